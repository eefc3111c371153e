"""Smooth functions that residuals show: their posterior, with size and smoothness inferred from the residuals.

    y = sum_i c_i phi_i + sum_g u_g q_g + noise,   c_i ~ N(0, v_b w_i),   u_g ~ N(0, t^2),   noise ~ N(0, s^2)

The phi are what cosines of a function of place, speed or another variable leave in the residuals. With weights
w_i ~ exp(-(l k_i)^2 / 2) of their wave numbers k_i, their sum is a Gaussian process with a squared exponential
covariance of length l (A. Solin and S. Sarkka 2020, of reduced rank). The q_g are what each group of rows (a phase of a
ball's motion, an impact) has for itself: whatever else the model lacks there, so that only what groups have in common
counts as the function. Variances v of every block of columns, t, s and l have the largest marginal likelihood; s is not
below 1, the noise that is known.

Left out: the uncertainty of these few; correlations between groups.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize, minimize_scalar

Array = NDArray[np.float64]
Index = NDArray[np.int64]
F = TypeVar("F")

LOG_SPAN = 16.0  # of variances on either side of where a search begins: from nothing to far above the noise
LBFGS_OPTIONS = {"ftol": 1e-7}  # of a log likelihood of some thousands
LOG_TOLERANCE = 0.2  # of t^2, whose own uncertainty is larger with fewer than hundreds of groups
LENGTHS_TRIED = (0.1, 0.4)  # of the longest, from which a search begins
LONGEST_WAVES = 3.0  # length over one over the least wave number, at which hardly a wave is left but the constant


@dataclass(frozen=True)
class Residuals:
    """Rows that functions are looked for in."""

    y: Array  # (m,) in units of noise
    own: Array  # (m,) what one unit of a group's own cause leaves
    group: Index  # (m,) from 0, without gaps
    freedom: int  # rows, less what was fitted to them

    def without(self, explained: Array) -> Residuals:
        """What is left beside what is explained (m,)."""
        return dataclasses.replace(self, y=self.y - explained)

    def per_group(self, columns: Array) -> Array:
        """Products of columns (m, k) with each group's own: (g, k)."""
        count = int(self.group.max()) + 1
        weighted = self.own[:, None] * columns
        return np.column_stack([np.bincount(self.group, column, count) for column in weighted.T])


@dataclass(frozen=True)
class Columns:
    """What is looked for: cosines in blocks, each with a variance of its own."""

    design: Array  # (m, k) what one unit of each leaves in the residuals
    block: Index  # (k,) from 0, without gaps
    wave: Array  # (k,) wave numbers, 0 of a constant
    usual: int = -1  # the block of what models have anyway, against which the evidence of the others is; -1 for none

    def weights(self, length: float) -> Array:
        """Prior variances of the columns, those of a block summing to one: (k,)."""
        square = self.wave**2
        least = np.full(int(self.block.max()) + 1, np.inf)
        np.minimum.at(least, self.block, square)
        raw = np.exp(-0.5 * length**2 * (square - least[self.block]))
        return np.asarray(raw / np.bincount(self.block, raw)[self.block])


@dataclass(frozen=True)
class Posterior:
    """What the residuals say of the columns."""

    mean: Array  # (k,)
    covariance: Array  # (k, k)
    evidence: float  # log of how much likelier the residuals are than without, less (BIC) half of log n a variance
    group_variance: float  # t^2 / s^2
    noise: float  # s

    def values(self, basis: Array) -> tuple[Array, Array]:
        """The function and its standard deviation where the columns have the values (n, k): (n,) each."""
        variance = np.einsum("nk,kl,nl->n", basis, self.covariance, basis)
        return basis @ self.mean, np.sqrt(np.maximum(variance, 0.0))


@dataclass(frozen=True)
class Explanation(Generic[F]):
    """What was found, how much likelier it makes the residuals, and what it explains of them."""

    found: F
    evidence: float  # see Posterior
    explained: Array  # (m,)


