"""When the pictures of a film were taken, where their stamps are wrong.

In: the tracks, at times of stamps, and which pictures are the ones before, stored again. Out: tracks, frames and times
without these, set right by the steps of the balls, and what to report of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.vision.camera.projection import Array, Camera
from sysid.vision.tracks.following.follow import BallTrack
from sysid.vision.tracks.moves import TrackedScene
from sysid.vision.tracks.noise import DEFAULT_NOISE_RADII, difference_noise
from sysid.vision.tracks.strays import without_strays
from sysid.vision.tracks.times.picks import find_picks
from sysid.vision.tracks.times.rates import even_times, regular_gaps
from sysid.vision.tracks.times.stamps import delays, doubled, missing

MAX_LISTED = 8  # frames that are named


@dataclass(frozen=True)
class TimedTracks:
    """The balls of a film, and when its different pictures were taken."""

    tracks: Sequence[BallTrack]
    frames: NDArray[np.int64]  # (n,) that show another picture than the one before
    times: Array  # (n,) [s]
    notes: tuple[str, ...] = ()  # what was set right
    rate: float | None = None  # pictures taken in a second, where it is not the film's [1/s]

    def without(self, left_out: NDArray[np.bool_]) -> TimedTracks:
        """What is left without some of the frames (n,)."""
        tracks = self.tracks
        if left_out.any():
            tracks = [track.without(np.isin(track.frame, self.frames[left_out])) for track in tracks]
        tracks = [track for track in tracks if len(track.frame)]
        return replace(self, tracks=tracks, frames=self.frames[~left_out], times=self.times[~left_out])

    def at(self, times: Array, *notes: str) -> TimedTracks:
        """The same at other times (n,) [s]."""
        late = times - self.times
        tracks = [replace(t, time=t.time + late[np.searchsorted(self.frames, t.frame)]) for t in self.tracks]
        return replace(self, tracks=tracks, times=times, notes=(*self.notes, *notes))

    def scene(self, camera: Camera, sigma: float) -> TrackedScene:
        """The same with the table, and a standard deviation of detections [m]."""
        return TrackedScene(self.tracks, self.frames, self.times, camera.table, camera.radius, sigma)

    def resting_noise(self, camera: Camera) -> float:
        """Of balls at rest, per axis [m]; a usual value where none rests."""
        if len(self.times) < 2 or not self.tracks:
            return math.nan
        sigma = difference_noise(self.scene(camera, 0.0), resting=True)
        return sigma if math.isfinite(sigma) else DEFAULT_NOISE_RADII * camera.radius


def set_right(found: TimedTracks, twice: NDArray[np.bool_], camera: Camera) -> TimedTracks:
    """Tracks at the times at which the pictures were taken, without pictures that were stored again.

    Args:
        found: all tracks, at times of stamps.
        twice: which pictures (n,) are the ones before, by themselves.
        camera: that took them.
    """
    again = found.frames[twice].tolist()
    found = found.without(twice)
    sigma = found.resting_noise(camera)
    still = doubled(found.tracks, found.frames, sigma)
    if still.any():
        again = sorted([*again, *found.frames[still].tolist()])
        found = found.without(still)
        sigma = found.resting_noise(camera)
    if again:
        found = replace(found, notes=(f"{_listed(again)} the same picture as the frame before: left out",))
    if len(found.times) < 2 or not found.tracks:
        return found
    period = float(np.median(np.diff(found.times)))
    picks = find_picks(found.tracks, found.frames, found.times, period, sigma)
    if picks is not None:
        return found.at(found.times + picks.delays(found.frames, found.times, period), picks.text(period))
    even = even_times(found.tracks, found.frames, found.times, sigma)
    if even is not None:
        times, period = even
        found = found.at(times, f"pictures were taken at a constant {1 / period:.3g} frames/s: times corrected")
        found = replace(found, rate=1 / period)
    gaps = _gaps(found, period, found.scene(camera, sigma))
    conversion = regular_gaps(gaps)
    if conversion is not None:
        found = found.at(conversion.source_times(found.frames, found.times, period), conversion.text(period))
        period *= conversion.share
        found = replace(found, rate=1 / period)
        gaps = _gaps(found, period, found.scene(camera, sigma))
    notes = [f"before frame {f} {n} missing, though stamps are even: later stamps corrected" for f, n in gaps.items()]
    return found.at(found.times + delays(found.frames, gaps, period), *notes)


def _gaps(found: TimedTracks, period: float, scene: TrackedScene) -> dict[int, int]:
    """Missing pictures, by the frame after them, of a film with pictures at an interval [s]."""
    tracks = [without_strays(scene, track, []) for track in found.tracks]
    return missing(tracks, found.frames, period, scene.sigma)


def _listed(frames: Sequence[int]) -> str:
    """Frames in words, the first few by number."""
    first = ", ".join(str(f) for f in frames[:MAX_LISTED])
    rest = f" and {len(frames) - MAX_LISTED} more" if len(frames) > MAX_LISTED else ""
    return f"frame{'s' * (len(frames) > 1)} {first}{rest} show{'s' * (len(frames) == 1)}"
