"""Kill the verbs that continue at random moments: `python -m tests.kills --runs 200`.

Prints a row for each verb; status 1 where finished work was lost, a process lived on, or a result differs from that of
an undisturbed run. The moments are random; on another machine they fall elsewhere.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from models.commands.console import table
from sysid.prepare import prepare
from tests.kills.course import SIGNALS, Course, Tally
from tests.kills.works import WORKS

KILLS_IN_A_ROW = 5  # before a command is let to its end


def main(words: Sequence[str] | None = None) -> int:
    """Kill: 0 nothing is wrong, 1 something."""
    parser = argparse.ArgumentParser(prog="python -m tests.kills", description=__doc__)
    parser.add_argument("--runs", type=int, default=200, help="kills in all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--verbs", nargs="+", choices=list(WORKS), default=list(WORKS))
    asked = parser.parse_args(words)
    prepare()  # a compiler that has begun does not hear a signal
    rng, tallies = np.random.default_rng(asked.seed), {name: Tally() for name in asked.verbs}
    with tempfile.TemporaryDirectory(prefix="cuelab-kills-") as place:
        courses = {name: Course(name, WORKS[name], Path(place, name)) for name in asked.verbs}
        done = 0
        while done < asked.runs:
            name = min(asked.verbs, key=lambda name: tallies[name].kills.total())
            seen, signals = len(tallies[name].wrong), [SIGNALS[k] for k in rng.permutation(len(SIGNALS))]
            courses[name].run(min(KILLS_IN_A_ROW, asked.runs - done), rng, tallies[name], signals)
            for wrong in tallies[name].wrong[seen:]:
                print(f"{name}: {wrong}", flush=True)
            done = sum(t.kills.total() for t in tallies.values())
            print(f"{done} of {asked.runs} kills", file=sys.stderr, flush=True)
    rows: list[tuple[str, ...]] = [("verb", *(s.name for s in SIGNALS), "as undisturbed", "wrong")]
    for name, tally in tallies.items():
        rows.append((name, *(str(tally.kills[s.name]) for s in SIGNALS), str(tally.ended), str(len(tally.wrong))))
    print(table(rows))
    return 1 if any(tally.wrong for tally in tallies.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
