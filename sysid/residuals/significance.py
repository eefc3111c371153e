"""Departures: coefficients of many candidate signatures in one set of residuals, and the few worth naming.

Each clip gives its own value of a coefficient, with the uncertainty of the noise. Under a model that is wrong elsewhere
the clips' values differ by more than that, so they are averaged with a variance between clips (DerSimonian and Laird
1986), and the mean's uncertainty is what they scatter (Hartung and Knapp 2001), judged by Student's t of the clips that
effectively count: what two clips show is no proof, however clear.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc, ndtri, stdtr

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CHANCE = 0.01  # that a comparison without a fault names anything
TABLE = "direction on the table"  # the variable of a pull that is the same everywhere
PLACE = "place"
MOST = 6  # departures of one kind that are named
FREE = 1.0  # least effective clips, less one
SUREST = 38.0  # normal quantile beyond which probabilities are 0 in double precision


@dataclass(frozen=True)
class Departure:
    """What measured balls do beyond the model in a group."""

    where: str  # a sentence
    variable: str
    group: str  # in plain words
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
    """How much of what is left unexplained a variable's groups explain."""

    of: str  # "motion", "turning", "impacts"
    variable: str
    groups: int  # coefficients
    share: float  # of chi-square beyond the noise; NaN where there is none
    z: float  # of the F test, as a normal quantile


@dataclass(frozen=True)
class Findings:
    """Departures and dependences of a comparison."""

    named: tuple[Departure, ...]  # the most evident first, each beyond what those before it explain
    groups: tuple[Departure, ...]  # every group by itself
    dependence: tuple[Dependence, ...]  # by what they are of, the largest share first
    tests: int  # groups looked at


@dataclass(frozen=True)
class Head:
    """What a candidate stands for."""

    variable: str
    group: str
    quantity: str
    unit: str
    samples: int
    say: Callable[[float, float], str]  # the sentence for a value and its sd


@dataclass(frozen=True)
class Slopes:
    """Coefficients of candidates with their uncertainty, each (k,); NaN where too few clips tell."""

    value: Array
    sd: Array
    sure: Array  # normal quantile as unlikely by chance
    gain: Array  # chi-square explained


@dataclass(frozen=True)
class Signature:
    """What a candidate would leave in the residuals, where it leaves anything: most groups touch few rows."""

    row: NDArray[np.int32]  # (i,)
    value: Array  # (i,) in units of noise


