"""A `FitView` of windows of one impact each: judges effects by how each impact follows from the one before it.

In: a fit of windows. Out: their evidence on candidates.

If a model lacks much, or after a dozen impacts, whole shots show little (sysid/estimation/chains/chain.py). Consecutive
windows of one impact each still do.
"""

from __future__ import annotations

import dataclasses
import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from sysid.estimation.chains.chain_beside import Beside, information_beside
from sysid.estimation.chains.chain_fit import fit_chain, settled_states
from sysid.estimation.fitted import FittedModel, Point
from sysid.estimation.from_nothing import WindowFit, from_other, moved_to, searched
from sysid.estimation.problem import CAUCHY_SD, Array
from sysid.estimation.solver.least_squares import weights
from sysid.selection.fits.view import FitView
from sysid.selection.scoring.score import Linearised, Score
from sysid.selection.scoring.signatures import Candidate, Signature

CANDIDATE_STEPS, FINAL_STEPS = 6, 30  # iterations of the constants: with or without an effect, and of the last model
TRIAL_STEPS = 3  # iterations of the states at each start value of a fit
PROBE_OF_USUAL = 0.1  # finite-difference step of a candidate's parameter, over its usual size
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ByWindows(FitView):
    """A fit of windows; `base` is one of whole shots, of the same clips."""

    at: WindowFit
    base: FittedModel

    @cached_property
    def point(self) -> Point:
        """Its problem and its constants."""
        return as_point(self.at)

    @property
    def fitted(self) -> FittedModel:
        """The constants as a fit of whole shots that are not played; the base itself if nothing was added."""
        return self.base if self.names == self.base.names else of_windows(self.at, self.base)

    @property
    def windows(self) -> int:
        """How many."""
        return len(self.at.fitted.states)

    @property
    def count(self) -> int:
        """Of residuals."""
        return 2 * int(self.at.fitted.chain.windows.data.count.sum())

    @cached_property
    def design_effect(self) -> float:
        """See `FitView`."""
        return self.at.fitted.design_effect

    @property
    def shots(self) -> tuple[Array, Array]:
        """See `FitView`."""
        return self.at.fitted.information, self.at.fitted.gradient

    def linearised(self, candidates: Sequence[Candidate], *, together: bool = False) -> Linearised:
        """See `FitView`."""
        return linearise_windows(self.at, candidates, together=together)

    def with_effect(self, score: Score) -> Self:
        """The fit with an effect more, or with another formula."""
        return dataclasses.replace(self, at=with_effect(self.at, score))

    def fitted_without(self, name: str) -> Self:
        """See `FitView`."""
        return dataclasses.replace(self, at=without_effect(self.at, name, CANDIDATE_STEPS))

    def stripped(self, name: str) -> Self:
        """The same without an effect, its other constants as they are."""
        return dataclasses.replace(self, at=without_effect(self.at, name, 0))

    def at_constants(self, c: Array) -> Self:
        """See `FitView`."""
        fitted = dataclasses.replace(self.at.fitted, constants=c)
        return dataclasses.replace(self, at=dataclasses.replace(self.at, fitted=fitted))

    def beside(self, other: Self) -> Self:
        """The fit at another one's errors of the model, started from its windows where these are likelier."""
        spread = other.at.fitted.chain.spread
        at = self.at if self.at.fitted.chain.spread == spread else searched(self.at, spread)
        at = from_other(at, other.at, CANDIDATE_STEPS)
        return self if at is self.at else dataclasses.replace(self, at=at)

    def renewed(self) -> Self:
        """The fit from windows searched again, at the most likely errors of the model."""
        return dataclasses.replace(self, at=searched(self.at))

    def searched(self, *, every: bool = False) -> Self:
        """The fit itself: its windows were searched when it was renewed."""
        return self

    def continued(self) -> Self:
        """The fit after as many further steps as a fit with a candidate takes."""
        found = self.at.fitted
        more = fit_chain(found.chain, found.states, found.constants, CANDIDATE_STEPS, "with nothing more")
        return dataclasses.replace(self, at=moved_to(self.at, more))

    def settled(self) -> Self:
        """The fit continued to convergence, from windows searched again."""
        last = self.at.fitted
        end = fit_chain(last.chain, last.states, last.constants, FINAL_STEPS, "the last model")
        return dataclasses.replace(self, at=searched(moved_to(self.at, end)))

    def losses_beside(self, more: Self) -> tuple[Array, Array]:
        """Losses of the shots (n,) about two fits at the same errors of the model."""
        return self.at.fitted.losses, more.at.fitted.losses

    def held_gain(self, more: Self) -> float:
        """The gain in held-out shots."""
        return float((self.at.held_losses() - more.at.held_losses()).sum())


