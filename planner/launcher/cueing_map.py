"""The cueing map: what a told stroke gives the ball, and what to tell for a stroke that is wanted.

The physics is in models/analytic/cue_impulse.py, the fit of its constants to a campaign in robot/cueing/map_fit.py;
here are the values, both directions, and the file (billiard-cueing-map/1, TOML). Backwards: cue speed and stage are
moved by what ball speed and spin lack, nearly linear in them, and the cue is turned against squirt and the zero of the
aim. No contact beyond half the radius is told (Robotic Billiards 2015). The file's [execution] is the launcher's
repeatability. Leaves out the spin about the direction of the aim, which follows from the rest, and drift of the
constants with wear and chalk: strike a new campaign.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import ArrayLike, NDArray

from models.analytic import cueing
from models.analytic.cue_impulse import CONSTANT_NAMES, Constants, Geometry, ball_speed_and_squirt, launch
from models.errors import BadInput
from models.files import read_toml, write_whole
from models.shot import Ball
from planner.launcher.execution import Execution, execution_from
from planner.launcher.stroke import Launcher

Array = NDArray[np.float64]
FORMAT = "billiard-cueing-map/1"
SECTIONS = ("format", "ball", "cue", "constants", "uncertainty", "execution", "fit")
OFFSET = cueing.SEED_LIMIT  # contact over radius beyond which nothing is told
ROUNDS = 12  # of going back


@dataclass(frozen=True)
class Prediction:
    """What strokes give, with the uncertainty that the constants leave; the launcher's scatter comes on top."""

    ball_speed: Array  # horizontal (n,) [m/s]
    squirt: Array  # against the aim, > 0 to the left (n,) [rad]
    ball_speed_sd: Array  # (n,) [m/s]
    squirt_sd: Array  # (n,) [rad]


@dataclass(frozen=True)
class Setting:
    """What to tell the launcher."""

    string: int  # the nearest
    cue_speed: float  # that is wanted [m/s]; the string's own is up to half a step off
    x0_mm: float  # of the stage, to the right
    y0_mm: float  # of the stage, up, across the cue
    theta: float  # of the cue [rad], table frame
    ball_speed: float  # that the nearest string gives [m/s]
    squirt: float  # that theta is turned against, with the zero of the aim [rad]


