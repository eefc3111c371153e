"""A model fitted to a clip set without start values: `sysid fit`.

In: a clip set and a model. Out: a `ClipFit`: the model with its constants and their uncertainty, and the split.

Segments between events come first: they give the constants of the open cloth a start. Then windows of one impact each
are fitted and, where the model follows them, whole shots (sysid/estimation/from_nothing.py). Every fifth clip is held
out.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from models.model_file import Model
from sysid.clips import ClipSet
from sysid.estimation.fitted import FittedModel, as_model
from sysid.estimation.from_nothing import fit_from_nothing
from sysid.estimation.open_cloth import OpenCloth
from sysid.estimation.solver.blas import on_one_blas_thread
from sysid.estimation.split import Split, split

BAND_SHARE = 0.95  # of the residuals inside the predicted band


@dataclass(frozen=True)
class ClipFit:
    """A model fitted to clips."""

    parts: Split
    fitted: FittedModel
    model: Model  # with values and estimates
    segment_ratio: float  # median rms of the segments over noise
    band_rate: float  # discrepancy rate for 95 % of the residuals, those of shots in false optima included

    @property
    def converged(self) -> bool:
        """Whether the fit ended at an optimum; standard deviations are valid only then."""
        return self.fitted.converged

    @property
    def constants(self) -> dict[str, tuple[float, float]]:
        """Value and standard deviation of each fitted constant, SI; nan where the fit did not converge."""
        values = self.model.parameters()
        return {n: (values[n], sd if self.converged else math.nan) for n, sd in self.fitted.sds.items()}

    def without_clips(self) -> Self:
        """The figures of the fit without its shots, which take much memory for thousands of clips."""
        none = np.zeros(0, np.int64)
        fitted = dataclasses.replace(
            self.fitted, problem=self.fitted.problem.only(none), initial_states=self.fitted.initial_states[:0],
            held_out=None,
        )  # fmt: skip
        parts = dataclasses.replace(self.parts, training=self.parts.training.only(none), held_out=None)
        return dataclasses.replace(self, parts=parts, fitted=fitted)


@on_one_blas_thread
def fit_clips(clip_set: ClipSet, model: Model) -> ClipFit:
    """Fit every constant of the model's stack to the training clips of a set.

    Raises:
        BadInput: where there are too few segments between events.
    """
    parts, cloth, model = split(clip_set, model)
    parts, _, found = fit_from_nothing(parts, model)
    return _clip_fit(parts, found, cloth)


def _clip_fit(parts: Split, found: FittedModel, cloth: OpenCloth) -> ClipFit:
    band = band_rate(found)
    files = [c.file for c in parts.training.clips]
    made = as_model(found, "sysid fit", files, {"segment_ratio": cloth.ratio, "band_rate": band})
    return ClipFit(parts, found, made, cloth.ratio, band)


def band_rate(found: FittedModel) -> float:
    """Discrepancy rate whose band holds 95 % of a fit's residuals, those of shots in false optima included."""
    return found.problem.discrepancy_rate(found.initial_states, found.constants, BAND_SHARE)
