"""Outlines of balls fitted to a picture: centre, radius and how well they are known, to a fraction of a pixel.

In: a picture beside the background, and initial centres. Out: `OutlineFit`; from the clearest of many, the blurs and
the edge noise of lens and sensor (`Optics`).

Along every normal to the outline that the camera expects, the picture is the colour of the ball inside and that of the
empty table outside, darkened at will; the edge between them is a linear least squares problem (edges.py). The outline
is shifted as a whole to where most normals agree. Normals that end on something else than the table (another ball, the
cue, a hand) do not count. Moving balls are also fitted with the blur of their motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.vision.balls.background import View
from sysid.vision.balls.candidates import candidates, motion_blurred
from sysid.vision.balls.edges import OUTER_PX, Optics, find_edges
from sysid.vision.balls.view_geometry import Array

REFIT_ROUNDS = 8  # at most, each at the centre that the last one found
REWEIGHT_STEPS = 5  # of robust least squares in a round
SETTLED_PX = 0.1  # a shift below this ends the rounds
MAX_LAST_SHIFT_PX = 0.25  # a larger last shift shows that there is no outline
NORMAL_ERROR_PX = 0.12  # error of a single edge by the light on the ball, standard deviation
CLOTH_COLOUR_ERROR = 0.02  # of the colour of the cloth beside a ball, as a fraction of its brightness
TUKEY_SCALE = 4.7  # robust standard deviations at which the biweight vanishes: 95 % efficiency for normal errors
MAX_EDGE_SD_PX = 0.6  # of an edge that counts as seen
MIN_EDGES = 8  # seen, that make an outline
MIN_COVERAGE = 0.3  # fraction of an outline seen, of a plausible ball
MIN_AGREEMENT = 0.6  # fraction of its visible part that agrees
MAX_CENTRE_SD_PX = 0.5  # of a plausible ball
FULL_COVERAGE = 0.7  # from which on a ball need not be filled
MIN_FOREGROUND = 0.5  # fraction of the disc that must be foreground below that coverage
FOREGROUND_DISC_RADII = 0.8  # radius of that disc
MIN_SEPARATION_RADII = 1.3  # between the centres of two balls
DOUBTFUL_QUALITY = 4.0  # [1/pixel], below which a fit is tried again
CLEAR_SCATTER_PX = 0.1  # smaller scatter does not improve the quality
MAX_RETRIES = 10  # outlines of a picture that are tried again
RETRY_DIRECTIONS = 6  # in which another initial centre is tried
RETRY_OFFSET_RADII = 0.3  # to that centre
SURE_COVERAGE = 0.6  # above which, together with
SURE_AGREEMENT = 0.9  # this agreement and
MAX_NOISE_RATIO = 2.2  # usual edge noise up to this factor, a fit is not doubtful
LOOSE_SCATTER_PX = 0.22  # from which on a ball may be moving
SMEAR_FRACTIONS = (0.75, 0.9, 1.1)  # of the motion that a blob shows, that are tried
MIN_QUALITY_RATIO = 1.1  # of a fit that replaces another
MIN_BLOB_SMEAR_RADII = 0.35  # motion from which on the centroid of the blob may be better than an outline
OPTICS_OUTLINES = 16  # the clearest ones, from which the optics are learnt
TRIED_BLURS_PX = (0.6, 0.72, 0.85, 1.0, 1.25, 1.6, 2.0, 2.6)  # of edges
BLUR_TEST_SPACING = 1.5  # of samples along normals, long enough to distinguish the blurs
MIN_EDGE_NOISE_GREY = 1.0
BLOB_SD = (0.1, 0.02)  # standard deviation of that centroid [pixels], and its growth with the motion


@dataclass(frozen=True)
class OutlineFit:
    """An outline fitted to a picture."""

    xy: Array  # (2,) centre [pixels]
    radius: float  # [pixels]
    size: float  # radius less the expected one [pixels]
    sd: float  # of the centre per axis [pixels]
    coverage: float = 1.0  # fraction of the outline that was seen and agrees
    agreement: float = 1.0  # fraction of its visible part, with the table beyond, that was seen and agrees
    scatter: float = 0.0  # of the edges about it, standard deviation [pixels]
    misfit: float = np.inf  # mean squared residual of brightness along its normals [grey levels^2]
    between: float = 0.0  # radius of the edges in colour less that of those in brightness [pixels]
    edge_noise: tuple[float, float] = (np.inf, np.inf)  # that explains the scatter of its edges, as in `Optics`

    @property
    def quality(self) -> float:
        """Figure of merit among outlines of the same ball [1/pixel]."""
        return self.coverage * self.agreement / max(self.scatter, CLEAR_SCATTER_PX)

    def doubtful(self, optics: Optics) -> bool:
        """Whether it may be misplaced: its quality is poor, and the noise of the pictures does not explain it."""
        if self.quality > DOUBTFUL_QUALITY:
            return False
        pairs = zip(self.edge_noise, optics.edge_noise, strict=True)
        explained = all(noise < MAX_NOISE_RATIO * usual_noise for noise, usual_noise in pairs)
        return not (explained and self.coverage > SURE_COVERAGE and self.agreement > SURE_AGREEMENT)


def _robust_shift(
    normals: Array, edge_shift: Array, variance: Array, valid: NDArray[np.bool_], optics: Optics
) -> tuple[Array, Array, Array]:
    """Robust shift and growth (m, 3) of outlines (Tukey's biweight), covariances (m, 3, 3), weights (m, n)."""
    x = np.concatenate([normals, np.ones((*edge_shift.shape, 1))], axis=2)
    prior = np.diag([1e-3, 1e-3, optics.size_sd**-2])
    weight, root = valid.astype(float), np.sqrt(variance)
    middle = np.maximum(valid.sum(axis=1, keepdims=True) - 1, 0) // 2
    for _ in range(REWEIGHT_STEPS):
        weighted = (x * (weight / variance)[..., None]).transpose(0, 2, 1)
        cov = np.linalg.inv(weighted @ x + prior)
        p = cov @ (weighted @ edge_shift[..., None])
        residual = np.abs(edge_shift - (x @ p)[..., 0]) / root
        scale = 1.48 * np.take_along_axis(np.sort(np.where(valid, residual, np.inf), axis=1), middle, axis=1)
        scale = np.where(np.isfinite(scale), np.maximum(scale, 1.0), 1.0)
        weight = valid * np.maximum(0.0, 1 - (residual / (TUKEY_SCALE * scale)) ** 2) ** 2
    return p[..., 0], cov * scale[..., None] ** 2, weight


def fit_outlines(
    view: View, optics: Optics, starts: Sequence[Array], smears: Sequence[Array] | None = None
) -> list[OutlineFit | None]:
    """Fit expected outlines to the picture, from initial centres (2,) [pixels]; None where no outline is found.

    `smears` (2,) [pixels] are the motions of the balls during the exposure, if any.
    """
    if len(starts) == 0:
        return []
    centres = np.array(starts, float).reshape(-1, 2)
    motions = np.zeros_like(centres) if smears is None else np.array(smears, float).reshape(-1, 2)
    for _ in range(REFIT_ROUNDS):
        shapes = [view.geometry.outline(c) for c in centres]
        offsets, normals, heights = (np.stack(v) for v in zip(*shapes, strict=True))
        edges = find_edges(view, optics, centres[:, None] + offsets + optics.size * normals, normals, heights, motions)
        misfit = sum(r / v**2 for r, v in zip(edges.misfit, optics.edge_noise, strict=True))
        inflation = np.maximum(1.0, misfit / np.maximum(np.median(misfit, axis=1, keepdims=True), 1.0) / 1.2) ** 2
        variance = (1 + (CLOTH_COLOUR_ERROR * edges.brightness / optics.edge_noise[0]) ** 2) / edges.information
        edge_shift = edges.shift.clip(-OUTER_PX, OUTER_PX)
        shift, cov, weight = _robust_shift(
            normals, edge_shift, inflation * (variance + NORMAL_ERROR_PX**2), edges.clear, optics
        )
        centres = centres + shift[:, :2].clip(-OUTER_PX, OUTER_PX)
        if np.abs(shift[:, :2]).max() < SETTLED_PX:
            break
    agreeing = edges.clear & (variance < MAX_EDGE_SD_PX**2) & (weight > 0.3)
    # An error of the cloth's colour shifts a whole side, the more so the less ball and cloth differ.
    colour_error = CLOTH_COLOUR_ERROR / 2 * edges.brightness[:, 0] / optics.edge_noise[0]
    common_variance = colour_error**2 / np.median(edges.information, axis=1)
    sd = np.sqrt((cov[:, 0, 0] + cov[:, 1, 1]) / 2 + common_variance)
    model = np.einsum("mrk,mk->mr", normals, shift[:, :2]) + shift[:, 2:]
    found: list[OutlineFit | None] = []
    for k, mask in enumerate(agreeing):
        if mask.sum() < MIN_EDGES or np.abs(shift[k, :2]).max() > MAX_LAST_SHIFT_PX:
            found.append(None)
            continue
        size = float(optics.size + shift[k, 2])
        radius = float(np.linalg.norm(offsets[k], axis=1).mean()) + size
        scatter = 1.48 * float(np.median(np.abs(edge_shift - model)[k, mask]))
        light, tint = (1.48 * float(np.median((np.abs(e - model) * np.sqrt(v))[k, mask])) for e, v in edges.each)
        found.append(
            OutlineFit(
                centres[k], radius, size, float(sd[k]), float(mask.mean()), float(mask.sum() / edges.clear[k].sum()),
                scatter, float(np.median(edges.misfit[0][k, mask])),
                float(np.median((edges.each[1][0] - edges.each[0][0])[k, mask])), (light, tint),
            )
        )  # fmt: skip
    return found


def fit_near(view: View, optics: Optics, starts: Sequence[Array]) -> list[OutlineFit | None]:
    """As `fit_outlines`, for initial centres a few pixels off and moving balls: doubtful fits are tried again."""
    best = fit_outlines(view, optics, starts)
    owners: list[int] = []
    tries: list[tuple[Array, Array]] = []
    for k in [k for k, fit in enumerate(best) if fit is None or fit.doubtful(optics)][:MAX_RETRIES]:
        fit, radius = best[k], view.geometry.radius(starts[k])
        blur = motion_blurred(view, starts[k]) if fit is None or fit.scatter > LOOSE_SCATTER_PX else None
        if blur is not None:
            middle, motion, proportionate = blur
            length = float(np.hypot(*motion))
            if proportionate and length > MIN_BLOB_SMEAR_RADII * radius:
                sd = BLOB_SD[0] + BLOB_SD[1] * length
                best[k] = _better(best[k], OutlineFit(middle, radius, 0.0, sd, scatter=BLOB_SD[0] + sd))
            retries = [(middle, part * motion) for part in SMEAR_FRACTIONS]
        else:
            angles = np.arange(RETRY_DIRECTIONS) * 2 * np.pi / RETRY_DIRECTIONS
            offsets = RETRY_OFFSET_RADII * radius * np.column_stack([np.cos(angles), np.sin(angles)])
            retries = [(starts[k] + offset, np.zeros(2)) for offset in offsets]
        owners, tries = owners + [k] * len(retries), tries + retries
    for k, fit in zip(owners, fit_outlines(view, optics, *zip(*tries, strict=True)) if tries else [], strict=True):
        best[k] = _better(best[k], fit)
    return best


def _better(one: OutlineFit | None, other: OutlineFit | None) -> OutlineFit | None:
    """The first fit, unless the second is clearly better."""
    return other if other and (one is None or other.quality > MIN_QUALITY_RATIO * one.quality) else one


def plausible(view: View, fit: OutlineFit | None, coverage: float = MIN_COVERAGE) -> bool:
    """Whether an outline can be that of a ball: well enough seen, and filled; no ring, if nearly all of it is seen."""
    if fit is None or fit.coverage < coverage or fit.agreement < MIN_AGREEMENT or fit.sd > MAX_CENTRE_SD_PX:
        return False
    if fit.coverage > FULL_COVERAGE:
        return not view.hollow(fit.xy, fit.radius)
    return view.foreground_fraction(fit.xy, FOREGROUND_DISC_RADII * fit.radius) > MIN_FOREGROUND


def balls(view: View, optics: Optics, coverage: float = MIN_COVERAGE) -> list[OutlineFit]:
    """All plausible outlines in a picture, none overlapping another."""
    kept: list[OutlineFit] = []
    fits = [fit for fit in fit_near(view, optics, candidates(view)) if fit and plausible(view, fit, coverage)]
    for fit in sorted(fits, key=lambda f: -f.quality):
        if all(np.hypot(*(fit.xy - k.xy)) > MIN_SEPARATION_RADII * k.radius for k in kept):
            kept.append(fit)
    return kept


def learn_optics(found: Sequence[tuple[View, OutlineFit]], optics: Optics) -> Optics:
    """Blurs and edge noise of lens and sensor, from the clearest outlines: the blurs with the least residual."""
    clean = sorted((f for f in found if np.isfinite(f[1].misfit)), key=lambda f: -f[1].quality)[:OPTICS_OUTLINES]

    def fitted(tried: Optics) -> list[tuple[View, OutlineFit]]:
        each = [(view, [fit.xy for v, fit in clean if v is view]) for view in {id(v): v for v, _ in clean}.values()]
        return [(view, fit) for view, at in each for fit in fit_outlines(view, tried, at) if fit is not None]

    def median_of(tried: Optics, of: Callable[[OutlineFit], float]) -> float:
        fits = fitted(tried)
        return float(np.median([of(fit) for _, fit in fits])) if 2 * len(fits) > len(clean) else np.inf

    if not clean:
        return replace(optics, size_sd=Optics.size_sd)
    # If the blur of colour is set too small, its edges seem to lie farther out. Along short normals every blur fits.
    pairs = []
    for light in TRIED_BLURS_PX:
        softer = [replace(optics, blur=(light, tint)) for tint in TRIED_BLURS_PX if tint >= light]
        pairs.append(min(softer, key=lambda tried: abs(median_of(tried, lambda fit: fit.between))))
    best = min(
        pairs, key=lambda tried: median_of(replace(tried, sample_spacing=BLUR_TEST_SPACING), lambda fit: fit.misfit)
    )
    optics = replace(optics, blur=best.blur)
    for size_sd in (optics.size_sd, optics.size_sd, Optics.size_sd):
        clean = fitted(optics) or clean
        edge_noise = np.maximum(np.median([fit.edge_noise for _, fit in clean], axis=0), MIN_EDGE_NOISE_GREY)
        size = float(np.median([fit.size for _, fit in clean]))
        optics = replace(optics, edge_noise=(float(edge_noise[0]), float(edge_noise[1])), size=size, size_sd=size_sd)
    return optics
