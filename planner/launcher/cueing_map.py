"""The cueing map of a launcher: from commanded strokes to ball speed, squirt and spin, and back.

In: constants of the balance of impulses (models/analytic/cue_impulse.py) with their covariance, fitted by
robot/cueing/map_fit.py, or a map file (billiard-cueing-map/1, TOML). Out: `forward`, the ball's motion for a command;
`inverse`, the command for a motion; `predict`, with uncertainty.

The inverse is a fixed-point iteration: cue speed and stage are corrected by the error of ball speed and spin, which are
nearly linear in them; the cue is turned against squirt and the zero of the aim. The file's [execution] is the
launcher's repeatability. Left out: the spin about the direction of the aim, which follows from the other parts, and
drift of the constants with wear and chalk, which requires a new measurement.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tomli_w
from numpy.typing import ArrayLike, NDArray

from models.analytic.cue_impulse import CONSTANT_NAMES, Constants, Geometry, ball_speed_and_squirt, launch
from models.errors import BadInput
from models.files import read_toml, write_whole
from models.files.decode import Allowed
from models.files.faults import shown
from models.shot import Ball
from planner.launcher.execution import Execution

Array = NDArray[np.float64]
MAP_FORMAT = "billiard-cueing-map/1"
INVERSE_ITERATIONS = 12  # each reduces the error to a tenth
USUAL_GAIN = 1.3  # ball speed over cue speed of a central stroke, the start of the inverse


@dataclass(frozen=True)
class Prediction:
    """Predicted speed and squirt, with the uncertainty of the constants; the launcher's scatter is not included."""

    ball_speed: Array  # horizontal (n,) [m/s]
    squirt: Array  # against the aim, > 0 to the left (n,) [rad]
    ball_speed_sd: Array  # (n,) [m/s]
    squirt_sd: Array  # (n,) [rad]


@dataclass(frozen=True)
class CueingMap:
    """A launcher's map and the quality of its fit."""

    constants: Constants
    geometry: Geometry
    covariance: Array  # of the constants, in the order of NAMES (8, 8); nan if it was not computed
    execution: Execution
    shots: int = 0  # number of shots fitted
    left_out: int = 0  # shots left out as outliers
    chi2_reduced: float = math.nan

    def predict(self, cue_speed: ArrayLike, x0_mm: ArrayLike, y0_mm: ArrayLike) -> Prediction:
        """Ball speed and squirt for commanded cue speed [m/s] and stage [mm], all (n,); errors propagate linearly."""
        given = [np.atleast_1d(np.asarray(v, float)) for v in (cue_speed, x0_mm, y0_mm)]
        v, x, y = np.broadcast_arrays(given[0], 1e-3 * given[1], 1e-3 * given[2])
        speed, squirt = ball_speed_and_squirt(self.constants, self.geometry, v, x, y)
        jacobian = np.empty((len(CONSTANT_NAMES), 2, len(v)))
        for k, name in enumerate(CONSTANT_NAMES):
            step = 1e-4 * max(abs(getattr(self.constants, name)), 1e-3)
            moved = dataclasses.replace(self.constants, **{name: getattr(self.constants, name) + step})
            other = ball_speed_and_squirt(moved, self.geometry, v, x, y)
            jacobian[k] = (other[0] - speed) / step, (other[1] - squirt) / step
        variance = np.einsum("kin,kl,lin->in", jacobian, self.covariance, jacobian)
        return Prediction(speed, squirt, *np.sqrt(np.maximum(variance, 0.0)))

    def forward(self, cue_speed: Array, x0: Array, y0: Array) -> tuple[Array, Array, Array, Array]:
        """The ball's motion for commanded cue speeds [m/s] and stage positions [m], all (n,).

        Returns:
            Horizontal ball speed [m/s], squirt [rad], and side and height of the spin [m]: the contact offset that
            gives this spin at this speed (planner/launcher/stroke.py).
        """
        velocity, spin = launch(self.constants, self.geometry, cue_speed, x0, y0)
        speed, squirt = np.hypot(velocity[:, 0], velocity[:, 1]), np.arctan2(velocity[:, 1], velocity[:, 0])
        scale = 0.4 * self.geometry.ball.radius**2 / speed
        return speed, squirt, scale * spin[:, 2], scale * (np.cos(squirt) * spin[:, 1] - np.sin(squirt) * spin[:, 0])

    def swerve(self, cue_speed: Array, x0: Array, y0: Array) -> Array:
        """Offset that stands for the ball's spin about its direction, as side and height in `forward`: (n,) [m]."""
        velocity, spin = launch(self.constants, self.geometry, cue_speed, x0, y0)
        along = np.sum(velocity[:, :2] * spin[:, :2], axis=1)
        return np.asarray(0.4 * self.geometry.ball.radius**2 * along / np.sum(velocity[:, :2] ** 2, axis=1))

    def inverse(self, speed: Array, side: Array, height: Array) -> tuple[Array, Array, Array, Array]:
        """The command for ball speeds [m/s] and side and height of their spin [m], all (n,).

        Returns:
            Cue speed [m/s], position of the stage to the right and up [m], and the resulting squirt [rad]. Does not
            converge beyond natural roll, where the slate limits the spin.
        """
        lever, c = self.geometry.lever, self.constants
        x, y, cue_speed = side / lever - c.side_zero, height / lever - c.height_zero, speed / USUAL_GAIN
        squirt = np.zeros_like(speed)
        for _ in range(INVERSE_ITERATIONS):
            got, squirt, right, up = self.forward(cue_speed, x, y)
            cue_speed, x, y = cue_speed * speed / got, x + (side - right) / lever, y + (height - up) / lever
        return cue_speed, x, y, squirt


