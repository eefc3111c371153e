"""The closed loop on a table that shares no code with the models: `python -m tests.robot.learn_truth --out DIR`.

Shots of the emulated launcher are played by tests/truth in place of the project's own engine, with other constants than
the loop begins with and one effect, of the catalogue or not. Its pockets swallow and have no jaws, so that the pots
that the plans promise are not what is tried here, but the cue ball's miss and what is found.
"""

from __future__ import annotations

import argparse
import math
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from models.analytic.cue_impulse import CONSTANT_NAMES, Constants, Geometry, launch
from models.commands.console import Progress
from models.model_file import full_model
from models.shot import GRAVITY, Array, Track
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE
from planner.launcher.cueing_map import CueingMap
from planner.launcher.execution import Execution
from robot.emulator.table import EmulatedTable
from robot.learning.emulated_rig import EmulatedRig, draw_hidden_cue
from robot.learning.loop import LearningConfig, learn
from robot.learning.report import sentences, write_report
from tests.truth.cloth import Constants as Truth
from tests.truth.physics import Start, Table, simulate
from tests.truth.sizes import NATURAL

# Another cloth, other balls and cushions than the loop begins with.
WRONG = {"mus": 0.235, "mur": 0.0098, "spin": 27.0, "ebb": 0.945, "mubb": 0.065, "ec": 0.86, "muc": 0.17}


class TruthTable(EmulatedTable):
    """An emulated table whose balls are moved by tests/truth."""

    def __init__(self, truth: Truth, *args: Any, **rest: Any) -> None:
        """As the other, after the constants of its world."""
        self.truth = truth
        super().__init__(*args, **rest)

    def _delivered(self, cue_speed: float, side: float, height: float) -> tuple[Array, Array]:
        """Velocity and spin (3,) of the ball by the balance of impulses, table frame."""
        one = (np.array([v]) for v in (cue_speed, side, height))
        c, s = math.cos(self.azimuth), math.sin(self.azimuth)
        about = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        velocity, spin = launch(self.options.constants, Geometry(SNOOKER_BALL), *one)
        return about @ velocity[0], about @ spin[0]

    def _shot(self, cue_speed: float, side: float, height: float) -> Track:
        names = (self._cue, *(n for n in self._places if n != self._cue))
        velocity, spin = (tuple(map(float, v)) for v in self._delivered(cue_speed, side, height))
        lie = {n: (float(self._places[n][0]), float(self._places[n][1])) for n in names}
        balls = {n: Start(lie[n]) for n in names} | {self._cue: Start(lie[self._cue], velocity[:2], spin)}
        longest = 2.0 * (math.hypot(*velocity[:2]) / (self.truth.mur * GRAVITY)) + 1.0
        times = np.arange(math.ceil(longest * self.fps) + 1) / self.fps
        motion = simulate(Table(), self.truth, {n: balls[n] for n in names}, times)
        xy, v, w, theta = (a[:, [motion.names.index(n) for n in names]] for a in
                           (motion.xy, motion.velocity, motion.omega, motion.theta))  # fmt: skip
        return Track(names, motion.times, xy, v, w, theta)


def main() -> int:
    """Play a series and tell what it came to."""
    parser = argparse.ArgumentParser(prog="python -m tests.robot.learn_truth", description=main.__doc__)
    parser.add_argument("--out", required=True, help="folder of the series; one that is there goes on")
    parser.add_argument("--effect", choices=sorted(NATURAL), default="table_tilt")
    parser.add_argument("--shots", type=int, default=20)
    parser.add_argument("--every", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    truth = Truth(**(WRONG | NATURAL[args.effect]))
    start = full_model(SNOOKER_TABLE, SNOOKER_BALL)
    unknown = CueingMap(Constants(), Geometry(SNOOKER_BALL), np.full((len(CONSTANT_NAMES),) * 2, math.nan), Execution())
    cue = draw_hidden_cue(np.random.default_rng([args.seed, 7]))
    stand = EmulatedRig(start, cue, seed=args.seed, make=partial(TruthTable, truth))
    course = LearningConfig(start, unknown, args.shots, args.every, args.seed, stops=False)
    progress = Progress()

    def say(line: str) -> None:
        progress.close()
        print(line, flush=True)

    story = learn(args.out, course, stand, say, progress)
    progress.close()
    print("\n".join(sentences(story)))
    for name, (value, sd) in (story.refits[-1].values if story.refits else {}).items():
        print(f"{name:32s} {value:.6g} +- {sd:.2g}")
    print(f"really: {truth}")
    write_report(Path(args.out) / "report.html", story, f"The closed loop on an independent table: {args.effect}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
