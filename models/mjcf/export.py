"""A table, its balls and, where wanted, the launcher as one plain MJCF file for any MuJoCo viewer.

Its contacts are MuJoCo's own, with the native terms of a model file or the shipped ones (models/mjcf/native.py);
models/README.md says what they cannot do. The shipped file, short enough to be read, is from
`python -m models.mjcf.export models/mjcf/table.xml --bare --balls white,red,black`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from models.errors import BadInput
from models.files import write_whole
from models.mjcf.launcher import build_scene
from models.mjcf.snooker import SNOOKER_BALL, SNOOKER_TABLE, racked
from models.mjcf.world import build_spec
from models.model_file import Model, read_model
from models.shot import Array, Ball, Table

SIZE_OPTIONS = ("length", "width", "diameter", "mass")


def export(
    model: Model, places: Mapping[str, Array], path: Path | str, *, launcher: bool = False, bare: bool = False
) -> None:
    """Write a model's native world, whole or not at all; `places` says where each ball waits, (2,) [m].

    A launcher is aimed at the first ball, along +x. A bare world has nothing that is only seen; its noses are shown.
    """
    names = tuple(places)
    xy = np.array([places[name] for name in names], float).reshape(-1, 2)
    _check(model, names, xy)
    if launcher:
        spec = build_scene(
            model.table, model.ball, names, xy[0], 0.0, others=xy[1:], native=model.native, furnished=not bare
        ).spec
    else:
        spec = build_spec(model.table, model.ball, names, (model.native,), furnished=not bare)
        for name, at in zip(names, xy, strict=True):
            spec.body(name).pos[:2] = at
    if bare:
        for geom in spec.geoms:
            geom.group = 0 if geom.name.startswith("cushion") else geom.group
    try:
        spec.compile()
    except ValueError as error:
        raise BadInput(f"MuJoCo takes no such world ({str(error).splitlines()[0]}); change names or sizes") from error
    write_whole(path, spec.to_xml().encode(), parents=True)


def _check(model: Model, names: Sequence[str], xy: Array) -> None:
    """Names and places that no world can be made of."""
    for name, at in zip(names, xy, strict=True):
        if not name or name == "world" or "/" in name:
            raise BadInput(f"{name!r} cannot name a ball; give names that are not empty, not world, without slashes")
        if not np.all(np.abs(at) <= model.table.centre_limits(model.ball)):
            raise BadInput(
                f"ball {name!r} at {at.round(3).tolist()} is not on the table; take fewer balls, or a larger one"
            )
    gaps = np.linalg.norm(xy[:, None] - xy, axis=-1) + np.eye(len(xy))
    if len(xy) > 1 and gaps.min() < model.ball.diameter:
        i, j = divmod(int(gaps.argmin()), len(names))
        raise BadInput(f"balls {names[i]!r} and {names[j]!r} overlap; place them apart, or take smaller ones")


def in_a_row(names: Sequence[str], ball: Ball) -> dict[str, Array]:
    """Balls side by side in the middle of the table."""
    gap = ball.diameter * 1.5
    return {name: np.array([(k - (len(names) - 1) / 2) * gap, 0.0]) for k, name in enumerate(names)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Write a table with its balls as plain MJCF."""
    parser = argparse.ArgumentParser(prog="python -m models.mjcf.export", description=main.__doc__)
    parser.add_argument("out", type=Path, metavar="OUT.xml")
    parser.add_argument("--model", metavar="M.toml", help="table, ball and native terms of a model file")
    parser.add_argument("--length", type=float, help="cushion to cushion [m]")
    parser.add_argument("--width", type=float, help="[m]")
    parser.add_argument("--diameter", type=float, help="of the balls [m]")
    parser.add_argument("--mass", type=float, help="of a ball [kg]")
    parser.add_argument("--no-pockets", action="store_true")
    parser.add_argument("--balls", help="names, which choose the colours (default: all 22 on their spots)")
    parser.add_argument("--launcher", action="store_true", help="with the cue launcher behind the first ball")
    parser.add_argument("--bare", action="store_true", help="without what is only seen")
    given = parser.parse_args(arguments)
    try:
        for name in SIZE_OPTIONS:
            value = getattr(given, name)
            if value is not None and not 0 < value < np.inf:
                raise BadInput(f"--{name} is {value}; give a positive number")
            if value is not None and given.model:
                raise BadInput(f"--{name} beside --model, which has its own; leave one of them out")
        table = Table(
            given.length or SNOOKER_TABLE.length, given.width or SNOOKER_TABLE.width, not given.no_pockets
        )  # fmt: skip
        ball = Ball(given.diameter or SNOOKER_BALL.diameter, given.mass or SNOOKER_BALL.mass)
        model = read_model(given.model) if given.model else Model(table, ball)
        if given.balls is not None:
            names = given.balls.split(",")
            if len(set(names)) < len(names):
                raise BadInput(f"--balls {given.balls} names a ball twice; give each a name of its own")
            places = in_a_row(names, model.ball)
        else:
            spots = racked(model.table, model.ball)
            places = {"white": spots.pop("white"), **spots}
        export(model, places, given.out, launcher=given.launcher, bare=given.bare)
    except BadInput as error:
        print(f"models.mjcf.export: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
