"""The result of a fit: a model, the initial states of its shots, and the uncertainty of both.

In: what sysid/estimation/fitting.py has found. Out: `FittedModel`, and `as_model`: the model for a file.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from models.messages import counted
from models.model_file import Estimate, Model
from sysid.estimation.problem import Array
from sysid.estimation.shot_problem import ShotProblem

MISS_OVER_AXIS = math.sqrt(2.0)  # rms miss, a distance in the plane, over rms per axis
UNFOLLOWED_RATE = 2e-3  # discrepancy rate beyond which late samples of a shot are chaos


@dataclass(frozen=True)
class Point:
    """A problem with values for its unknowns, and the discrepancy rate of the model there."""

    problem: ShotProblem  # with the noise of the camera alone
    initial_states: Array  # (n, p)
    constants: Array  # (q,)
    discrepancy_rate: float  # error of the model per path length

    @property
    def names(self) -> tuple[str, ...]:
        """The constants."""
        return self.problem.names

    @property
    def model(self) -> Model:
        """The model at these constants."""
        return self.problem.model.with_values({n: float(v) for n, v in zip(self.names, self.constants, strict=True)})

    @property
    def weighted(self) -> ShotProblem:
        """The problem with the discrepancy of the model."""
        return self.problem.with_discrepancy(self.discrepancy_rate)

    def residuals(self, problem: ShotProblem | None = None) -> Array:
        """Residuals (n, m), of this problem or of the same one with other standard deviations."""
        n = len(self.initial_states)
        at = problem or self.problem
        return at.evaluate(self.initial_states, np.tile(self.constants, (n, 1)), np.arange(n))


@dataclass(frozen=True)
class HeldOut:
    """A model on held-out clips: only their initial states are fitted."""

    initial_states: Array  # (n, p)
    rms: float  # per axis [m]
    residuals: Array  # (n, m) [standard deviations of the noise]
    open_residuals: Array  # (n, m) the same with constants moved as far as the fit leaves them open


@dataclass(frozen=True)
class FittedModel(Point):
    """A model fitted to clips."""

    covariance: Array  # (q, q) of the constants; NaN if the clips do not determine them
    converged: bool
    rms: float  # of the clips, per axis [m]
    chi2: float  # reduced
    held_out: HeldOut | None = None

    @property
    def held_rms(self) -> float:
        """Rms of the held-out clips, per axis [m]; NaN without any."""
        return self.held_out.rms if self.held_out else float("nan")

    @property
    def miss(self) -> float:
        """Rms distance from the measured to the modelled ball, in the clips used [m]."""
        return MISS_OVER_AXIS * self.rms

    @property
    def held_miss(self) -> float:
        """Rms distance in the held-out clips [m]; NaN without any."""
        return MISS_OVER_AXIS * self.held_rms

    @property
    def sds(self) -> dict[str, float]:
        """Standard deviations of the constants; NaN where the clips do not determine them."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    def value(self, name: str) -> tuple[float, float]:
        """A constant and its standard deviation."""
        return float(self.constants[self.names.index(name)]), self.sds[name]


def as_model(found: FittedModel, command: str, files: Sequence[str], more: Mapping[str, Any] | None = None) -> Model:
    """The model of a fit, for a file: constants with their uncertainty, correlation and where they come from.

    A constant that the clips do not determine keeps its value from before the fit.

    Args:
        found: the fit; only constants of its model's effects are written.
        command: that made the fit.
        files: of the clips that gave the constants.
        more: additional entries of the file's [fitted].
    """
    model = found.problem.model
    rows = [k for k, name in enumerate(found.names) if name in model.parameters()]
    names, sds = [found.names[k] for k in rows], np.sqrt(np.diag(found.covariance))[rows]
    source = f"{command}, {counted(len(files), 'clip')}" + ("" if found.converged else ", NOT converged")
    estimates = dict(model.estimates)
    for name, sd in zip(names, sds.tolist(), strict=True):
        described = source if np.isfinite(sd) else f"{source}: not determined by these clips"
        estimates[name] = Estimate(sd if found.converged else float("nan"), described)
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = found.covariance[np.ix_(rows, rows)] / np.outer(sds, sds)
    summary = {
        "command": command, "clips": list(files), "converged": found.converged, "noise_m": found.problem.noise,
        "error_rate": found.discrepancy_rate, **(more or {}), "names": names,
        "correlation": [[float(np.round(v, 3)) for v in row] for row in correlation],
    }  # fmt: skip
    values = {n: found.value(n)[0] for n, sd in zip(names, sds, strict=True) if np.isfinite(sd)}
    return dataclasses.replace(model.with_values(values), estimates=estimates, fitted=summary)
