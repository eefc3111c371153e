"""Screening on segments between impacts, where whole shots are not followed.

In: clips (`Split`) and their fit (`FittedModel`). Out: a `Screening` of the segments, and a `Confirmation` of its best
effect by whole shots.

Every impact multiplies the error before it. A model that lacks much on the cloth so leaves whole shots in false optima,
where a wrong effect may have the largest predicted improvement. A segment without impacts has no such optima: it shows
cloth and camera alone. What is found there is accepted if whole shots are followed better with it.
"""

from __future__ import annotations

import dataclasses
import logging
from dataclasses import dataclass

import numpy as np

from models.effect import Effect
from models.model_file import Model
from sysid.clips.pieces import cut_clips
from sysid.estimation.fitted import FittedModel
from sysid.estimation.open_cloth import MIN_SEGMENTS, START_CAUCHY_SD, UNSEEN_EVENT_RATIO, ratios
from sysid.estimation.problem import on_open_table
from sysid.estimation.shot_problem import ShotProblem, shot_problem
from sysid.estimation.solver.least_squares import fit_each
from sysid.estimation.split import Split, fit_anew
from sysid.selection.evidence import compare_fits
from sysid.selection.score import score_all
from sysid.selection.screening import (
    MIN_DELTA_BIC,
    FittedCandidate,
    PartialScreening,
    Screening,
    candidates_for,
    fit_candidate,
    fit_most_promising,
    screen,
    with_better_states,
)

MAX_RATIO_TO_MEDIAN = 6.0  # of a segment's residuals, over the median of all: beyond it holds an unseen impact
SEGMENT_FIT_STEPS = 8  # iterations of the fit that shows it
log = logging.getLogger(__name__)


def segments_of(parts: Split, model: Model) -> Split:
    """The same shots, cut into segments without impacts; those that seem to hold an unseen impact are left out."""
    training = _without_unseen_impacts(parts.training, model)
    held = _without_unseen_impacts(parts.held_out, model) if parts.held_out else None
    return Split(training, held if held and held.clips else None, parts.spikes)


def _without_unseen_impacts(part: ShotProblem, model: Model) -> ShotProblem:
    segments, none = cut_clips(part.clip_set, part.noise), np.zeros(0)
    problem = shot_problem(model, (), segments, part.noise, part.known, part.correlation_time, part.slow_noise)
    if not segments.clips:
        return problem
    x, _ = fit_each(problem.objective(START_CAUCHY_SD), problem.start, none, SEGMENT_FIT_STEPS)
    miss = ratios(problem, x, none)
    return problem.only(np.flatnonzero(miss < max(UNSEEN_EVENT_RATIO, MAX_RATIO_TO_MEDIAN * float(np.median(miss)))))


def screen_segments(parts: Split, now: FittedModel) -> Screening | None:
    """Which effect of cloth or camera is missing in the segments; None where there are too few of them."""
    model = on_open_table(now.model)
    segments = segments_of(parts, model)
    count = len(segments.training.clips)
    if count < MIN_SEGMENTS:
        return None
    log.info("%d segments between impacts", count)
    base = fit_anew(segments, model, "segments")
    candidates = [one for one in candidates_for(now.model) if _acts_between_impacts(type(one.effect))]
    seen = screen(segments, base, candidates)
    fits = tuple(dataclasses.replace(one, fitted=_on_table_of(now.model, one.fitted)) for one in seen.fits)
    return dataclasses.replace(seen, base=_on_table_of(now.model, seen.base), fits=fits, segments=count)


@dataclass(frozen=True)
class Confirmation:
    """Whether whole shots confirm an effect that segments named; one of the two is given."""

    fitted: FittedModel | None = None  # whole shots with the effect, where they confirm it
    partial: PartialScreening | None = None  # what is known of their own screening, where they do not


def screen_whole_shots(parts: Split, now: FittedModel) -> PartialScreening:
    """Scores of all candidates on whole shots, and the fit of the first."""
    scores = score_all(now, candidates_for(now.model))
    return PartialScreening(scores, tuple(fit_candidate(parts, now, row) for row in scores.rows[:1]))


def confirm(parts: Split, now: FittedModel, best: FittedCandidate, partial: PartialScreening) -> Confirmation:
    """Confirm an effect if whole shots are followed better with it, and not better still with a candidate of theirs.

    An effect that segments hardly show, since their initial spins imitate it, would else lose to a minor one. One that
    acts at impacts alone does not compete, since segments do not show it and both may be missing; but if at its usual
    size it explains more, it comes first, and what segments name is seen more clearly after it.

    Args:
        parts: whole shots.
        now: their fit without the effect.
        best: the effect, fitted to the segments.
        partial: the screening of whole shots, with its best candidates fitted.
    """
    new = fit_anew(parts, best.fitted.model, f"with {best.name}")
    # A shot that one of both fits has in a false optimum must not decide.
    evidence = compare_fits(with_better_states(now, new)[0], with_better_states(new, now)[0])
    if evidence.delta_bic <= MIN_DELTA_BIC:
        return Confirmation(partial=partial)
    for rival in partial.fitted:
        acts = _acts_between_impacts(type(rival.score.candidate.effect))
        other = rival.name != best.name and rival.converged and acts
        if other and compare_fits(new, rival.fitted).delta_bic > MIN_DELTA_BIC:
            score = next(row for row in partial.scores.rows if row.candidate.name == best.name)
            known = PartialScreening(partial.scores, (rival, FittedCandidate(score, new, evidence)))
            return Confirmation(partial=known)
    at_impacts = [row for row in partial.scores.rows if not _acts_between_impacts(type(row.candidate.effect))]
    first = fit_most_promising(parts, now, at_impacts, [new])
    if first is None or not (first.converged and first.generalises):
        return Confirmation(new)
    if compare_fits(new, first.fitted).delta_bic <= MIN_DELTA_BIC:
        return Confirmation(new)
    return Confirmation(partial=PartialScreening(partial.scores, (first,)))


def _acts_between_impacts(kind: type[Effect]) -> bool:
    """Whether an effect shows between impacts."""
    return kind.opens("forces", "observe", "exposures")


def _on_table_of(model: Model, found: FittedModel) -> FittedModel:
    """The fit, its model on the table of another."""
    own = dataclasses.replace(found.problem.model, table=model.table, sizes=model.sizes)
    return dataclasses.replace(found, problem=found.problem.with_model(own, found.names))
