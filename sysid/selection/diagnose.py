"""One diagnosis from clips: fit the model, and find the effect that it lacks.

In: a `ClipSet` and a `Model`. Out: a `ClipDiagnosis`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from models.model_file import Model
from sysid.clips import ClipSet
from sysid.estimation.fitted import FittedModel
from sysid.estimation.from_nothing import fit_from_nothing
from sysid.estimation.solver.blas import on_one_blas_thread
from sysid.estimation.split import Split, split
from sysid.selection.fits.by_whole_shots import ByWholeShots
from sysid.selection.fits.by_windows import ByWindows
from sysid.selection.formulas.description import describe
from sysid.selection.judgement import ERROR_RATE, V, judged, unknowns_of_terms
from sysid.selection.next_shot import NextShot, propose_next
from sysid.selection.remainder import remainder
from sysid.selection.screening import Diagnosis
from sysid.selection.search import Round, next_cause


@dataclass(frozen=True)
class ClipDiagnosis:
    """The diagnosis of a model by a set of clips."""

    parts: Split
    fitted: FittedModel  # the model whose residuals are explained, on whole shots
    diagnosis: Diagnosis
    unexplained: Mapping[str, Any] | None  # a formula or a remark on what no effect explains, as result.json has it
    next_shots: tuple[NextShot, ...]  # to film, the best first

    @property
    def verdict(self) -> str | None:
        """The effect to add; None if there is none."""
        return self.diagnosis.name

    @property
    def next_shot(self) -> NextShot | None:
        """The first of the next shots."""
        return self.next_shots[0] if self.next_shots else None

    @property
    def ranking(self) -> tuple[tuple[str, float], ...]:
        """Fitted candidates, best first, each with its log odds over the model."""
        return tuple((one.name, one.evidence.log_odds) for one in self.diagnosis.screening.fits)


@on_one_blas_thread
def diagnose(clip_set: ClipSet, model: Model, error_rate: float = ERROR_RATE) -> ClipDiagnosis:
    """Fit the model to the clips and search for what it lacks, see `discover`; every fifth clip is held out."""
    parts, _, model = split(clip_set, model)
    parts, at, base = fit_from_nothing(parts, model)
    if parts.training.is_long:
        windows = ByWindows(at, base)
        seen = next_cause(windows, error_rate=error_rate)
        if seen.view is not windows or not parts.follows(base):
            return _diagnosed(parts, base, windows, seen, error_rate)
    whole = ByWholeShots(parts, base)
    return _diagnosed(parts, base, whole, next_cause(whole, error_rate=error_rate), error_rate)


def _diagnosed(parts: Split, base: FittedModel, view: V, seen: Round[V], error_rate: float) -> ClipDiagnosis:
    """The diagnosis from a round for a fit; `base` is the fit on whole shots."""
    diagnosis = Diagnosis(seen.screening, seen.formula)
    unexplained: Mapping[str, Any] | None = None
    if seen.formula is not None:
        evidence = judged(view.beside(seen.view), seen.view, unknowns_of_terms(seen.formula.terms)).evidence
        unexplained = describe(seen.formula, seen.view.fitted, evidence)
    elif diagnosis.name is None:
        unexplained = remainder(base)
    named = (diagnosis.name,) if diagnosis.name else ()
    shots = propose_next(parts, base, (seen.screening,), named, error_rate)
    return ClipDiagnosis(parts, base, diagnosis, unexplained, shots)