def as_point(at: WindowFit) -> Point:
    """The constants of a fit of windows, without states."""
    chain = at.fitted.chain
    return Point(chain.problem, np.zeros((0, 0)), at.fitted.constants, chain.spread.impact)


def linearise_windows(at: WindowFit, candidates: Sequence[Candidate], *, together: bool = False) -> Linearised:
    """Quadratic losses of a fit of windows and candidates, for each shot or all together."""
    found = at.fitted
    chain, c, states = found.chain, found.constants, found.states
    signatures, beside = list[Signature](), list[Beside]()
    for one in candidates:
        off, probe = one.off(), (one.size or PROBE_OF_USUAL) * one.usual()
        probe = np.clip(off + probe, *one.bounds().T) - off
        keys = tuple(f"{one.name}.{key}" for key in one.keys)
        changed = chain.with_model(chain.model.add(one.effect), (*chain.names, *keys))
        beside.append(Beside(changed, off, probe, one.effect.impacts()))
        signatures.append(Signature(one, np.abs(probe), np.zeros((len(off), 0, 0))))
    steps = chain.shared.steps_from(c)
    information, gradient, marginal = information_beside(
        chain, states, c, chain.gap_sd(states), steps, beside, together=together
    )
    r = chain.play(states, np.tile(c, (len(states), 1)), np.arange(len(states)))[0]
    chi2, residuals = float(np.sum(weights(r, CAUCHY_SD) * np.nan_to_num(r) ** 2)), int(np.isfinite(r).sum())
    return Linearised(tuple(signatures), information, gradient, marginal[len(c) :], chi2, residuals)


def with_effect(at: WindowFit, score: Score) -> WindowFit:
    """The fit with an additional effect, or another formula, started at its predicted or its usual size.

    It starts at the constants that go with the predicted size, or at those of the fit.
    """
    one, found = score.candidate, at.fitted
    had = dict(zip(found.chain.names, found.constants.tolist(), strict=True))
    bare = {name: value for name, value in had.items() if not name.startswith(f"{one.name}.")}
    keys = tuple(one.effect.parameters())
    names = (*bare, *(f"{one.name}.{key}" for key in keys))
    chain = found.chain.with_model(found.chain.model.add(one.effect), names)
    low, high = one.bounds().T
    sd, tried = chain.gap_sd(found.states), list[tuple[float, Array]]()
    own = np.array(list(bare.values()))
    likeliest = score.constants_in(chain.model, tuple(bare), own)
    starts = [(score.values, likeliest), (score.values, own)]
    if not np.allclose(usual := one.off() + one.usual(), score.values):
        starts.append((usual, own))
    for size, at_constants in starts:
        values = np.clip(size, low + 1e-3 * (high - low), high - 1e-3 * (high - low))
        tried_at = dict(zip(one.keys, values.tolist(), strict=True))
        c = np.array([*at_constants, *(tried_at.get(key, float(getattr(one.effect, key))) for key in keys)])
        states = settled_states(chain, found.states, c, TRIAL_STEPS)
        tried.append((float(chain.losses(states, c, sd).sum()), c))
    _, c = min(tried, key=lambda trial: trial[0])
    return moved_to(at, fit_chain(chain, found.states, c, CANDIDATE_STEPS, f"with {one.name}"))


def without_effect(at: WindowFit, name: str, steps: int) -> WindowFit:
    """The fit without one of its effects, after a number of steps of the constants."""
    found = at.fitted
    keep = [k for k, n in enumerate(found.chain.names) if not n.startswith(f"{name}.")]
    names = tuple(found.chain.names[k] for k in keep)
    chain = found.chain.with_model(found.chain.model.without(name), names)
    return moved_to(at, fit_chain(chain, found.states, found.constants[keep], steps, f"without {name}"))


def of_windows(at: WindowFit, base: FittedModel) -> FittedModel:
    """A fit of windows as one of whole shots that are not played: with constants, without errors."""
    found = at.fitted
    problem = base.problem.with_model(found.chain.model, found.chain.names)
    return dataclasses.replace(
        base, problem=problem, constants=found.constants, covariance=found.covariance, converged=found.converged,
        rms=math.nan, chi2=math.nan, held_out=None,
    )  # fmt: skip