@dataclass(frozen=True)
class Candidates:
    """Signatures of groups in one set of residuals."""

    of: str
    signatures: tuple[Signature, ...]  # k
    residual: Array  # (m,) in units of noise
    clip: Index  # (m,)
    free: int  # degrees of freedom of the residuals
    heads: tuple[Head, ...]  # k

    @cached_property
    def _cluster(self) -> Index:
        """Number of each row's clip, without gaps: (m,)."""
        return np.unique(self.clip, return_inverse=True)[1]

    @cached_property
    def _weight(self) -> Array:
        """The signatures' power in each clip: (c, k)."""
        return self._sums(lambda s: s.value**2)

    def _sums(self, of: Callable[[Signature], Array]) -> Array:
        """What is said of the rows of every signature, summed over each clip: (c, k)."""
        count = self._cluster.max(initial=-1) + 1
        sums = [np.bincount(self._cluster[s.row], of(s), count) for s in self.signatures]
        return np.reshape(sums, (len(sums), count)).T

    @cached_property
    def own(self) -> Slopes:
        """Every candidate by itself."""
        return self.slopes(self.residual)

    def slopes(self, residual: Array) -> Slopes:
        """Every candidate by itself, in these residuals (m,)."""
        weight = self._weight
        with np.errstate(divide="ignore", invalid="ignore"):
            cross = self._sums(lambda s: s.value * residual[s.row])
            power = weight.sum(axis=0)
            tells = weight > 1e-9 * power
            each = np.where(tells, cross / weight, 0.0)
            mean = (weight * each).sum(axis=0) / power
            spread = (weight * (each - mean) ** 2).sum(axis=0) - (tells.sum(axis=0) - 1)
            differ = np.maximum(spread / (power - (weight**2).sum(axis=0) / power), 0.0)
            trust = np.where(tells, 1 / (1 / weight + differ), 0.0)
            whole = trust.sum(axis=0)
            value = (trust * each).sum(axis=0) / whole
            free = whole**2 / (trust**2).sum(axis=0) - 1
            scatter = (trust * (each - value) ** 2).sum(axis=0) / free
            sd = np.sqrt(np.maximum(scatter, 1.0) / whole)
            z = np.abs(value) / sd
            sure = np.minimum(np.where(differ > 0, -ndtri(stdtr(free, -z)), z), SUREST)
            gain = 2 * value * cross.sum(axis=0) - value**2 * power
        good = (free >= FREE) & (power > 0)
        return Slopes(*(np.where(good, v, np.nan) for v in (value, sd, sure, gain)))

    def departures(self) -> list[Departure]:
        """Every group by itself."""
        found = self.own
        return [_departure(self.of, h, found, k) for k, h in enumerate(self.heads) if np.isfinite(found.value[k])]

    def dependence(self) -> list[Dependence]:
        """Every variable's groups together."""
        total = float(self.residual @ self.residual)
        beyond = total - self.free
        rows = []
        for name in dict.fromkeys(h.variable for h in self.heads):
            axes_of = ("x", "y") if name == PLACE else ("along", "across")
            of = [
                k for k, h in enumerate(self.heads)
                if h.variable == name and (self.of != "motion" or name == TABLE or h.quantity.split()[1] in axes_of)
            ]  # fmt: skip
            s = np.zeros((len(of), len(self.residual)))
            for whole, k in zip(s, of, strict=True):
                whole[self.signatures[k].row] = self.signatures[k].value
            products, along = s @ s.T, s @ self.residual
            power = np.sqrt(np.diag(products))
            tells = power > 0
            if not tells.any():
                continue
            power = power[tells]
            size, axes = np.linalg.eigh(products[np.ix_(tells, tells)] / np.outer(power, power))
            use = size > 1e-8 * size[-1]
            k, left = int(use.sum()), max(self.free - int(use.sum()), 1)
            gain = float(np.sum((axes[:, use].T @ (along[tells] / power)) ** 2 / size[use]))
            chance = fdtrc(k, left, gain / k / max((total - gain) / left, 1e-300))
            share = (gain - k) / beyond if beyond > 5 * np.sqrt(2 * self.free) else np.nan
            rows.append(Dependence(self.of, name, k, float(np.clip(share, 0, 1)), float(min(-ndtri(chance), SUREST))))
        return rows


def pursue(candidates: Candidates, tests: int) -> list[Departure]:
    """Name candidates one after another, each the one that explains most of what those before it leave."""
    least = -ndtri(CHANCE / 2 / max(tests, 1))
    named: list[Departure] = []
    residual, found = candidates.residual, candidates.own
    for _ in range(MOST):
        sure = (np.nan_to_num(found.sure) > least) & (np.nan_to_num(found.gain) > 0)
        if not sure.any():
            break
        k = int(np.argmax(np.where(sure, found.gain, -1.0)))
        named.append(_departure(candidates.of, candidates.heads[k], found, k))
        residual = residual.copy()
        residual[candidates.signatures[k].row] -= float(found.value[k]) * candidates.signatures[k].value
        found = candidates.slopes(residual)
    return named


def _departure(of: str, head: Head, found: Slopes, k: int) -> Departure:
    value, sd = float(found.value[k]), float(found.sd[k])
    return Departure(
        head.say(value, sd), head.variable, head.group, head.quantity, value, head.unit, sd, value / sd, head.samples,
        float(found.gain[k]), of,
    )  # fmt: skip


def signature(rows: Array) -> Signature:
    """Of the residuals that a candidate would leave, one in each row (m,)."""
    row = np.flatnonzero(rows)
    return Signature(row.astype(np.int32), rows[row])
