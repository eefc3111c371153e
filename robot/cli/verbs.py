"""The `robot` command.

Without --port no hardware moves: plans go to an emulated launcher at an emulated table, and the command says so. An
interrupt stops the launcher before anything else (robot/device/link.py).
"""

from __future__ import annotations

from collections.abc import Sequence

from models.commands.program import Program, run
from robot.cli import align, learn, measure, play, review, single, strings
from robot.device.protocol import LauncherError

PROGRAM = Program(
    "robot",
    "Use the cue launcher, with and without hardware.",
    {
        "Strokes": (play.play, align.align, learn.learn, review.review),
        "Measurements of the launcher": (measure.campaign, measure.map_, strings.repeat, strings.calibrate),
        "The launcher itself": (single.status, single.home, single.stop, single.reset, single.emulate),
    },
)


def main(words: Sequence[str] | None = None) -> int:
    """Run a verb: 0 done, 1 the launcher needs attention, 2 bad input."""
    return run(PROGRAM, words, failures=(LauncherError,))