def write_map(path: Path | str, cueing_map: CueingMap) -> None:
    """Write the map's TOML file, completely or not at all."""
    m, g = cueing_map, cueing_map.geometry
    data = {
        "format": MAP_FORMAT,
        "ball": {"diameter": g.ball.diameter, "mass": g.ball.mass},
        "cue": {"tip_radius": g.tip_radius, "elevation": g.elevation},
        "constants": dataclasses.asdict(m.constants),
        "uncertainty": {"names": list(CONSTANT_NAMES), "covariance": [[float(v) for v in row] for row in m.covariance]},
        "execution": dataclasses.asdict(m.execution),
        "fit": {"shots": m.shots, "left_out": m.left_out, "chi2_reduced": m.chi2_reduced},
    }
    write_whole(path, tomli_w.dumps(data).encode())


@dataclass(frozen=True)
class CueShape:
    """The keys of a map file's [cue]."""

    tip_radius: Annotated[float, Allowed(0.002, 0.03, "m")]
    elevation: Annotated[float, Allowed(0.0, 1.5, "rad")]


@dataclass(frozen=True)
class Uncertainty:
    """The keys of a map file's [uncertainty]."""

    names: tuple[str, ...]
    covariance: Annotated[Array, Allowed(shape=(len(CONSTANT_NAMES), len(CONSTANT_NAMES)), nan=True)]

    def __post_init__(self) -> None:
        """Raise BadInput for other constants or an invalid covariance; nan means that it was not computed."""
        found = self.covariance
        if self.names != CONSTANT_NAMES:
            raise BadInput(f"names = {shown(list(self.names))}: give names = {list(CONSTANT_NAMES)}")
        if not np.isnan(found).all() and not (np.allclose(found, found.T) and (np.diag(found) >= 0).all()):
            raise BadInput("covariance is not symmetric with a diagonal of 0 or more: correct it")


@dataclass(frozen=True)
class FitQuality:
    """The keys of a map file's [fit], as in `CueingMap`."""

    shots: Annotated[int, Allowed(0, 1e9)] = 0
    left_out: Annotated[int, Allowed(0, 1e9)] = 0
    chi2_reduced: Annotated[float, Allowed(nan=True)] = math.nan


@dataclass(frozen=True)
class CueingMapFile:
    """The keys of a map file."""

    ball: Ball
    cue: CueShape
    constants: Annotated[Constants, Allowed(needs=CONSTANT_NAMES)]
    execution: Annotated[Execution, Allowed(form="[execution] with speed_sd, azimuth_sd, side_sd, height_sd")]
    uncertainty: Uncertainty | None = None
    fit: FitQuality = FitQuality()


def read_map(path: Path | str) -> CueingMap:
    """Read a map file; BadInput names its faults."""
    file = read_toml(path, CueingMapFile, MAP_FORMAT, "name a cueing map")
    unknown = np.full((len(CONSTANT_NAMES), len(CONSTANT_NAMES)), math.nan)
    return CueingMap(
        file.constants, Geometry(file.ball, **vars(file.cue)),
        file.uncertainty.covariance if file.uncertainty else unknown, file.execution, **vars(file.fit),
    )  # fmt: skip
