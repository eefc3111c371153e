"""Try damaged inputs for a time or a count: `python -m tests.fuzz --seconds 600`, or `--count 5000`.

With `--readers` files are read in this process, without a command, many times as fast.

A failing input is kept in its own folder below --out, with `command.txt` to run there and what was wrong. Status 1 if
there is any. The same seed tries the same commands.
"""

from __future__ import annotations

import argparse
import hashlib
import shlex
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis.strategies import SearchStrategy

from tests.fuzz.damage import Damaged, commands, damaged_files
from tests.fuzz.readers import READERS, FileReader, defect_of
from tests.fuzz.trial import Ended, prepare, tried
from tests.fuzz.verbs import SEEDS

BATCH = 50  # commands of one seed
MAX_KEPT_PER_DEFECT = 2


def keep(out: Path, command: Damaged, ended: Ended, work: Path) -> Path:
    """Keep a failing input in a folder that is named by its defect."""
    name = hashlib.sha256(repr((command.words, sorted(command.files.items()))).encode()).hexdigest()[:10]
    folder = out / name
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(work, folder, ignore=shutil.ignore_patterns("stdout"))
    for path, content in command.files.items():
        (folder / "in" / path).write_bytes(content)
    line = f"cd in && python -m {command.words[0]}.cli {shlex.join(command.words[1:])}"
    text = f"{line}\n\n{ended.defect}\nstatus {ended.status}\ndamaged: {', '.join(command.files)}\n"
    (folder / "command.txt").write_text(text, encoding="utf-8", errors="backslashreplace")
    return folder


def keep_file(out: Path, name: str, raw: bytes, defect: str) -> Path:
    """Keep a file that is read badly in a folder of its own."""
    folder = out / hashlib.sha256(name.encode() + raw).hexdigest()[:10]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / Path(name).name).write_bytes(raw)
    (folder / "defect.txt").write_text(f"{name}\n{defect}\n", encoding="utf-8", errors="backslashreplace")
    return folder


class Campaign:
    """Damaged commands, or files, tried one after the other, and their defects."""

    def __init__(self, out: Path) -> None:
        """Nothing is tried yet."""
        self.out, self.count, self.since = out, 0, 0
        self.defects: dict[str, int] = {}

    def run(self, number: int, count: int, ends: float, drawn: SearchStrategy[Any], judge: Callable[..., None]) -> None:
        """Judge what is drawn from one seed, in a folder of its own."""
        with tempfile.TemporaryDirectory(prefix="cuelab-fuzz-") as place:

            @seed(number)
            @settings(
                max_examples=count, deadline=None, database=None, phases=[Phase.generate],
                suppress_health_check=list(HealthCheck),
            )  # fmt: skip
            @given(one=drawn)
            def each(one: Any) -> None:
                if time.monotonic() < ends:
                    judge(one, Path(place, "trial"))

            each()

    def command(self, command: Damaged, work: Path) -> None:
        """Try one command, and keep it where it shows a defect."""
        ended = tried(command, work)
        if self._counted(ended.defect):
            print(f"{keep(self.out, command, ended, work)}: {ended.defect}", flush=True)

    def file(self, damaged: tuple[FileReader, str, bytes], work: Path) -> None:
        """Read one file, and keep it where that shows a defect."""
        reader, name, raw = damaged
        if not work.exists():
            shutil.copytree(SEEDS, work)
        (work / name).write_bytes(raw)
        defect = defect_of(reader, work / name)
        shutil.copyfile(SEEDS / name, work / name)
        if self._counted(defect):
            print(f"{keep_file(self.out, name, raw, defect)}: {defect}", flush=True)

    def _counted(self, defect: str) -> bool:
        """Count a trial; whether it is to be kept."""
        self.count += 1
        self.since += 1
        if not defect:
            return False
        self.since = 0
        self.defects[defect] = self.defects.get(defect, 0) + 1
        return self.defects[defect] <= MAX_KEPT_PER_DEFECT


def main(words: Sequence[str] | None = None) -> int:
    """Try damaged inputs: 0 no defect, 1 some."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--count", type=int, default=10**9)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"))
    parser.add_argument("--only", default="", help="verbs, or readers, whose line begins so, such as 'sysid check'")
    parser.add_argument("--readers", action="store_true", help="read files in this process, without commands")
    given_words = parser.parse_args(words)
    if given_words.seconds == float("inf") and given_words.count == 10**9:
        parser.error("give --seconds or --count")
    campaign, began, number = Campaign(given_words.out), time.monotonic(), 0
    only, ends = given_words.only, began + given_words.seconds
    drawn: SearchStrategy[Any]
    if given_words.readers:
        drawn, judge = damaged_files([r for r in READERS if r.name.startswith(only)]), campaign.file
    else:
        prepare()
        drawn, judge = commands(only), campaign.command
    while campaign.count < given_words.count and time.monotonic() < ends:
        count = min(BATCH, given_words.count - campaign.count)
        campaign.run(1000 * given_words.seed + number, count, ends, drawn, judge)
        number += 1
    kinds = len(campaign.defects)
    rate, what = campaign.count / (time.monotonic() - began), "files" if given_words.readers else "commands"
    print(f"{campaign.count} damaged {what}, {kinds} kinds of defects, {campaign.since} since the last, {rate:.1f}/s")
    return 1 if kinds else 0


if __name__ == "__main__":
    sys.exit(main())
