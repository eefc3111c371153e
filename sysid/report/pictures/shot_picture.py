"""The shots to film next, from above: the balls' positions, and their paths in the model that was found.

In: `NextShot`s and the model. Out: `ShotPicture`s, shapes in pixels that templates/shot.svg.j2 draws.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.model_file import Model
from models.simulation.simulate import simulate
from sysid.selection.next_shot import NextShot

WIDTH_PX, RIM_PX = 400, 8  # of the picture, and of the rails in it
AIM_M = 0.25  # length of the arrow along which the cue ball is struck


@dataclass(frozen=True)
class ShotPicture:
    """One shot; pixels, y downwards."""

    title: str
    words: str  # what to do
    width: float
    height: float
    rim: float
    radius: float  # of a ball
    pockets: tuple[tuple[float, float], ...]
    paths: tuple[tuple[str, str], ...]  # of each ball: "cue" or "red", and its points
    balls: tuple[tuple[str, float, float], ...]  # where they lie
    aim: tuple[float, float, float, float]  # from the cue ball


def shot_pictures(shots: Sequence[NextShot], model: Model) -> list[ShotPicture]:
    """Pictures of the shots in the order in which to film; none where there is no shot."""
    if not shots:
        return []
    table, radius = model.table, model.ball.radius
    scale = (WIDTH_PX - 2 * RIM_PX) / table.length

    def at(x: float, y: float) -> tuple[float, float]:
        return RIM_PX + scale * (table.length / 2 + x), RIM_PX + scale * (table.width / 2 - y)

    found = []
    for number, (one, track) in enumerate(zip(shots, simulate(model, [s.shot(radius) for s in shots]), strict=True), 1):
        paths = []
        for ball, name in enumerate(track.names):
            place = track.position[:, ball]
            points = [at(x, y) for x, y in place[np.isfinite(place).all(axis=1)].tolist()]
            paths.append((name, " ".join(f"{x:.1f},{y:.1f}" for x, y in points)))
        balls = [("cue", *at(*one.place)), *([("red", *at(*one.other))] if one.other else [])]
        end = one.place[0] + AIM_M * math.cos(one.cue.azimuth), one.place[1] + AIM_M * math.sin(one.cue.azimuth)
        title = f"Shot {number} of {len(shots)}: {one.why}" if len(shots) > 1 else one.why
        found.append(ShotPicture(
            title[0].upper() + title[1:], f"{one.in_words()}.", WIDTH_PX, 2 * RIM_PX + scale * table.width, RIM_PX,
            max(2.5, scale * radius),
            tuple(at(sx * table.length / 2, sy * table.width / 2) for sx in (-1, 0, 1) for sy in (-1, 1))
            if table.pockets else (), tuple(paths), tuple(balls), (*at(*one.place), *at(*end)),
        ))  # fmt: skip
    return found
