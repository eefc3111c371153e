"""States of windows searched from one impact to the next, and initial states of whole shots found through them.

In: a `Chain` and constants. Out: states of its windows, or of its shots.

Each window begins where the one before it ends. If that does not lead to its samples, other starts are drawn, because
a ball's spin shows only at its next impact.
"""

from __future__ import annotations

import dataclasses
import logging
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri
from scipy.stats import qmc

from models.engine.play import lacking
from models.messages import counted
from sysid.estimation.chains.chain import Chain, likely_spread
from sysid.estimation.chains.chain_fit import settled_states
from sysid.estimation.problem import CAUCHY_SD, Array, Index
from sysid.estimation.residual_rows import MOTION_SIZE
from sysid.estimation.shot_problem import GROWING_RATE, ShotProblem
from sysid.estimation.solver.least_squares import Objective, Prior, fit_each, loss
from sysid.estimation.states.initial_states import fit_states, followed, own_scores, within_noise
from sysid.estimation.states.state_search import SEARCH_EFFORTS, from_other_sidespins, searched_states, standing_out
from sysid.estimation.windows import columns, shot_states, windows_of

MAX_SEARCHES = 3  # searches of the states of all windows, at most,
MAX_WHOLE_SEARCHES = 8  # and of whole shots: a state that every other search misses is then missed in one of 256
SEARCH_TOLERANCES = (1.0, 0.5, 0.25)  # of these searches in turn, over the model's usual discrepancy
SAME_LOSS = 1.0  # difference of a shot's loss within which two searches have found the same states
DRAWS_PER_CENTRE = 8  # other starts around each of two centres, in windows that are not followed
SPIN_SD, VELOCITY_SD = 0.5, 0.03  # sd of R omega and of velocity in these, over the speed
SEEN_M, SEEN_SHARE, SEEN_M_S, SEEN_SPIN_M_S = 5e-3, 0.1, 0.05, 0.1  # sd of position and motion from the samples alone
FIRST_STEPS, DRAWN_STEPS, WINDOW_STEPS = 5, 4, 10  # iterations for a window at first, a draw, all windows
FIRST_SHOT_SD_M_S = 10.0  # sd of what is unknown in the first window
HELD_SD = 1e-9  # sd of what is not an unknown
SETTLING_STEPS = 8  # iterations of the states of whole shots
log = logging.getLogger(__name__)


def searched_windows(chain: Chain, c: Array, known: Array | None = None, searches: int = MAX_SEARCHES) -> Array:
    """States of windows (w, p) at constants (q,): for each shot the best of several searches.

    A shot is searched again until its best states have been found twice (multistart: C. G. E. Boender and A. H. G.
    Rinnooy Kan, Mathematical Programming 37, 1987).

    Args:
        chain: the windows.
        c: constants.
        known: (w, p) nearly right states, which count as found once.
        searches: largest number of searches.
    """
    shot = chain.windows.shot
    sd = chain.gap_sd(chain.windows.start)
    best = _searched_once(chain, c, 0) if known is None else known.copy()
    cost = chain.losses(best, c, sd)
    todo = np.arange(len(chain.windows.runs))
    for seed in range(known is None, searches):
        log.info("searching the states of %s", counted(len(todo), "shot"))
        part, here = chain.only(todo), np.isin(shot, todo)
        found = _searched_once(part, c, seed)
        there = part.losses(found, c, part.gap_sd(part.windows.start))
        better, again = there < cost[todo], np.abs(there - cost[todo]) < SAME_LOSS
        best[here] = np.where(better[part.windows.shot][:, None], found, best[here])
        cost[todo] = np.minimum(there, cost[todo])
        todo = todo[~again]
        if not todo.size:
            break
    return best


