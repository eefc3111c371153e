"""A launcher with its cueing map: strokes are planned in what it really gives, and told in what it must be told.

A stroke's speed and spin are the ball's as it leaves the tip (planner/launcher/stroke.py); the map's balance of
impulses, with slate, end mass and the zeros of stage and aim, says what cue speed, stage and yaw give them. The slate
holds a part of the spin back, so that the miscue limit leaves less of it than its offset says. A squirt that the model
knows was fitted to clips of such strokes, so it is what the map leaves, and adds to it.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from models.errors import BadInput
from models.model_file import Model
from models.shot import Ball
from planner.launcher.cueing_map import CueingMap
from planner.launcher.execution import Execution
from planner.launcher.stroke import AZIMUTH, HEIGHT, SIDE, SPEED, Launcher

Array = NDArray[np.float64]
USUAL = 2.0  # ball speed at which gain and limit are taken; the gain changes by less than 1 % with speed [m/s]
GRID = 25  # of the table of gains, each way
AROUND = 72  # places on the miscue limit that are tried


@dataclass(frozen=True)
class MappedLauncher(Launcher):
    """What strokes a launcher can play that was mapped."""

    cueing_map: CueingMap = field(kw_only=True)

    @cached_property
    def _gains(self) -> RegularGridInterpolator:
        """Gain over side and height; within the limit of the spin."""
        axis = np.linspace(-1.0, 1.0, GRID) * self.offset * self.cueing_map.geometry.ball.radius
        side, height = (v.ravel() for v in np.meshgrid(axis, axis, indexing="ij"))
        off = np.hypot(side, height)
        inside = np.minimum(1.0, axis[-1] / np.maximum(off, 1e-12))
        cue_speed, *_ = self.cueing_map.told(np.full(off.size, USUAL), side * inside, height * inside)
        gains = (USUAL / cue_speed).reshape(GRID, GRID)
        return RegularGridInterpolator((axis, axis), gains, method="cubic", bounds_error=False, fill_value=None)

    def gain(self, q: Array, ball: Ball) -> Array:
        """Ball speed, horizontal, over cue speed: (n,)."""
        return np.asarray(self._gains(q[:, [SIDE, HEIGHT]]))

    def playable(self, q: Array, ball: Ball) -> Array:
        """The nearest strokes that strings and stage steps can ask for: (n, 4)."""
        cue_speed, x, y, _ = self.cueing_map.told(q[:, SPEED], q[:, SIDE], q[:, HEIGHT])
        x, y = (np.round(v / self.step) * self.step for v in (x, y))
        strings = np.array([self.cue_speed(self.string(float(v))) for v in cue_speed])
        out = np.array(q, float)
        out[:, SPEED], _, out[:, SIDE], out[:, HEIGHT] = self.cueing_map.give(strings, x, y)
        off = np.hypot(out[:, SIDE], out[:, HEIGHT])
        far = off > self.offset * ball.radius
        if far.any():  # rounded outwards: a step inwards
            near = q[far].copy()
            near[:, [SIDE, HEIGHT]] *= (1.0 - 2.0 * self.step / off[far])[:, None]
            out[far] = self.playable(near, ball)
        return out

    def terms(self, model: Model, q: Array) -> dict[str, Any]:
        """What to tell the launcher for one stroke (4,)."""
        rows = self.cueing_map.told(*(np.array([q[k]]) for k in (SPEED, SIDE, HEIGHT)))
        cue_speed, x, y, turn = (float(v[0]) for v in rows)
        return self.told(cue_speed, x, y, float(q[AZIMUTH]), turn)


def with_map(launcher: Launcher, cueing_map: CueingMap, ball: Ball) -> MappedLauncher:
    """A launcher with its map; BadInput where that is of another ball."""
    geometry = cueing_map.geometry
    if abs(geometry.ball.radius - ball.radius) > 1e-4 or abs(geometry.ball.mass - ball.mass) > 1e-3:
        raise BadInput(
            f"the cueing map is of balls of {1e3 * geometry.ball.diameter:g} mm, {1e3 * geometry.ball.mass:g} g, the "
            f"scene's have {1e3 * ball.diameter:g} mm, {1e3 * ball.mass:g} g; fit a map to strokes of these balls"
        )
    cue = dataclasses.replace(launcher.cue, tip_radius=geometry.tip_radius, elevation=geometry.elevation)
    rest = {f.name: getattr(launcher, f.name) for f in dataclasses.fields(Launcher)}
    rest |= {"cue": cue, "offset": _least_spin(launcher.offset, cueing_map)}
    return MappedLauncher(**rest, cueing_map=cueing_map)


def unsure(cueing_map: CueingMap) -> Execution:
    """The launcher's repeatability and what its map leaves open, as one: a map's error is in every stroke alike.

    Taken over the stage's reach at a usual speed; a map without uncertainty adds none.
    """
    g, known = cueing_map.geometry, cueing_map.execution
    if not np.isfinite(cueing_map.covariance).all():
        return known
    reach = 1e3 * 0.4 * g.ball.radius / g.lever * np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)])
    p = cueing_map.predict(USUAL / 1.3, reach[:, 0], reach[:, 1])
    speed, turn = (float(np.sqrt(np.mean(v**2))) for v in (p.ball_speed_sd / p.ball_speed, p.squirt_sd))
    return dataclasses.replace(
        known, speed_sd=float(np.hypot(known.speed_sd, speed)), azimuth_sd=float(np.hypot(known.azimuth_sd, turn))
    )


def _least_spin(offset: float, cueing_map: CueingMap) -> float:
    """The spin, as an offset over radius, that contacts at the miscue limit give to any side at least."""
    turn = np.linspace(0.0, 2 * np.pi, AROUND, endpoint=False)
    g, c = cueing_map.geometry, cueing_map.constants
    limit = offset * g.ball.radius / g.lever
    x, y = limit * np.cos(turn) - c.side_zero, limit * np.sin(turn) - c.height_zero
    _, _, side, height = cueing_map.give(np.full(AROUND, USUAL / 1.3), x, y)
    return min(offset, float(np.hypot(side, height).min()) / g.ball.radius)
