"""A model fitted to clips without start values: first to windows, then from there to whole shots.

In: a `Split` and a model. Out: a `WindowFit` of consecutive windows (sysid/estimation/chains/chain.py), and the
`FittedModel` of whole shots that it leads to.

Windows have few false optima. If the model follows whole shots at the windows' constants, it is fitted once more to
whole shots, which are then the most informative. If it does not, late samples of whole shots are chaotic, and the
constants are those of the windows.
"""

from __future__ import annotations

import dataclasses
import logging
from dataclasses import dataclass

import numpy as np

from models.model_file import Model
from sysid.clips import ClipSet
from sysid.estimation.chains.chain import Chain, Spread, likely_spread
from sysid.estimation.chains.chain_fit import ChainFit, fit_chain, settled_states
from sysid.estimation.chains.chain_search import SAME_LOSS, found_states, searched_windows, whole_states
from sysid.estimation.fitted import FittedModel, Point
from sysid.estimation.fitting import fit, fit_held_out
from sysid.estimation.problem import Array, Index, values_of
from sysid.estimation.profile import profiled
from sysid.estimation.shot_problem import ShotProblem
from sysid.estimation.split import Split, exclusion_lines, lost_shots, shot_errors, split, typical_error
from sysid.estimation.states.initial_states import followed, own_scores, shot_scores, with_scatter
from sysid.estimation.states.state_search import BETTER_LOSS
from sysid.estimation.windows import windows_of

BASE_STEPS, BASE_ROUNDS = 8, 3  # iterations of the constants, and rounds of searching windows again
LAST_STEPS = 8
SEED_OF_HALVES = 0
REPEATED_SEARCHES = 1  # further searches from nearly right states
HELD_OUT_STEPS = 4  # iterations of the states of held-out windows at other constants
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class WindowFit:
    """A model fitted to windows, with the states of held-out windows at its constants."""

    fitted: ChainFit
    held_out: Chain | None
    held_states: Array  # (v, p)

    @property
    def model(self) -> Model:
        """The model at these constants."""
        at = self.fitted
        return at.chain.model.with_values(dict(zip(at.chain.names, at.constants.tolist(), strict=True)))

    def held_losses(self) -> Array:
        """Loss of every held-out shot: (m,)."""
        if self.held_out is None:
            return np.zeros(0)
        return self.held_out.losses(self.held_states, self.fitted.constants, self.held_out.gap_sd(self.held_states))


def fit_windows(parts: Split, model: Model) -> WindowFit:
    """Fit a model to windows without start values, using the event engine."""
    names, model = tuple(model.parameters()), dataclasses.replace(model, engine="events")
    problem = parts.training.with_model(model, names)
    chain, c = Chain(problem, windows_of(problem)), values_of(model, names)
    log.info("%d windows of one impact each", len(chain.windows.shot))
    states = searched_windows(chain, c)
    for _ in range(BASE_ROUNDS):
        found = fit_chain(chain, states, c, BASE_STEPS, "windows")
        c = found.constants
        states = searched_windows(chain, c, found.states, REPEATED_SEARCHES)
        chain = chain.with_spread(likely_spread(chain, states, c))
    found = fit_chain(chain, states, c, LAST_STEPS, "windows")
    held, held_states = None, np.zeros((0, states.shape[1]))
    if parts.held_out is not None:
        other = parts.held_out.with_model(model, names)
        held = Chain(other, windows_of(other), chain.spread)
        held_states = searched_windows(held, c)
    return WindowFit(found, held, held_states)


def roughness_of(parts: Split, model: Model) -> float:
    """Roughness of the loss, see `Chain`, from independent fits of two halves of the shots; at least 1.

    A loss of many windows has many optima, each sharper than the loss over all of them. Standard deviations must
    explain the difference between the constants of the halves. A single shot has no halves, and a few may not determine
    the constants; the roughness is then unknown.
    """
    training = parts.training
    if len(training.clips) < 2:
        return 1.0
    order = np.random.default_rng(SEED_OF_HALVES).permutation(len(training.clips))
    halves = [
        fit_windows(dataclasses.replace(parts, training=training.only(np.sort(half)), held_out=None), model).fitted
        for half in np.array_split(order, 2)
    ]
    one, two = ((half.constants, np.diag(half.covariance)) for half in halves)
    squares = (one[0] - two[0]) ** 2 / (one[1] + two[1])
    squares = squares[np.isfinite(squares)]
    if not squares.size:
        return 1.0
    log.info("constants of halves differ by %.1f standard deviations", np.sqrt(squares.mean()))
    return max(float(squares.mean()), 1.0)


