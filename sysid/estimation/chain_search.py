"""States of windows searched from one impact to the next, and initial states of whole shots found through them.

In: a `Chain` and constants. Out: states of its windows, or of its shots.

Each window begins where the one before it ends, with place and velocity as seen. Where that does not lead to its
samples, other spins are drawn: what a ball's spin is shows at its next impact only. For a whole shot the windows are
then drawn together: the gaps between them are allowed less and less, down to nearly nothing (continuation).
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri
from scipy.stats import qmc

from sysid.estimation.chain import Chain, Spread, likely_spread
from sysid.estimation.chain_fit import settled_states
from sysid.estimation.initial_states import fit_states, shot_scores, within_noise
from sysid.estimation.problem import CAUCHY_SD, Array, Index
from sysid.estimation.shot_problem import GROWING_RATE, ShotProblem
from sysid.estimation.solver.least_squares import Objective, Prior, fit_each
from sysid.estimation.state_search import EFFORTS, searched_states, standing_out
from sysid.estimation.windows import columns, shot_states, windows_of

DRAWS = 16  # of other spins, in windows that are not followed
SPIN_SD = 0.5  # of R omega in these, over the speed
FIRST_STEPS, DRAWN_STEPS, WINDOW_STEPS = 5, 4, 4  # of states: of a window at first, of a draw, of all windows together
FIRST_SHOT_SD_M_S = 10.0  # of what nothing is known in the first window
HELD_SD = 1e-9  # of what is no unknown
SAME_SHARE, SAME_M_S = 0.3, 0.05  # of velocity, within which the end of a window and what was seen are of one motion
TIGHTENED = (0.5, 0.1, 0.02)  # shares of the gaps that are allowed
TIGHTENING_STEPS, SETTLING_STEPS = 6, 8  # of states: of windows at each share, of whole shots


def searched_windows(chain: Chain, states: Array, c: Array) -> Array:
    """States of windows (w, p) at constants (q,), one after the other from the first of each shot."""
    w, states = chain.windows, states.copy()
    mean, sd = np.zeros(states.shape), np.full(states.shape, HELD_SD)
    _, after = w.following
    gap = np.full(states.shape, np.inf)
    gap[after] = chain.gap_sd(states)
    depth = np.arange(len(w.shot)) - np.maximum.accumulate(np.where(w.first, np.arange(len(w.shot)), 0))
    ends = np.full(states.shape, np.nan)
    objective = Objective(chain.evaluate, w.steps, Prior(mean, sd), CAUCHY_SD)  # whose prior is filled on the way
    for d in range(int(depth.max()) + 1):
        now = np.flatnonzero(depth == d)
        for window in now.tolist():
            _begin(chain, window, ends, gap, states, mean, sd)
        x, cost = fit_each(objective, states[now], c, FIRST_STEPS, now)
        odd = _not_followed(chain, x, c, now)
        if odd.size:
            which = np.repeat(now[odd], DRAWS)
            other, there = fit_each(objective, _drawn(chain, states, now[odd]), c, DRAWN_STEPS, which)
            there = there.reshape(odd.size, DRAWS)
            best = np.argmin(there, axis=1)
            better = there[np.arange(odd.size), best] < cost[odd]
            x[odd[better]] = other.reshape(odd.size, DRAWS, -1)[np.arange(odd.size), best][better]
        states[now] = x
        ends[now] = chain.play(x, np.tile(c, (now.size, 1)), now)[1]
    return settled_states(chain, states, c, WINDOW_STEPS)


def _begin(chain: Chain, window: int, ends: Array, gap: Array, states: Array, mean: Array, sd: Array) -> None:
    """Where a window begins, and what is known of it from the one before; filled in place."""
    w = chain.windows
    free, prior = w.free[window], w.prior.sd[window]
    if w.first[window]:
        known = np.isfinite(prior)
        mean[window] = np.where(known, w.prior.mean[window], states[window])
        sd[window] = np.where(free, np.where(known, prior, FIRST_SHOT_SD_M_S), HELD_SD)
        return
    end = ends[window - 1]
    known = free & np.isfinite(end) & np.isfinite(gap[window])
    for i in range(w.balls):
        place, motion = columns(i, w.balls)
        seen = w.start[window, motion[:2]]
        if known[motion].all() and np.hypot(*(end[motion[:2]] - seen)) > SAME_SHARE * np.hypot(*seen) + SAME_M_S:
            known[place], known[motion] = False, False  # the window before it was not followed
    states[window] = np.where(known, end, w.start[window])
    mean[window] = states[window]
    sd[window] = np.where(known, gap[window], np.where(free, 1.0, HELD_SD))
    for i in range(w.balls):
        place, motion = columns(i, w.balls)
        if w.moving[window, i]:
            states[window, place], states[window, motion[:2]] = w.start[window, place], w.start[window, motion[:2]]


def _not_followed(chain: Chain, x: Array, c: Array, which: Index) -> Index:
    """Rows of windows whose samples are missed by more than chance."""
    r = chain.evaluate(x, np.tile(c, (len(x), 1)), which)
    count = np.isfinite(r).sum(axis=1)
    square = np.nansum(np.minimum(r**2, CAUCHY_SD**2), axis=1)
    return np.flatnonzero(~within_noise(0.5 * square, count, chain.problem.correlation_time))


def _drawn(chain: Chain, states: Array, windows: Index) -> Array:
    """Starts of windows with other spins: (len(windows) * DRAWS, p)."""
    w = chain.windows
    normal = ndtri(qmc.Sobol(3 * w.balls, seed=0).random(DRAWS))
    out = np.repeat(states[windows], DRAWS, axis=0)
    for i in range(w.balls):
        motion = columns(i, w.balls)[1]
        speed = np.hypot(*out[:, motion[:2]].T) * np.repeat(w.moving[windows, i], DRAWS)
        out[:, motion[2:]] += SPIN_SD * speed[:, None] * np.tile(normal[:, 3 * i : 3 * i + 3], (len(windows), 1))
    return out


def better_windows(chain: Chain, states: Array, c: Array) -> Array:
    """States of windows, those of the shots replaced that a new search finds with less loss."""
    sd = chain.gap_sd(states)
    found = searched_windows(chain, states, c)
    better = chain.losses(found, c, sd) < chain.losses(states, c, sd)
    return np.where(better[chain.windows.shot][:, None], found, states)


def whole_states(chain: Chain, states: Array, c: Array, problem: ShotProblem) -> Array:
    """Initial states of whole shots (n, p) at constants (q,) from states of windows, the gaps of these closed.

    Of what each tightening leads to every shot has the most likely. Those that miss by more than noise are searched
    from event to event as well (sysid/estimation/state_search.py); those that stand out then with more tolerance and
    effort.
    """
    x = fit_states(
        problem.with_discrepancy(chain.spread.path), _first_states(chain, states, problem), c, SETTLING_STEPS
    )
    score, own = shot_scores(problem, x, c)
    for share in TIGHTENED:
        loose = chain.with_spread(Spread(chain.spread.impact, chain.spread.path + (1 - share) * float(np.median(own))))
        states = settled_states(loose, states, c, TIGHTENING_STEPS, share * chain.gap_sd(states))
        x, score, own = _better(problem, x, score, own, _first_states(chain, states, problem), c)
    for effort in (0, *EFFORTS):
        typical = float(np.median(own))
        seen = problem.with_discrepancy(typical)
        rows = standing_out(seen, x, c) if effort else np.flatnonzero(own > 0)
        if not rows.size or rows.size * effort > max(len(x), EFFORTS[-1]):
            continue
        tolerant = problem.only(rows).with_discrepancy(max(typical, GROWING_RATE if effort else 0.0))
        other = x.copy()
        other[rows] = searched_states(tolerant, c, max(effort, 1))
        x, score, own = _better(problem, x, score, own, other, c)
    return x


def long_states(problem: ShotProblem, c: Array) -> Array:
    """Initial states of long shots (n, p) at constants (q,), from nothing."""
    chain = Chain(problem, windows_of(problem))
    states = searched_windows(chain, chain.windows.start, c)
    return whole_states(chain.with_spread(likely_spread(chain, states, c)), states, c, problem)


def _first_states(chain: Chain, states: Array, problem: ShotProblem) -> Array:
    return problem.objective().inside(shot_states(problem, chain.windows, states))


def _better(
    problem: ShotProblem, x: Array, score: Array, own: Array, other: Array, c: Array
) -> tuple[Array, Array, Array]:
    """Of two initial states of each shot the more likely, polished at its own discrepancy; likelihoods and rates."""
    seen = problem.with_discrepancy(float(np.median(own)))
    other = fit_states(seen, other, c, SETTLING_STEPS)
    there, rates = shot_scores(problem, other, c)
    other = fit_states(problem.with_own_rates(rates).with_discrepancy(0.0), other, c, SETTLING_STEPS)
    there, rates = shot_scores(problem, other, c)
    better = there < score
    return np.where(better[:, None], other, x), np.where(better, there, score), np.where(better, rates, own)
