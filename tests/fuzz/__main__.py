"""Try changed inputs: `python -m tests.fuzz --count 200000`, or `--seconds 600`.

Sound files are taken apart as what they are (trees of TOML and JSON, tables of CSV and Parquet, chunks of PNG and AVI),
changed, and written again. Most are read in workers of this program, whose memory and time are limited; one in
`--verbs` is given to a command in a process of its own. Every trial follows from the seed and its number alone.

A failing input is kept in its own folder below --out, with what was wrong. Status 1 if there is any.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import select
import shlex
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from tests.fuzz.mutate import changed_command, changed_file
from tests.fuzz.readers import LIMIT_MEMORY, LIMIT_WAITING_S, READERS, FileReader, defect_of
from tests.fuzz.trial import prepare, tried
from tests.fuzz.verbs import SEEDS, VERBS, Command

BATCH = 400  # trials of one worker
MAX_KEPT_PER_DEFECT = 2
TOLD_EVERY_S = 60.0


def drawn_file(seed: int, number: int, readers: Sequence[FileReader]) -> tuple[FileReader, str, bytes]:
    """A reader, the name of the seed that is changed, and its content; of a trial's number."""
    rng = random.Random(f"file {seed} {number}")
    reader = rng.choices(readers, [one.share for one in readers])[0]
    name = rng.choice(reader.seeds)
    return reader, name, changed_file(rng, name)


def drawn_command(seed: int, number: int, only: str) -> Command:
    """The command of a trial's number."""
    verbs = [verb for verb in VERBS if verb.line.startswith(only)]
    return changed_command(random.Random(f"command {seed} {number}"), verbs)


def in_worker(seed: int, numbers: Sequence[int], readers: Sequence[FileReader]) -> Iterator[tuple[int, str, str]]:
    """Numbers of trials, readers and defects, as they end; the last one's where it ended the worker as well."""
    ours, theirs = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(ours)
        _work(theirs, seed, numbers, readers)
    os.close(theirs)
    done = 0
    with os.fdopen(ours, "rb") as results:
        while done < len(numbers):
            if not select.select([results], [], [], 1.5 * LIMIT_WAITING_S)[0]:
                os.kill(child, signal.SIGKILL)
                break
            if not (line := results.readline()):
                break
            yield numbers[done], *json.loads(line)
            done += 1
    _, code = os.waitpid(child, 0)
    if done < len(numbers):
        reader = drawn_file(seed, numbers[done], readers)[0]
        yield numbers[done], reader.name, f"{reader.name}: worker ended with {os.waitstatus_to_exitcode(code)}"


def _work(to: int, seed: int, numbers: Sequence[int], readers: Sequence[FileReader]) -> None:
    """A worker: never returns."""
    try:
        own = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (own + LIMIT_MEMORY + (1 << 29),) * 2)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        with tempfile.TemporaryDirectory(prefix="cuelab-fuzz-") as place:
            work = Path(place, "seeds")
            shutil.copytree(SEEDS, work)
            for number in numbers:
                reader, name, raw = drawn_file(seed, number, readers)
                (work / name).write_bytes(raw)
                del raw
                defect = defect_of(reader, work / name)
                shutil.copyfile(SEEDS / name, work / name)
                os.write(to, json.dumps([reader.name, defect]).encode() + b"\n")
    finally:
        os._exit(0)


class Campaign:
    """What was tried, and what was wrong."""

    def __init__(self, out: Path) -> None:
        """Nothing is tried yet."""
        self.out, self.counts, self.defects = out, Counter[str](), Counter[str]()

    def count(self, kind: str, defect: str) -> bool:
        """Count a trial; whether it is to be kept."""
        self.counts[kind] += 1
        self.defects.update([defect] * bool(defect))
        return bool(defect) and self.defects[defect] <= MAX_KEPT_PER_DEFECT

    def keep(self, name: str, files: dict[str, bytes], text: str) -> None:
        """Keep a failing input in a folder of its own."""
        folder = self.out / name
        shutil.rmtree(folder, ignore_errors=True)
        for file, content in files.items():
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            (folder / file).write_bytes(content)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "defect.txt").write_text(text, encoding="utf-8", errors="backslashreplace")
        print(f"{folder}: {text.splitlines()[-1]}", flush=True)


def main(words: Sequence[str] | None = None) -> int:
    """Try changed inputs: 0 no defect, 1 some."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--count", type=int, default=10**9)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first trial")
    parser.add_argument("--verbs", type=int, default=40, help="one of so many trials is a command; 0 for none")
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"))
    parser.add_argument("--only", default="", help="verbs, or readers, whose line begins so, such as 'sysid check'")
    given = parser.parse_args(words)
    if given.seconds == float("inf") and given.count == 10**9:
        parser.error("give --seconds or --count")
    readers = [reader for reader in READERS if reader.name.startswith(given.only)]
    commands = given.verbs if any(verb.line.startswith(given.only) for verb in VERBS) else 0
    if not readers and not commands:
        parser.error(f"--only {given.only}: neither a reader nor a verb begins so")
    prepare()
    campaign, began, told = Campaign(given.out), time.monotonic(), 0.0
    todo, end = given.first, given.first + given.count
    with tempfile.TemporaryDirectory(prefix="cuelab-fuzz-") as place:
        while todo < end and time.monotonic() - began < given.seconds:
            numbers = range(todo, min(todo + BATCH, end))
            of_files = [n for n in numbers if readers and not (commands and n % commands == 0)]
            while of_files and time.monotonic() - began < given.seconds:
                for number, kind, defect in in_worker(given.seed, of_files, readers):
                    if campaign.count(kind, defect):
                        _, name, raw = drawn_file(given.seed, number, readers)
                        campaign.keep(f"file-{number}", {name: raw}, f"{name}\n{defect}\n")
                of_files = of_files[of_files.index(number) + 1 :]
            for number in numbers if commands else ():
                if number % commands == 0 or not readers:
                    if time.monotonic() - began >= given.seconds:
                        break
                    command = drawn_command(given.seed, number, given.only)
                    ended = tried(command, Path(place, "trial"))
                    if campaign.count(" ".join(command.verb.words[:2]), ended.defect):
                        line = f"cd in && python -m {command.words[0]}.cli {shlex.join(command.words[1:])}"
                        text = f"{line}\nstatus {ended.status}\n{ended.defect}\n"
                        campaign.keep(f"command-{number}", {f"in/{n}": c for n, c in command.files.items()}, text)
            todo = numbers[-1] + 1
            if time.monotonic() - told > TOLD_EVERY_S:
                told = time.monotonic()
                print(f"{told - began:.0f} s  {campaign.counts.total()} inputs, {len(campaign.defects)} kinds of "
                      f"defects", flush=True)  # fmt: skip
    for kind, count in sorted(campaign.counts.items()):
        print(f"{count:8} {kind}")
    campaign.defects = +campaign.defects
    for defect, count in campaign.defects.most_common():
        print(f"{count:8} {defect}")
    total = campaign.counts.total()
    rate = total / (time.monotonic() - began)
    print(f"{total} changed inputs, {campaign.defects.total()} of them with defects, {rate:.1f}/s")
    return 1 if campaign.defects else 0


if __name__ == "__main__":
    sys.exit(main())
