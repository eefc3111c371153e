"""Every shot's own unknowns, at given constants.

A whole shot has many false optima beyond its first impacts, so the horizon grows from event to event, errors being
forgiven in proportion to the way travelled, most of all since the first event; shots that do not fit are tried again
with other spins. Last comes the whole shot with equal weight for every sample.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.clips import Clip, ClipSet
from sysid.problem import Array, Index, ShotProblem
from sysid.segments import event_times
from sysid.solve import Prior, fit_each, loss

FORGIVE = 0.02  # error forgiven per way travelled since the first event, while the horizon grows
BEFORE = 0.1  # of that is forgiven before the first event
ROBUST = 4.0  # Cauchy's constant, in standard deviations
RETRY = 4.0  # cost per residual beyond which a shot is tried from other spins
TRIALS = ((6, -0.8), (6, -0.3), (6, 0.3), (6, 0.8), (5, -0.7), (5, 0.7))  # unknown, shift over speed
MAX_STAGES = 12


def ways(clip: Clip, first: float) -> dict[str, Array]:
    """How far each sample's error has had to grow: the way of its ball and of what set it moving [m].

    What was travelled before the first event counts a tenth: impacts magnify errors, open cloth does not.
    """
    struck = clip.balls[clip.struck]

    def run(time: Array, xy: Array) -> Array:
        step = np.hypot(*np.diff(xy, axis=0).T) * np.where(time[1:] > first, 1.0, BEFORE)
        return np.concatenate([[0.0], np.cumsum(step)])

    lead = run(struck.time, struck.xy)
    found = {clip.struck: lead}
    for name, seen in clip.balls.items():
        if name != clip.struck:
            own = run(seen.time, seen.xy)
            moving = np.flatnonzero(own > 0.02)
            start = np.interp(seen.time[moving[0]], struck.time, lead) if moving.size else 0.0
            found[name] = own + start * (own > 0.02)
    return found


def with_error(problem: ShotProblem, sigma: float, rate: float, way: Sequence[dict[str, Array]]) -> ShotProblem:
    """The problem with a model error that grows with the way: sd = hypot(sigma, rate way)."""
    return dataclasses.replace(problem, sd=np.hypot(sigma, rate * problem.laid(way)))


def events_and_ways(clip_set: ClipSet, sigma: float) -> tuple[list[Array], list[dict[str, Array]]]:
    """Times of the struck ball's events, and how far every sample lies from the first one."""
    events = [event_times(c, clip_set.table, clip_set.ball, sigma, clip_set.fps) for c in clip_set.clips]
    first = [e[0] if e.size else np.inf for e in events]
    return events, [ways(c, f) for c, f in zip(clip_set.clips, first, strict=True)]


def fit_own(
    problem: ShotProblem,
    clip_set: ClipSet,
    constants: Array,
    sigma: float,
    report: Callable[[str], None] | None = None,
) -> Array:
    """Own unknowns of every shot, grown from event to event: (n, p)."""
    growth = Growth.of(problem, clip_set, sigma)
    x = problem.start.copy()
    for stage in range(growth.stages):
        x = growth.own(x, constants, stage)
        if report:
            report(f"shots up to event {stage + 1} of {growth.stages}")
    return x


@dataclass(frozen=True)
class Growth:
    """The horizons of a set of shots, stage by stage."""

    problem: ShotProblem
    clip_set: ClipSet
    sigma: float
    events: list[Array]
    way: list[dict[str, Array]]

    @staticmethod
    def of(problem: ShotProblem, clip_set: ClipSet, sigma: float) -> Growth:
        """The horizons of a problem's shots: their events found."""
        return Growth(problem, clip_set, sigma, *events_and_ways(clip_set, sigma))

    def at(self, problem: ShotProblem) -> Growth:
        """The same shots with another model or noise."""
        return dataclasses.replace(self, problem=problem)

    @property
    def grown(self) -> ShotProblem:
        """The problem with what is forgiven while the horizon grows."""
        return with_error(self.problem, self.sigma, FORGIVE, self.way)

    @property
    def stages(self) -> int:
        """How many horizons there are; the last is the end of every shot."""
        return min(max((len(e) for e in self.events), default=0), MAX_STAGES) + 1

    def horizon(self, stage: int) -> Array:
        """Until when each shot is looked at: (n,) [s]."""
        end = self.problem.horizon
        if stage < 0:
            return np.zeros_like(end)
        whole = stage >= self.stages - 1
        return np.array([_horizon(e, stage, t, whole) for e, t in zip(self.events, end, strict=True)])

    def own(self, x: Array, constants: Array, stage: int) -> Array:
        """Own unknowns at this stage, from those of the stage before."""
        todo = np.flatnonzero(self.horizon(stage) > self.horizon(stage - 1))
        x = x.copy()
        if todo.size:
            x[todo] = _stage(self.grown.until(self.horizon(stage)), x, constants, todo, retry=stage > 0)
        return x


def _horizon(events: Array, stage: int, end: float, last: bool) -> float:
    return end if last or stage >= len(events) else min(float(events[stage]) - 1e-3, end)


def _stage(problem: ShotProblem, x: Array, constants: Array, todo: Index, retry: bool) -> Array:
    prior = Prior(problem.prior.mean[todo], problem.prior.sd[todo])
    best, cost = fit_each(problem.evaluate, x[todo], constants, problem.steps, prior, ROBUST, 6, todo)
    if not retry:
        return best
    r = problem.evaluate(best, np.tile(constants, (todo.size, 1)), todo)
    bad = np.flatnonzero(loss(r, ROBUST) > RETRY * np.isfinite(r).sum(axis=1) / 2)
    if bad.size == 0:
        return best
    for unknown, shift in TRIALS:
        moved = best[bad].copy()
        moved[:, unknown] += shift * np.hypot(moved[:, 2], moved[:, 3])
        here = Prior(prior.mean[bad], prior.sd[bad])
        new, new_cost = fit_each(problem.evaluate, moved, constants, problem.steps, here, ROBUST, 4, todo[bad])
        better = new_cost < cost[bad]
        best[bad[better]], cost[bad[better]] = new[better], new_cost[better]
    return best


def polish(problem: ShotProblem, x: Array, constants: Array, rounds: int = 2) -> Array:
    """Whole shots, by their noise alone: least squares but for what lies beyond four times a shot's own scatter."""
    n = len(x)
    for _ in range(rounds):
        r = problem.evaluate(x, np.tile(constants, (n, 1)), np.arange(n))
        scatter = np.sqrt(np.nanmean(np.minimum(np.abs(r), 4 * np.nanstd(r, axis=1, keepdims=True)) ** 2, axis=1))
        scale = np.maximum(scatter, 1.0)
        scaled = dataclasses.replace(
            problem,
            sd=problem.sd * scale[:, None, None],
            sd_theta=problem.sd_theta * scale,
        )
        x, _cost = fit_each(scaled.evaluate, x, constants, problem.steps, problem.prior, ROBUST, 10)
    return x
