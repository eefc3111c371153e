"""The noise of the detections, from the tracks themselves.

In: the tracked scene. Out: `Noise`. Third differences of smooth motion give the noise: the motion of a ball vanishes in
them except at impacts, which are far larger than usual and left out. Two joined parabolas, a sliding one and a rolling
one, through several detections leave more where errors last over some frames, as those of compressed pictures do; the
larger of both is taken. The scatter of balls at rest is given beside it; it is smaller where the error of a detector
depends on where a ball lies on the grid of pixels.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sysid.vision.camera.projection import Array
from sysid.vision.tracks.following.follow import BallTrack
from sysid.vision.tracks.moves import TrackedScene

DEFAULT_NOISE_RADII = 0.01  # standard deviation to use where it cannot be estimated, in ball radii
MIN_DIFFERENCES = 50  # that make an estimate of the noise
SWAY_TURNS = 2.0  # of a ball, over which correlated errors are estimated
MIN_SWAY_FRAMES = 10  # of such a segment
MIN_SWAY_SEGMENTS = 3  # of a ball
IMPACT_FACTOR = 8.0  # third differences above this many times the noise are impacts
CLEAR_QUANTILE = 0.25  # fraction of the segments that contain no impact, at least
USUAL_SD = 3.5  # standard deviations, beyond which third differences are unusual
USUAL_ROUNDS = 5  # in which the usual ones and their standard deviation are found in turn
PARABOLA_FRAMES = 9  # in a row, to which two joined parabolas are fitted,
PARABOLA_STRIDE = 4  # from the first of them to that of the next
PARABOLA_FREEDOM = 2 * (PARABOLA_FRAMES - 4) - 1  # that is left: four unknowns of each axis and the knot are fitted
MIN_PARABOLAS = 4  # fits that make an estimate
MAX_USUAL_VARIANCE = 4.0  # of a fit, over the median; more is no noise
INNER_KNOTS = np.linspace(-0.6, 0.6, 5)  # of so few detections
KNOT_POSITIONS = np.linspace(-0.8, 0.8, 9)  # at which a ball may cease to slide, in a segment from -1 to 1


@dataclass(frozen=True)
class Noise:
    """Standard deviation of the detections per axis; NaN where there were too few to estimate it."""

    moving: float  # [m]
    resting: float  # [m]
    balls: Mapping[str, float] = field(default_factory=dict)  # of each ball that moves [m]

    @property
    def sigma(self) -> float:
        """The estimate to use [m]."""
        return self.moving if math.isfinite(self.moving) else self.resting

    def text(self) -> str:
        """For the user."""
        kinds = {"moving": self.moving, "resting": self.resting}
        known = [f"{1e3 * sd:.3f} mm {name}" for name, sd in kinds.items() if math.isfinite(sd)]
        return "noise " + (", ".join(known) or "unknown: too few frames show a ball")


def estimate_noise(scene: TrackedScene) -> Noise:
    """Estimate the noise of the detections of a scene."""
    scatter = []
    for track in scene.tracks:
        for first, last in scene.resting[track.name]:
            if last - first >= 20:
                places = track.xy[first : last + 1]
                scatter.append((places - np.median(places, axis=0)).ravel())
    values = np.abs(np.concatenate(scatter)) if scatter else np.zeros(0)
    resting = float(np.median(values)) / 0.6745 if values.size >= MIN_DIFFERENCES else math.nan
    quick = difference_noise(scene, resting=False)
    variances = {track.name: _parabola_variances(scene, track, quick) for track in scene.tracks}
    moving = np.fmax(_typical_sd([v for values in variances.values() for v in values]), _correlated_noise(scene, quick))
    each = {name: _typical_sd(values) for name, values in variances.items()}
    known = {name: sd for name, sd in each.items() if math.isfinite(sd)}
    return Noise(float(np.fmax(_usual_rms(_differences(scene, resting=False)), moving)), resting, known)


def _typical_sd(variances: list[float]) -> float:
    """Root of the mean variance but for outlying ones [m]; NaN where there are few."""
    if len(variances) < MIN_PARABOLAS:
        return math.nan
    values = np.array(variances)
    return math.sqrt(float(np.mean(values[values <= MAX_USUAL_VARIANCE * np.median(values)])))


def _usual_rms(differences: Array) -> float:
    """Root mean square of absolute third differences (n,) without unusually large ones [m]; NaN where there are few.

    It scatters by less than the median does, which matters in films of few frames.
    """
    if differences.size < MIN_DIFFERENCES:
        return math.nan
    sd = float(np.median(differences)) / 0.6745
    for _ in range(USUAL_ROUNDS):
        sd = float(np.sqrt(np.mean(differences[differences <= USUAL_SD * sd] ** 2)))
    return sd


def _parabola_variances(scene: TrackedScene, track: BallTrack, quick: float) -> list[float]:
    """Variance per axis that two joined parabolas leave of some detections in a row of a moving ball [m^2]."""
    n, found = PARABOLA_FRAMES, []
    moving = ~scene.at_rest(track) & ~_impacts(track, quick if math.isfinite(quick) else math.inf)
    order = np.searchsorted(scene.frames, track.frame)
    k = 0
    while k + n <= len(order):
        part = slice(k, k + n)
        if order[k + n - 1] - order[k] > n - 1 or not moving[part].all():
            k += 1
            continue
        left = min(_parabola_residual(track.time[part], track.xy[part], knot) for knot in INNER_KNOTS)
        found.append(left / PARABOLA_FREEDOM)
        k += PARABOLA_STRIDE
    return found


def _correlated_noise(scene: TrackedScene, quick: float) -> float:
    """Error of moving balls that is correlated over several frames, as rotating marks cause it [m]; NaN if unknown.

    Residual of two parabolas, a sliding one and a rolling one joined to it, over two turns of a ball without an impact,
    which would exceed the noise `quick` [m] of third differences. The lower quartile of such segments is taken, as some
    contain an impact too weak to show; of the balls, the largest value.
    """
    residual: dict[str, list[float]] = {}
    for track in scene.tracks:
        at_rest = scene.at_rest(track)
        impact = _impacts(track, quick)
        path_length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(track.xy, axis=0), axis=1))])
        k = 0
        while k < len(path_length):
            stop = int(np.searchsorted(path_length, path_length[k] + SWAY_TURNS * 2 * math.pi * scene.radius))
            first_impact = k + int(np.argmax(impact[k:stop])) if impact[k:stop].any() else stop
            if first_impact < stop:
                k = first_impact + 1
                continue
            part, k = slice(k, stop), max(stop, k + 1)
            count = stop - part.start
            whole = count >= MIN_SWAY_FRAMES and track.frame[stop - 1] - track.frame[part.start] == count - 1
            if stop < len(path_length) and whole and not at_rest[part].any():
                best = min(_parabola_residual(track.time[part], track.xy[part], knot) for knot in KNOT_POSITIONS)
                residual.setdefault(track.name, []).append(float(np.sqrt(best / 2 / (count - 5))))
    well_sampled = [values for values in residual.values() if len(values) >= MIN_SWAY_SEGMENTS]
    return max((float(np.quantile(values, CLEAR_QUANTILE)) for values in well_sampled), default=math.nan)


def _impacts(track: BallTrack, quick: float) -> NDArray[np.bool_]:
    """Which detections (n,) are near an impact, which exceeds the noise `quick` [m] of third differences."""
    found = np.zeros(len(track.time), bool)
    if len(track.time) >= 4:
        difference = np.abs(_weighted_sums(track.time, track.xy, _difference_weights(track.time, 4))).max(axis=1)
        for at in np.flatnonzero(~(difference < IMPACT_FACTOR * quick)):
            found[at : at + 4] = True
    return found


def _parabola_residual(time: Array, xy: Array, knot: float) -> float:
    """Residual sum of squares of two smoothly joined parabolas fitted to places (n, 2) at times (n,) [m^2].

    The `knot` between them is in -1 to 1, the first time and the last.
    """
    time = 2 * (time - time[0]) / (time[-1] - time[0]) - 1
    basis = np.column_stack([np.vander(time, 3), np.maximum(time - knot, 0.0) ** 2])
    return float(np.sum((xy - basis @ np.linalg.lstsq(basis, xy, rcond=None)[0]) ** 2))


def _difference_weights(time: Array, count: int) -> Array:
    """Weights (n - count + 1, count) of unit length of divided differences of `count` samples in a row.

    Polynomials of degree count - 2 vanish in them, at whatever times (n,); what is left is noise.
    """
    rows = np.lib.stride_tricks.sliding_window_view(time, count)
    rows = (rows - rows[:, :1]) / np.median(np.diff(time))
    intervals = rows[:, :, None] - rows[:, None, :] + np.eye(count)
    weights = 1.0 / intervals.prod(axis=2)
    return np.asarray(weights / np.linalg.norm(weights, axis=1, keepdims=True))


def _weighted_sums(time: Array, xy: Array, weights: Array) -> Array:
    """Weighted sums of samples (n, 2) in a row: (n - count + 1, 2); NaN where a sample is missing."""
    count = weights.shape[1]
    windows = np.lib.stride_tricks.sliding_window_view(xy, count, axis=0)
    whole = time[count - 1 :] - time[: len(time) - count + 1] < (count - 0.5) * np.median(np.diff(time))
    return np.where(whole[:, None], np.einsum("nki,ni->nk", windows, weights), np.nan)


def difference_noise(scene: TrackedScene, *, resting: bool) -> float:
    """Noise from third differences, with or without those of balls at rest [m]; NaN if there are few."""
    values = _differences(scene, resting=resting)
    return float(np.median(values)) / 0.6745 if values.size >= MIN_DIFFERENCES else math.nan


def _differences(scene: TrackedScene, *, resting: bool) -> Array:
    """Absolute third differences of all balls, with or without those of balls at rest: (n,) [m]."""
    found = []
    for track in scene.tracks:
        if len(track.time) < 4:
            continue
        differences = _weighted_sums(track.time, track.xy, _difference_weights(track.time, 4))
        if not resting:
            at_rest = scene.at_rest(track)
            differences[at_rest[:-3] | at_rest[1:-2] | at_rest[2:-1] | at_rest[3:]] = np.nan
        found.append(differences[np.isfinite(differences)])
    return np.abs(np.concatenate(found)) if found else np.zeros(0)


def residuals(time: Array, xy: Array) -> Array:
    """Distance of each detection (n, 2) from a cubic through its four neighbours (n,) [m]; NaN where one is missing."""
    distance = np.full(len(time), np.nan)
    if len(time) >= 5:
        weights = _difference_weights(time, 5)
        distance[2:-2] = np.linalg.norm(_weighted_sums(time, xy, weights), axis=1) / np.abs(weights[:, 2])
    return distance
