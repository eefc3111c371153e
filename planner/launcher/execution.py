"""Execution errors of a launcher, and the quasi-random normal numbers that they are sampled with.

In: the table [execution] of a TOML file, or a seed. Out: `Execution`, the standard deviations of a stroke, which
perturbs commanded strokes; normal samples (count, columns).

Ball speed, azimuth, side and height of a stroke are the commanded ones plus independent normal errors, relative for the
speed. Robotic Billiards (2015) reports a repeatability of +-50 mm for strokes of up to 2.8 m/s: path length goes with
the square of the speed, so that 50 mm of 2.2 m are 1.2 % of the speed. Its yaw is set by hand against the camera's
picture; 1 mrad and 0.5 mm of the tip are estimates. The samples are Owen-scrambled Sobol points, which estimate a
probability with fewer plays than independent ones. Left out: errors that are correlated from shot to shot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import qmc

from models.files import read_toml
from models.files.decode import Allowed, decode
from models.files.faults import Faults
from models.files.place import Place

Array = NDArray[np.float64]
MAX_SD = {"speed_sd": 0.3, "azimuth_sd": 0.2, "side_sd": 0.01, "height_sd": 0.01}  # larger values are in a wrong unit


@dataclass(frozen=True)
class Execution:
    """One standard deviation of each part of a stroke."""

    speed_sd: Annotated[float, Allowed(0, MAX_SD["speed_sd"])] = 0.012  # fraction of the ball's speed
    azimuth_sd: Annotated[float, Allowed(0, MAX_SD["azimuth_sd"], "rad")] = 0.001
    side_sd: Annotated[float, Allowed(0, MAX_SD["side_sd"], "m")] = 0.0005  # of the contact point
    height_sd: Annotated[float, Allowed(0, MAX_SD["height_sd"], "m")] = 0.0005

    def perturb(self, q: Array, normal: Array) -> Array:
        """Strokes as played (n, m, 4), from commanded ones (n, 4) and standard normal numbers (m, 4)."""
        size = np.empty((len(q), 1, 4))
        size[:, 0, 0] = self.speed_sd * q[:, 0]
        size[:, 0, 1:] = self.azimuth_sd, self.side_sd, self.height_sd
        return np.asarray(q[:, None, :] + size * normal[None])


@dataclass(frozen=True)
class ExecutionFile:
    """The keys of a file with execution errors."""

    execution: Annotated[Execution, Allowed(form="[execution] with speed_sd, azimuth_sd, side_sd, height_sd")]


def execution_from(data: Any, where: str) -> Execution:
    """Execution errors from the table [execution] of a file; BadInput names its faults."""
    faults = Faults()
    return faults.settle(decode(Execution, data, Place(where, faults, name="execution")))


def read_execution(path: Path | str) -> Execution:
    """Execution errors from a TOML file with a table [execution], such as a model file."""
    return read_toml(path, ExecutionFile, "", "name a TOML file with [execution]", more=True).execution


def normal_samples(count: int, columns: int, seed: int) -> Array:
    """Standard normal numbers (count, columns) that fill the space evenly."""
    powers = max(0, math.ceil(math.log2(max(count, 1))))
    points = qmc.Sobol(columns, scramble=True, rng=np.random.default_rng(seed)).random_base2(powers)[:count]
    return np.asarray(ndtri(np.clip(points, 1e-9, 1 - 1e-9)))
