"""Stop a series from outside at random moments, in real time: `python -m tests.stops --rounds 100`.

Prints a row for each way; status 1 where a stop was not confirmed, a stroke followed it, or the launcher still moved
half a second after its controller was gone. The moments are random; on another machine they fall elsewhere.
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence

import numpy as np

from models.commands.console import table
from tests.stops.rounds import FROM_ELSEWHERE, MAY_GO_ON, STANDS_WITHIN_S, WAYS, Round, play


def main(words: Sequence[str] | None = None) -> int:
    """Stop: 0 nothing is wrong, 1 something."""
    parser = argparse.ArgumentParser(prog="python -m tests.stops", description=__doc__)
    parser.add_argument("--rounds", type=int, default=100, help="of each way")
    parser.add_argument("--rate", type=float, default=0.05, help="faults a line, where another shell stops the series")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--ways", nargs="+", choices=list(WAYS), default=list(WAYS))
    asked = parser.parse_args(words)
    head = ("way", "rounds", "confirmed", "strokes after", "moved after 0.5 s", "stopped", "median ms", "worst ms")
    rows: list[tuple[str, ...]] = [head]
    signal.signal(signal.SIGQUIT, signal.SIG_DFL)  # ignored in the background of a script, and by what is begun there
    wrong = 0
    for way in asked.ways:
        elsewhere, rounds = way in FROM_ELSEWHERE, list[Round]()
        for k in range(asked.rounds):
            rng = np.random.default_rng([asked.seed, list(WAYS).index(way), k])
            rounds.append(play(way, rng, asked.rate if elsewhere else 0.0))
            for fault in faults_of(rounds[-1]):
                wrong += 1
                print(f"{way}, round {k}: {fault}: {rounds[-1]}", flush=True)
            print(f"{way}: {k + 1} of {asked.rounds}", file=sys.stderr, flush=True)
        stood = 1e3 * np.array([r.stood_s for r in rounds])
        confirmed, late = sum(r.confirmed for r in rounds), sum(r.stood_s > STANDS_WITHIN_S for r in rounds)
        counts = (str(confirmed), "-") if elsewhere else ("-", str(late))
        rows.append((
            way, str(len(rounds)), counts[0], str(sum(r.later for r in rounds)), counts[1],
            str(sum(r.stopped for r in rounds)), f"{np.median(stood):.0f}", f"{stood.max():.0f}",
        ))  # fmt: skip
    print(table(rows))
    return 1 if wrong else 0


def faults_of(done: Round) -> list[str]:
    """What is wrong with a round."""
    faults = []
    if done.way in FROM_ELSEWHERE:
        faults += ["not confirmed"] * (not done.confirmed)
    else:
        faults += [f"moved {done.stood_s:.3f} s"] * (done.stood_s > STANDS_WITHIN_S)
    faults += [f"{done.later} strokes afterwards"] * bool(done.later)
    if done.status is None:
        faults += ["did not end"] * (done.stopped or done.way not in MAY_GO_ON)
    elif done.way != "KILL":  # it says how it ended, in one line
        faults += [f"{len(done.told)} lines at its end"] * (len(done.told) != 1)
        faults += [f"status {done.status}"] * (done.status != (128 + signal.SIGQUIT if done.way == "QUIT" else 1))
    return faults


if __name__ == "__main__":
    sys.exit(main())
