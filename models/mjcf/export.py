"""A table, its balls and, optionally, the launcher as one plain MJCF file for any MuJoCo viewer.

Its contacts are MuJoCo's own, with the shipped native terms (models/mjcf/native.py); models/README.md describes their
limits. `sysid export` writes a fitted table with its own terms. The shipped file, short enough to read, was made with
`python -m models.mjcf.export models/mjcf/table.xml --bare --balls white,red,black`.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import mujoco
import numpy as np

from models.commands.console import Status
from models.commands.options import FILE_PATH, gathered, given
from models.commands.program import lone_command, run
from models.errors import BadInput
from models.files import write_whole
from models.mjcf.launcher import SLATE_IMPEDANCE, attach_launcher
from models.mjcf.world import build_spec
from models.model_file import Model
from models.shot import Array, Ball, Table, largest_overlap
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE, racked


def export(
    model: Model, places: Mapping[str, Array], path: Path | str, *, launcher: bool = False, bare: bool = False
) -> None:
    """Write a model's native world, completely or not at all; see `spec_of`."""
    write_whole(path, text_of(spec_of(model, places, launcher=launcher, bare=bare)).encode(), parents=True)


def text_of(spec: mujoco.MjSpec) -> str:
    """A world as MJCF for MuJoCo 3.3 or later, without entries that only newer versions know."""
    return re.sub(r' colorspace="auto"| input="(pos|vel)"', "", spec.to_xml())


def spec_of(model: Model, places: Mapping[str, Array], *, launcher: bool = False, bare: bool = False) -> mujoco.MjSpec:
    """A model's native world, with the balls at `places`, (2,) [m] each.

    A launcher is aimed at the first ball, along +x. A bare world has no purely visual parts; its noses are visible.
    """
    names = tuple(places)
    xy = np.array([places[name] for name in names], float).reshape(-1, 2)
    _check(model, names, xy)
    spec = build_spec(model.table, model.ball, names, (model.native,), furnished=not bare)
    for name, at in zip(names, xy, strict=True):
        spec.body(name).pos[:2] = at
    if launcher:
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST  # the servo's and the leather's damping
        attach_launcher(spec, names[0], model.ball, aim=np.append(xy[0], model.ball.radius))
        bed = next(p for p in spec.pairs if {p.geomname1, p.geomname2} == {f"ball {names[0]}", "bed"})
        bed.solimp = SLATE_IMPEDANCE
    if bare:
        for geom in spec.geoms:
            geom.group = 0 if geom.name.startswith("cushion") else geom.group
    spec.compiler.conflict = mujoco.mjtConflict.mjCONFLICT_WARNING  # the default, which MuJoCo 3.3 does not know yet
    try:
        spec.compile()
    except ValueError as error:
        raise BadInput(f"MuJoCo rejects this world ({str(error).splitlines()[0]}); change names or sizes") from error
    return spec


def _check(model: Model, names: Sequence[str], xy: Array) -> None:
    """Raise BadInput for invalid names or places."""
    for name, at in zip(names, xy, strict=True):
        if not name or name == "world" or "/" in name:
            raise BadInput(
                f"{name!r} is not a valid name of a ball; names are not empty, not world, and without slashes"
            )
        if not np.all(np.abs(at) <= model.table.centre_limits(model.ball)):
            raise BadInput(
                f"ball {name!r} at {at.round(3).tolist()} is not on the table; use fewer balls, or a larger table"
            )
    depth, i, j = largest_overlap(xy, model.ball)
    if depth > 0.0:
        raise BadInput(f"balls {names[i]!r} and {names[j]!r} overlap; place them apart, or use smaller ones")


def in_a_row(names: Sequence[str], ball: Ball) -> dict[str, Array]:
    """Balls side by side in the middle of the table."""
    gap = ball.diameter * 1.5
    return {name: np.array([(k - (len(names) - 1) / 2) * gap, 0.0]) for k, name in enumerate(names)}


def places_of(model: Model, balls: Sequence[str] | None) -> dict[str, Array]:
    """Balls with these names side by side; by default a snooker frame, the white first."""
    if balls is None:
        spots = racked(model.table, model.ball)
        return {"white": spots.pop("white"), **spots}
    if len(set(balls)) < len(balls):
        raise BadInput(f"--balls {','.join(balls)} names a ball twice; give each a different name")
    return in_a_row(balls, model.ball)


@dataclass(frozen=True)
class Sizes:
    """Options of sizes of table and ball, SI; None for those of snooker."""

    length: float | None = given("--length", "L", "Length, cushion to cushion [m].", float)
    width: float | None = given("--width", "W", "Width, cushion to cushion [m].", float)
    diameter: float | None = given("--diameter", "D", "Diameter of the balls [m].", float)
    mass: float | None = given("--mass", "M", "Mass of a ball [kg].", float)
    no_pockets: bool = given("--no-pockets", "", "The table has no pockets.", bool, False)

    def model(self) -> Model:
        """A bare model with these sizes."""
        for name in ("length", "width", "diameter", "mass"):
            value = getattr(self, name)
            if value is not None and not 0 < value < np.inf:
                raise BadInput(f"--{name} is {value}; give a positive number")
        table, ball = SNOOKER_TABLE, SNOOKER_BALL
        return Model(
            Table(self.length or table.length, self.width or table.width, not self.no_pockets),
            Ball(self.diameter or ball.diameter, self.mass or ball.mass),
        )


@lone_command("models.mjcf.export")
@click.argument("out", metavar="OUT.xml", type=FILE_PATH)
@gathered("sizes", Sizes)
@click.option("--balls", metavar="A,B,...", help="Names, which set the colours; by default all 22 on their spots.")
@click.option("--launcher", is_flag=True, help="Add the cue launcher behind the first ball.")
@click.option("--bare", is_flag=True, help="Leave out purely visual parts.")
def main(out: Path, sizes: Sizes, balls: str | None, launcher: bool, bare: bool) -> int:
    """Write a table of these sizes, with its balls, as plain MJCF; for a fitted table see sysid export."""
    model = sizes.model()
    export(model, places_of(model, balls.split(",") if balls is not None else None), out, launcher=launcher, bare=bare)
    return Status.DONE


if __name__ == "__main__":
    sys.exit(run(main))
