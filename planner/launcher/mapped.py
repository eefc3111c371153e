"""The launcher model with a cueing map.

In: a launcher model and a cueing map. Out: a launcher model with gain, commands and bounds from the map, the resulting
motion of the tip, and execution errors that include the map's uncertainty. A launcher that was not measured has a map
with constants from the literature.

Speed and spin of a stroke are the ball's as it leaves the tip (planner/launcher/stroke.py); the map's balance of
impulses, with slate, end mass and the zeros of stage and aim, gives the cue speed, stage and yaw for them. The slate
takes part of the spin, so that contacts at the miscue limit give less spin than their offset would on a free ball, and
turns the axis of sidespin with draw and follow, by up to half a degree of the path once the ball rolls. A
squirt effect of the model was fitted to clips of mapped strokes: it is a residual and adds to the map's squirt.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from models.analytic.cue_impulse import CONSTANT_NAMES, Constants, Geometry
from models.errors import BadInput
from models.mjcf.launcher import CueProperties
from models.model_file import Model
from models.shot import Ball
from planner.launcher.cueing_map import USUAL_GAIN, CueingMap
from planner.launcher.execution import Execution
from planner.launcher.stroke import AZIMUTH, HEIGHT, SIDE, SPEED, LauncherModel

Array = NDArray[np.float64]
REFERENCE_SPEED_M_S = 2.0  # ball speed for gain, swerve and spin limit; the gain changes by less than 1 % with speed
GRID_POINTS = 25  # of the tables of gain and swerve, along side and along height
LIMIT_DIRECTIONS = 72  # directions in which the spin at the miscue limit is computed


@dataclass(frozen=True)
class MappedLauncher(LauncherModel):
    """A launcher model with a measured cueing map."""

    cueing_map: CueingMap = field(kw_only=True)
    squirt_in_model: bool = field(default=False, kw_only=True)  # whether an effect of the model causes all squirt

    @cached_property
    def _offsets(self) -> Array:
        """Sides, and heights, of the tables below (n,) [m]."""
        return np.linspace(-1.0, 1.0, GRID_POINTS) * self.offset * self.cueing_map.geometry.ball.radius

    @cached_property
    def _commands(self) -> Array:
        """Cue speed and stage for strokes of the tables at the reference speed, (3, n n), at most at the spin's limit.

        Rows of the tables are sides, columns heights.
        """
        side, height = (v.ravel() for v in np.meshgrid(self._offsets, self._offsets, indexing="ij"))
        inside = np.minimum(1.0, self._offsets[-1] / np.maximum(np.hypot(side, height), 1e-12))
        speed = np.full(side.size, REFERENCE_SPEED_M_S)
        return np.stack(self.cueing_map.inverse(speed, side * inside, height * inside)[:3])

    def _table(self, values: Array, method: str) -> RegularGridInterpolator:
        shape = (GRID_POINTS, GRID_POINTS)
        return RegularGridInterpolator(
            (self._offsets, self._offsets), values.reshape(shape), method=method, bounds_error=False, fill_value=None
        )

    @cached_property
    def _gains(self) -> RegularGridInterpolator:
        """Gain over side and height, constant beyond the limit of the spin."""
        return self._table(REFERENCE_SPEED_M_S / self._commands[0], "cubic")

    @cached_property
    def _swerves(self) -> RegularGridInterpolator:
        """Swerve over side and height; linear between, since it bends where the slate's friction begins to hold."""
        return self._table(self.cueing_map.swerve(*self._commands), "linear")

    def gain(self, q: Array, ball: Ball) -> Array:
        """Ball speed, horizontal, over cue speed: (n,)."""
        return np.asarray(self._gains(q[:, [SIDE, HEIGHT]]))

    def swerve(self, q: Array) -> Array:
        """Offset that stands for the spin about the aim, (n,) [m]: the slate changes it with the height."""
        return np.asarray(self._swerves(q[:, [SIDE, HEIGHT]]))

    def playable(self, q: Array, ball: Ball) -> Array:
        """The nearest strokes that speed strings and stage steps can play: (n, 4)."""
        cue_speed, x, y, _ = self.cueing_map.inverse(q[:, SPEED], q[:, SIDE], q[:, HEIGHT])
        x, y = (np.round(v / self.step) * self.step for v in (x, y))
        strings = np.array([self.cue_speed(self.string(float(v))) for v in cue_speed])
        out = np.array(q, float)
        out[:, SPEED], _, out[:, SIDE], out[:, HEIGHT] = self.cueing_map.forward(strings, x, y)
        offset = np.hypot(out[:, SIDE], out[:, HEIGHT])
        beyond = offset > self.offset * ball.radius
        if beyond.any():  # rounded outwards: repeat from two steps further inside
            inward = q[beyond].copy()
            inward[:, [SIDE, HEIGHT]] *= (1.0 - 2.0 * self.step / offset[beyond])[:, None]
            out[beyond] = self.playable(inward, ball)
        return out

    def command(self, model: Model, q: Array) -> dict[str, Any]:
        """The launcher's command for one stroke (4,), as entries of a plan file."""
        rows = self.cueing_map.inverse(*(np.array([q[k]]) for k in (SPEED, SIDE, HEIGHT)))
        cue_speed, x, y, squirt = (float(v[0]) for v in rows)
        squirt *= not self.squirt_in_model
        return self.plan_entries(q, cue_speed, x, y, squirt)

    @property
    def device(self) -> CueProperties:
        """The properties of cue and tip."""
        known = self.cueing_map.constants
        return CueProperties(known.cue_mass, known.end_mass, known.tip_restitution)

    def tip_strokes(self, q: Array) -> Array:
        """Cue motion for strokes (n, 4): cue speed [m/s], azimuth [rad], side and height of its axis [m]."""
        known = self.cueing_map.constants
        cue_speed, x, y, squirt = self.cueing_map.inverse(q[:, SPEED], q[:, SIDE], q[:, HEIGHT])
        turn = q[:, AZIMUTH] - squirt * (not self.squirt_in_model) + known.aim_zero
        return np.stack([cue_speed, turn, x + known.side_zero, y + known.height_zero], axis=-1)


