"""`python -m tests.study`: measure how reliably `discover` finds hidden effects; hours, and resumable."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time
from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from models.commands.console import write_json
from models.errors import BadInput
from models.workers import open_workers
from tests.study.plan import Entry, plan
from tests.study.report import REPORT, write_report
from tests.study.run import (
    OUT,
    Running,
    fingerprint,
    read_result,
    result_path,
    stopped_in_the_end,
    study_there,
    valid,
)

POLL = 0.2  # [s]
INTERRUPTED = 130


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser(prog="python -m tests.study", description="How reliably hidden effects are found.")
    p.add_argument("--only", metavar="PATTERN", help="sets whose name holds this, or matches it with * and ?")
    p.add_argument("--workers", type=int, default=os.cpu_count() or 1, metavar="N", help="sets at a time (all cores)")
    p.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask scheduler whose workers run the sets instead")
    p.add_argument("--limit", type=int, metavar="N", help="run at most so many, then report")
    p.add_argument("--report-only", action="store_true", help="run none; write the report from the results there are")
    p.add_argument("--keep", action="store_true", help="results made by other sources count as well")
    p.add_argument("--out", type=Path, default=OUT, metavar="DIR", help="where sets and results are (out/study)")
    p.add_argument("--report", type=Path, default=REPORT, metavar="FILE", help="default: tests/study/REPORT.md")
    return p


def chosen(entries: Sequence[Entry], pattern: str | None) -> list[Entry]:
    """The sets that a pattern names."""
    if pattern is None:
        return list(entries)
    text = pattern if set("*?[") & set(pattern) else f"*{pattern}*"
    return [e for e in entries if fnmatch(e.name, text)]


def to_do(entries: Sequence[Entry], out: Path, mark: str, keep: bool) -> list[Entry]:
    """Those without a result of these sources."""
    return [e for e in entries if not valid(e, read_result(e.name, out), mark, keep)]


def told(entry: Entry, result: dict[str, Any] | None) -> str:
    """One finished set in a line."""
    if result is None:
        return f"{entry.name}: not kept, the sources changed while it ran"
    if result["error"]:
        return f"{entry.name}: FAILED: {result['error']}"
    said = ", ".join(result["verdict"]) or "nothing"
    where = f"; unexplained: {result['unexplained']['where']}" if result["unexplained"] else ""
    return f"{entry.name}: {said}{where} ({result['elapsed_s']:.0f} s)"


def run_all(todo: Sequence[Entry], workers: int, out: Path, mark: str) -> int:
    """Run sets side by side; how many were done."""
    waiting, done = list(todo), 0
    took: list[float] = []
    with stopped_in_the_end([]) as running:
        while waiting or running:
            while waiting and len(running) < workers:
                slot = min(set(range(workers)) - {r.slot for r in running})
                running.append(Running(waiting.pop(0), mark, out, slot=slot))
            time.sleep(POLL)
            for one in [r for r in running if r.done()]:
                running.remove(one)
                done += 1
                took.append(one.elapsed)
                left = sum(took) / len(took) * (len(todo) - done) / workers
                line = told(one.entry, read_result(one.entry.name, out))
                print(f"{done}/{len(todo)}  {line}; {left / 60:.0f} min left", flush=True)
    return done


def run_there(todo: Sequence[Entry], scheduler: str, out: Path, mark: str) -> None:
    """Run sets on a cluster; BadInput where it is out of reach, or its sources are others."""
    with open_workers(scheduler, 0) as workers:
        for done, (number, result) in enumerate(workers.as_they_come(study_there, [(e.name,) for e in todo]), 1):
            if result["fingerprint"] != mark:
                raise BadInput(f"--scheduler {scheduler}: a worker has other sources of the study; update them")
            path = result_path(result["name"], out)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_json(path, result)
            print(f"{done}/{len(todo)}  {told(todo[number], result)}", flush=True)


def main(argv: Sequence[str] | None = None) -> int:
    """Run what has no result, then report: 0 done, 2 bad input, 130 interrupted."""
    args = parser().parse_args(argv)
    entries = plan()
    some = chosen(entries, args.only)
    if not some:
        print(f"error: --only {args.only}: no set has such a name, e.g. {entries[1].name}", file=sys.stderr)
        return 2
    if args.workers < 1 or (args.limit is not None and args.limit < 0):
        print("error: --workers must be at least 1, --limit at least 0", file=sys.stderr)
        return 2
    mark = fingerprint()
    todo = [] if args.report_only else to_do(some, args.out, mark, args.keep)[: args.limit]
    status = 0
    if not args.report_only:
        print(f"{len(entries)} sets in the plan, {len(todo)} to run now, {args.workers} at a time", flush=True)
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        try:
            if args.scheduler:
                run_there(todo, args.scheduler, args.out, mark)
            else:
                run_all(todo, args.workers, args.out, mark)
        except BadInput as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
        except KeyboardInterrupt:
            status = INTERRUPTED
            print("interrupted: finished sets are kept, and the next run goes on from them", file=sys.stderr)
    now = fingerprint()
    if now != mark and not args.keep:
        print("the sources changed meanwhile: results from before count only with --keep", file=sys.stderr)
    used, left_out = [], 0
    for entry in entries:
        result = read_result(entry.name, args.out)
        if valid(entry, result, now, args.keep) and result is not None:
            used.append(result)
        else:
            left_out += result is not None
    if not used:
        print("no results of these sources, so no report", file=sys.stderr)
        return status or 1
    write_report(args.report, used, len(entries))
    outdated = f"; {left_out} outdated ones left out" if left_out else ""
    print(f"{args.report}: {len(used)} of {len(entries)} sets{outdated}")
    return status


if __name__ == "__main__":
    sys.exit(main())
