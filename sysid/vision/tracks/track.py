"""From footage to a clip set: detect, follow, split into shots, estimate the noise, write.

Third differences of smooth stretches give the noise: the motion of a ball vanishes in them but for what happens at
impacts, which their median ignores. The scatter of resting balls is told beside it; it is less where a detector errs by
where a ball lies on the pixels.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.shot import Table
from sysid.clips import Clip, ClipSet, Observation
from sysid.clips.outliers import spikes
from sysid.clips.plausibility import OVERLAP, POCKET_REACH
from sysid.vision.camera.projection import Array, Camera, ball_of
from sysid.vision.tracks.follow import Follower, Path
from sysid.vision.tracks.moves import Scene
from sysid.vision.tracks.spins import change, spins
from sysid.vision.tracks.strikes import Shot, split

if TYPE_CHECKING:
    from sysid.vision.balls.detect import Detection, Detector
    from sysid.vision.frames import Footage, Picture

WHOLE = 0.2  # between two searches of the whole picture [s]
SHOWN = 0.2  # between two lines of progress [s]
SAME = 1.2  # radii within which two sightings are the same ball
ENOUGH = 100  # third differences that make an estimate of the noise
TURNS, LEAST_SWAY, FEW_SWAYS = 2.0, 10, 3  # along which slow errors are looked for: turns, frames; how many such parts
KINK = 8.0  # times the noise, of third differences at impacts
CLEAR = 0.25  # part of such runs in which nothing was met, at least
KNOTS = np.linspace(-0.8, 0.8, 9)  # where a ball may cease to slide, in a run from -1 to 1
UNKNOWN = 0.01  # noise to go by where there is too little to tell, in radii
VAGUE = 5.0  # times the usual standard deviation: a sighting that is not used
LOST = 0.5  # part of the struck ball's frames without it that spoils a clip
ROUGH = 0.15  # noise that is not to be trusted, in radii
BEYOND = 0.004  # over the nose line [m]
EMPTY = "no shot was found that begins with a ball at rest and a clean stroke"

ClipTracks = Mapping[str, tuple[Path, NDArray[np.int64]]]  # ball -> its path, and which of its sightings


@dataclass(frozen=True)
class Noise:
    """Of the sightings, one standard deviation per axis; NaN where there was too little to tell."""

    moving: float  # [m]
    resting: float  # [m]

    @property
    def sigma(self) -> float:
        """What to go by [m]."""
        return self.moving if math.isfinite(self.moving) else self.resting


@dataclass(frozen=True)
class Extra:
    """What pictures tell of a shot beside places."""

    theta: Mapping[str, Array] = field(default_factory=dict)  # ball -> angle at each of its sightings in the clip [rad]
    tip: str = ""  # such as "cue tip 1.43 +- 0.01 m/s at 34.2 deg"


@dataclass(frozen=True)
class Tracked:
    """What was made of footage."""

    scene: Scene
    shots: tuple[Shot, ...]
    found: tuple[ClipTracks, ...]  # of each shot
    left_out: tuple[str, ...]
    noise: Noise
    doubts: tuple[str, ...]  # why the result is not to be trusted
    told: tuple[str, ...]  # what was assumed or done on the way
    rate: float  # of the tracking [frames/s]


def track(
    footage: Footage, camera: Camera, detector: Detector, counts: Mapping[str, int],
    progress: Callable[[str], None] = lambda line: None,
) -> Tracked:  # fmt: skip
    """Follow all balls of footage and split what they do into shots; `counts`: how many balls there can be by name."""
    follower = Follower(camera, counts)
    frames, times = [], []
    began = shown = clock.monotonic()
    looked, before = -math.inf, None
    for frame in footage:
        frames.append(frame.index)
        times.append(frame.time)
        expected = follower.expected(frame.time)
        whole = not expected or follower.seeking or frame.time - looked >= WHOLE
        seen = _look(detector, frame.picture, expected, whole)
        if before is not None:
            seen = [replace(s, change=change(before, frame.picture, s.xy, s.radius, detector.noise)) for s in seen]
        follower.take(frame.index, frame.time, seen)
        before = frame.picture
        looked = frame.time if whole else looked
        if (now := clock.monotonic()) - shown > SHOWN:
            shown, rate = now, len(frames) / (now - began)
            of = f" of {footage.count}" if footage.count else ""
            progress(f"{len(frames)}{of} frames, {rate:.0f} frames/s, {follower.in_sight} balls in sight")
    rate = len(frames) / max(clock.monotonic() - began, 1e-9)
    return tracked(follower.paths(), np.array(frames, np.int64), np.array(times), camera, rate)


def _look(
    detector: Detector, picture: Picture, expected: Sequence[tuple[str, Array]], whole: bool
) -> list[Detection]:  # fmt: skip
    """The balls expected, and with them all others where the whole picture is searched."""
    seen = list(detector.find(picture, expected)) if expected else []
    for one in detector.find(picture) if whole else ():
        if all(np.hypot(*(one.xy - other.xy)) > SAME * other.radius for other in seen):
            seen.append(one)
    return seen


def tracked(
    paths: Sequence[Path], frames: NDArray[np.int64], times: Array, camera: Camera, rate: float = math.nan
) -> Tracked:
    """Shots from the paths of balls over frames (m,), taken at times (m,) [s]."""
    told: list[str] = []
    scene = Scene(paths, frames, times, camera.table, camera.radius, 0.0)
    rough_noise = _third(scene, resting=True)
    scene = replace(scene, sigma=rough_noise if math.isfinite(rough_noise) else UNKNOWN * camera.radius)
    scene = replace(scene, paths=[_cleared(path, scene.sigma, told) for path in paths])
    noise = noise_of(scene)
    if math.isfinite(noise.sigma):
        scene = replace(scene, sigma=max(noise.sigma, 1e-6))
    shots, left_out = split(scene) if len(frames) > 1 else ((), ())
    shots = tuple(sorted([*shots, *spins(scene, shots)], key=lambda shot: shot.time))
    kept, doubts, out = [], [], list(left_out)
    for shot in shots:
        found = _sightings(shot, scene)
        near = overlap(found, camera.radius)
        if near < 2 * camera.radius - OVERLAP - 6 * scene.sigma:
            out.append(f"{shot.time:.2f} s: balls {1e3 * near:.1f} mm apart at the start: left out")
            doubts.append(f"at {shot.time:.2f} s balls are seen within each other: check calibration and ball diameter")
            continue
        outside = {name: _outside(path.xy[rows], camera.table, camera.diameter) for name, (path, rows) in found.items()}
        if count := sum(int(bad.sum()) for bad in outside.values()):
            doubts.append(f"at {shot.time:.2f} s {count} sightings lie beyond the cushions: check calibration")
        found = {name: (path, rows[~outside[name]]) for name, (path, rows) in found.items()}
        found = {name: one for name, one in found.items() if one[1].size}
        if shot.struck in found:
            kept.append((shot, found))
            lost = lost_frames(scene, shot, *found[shot.struck])
            if lost > LOST * (lost + found[shot.struck][1].size):
                doubts.append(f"shot {len(kept)}: {shot.struck} was lost in {lost} of its frames")
    if not paths:
        doubts.append("no ball was found: check that camera file and palette belong to this video")
    elif not kept:
        doubts.append(EMPTY)
    if noise.sigma > ROUGH * camera.radius:
        doubts.append(f"balls scatter by {1e3 * noise.sigma:.1f} mm: check focus, light and calibration")
    return Tracked(
        scene, tuple(shot for shot, _ in kept), tuple(found for _, found in kept), tuple(out), noise, tuple(doubts),
        tuple(told), rate,
    )  # fmt: skip


def without(result: Tracked, bad: Sequence[bool]) -> Tracked:
    """What was tracked but for some of the shots."""
    kept = [k for k, off in enumerate(bad) if not off]
    doubts = (*result.doubts, EMPTY) if result.shots and not kept else result.doubts
    shots, found = tuple(result.shots[k] for k in kept), tuple(result.found[k] for k in kept)
    return replace(result, shots=shots, found=found, doubts=doubts)


def _sightings(shot: Shot, scene: Scene) -> ClipTracks:
    """What goes into a shot's clip."""
    found = {}
    for path in scene.paths:
        if path.name in shot.balls:
            stop = shot.potted.get(path.name, shot.last)
            found[path.name] = (path, np.flatnonzero((path.frame >= shot.first) & (path.frame <= stop)))
    return {name: found[name] for name in shot.balls}


