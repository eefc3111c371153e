"""One look at what is missing: a named effect, a formula for something else, or nothing.

Where whole shots are not followed, runs between impacts are asked first, and named is what whole shots agree to.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from sysid.diagnose import REST, Round, Trial, candidates_for, look, try_one
from sysid.runs import believed, look_at_runs, promised
from sysid.stages import Clips, Stage, followed, left_over
from sysid.structure import Structure, scores_of_terms, select

STANDS = 3.0  # times less may a named effect promise than such a term and still be tried
OUTDOES = 1.2  # by which a term must promise more than the best named effect to stand for it
SHARE = 0.05  # of what a formula leaves beyond noise: what a named effect beside it must promise
Report = Callable[[str], None]


@dataclass(frozen=True)
class Judgement:
    """What one look says."""

    round: Round
    structure: Structure | None = None  # what stands for it where no effect does
    trial: Trial | None = None  # the formula, fitted
    believed: Stage | None = None  # whole shots with the effect, where runs named it
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


def judge(
    clips: Clips, now: Stage, report: Report = lambda line: None, formula: bool = True, smooth: bool = True
) -> Judgement:
    """Look for the missing effect; where none explains what is left, for a `formula` outside the catalogue.

    `smooth` says whether runs without impacts may be asked.
    """
    runs, begun = None, None
    if smooth and formula and not followed(clips, now):
        runs = look_at_runs(clips, now, report)
        if runs is not None and runs.best is not None:
            belief = believed(clips, now, runs.best, lambda: promised(clips, now), report)
            if belief.stage is not None:
                return Judgement(runs, believed=belief.stage)
            begun = belief.begun
    known: list[Structure | None] = []

    def outside(base: Stage) -> Structure | None:
        if not known:
            known.append(select(*scores_of_terms(clips, base, report)))
        return known[0]

    def bar() -> float:
        found = outside(now) if formula else None
        return found.gains[0] / STANDS if found else 0.0

    seen = look(clips, now, candidates_for(now.model), report, bar, 0.0 if formula else SHARE, begun)
    best, now = seen.best, seen.base
    if not formula or left_over(clips, best.stage if best else now) <= REST:
        return Judgement(seen, runs=runs)
    structure = outside(now)
    if structure is None or (best is not None and structure.gains[0] <= OUTDOES * best.score.gain):
        return Judgement(seen, runs=runs)
    report(f"a formula: {', '.join(t.name for t in structure.terms)}")
    trial = try_one(clips, now, structure.score(), report)
    if trial.evidence.delta_bic <= 0:
        return Judgement(seen, runs=runs)
    return Judgement(seen, structure, trial, runs=runs)