@dataclass(frozen=True)
class CueingMap:
    """A launcher's map, with where it came from."""

    constants: Constants
    geometry: Geometry
    covariance: Array  # of the constants, in the order of NAMES (8, 8); nan where none was computed
    execution: Execution
    shots: int = 0  # that it was fitted to
    left_out: int = 0  # that lay too far off
    chi2_reduced: float = math.nan

    def predict(self, cue_speed: ArrayLike, x0_mm: ArrayLike, y0_mm: ArrayLike) -> Prediction:
        """Ball speed and squirt of strokes as told: cue speed [m/s], stage [mm]; all (n,)."""
        given = [np.atleast_1d(np.asarray(v, float)) for v in (cue_speed, x0_mm, y0_mm)]
        v, x, y = np.broadcast_arrays(given[0], 1e-3 * given[1], 1e-3 * given[2])
        speed, squirt = ball_speed_and_squirt(self.constants, self.geometry, v, x, y)
        slopes = np.empty((len(CONSTANT_NAMES), 2, len(v)))
        for k, name in enumerate(CONSTANT_NAMES):
            step = 1e-4 * max(abs(getattr(self.constants, name)), 1e-3)
            moved = dataclasses.replace(self.constants, **{name: getattr(self.constants, name) + step})
            other = ball_speed_and_squirt(moved, self.geometry, v, x, y)
            slopes[k] = (other[0] - speed) / step, (other[1] - squirt) / step
        variance = np.einsum("kin,kl,lin->in", slopes, self.covariance, slopes)
        return Prediction(speed, squirt, *np.sqrt(np.maximum(variance, 0.0)))

    def give(self, cue_speed: Array, x0: Array, y0: Array) -> tuple[Array, Array, Array, Array]:
        """What told strokes give: horizontal ball speed [m/s], squirt [rad], and its spin's side and height [m].

        Side and height are those of planner/launcher/stroke.py: a contact there would give this spin at this speed.
        """
        velocity, spin = launch(self.constants, self.geometry, cue_speed, x0, y0)
        speed, turn = np.hypot(velocity[:, 0], velocity[:, 1]), np.arctan2(velocity[:, 1], velocity[:, 0])
        scale = 0.4 * self.geometry.ball.radius**2 / speed
        return speed, turn, scale * spin[:, 2], scale * (np.cos(turn) * spin[:, 1] - np.sin(turn) * spin[:, 0])

    def told(self, speed: Array, side: Array, height: Array) -> tuple[Array, Array, Array, Array]:
        """What to tell for ball speeds [m/s] and the side and height of their spin [m], all (n,); `give` backwards.

        Returns:
            Cue speed [m/s], place of the stage to the right and up [m], and the squirt that comes of it [rad].
        """
        lever, c = self.geometry.lever, self.constants
        x, y, cue = side / lever - c.side_zero, height / lever - c.height_zero, speed / 1.3
        turn = np.zeros_like(speed)
        for _ in range(ROUNDS):  # each leaves a tenth of the error, but beyond rolling, where the slate holds spin back
            got, turn, right, up = self.give(cue, x, y)
            cue, x, y = cue * speed / got, x + (side - right) / lever, y + (height - up) / lever
        return cue, x, y, turn

    def stroke_for(
        self, ball_speed: float, azimuth: float, side: float, height: float, launcher: Launcher | None = None
    ) -> Setting:
        """What to tell for a stroke.

        Args:
            ball_speed: horizontal, as the ball leaves the tip [m/s].
            azimuth: in which the ball is to leave [rad], table frame.
            side: of its spin, as a contact so far to the right would give it [m].
            height: the same, up [m].
            launcher: whose strings and bounds hold; the planner's without.

        Raises:
            BadInput: the contact is beyond the miscue limit, or no cue speed within bounds gives that ball speed.
        """
        launcher = launcher or Launcher()
        radius, lever, c = self.geometry.ball.radius, self.geometry.lever, self.constants
        for name, value in (("ball_speed", ball_speed), ("azimuth", azimuth), ("side", side), ("height", height)):
            if not math.isfinite(value):
                raise BadInput(f"{name} is {value}; give a finite number")
        if ball_speed <= 0:
            raise BadInput(f"ball_speed is {ball_speed:g} m/s; give one above 0")
        most = min(OFFSET, launcher.offset)
        one = np.array([ball_speed]), np.array([side]), np.array([height])
        off = math.hypot(side, height) / radius
        if off <= most + 1e-9:
            cue, x, y, turn = (float(v[0]) for v in self.told(*one))
            off = lever * math.hypot(x + c.side_zero, y + c.height_zero) / radius
        if off > most + 1e-9:
            raise BadInput(
                f"spin of side {1e3 * side:.2f} mm, height {1e3 * height:.2f} mm takes a contact {off:.3f} R from the "
                f"centre; the tip slips beyond {most:g} R ({1e3 * most * radius:.2f} mm), ask for less"
            )
        if not launcher.slowest * (1 - 1e-9) <= cue <= launcher.fastest * (1 + 1e-9):
            least, fastest = (ball_speed / cue * v for v in (launcher.slowest, launcher.fastest))
            raise BadInput(
                f"ball_speed is {ball_speed:g} m/s; with this spin the cue's {launcher.slowest:g} to "
                f"{launcher.fastest:g} m/s give about {least:.3f} to {fastest:.3f} m/s"
            )
        string = launcher.string(cue)
        given = self.give(np.array([launcher.cue_speed(string)]), np.array([x]), np.array([y]))
        return Setting(
            string=string, cue_speed=cue, x0_mm=1e3 * x, y0_mm=1e3 * y,
            theta=math.remainder(azimuth - turn, 2 * math.pi), ball_speed=float(given[0][0]), squirt=turn,
        )  # fmt: skip


def write_map(path: Path | str, cueing_map: CueingMap) -> None:
    """Write the map's TOML file, whole or not at all."""
    m, g = cueing_map, cueing_map.geometry
    data = {
        "format": FORMAT,
        "ball": {"diameter": g.ball.diameter, "mass": g.ball.mass},
        "cue": {"tip_radius": g.tip_radius, "elevation": g.elevation},
        "constants": dataclasses.asdict(m.constants),
        "uncertainty": {"names": list(CONSTANT_NAMES), "covariance": [[float(v) for v in row] for row in m.covariance]},
        "execution": dataclasses.asdict(m.execution),
        "fit": {"shots": m.shots, "left_out": m.left_out, "chi2_reduced": m.chi2_reduced},
    }
    write_whole(path, tomli_w.dumps(data).encode())