def _cleared(path: Path, sigma: float, told: list[str]) -> Path:
    """A path without sightings that are vague, or far from where their neighbours lead."""
    vague = path.sd > VAGUE * np.median(path.sd)
    path = _without(path, vague) if vague.any() else path
    wild = spikes(Observation(path.time, path.xy, np.full(len(path.time), np.nan)), sigma)
    if count := int(vague.sum() + wild.sum()):
        told.append(f"{path.name}: {count} sighting{'s' * (count > 1)} too vague or astray, not used")
    return _without(path, wild)


def _without(path: Path, bad: NDArray[np.bool_]) -> Path:
    """A path without some of its sightings (n,)."""
    keep = ~bad
    return replace(
        path, frame=path.frame[keep], time=path.time[keep], pixels=path.pixels[keep], xy=path.xy[keep],
        sd=path.sd[keep], radius=path.radius[keep], change=path.change[keep],
    )  # fmt: skip


def noise_of(scene: Scene) -> Noise:
    """The noise of a scene's sightings."""
    scatter = []
    for path in scene.paths:
        for first, last in scene.resting[path.name]:
            if last - first >= 20:
                off = path.xy[first : last + 1]
                scatter.append((off - np.median(off, axis=0)).ravel())
    values = np.abs(np.concatenate(scatter)) if scatter else np.zeros(0)
    resting = float(np.median(values)) / 0.6745 if values.size >= ENOUGH else math.nan
    quick = _third(scene, resting=False)
    return Noise(float(np.fmax(quick, _swaying(scene, quick))), resting)