def usual_map(ball: Ball) -> CueingMap:
    """The map with constants from the literature, none of them measured."""
    unknown = np.full((len(CONSTANT_NAMES),) * 2, math.nan)
    return CueingMap(Constants(), Geometry(ball), unknown, Execution())


def usual_launcher(model: Model, launcher: LauncherModel | None = None) -> MappedLauncher:
    """A launcher with constants from the literature; the squirt is that of the model if it has one."""
    own = any("squirt" in (e.name(), e.slot) for e in model.effects)
    return dataclasses.replace(
        with_map(launcher or LauncherModel(), usual_map(model.ball), model.ball), squirt_in_model=own
    )


def with_map(launcher: LauncherModel, cueing_map: CueingMap, ball: Ball) -> MappedLauncher:
    """The launcher model with its map; BadInput if the map is for another ball."""
    geometry = cueing_map.geometry
    if abs(geometry.ball.radius - ball.radius) > 1e-4 or abs(geometry.ball.mass - ball.mass) > 1e-3:
        raise BadInput(
            f"the cueing map is for balls of {1e3 * geometry.ball.diameter:g} mm, {1e3 * geometry.ball.mass:g} g, the "
            f"scene's have {1e3 * ball.diameter:g} mm, {1e3 * ball.mass:g} g; fit a map to strokes of these balls"
        )
    cue = dataclasses.replace(launcher.cue, tip_radius=geometry.tip_radius, elevation=geometry.elevation)
    fields = {f.name: getattr(launcher, f.name) for f in dataclasses.fields(LauncherModel)}
    fields |= {"cue": cue, "offset": _spin_limit(launcher.offset, cueing_map)}
    return MappedLauncher(**fields, cueing_map=cueing_map)


def execution_of(cueing_map: CueingMap) -> Execution:
    """The launcher's repeatability and the uncertainty of its map, added in quadrature.

    The map's part is the root mean square over the centre and four edges of the stage at a usual speed; it is the same
    in every stroke, but is treated as independent. A map without a covariance adds none.
    """
    g, known = cueing_map.geometry, cueing_map.execution
    if not np.isfinite(cueing_map.covariance).all():
        return known
    stage_mm = 1e3 * 0.4 * g.ball.radius / g.lever * np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)])
    p = cueing_map.predict(REFERENCE_SPEED_M_S / USUAL_GAIN, stage_mm[:, 0], stage_mm[:, 1])
    speed, squirt = (float(np.sqrt(np.mean(v**2))) for v in (p.ball_speed_sd / p.ball_speed, p.squirt_sd))
    return dataclasses.replace(
        known, speed_sd=float(np.hypot(known.speed_sd, speed)), azimuth_sd=float(np.hypot(known.azimuth_sd, squirt))
    )


def _spin_limit(offset: float, cueing_map: CueingMap) -> float:
    """The least spin, as an offset over radius, of contacts at the miscue limit in any direction."""
    angle = np.linspace(0.0, 2 * np.pi, LIMIT_DIRECTIONS, endpoint=False)
    g, c = cueing_map.geometry, cueing_map.constants
    limit = offset * g.ball.radius / g.lever
    x, y = limit * np.cos(angle) - c.side_zero, limit * np.sin(angle) - c.height_zero
    cue_speed = np.full(LIMIT_DIRECTIONS, REFERENCE_SPEED_M_S / USUAL_GAIN)
    _, _, side, height = cueing_map.forward(cue_speed, x, y)
    return min(offset, float(np.hypot(side, height).min()) / g.ball.radius)