def read_map(path: Path | str) -> CueingMap:
    """A map from its file; BadInput names what is wrong in it."""
    data = read_toml(path, "name a cueing map", "correct that line")
    if data.get("format") != FORMAT:
        raise BadInput(f"{path}: format is {data.get('format')!r}; a cueing map says {FORMAT!r}")
    _known(path, "", data, SECTIONS)
    bounds = {f.name: f.metadata["bounds"] for f in dataclasses.fields(Constants)}
    ball = _numbers(path, data, "ball", {"diameter": (0.02, 0.1), "mass": (0.02, 1.0)})
    cue = _numbers(path, data, "cue", {"tip_radius": (0.002, 0.03), "elevation": (0.0, 1.5)})
    constants = _numbers(path, data, "constants", bounds)
    rest = data.get("uncertainty", {})
    covariance = np.full((len(CONSTANT_NAMES), len(CONSTANT_NAMES)), math.nan)
    if rest:
        covariance = _covariance(path, rest)
    fit = data.get("fit", {})
    shots, left_out, chi2 = (
        fit.get(k, default) for k, default in (("shots", 0), ("left_out", 0), ("chi2_reduced", math.nan))
    )
    if not isinstance(shots, int) or not isinstance(left_out, int) or not isinstance(chi2, int | float):
        raise BadInput(f"{path} [fit]: is {fit!r}; give whole numbers shots, left_out and a number chi2_reduced")
    if "execution" not in data:
        raise BadInput(f"{path}: has no [execution]; write speed_sd, azimuth_sd, side_sd, height_sd below it")
    return CueingMap(
        Constants(**constants), Geometry(Ball(**ball), **cue), covariance,
        execution_from(data["execution"], str(path)), shots, left_out, float(chi2),
    )  # fmt: skip


def _known(path: Path | str, where: str, data: Mapping[str, Any], names: Any) -> None:
    for key in data:
        if key not in names:
            near = get_close_matches(key, list(names), 1)
            hint = f"did you mean {near[0]}?" if near else f"choose from {', '.join(names)}"
            raise BadInput(f"{path}{where}: unknown key {key!r}; {hint}")


def _numbers(
    path: Path | str, data: Mapping[str, Any], section: str, bounds: Mapping[str, tuple[float, float]]
) -> dict[str, float]:
    """All numbers of a section, each within its bounds."""
    table = data.get(section)
    if not isinstance(table, Mapping):
        raise BadInput(f"{path}: [{section}] is {table!r}; give {', '.join(bounds)} below it")
    _known(path, f" [{section}]", table, bounds)
    for name, (low, high) in bounds.items():
        value = table.get(name)
        if not isinstance(value, int | float) or isinstance(value, bool) or not low <= value <= high:
            raise BadInput(f"{path} [{section}]: {name} is {value!r}; give a number from {low:g} to {high:g}")
    return {name: float(table[name]) for name in bounds}


def _covariance(path: Path | str, table: Any) -> Array:
    """The covariance of the constants; nan stands for one that was not computed."""
    names, rows = (table.get("names"), table.get("covariance")) if isinstance(table, Mapping) else (None, None)
    try:
        found = np.array(rows, float)
    except (TypeError, ValueError):
        found = np.zeros(0)
    if names != list(CONSTANT_NAMES) or found.shape != (len(CONSTANT_NAMES), len(CONSTANT_NAMES)):
        raise BadInput(
            f"{path} [uncertainty]: give names = {list(CONSTANT_NAMES)} and their covariance, "
            f"{len(CONSTANT_NAMES)} rows"
        )
    fault = not np.all(np.isnan(found)) and (
        not np.all(np.isfinite(found)) or not np.allclose(found, found.T) or np.any(np.diag(found) < 0)
    )
    if fault:
        raise BadInput(f"{path} [uncertainty]: covariance is not symmetric with a diagonal of 0 or more; write it anew")
    return found
