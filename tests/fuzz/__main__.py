"""Try damaged inputs for a time or a count: `python -m tests.fuzz --seconds 600`, or `--count 5000`.

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
from collections.abc import Sequence
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings

from tests.fuzz.damage import Damaged, commands
from tests.fuzz.trial import Ended, prepare, tried

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


class Campaign:
    """Damaged commands tried one after the other, and their defects."""

    def __init__(self, out: Path, only: str) -> None:
        """Nothing is tried yet."""
        self.out, self.only, self.count, self.since = out, only, 0, 0
        self.defects: dict[str, int] = {}
        self.verbs: dict[str, float] = {}  # seconds

    def run(self, number: int, count: int, ends: float) -> None:
        """Try the commands of one seed."""
        with tempfile.TemporaryDirectory(prefix="cuelab-fuzz-") as place:

            @seed(number)
            @settings(
                max_examples=count, deadline=None, database=None, phases=[Phase.generate],
                suppress_health_check=list(HealthCheck),
            )  # fmt: skip
            @given(command=commands(self.only))
            def one(command: Damaged) -> None:
                if time.monotonic() < ends:
                    self.judge(command, Path(place, "trial"))

            one()

    def judge(self, command: Damaged, work: Path) -> None:
        """Try one command, and keep it where it shows a defect."""
        began = time.monotonic()
        ended = tried(command, work)
        name = " ".join(command.verb.words[:2])
        self.verbs[name] = self.verbs.get(name, 0.0) + time.monotonic() - began
        self.count += 1
        self.since += 1
        if not ended.defect:
            return
        self.since = 0
        known = self.defects.get(ended.defect, 0)
        self.defects[ended.defect] = known + 1
        if known < MAX_KEPT_PER_DEFECT:
            print(f"{keep(self.out, command, ended, work)}: {ended.defect}", flush=True)


def main(words: Sequence[str] | None = None) -> int:
    """Try damaged inputs: 0 no defect, 1 some."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--count", type=int, default=10**9)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"))
    parser.add_argument("--only", default="", help="verbs whose command line begins so, such as 'sysid check'")
    given_words = parser.parse_args(words)
    if given_words.seconds == float("inf") and given_words.count == 10**9:
        parser.error("give --seconds or --count")
    prepare()
    campaign, ends, number = Campaign(given_words.out, given_words.only), time.monotonic() + given_words.seconds, 0
    while campaign.count < given_words.count and time.monotonic() < ends:
        campaign.run(1000 * given_words.seed + number, min(BATCH, given_words.count - campaign.count), ends)
        number += 1
    kinds = len(campaign.defects)
    print(f"{campaign.count} damaged commands, {kinds} kinds of defects, {campaign.since} since the last")
    return 1 if kinds else 0


if __name__ == "__main__":
    sys.exit(main())
