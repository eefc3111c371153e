"""The `planner` command: a scene from a picture or a file, a shot for it, statistics over many."""

from __future__ import annotations

from collections.abc import Sequence

from models.commands.program import Program, run
from planner.cli import plan, review, scene, study, view

PROGRAM = Program(
    "planner",
    "Plan shots that allow for the errors of the launcher and of the model.",
    {"One shot": (scene.scene, plan.plan, review.review, view.view), "Many shots": (study.study,)},
)


def main(words: Sequence[str] | None = None) -> int:
    """Run a verb: 0 done, 1 a finding to act on (no shot is reasonable), 2 bad input."""
    return run(PROGRAM, words, interrupted="; files named above are complete")
