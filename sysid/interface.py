"""The verbs of the `sysid` command as functions: what `from sysid import fit` gives.

In: a `ClipSet`, and a `Model` to start from: the base (decoupled cloth, frictional impacts) if none is given. Out: the
results of the rooms below, frozen values.
"""

from __future__ import annotations

from models.model_file import Model, full_model
from sysid.clips import ClipSet
from sysid.estimation.clip_fit import ClipFit, fit_clips
from sysid.residuals.compare import compare as compare_clips
from sysid.residuals.comparison import Comparison
from sysid.selection.diagnose import ClipDiagnosis
from sysid.selection.diagnose import diagnose as diagnose_clips
from sysid.selection.discover import DiscoveryResult
from sysid.selection.discover import discover as discover_effects


def compare(clips: ClipSet, model: Model | None = None) -> Comparison:
    """Where a model fails: initial states fitted, its constants held."""
    return compare_clips(clips, model or full_model(clips.table, clips.ball))


def fit(clips: ClipSet, model: Model | None = None) -> ClipFit:
    """Every constant of a model fitted, each with its standard deviation; every fifth clip is held out."""
    return fit_clips(clips, model or full_model(clips.table, clips.ball))


def diagnose(clips: ClipSet, model: Model | None = None) -> ClipDiagnosis:
    """Which effect of the catalogue a model lacks, if any."""
    return diagnose_clips(clips, model or full_model(clips.table, clips.ball))


def discover(clips: ClipSet, model: Model | None = None) -> DiscoveryResult:
    """Fit, diagnose and add effects until nothing significant remains."""
    return discover_effects(clips, model or full_model(clips.table, clips.ball))
