"""One look at what is missing: a named effect, a formula for something else, or nothing.

Where whole shots are not followed, runs between impacts are asked first, and named is what whole shots agree to.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

from sysid.estimation.fitted import FittedModel
from sysid.estimation.split import Split
from sysid.selection.evidence import left_over
from sysid.selection.formula import Structure, scores_of_terms, select
from sysid.selection.runs import believed, look_at_runs, promised
from sysid.selection.screening import REST, Round, Trial, candidates_for, look, try_one

STANDS = 3.0  # times less may a named effect promise than such a term and still be tried
OUTDOES = 1.2  # by which a term must promise more than the best named effect to stand for it
SHARE = 0.05  # of what a formula leaves beyond noise: what a named effect beside it must promise
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Judgement:
    """What one look says."""

    round: Round
    structure: Structure | None = None  # what stands for it where no effect does
    trial: Trial | None = None  # the formula, fitted
    believed: FittedModel | None = None  # whole shots with the effect, where runs named it
    runs: Round | None = None  # runs that were asked first, where whole shots did not agree with them

    @property
    def name(self) -> str | None:
        """The effect to name."""
        best = self.round.best
        return best.name if best is not None and self.structure is None else None

    @property
    def rounds(self) -> tuple[Round, ...]:
        """Everything that was looked at."""
        return (self.runs, self.round) if self.runs is not None else (self.round,)


def judge(parts: Split, now: FittedModel, formula: bool = True, smooth: bool = True) -> Judgement:
    """Look for the missing effect; where none explains what is left, for a `formula` outside the catalogue.

    `smooth` says whether runs without impacts may be asked.
    """
    runs, begun = None, None
    if smooth and formula and not parts.follows(now):
        runs = look_at_runs(parts, now)
        if runs is not None and runs.best is not None:
            belief = believed(parts, now, runs.best, lambda: promised(parts, now))
            if belief.fitted is not None:
                return Judgement(runs, believed=belief.fitted)
            begun = belief.begun
    known: list[Structure | None] = []

    def outside(base: FittedModel) -> Structure | None:
        if not known:
            known.append(select(*scores_of_terms(base)))
        return known[0]

    def bar() -> float:
        found = outside(now) if formula else None
        return found.gains[0] / STANDS if found else 0.0

    seen = look(parts, now, candidates_for(now.model), bar, 0.0 if formula else SHARE, begun)
    best, now = seen.best, seen.base
    if not formula or left_over(best.fitted if best else now) <= REST:
        return Judgement(seen, runs=runs)
    structure = outside(now)
    if structure is None or (best is not None and structure.gains[0] <= OUTDOES * best.score.gain):
        return Judgement(seen, runs=runs)
    log.info("a formula: %s", ", ".join(t.name for t in structure.terms))
    trial = try_one(parts, now, structure.score())
    if trial.evidence.delta_bic <= 0:
        return Judgement(seen, runs=runs)
    return Judgement(seen, structure, trial, runs=runs)
