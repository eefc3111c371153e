"""The interface of a fit for the search of causes, on windows (by_windows.py) or on whole shots.

In: a fit. Out: its `FitView`: scores of candidates, fits with one cause more or less, and gains of log likelihood of
one fit over another, in fitted and in held-out shots.

Shots are less informative than as many independent residuals if they scatter about a fit by more than their information
implies: by the design effect. So a single shot that departs from all others cannot support a cause alone.
"""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from models.model_file import Model
from sysid.estimation.fitted import FittedModel, Point
from sysid.estimation.problem import Array, Index
from sysid.selection.scoring.score import Linearised, Score, Scores, scores_of
from sysid.selection.scoring.signatures import Candidate


class ShotLosses(NamedTuple):
    """Quadratic losses of n shots about a fit, in its q constants, with initial states eliminated."""

    losses: Array  # (n,) at the fit
    information: Array  # (n, q, q)
    gradient: Array  # (n, q)

    def without_each(self) -> Array:
        """The loss of all other shots at the constants that they have alone, for each shot that is left out: (n,)."""
        information, slope = self.information.sum(axis=0), self.gradient.sum(axis=0)
        scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
        found = np.empty(len(self.losses))
        for k in range(len(found)):
            own, pull = information - self.information[k], (slope - self.gradient[k]) / scale
            step = np.linalg.lstsq(own / np.outer(scale, scale), pull, rcond=1e-10)[0]
            found[k] = self.losses.sum() - self.losses[k] - 0.5 * float(pull @ step)
        return found


class FitView(ABC):
    """A fit, with the operations that the search needs."""

    @property
    @abstractmethod
    def point(self) -> Point:
        """The problem and constants of the fit."""

    @property
    @abstractmethod
    def fitted(self) -> FittedModel:
        """The result as a fit of whole shots."""

    @property
    @abstractmethod
    def windows(self) -> int:
        """Number of windows of one impact each; 0 for whole shots."""

    @property
    @abstractmethod
    def count(self) -> int:
        """Of residuals."""

    @property
    @abstractmethod
    def design_effect(self) -> float:
        """Factor by which shots are less informative than as many independent residuals; at least 1."""

    @property
    @abstractmethod
    def shots(self) -> tuple[Array, Array]:
        """Information (n, q, q) and gradient (n, q) of each shot about the constants, with states eliminated."""

    @abstractmethod
    def linearised(self, candidates: Sequence[Candidate], *, together: bool = False) -> Linearised:
        """Quadratic losses of the shots with candidates, or of all shots together."""

    @abstractmethod
    def with_effect(self, score: Score) -> Self:
        """The fit with an additional effect, or with another formula instead of its own."""

    def without(self, name: str) -> Self:
        """The fit without an effect."""
        if name not in self._fits_without:
            self._fits_without[name] = self.fitted_without(name)
        return self._fits_without[name]

    @cached_property
    def _fits_without(self) -> dict[str, Self]:
        """Fits without one effect: the search, its last reading and the result ask for the same one."""
        return {}

    @abstractmethod
    def fitted_without(self, name: str) -> Self:
        """The fit without an effect, fitted anew."""

    @abstractmethod
    def stripped(self, name: str) -> Self:
        """The fit without an effect, other constants unchanged."""

    @abstractmethod
    def at_constants(self, c: Array) -> Self:
        """The fit at other constants (q,) that play its shots alike; nothing is fitted again."""

    @abstractmethod
    def beside(self, other: Self) -> Self:
        """The fit started from another one's states and errors of the model, so that both can be compared."""

    @abstractmethod
    def renewed(self) -> Self:
        """The fit at the most likely errors of its model."""

    @abstractmethod
    def searched(self, *, every: bool = False) -> Self:
        """The fit with initial states of poorly followed shots, or of all, searched again.

        It is unchanged if that finds nothing likelier.
        """

    @abstractmethod
    def continued(self) -> Self:
        """The fit after as many further steps as a fit with a candidate takes."""

    @abstractmethod
    def settled(self) -> Self:
        """The fit at its end, as it is handed on."""

    @abstractmethod
    def losses_beside(self, more: Self) -> tuple[Array, Array]:
        """Losses of the shots (n,) about this fit and about another one, by independent residuals and equal priors."""

    def gain(self, more: Self) -> float:
        """Gain of another fit of the same shots, in log likelihood of independent residuals."""
        one, two = self.losses_beside(more)
        return float((one - two).sum())

    @abstractmethod
    def held_gain(self, more: Self) -> float:
        """The gain in held-out shots; 0 without any."""

    def scores(self, candidates: Sequence[Candidate]) -> Scores:
        """Scores of candidates for the fit."""
        return scores_of(self.point, self.linearised(candidates, together=True), self.design_effect)

    def scores_without(self, parameters: Collection[str], candidates: Sequence[Candidate]) -> Scores:
        """Scores of candidates for the fit with some parameters removed, using the losses of the fit that has them.

        Losses are quadratic about a fit that follows the shots, but rough about one that misses them.
        """
        point, gone = self.point, np.array([name in parameters for name in self.names])
        metas = [self.model.meta(name) for name in np.array(self.names)[gone]]
        away = [
            c - m["off"] if m["off"] is not None else 0.0 for c, m in zip(point.constants[gone], metas, strict=True)
        ]
        seen = self.linearised(candidates, together=True).held(np.flatnonzero(gone), np.array(away))
        rest = [name for name in self.names if name not in parameters]
        problem = point.problem.with_model(point.problem.model, rest)
        point = dataclasses.replace(point, problem=problem, constants=point.constants[~gone])
        return scores_of(point, seen, self.design_effect)

    @property
    def names(self) -> tuple[str, ...]:
        """The constants."""
        return self.point.names

    @property
    def model(self) -> Model:
        """The model at these constants."""
        return self.point.model

    @property
    def follows_most(self) -> bool:
        """Whether most shots scatter about the fit by noise alone."""
        return self.design_effect == 1.0

    @property
    def unfollowed(self) -> int:
        """Number of shots that miss by more than noise explains, where most are followed."""
        return 0

    @property
    def leaves_noise(self) -> bool:
        """Whether all shots scatter about the fit by noise alone."""
        return self.follows_most and self.unfollowed == 0

    def told_of(self, rows: Index) -> tuple[Array, Array]:
        """Information (n, k, k) and gradient (n, k) of each shot about some constants, reduced by the design effect."""
        information, gradient = projected_on(*self.shots, rows)
        return information / self.design_effect, gradient / self.design_effect


def projected_on(information: Array, gradient: Array, rows: Index) -> tuple[Array, Array]:
    """Quadratic losses of shots, reduced to a few of the unknowns: (n, k, k) and (n, k).

    The other unknowns follow by the response of all shots together. Information is (n, u, u), the gradient (n, u).
    """
    total = information.sum(axis=0)
    rest = np.setdiff1d(np.arange(len(total)), rows)
    scale = np.sqrt(np.maximum(np.diag(total), 1e-300))[rest]
    own = total[np.ix_(rest, rest)] / np.outer(scale, scale)
    way = np.zeros((len(total), len(rows)))
    way[rest] = -np.linalg.lstsq(own, total[np.ix_(rest, rows)] / scale[:, None], rcond=1e-10)[0] / scale[:, None]
    way[rows] = np.eye(len(rows))
    return np.einsum("uk,nuv,vl->nkl", way, information, way, optimize=True), gradient @ way
