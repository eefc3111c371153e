"""Runs between impacts, where whole shots are not followed.

A model that lacks much on the cloth leaves whole shots in false optima, since every impact multiplies what is wrong
before it, and then the wrong effect may promise most. A run without impacts has none: there cloth and camera are looked
at by themselves, and what is found is believed when whole shots are followed better with it.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from models.effect import Effect
from models.model_file import Model
from models.shot import Table
from sysid.clips.pieces import cut_up
from sysid.estimation.fitted import FittedModel
from sysid.estimation.least_squares import fit_each
from sysid.estimation.open_cloth import MIN_SEGMENTS, START_CAUCHY_SD, UNSEEN_EVENT_RATIO, ratios
from sysid.estimation.problem import open_table
from sysid.estimation.shot_problem import ShotProblem, shot_problem
from sysid.estimation.split import Split, fit_anew
from sysid.selection.evidence import compare_fits
from sysid.selection.score import score_all
from sysid.selection.screening import NAMED, Begun, Round, Trial, candidates_for, look, try_one

UNSEEN_TIMES_MEDIAN = 6.0  # times the median, by which a run misses that holds an unseen impact
SCREENING_STEPS = 8  # of the fit that shows it
log = logging.getLogger(__name__)


def runs_of(parts: Split, model: Model) -> Split:
    """The same shots, cut into runs; those that miss by far more than the others hold an unseen impact, and go."""
    training = _smooth(parts.training, model)
    held = _smooth(parts.held_out, model) if parts.held_out else None
    return Split(training, held if held and held.clips else None, parts.spikes)


def _smooth(part: ShotProblem, model: Model) -> ShotProblem:
    runs, none = cut_up(part.clip_set, part.noise, impacts=False), np.zeros(0)
    problem = shot_problem(model, (), runs, part.noise, part.known)
    if not runs.clips:
        return problem
    x, _ = fit_each(problem.objective(START_CAUCHY_SD), problem.start, none, SCREENING_STEPS)
    miss = ratios(problem, x, none)
    return problem.only(np.flatnonzero(miss < max(UNSEEN_EVENT_RATIO, UNSEEN_TIMES_MEDIAN * float(np.median(miss)))))


def look_at_runs(parts: Split, now: FittedModel) -> Round | None:
    """Which effect of cloth or camera is missing in runs; None where there are too few of them."""
    table = now.model.table
    model = _on(now.model, open_table(table))
    runs = runs_of(parts, model)
    if len(runs.training.clips) < MIN_SEGMENTS:
        return None
    log.info("%d runs between impacts", len(runs.training.clips))
    base = fit_anew(runs, model, "runs")
    candidates = [one for one in candidates_for(model) if _acts(type(one.effect))]
    seen = look(runs, base, candidates)
    trials = tuple(dataclasses.replace(t, fitted=_home(t.fitted, table)) for t in seen.trials)
    return dataclasses.replace(seen, base=_home(seen.base, table), trials=trials, runs=len(runs.training.clips))


@dataclass(frozen=True)
class Belief:
    """What whole shots say to what runs have named."""

    fitted: FittedModel | None = None  # whole shots with it, where they agree
    begun: Begun | None = None  # where they do not: what was seen of their own look


def promised(parts: Split, now: FittedModel) -> Begun:
    """What whole shots promise, with what promises most fitted."""
    scores = score_all(now, candidates_for(now.model))
    return Begun(scores, tuple(try_one(parts, now, row) for row in scores.rows[:1]))


def believed(parts: Split, now: FittedModel, best: Trial, own: Callable[[], Begun]) -> Belief:
    """Whole shots agree where they are followed better with what runs have named, and no better with something else.

    An effect that runs hardly show, since their own spins imitate it, leaves them to another that does a little: `own`
    is what whole shots promise themselves.
    """
    new = fit_anew(parts, best.fitted.model, f"with {best.name}")
    worth = compare_fits(now, new)
    begun = own()
    if worth.delta_bic <= NAMED:
        return Belief(begun=begun)
    for rival in begun.fitted:
        better = rival.name != best.name and rival.converged
        if better and compare_fits(new, rival.fitted).delta_bic > NAMED:
            score = next(row for row in begun.scores.rows if row.candidate.name == best.name)
            return Belief(begun=Begun(begun.scores, (rival, Trial(score, new, worth))))
    return Belief(new)


def _acts(kind: type[Effect]) -> bool:
    """Whether an effect shows between impacts."""
    return kind.opens("forces", "observe", "exposures")


def _on(model: Model, table: Table) -> Model:
    return dataclasses.replace(model, table=table)


def _home(found: FittedModel, table: Table) -> FittedModel:
    """A fit whose model is that of the real table."""
    return dataclasses.replace(found, problem=found.problem.with_model(_on(found.problem.model, table), found.names))
