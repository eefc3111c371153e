"""One diagnosis from clips: fit the model, and say which effect it lacks.

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
from sysid.estimation.split import Split, in_any_case, split
from sysid.selection.by_windows import described_in_windows, screen_windows
from sysid.selection.evidence import holds
from sysid.selection.formula import describe
from sysid.selection.judge import Diagnosis, diagnose_fit
from sysid.selection.next_shot import NextShot, propose_next
from sysid.selection.remainder import remainder


@dataclass(frozen=True)
class ClipDiagnosis:
    """What a model lacks by a set of clips."""

    parts: Split
    fitted: FittedModel  # the model whose residuals are explained, on whole shots
    diagnosis: Diagnosis
    unexplained: Mapping[str, Any] | None  # a formula or a remark on what no effect explains, as result.json has it
    next_shot: NextShot | None

    @property
    def verdict(self) -> str | None:
        """The effect to add; None if none is named."""
        return self.diagnosis.name

    @property
    def ranking(self) -> tuple[tuple[str, float], ...]:
        """Candidates that were fitted, best first, each with its delta BIC over the model."""
        return tuple((one.name, one.evidence.delta_bic) for one in self.diagnosis.screening.fits)


def diagnose(clip_set: ClipSet, model: Model) -> ClipDiagnosis:
    """Fit the model to the clips and search what it lacks; every fifth clip is held out."""
    parts, _, model = split(clip_set, model)
    parts, at, base = fit_from_nothing(parts, model)
    if parts.needs_windows(base):
        seen = screen_windows(at, base)
        named = (seen.name,) if seen.name else ()
        if named or seen.formula or (parts.training.is_long and not parts.follows(base)):
            unexplained = None if named else remainder(base)
            if seen.formula is not None:
                unexplained = described_in_windows(seen.formula, at, seen.fitted, base)
            shot = propose_next(parts, base, (seen.screening,), named)
            return ClipDiagnosis(parts, base, Diagnosis(seen.screening, seen.formula), unexplained, shot)
        base = in_any_case(parts, base)
    diagnosis = diagnose_fit(parts, base)
    unexplained, fitted, screening = None, diagnosis.fitted_formula, diagnosis.screening
    if diagnosis.formula is not None and fitted is not None and holds(screening.base, fitted.fitted):
        unexplained = describe(diagnosis.formula, fitted.fitted, fitted.evidence)
    elif diagnosis.name is None:
        unexplained = remainder(screening.base)
    named = (diagnosis.name,) if diagnosis.name else ()
    shot = propose_next(parts, base, (screening,), named)
    return ClipDiagnosis(parts, base, diagnosis, unexplained, shot)