def moved_to(before: WindowFit, found: ChainFit) -> WindowFit:
    """The fit of another chain, with the held-out windows fitted at its constants."""
    held, states = before.held_out, before.held_states
    if held is not None:
        held = held.with_model(found.chain.model, found.chain.names)
        states = settled_states(held, states, found.constants, HELD_OUT_STEPS)
    return WindowFit(found, held, states)


def searched(at: WindowFit, spread: Spread | None = None) -> WindowFit:
    """The fit with windows searched again at its constants, at these errors of the model or the most likely ones."""
    found = at.fitted
    states = searched_windows(found.chain, found.constants, found.states, REPEATED_SEARCHES)
    chain = found.chain.with_spread(spread or likely_spread(found.chain, states, found.constants))
    now = fit_chain(chain, states, found.constants, LAST_STEPS, "windows")
    held, held_states = at.held_out, at.held_states
    if held is not None:
        held = held.with_spread(chain.spread)
        held_states = searched_windows(held, now.constants, held_states, REPEATED_SEARCHES)
    return WindowFit(now, held, held_states)


def from_other(at: WindowFit, other: WindowFit, steps: int) -> WindowFit:
    """The fit, started from the windows of another one in each shot where these are likelier than its own.

    One of two fits may follow a window by luck; after this both do.
    """
    found, c = at.fitted, at.fitted.constants
    states = _likelier(found.chain, found.states, other.fitted.states, c)
    held_states = at.held_states
    if at.held_out is not None:
        held_states = _likelier(at.held_out, held_states, other.held_states, c)
    if states is not found.states:
        return moved_to(
            WindowFit(found, at.held_out, held_states), fit_chain(found.chain, states, c, steps, "from another optimum")
        )
    return at if held_states is at.held_states else WindowFit(found, at.held_out, held_states)


def _likelier(chain: Chain, states: Array, others: Array, c: Array) -> Array:
    """States of windows (w, p), replaced by others, fitted, in the shots where these are likelier."""
    sd, settled = chain.gap_sd(states), settled_states(chain, others, c, HELD_OUT_STEPS)
    better = chain.losses(settled, c, sd) < chain.losses(states, c, sd) - SAME_LOSS
    return np.where(better[chain.windows.shot][:, None], settled, states) if better.any() else states


def as_fitted(at: WindowFit, problem: ShotProblem, x: Array) -> FittedModel:
    """The fit as a `FittedModel` of whole shots with initial states x (n, p)."""
    found = at.fitted
    rates = shot_scores(problem, x, found.constants)[1]
    point = Point(problem.with_own_rates(np.zeros(len(x))), x, found.constants, float(np.median(rates)))
    r = point.residuals()
    count = max(int(np.isfinite(r).sum()), 1)
    rms = problem.noise * float(np.sqrt(np.nanmean(r**2)))
    return FittedModel(
        point.problem, x, found.constants, point.discrepancy_rate, found.covariance, found.converged, rms,
        float(np.nansum(r**2)) / count,
    )  # fmt: skip


def whole_shots(parts: Split, at: WindowFit, in_any_case: bool = False, searching: bool = True) -> FittedModel:
    """Fit whole shots from the constants of windows; returns the fit with its error on the held-out clips.

    Constants and initial states are fitted if shots are short, if the model follows them, or `in_any_case`: after many
    impacts a shot that is not followed is chaos, and moves the constants at random. With `searching`, the initial
    states of shots that miss by more than most are searched again, and with more effort.
    """
    found = at.fitted
    x = whole_states(found.chain, found.states, found.constants, found.chain.problem, searching)
    model = dataclasses.replace(found.chain.model, engine=parts.training.model.engine)
    now = as_fitted(at, with_scatter(parts.training.with_model(model, found.chain.names), x), x)
    if in_any_case or not now.problem.is_long or parts.follows(now):
        now = fit(now, "whole shots", searching)
        if searching and now.discrepancy_rate == 0.0:  # most are followed to the noise, so others began elsewhere
            now = with_found_starts(now)
        if now.discrepancy_rate == 0.0 and now.problem.is_long:
            now = profiled(now)
    if at.held_out is None or parts.held_out is None:
        return now
    x = whole_states(at.held_out, at.held_states, now.constants, at.held_out.problem, searching)
    return dataclasses.replace(now, held_out=fit_held_out(now, parts.held_out, x, searching))