def _searched_once(chain: Chain, c: Array, seed: int) -> Array:
    """States of windows (w, p), one after the other from the first of each shot.

    A window begins where the one before it ends. If that does not lead to its samples, starts are drawn, half of them
    around that end and half around the observed motion, since the state left by the window before may be wrong. The
    likelier one is kept, by samples and gap.
    """
    w = chain.windows
    states, predicted, observed = w.start.copy(), _Start.nothing(w.start.shape), _Start.nothing(w.start.shape)
    _, after = w.following
    gap = np.full(states.shape, np.inf)
    gap[after] = chain.gap_sd(states)
    depth = np.arange(len(w.shot)) - np.maximum.accumulate(np.where(w.first, np.arange(len(w.shot)), 0))
    ends = np.full(states.shape, np.nan)
    for d in range(int(depth.max()) + 1):
        now = np.flatnonzero(depth == d)
        for window in now.tolist():
            _begin(chain, window, ends, gap, predicted, observed)
        x, _ = fit_each(predicted.objective(chain), predicted.at[now], c, FIRST_STEPS, now)
        if d == 0:
            x = from_other_sidespins(predicted.objective(chain), x, c, now, w.balls)
        odd = _not_followed(chain, x, c, now)
        if odd.size:
            which = now[odd]
            found, cost = x[odd], predicted.costs(chain, x[odd], c, which)
            for number, about in enumerate((predicted, observed)):
                many = np.repeat(which, DRAWS_PER_CENTRE)
                other, _ = fit_each(
                    about.objective(chain), _drawn(chain, about.at, which, 2 * seed + number), c, DRAWN_STEPS, many
                )
                there = predicted.costs(chain, other, c, many).reshape(odd.size, DRAWS_PER_CENTRE)
                best = np.argmin(there, axis=1)
                least = there[np.arange(odd.size), best]
                better = least < cost
                found[better] = other.reshape(odd.size, DRAWS_PER_CENTRE, -1)[np.arange(odd.size), best][better]
                cost = np.minimum(cost, least)
            x[odd] = found
        states[now] = x
        ends[now] = chain.play(x, np.tile(c, (now.size, 1)), now)[1]
    return settled_states(chain, states, c, WINDOW_STEPS)


@dataclass(frozen=True)
class _Start:
    """Prior knowledge of the states in which windows begin, filled from one to the next."""

    at: Array  # (w, p) where a fit of each begins
    mean: Array  # (w, p)
    sd: Array  # (w, p)

    @classmethod
    def nothing(cls, shape: tuple[int, ...]) -> _Start:
        """A start without knowledge of any window."""
        return cls(np.zeros(shape), np.zeros(shape), np.full(shape, HELD_SD))

    def objective(self, chain: Chain) -> Objective:
        """The objective of single windows, with this knowledge as their prior."""
        return Objective(
            chain.evaluate, chain.windows.steps, Prior(self.mean, self.sd), CAUCHY_SD,
            lengths=chain.windows.lengths, free=chain.windows.free,
        )  # fmt: skip

    def costs(self, chain: Chain, x: Array, c: Array, which: Index) -> Array:
        """Losses of windows (k,) at states (k, p): of the samples and of the prior."""
        gap = (x - self.mean[which]) / self.sd[which]
        return loss(chain.evaluate(x, np.tile(c, (len(x), 1)), which), CAUCHY_SD) + loss(gap, CAUCHY_SD)


def _begin(chain: Chain, window: int, ends: Array, gap: Array, predicted: _Start, observed: _Start) -> None:
    """Fill in the prior of a window, from the window before it and from its first samples; in place."""
    w = chain.windows
    free, start = w.free[window], w.start[window]
    observed.at[window] = observed.mean[window] = predicted.at[window] = predicted.mean[window] = start
    if w.first[window]:
        prior = w.prior.sd[window]
        known = np.isfinite(prior)
        predicted.mean[window, known] = observed.mean[window, known] = w.prior.mean[window, known]
        predicted.sd[window] = observed.sd[window] = np.where(free, np.where(known, prior, FIRST_SHOT_SD_M_S), HELD_SD)
        return
    end = ends[window - 1]
    known = free & np.isfinite(end) & np.isfinite(gap[window])
    predicted.mean[window] = np.where(known, end, start)
    predicted.at[window] = predicted.mean[window]
    predicted.sd[window] = np.where(known, gap[window], np.where(free, 1.0, HELD_SD))
    for i in range(w.balls):
        place, motion = columns(i, w.balls)
        if not w.moving[window, i]:
            observed.mean[window, place] = predicted.mean[window, place]
            observed.sd[window, place] = predicted.sd[window, place]
            observed.at[window, place] = predicted.at[window, place]
            continue
        speed = float(np.hypot(*start[motion[:2]]))
        predicted.at[window, place], predicted.at[window, motion[:2]] = start[place], start[motion[:2]]
        observed.sd[window, place], observed.sd[window, motion[:2]] = SEEN_M, SEEN_SHARE * speed + SEEN_M_S
        observed.sd[window, motion[2:]] = speed + SEEN_SPIN_M_S


def _not_followed(chain: Chain, x: Array, c: Array, which: Index) -> Index:
    """Rows of windows that miss their samples by more than chance explains."""
    r = chain.evaluate(x, np.tile(c, (len(x), 1)), which)
    count = np.isfinite(r).sum(axis=1)
    square = np.nansum(np.minimum(r**2, CAUCHY_SD**2), axis=1)
    return np.flatnonzero(~within_noise(0.5 * square, count, chain.problem.correlation_time))


