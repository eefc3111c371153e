"""How well a launcher repeats its strokes, and common random numbers to play them with.

A stroke's ball speed, azimuth, side and height are what was asked for plus independent normal errors: speed by a
fraction, the others by an amount. Robotic Billiards (2015) tells +-50 mm of repeatability for strokes of up to 2.8 m/s:
a run goes with the square of the speed, so that 50 mm of 2.2 m are 1.2 % of the speed. Its yaw is set by hand against
the camera's picture; 1 mrad and 0.5 mm of the tip are estimates. Draws are Owen-scrambled Sobol points, which tell a
probability with fewer shots than independent ones. Leaves out errors that hang together from shot to shot.
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
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import qmc

from models.errors import BadInput
from models.files import read_toml

Array = NDArray[np.float64]
MOST = {"speed_sd": 0.3, "azimuth_sd": 0.2, "side_sd": 0.01, "height_sd": 0.01}  # beyond which it is no launcher's


@dataclass(frozen=True)
class Execution:
    """One standard deviation of each part of a stroke."""

    speed_sd: float = 0.012  # fraction of the ball's speed [1]
    azimuth_sd: float = 0.001  # [rad]
    side_sd: float = 0.0005  # of the contact point [m]
    height_sd: float = 0.0005  # [m]

    def spread(self, q: Array, normal: Array) -> Array:
        """Strokes as played: asked for (n, 4), standard normal numbers (m, 4) -> (n, m, 4)."""
        size = np.empty((len(q), 1, 4))
        size[:, 0, 0] = self.speed_sd * q[:, 0]
        size[:, 0, 1:] = self.azimuth_sd, self.side_sd, self.height_sd
        return np.asarray(q[:, None, :] + size * normal[None])


def execution_from(data: Any, where: str) -> Execution:
    """Execution noise from a table of a TOML file; BadInput names what is wrong in it."""
    if not isinstance(data, Mapping):
        raise BadInput(f"{where} [execution] is {data!r}; give speed_sd, azimuth_sd, side_sd, height_sd")
    names = [f.name for f in dataclasses.fields(Execution)]
    for key, value in data.items():
        if key not in names:
            near = get_close_matches(key, names, 1)
            raise BadInput(f"{where} [execution]: unknown key {key!r}; did you mean {near[0] if near else names}?")
        if not isinstance(value, int | float) or isinstance(value, bool) or not 0 <= value <= MOST[key]:
            raise BadInput(f"{where} [execution]: {key} is {value!r}; give a number from 0 to {MOST[key]}")
    return Execution(**{key: float(value) for key, value in data.items()})


def read_execution(path: Path | str) -> Execution:
    """Execution noise from a TOML file with a table [execution], such as a model file."""
    data = read_toml(path, "name a TOML file with [execution]", "correct that line")
    if "execution" not in data:
        raise BadInput(f"{path}: has no [execution]; write speed_sd, azimuth_sd, side_sd, height_sd below it")
    return execution_from(data["execution"], str(path))


def draws(count: int, columns: int, seed: int) -> Array:
    """Standard normal numbers that fill their space evenly: (count, columns)."""
    powers = max(0, math.ceil(math.log2(max(count, 1))))
    points = qmc.Sobol(columns, scramble=True, rng=np.random.default_rng(seed)).random_base2(powers)[:count]
    return np.asarray(ndtri(np.clip(points, 1e-9, 1 - 1e-9)))
