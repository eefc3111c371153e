"""Edges of balls to a fraction of a pixel, by least squares along the normals of their outlines.

In: a picture beside the background, and outlines. Out: `Edges`, how far from each outline the edge of the ball is along
every normal, and how well that is known.

Along a normal, d outwards from the outline, a channel of the picture is modelled as
S(d) (a + b h(d)) + (1 - S(d)) (T(d) + c): S the step from ball to table and h the height of the sphere over its widest
circle, both blurred, T the empty table, and a, b, c free. A shift of the outline adds its derivative.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from models.shot import NOSE_HEIGHT
from sysid.vision.balls.background import View
from sysid.vision.balls.view_geometry import OUTLINE_NORMALS, Array

INNER_PX = 3.0  # of a normal, within the outline, that are sampled
OUTER_PX = 4.0  # and outside of it
MIN_OUTLINE_RADIUS_PX = INNER_PX + OUTER_PX  # of balls below which normals show little beside the edges themselves
SAMPLE_STEP_PX = 0.5  # between samples along a normal
SAMPLE_OFFSETS_PX = np.arange(-INNER_PX, OUTER_PX + SAMPLE_STEP_PX / 2, SAMPLE_STEP_PX)
EDGE_SAMPLE = int(INNER_PX / SAMPLE_STEP_PX)  # index of the sample on the outline
INNER_SAMPLES = EDGE_SAMPLE - 1  # samples inside the ball, clear of the edge
SHADING_STEPS = 3  # reweighted fits of a ball's shading, which finds its marks
MARK_LIMITS = (3.0, 0.1)  # a mark departs from the shading by standard deviations, and by a fraction of the brightness
RIDGE_WEIGHT = 1e-6  # keeps the fit of the shading solvable
ROUNDING_NOISE_GREY = 0.3  # the least noise of a picture: 1 / sqrt(12) by rounding [grey levels]
MODEL_STEP_PX = 0.05  # in which the blurred model is computed
SHARP_BLUR_PX = 0.85  # wider blurs are sampled more coarsely, over a longer part of the normal
STEPS_PER_OCTAVE = 4  # of sample spacings and of smears
MAX_DEPTH_FRACTION = 0.45  # of the radius, within which a ball is sampled
WIDTH_PER_SD = 12**0.5  # of the uniform distribution that a smear is
RESIDUAL_DOF = (11, 24)  # degrees of freedom along a normal in brightness and in colour
MAX_TINT = 0.22  # change of the table's colour beside a ball, as a fraction of its brightness
MIN_SHADE = -0.7  # change of the table's brightness beside a ball, as a fraction of it: the darkest shadow
MAX_SHADE = 0.3  # and the brightest light

Profile = tuple[Array, Array, Array]


@dataclass(frozen=True)
class Optics:
    """How lens and sensor show an outline."""

    edge_noise: tuple[float, float]  # that explains the scatter of edges in brightness and in colour [grey levels]
    blur: tuple[float, float] = (0.85, 0.85)  # of these edges, standard deviation [pixels]
    size: float = 0.0  # radius less the expected one [pixels]
    size_sd: float = 0.12  # standard deviation of `size` between outlines [pixels]
    sample_spacing: float = 0.0  # of the samples along normals; 0 to choose it by the blur


@lru_cache(maxsize=4096)
def _profile(radius: float, blur: float, shadow: bool) -> Profile:
    """For n samples along a normal: fraction covered by the ball (n,), projection matrix (n, k), and products (3,).

    The columns of the matrix: the two derivatives by a shift, orthogonal to the span of the free colours (`products`
    are their inner products); the pseudo-inverse that gives a, b and c; and an orthonormal basis of that span.
    """
    fine = np.arange(-INNER_PX - 5 * blur, OUTER_PX + 5 * blur, MODEL_STEP_PX)
    kernel = np.exp(-0.5 * (np.arange(-4 * blur, 4 * blur + MODEL_STEP_PX / 2, MODEL_STEP_PX) / blur) ** 2)
    inside = (fine < 0).astype(float)
    height = np.sqrt(np.maximum(0.0, 1 - np.maximum(0.0, 1 + fine / radius) ** 2)) * inside
    step, dome = (np.convolve(f, kernel / kernel.sum(), "same") for f in (inside, height))
    edge, slope = (np.interp(SAMPLE_OFFSETS_PX, fine, -np.gradient(f, MODEL_STEP_PX)) for f in (step, dome))
    coverage, dome = np.interp(SAMPLE_OFFSETS_PX, fine, step), np.interp(SAMPLE_OFFSETS_PX, fine, dome)
    # A shadow darkens without tinting, and may begin or end beside the ball.
    colours = [coverage, dome, 1 - coverage, *([(1 - coverage) * np.maximum(SAMPLE_OFFSETS_PX, -1)] if shadow else [])]
    basis = np.stack(colours, axis=1)
    q = np.linalg.qr(basis)[0]
    derivatives = np.stack([edge, slope], axis=1)
    derivatives = derivatives - q @ (q.T @ derivatives)
    d = derivatives
    products = np.array([d[:, 0] @ d[:, 0], d[:, 0] @ d[:, 1], d[:, 1] @ d[:, 1]])
    return coverage, np.concatenate([derivatives, np.linalg.pinv(basis).T[:, :3], q], axis=1), products


def _edge_shift(samples: Array, table: Array, kinds: NDArray[np.intp], profiles: Sequence[Profile]) -> Array:
    """Gradient, information, misfit and offset c of the table (4, rows) for samples and table (rows, n).

    The shift is gradient / information, its variance at a noise of one grey level 1 / information; the misfit is the
    sum of squares without a shift. `kinds` is the profile of each row.
    """
    out = np.empty((4, len(samples)))
    for kind, (coverage, columns, (ee, es, ss)) in enumerate(profiles):
        rows = slice(None) if len(profiles) == 1 else np.flatnonzero(kinds == kind)
        background = table[rows]
        y = samples[rows] - (1 - coverage) * background
        z = y @ columns
        contrast, shading = z[:, 2] - z[:, 4] - background[:, EDGE_SAMPLE], z[:, 3]
        out[0, rows] = contrast * z[:, 0] + shading * z[:, 1]
        out[1, rows] = contrast**2 * ee + 2 * contrast * shading * es + shading**2 * ss
        out[2, rows] = np.einsum("rn,rn->r", y, y) - np.einsum("rn,rn->r", z[:, 5:], z[:, 5:])
        out[3, rows] = z[:, 4]
    return out


def _kinds(
    optics: Optics, radii: Array, smear: Array
) -> tuple[Array, NDArray[np.intp], list[tuple[float, float, float]]]:
    """Sample spacings of normals (m, r), the kind of each (m * r,), and radius and blurs of every kind [samples]."""
    # Rounded, so that there are few kinds.
    octave = STEPS_PER_OCTAVE
    width = np.where(smear > 0, 2 ** (np.round(octave * np.log2(np.maximum(smear, 0.25))) / octave), 0.0) / WIDTH_PER_SD
    steps = np.ceil(octave * np.log2(np.maximum(np.hypot(max(optics.blur), width) / SHARP_BLUR_PX, 1.0)) - 1e-9)
    max_steps = np.maximum(np.floor(octave * np.log2(MAX_DEPTH_FRACTION * radii[:, None] / INNER_PX)), 0)
    spacing = 2 ** (np.minimum(steps, max_steps) / octave)
    if optics.sample_spacing:
        spacing = np.full(smear.shape, optics.sample_spacing)
    features = np.stack([np.broadcast_to(np.round(2 * radii)[:, None] / 2, smear.shape), width, spacing], axis=-1)
    if not smear.any():  # then all normals of a ball are of one kind
        kinds, kind_of = np.unique(features[:, 0], axis=0, return_inverse=True)
        kind_of = np.repeat(kind_of, smear.shape[1])
    else:
        kinds, kind_of = np.unique(features.reshape(-1, 3), axis=0, return_inverse=True)
    light, tint = optics.blur
    parameters = [(r / s, float(np.hypot(light, w) / s), float(np.hypot(tint, w) / s)) for r, w, s in kinds.tolist()]
    return spacing, kind_of.reshape(-1), parameters


def _axes(table: Array) -> Array:
    """Axes of colour (m, 3, 3), in columns: that of the table (m, 3), along which shadows act, and two across it."""
    b, g, r = table.T
    # A black table, as in a pocket, has no such axes and gives no information.
    flat = np.stack([-g, b + r, -g], axis=1) / np.maximum(np.hypot(np.sqrt(2) * g, b + r), 1e-9)[:, None]
    x, y, z = flat.T
    return np.stack([table, flat, np.stack([g * z - r * y, r * x - b * z, b * y - g * x], axis=1)], axis=2)


@dataclass(frozen=True)
class Edges:
    """Edges found along the normals of m outlines, (m, OUTLINE_NORMALS) each."""

    shift: Array  # of the edge outwards [pixels]
    information: Array  # inverse of its variance [1/pixel^2]
    each: list[tuple[Array, Array]]  # shift and information of brightness and of colour alone, at one grey level noise
    misfit: list[Array]  # mean squared residuals of brightness and of colour [grey levels^2]
    clear: NDArray[np.bool_]  # whether the table is visible beyond the edge
    brightness: Array  # (m, 1) of the table [grey levels]


def _unmarked(grey: Array, normals: Array) -> NDArray[np.bool_]:
    """Which normals (m, n, 2) begin on the colour of the ball, not on a mark, by grey levels there (m, n, k).

    The shading of a ball is linear in the normal (Lambert's law and an ambient part).
    """
    level = grey.transpose(0, 2, 1)
    x = np.concatenate([np.ones((*normals.shape[:2], 1)), normals], axis=2)[:, None]
    model = np.median(level, axis=2, keepdims=True)
    for _ in range(SHADING_STEPS):
        residual = np.abs(level - model)
        spread = np.maximum(1.48 * np.median(residual, axis=2, keepdims=True), ROUNDING_NOISE_GREY)
        limit = np.maximum(MARK_LIMITS[0] * spread, MARK_LIMITS[1] * np.abs(model))
        weighted = (x * np.maximum(0.0, 1 - (residual / limit) ** 2)[..., None]).transpose(0, 1, 3, 2)
        model = (x @ np.linalg.solve(weighted @ x + RIDGE_WEIGHT * np.eye(3), weighted @ level[..., None]))[..., 0]
    unmarked = (np.abs(level - model) < limit).all(axis=1)
    return np.asarray(unmarked & np.roll(unmarked, 1, axis=1) & np.roll(unmarked, -1, axis=1))


def find_edges(view: View, optics: Optics, rim: Array, normals: Array, heights: Array, smears: Array) -> Edges:
    """Find edges along normals at points (m, n, 2) of outlines that move by `smears` (m, 2) in exposure [pixels]."""
    h, w = view.picture.shape[:2]
    m, n = len(rim), len(SAMPLE_OFFSETS_PX)
    radii = np.linalg.norm(rim - rim.mean(axis=1, keepdims=True), axis=2).mean(axis=1)
    spacing, kind_of, kinds = _kinds(optics, radii, np.abs(normals @ smears[:, :, None])[..., 0])
    points = rim[:, :, None] + (spacing[..., None] * SAMPLE_OFFSETS_PX)[..., None] * normals[:, :, None]
    points = points.astype(np.float32)
    positions = points.reshape(m * OUTLINE_NORMALS, n, 2)
    samples, table = (
        cv2.remap(v, positions, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        for v in (view.picture, view.table)
    )
    samples = samples.reshape(m, -1, 3).astype(np.float32)
    table = (table * view.gain.astype(np.float32)).reshape(m, -1, 3)
    unmarked = _unmarked(samples.reshape(m, OUTLINE_NORMALS, n, 3)[:, :, :INNER_SAMPLES:2].mean(axis=3), normals)
    colour = table.reshape(m, OUTLINE_NORMALS, n, 3)[:, :, EDGE_SAMPLE].mean(axis=1)
    brightness = np.maximum(np.linalg.norm(colour, axis=1, keepdims=True), 1.0)
    samples, table = (
        (v @ _axes(colour / brightness)).transpose(2, 0, 1).reshape(3, m * OUTLINE_NORMALS, n) for v in (samples, table)
    )
    light = _edge_shift(samples[0], table[0], kind_of, [_profile(r, b, True) for r, b, _ in kinds])
    tint_profiles = [_profile(r, b, False) for r, _, b in kinds]
    tint = _edge_shift(samples[1:].reshape(-1, n), table[1:].reshape(-1, n), np.tile(kind_of, 2), tint_profiles)
    light, tint = light.reshape(4, m, OUTLINE_NORMALS), tint.reshape(4, 2, m, OUTLINE_NORMALS)
    parts = (light[:3], tint[:3].sum(axis=1))
    information = np.maximum(sum(h / v**2 for (_, h, _), v in zip(parts, optics.edge_noise, strict=True)), 1e-9)
    shift = sum(p / v**2 for (p, _, _), v in zip(parts, optics.edge_noise, strict=True)) / information
    misfit = [(r - 2 * shift * p + shift**2 * h) / free for (p, h, r), free in zip(parts, RESIDUAL_DOF, strict=True)]
    each = [(spacing * p / np.maximum(h, 1e-9), h / spacing**2) for p, h, _ in parts]
    tint_change, shade = np.abs(tint[3]).max(axis=0) / brightness, light[3] / brightness
    clear = unmarked & (tint_change < MAX_TINT) & (shade > MIN_SHADE) & (shade < MAX_SHADE)
    column, row = rim[..., 0].round().astype(int).clip(0, w - 1), rim[..., 1].round().astype(int).clip(0, h - 1)
    clear &= ~(view.geometry.behind_noses[row, column] & (heights < NOSE_HEIGHT * view.geometry.camera.radius))
    x, y = points[:, :, -1, 0], points[:, :, -1, 1]
    clear &= (x >= 0) & (x <= w - 1) & (y >= 0) & (y <= h - 1)
    return Edges(spacing * shift, information / spacing**2, each, misfit, clear, brightness)