@dataclass(frozen=True)
class _Solved:
    """The posterior at given variances, and how its log likelihood changes with their logarithms."""

    log_likelihood: float
    mean: Array  # (k,)
    covariance: Array  # (k, k)
    noise: float  # s
    slopes: Array  # (k,) by the prior variance of each column


@dataclass(frozen=True)
class _Sums:
    """Sums over rows, which do not depend on any variance."""

    residuals: Residuals
    columns: Columns

    @cached_property
    def products(self) -> tuple[Array, Array, Array, Array, Array, float]:
        """Of columns with columns, with y, with the groups' own; of own with own, with y; of y with y."""
        r, x = self.residuals, self.columns.design
        own, y = r.own[:, None], r.y[:, None]
        power, along = r.per_group(own)[:, 0], r.per_group(y)[:, 0]
        return x.T @ x, x.T @ r.y, r.per_group(x), power, along, float(r.y @ r.y)

    def beside_own(self, group_variance: float) -> _Normal:
        """The normal equations where a group's own cause has t^2 over s^2."""
        products, with_y, of_groups, power, along, square = self.products
        share = group_variance / (1.0 + group_variance * power)
        return _Normal(
            products - (of_groups * share[:, None]).T @ of_groups, with_y - of_groups.T @ (share * along),
            square - float(share @ along**2), float(np.log1p(group_variance * power).sum()), self.residuals.freedom,
        )  # fmt: skip


@dataclass(frozen=True)
class _Normal:
    """Normal equations of the columns."""

    inner: Array  # (k, k)
    outer: Array  # (k,)
    square: float
    spread: float  # log determinant of the groups' own
    freedom: int

    def solved(self, variance: Array) -> _Solved:
        """The columns with prior variances (k,) over s^2."""
        scale, n = np.sqrt(variance), self.freedom
        factor = cho_factor(np.eye(len(scale)) + scale[:, None] * self.inner * scale)
        inverse = cho_solve(factor, np.eye(len(scale)))
        scaled = inverse @ (scale * self.outer)
        mean = scale * scaled
        misfit = self.square - float(self.outer @ mean)
        noise = max(1.0, misfit / n)
        spread = self.spread + 2 * float(np.log(np.diag(factor[0])).sum())
        return _Solved(
            -0.5 * (misfit / noise + n * math.log(noise) + spread), mean, noise * scale[:, None] * inverse * scale,
            math.sqrt(noise), 0.5 * (scaled**2 / noise - 1.0 + np.diag(inverse)),
        )  # fmt: skip


@dataclass(frozen=True)
class _Fit:
    """The most likely variances."""

    variances: int  # how many, and lengths
    group_variance: float  # t^2 / s^2
    solved: _Solved


def posterior(residuals: Residuals, columns: Columns) -> Posterior:
    """The posterior of what is looked for, at the most likely variances."""
    sums, blocks = _Sums(residuals, columns), np.arange(int(columns.block.max()) + 1)
    without = _most_likely(sums, blocks[blocks == columns.usual])
    best = _most_likely(sums, blocks)
    cost = 0.5 * (best.variances - without.variances) * math.log(max(len(sums.products[3]), 2))
    seen = best.solved
    evidence = seen.log_likelihood - without.solved.log_likelihood - cost
    return Posterior(seen.mean, seen.covariance, evidence, best.group_variance, seen.noise)


