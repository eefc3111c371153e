"""Normal equations of least squares from residuals and their finite differences, summed in one compiled pass."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.compiled import compiled, compiled_sums
from models.workers.threads import over_threads

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NormalEquations:
    """Normal equations of n problems with k unknowns each, without priors."""

    loss: Array  # (n,) half the robust loss
    matrix: Array  # (n, k, k) J^T W J
    gradient: Array  # (n, k) J^T W r


def robust_loss(residuals: Array, c: float) -> Array:
    """Half of Cauchy's loss, c^2/2 log(1 + (r/c)^2), of every problem: (...,) for residuals (..., m).

    NaN is ignored; infinite c is least squares.
    """
    flat = np.ascontiguousarray(residuals, float).reshape(-1, residuals.shape[-1])
    out = np.empty(len(flat))
    over_threads(lambda first, last: _losses(flat, float(c), out, first, last), len(flat))
    return out.reshape(residuals.shape[:-1])


@compiled
def _losses(residuals, c, out, first, last):  # type: ignore[no-untyped-def]
    for n in range(first, last):
        total = 0.0
        for k in range(residuals.shape[1]):
            r = residuals[n, k]
            if r == r:
                total += r * r if c == np.inf else c * c * math.log1p((r / c) * (r / c))
        out[n] = 0.5 * total


def from_differences(rows: Array, steps: Array, c: float) -> NormalEquations:
    """Normal equations from residuals (1 + k, n, m) at a point and with each of k unknowns moved; Cauchy's c."""
    rows = np.ascontiguousarray(rows)
    return _summed(rows[0], rows[1:], np.ascontiguousarray(steps, float), c)


def from_columns(residuals: Array, columns: Sequence[Array], c: float) -> Iterator[NormalEquations]:
    """Normal equations of one problem after the other, from residuals (n, m) and k finite derivatives (n, m).

    With thousands of unknowns the matrices of all problems together would fill the memory.
    """
    for one, r in enumerate(residuals):
        used = np.isfinite(r)
        root = 1.0 / np.sqrt(1.0 + (r[used] / c) ** 2)
        rows = np.array([column[one, used] for column in columns]).reshape(len(columns), root.size)
        rows *= root
        loss = robust_loss(residuals[one : one + 1], c)
        yield NormalEquations(loss, (rows @ rows.T)[None], (rows @ (root * r[used]))[None])


def from_derivatives(residuals: Array, rows: Array, c: float) -> NormalEquations:
    """Normal equations from residuals (n, m) and their derivatives by each unknown (k, n, m)."""
    return _summed(np.ascontiguousarray(residuals), np.ascontiguousarray(rows), np.zeros(0), c)


def projected(rows: Array, steps: Array, vectors: Array, c: float) -> Array:
    """J^T W v of every problem (n, k), for vectors v (n, m).

    Args:
        rows: (1 + k, n, m) residuals at a point, and with each of k unknowns moved.
        steps: (n, k) of those moves.
        vectors: v; entries that are not finite are ignored.
        c: Cauchy's constant.
    """
    out = np.empty(steps.shape)
    rows, steps, vectors = (np.ascontiguousarray(values, float) for values in (rows, steps, vectors))
    over_threads(lambda first, last: _project(rows, steps, vectors, float(c), out, first, last), len(steps))
    return out


@compiled_sums
def _project(rows, steps, vectors, c, out, first, last):  # type: ignore[no-untyped-def]
    size = rows.shape[2]
    derivative, along = np.empty(size), np.empty(size)  # of used entries only: sums do not depend on the batch
    for n in range(first, last):
        for k in range(steps.shape[1]):
            used = 0
            for s in range(size):
                value = rows[0, n, s]
                d, v = rows[1 + k, n, s] - value, vectors[n, s]
                if math.isfinite(d * v):
                    derivative[used], along[used] = d, v / (1.0 + (value / c) * (value / c))
                    used += 1
            out[n, k] = _dot(derivative, along, used) / steps[n, k]


def _summed(residuals: Array, rows: Array, steps: Array, c: float) -> NormalEquations:
    """Normal equations from residuals (n, m) and rows (k, n, m): moved by steps (k,), or derivatives without steps."""
    k, n = rows.shape[:2]
    found = NormalEquations(np.empty(n), np.empty((n, k, k)), np.empty((n, k)))

    def part(first: int, last: int) -> None:
        _sum(residuals, rows, steps, float(c), found.loss, found.matrix, found.gradient, first, last)

    over_threads(part, n)
    return found


@compiled_sums
def _sum(residuals, rows, steps, c, loss, matrix, gradient, first, last):  # type: ignore[no-untyped-def]
    count, size = rows.shape[0], rows.shape[2]
    j, weighted, r = np.empty((count, size)), np.empty((count, size)), np.empty(size)
    moved = steps.size > 0
    for n in range(first, last):
        total, used = 0.0, 0
        for s in range(size):
            value = residuals[n, s]
            if not math.isnan(value):
                q = value / c
                weight = 1.0 / (1.0 + q * q)
                total += 0.5 * value * value if math.isinf(c) else 0.5 * c * c * math.log1p(q * q)
                r[used] = value
                for k in range(count):
                    d = (rows[k, n, s] - value) / steps[k] if moved else rows[k, n, s]
                    d = 0.0 if math.isnan(d) else d
                    j[k, used], weighted[k, used] = d, weight * d
                used += 1
        loss[n] = total
        for a in range(count):
            for b in range(a + 1):
                matrix[n, a, b] = matrix[n, b, a] = _dot(weighted[a], j[b], used)
            gradient[n, a] = _dot(weighted[a], r, used)


@compiled_sums
def _dot(a, b, count):  # type: ignore[no-untyped-def]
    total = 0.0
    for k in range(count):
        total += a[k] * b[k]
    return total
