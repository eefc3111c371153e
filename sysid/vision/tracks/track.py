"""From footage to tracks and shots: detect, follow, remove outliers, split into shots, estimate the noise.

In: footage, its camera and a detector. Out: `Tracked`, whose shots clips.py makes into a clip set.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from models.shot import Table
from sysid.clips import Observation
from sysid.clips.outliers import find_outliers
from sysid.clips.plausibility import MAX_OVERLAP_M, POCKET_REACH
from sysid.vision.ahead import ahead
from sysid.vision.balls.discs import Shutter
from sysid.vision.balls.faces import ANY_BALL
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.tracks.follow import BallTrack, Follower
from sysid.vision.tracks.moves import TrackedScene
from sysid.vision.tracks.naming import named
from sysid.vision.tracks.noise import Noise, difference_noise, estimate_noise
from sysid.vision.tracks.picks import UNEVEN_SD, find_picks, seem_uneven
from sysid.vision.tracks.places import PlaceError, place_error
from sysid.vision.tracks.running import running_shots
from sysid.vision.tracks.spins import face_change, spins
from sysid.vision.tracks.stamps import delays, doubled, later, marked, missing
from sysid.vision.tracks.strikes import TrackedShot, split_shots
from sysid.vision.tracks.unsaid import unsaid

if TYPE_CHECKING:
    from sysid.vision.balls.detect import Detection, Detector
    from sysid.vision.frames import Footage, Frame, Picture

    Watch = Callable[[Frame, Sequence[Detection]], None]

FULL_SEARCH_INTERVAL_S = 0.2  # between two searches of the whole picture
PROGRESS_INTERVAL_S = 0.2  # between two lines of progress
SAME_BALL_RADII = 1.2  # within which two detections are of the same ball
DEFAULT_NOISE_RADII = 0.01  # standard deviation to use where it cannot be estimated, in ball radii
MAX_SD_RATIO = 8.0  # of a detection to the median; less accurate ones are not used
MAX_LOST_FRACTION = 0.5  # of the struck ball's frames without a detection, above which a clip is doubtful
MAX_NOISE_RADII = 0.15  # noise above which the result is doubtful, in ball radii
MAX_ASIDE_SD = 4.0  # of a place from the line between its neighbours, on which it may be early or late,
MAX_ASIDE_M = 1e-3  # or this far
USUAL_FRAMES = 12  # the last ones, that show how often a picture is new
MAX_LISTED = 8  # frames that are named
MAX_BEYOND_NOSE_M = 0.004  # of a detection beyond the nose line
NO_SHOT = "no shot was found, neither from a clean stroke on nor in mid-motion"

ClipTracks = Mapping[str, tuple[BallTrack, NDArray[np.int64]]]  # ball -> its track, and the indices of its detections


@dataclass(frozen=True)
class Tracked:
    """Tracks, shots and noise of a footage."""

    scene: TrackedScene
    shots: tuple[TrackedShot, ...]
    found: tuple[ClipTracks, ...]  # the tracks of each shot
    left_out: tuple[str, ...]  # messages on what became no shot
    noise: Noise
    doubts: tuple[str, ...]  # why the result is not to be trusted
    notes: tuple[str, ...]  # what was assumed or discarded, for the user
    rate: float  # of the tracking [frames/s]
    places: PlaceError  # of its clips


def track(
    footage: Footage, camera: Camera, detector: Detector, counts: Mapping[str, int],
    progress: Callable[[str], None] = lambda line: None, shutter: Shutter | None = None, watch: Watch | None = None,
) -> Tracked:  # fmt: skip
    """Track all balls of a footage and split their motion into shots.

    Args:
        footage: to be tracked.
        camera: that took it.
        detector: of the balls.
        counts: greatest number of balls by name.
        progress: called with what is being done.
        shutter: of the camera.
        watch: called with each frame and the balls detected in it.
    """
    shutter = shutter or Shutter()
    found = _followed(footage, camera, detector, counts, progress, shutter, watch, 0.0)
    if seem_uneven([*found.tracks], found.frames):
        progress("frames seem to be taken at uneven times: following the balls once more")
        found = _followed(footage, camera, detector, counts, progress, shutter, watch, UNEVEN_SD / footage.fps)
    followed, names = named(found.tracks, footage, detector)
    tracks, index, stamps, told = _stamped(followed, found.frames, found.times, found.twice, camera)
    result = tracked(tracks, index, stamps, camera, found.rate)
    return replace(result, notes=(*names, *told, *result.notes))


@dataclass(frozen=True)
class _Followed:
    """The balls of a footage, followed over its frames."""

    tracks: tuple[BallTrack, ...]
    frames: NDArray[np.int64]  # (m,)
    times: Array  # (m,) by stamps [s]
    twice: NDArray[np.bool_]  # (m,) which show the picture before once more
    rate: float  # [frames/s]


def _followed(
    footage: Footage, camera: Camera, detector: Detector, counts: Mapping[str, int], progress: Callable[[str], None],
    shutter: Shutter, watch: Watch | None, time_sd: float,
) -> _Followed:  # fmt: skip
    """Detect and follow all balls; the times of frames may be wrong, with a standard deviation `time_sd` [s]."""
    counts = counts if detector.palette is None else {ANY_BALL: sum(counts.values())}
    follower = Follower(camera, counts, time_sd=time_sd)
    frames, times, twice = [], [], []
    began = reported = clock.monotonic()
    last_full_search, previous = -math.inf, None
    for frame, again in ahead(marked(footage)):
        frames.append(frame.index)
        times.append(frame.time)
        twice.append(again)
        if again:
            continue
        expected = follower.expected(frame.time)
        full_search = not expected or follower.seeking or frame.time - last_full_search >= FULL_SEARCH_INTERVAL_S
        # A given exposure is a part of the time between frames; one that is estimated, of that between pictures.
        period = 1.0 / footage.fps if shutter.given is not None else _usual_interval(times, twice, 1.0 / footage.fps)
        seen = _detect(detector, frame.picture, expected, follower.steps(period), shutter, full_search)
        if previous is not None:
            turned = [face_change(previous, frame.picture, s.xy, s.radius, detector.noise) for s in seen]
            seen = [replace(s, face_change=by) for s, by in zip(seen, turned, strict=True)]
        follower.update(frame.index, frame.time, seen)
        if watch is not None:
            watch(frame, seen)
        previous = frame.picture
        last_full_search = frame.time if full_search else last_full_search
        if (now := clock.monotonic()) - reported > PROGRESS_INTERVAL_S:
            reported, rate = now, len(frames) / (now - began)
            of = f" of {footage.count}" if footage.count else ""
            progress(f"{len(frames)}{of} frames, {rate:.0f} frames/s, {follower.in_sight} balls in sight")
    rate = len(frames) / max(clock.monotonic() - began, 1e-9)
    return _Followed(follower.tracks(), np.array(frames, np.int64), np.array(times), np.array(twice, bool), rate)


def _usual_interval(times: Sequence[float], twice: Sequence[bool], default: float) -> float:
    """Time between the last different pictures [s]."""
    fresh = [time for time, again in zip(times[-USUAL_FRAMES:], twice[-USUAL_FRAMES:], strict=True) if not again]
    return float(np.median(np.diff(fresh))) if len(fresh) > 2 else default


def _stamped(
    tracks: Sequence[BallTrack], frames: NDArray[np.int64], times: Array, twice: NDArray[np.bool_], camera: Camera
) -> tuple[Sequence[BallTrack], NDArray[np.int64], Array, list[str]]:
    """Tracks, frames and times without doubled frames, those after missing ones later; and what to report of it."""
    again = frames[twice].tolist()
    tracks, frames, times = _without(twice, tracks, frames, times)
    sigma = _resting_noise(tracks, frames, times, camera)
    twice = doubled(tracks, frames, sigma)
    if twice.any():
        again = sorted([*again, *frames[twice].tolist()])
        tracks, frames, times = _without(twice, tracks, frames, times)
        sigma = _resting_noise(tracks, frames, times, camera)
    notes = [f"{_listed(again)} the same picture as before: left out"] if again else []
    if len(times) < 2 or not tracks:
        return tracks, frames, times, notes
    period = float(np.median(np.diff(times)))
    picks = find_picks(tracks, frames, times, period, sigma)
    if picks is not None:
        notes.append(picks.text(period))
        late = picks.delays(frames, times, period)
        tracks = [replace(t, time=t.time + late[np.searchsorted(frames, t.frame)]) for t in tracks]
        return tracks, frames, times + late, notes
    gaps = missing([_without_outliers(track, sigma, []) for track in tracks], frames, period, sigma)
    for frame, count in gaps.items():
        notes.append(f"before frame {frame} {count} missing, though stamps are even: later stamps set right")
    return later(tracks, gaps, period), frames, times + delays(frames, gaps, period), notes


def _without(
    left_out: NDArray[np.bool_], tracks: Sequence[BallTrack], frames: NDArray[np.int64], times: Array
) -> tuple[Sequence[BallTrack], NDArray[np.int64], Array]:
    """Tracks, frames and times (m,) without some of the frames (m,)."""
    if left_out.any():
        tracks = [_dropping(track, np.isin(track.frame, frames[left_out])) for track in tracks]
    return [track for track in tracks if len(track.frame)], frames[~left_out], times[~left_out]


def _resting_noise(tracks: Sequence[BallTrack], frames: NDArray[np.int64], times: Array, camera: Camera) -> float:
    """Of balls at rest, per axis [m]; a usual value where none rests."""
    if len(times) < 2 or not tracks:
        return math.nan
    sigma = difference_noise(TrackedScene(tracks, frames, times, camera.table, camera.radius, 0.0), resting=True)
    return sigma if math.isfinite(sigma) else DEFAULT_NOISE_RADII * camera.radius


def _listed(frames: Sequence[int]) -> str:
    """Frames in words, the first few by number."""
    first = ", ".join(str(f) for f in frames[:MAX_LISTED])
    rest = f" and {len(frames) - MAX_LISTED} more" if len(frames) > MAX_LISTED else ""
    return f"frame{'s' * (len(frames) > 1)} {first}{rest} show{'s' * (len(frames) == 1)}"


def _detect(
    detector: Detector, picture: Picture, expected: Sequence[tuple[str, Array]], steps: Sequence[Array],
    shutter: Shutter, full_search: bool,
) -> list[Detection]:  # fmt: skip
    """The expected balls, and all others where the whole picture is searched."""
    detections = list(detector.find(picture, expected, steps, shutter)) if expected else []
    for one in detector.find(picture) if full_search else ():
        if all(np.hypot(*(one.xy - other.xy)) > SAME_BALL_RADII * other.radius for other in detections):
            detections.append(one)
    return detections


def tracked(
    tracks: Sequence[BallTrack], frames: NDArray[np.int64], times: Array, camera: Camera, rate: float = math.nan
) -> Tracked:
    """Shots from the tracks of balls over frames (m,), taken at times (m,) [s]."""
    notes: list[str] = []
    scene = TrackedScene(tracks, frames, times, camera.table, camera.radius, 0.0)
    initial_noise = difference_noise(scene, resting=True)
    scene = replace(scene, sigma=initial_noise if math.isfinite(initial_noise) else DEFAULT_NOISE_RADII * camera.radius)
    scene = replace(scene, tracks=[_without_outliers(track, scene.sigma, notes) for track in tracks])
    noise = estimate_noise(scene)
    if math.isfinite(noise.sigma):
        scene = replace(scene, sigma=max(noise.sigma, 1e-6), rest_sigma=initial_noise)
    shots, left_out = _shots(scene) if len(frames) > 1 else ([], [])
    kept, doubts, omitted = [], [], left_out
    for shot in shots:
        found = _clip_tracks(shot, scene)
        gap = overlap(found, camera.radius)
        if gap < 2 * camera.radius - MAX_OVERLAP_M - 6 * scene.sigma:
            omitted.append(f"{_moment(scene, shot.time)}: balls {1e3 * gap:.1f} mm apart at the start: left out")
            doubts.append(f"at {shot.time:.2f} s balls are seen within each other: check calibration and ball diameter")
            continue
        outside = {
            name: _off_table(track.xy[rows], camera.table, camera.diameter) for name, (track, rows) in found.items()
        }
        if count := sum(int(bad.sum()) for bad in outside.values()):
            doubts.append(f"at {shot.time:.2f} s {count} detections lie beyond the cushions: check calibration")
        found = {name: (track, rows[~outside[name]]) for name, (track, rows) in found.items()}
        found = {name: one for name, one in found.items() if one[1].size}
        if shot.struck in found:
            kept.append((shot, found))
            lost = lost_frames(scene, shot, *found[shot.struck])
            if lost > MAX_LOST_FRACTION * (lost + found[shot.struck][1].size):
                doubts.append(f"shot {len(kept)}: {shot.struck} was lost in {lost} of its frames")
    if not tracks:
        doubts.append("no ball was found: check that camera file and palette belong to this video")
    elif not kept:
        doubts.append(NO_SHOT)
    if noise.sigma > MAX_NOISE_RADII * camera.radius:
        doubts.append(f"balls scatter by {1e3 * noise.sigma:.1f} mm: check focus, light and calibration")
    return Tracked(
        scene, tuple(shot for shot, _ in kept), tuple(found for _, found in kept), tuple(omitted), noise, tuple(doubts),
        tuple(notes), rate, place_error([found for _, found in kept], camera, noise.sigma, scene.period),
    )  # fmt: skip


def _shots(scene: TrackedScene) -> tuple[list[TrackedShot], list[str]]:
    """Shots, running clips and spins in place, in order of time, and messages on what was left out."""
    split = split_shots(scene)
    running, notes = running_shots(scene, split)
    shots = [*split.shots, *running]
    shots += spins(scene, shots)
    notes = [*split.left_out, *notes]
    notes += unsaid(scene, shots, notes)
    left_out = [f"{_moment(scene, time)}: {text}" for time, text in sorted(notes)]
    return sorted(shots, key=lambda shot: shot.time), left_out


def _moment(scene: TrackedScene, time: float) -> str:
    """A time [s] and the frame that was taken then, or last before."""
    k = max(int(np.searchsorted(scene.times, time + 0.1 * scene.period, side="right")) - 1, 0)
    return f"{time:.2f} s, frame {scene.frames[k]}"


def without_shots(result: Tracked, bad: Sequence[bool]) -> Tracked:
    """The result without some of the shots."""
    kept = [k for k, off in enumerate(bad) if not off]
    doubts = (*result.doubts, NO_SHOT) if result.shots and not kept else result.doubts
    shots, found = tuple(result.shots[k] for k in kept), tuple(result.found[k] for k in kept)
    return replace(result, shots=shots, found=found, doubts=doubts)


def _clip_tracks(shot: TrackedShot, scene: TrackedScene) -> ClipTracks:
    """The tracks that belong to the clip of a shot."""
    found = {}
    for track in scene.tracks:
        if track.name in shot.balls:
            stop = shot.potted.get(track.name, shot.last)
            found[track.name] = (track, np.flatnonzero((track.frame >= shot.first) & (track.frame <= stop)))
    return {name: found[name] for name in shot.balls}


def _without_outliers(track: BallTrack, sigma: float, notes: list[str]) -> BallTrack:
    """A track without inaccurate detections and outliers; appends to the notes."""
    inaccurate = track.sd > MAX_SD_RATIO * np.median(track.sd)
    track = _dropping(track, inaccurate) if inaccurate.any() else track
    outlying = find_outliers(Observation(track.time, track.xy, np.full(len(track.time), np.nan)), sigma)
    outlying &= ~_on_the_way(track.xy, max(MAX_ASIDE_SD * sigma, MAX_ASIDE_M))
    if count := int(inaccurate.sum() + outlying.sum()):
        notes.append(f"{track.name}: {count} detection{'s' * (count > 1)} too inaccurate or outlying: not used")
    return _dropping(track, outlying)


def _on_the_way(xy: Array, room: float) -> NDArray[np.bool_]:
    """Which places (n, 2) lie between their neighbours, on the line that joins them: early or late, but of the ball."""
    found = np.zeros(len(xy), bool)
    if len(xy) < 3:
        return found
    chord, offset = xy[2:] - xy[:-2], xy[1:-1] - xy[:-2]
    length = np.maximum(np.linalg.norm(chord, axis=1), 1e-9)
    along = np.sum(offset * chord, axis=1) / length
    aside = np.abs(offset[:, 0] * chord[:, 1] - offset[:, 1] * chord[:, 0]) / length
    found[1:-1] = (along > 0) & (along < length) & (aside < room)
    return found


def _dropping(track: BallTrack, dropped: NDArray[np.bool_]) -> BallTrack:
    """A track without some of its detections (n,)."""
    keep = ~dropped
    return replace(
        track, frame=track.frame[keep], time=track.time[keep], pixels=track.pixels[keep], xy=track.xy[keep],
        sd=track.sd[keep], radius=track.radius[keep], face_change=track.face_change[keep],
    )  # fmt: skip


def overlap(found: ClipTracks, radius: float) -> float:
    """Least distance between the first positions of two balls in a clip [m]."""
    places = np.array([track.xy[rows[0]] for track, rows in found.values() if rows.size])
    distances = np.linalg.norm(places[:, None] - places[None], axis=2) + 1e3 * radius * np.eye(len(places))
    return float(distances.min()) if distances.size else math.inf


def _off_table(xy: Array, table: Table, diameter: float) -> NDArray[np.bool_]:
    """Which positions (n, 2) are behind the cushions and in no pocket: (n,)."""
    over = np.abs(xy) - np.array([table.length, table.width]) / 2
    return np.asarray((over > MAX_BEYOND_NOSE_M).any(axis=1) & (table.to_pocket(xy) >= POCKET_REACH * diameter))


def lost_frames(scene: TrackedScene, shot: TrackedShot, track: BallTrack, rows: NDArray[np.int64]) -> int:
    """Number of frames of a clip in which a ball should have been detected and was not."""
    last = shot.potted.get(track.name, shot.last)
    return int(((scene.frames >= shot.first) & (scene.frames <= last)).sum()) - rows.size
