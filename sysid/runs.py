"""Runs between impacts, where whole shots are not followed.

A model that lacks much on the cloth leaves whole shots in false optima, since every impact multiplies what is wrong
before it, and then the wrong effect may promise most. A run without impacts has none: there cloth and camera are looked
at by themselves, and what is found is believed when whole shots are followed better with it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from models.effect import Effect
from models.model_file import Model
from models.shot import Table
from sysid.clips import ClipSet
from sysid.diagnose import NAMED, Begun, Round, Trial, candidates_for, look, scored, try_one
from sysid.fit import LEAST_SEGMENTS, MISCUT, SEGMENT_ROBUST, ratios, subset
from sysid.pieces import cut_up
from sysid.problem import open_table, shot_problem
from sysid.solve import fit_each
from sysid.stages import Clips, Stage, compare_stages, growth_of, settle

UNSEEN = 6.0  # times the median, by which a run misses that holds an unseen impact
STEPS = 8  # of the fit that shows it
Report = Callable[[str], None]


def runs_of(clips: Clips, model: Model) -> Clips:
    """The same clips, cut into runs; those that miss by far more than the others hold an unseen impact, and go."""
    training, held = (_smooth(part, clips.sigma, model) for part in (clips.training, clips.held))
    growth = growth_of(model, training, clips.sigma)
    other = growth_of(model, held, clips.sigma) if held.clips else None
    return dataclasses.replace(clips, training=training, held=held, growth=growth, held_growth=other, cut=0)


def _smooth(part: ClipSet, sigma: float, model: Model) -> ClipSet:
    runs = cut_up(part, sigma, impacts=False)
    if not runs.clips:
        return runs
    problem = shot_problem(model, (), runs, sigma)
    x, _ = fit_each(problem.evaluate, problem.start, np.zeros(0), problem.steps, problem.prior, SEGMENT_ROBUST, STEPS)
    miss = ratios(problem, x, np.zeros(0))
    return subset(runs, np.flatnonzero(miss < max(MISCUT, UNSEEN * float(np.median(miss)))).tolist())


def look_at_runs(clips: Clips, now: Stage, report: Report) -> Round | None:
    """Which effect of cloth or camera is missing in runs; None where there are too few of them."""
    table = now.model.table
    model = _on(now.model, open_table(table))
    runs = runs_of(clips, model)
    if len(runs.training.clips) < LEAST_SEGMENTS:
        return None
    report(f"{len(runs.training.clips)} runs between impacts")
    base = settle(runs, model, report, "runs")
    candidates = [one for one in candidates_for(model) if _acts(type(one.effect))]
    seen = look(runs, base, candidates, report)
    trials = tuple(dataclasses.replace(t, stage=_home(t.stage, table)) for t in seen.trials)
    return dataclasses.replace(seen, base=_home(seen.base, table), trials=trials, runs=len(runs.training.clips))


@dataclass(frozen=True)
class Belief:
    """What whole shots say to what runs have named."""

    stage: Stage | None = None  # whole shots with it, where they agree
    begun: Begun | None = None  # where they do not: what was seen of their own look


def promised(clips: Clips, now: Stage) -> Begun:
    """What whole shots promise, with what promises most fitted."""
    scores = scored(clips, now, candidates_for(now.model), lambda line: None)
    return Begun(scores, tuple(try_one(clips, now, row, lambda line: None) for row in scores.rows[:1]))


def believed(clips: Clips, now: Stage, best: Trial, own: Callable[[], Begun], report: Report) -> Belief:
    """Whole shots agree where they are followed better with what runs have named, and no better with something else.

    An effect that runs hardly show, since their own spins imitate it, leaves them to another that does a little: `own`
    is what whole shots promise themselves.
    """
    new = settle(clips, best.stage.model, report, f"with {best.name}")
    worth = compare_stages(clips, now, new)
    begun = own()
    if worth.delta_bic <= NAMED:
        return Belief(begun=begun)
    for rival in begun.fitted:
        better = rival.name != best.name and rival.converged
        if better and compare_stages(clips, new, rival.stage).delta_bic > NAMED:
            score = next(row for row in begun.scores.rows if row.candidate.name == best.name)
            return Belief(begun=Begun(begun.scores, (rival, Trial(score, new, worth))))
    return Belief(new)


def _acts(kind: type[Effect]) -> bool:
    """Whether an effect shows between impacts."""
    return kind.opens("forces", "observe", "exposures")


def _on(model: Model, table: Table) -> Model:
    return dataclasses.replace(model, table=table)


def _home(found: Stage, table: Table) -> Stage:
    """A stage whose model is that of the real table."""
    problem = found.point.problem
    point = dataclasses.replace(found.point, problem=dataclasses.replace(problem, model=_on(problem.model, table)))
    return dataclasses.replace(found, fit=dataclasses.replace(found.fit, point=point))