def _most_likely(sums: _Sums, used: Index) -> _Fit:
    """The fit at the most likely variances, with some blocks of columns: for every t^2 the others anew."""
    columns = sums.columns
    inside = np.isin(columns.block, used)
    number = np.searchsorted(used, np.where(inside, columns.block, 0)) if len(used) else np.zeros_like(columns.block)
    waves = columns.wave[inside & (columns.wave > 0)]

    def variances(x: Array) -> tuple[Array, Array, float]:
        """Prior variances of the columns, their weights, and the length."""
        length = math.exp(x[-1]) if len(waves) else 1.0
        weights = columns.weights(length)
        return np.where(inside, np.exp(np.append(x, 0.0)[number]) * weights, 0.0), weights, length

    def loss(x: Array, normal: _Normal) -> tuple[float, Array]:
        variance, weights, length = variances(x)
        seen = normal.solved(variance)
        by_column = np.where(inside, seen.slopes, 0.0)
        slopes = np.bincount(number, by_column, len(used))[: len(used)].tolist()
        if len(waves):
            square = (length * columns.wave) ** 2
            mean = np.bincount(columns.block, weights * square)[columns.block]
            slopes.append(float(by_column @ (mean - square)))
        return -seen.log_likelihood, -np.array(slopes)

    power = np.bincount(columns.block, np.diag(sums.products[0])) / np.bincount(columns.block)
    own, *start = -np.log(np.maximum([float(sums.products[3].mean()), *power[used]], np.finfo(float).tiny))
    bounds, begins = [(one - LOG_SPAN, one + LOG_SPAN) for one in start], [np.array(start)]
    if len(waves):
        shortest, longest = 1.0 / float(waves.max()), LONGEST_WAVES / float(waves.min())
        bounds.append((math.log(shortest), math.log(longest)))
        begins = [np.append(start, math.log(share * longest)) for share in LENGTHS_TRIED]
    fits: dict[float, tuple[float, Array]] = {}

    def profile(log_group_variance: float) -> float:
        """Loss at the best of the other variances, from the best so far and from the starts at first."""
        normal, x = sums.beside_own(math.exp(log_group_variance)), np.zeros(0)
        if not begins[0].size:
            value = loss(x, normal)[0]
        else:
            known = [min(fits.values(), key=lambda one: one[0])[1]] if fits else begins
            tries = [
                minimize(loss, one, (normal,), bounds=bounds, method="L-BFGS-B", jac=True, options=LBFGS_OPTIONS)
                for one in known
            ]
            best = min(tries, key=lambda one: float(one.fun))
            value, x = float(best.fun), best.x
        fits[log_group_variance] = value, x
        return value

    minimize_scalar(profile, bounds=(own - LOG_SPAN, own + LOG_SPAN), options={"xatol": LOG_TOLERANCE})
    log_group_variance = min(fits, key=lambda one: fits[one][0])
    x, group_variance = fits[log_group_variance][1], math.exp(log_group_variance)
    return _Fit(len(x) + 1, group_variance, sums.beside_own(group_variance).solved(variances(x)[0]))


def each(residuals: Residuals, design: Array, found: Posterior) -> tuple[Array, Array]:
    """Every column (m, k) by itself, under the noise of a posterior: values and standard deviations (k,)."""
    columns = Columns(design, np.arange(design.shape[1]), np.zeros(design.shape[1]))
    products, with_y, of_groups, power, along, _ = _Sums(residuals, columns).products
    share = found.group_variance / (1.0 + found.group_variance * power)
    before = np.diag(products)
    information = before - share @ of_groups**2
    known = information > np.finfo(float).eps * before
    with np.errstate(divide="ignore", invalid="ignore"):
        value = (with_y - of_groups.T @ (share * along)) / information
        sd = found.noise / np.sqrt(information)
    return np.where(known, value, np.nan), np.where(known, sd, np.nan)


def cosines(at: Array, size: Array, waves: Sequence[int]) -> tuple[Array, Array]:
    """Cosines of places (n, d) in a box around 0 of size (d,) [m]: (n, k), and their wave numbers (k,)."""
    numbers = np.stack(np.meshgrid(*(np.arange(n + 1) for n in waves), indexing="ij"), axis=-1).reshape(-1, len(size))
    angle = math.pi * (at / size + 0.5)
    basis = np.prod([np.cos(angle[:, [d]] * numbers[:, d]) for d in range(len(size))], axis=0)
    return basis, math.pi * np.hypot.reduce(numbers / size, axis=1)
