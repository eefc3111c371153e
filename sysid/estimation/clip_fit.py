"""A model fitted to a clip set, whole shots from nothing: `sysid fit`.

Segments between events first: they give what acts on open cloth, where the constants of whole shots begin. Every fifth
clip is held out. Where whole shots are not followed to the noise, uncertainties are those of their first events.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.model_file import Model
from sysid.clips import ClipSet
from sysid.estimation.fitted import FittedModel, as_model
from sysid.estimation.fitting import fit_from_nothing, widened
from sysid.estimation.split import Split, split, tried

BAND_SHARE = 0.95  # of the residuals that the band holds


@dataclass(frozen=True)
class ClipFit:
    """A model fitted to clips."""

    parts: Split
    fitted: FittedModel
    model: Model  # with values and estimates
    segment_ratio: float  # median rms of the segments over noise
    band_rate: float  # discrepancy rate for 95 % of the residuals, of which some shots go astray


def fit_clips(clip_set: ClipSet, model: Model, command: str = "sysid fit") -> ClipFit:
    """Fit every constant of the model's stack to the training clips of a set.

    Raises:
        BadInput: where there are too few segments between events.
    """
    parts, cloth, model = split(clip_set, model, cut=False)
    problem = parts.training.with_model(model, tuple(model.parameters()))
    found = tried(parts, widened(fit_from_nothing(problem, "whole shots")), None)
    band = problem.discrepancy_rate(found.initial_states, found.constants, BAND_SHARE)
    files = [c.file for c in parts.training.clips]
    made = as_model(found, command, files, {"segment_ratio": cloth.ratio, "band_rate": band})
    return ClipFit(parts, found, made, cloth.ratio, band)
