"""Departures: coefficients of many candidate regressors in a set of residuals, and the significant ones.

In: `Candidates`. Out: `Departure`s and `Dependence`s, of which a `Findings` is made.

Each clip gives a value of a coefficient, with the uncertainty due to noise. If the model is wrong elsewhere, the clips'
values differ by more than that, so they are averaged with a variance between clips (random effects, DerSimonian and
Laird 1986), and the mean's uncertainty is their scatter (Hartung and Knapp 2001), judged by Student's t with the
effective number of clips: a difference that only two clips show is not significant, however clear.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.special import fdtrc, ndtri, stdtr

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FALSE_ALARM_RATE = 0.01  # share of comparisons of a perfect model that name a departure
TABLE_DIRECTION = "direction on the table"  # the variable of an acceleration that is the same everywhere
PLACE_VARIABLE = "place"
MAX_NAMED = 6  # most departures of one kind
MIN_EFFECTIVE_FREEDOM = 1.0  # effective number of clips, less one
MAX_QUANTILE = 38.0  # of a normal, beyond which probabilities are 0 in double precision


@dataclass(frozen=True)
class Departure:
    """The departure of measured balls from the model in a group."""

    where: str  # a sentence
    variable: str
    group: str  # description
    quantity: str
    value: float  # measured minus modelled
    unit: str
    sd: float
    z: float  # value over sd
    samples: int
    gain: float  # chi-square explained
    of: str  # "motion", "turning", "impacts"


@dataclass(frozen=True)
class Dependence:
    """The share of the chi-square beyond the noise that a variable's groups explain."""

    of: str  # "motion", "turning", "impacts"
    variable: str
    groups: int  # coefficients
    share: float  # of chi-square beyond the noise; NaN where there is none
    z: float  # of the F test, as a normal quantile


@dataclass(frozen=True)
class Findings:
    """Departures and dependences of a comparison."""

    named: tuple[Departure, ...]  # the most evident first, each after subtraction of those before it
    groups: tuple[Departure, ...]  # every group alone
    dependence: tuple[Dependence, ...]  # by kind, the largest share first
    tests: int  # groups tested


@dataclass(frozen=True)
class Regressor:
    """A column of the design matrix, sparse: most groups concern few rows."""

    row: NDArray[np.int32]  # (i,)
    value: Array  # (i,) in units of noise


@dataclass(frozen=True)
class CandidateDeparture:
    """A tested departure: a group, a quantity, and the residuals that one unit of it causes."""

    variable: str
    group: str
    quantity: str
    unit: str
    samples: int
    sentence: Callable[[float, float], str]  # for a value and its sd
    regressor: Regressor


@dataclass(frozen=True)
class Coefficients:
    """Coefficients of candidates with their uncertainty, each (k,); NaN if too few clips determine one."""

    value: Array
    sd: Array
    quantile: Array  # normal quantile of the same probability
    gain: Array  # chi-square explained


