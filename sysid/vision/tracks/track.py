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

from models.messages import counted
from models.shot import Table
from sysid.clips.plausibility import MAX_OVERLAP_M, MIN_STRUCK_SAMPLES, POCKET_REACH
from sysid.vision.ahead import ahead
from sysid.vision.balls.colours.faces import ANY_BALL
from sysid.vision.balls.discs import Shutter
from sysid.vision.camera.camera_motion import SteadyView
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.tracks.following.follow import BallTrack, Follower
from sysid.vision.tracks.following.naming import named
from sysid.vision.tracks.following.retrace import Retracer
from sysid.vision.tracks.moves import TrackedScene
from sysid.vision.tracks.noise import DEFAULT_NOISE_RADII, Noise, difference_noise, estimate_noise
from sysid.vision.tracks.places import PlaceError, place_error
from sysid.vision.tracks.shots.running import running_shots
from sysid.vision.tracks.shots.spins import face_change, spins
from sysid.vision.tracks.shots.strikes import TrackedShot, split_shots
from sysid.vision.tracks.shots.unsaid import unsaid
from sysid.vision.tracks.strays import without_strays
from sysid.vision.tracks.times.picks import UNEVEN_SD, seem_uneven
from sysid.vision.tracks.times.picture_times import TimedTracks, set_right
from sysid.vision.tracks.times.stamps import marked

if TYPE_CHECKING:
    from sysid.vision.balls.detect import Detection, Detector
    from sysid.vision.balls.discs import Expected
    from sysid.vision.frames import Footage, Frame
    from sysid.vision.sources.pictures import Picture

    Watch = Callable[[Frame, Sequence[Detection]], None]

FULL_SEARCH_INTERVAL_S = 0.2  # between two searches of the whole picture
PROGRESS_INTERVAL_S = 0.2  # between two lines of progress
SAME_BALL_RADII = 1.2  # within which two detections are of the same ball
MAX_LOST_FRACTION = 0.5  # of the struck ball's frames without a detection, above which a clip is doubtful
MAX_NOISE_RADII = 0.15  # noise above which the result is doubtful, in ball radii
USUAL_FRAMES = 12  # the last ones, that show how often a picture is new
MAX_BEYOND_NOSE_M = 0.004  # of a detection beyond the nose line
NO_SHOT = "no shot was found, neither with its stroke nor in mid-motion"

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
    picture_rate: float | None = None  # pictures taken in a second, where it is not the film's [1/s]


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
        progress("frames seem to have been taken at uneven times: tracking the balls again")
        found = _followed(footage, camera, detector, counts, progress, shutter, watch, UNEVEN_SD / footage.fps)
    followed, names = named(found.tracks, footage, detector)
    timed = set_right(TimedTracks(followed, found.frames, found.times), found.twice, camera)
    result = tracked(timed.tracks, timed.frames, timed.times, camera, found.rate)
    return replace(result, notes=(*names, *timed.notes, *result.notes), picture_rate=timed.rate)


