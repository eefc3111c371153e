"""A `FitView` of whole shots, which show best what acts between impacts.

In: clips (`Split`) and a fit of whole shots (`FittedModel`). Out: their evidence on candidates.

A shot may be in a false optimum with one model and not with another. So a fit starts at the likeliest of a few sizes of
a candidate, and two fits are compared only after each has tried the states of the other.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from models.effect import Effect
from sysid.estimation.chains.chain_fit import design_effect
from sysid.estimation.fitted import FittedModel, HeldOut, Point
from sysid.estimation.fitting import few_steps, fit_held_out
from sysid.estimation.from_nothing import likelier_starts, with_every_start_found, with_found_starts
from sysid.estimation.problem import Array
from sysid.estimation.split import Split, fit_on
from sysid.estimation.states.initial_states import fit_states, followed, shot_losses
from sysid.estimation.states.state_search import BETTER_LOSS
from sysid.selection.fits.view import FitView
from sysid.selection.scoring.evidence import MAX_RESIDUAL_SD, compared_losses, counted_as_one, remove_effect
from sysid.selection.scoring.score import Linearised, Score, linearise
from sysid.selection.scoring.signatures import Candidate, with_candidate

WARM_START_STEPS = 5  # iterations of the initial states from the optimum of another fit
MIN_WARM_START_IMPROVEMENT, MIN_WARM_START_SHARE = 2.0, 1e-3  # of the loss, to use another optimum
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ByWholeShots(FitView):
    """A fit of whole shots."""

    parts: Split
    now: FittedModel

    @property
    def point(self) -> Point:
        """The problem and constants of the fit."""
        return self.now

    @property
    def fitted(self) -> FittedModel:
        """The fit."""
        return self.now

    @property
    def windows(self) -> int:
        """None."""
        return 0

    @cached_property
    def _alone(self) -> Linearised:
        return linearise(self.now, [])

    @property
    def count(self) -> int:
        """Of residuals."""
        return self._alone.count

    @cached_property
    def design_effect(self) -> float:
        """Design effect of the shots, or of their correlated samples."""
        seen = self._alone
        return max(design_effect(seen.information, seen.gradient), counted_as_one(self.now))

    @property
    def shots(self) -> tuple[Array, Array]:
        """See `FitView`."""
        return self._alone.information, self._alone.gradient

    @property
    def follows_most(self) -> bool:
        """Whether the errors of most shots are those of the measurement."""
        return self.now.discrepancy_rate == 0.0

    @cached_property
    def unfollowed(self) -> int:
        """See `FitView`."""
        return int(np.count_nonzero(~followed(self.now.problem, self.now.initial_states, self.now.constants)))

    def linearised(self, candidates: Sequence[Candidate], *, together: bool = False) -> Linearised:
        """See `FitView`."""
        return linearise(self.now, candidates, quick=True, together=together)

    def with_effect(self, score: Score) -> Self:
        """The fit with an additional effect, or with another formula."""
        now, name = self.now, score.candidate.name
        if any(one.name() == name for one in now.model.effects):
            now = remove_effect(now, name)
        return dataclasses.replace(self, now=fit_candidate(self.parts, now, score))

    def fitted_without(self, name: str) -> Self:
        """See `FitView`."""
        return dataclasses.replace(self, now=fit_without(self.parts, self.now, name))

    def stripped(self, name: str) -> Self:
        """The fit without an effect, other constants unchanged."""
        return dataclasses.replace(self, now=remove_effect(self.now, name))

    def at_constants(self, c: Array) -> Self:
        """See `FitView`."""
        return dataclasses.replace(self, now=dataclasses.replace(self.now, constants=c))

    def beside(self, other: Self) -> Self:
        """The fit, started from the initial states of another one in the shots where they are likelier."""
        now = warm_started(self.parts, self.now, other.now, "from another optimum")
        return self if now is None else dataclasses.replace(self, now=now)

    def renewed(self) -> Self:
        """The fit itself: each fit of whole shots has the most likely errors."""
        return self

    def searched(self, *, every: bool = False) -> Self:
        """The fit with new initial states for poorly followed shots, including held-out ones, if likelier.

        With `every`, those of the others are searched, too, once all are followed.
        """
        now, before = with_found_starts(self.now), self.now.held_out
        if every and dataclasses.replace(self, now=now).leaves_noise:
            now = with_every_start_found(now)
        if self.parts.held_out is not None and before is not None:
            problem = self.parts.held_out.with_model(now.problem.model, now.names)
            x, c = before.initial_states, now.constants
            odd = np.flatnonzero(~followed(problem, x, c, now.discrepancy_rate))
            states = likelier_starts(problem, x, c, odd)
            held = fit_held_out(now, problem, states, searching=False)
            if now is not self.now or _loss(held) < _loss(before) - BETTER_LOSS:
                now = dataclasses.replace(now, held_out=held)
        return self if now is self.now else dataclasses.replace(self, now=now)

    def continued(self) -> Self:
        """The fit itself: each fit of whole shots continues until it converges."""
        return self

    def settled(self) -> Self:
        """The same: it has converged."""
        return self

    def losses_beside(self, more: Self) -> tuple[Array, Array]:
        """Losses of the shots (n,) about two fits, each at its most likely errors of the model."""
        return compared_losses(self.now, more.now)

    def held_gain(self, more: Self) -> float:
        """The gain in held-out shots, with constants moved within their uncertainty."""
        one, two = self.now.held_out, more.now.held_out
        if one is None or two is None:
            return 0.0
        old, new = (float(np.nansum(np.minimum(at.open_residuals**2, MAX_RESIDUAL_SD**2))) for at in (one, two))
        return 0.5 * (old - new)


def _loss(held: HeldOut) -> float:
    """Half the sum of squares of held-out clips."""
    return 0.5 * float(np.nansum(held.residuals**2))


def fit_candidate(parts: Split, base: FittedModel, score: Score) -> FittedModel:
    """Fit all constants, including a candidate's, and all initial states, from the optimum without it."""
    one = score.candidate
    x, c, effect = _best_start(base, score)
    values = np.array([float(getattr(effect, key)) for key in effect.parameters()])
    problem = with_candidate(base.problem, one, [f"{one.name}.{key}" for key in effect.parameters()])
    start = Point(problem, x, np.concatenate([c, values]), base.discrepancy_rate)
    return fit_on(parts, start, base, f"with {one.name}", searching=False)


