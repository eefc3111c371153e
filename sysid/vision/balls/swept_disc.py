"""A disc with a blurred rim, swept along a straight path, and its least squares against cover, compiled.

In: cover (rows, columns) of a window, and where the disc may be. Out: centre, radius, height and shading that fit best.
Pixels are seen along the path and across it: of the places of the disc on its path, only those whose rim is at a pixel
cost anything there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from models.compiled import compiled
from sysid.vision.balls.view_geometry import Array, Image

RIM_BLUR_PX = 1.0  # of the rim of a disc
RIM_REACH = 3.5  # blurs from the rim, beyond which a disc covers all or nothing
RIM_STEPS = 512  # of a table of the rim, in a blur: linear between them, it is true to 2e-7
RIM_COVER = 0.5 + 0.5 * np.tanh(np.arange(-RIM_REACH * RIM_STEPS - 1, RIM_REACH * RIM_STEPS + 3) / RIM_STEPS)
MAX_SWEEP_PX = 4.0  # between two places of a disc on its path
MAX_STEP_GAIN = 1.8  # times a step: reweighted least squares fall short, and would stop on the way
GAIN_FALL = 0.5  # times it after a step back, which went too far
GAIN_RISE = 1.1  # times it after another one
MIN_STEP_GAIN = 0.05
SETTLED_PX = 0.01
COVERED = 0.05  # of a pixel, from which on it counts as the disc's
RIDGE_WEIGHT = 1e-6  # keeps the least squares solvable where the picture shows nothing
MAX_GROWTH = 0.15  # of the radius
MAX_MOVE_RADII = 0.5  # of the centre in a step
MAX_AWAY_RADII = 1.2  # from where it starts, beside its motion
UNKNOWNS = 6  # centre along the path and across it, radius, height, shading along and across


class Window(NamedTuple):
    """The picture that a disc is fitted to."""

    seen: Image  # cover (rows, columns)
    corner: Array  # (2,) its first pixel
    radius: float  # within which pixels count, about the disc's path [pixels]
    limit: float  # of residuals


class SweptDisc(NamedTuple):
    """A disc on its path, whose radius is yet to grow."""

    radius: float  # [pixels]
    motion: Array  # (2,) [pixels]
    places: int  # on its path
    gain: float  # times its cover


class StepEquations(NamedTuple):
    """Least squares for steps of the unknowns, and what they rest on.

    The sums are the weighted squares and weights of all residuals, the squares and number of those that the disc
    covers, and the squares and number of all, each at most at the limit.
    """

    matrix: Array  # (6, 6)
    right: Array  # (6,)
    sums: Array  # (6,)


def places(motion: Array) -> int:
    """Number of places of a disc on its path."""
    return 1 + 2 * math.ceil(math.hypot(*motion) / (2 * MAX_SWEEP_PX))


@compiled
def _path(motion: Array) -> tuple[float, float, float]:
    """Length of a motion (2,), and its direction."""
    length = math.hypot(motion[0], motion[1])
    return (length, motion[0] / length, motion[1] / length) if length > 0 else (length, 1.0, 0.0)


@compiled
def _swept(
    a: float, b: float, radius: float, length: float, count: int
) -> tuple[float, float, float, float, float, float]:
    """Cover at an offset along and across the path from its middle; derivatives by centre, radius and shading."""
    total = by_a = by_b = by_radius = along = across = 0.0
    margin = RIM_REACH * RIM_BLUR_PX
    outer = (radius + margin) ** 2
    inner = max(radius - margin, 0.0) ** 2
    bb = b * b
    if bb < outer:
        step = length / count
        x = a + 0.5 * (length - step)
        for _ in range(count):
            square = x * x + bb
            if square < inner:
                total += 1.0
                along += x
                across += b
            elif square < outer:
                distance = math.sqrt(square) + 1e-6
                depth = ((radius - distance) / RIM_BLUR_PX + RIM_REACH) * RIM_STEPS + 1.0
                k = int(depth)
                disc = RIM_COVER[k] + (depth - k) * (RIM_COVER[k + 1] - RIM_COVER[k])
                steep = 2 * disc * (1 - disc) / RIM_BLUR_PX
                inwards = steep / distance
                total += disc
                along += disc * x
                across += disc * b
                by_a += inwards * x
                by_b += inwards * b
                by_radius += steep
            x -= step
        each = 1.0 / count
        rim = each / radius
        return each * total, each * by_a, each * by_b, each * by_radius, rim * along, rim * across
    return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


@compiled
def _gained(
    a: float, b: float, radius: float, length: float, disc: SweptDisc
) -> tuple[float, float, float, float, float, float]:
    """The same with the gain of a disc, whose cover ends at 1."""
    gain = disc.gain
    model, d0, d1, d2, d4, d5 = _swept(a, b, radius, length, disc.places)
    if gain * model > 1.0:
        return 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if gain != 1.0:
        return gain * model, gain * d0, gain * d1, gain * d2, gain * d4, gain * d5
    return model, d0, d1, d2, d4, d5


@compiled
def _fill(into: StepEquations, lower: tuple[float, ...], right: tuple[float, ...], sums: tuple[float, ...]) -> None:
    """Fill equations, the matrix from its lower triangle, row by row."""
    k = 0
    for m in range(UNKNOWNS):
        into.right[m], into.sums[m] = right[m], sums[m]
        for n in range(m + 1):
            into.matrix[m, n] = into.matrix[n, m] = lower[k]
            k += 1


@compiled
def _normal_equations(
    window: Window, x0: float, y0: float, disc: SweptDisc, grown: float, shading: Array, into: StepEquations
) -> None:
    """Least squares of a swept disc, `grown` so much, against a window whose first pixel is (x0, y0) from its middle.

    `shading` (2,): by how much its cover rises to the rim, along the path and across it. Tukey's biweight weighs.
    """
    seen, limit, radius = window.seen, window.limit, disc.radius + grown
    length, cosine, sine = _path(disc.motion)
    inside, rim = window.radius * window.radius, (radius + RIM_REACH * RIM_BLUR_PX) ** 2
    squares = weights = covered_squares = capped = 0.0
    covered = counted = 0
    # Scalars stay in registers, arrays do not: this loop is most of the time that tracking takes.
    m00 = m10 = m11 = m20 = m21 = m22 = m30 = m31 = m32 = m33 = m40 = m41 = m42 = m43 = m44 = 0.0
    m50 = m51 = m52 = m53 = m54 = m55 = r0 = r1 = r2 = r3 = r4 = r5 = 0.0
    for j in range(seen.shape[0]):
        for i in range(seen.shape[1]):
            u, v = i + x0, j + y0
            a, b = u * cosine + v * sine, v * cosine - u * sine
            beyond = max(abs(a) - length / 2, 0.0)
            distance = beyond * beyond + b * b
            if distance >= inside:
                continue
            d0 = d1 = d2 = model = d4 = d5 = 0.0
            if distance < rim:
                model, d0, d1, d2, d4, d5 = _gained(a, b, radius, length, disc)
            residual = seen[j, i] - model - shading[0] * d4 - shading[1] * d5
            square = residual * residual
            capped += min(square, limit * limit)
            counted += 1
            if model > COVERED:
                covered_squares += square
                covered += 1
            if abs(residual) >= limit:
                continue
            weight = (1 - square / (limit * limit)) ** 2
            squares += weight * square
            weights += weight
            if model == 0.0:
                continue
            w3, w4, w5 = weight * model, weight * d4, weight * d5
            r3, r4, r5 = r3 + w3 * residual, r4 + w4 * residual, r5 + w5 * residual
            m33 += w3 * model
            m43, m44 = m43 + w4 * model, m44 + w4 * d4
            m53, m54, m55 = m53 + w5 * model, m54 + w5 * d4, m55 + w5 * d5
            if d2 == 0.0:  # within the rim, only height and shading count
                continue
            w0, w1, w2 = weight * d0, weight * d1, weight * d2
            r0, r1, r2 = r0 + w0 * residual, r1 + w1 * residual, r2 + w2 * residual
            m00 += w0 * d0
            m10, m11 = m10 + w1 * d0, m11 + w1 * d1
            m20, m21, m22 = m20 + w2 * d0, m21 + w2 * d1, m22 + w2 * d2
            m30, m31, m32 = m30 + w3 * d0, m31 + w3 * d1, m32 + w3 * d2
            m40, m41, m42 = m40 + w4 * d0, m41 + w4 * d1, m42 + w4 * d2
            m50, m51, m52 = m50 + w5 * d0, m51 + w5 * d1, m52 + w5 * d2
    lower = (
        m00, m10, m11, m20, m21, m22, m30, m31, m32, m33, m40, m41, m42, m43, m44, m50, m51, m52, m53, m54, m55,
    )  # fmt: skip
    sums = (squares, weights, covered_squares, float(covered), capped, float(counted))
    _fill(into, lower, (r0, r1, r2, r3, r4, r5), sums)


@compiled
def settled(
    window: Window, disc: SweptDisc, start: Array, prior: Array, steps: int, into: StepEquations
) -> tuple[bool, float, float, float, float]:
    """Fit a swept disc to a window, from a pixel (2,).

    `prior` (6,) is the inverse of the variances of the unknowns about none. Returns whether it stayed, its centre,
    by how much it has grown, and its height; leaves the equations of the last step.
    """
    corner, radius, motion, (matrix, right, _) = window.corner, disc.radius, disc.motion, into
    step = np.zeros(UNKNOWNS)
    shading, held = np.zeros(2), np.zeros(UNKNOWNS)
    x, y, grown, height = start[0], start[1], 0.0, 1.0
    step_gain, before_a, before_b = MAX_STEP_GAIN, 0.0, 0.0
    _, cosine, sine = _path(motion)
    away = MAX_AWAY_RADII * radius + max(abs(motion[0]), abs(motion[1]))
    for _ in range(steps):
        _normal_equations(window, corner[0] - x, corner[1] - y, disc, grown, shading, into)
        held[2], held[4], held[5] = grown, shading[0], shading[1]
        for m in range(UNKNOWNS):
            matrix[m, m] += prior[m] + RIDGE_WEIGHT
        step[:] = np.linalg.solve(matrix, right - prior * held)
        height = 1.0 + step[3]
        back = step[0] * before_a + step[1] * before_b < 0
        step_gain = max(GAIN_FALL * step_gain, MIN_STEP_GAIN) if back else min(GAIN_RISE * step_gain, MAX_STEP_GAIN)
        before_a, before_b = step[0], step[1]
        most = MAX_MOVE_RADII * radius
        dx = min(max(step_gain * (step[0] * cosine - step[1] * sine), -most), most)
        dy = min(max(step_gain * (step[0] * sine + step[1] * cosine), -most), most)
        x, y = x + dx, y + dy
        grown = min(max(grown + step_gain * step[2], -MAX_GROWTH * radius), MAX_GROWTH * radius)
        shading[0] += step_gain * step[4]
        shading[1] += step_gain * step[5]
        if max(abs(x - start[0]), abs(y - start[1])) > away:
            return False, x, y, grown, height
        if MAX_STEP_GAIN * max(abs(dx), abs(dy)) < SETTLED_PX * step_gain:
            break
    return True, x, y, grown, height


@compiled
def share(x: Array, y: Array, radius: float, motion: Array, count: int) -> Array:
    """Cover (n,) at offsets (n,) from the middle of a swept disc [pixels]."""
    out = np.empty(len(x))
    length, cosine, sine = _path(motion)
    for k in range(len(x)):
        out[k] = _swept(x[k] * cosine + y[k] * sine, y[k] * cosine - x[k] * sine, radius, length, count)[0]
    return out