def _drawn(chain: Chain, states: Array, windows: Index, seed: int) -> Array:
    """Starts of windows with other spins and slightly different velocities: (len(windows) * DRAWS_PER_CENTRE, p)."""
    w = chain.windows
    normal = ndtri(qmc.Sobol(MOTION_SIZE * w.balls, seed=seed).random(DRAWS_PER_CENTRE))
    out = np.repeat(states[windows], DRAWS_PER_CENTRE, axis=0)
    share = np.array([VELOCITY_SD, VELOCITY_SD, SPIN_SD, SPIN_SD, SPIN_SD])
    for i in range(w.balls):
        motion = columns(i, w.balls)[1]
        speed = np.hypot(*out[:, motion[:2]].T) * np.repeat(w.moving[windows, i], DRAWS_PER_CENTRE)
        drawn = np.tile(normal[:, MOTION_SIZE * i : MOTION_SIZE * (i + 1)], (len(windows), 1))
        out[:, motion] += share * speed[:, None] * drawn
    return out


def whole_states(chain: Chain, states: Array, c: Array, problem: ShotProblem, thorough: bool = True) -> Array:
    """Initial states of whole shots (n, p) at constants (q,) from states of windows.

    Shots that miss by more than noise are also searched from event to event (states/state_search.py), from other
    draws and at another tolerance each time: a wide one keeps optima that are wrong early on, a narrow one drops
    those that the model cannot follow closely. A shot is done when its most likely state has been found as often as
    it has impacts, each of which adds optima, and at least twice. If `thorough`, those that stand out are then
    searched with more effort, if that is no more work than one search of all. Each shot keeps its most likely
    state.
    """
    seen = problem.with_discrepancy(chain.spread.path)
    x = fit_states(seen, _first_states(chain, states, problem), c, SETTLING_STEPS)
    hit = np.flatnonzero([len(times) > 0 for times in problem.events])
    x[hit] = from_other_sidespins(seen.objective(), x[hit], c, hit, max(len(clip.balls) for clip in problem.clips))
    score, own = own_scores(problem, x, c)
    times, enough = np.ones(len(x)), np.maximum([len(e) for e in problem.events], 2)
    for effort in SEARCH_EFFORTS if thorough else SEARCH_EFFORTS[:1]:
        todo = np.flatnonzero(~followed(problem, x, c))
        if effort > 1:
            todo = np.intersect1d(todo, standing_out(problem.with_discrepancy(float(np.median(own))), x, c))
        if todo.size * effort > max(len(x), SEARCH_EFFORTS[-1]):
            break
        for seed in range(MAX_WHOLE_SEARCHES):
            if not todo.size:
                break
            usual = min(float(np.median(own)), GROWING_RATE)
            part = problem.with_discrepancy(usual * SEARCH_TOLERANCES[seed % len(SEARCH_TOLERANCES)]).only(todo)
            found, there, rates = _at_own_discrepancy(part, searched_states(part, c, effort, seed), c)
            better, again = there < score[todo], np.abs(there - score[todo]) < SAME_LOSS
            x[todo] = np.where(better[:, None], found, x[todo])
            own[todo], score[todo] = np.where(better, rates, own[todo]), np.minimum(there, score[todo])
            times[todo] = np.where(again, times[todo] + 1, np.where(better, 1, times[todo]))
            log.info("likelier initial states for %d of %d shots", np.count_nonzero(better & ~again), todo.size)
            todo = todo[times[todo] < enough[todo]]
    return x


def found_states(problem: ShotProblem, c: Array) -> Array:
    """Initial states of shots (n, p) at constants (q,), without start values.

    The search uses the event engine; a model that it cannot play is searched from event to event.
    """
    if lacking(problem.model):
        x = searched_states(problem.with_discrepancy(GROWING_RATE), c)
        return fit_states(problem, x, c, SETTLING_STEPS)
    problem = problem.with_model(dataclasses.replace(problem.model, engine="events"), problem.names)
    chain = Chain(problem, windows_of(problem))
    states = searched_windows(chain, c)
    return whole_states(chain.with_spread(likely_spread(chain, states, c)), states, c, problem)


def _first_states(chain: Chain, states: Array, problem: ShotProblem) -> Array:
    return problem.objective().inside(shot_states(problem, chain.windows, states))


def _at_own_discrepancy(weighted: ShotProblem, x: Array, c: Array) -> tuple[Array, Array, Array]:
    """Initial states (n, p), each refined at its shot's own discrepancy; negative log likelihoods and rates, (n,)."""
    x = fit_states(weighted, x, c, SETTLING_STEPS)
    own = weighted.with_own_rates(own_scores(weighted, x, c)[1])
    x = fit_states(own.with_discrepancy(0.0), x, c, SETTLING_STEPS)
    return x, *own_scores(weighted, x, c)
