"""A fitted table as one plain MJCF file, whose head lists what it leaves out.

In: a model, and the initial places of its balls. Out: a `PlainTable`.

The file holds sizes, masses, noses and pockets, the slope as gravity, the other effects that MJCF can express
(said.py), and MuJoCo's own contact terms, fitted to the model (terms.py). The cost of what it leaves out is measured in
shots (costs.py), except for the jaws of pockets: here a pocket is a gap between straight noses.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from models.files import write_whole
from models.mjcf.export import text_of
from models.model_file import Model
from models.report.sheet import Presented, Sheet
from models.shot import Array
from sysid.mjcf.costs import SECONDS, SHOTS, Cost, costs_of, moves_balls
from sysid.mjcf.said import is_expressible, plain_spec
from sysid.mjcf.terms import FittedTerms, fit_terms

MUJOCO_VERSION = "3.3"  # oldest version that loads the file
LINE_WIDTH = 110  # of the head [characters]
COMPLETE_TEXT = "The file leaves out nothing of the model's motion: its contacts are MuJoCo's own."
COST_TEXT = f"distance of the struck ball after {SECONDS:g} s, median of {SHOTS} shots"


@dataclass(frozen=True, repr=False, eq=False)
class PlainTable(Presented):
    """A table as the text of a file, and the costs of what it leaves out."""

    text: str
    terms: FittedTerms
    costs: tuple[Cost, ...]  # the total first, then by cause

    def sheet(self) -> Sheet:
        """A table of the costs, by cause."""
        columns: dict[str, list[Any]] = {
            "cause": [c.cause for c in self.costs],
            "median_m": [c.median_m for c in self.costs],
        }
        rows = tuple((f"{c.median_m * 1000:.1f}", c.cause) for c in self.costs)
        return Sheet(
            columns,
            ("mm", "left out"),
            rows,
            (f"What the file leaves out: {COST_TEXT}" if self.costs else COMPLETE_TEXT,),
        )

    def save(self, path: Path | str) -> None:
        """Write the file, completely or not at all; BadInput if it cannot be written."""
        write_whole(path, self.text.encode(), parents=True)


def plain_table(
    model: Model, places: Mapping[str, Array], *, launcher: bool = False, bare: bool = False, origin: str = ""
) -> PlainTable:  # fmt: skip
    """A model as plain MJCF, with the balls at their initial places.

    Args:
        model: its parameters are numbers.
        places: initial place of each ball (2,) [m]; the first is the one to be struck.
        launcher: with the cue launcher behind the first ball.
        bare: without what is only seen.
        origin: where the model comes from, in words.

    Raises:
        BadInput: for invalid names or places of balls.
    """
    model = model.as_played()
    plain_spec(model, places, launcher=launcher, bare=bare)  # reports invalid balls before the long work
    moving = replace(model, effects=tuple(e for e in model.stack()[1:] if moves_balls(e)))
    terms = fit_terms(moving)
    spec = plain_spec(replace(moving, native=terms.native), places, terms.of_rails, launcher=launcher, bare=bare)
    costs = costs_of(moving, terms)
    return PlainTable(head(model, costs, origin) + text_of(spec), terms, costs)


def head(model: Model, costs: tuple[Cost, ...], origin: str) -> str:
    """The comment at the head of a file: what it holds, and what it leaves out."""
    effects = model.stack()[1:]
    said = [e.name() for e in effects if is_expressible(e)]
    unseen = [e.name() for e in effects if not moves_balls(e)]
    held = "Sizes, masses, noses and pockets are the model's" + (f", and so are {', '.join(said)}" if said else "")
    lines = [
        f"A billiard table for MuJoCo {MUJOCO_VERSION} or later{f', from {origin}' if origin else ''}. Units are SI.",
        f"{held}. The terms of contacts are fitted to the model; a rolling ball slows down as it does there.",
        "",
        f"What the file leaves out, as {COST_TEXT}: first in total, then each cause alone." if costs else COMPLETE_TEXT,
        *(f"  {cost.median_m * 1000:7.1f} mm  {cost.cause}" for cost in costs),
        "",
        "A pocket is a gap between straight noses: jaws, and a ball's fall over the slate's edge, are left out."
        if model.table.pockets
        else "The table has no pockets.",
    ]
    if unseen:
        lines.append(f"Effects of the camera are not part of the motion: {', '.join(unseen)}.")
    folded = [part for line in lines for part in textwrap.wrap(line, LINE_WIDTH, subsequent_indent="  ") or [""]]
    body = "\n".join(f"  {line}".rstrip() for line in folded)
    return f"<!--\n{body.replace('--', '- -')}\n-->\n"
