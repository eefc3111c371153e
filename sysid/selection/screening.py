"""The result of a round of discovery: scored and fitted candidates, and which of them is missing.

In: scores and fits (of search.py). Out: a `Screening`: the fits with their evidence over the base, the best of them,
its margin over the next, and the candidates that these data confound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from models.effect import Effect
from models.effect_catalogue import catalogue
from models.model_file import Model
from sysid.estimation.fitted import FittedModel
from sysid.selection.formulas.formula import SEPARATED_LOG_ODDS, SparseFormula
from sysid.selection.scoring.evidence import Evidence
from sysid.selection.scoring.score import Score, Scores
from sysid.selection.scoring.signatures import Candidate, candidate

CONFOUNDED_CORRELATION = 0.9  # least correlation of two signatures that are confounded


@dataclass(frozen=True)
class FittedCandidate:
    """A fitted candidate."""

    score: Score
    fitted: FittedModel
    evidence: Evidence  # over the base
    generalises: bool = True  # whether held-out shots do not contradict it
    shown_by: str = ""  # the one clip that it rests on, which is why it is not accepted

    @property
    def name(self) -> str:
        """The candidate's name."""
        return self.score.candidate.name

    @property
    def converged(self) -> bool:
        """Whether its fit converged."""
        return self.fitted.converged


@dataclass(frozen=True)
class Screening:
    """The result of one round."""

    base: FittedModel
    scores: Scores  # of effects of the catalogue
    fits: tuple[FittedCandidate, ...]  # best first; of tied ones, that with the fewest constants first
    confounded: tuple[tuple[str, str, float], ...]  # pairs of relevant candidates, with their correlation
    tied: tuple[tuple[str, str], ...]  # pairs of fits that the evidence does not separate
    windows: int = 0  # number of windows on which candidates were scored; 0 for whole shots
    best: FittedCandidate | None = None  # the effect to name

    @property
    def count(self) -> int:
        """Residuals."""
        return self.scores.count

    @property
    def margin(self) -> float:
        """Delta BIC of the best fit over the next; infinite if no other candidate was fitted."""
        odds = [one.evidence.delta_bic for one in self.fits]
        return odds[0] - odds[1] if len(odds) > 1 else float("inf")

    @property
    def refuted(self) -> tuple[str, ...]:
        """Candidates supported by the training clips whose fit follows the held-out clips worse."""
        return tuple(one.name for one in self.fits if not one.generalises and one.evidence.log_odds > 0.0)

    @property
    def shown_once(self) -> dict[str, str]:
        """Candidates that are accepted but for one clip, which alone shows them, with that clip."""
        return {one.name: one.shown_by for one in self.fits if one.shown_by}

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Names of candidates whose fit did not converge."""
        return tuple(one.name for one in self.fits if not one.converged)


@dataclass(frozen=True)
class Diagnosis:
    """The outcome of one round, in whole shots or in windows."""

    screening: Screening
    formula: SparseFormula | None = None  # of structure that no effect explains

    @property
    def name(self) -> str | None:
        """The effect to name."""
        return self.screening.best.name if self.screening.best is not None and self.formula is None else None


def candidates_for(model: Model, extra: Sequence[type[Effect]] = ()) -> list[Candidate]:
    """Candidates from effects that the model lacks and that replace none of its own; local ones at several places."""
    active, slots = {e.name() for e in model.effects}, {e.slot for e in model.effects if e.slot}
    found = [k for n, k in catalogue().items() if n not in active and k.slot not in slots]
    return [candidate(start) for k in [*found, *extra] for start in k.starts(model.table)]


def confounded(scores: Scores) -> tuple[tuple[str, str, float], ...]:
    """Pairs of confounded candidates, one of which is relevant, with their correlation."""
    predicted = {row.candidate.name: row.predicted_improvement for row in scores.rows}
    least = max(2 * SEPARATED_LOG_ODDS, 0.5 * max(predicted.values(), default=0.0))
    return tuple(
        (a, b, value)
        for (a, b), value in sorted(scores.correlations.items())
        if value > CONFOUNDED_CORRELATION and max(predicted[a], predicted[b]) > least
    )


def tied(fits: Sequence[FittedCandidate]) -> tuple[tuple[str, str], ...]:
    """Pairs of fits that the evidence does not separate."""
    return tuple(
        (one.name, two.name)
        for one, two in combinations(fits, 2)
        if abs(one.evidence.log_odds - two.evidence.log_odds) < SEPARATED_LOG_ODDS
    )