def _best_start(base: FittedModel, score: Score) -> tuple[Array, Array, Effect]:
    """Start values: initial states (n, p), constants (q,), the effect at its predicted or its usual size, held.

    A fit that lacks a large effect has biased constants, and a fit that frees the effect at once may keep them. So the
    likeliest of three starts is used: the predicted size with the predicted constants, with the fit's own, and the
    usual size with these.
    """
    one, off = score.candidate, score.candidate.off()
    bounds = one.bounds()
    problem, found = base.weighted, list[tuple[float, Array, Array, Effect]]()
    inner = bounds + np.outer(bounds[:, 1] - bounds[:, 0], [1e-4, -1e-4])
    size, usual = (np.clip(values, *inner.T) for values in (score.values, off + one.usual()))
    starts = [(size, score.constants_in(base.model, base.names, base.constants)), (size, base.constants)]
    if not np.array_equal(size, usual):
        starts.append((usual, base.constants))
    for values, constants in starts:
        effect = one.at(values)
        held = problem.with_model(base.model.add(effect), base.names)
        x, c, cost = few_steps(held, base.initial_states, constants)
        found.append((cost, x, c, effect))
    return min(found, key=lambda one: one[0])[1:]


def fit_without(parts: Split, found: FittedModel, name: str) -> FittedModel:
    """Fit again without an effect."""
    plain = fit_on(parts, remove_effect(found, name), found, f"without {name}", searching=False)
    return warm_started(parts, plain, found, f"without {name}") or plain


def with_better_states(one: FittedModel, other: FittedModel) -> tuple[FittedModel, float]:
    """`one` with the initial states of `other` in the shots where they lower the loss, and the fall of the loss."""
    seen = one.weighted
    x = fit_states(seen, other.initial_states, one.constants, WARM_START_STEPS)
    old, new = (shot_losses(seen, at, one.constants)[0] for at in (one.initial_states, x))
    better = new < old
    mixed = np.where(better[:, None], x, one.initial_states)
    return dataclasses.replace(one, initial_states=mixed), float(np.sum((old - new)[better]))


def warm_started(parts: Split, one: FittedModel, other: FittedModel, what: str) -> FittedModel | None:
    """Fit `one` again, from the initial states of `other` in the shots where they lower the loss.

    None if that does not lower its loss noticeably.
    """
    mixed, gain = with_better_states(one, other)
    loss = float(shot_losses(one.weighted, one.initial_states, one.constants)[0].sum())
    if gain < max(MIN_WARM_START_IMPROVEMENT, MIN_WARM_START_SHARE * loss):
        return None
    log.info("%s again, from another optimum", what)
    return fit_on(parts, mixed, one, what, searching=False)
