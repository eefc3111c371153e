"""Play random shots and judge them: `python -m tests.random_shots --shots 100000`, `--seed` to begin elsewhere.

Every breach is printed in a line with the batch and the row that give it again; status 1 if there is any. The same
seed gives the same shots.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Sequence

from tests.random_shots.draws import batch
from tests.random_shots.laws import breaches, play

BATCH = 64  # shots
PROGRESS_INTERVAL_S = 30.0
MAX_SHOWN = 20  # lines of one law


def main(words: Sequence[str] | None = None) -> int:
    """Play and judge: 0 no breach, 1 some."""
    parser = argparse.ArgumentParser(prog="python -m tests.random_shots", description=__doc__)
    parser.add_argument("--shots", type=int, default=6400)
    parser.add_argument("--seed", type=int, default=0, help="of the first batch")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="after which no other batch begins")
    parser.add_argument("--threads", type=int, default=1)
    asked = parser.parse_args(words)
    found: Counter[str] = Counter()
    began, seed, done, most = time.monotonic(), asked.seed, 0, 0
    shown = began
    while done < asked.shots and (now := time.monotonic()) - began < asked.seconds:
        if now - shown > PROGRESS_INTERVAL_S:
            shown = now
            print(f"{done} of {asked.shots} shots, {now - began:.0f} s", file=sys.stderr, flush=True)
        one = batch(seed, min(BATCH, asked.shots - done))
        played = play(one, asked.threads)
        most = max(most, int(played.result.counts.sum(axis=1).max()))
        for breach in breaches(one, played):
            found[breach.law] += 1
            if found[breach.law] <= MAX_SHOWN:
                effects = ", ".join(e.name() for e in one.model.effects[3:])
                what = f"{len(one.shots[0].names)} balls, {one.layout}{', jaws' if one.jaws else ''}; {effects}"
                print(f"seed {seed} row {breach.row}: {breach.law}: {breach.said} ({what})", flush=True)
        done, seed = done + len(one.shots), seed + 1
    rate = done / (time.monotonic() - began)
    print(f"{done} shots, {sum(found.values())} breaches {dict(found)}, at most {most} events, {rate:.0f} shots/s")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