def while_steady(result: Tracked, view: SteadyView) -> Tracked:
    """The result without the shots during which the camera moves unseen."""
    moved = [view.moved_unseen(shot.first, shot.last) for shot in result.shots]
    left_out = [
        f"{_moment(result.scene, shot.time)}: the camera moves by {1e3 * by:.1f} mm while the cushions are hidden: "
        "left out"
        for shot, by in zip(result.shots, moved, strict=True) if by
    ]  # fmt: skip
    return replace(without_shots(result, [by > 0 for by in moved]), left_out=(*result.left_out, *left_out))


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

    def find(frame: Frame, expected: Sequence[Expected], full_search: bool) -> list[Detection]:
        return [] if frame.elsewhere else _detect(detector, frame.picture, expected, shutter, full_search)

    retracer = Retracer(follower, find)
    frames, times, twice = [], [], []
    began = reported = clock.monotonic()
    last_full_search, previous = -math.inf, None
    for frame, again in ahead(marked(footage)):
        frames.append(frame.index)
        times.append(frame.time)
        twice.append(again)
        if again:
            continue
        # A given exposure is a part of the time between frames; one that is estimated, of that between pictures.
        period = 1.0 / footage.fps if shutter.given is not None else _usual_interval(times, twice, 1.0 / footage.fps)
        expected = follower.expected(frame.time, period)
        full_search = not expected or follower.seeking or frame.time - last_full_search >= FULL_SEARCH_INTERVAL_S
        seen = find(frame, expected, full_search)
        if previous is not None:
            turned = [face_change(previous, frame.picture, s.xy, s.radius, detector.noise) for s in seen]
            seen = [replace(s, face_change=by) for s, by in zip(seen, turned, strict=True)]
        retracer.begin()
        follower.update(frame.index, frame.time, seen)
        retracer.end(frame, period)
        if watch is not None:
            watch(frame, seen)
        previous = frame.picture
        last_full_search = frame.time if full_search else last_full_search
        if (now := clock.monotonic()) - reported > PROGRESS_INTERVAL_S:
            reported, rate = now, len(frames) / (now - began)
            of = f" of {footage.count}" if footage.count else ""
            progress(f"{len(frames)}{of} frames, {rate:.0f} frames/s, {counted(follower.in_sight, 'ball')} in sight")
    if frames:
        retracer.finish(period)
    rate = len(frames) / max(clock.monotonic() - began, 1e-9)
    return _Followed(follower.tracks(), np.array(frames, np.int64), np.array(times), np.array(twice, bool), rate)


def _usual_interval(times: Sequence[float], twice: Sequence[bool], default: float) -> float:
    """Time between the last different pictures [s]."""
    fresh = [time for time, again in zip(times[-USUAL_FRAMES:], twice[-USUAL_FRAMES:], strict=True) if not again]
    return float(np.median(np.diff(fresh))) if len(fresh) > 2 else default


def _detect(
    detector: Detector, picture: Picture, expected: Sequence[Expected], shutter: Shutter, full_search: bool
) -> list[Detection]:  # fmt: skip
    """The expected balls, and all others where the whole picture is searched."""
    detections = list(detector.find(picture, expected, shutter)) if expected else []
    for one in detector.find(picture, taken=detections) if full_search else ():
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
    scene = replace(scene, tracks=[without_strays(scene, track, notes) for track in tracks])
    noise = estimate_noise(scene)
    if math.isfinite(noise.sigma):
        scene = replace(scene, sigma=max(noise.sigma, 1e-6))
    shots, left_out = _shots(scene) if len(frames) > 1 else ([], [])
    kept, doubts, omitted = [], [], left_out
    for shot in shots:
        found = _clip_tracks(shot, scene)
        gap = overlap(found, camera.radius)
        if gap < 2 * camera.radius - MAX_OVERLAP_M - 6 * scene.sigma:
            omitted.append(f"{_moment(scene, shot.time)}: balls {1e3 * gap:.1f} mm apart at the start: left out")
            doubts.append(f"at {shot.time:.2f} s balls overlap: check calibration and ball diameter")
            continue
        outside = {
            name: _off_table(track.xy[rows], camera.table, camera.diameter) for name, (track, rows) in found.items()
        }
        if count := sum(int(bad.sum()) for bad in outside.values()):
            doubts.append(f"at {shot.time:.2f} s {count} detections lie beyond the cushions: check calibration")
        found = {name: (track, rows[~outside[name]]) for name, (track, rows) in found.items()}
        fewest = {} if shot.running else {shot.struck: MIN_STRUCK_SAMPLES}
        found = {name: one for name, one in found.items() if one[1].size >= fewest.get(name, 1)}
        if shot.struck in found:
            kept.append((shot, found))
            lost = lost_frames(scene, shot, *found[shot.struck])
            if lost > MAX_LOST_FRACTION * (lost + found[shot.struck][1].size):
                doubts.append(f"shot {len(kept)}: {shot.struck} was lost in {lost} of its frames")
    if not tracks:
        doubts.append("no ball was found: check that the camera file and the palette belong to this video")
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
    struck = split_shots(scene)
    running, notes = running_shots(scene, struck)
    shots = [*struck.shots, *running]
    shots += spins(scene, shots)
    notes = [*struck.left_out, *notes]
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