def _swaying(scene: Scene, quick: float) -> float:
    """Error of moving balls that changes over several frames, as marks that turn make it [m]; NaN if little is seen.

    What parabolas, a sliding one and a rolling one that goes on from it, leave over two turns of a ball without a kink,
    which would stand out of the `quick` noise [m]: in one of the smoother such runs, of the ball where that is largest.
    Others hold a glancing touch that does not stand out.
    """
    left: dict[str, list[float]] = {}
    for path in scene.paths:
        lies = scene.lies(path)
        kinked = np.zeros(len(path.time), bool)
        if len(path.time) >= 4:
            bend = np.abs(_cancelled(path.time, path.xy, _contrast(path.time, 4))).max(axis=1)
            for at in np.flatnonzero(~(bend < KINK * quick)):
                kinked[at : at + 4] = True
        way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.xy, axis=0), axis=1))])
        k = 0
        while k < len(way):
            stop = int(np.searchsorted(way, way[k] + TURNS * 2 * math.pi * scene.radius))
            met = k + int(np.argmax(kinked[k:stop])) if kinked[k:stop].any() else stop
            if met < stop:
                k = met + 1
                continue
            part, k = slice(k, stop), max(stop, k + 1)
            count = stop - part.start
            whole = count >= LEAST_SWAY and path.frame[stop - 1] - path.frame[part.start] == count - 1
            if stop < len(way) and whole and not lies[part].any():
                least = min(_beside_parabolas(path.xy[part], knot) for knot in KNOTS)
                left.setdefault(path.name, []).append(float(np.sqrt(least / 2 / (count - 5))))
    told = [values for values in left.values() if len(values) >= FEW_SWAYS]
    return max((float(np.quantile(values, CLEAR)) for values in told), default=math.nan)


def _beside_parabolas(xy: Array, knot: float) -> float:
    """Sum of squares that two parabolas leave of evenly timed places (n, 2) where one goes on from the other [m^2].

    The `knot` lies between them, of -1 to 1.
    """
    time = np.linspace(-1, 1, len(xy))
    basis = np.column_stack([np.vander(time, 3), np.maximum(time - knot, 0.0) ** 2])
    return float(np.sum((xy - basis @ np.linalg.lstsq(basis, xy, rcond=None)[0]) ** 2))


def _contrast(time: Array, count: int) -> Array:
    """Weights (n - count + 1, count), unit length, with which as many samples in a row cancel but for noise.

    Those of divided differences: a polynomial of degree count - 2 vanishes in them, however the times (n,) lie.
    """
    rows = np.lib.stride_tricks.sliding_window_view(time, count)
    rows = (rows - rows[:, :1]) / np.median(np.diff(time))
    apart = rows[:, :, None] - rows[:, None, :] + np.eye(count)
    weights = 1.0 / apart.prod(axis=2)
    return np.asarray(weights / np.linalg.norm(weights, axis=1, keepdims=True))


