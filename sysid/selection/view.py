"""A fit beside which causes are looked for: of windows of one impact each (by_windows.py), or of whole shots.

In: a fit. Out: a `FitView` of it: candidates scored beside it, fits with one more or one less, and by how much one fit
is likelier than another in the shots that were fitted and in those held out.

Shots tell less than as many independent residuals where they scatter about a fit by more than their information says:
by its design effect. So a single shot that departs from all others cannot speak for a cause alone.
"""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from typing import Self

import numpy as np

from models.model_file import Model
from sysid.estimation.fitted import FittedModel, Point
from sysid.estimation.problem import Array, Index
from sysid.selection.score import Linearised, Score, Scores, scores_of
from sysid.selection.signatures import Candidate


class FitView(ABC):
    """A fit, as causes are looked for beside it."""

    @property
    @abstractmethod
    def point(self) -> Point:
        """Its problem and its constants."""

    @property
    @abstractmethod
    def fitted(self) -> FittedModel:
        """As a fit of whole shots."""

    @property
    @abstractmethod
    def windows(self) -> int:
        """Of one impact each; 0 for whole shots."""

    @property
    @abstractmethod
    def count(self) -> int:
        """Of residuals."""

    @property
    @abstractmethod
    def design_effect(self) -> float:
        """By how much less its shots tell than as many independent residuals: 1 at least."""

    @property
    @abstractmethod
    def shots(self) -> tuple[Array, Array]:
        """Information (n, q, q) and gradient (n, q) of each on the constants, states eliminated."""

    @abstractmethod
    def linearised(self, candidates: Sequence[Candidate], *, together: bool = False) -> Linearised:
        """Its shots' losses with candidates beside it, or those of all shots together."""

    @abstractmethod
    def with_effect(self, score: Score) -> Self:
        """The fit with an effect more, or with another formula in place of its own."""

    @abstractmethod
    def without(self, name: str) -> Self:
        """The fit without an effect."""

    @abstractmethod
    def stripped(self, name: str) -> Self:
        """The same without an effect, its other constants as they are."""

    @abstractmethod
    def beside(self, other: Self) -> Self:
        """The fit from where another one has led, and at its errors of the model, so that both can be compared."""

    @abstractmethod
    def renewed(self) -> Self:
        """The fit at the most likely errors of the model beside all that it has."""

    @abstractmethod
    def searched(self) -> Self:
        """The fit with its shots searched for where they began; the same one where that finds nothing likelier."""

    @abstractmethod
    def continued(self) -> Self:
        """The fit after as many steps more as one with a candidate gets."""

    @abstractmethod
    def settled(self) -> Self:
        """The fit at its end, as it is handed on."""

    @abstractmethod
    def gain(self, more: Self) -> float:
        """By how much another fit of the same shots is likelier, in log likelihood of independent residuals."""

    @abstractmethod
    def held_gain(self, more: Self) -> float:
        """The same of the shots held out; 0 without any."""

    def scores(self, candidates: Sequence[Candidate]) -> Scores:
        """Of candidates beside it."""
        return scores_of(self.point, self.linearised(candidates, together=True), self.design_effect)

    def scores_without(self, parameters: Collection[str], candidates: Sequence[Candidate]) -> Scores:
        """Of candidates beside the fit without what some parameters do, by the losses that its shots have with that.

        These are quadratic about a fit that follows the shots, where those of a fit that misses them are rough.
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
    def leaves_noise(self) -> bool:
        """Whether its shots scatter about it as noise alone does."""
        return self.design_effect == 1.0

    def told_of(self, rows: Index) -> tuple[Array, Array]:
        """Information (n, k, k) and gradient (n, k) of each shot on some constants, at the design effect of all."""
        information, gradient = projected_on(*self.shots, rows)
        return information / self.design_effect, gradient / self.design_effect


def projected_on(information: Array, gradient: Array, rows: Index) -> tuple[Array, Array]:
    """Losses of shots, quadratic in some unknowns, as those of a few of them alone: (n, k, k) and (n, k).

    The others follow as all shots together have it. Information is (n, u, u), the gradient (n, u).
    """
    total = information.sum(axis=0)
    rest = np.setdiff1d(np.arange(len(total)), rows)
    scale = np.sqrt(np.maximum(np.diag(total), 1e-300))[rest]
    own = total[np.ix_(rest, rest)] / np.outer(scale, scale)
    way = np.zeros((len(total), len(rows)))
    way[rest] = -np.linalg.lstsq(own, total[np.ix_(rest, rows)] / scale[:, None], rcond=1e-10)[0] / scale[:, None]
    way[rows] = np.eye(len(rows))
    return np.einsum("uk,nuv,vl->nkl", way, information, way, optimize=True), gradient @ way