@dataclass(frozen=True)
class Candidates:
    """All candidates for one set of residuals."""

    of: str  # "motion", "turning", "impacts"
    all: tuple[CandidateDeparture, ...]  # k
    residual: Array  # (m,) in units of noise
    clip: Index  # (m,)
    freedom: int  # degrees of freedom of the residuals

    @cached_property
    def _cluster(self) -> Index:
        """Index of each row's clip, numbered without gaps: (m,)."""
        return np.unique(self.clip, return_inverse=True)[1]

    @cached_property
    def _information(self) -> Array:
        """Information on each coefficient in each clip: (c, k)."""
        return self._sums(lambda s: s.value**2)

    def _sums(self, of: Callable[[Regressor], Array]) -> Array:
        """Sum over each clip of a quantity of every regressor's rows: (c, k)."""
        count = self._cluster.max(initial=-1) + 1
        sums = [np.bincount(self._cluster[c.regressor.row], of(c.regressor), count) for c in self.all]
        return np.reshape(sums, (len(sums), count)).T

    @cached_property
    def single(self) -> Coefficients:
        """Coefficients of every candidate alone."""
        return self.coefficients(self.residual)

    def coefficients(self, residual: Array) -> Coefficients:
        """Coefficients of every candidate alone, in these residuals (m,)."""
        weight = self._information
        with np.errstate(divide="ignore", invalid="ignore"):
            cross = self._sums(lambda s: s.value * residual[s.row])
            power = weight.sum(axis=0)
            informed = weight > 1e-9 * power
            each = np.where(informed, cross / weight, 0.0)
            mean = (weight * each).sum(axis=0) / power
            spread = (weight * (each - mean) ** 2).sum(axis=0) - (informed.sum(axis=0) - 1)
            between = np.maximum(spread / (power - (weight**2).sum(axis=0) / power), 0.0)
            trust = np.where(informed, 1 / (1 / weight + between), 0.0)
            whole = trust.sum(axis=0)
            value = (trust * each).sum(axis=0) / whole
            freedom = whole**2 / (trust**2).sum(axis=0) - 1
            scatter = (trust * (each - value) ** 2).sum(axis=0) / freedom
            sd = np.sqrt(np.maximum(scatter, 1.0) / whole)
            z = np.abs(value) / sd
            quantile = np.minimum(np.where(between > 0, -ndtri(stdtr(freedom, -z)), z), MAX_QUANTILE)
            gain = 2 * value * cross.sum(axis=0) - value**2 * power
        good = (freedom >= MIN_EFFECTIVE_FREEDOM) & (power > 0)
        return Coefficients(*(np.where(good, v, np.nan) for v in (value, sd, quantile, gain)))

    def departures(self) -> list[Departure]:
        """The departure of every group alone."""
        return [_departure(self, self.single, k) for k in range(len(self.all)) if np.isfinite(self.single.value[k])]

    def dependence(self) -> list[Dependence]:
        """The dependence on every variable, from its groups together."""
        rows = (self._explained_by(name) for name in dict.fromkeys(c.variable for c in self.all))
        return [row for row in rows if row is not None]

    def _explained_by(self, variable: str) -> Dependence | None:
        """The dependence on a variable, from its groups together; None if they concern no residual."""
        total = float(self.residual @ self.residual)
        beyond = total - self.freedom
        axes = ("x", "y") if variable == PLACE_VARIABLE else ("along", "across")
        counted = [
            c.regressor for c in self.all
            if c.variable == variable
            and (self.of != "motion" or variable == TABLE_DIRECTION or c.quantity.split()[1] in axes)
        ]  # fmt: skip
        s = _stacked(counted, len(self.residual))
        products, along = (s @ s.T).toarray(), s @ self.residual
        power = np.sqrt(np.diag(products))
        informed = power > 0
        if not informed.any():
            return None
        power = power[informed]
        size, vectors = np.linalg.eigh(products[np.ix_(informed, informed)] / np.outer(power, power))
        use = size > 1e-8 * size[-1]
        k, remaining = int(use.sum()), max(self.freedom - int(use.sum()), 1)
        gain = float(np.sum((vectors[:, use].T @ (along[informed] / power)) ** 2 / size[use]))
        chance = fdtrc(k, remaining, gain / k / max((total - gain) / remaining, 1e-300))
        share = (gain - k) / beyond if beyond > 5 * np.sqrt(2 * self.freedom) else np.nan
        z = float(min(-ndtri(chance), MAX_QUANTILE))
        return Dependence(self.of, variable, k, float(np.clip(share, 0, 1)), z)


def pursue(candidates: Candidates, tests: int) -> list[Departure]:
    """Find the significant candidates in turn, each the one that explains most of the remaining residuals.

    Args:
        candidates: of one kind.
        tests: number of candidates for the Bonferroni correction.
    """
    threshold = -ndtri(FALSE_ALARM_RATE / 2 / max(tests, 1))
    named: list[Departure] = []
    residual, found = candidates.residual, candidates.single
    for _ in range(MAX_NAMED):
        significant = (np.nan_to_num(found.quantile) > threshold) & (np.nan_to_num(found.gain) > 0)
        if not significant.any():
            break
        k = int(np.argmax(np.where(significant, found.gain, -1.0)))
        named.append(_departure(candidates, found, k))
        regressor = candidates.all[k].regressor
        residual = residual.copy()
        residual[regressor.row] -= float(found.value[k]) * regressor.value
        found = candidates.coefficients(residual)
    return named


def _departure(candidates: Candidates, found: Coefficients, k: int) -> Departure:
    one, value, sd = candidates.all[k], float(found.value[k]), float(found.sd[k])
    return Departure(
        one.sentence(value, sd), one.variable, one.group, one.quantity, value, one.unit, sd, value / sd, one.samples,
        float(found.gain[k]), candidates.of,
    )  # fmt: skip


def _stacked(regressors: Sequence[Regressor], length: int) -> csr_array:
    """Regressors as the rows of a sparse matrix (k, length): most groups concern few residuals."""
    ends = np.cumsum([0, *(len(r.row) for r in regressors)])
    columns = np.concatenate([r.row for r in regressors] or [np.zeros(0, np.int32)])
    values = np.concatenate([r.value for r in regressors] or [np.zeros(0)])
    return csr_array((values, columns, ends), shape=(len(regressors), length))


def sparse(column: Array) -> Regressor:
    """A column of the design matrix (m,), in units of noise."""
    row = np.flatnonzero(column)
    return Regressor(row.astype(np.int32), column[row])