def _cancelled(time: Array, xy: Array, weights: Array) -> Array:
    """What is left of samples (n, 2) in a row, weighted: (n - count + 1, 2); NaN where a sample is missing."""
    count = weights.shape[1]
    windows = np.lib.stride_tricks.sliding_window_view(xy, count, axis=0)
    whole = time[count - 1 :] - time[: len(time) - count + 1] < (count - 0.5) * np.median(np.diff(time))
    return np.where(whole[:, None], np.einsum("nki,ni->nk", windows, weights), np.nan)


def _third(scene: Scene, *, resting: bool) -> float:
    """Noise from third differences, with those of resting balls or without [m]; NaN if there are few."""
    found = []
    for path in scene.paths:
        if len(path.time) < 4:
            continue
        left = _cancelled(path.time, path.xy, _contrast(path.time, 4))
        if not resting:
            lies = scene.lies(path)
            left[lies[:-3] | lies[1:-2] | lies[2:-1] | lies[3:]] = np.nan
        found.append(left[np.isfinite(left)])
    values = np.abs(np.concatenate(found)) if found else np.zeros(0)
    return float(np.median(values)) / 0.6745 if values.size >= ENOUGH else math.nan


def overlap(found: ClipTracks, radius: float) -> float:
    """Least distance of two balls' first places in a clip [m]."""
    places = np.array([path.xy[rows[0]] for path, rows in found.values() if rows.size])
    far = np.linalg.norm(places[:, None] - places[None], axis=2) + 1e3 * radius * np.eye(len(places))
    return float(far.min()) if far.size else math.inf


def _outside(xy: Array, table: Table, diameter: float) -> NDArray[np.bool_]:
    """Which places (n, 2) lie where no ball can be: (n,)."""
    over = np.abs(xy) - np.array([table.length, table.width]) / 2
    return np.asarray((over > BEYOND).any(axis=1) & (table.to_pocket(xy) >= POCKET_REACH * diameter))


def lost_frames(scene: Scene, shot: Shot, path: Path, rows: NDArray[np.int64]) -> int:
    """Frames of a clip in which a ball should have been seen and was not."""
    last = shot.potted.get(path.name, shot.last)
    return int(((scene.frames >= shot.first) & (scene.frames <= last)).sum()) - rows.size


def note(number: int, shot: Shot, extra: Extra = Extra()) -> str:
    """A clip in plain words."""
    count = f"{len(shot.balls)} ball{'s' * (len(shot.balls) > 1)}"
    what = f"{shot.struck} spins in place" if shot.spun else f"shot {number}"
    return "; ".join([f"{what} at {shot.time:.2f} s", count, *shot.remarks, *([extra.tip] if extra.tip else [])])


def clip_set(result: Tracked, camera: Camera, mass: float, fps: float, extras: Sequence[Extra] = ()) -> ClipSet:
    """The shots as clips.

    Args:
        result: of tracking.
        camera: with the table and the balls' diameter.
        mass: of a ball [kg].
        fps: nominal frame rate [1/s].
        extras: what else is known of each shot.
    """
    if not result.shots:
        raise BadInput("video: holds no shot to write; film whole shots, from before the stroke until the balls rest")
    clips = []
    for number, (shot, found) in enumerate(zip(result.shots, result.found, strict=True), 1):
        extra = extras[number - 1] if extras else Extra()
        start = min(float(path.time[rows[0]]) for path, rows in found.values())
        balls = {}
        for name, (path, rows) in found.items():
            unseen = np.full(rows.size, np.nan)
            balls[name] = Observation(path.time[rows] - start, path.xy[rows], extra.theta.get(name, unseen))
        clips.append(Clip(f"clips/{number:04d}.csv", shot.struck, balls, note=note(number, shot, extra)))
    sigma = result.noise.sigma
    return ClipSet(camera.table, ball_of(camera, mass), fps, tuple(clips), sigma if math.isfinite(sigma) else None)


def rough(time: Array, xy: Array) -> Array:
    """How far each sighting (n, 2) lies from a cubic through its four neighbours (n,) [m]; NaN where one is missing."""
    off = np.full(len(time), np.nan)
    if len(time) >= 5:
        weights = _contrast(time, 5)
        off[2:-2] = np.linalg.norm(_cancelled(time, xy, weights), axis=1) / np.abs(weights[:, 2])
    return off


def pictures(footage: Footage, wanted: set[int]) -> Iterator[tuple[int, Picture]]:
    """The pictures of some frames, read through once more."""
    last = max(wanted, default=-1)
    for frame in footage:
        if frame.index in wanted:
            yield frame.index, frame.picture
        if frame.index >= last:
            return
