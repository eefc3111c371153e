"""The tip of a cue along its axis, in every picture.

In: pictures and the axis of the cue. Out: distances of the tip from its contact with the ball. The tip is the end of
what is not there when the cue is drawn back: the same pattern is shifted in every picture until it fits (least squares
along the axis), so that the look of the leather biases all pictures alike, and not the speed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from sysid.vision.camera.projection import Array, Camera
from sysid.vision.cue.axis import EDGE_LENGTH_M, MIN_CONTRAST_GREY, CueAxis, plane_pixels, sample_colours
from sysid.vision.cue.line import SAMPLES_PER_PIXEL
from sysid.vision.sources.pictures import Picture

FRONT_SAMPLES = 4 * SAMPLES_PER_PIXEL  # before the tip, and
TIP_SAMPLES = 9 * SAMPLES_PER_PIXEL  # of the tip, that are compared
ALIGNMENT_ROUNDS = 12  # of shifting the pattern


def tip_distances(axis: CueAxis, contact: float, pictures: Sequence[Picture], camera: Camera, scale: float) -> Array:
    """Distance of the tip from its contact with the ball, in every picture (n,) [m]; NaN where it is not seen."""
    step = scale / SAMPLES_PER_PIXEL
    behind = np.arange(contact - 0.01, contact + EDGE_LENGTH_M, step)
    pixels = plane_pixels(camera, axis.points(behind, np.linspace(-0.0025, 0.0025, 5)))
    seen = np.array([sample_colours(p, pixels).mean(axis=1) for p in pictures])  # (n, m, c)
    seen = seen[:, np.cumsum(~np.isfinite(seen).all(axis=(0, 2))) == 0]  # up to the edge of the pictures
    if seen.shape[1] <= TIP_SAMPLES:
        return np.full(len(seen), np.nan)
    place, empty = _onsets(seen, SAMPLES_PER_PIXEL)
    use = np.flatnonzero(np.isfinite(place))
    if len(use) < 2:
        return np.full(len(seen), np.nan)
    window = np.arange(-FRONT_SAMPLES, TIP_SAMPLES)
    tip = 0.0
    for _ in range(ALIGNMENT_ROUNDS):
        windows = np.array([_interpolated(seen[k], place[k] + window) for k in use])
        hidden = np.array([_interpolated(empty, place[k] + window) for k in use])
        cover, tip = _coverage(_mean(windows - hidden))
        # A sample shows the cue where coverage is 1, what the cue hides where it is 0, and a mixture between.
        share = cover[:, None]
        hidden = np.where(share < 1, hidden, 0.0)
        cue_colour = _mean(windows - (1 - share) * hidden)
        residual = windows - (1 - share) * hidden - cue_colour
        derivative = np.gradient(cover)[:, None] * hidden - np.gradient(cue_colour, axis=0)
        derivative = np.where(np.isfinite(residual), derivative, 0.0)
        residual = np.where(np.isfinite(residual), residual, 0.0)
        shift = np.sum(derivative * residual, axis=(1, 2)) / (np.sum(derivative**2, axis=(1, 2)) + 1e-9)
        place[use] += np.clip(shift, -3.0, 3.0)
    return np.asarray(behind[0] - contact + (place + window[0] + tip) * step)


def _mean(values: Array) -> Array:
    """Mean of the finite values over the first axis; 0 where there are none."""
    known = np.isfinite(values)
    return np.asarray(np.where(known, values, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1))


def _coverage(change: Array) -> tuple[Array, float]:
    """Coverage by the cue along its axis (k,), 0 to 1, and the index at which it is a half."""
    full = change[-1]
    width = 3 * SAMPLES_PER_PIXEL
    for first in range(FRONT_SAMPLES + 2 * SAMPLES_PER_PIXEL, len(change) - width, width):
        full = np.median(change[first : first + width], axis=0)
        if full @ full > MIN_CONTRAST_GREY**2:
            break
    coverage = np.clip(change @ full / max(float(full @ full), 1e-9), 0.0, 1.0)
    half = max(int(np.argmax(coverage > 0.5)), 1)
    whole = half + int(np.argmax(coverage[half:] > 0.98))
    coverage[whole:] = 1.0
    return coverage, half - 1 + float((0.5 - coverage[half - 1]) / max(coverage[half] - coverage[half - 1], 1e-9))


def _interpolated(change: Array, at: Array) -> Array:
    """Samples (m, c) interpolated at fractional indices (k,): (k, c); NaN outside."""
    return np.stack([np.interp(at, np.arange(len(change)), colour, np.nan, np.nan) for colour in change.T], axis=1)


def _onsets(seen: Array, pixel: int) -> tuple[Array, Array]:
    """Index at which the cue begins along its axis in pictures (n, m, c): (n,), and the background there: (m, c)."""
    noise = 1.4826 * float(np.median(np.abs(np.diff(seen, axis=0)))) / math.sqrt(2)
    limit = max(MIN_CONTRAST_GREY, 6.0 * noise)
    # The background is visible where the cue is drawn back, farthest in one of the pictures.
    changed = np.sqrt(np.sum((seen - seen[-1]) ** 2, axis=2)) > limit
    back = int(np.argmax(changed.sum(axis=1)))
    differs = np.sqrt(np.sum((seen - seen[back]) ** 2, axis=2)) > limit
    # Two pixels in a row: one may be noise.
    runs = np.all(np.lib.stride_tricks.sliding_window_view(differs, 2 * pixel, axis=1), axis=2)
    onset = np.where(runs.any(axis=1), runs.argmax(axis=1), np.nan)
    known = max(int(np.flatnonzero(runs.any(axis=0)).max(initial=0)) - 2 * pixel, 0)
    empty = np.full(seen.shape[1:], np.nan)
    clear = np.arange(known)[None, :] < np.where(np.isfinite(onset), onset, known)[:, None] - 4 * pixel
    clear[back] = True
    empty[:known] = np.sum(seen[:, :known] * clear[..., None], axis=0) / clear.sum(axis=0)[:, None]
    onset[onset > known - 4 * pixel] = np.nan
    return onset, empty
