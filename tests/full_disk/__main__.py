"""Fill the disk under every verb that writes: `python -m tests.full_disk --points 50`.

Prints a row for each verb; status 1 where one hung, left half a file, or said a line that is not ours. Half of the
points are disks of random room, where this process may mount one; the others are random bytes at which files end.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from models.commands.console import table
from tests.full_disk.course import Course, NotHere, Tally, prepare
from tests.full_disk.disk import can_mount
from tests.full_disk.works import WORKS, film


def main(words: Sequence[str] | None = None) -> int:
    """Fill disks: 0 nothing is wrong, 1 something."""
    parser = argparse.ArgumentParser(prog="python -m tests.full_disk", description=__doc__)
    parser.add_argument("--points", type=int, default=50, help="of each verb")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--verbs", nargs="+", choices=list(WORKS), default=list(WORKS))
    asked = parser.parse_args(words)
    prepare()
    mounted = can_mount()
    if not mounted:
        print("no file system may be mounted here: files end at random bytes instead")
    rows: list[tuple[str, ...]] = [("verb", "points", "refused", "ended well", "wrong", "s a point")]
    bad = False
    with tempfile.TemporaryDirectory(prefix="cuelab-disk-") as place:
        films = Path(place, "films")
        if any("{films}" in WORKS[name] for name in asked.verbs):
            film(films)
        for name in asked.verbs:
            tally, began = Tally(), time.monotonic()
            rng = np.random.default_rng([asked.seed, *name.encode()])
            try:
                course = Course(WORKS[name].format(films=films), Path(place, "work"), mounted=mounted)
            except NotHere as error:
                print(f"{name}: left out, does not run here: {error}", flush=True)
                continue
            course.points(asked.points, rng, tally, lambda text: print(text, flush=True))
            took = (time.monotonic() - began) / max(asked.points, 1)
            well = tally.ended[0] + tally.ended[1]
            rows.append((name, str(asked.points), str(tally.ended[2]), str(well), str(len(tally.wrong)), f"{took:.1f}"))
            print(f"{' '.join(rows[-1])}", file=sys.stderr, flush=True)
            bad |= bool(tally.wrong)
    print(table(rows))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