def with_found_starts(found: FittedModel) -> FittedModel:
    """The fit with the initial states of poorly followed shots taken from windows, if that is likelier.

    Such a shot may be in a false optimum, and keep the constants there with it, so it is searched at the constants of
    the others. Where most shots are poorly followed, the model lacks something, and no shot is searched.
    """
    while True:
        problem, x, usual = found.problem, found.initial_states.copy(), found.discrepancy_rate
        bare, c = problem.with_own_rates(np.zeros(len(x))), found.constants
        good = followed(problem, x, c, usual)
        odd, rest = np.flatnonzero(~good), np.flatnonzero(good)
        if not 0 < odd.size < rest.size:
            return found
        others = fit(Point(bare.only(rest), x[rest], c, usual), f"{rest.size} shots that are followed", searching=False)
        x[rest], x[odd] = others.initial_states, found_states(bare.only(odd), others.constants)
        now = fit(Point(bare, x, others.constants, usual), "all shots", searching=False)
        if not _score(now) < _score(found) - BETTER_LOSS:
            return found
        log.info("%d shots beyond the noise searched at the constants of the others", odd.size)
        found = now


def with_every_start_found(found: FittedModel) -> FittedModel:
    """The fit with the initial states of any shot taken from windows, if that is likelier.

    A shot that misses by no more than chance explains may be in a false optimum all the same. What is missing there, a
    few standard deviations of its chi-square, looks like a small further cause.
    """
    problem, x, c, usual = found.problem, found.initial_states, found.constants, found.discrepancy_rate
    new = likelier_starts(problem, x, c, np.arange(len(x)))
    if np.array_equal(new, x):
        return found
    bare = problem.with_own_rates(np.zeros(len(x)))
    now = fit(Point(bare, new, c, usual), "all shots", searching=False)
    log.info("%d shots with likelier initial states", np.count_nonzero(np.any(new != x, axis=1)))
    return now if _score(now) < _score(found) - BETTER_LOSS else found


def likelier_starts(problem: ShotProblem, x: Array, c: Array, which: Index) -> Array:
    """Initial states (n, p) at constants (q,), found anew for some shots where that is likelier."""
    x = x.copy()
    if which.size:
        part = problem.with_own_rates(np.zeros(len(x))).only(which)
        new = found_states(part, c)
        better = own_scores(part, new, c)[0] < own_scores(part, x[which], c)[0] - BETTER_LOSS
        x[which] = np.where(better[:, None], new, x[which])
    return x


def _score(found: FittedModel) -> float:
    """Negative log likelihood of all shots."""
    return float(shot_scores(found.problem, found.initial_states, found.constants)[0].sum())


def begin(clip_set: ClipSet, model: Model) -> tuple[Split, FittedModel]:
    """Split the clips, and fit every constant of the model's stack to whole shots."""
    parts, _, model = split(clip_set, model)
    parts, _, found = fit_from_nothing(parts, model, in_any_case=True)
    return parts, found


def fit_from_nothing(
    parts: Split, model: Model, in_any_case: bool = False, searching: bool = True
) -> tuple[Split, WindowFit, FittedModel]:
    """Fit windows, then whole shots (see `whole_shots`); returns both, and the split without lost shots.

    Raises:
        BadInput: where most shots are lost.
    """
    at = fit_windows(parts, model)
    found = whole_shots(parts, at, in_any_case, searching)
    errors = shot_errors(found.problem, found.initial_states, found.constants)
    typical = typical_error(errors)
    lost, held_lost, held = lost_shots(errors, typical), np.zeros(0, np.int64), parts.held_out
    lines = exclusion_lines(parts.training, lost, errors)
    if held is not None and found.held_out is not None:
        seen = held.with_model(found.problem.model, found.names)
        errors = shot_errors(seen, found.held_out.initial_states, found.constants)
        held_lost = lost_shots(errors, typical)
        lines += exclusion_lines(held, held_lost, errors)
    if lines:
        kept = np.setdiff1d(np.arange(len(parts.training.clips)), lost)
        if held is not None:
            others = np.setdiff1d(np.arange(len(held.clips)), held_lost)
            held = held.only(others) if others.size else None
        parts = parts.excluding(lines, parts.training.only(kept), held)
        at = fit_windows(parts, model)
        found = whole_shots(parts, at, in_any_case, searching)
    if in_any_case or not parts.training.is_long:
        return parts, at, found
    rough = dataclasses.replace(at.fitted.chain, roughness=roughness_of(parts, model))
    at = dataclasses.replace(at, fitted=dataclasses.replace(at.fitted, chain=rough))
    if parts.follows(found):
        return parts, at, found
    return parts, at, dataclasses.replace(found, covariance=at.fitted.covariance, converged=at.fitted.converged)
