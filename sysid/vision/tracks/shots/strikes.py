"""From moves to shots: when a ball is struck, what belongs to the shot, and what is left out and why.

In: the tracked scene. Out: `TrackedShot` in order of time, and messages on what was left out. A ball is set in motion
by a moving ball that touches it then, or may touch it unseen; otherwise it was struck, or moved by hand. A strike takes
a millisecond or two, after which the ball is at its full speed; a ball that gains speed on free cloth was moved by
hand. A shot lasts until all balls are at rest, potted or lost, or something else is set in motion. Its clip begins with
the first frame exposed wholly after the strike, or with the last one before it if the struck ball has touched another
by then. Motion of which no shot can be made begins in mid-motion: running.py.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.clips.consistency.tempo import MAX_CUE_SPEED
from sysid.clips.plausibility import MIN_STRUCK_SAMPLES
from sysid.vision.tracks.following.prediction import TOUCH_RADII
from sysid.vision.tracks.moves import (
    MAX_UNSEEN_S,
    MIN_REST_DETECTIONS,
    SURE_SD,
    Move,
    TrackedScene,
    phase_at,
    pocketed,
)
from sysid.vision.tracks.shots.clip_extent import balls_there, ending

MAX_CONTACT_S = 0.002  # longest contact of cue and ball
MAX_LOST_S = 1.0  # a moving ball lost for longer was taken away and sets nothing in motion
SIMULTANEOUS_FRAMES = 1.5  # within which balls begin to move that may have been set in motion together
MIN_BEHIND_COSINE = 0.87  # of the angle between the velocity of a ball and the line from the ball that pushed it
# A ball that is struck at the utmost height, half a radius above its middle, rolls at 5/7 + 2/7 * 5/4 of its speed.
MAX_ROLLING_GAIN = 1.08


@dataclass(frozen=True)
class TrackedShot:
    """A shot of one ball, and the frames of its clip."""

    struck: str
    time: float  # of the strike [s]
    first: int  # frame
    last: int  # frame
    balls: tuple[str, ...]  # that were there, the struck one first
    speed: float  # of the struck ball at the beginning [m/s]
    potted: Mapping[str, int]  # ball -> the last frame before it is in a pocket
    remarks: tuple[str, ...] = ()
    spun: bool = False  # in place, rather than struck
    running: tuple[str, ...] = ()  # balls in motion when it begins, `struck` the first; none where it was struck


@dataclass(frozen=True)
class Unstruck:
    """Motion that belongs to no shot, since its strike is not seen or does not begin one."""

    frame: int  # from which on
    why: str  # it is no shot


@dataclass(frozen=True)
class FoundShots:
    """What the moves of a footage are made of."""

    shots: tuple[TrackedShot, ...]  # in order of time
    unstruck: tuple[Unstruck, ...]  # in order of time
    strikes: tuple[int, ...]  # the last frames before each, clean or not
    left_out: tuple[tuple[float, str], ...]  # time [s], and why


def split_shots(scene: TrackedScene) -> FoundShots:
    """Shots, motion that may begin a running clip, and messages on what was left out."""
    moves = scene.moves
    notes: list[tuple[float, str]] = []
    unstruck: list[Unstruck] = []
    strikes: list[tuple[Move, list[Move], bool]] = []  # struck ball, balls set in motion with it, clean stroke
    for move in (m for m in moves if m.place is None):
        what = "was already moving when the video begins" if move.began <= scene.frames[0] + MIN_REST_DETECTIONS else ""
        unstruck.append(Unstruck(move.began, f"{move.name} {what or 'was set in motion unseen'}"))
    for group in _groups(scene, _uncaused(scene, [move for move in moves if move.place is not None], moves)):
        struck = _struck(group)
        why = _fault(scene, struck)
        if why:
            notes.append((scene.time_of(struck.began), f"{struck.name} {why}"))
        alone = [m.name for m in group if m not in _set_in_motion(scene, [struck], group)]
        if alone and not why:  # a cue strikes one ball
            names = " and ".join([struck.name, *alone])
            unstruck.append(Unstruck(struck.began, f"{names} were set in motion together by something unseen"))
        strikes.append((struck, group, not why and not alone))
    shots = []
    strikes.sort(key=lambda one: one[0].began)
    for k, (struck, group, clean) in enumerate(strikes):
        later = [one for one, _, _ in strikes[k + 1 :] if one.began > struck.began]
        limit = min((one.before for one in later), default=int(scene.frames[-1]))
        if clean:
            shot, why = _shot(scene, struck, group, moves, limit)
            if shot is not None:
                shots.append(shot)
            else:
                unstruck.append(Unstruck(struck.began + 1, f"{struck.name} was struck, but {why}"))
    unstruck.sort(key=lambda one: one.frame)
    return FoundShots(tuple(shots), tuple(unstruck), tuple(s.before for s, _, _ in strikes), tuple(notes))


def _may_touch(scene: TrackedScene, other: Move, move: Move) -> bool:
    """Whether another ball touches one at rest just when that begins to move, or may touch it unseen."""
    if move.place is None:
        return False
    track, touch = other.track, TOUCH_RADII * scene.radius
    departed, arrived = (float(move.track.time[k]) for k in (move.first - 1, move.first))
    last = max(int(np.searchsorted(track.time, departed, side="right")) - 1, 0)
    since, ends = float(track.time[last]), track.xy[last : last + 2]
    until = float(track.time[last + 1]) if len(ends) > 1 else arrived
    if departed - since > MAX_UNSEEN_S or until - since > max(MAX_UNSEEN_S, 1.5 * scene.period):
        if departed - since > MAX_LOST_S or pocketed(scene, track, np.arange(other.first, last + 1)) is not None:
            return False
        # It may be anywhere on a way between its two places, as long as it was fast: one sight does not tell how fast.
        one = phase_at(scene, track, last)
        speed = MAX_CUE_SPEED if last <= max(one.first, other.first) else float(np.linalg.norm(one.velocity(since)))
        return float((np.linalg.norm(ends - move.place, axis=1) - touch).sum()) < speed * (until - since)
    for one in other.phases:
        after = float(track.time[one.stop]) if one.stop < len(track.time) else math.inf
        before = float(track.time[one.first - 1]) if one.first else -math.inf
        if before > arrived or after < departed:
            continue
        # Where this phase may have been meanwhile: it ends, or began, between two detections.
        for time in np.linspace(max(departed, before), min(arrived, after), 9):
            sd = math.hypot(one.place_sd(time), scene.sigma)
            if np.linalg.norm(one.place(time) - move.place) < touch + SURE_SD * sd:
                return True
    return False


def _caused(scene: TrackedScene, move: Move, moves: Sequence[Move]) -> bool:
    """Whether a ball was set in motion by one that was moving already, or may have been."""
    return any(
        other.name != move.name
        and other.onset < move.onset - SIMULTANEOUS_FRAMES * scene.period
        and (other.lost or other.track.frame[other.stop] >= move.before)
        and _may_touch(scene, other, move)
        for other in moves
    )


def _uncaused(scene: TrackedScene, begun: Sequence[Move], moves: Sequence[Move]) -> list[Move]:
    """Those balls that no ball in motion set in motion, nor one at rest that it hit, as in a rack."""
    caused = [move for move in begun if _caused(scene, move, moves)]
    set_in_motion = _set_in_motion(scene, caused, begun)
    return [move for move in begun if move not in set_in_motion]


def _groups(scene: TrackedScene, moves: Sequence[Move]) -> list[list[Move]]:
    """Groups of balls that may have begun to move together."""
    groups: list[list[Move]] = []
    for move in sorted(moves, key=lambda m: m.began):
        for group in groups:
            if any(_simultaneous(scene, move, other) for other in group):
                group.append(move)
                break
        else:
            groups.append([move])
    return groups


def _simultaneous(scene: TrackedScene, one: Move, two: Move) -> bool:
    """Whether two balls began to move within a frame, or while neither was seen."""
    near = abs(one.onset - two.onset) < SIMULTANEOUS_FRAMES * scene.period
    return near or max(one.before, two.before) < min(one.began, two.began)


def _struck(group: Sequence[Move]) -> Move:
    """Of balls that begin to move together, the one that was struck: the others move away from its place."""
    if len(group) == 1:
        return group[0]

    def mismatch(one: Move) -> tuple[float, bool]:
        total = 0.0
        for other in group:
            if other is not one and one.place is not None and other.place is not None:
                velocity, offset = other.velocity, other.place - one.place
                total += float(np.linalg.norm(velocity) - velocity @ offset / np.linalg.norm(offset))
        return round(total, 3), one.name.split("_")[0] not in ("white", "cue")

    return min(group, key=mismatch)


def _set_in_motion(scene: TrackedScene, first: Sequence[Move], moves: Sequence[Move]) -> list[Move]:
    """Balls that move at first, and those that these, or others that they set in motion, can have reached by then."""
    found = list(first)
    left = [move for move in moves if move not in found]
    for one in found:
        hit = [move for move in left if _simultaneous(scene, one, move) and _reaches(scene, one, move)]
        found += hit
        left = [move for move in left if move not in hit]
    return found


def _reaches(scene: TrackedScene, one: Move, other: Move) -> bool:
    """Whether a ball that begins to move can touch another at rest before that is seen to move, away from it."""
    if one.place is None or other.place is None:
        return False
    way, velocity = other.place - one.place, other.velocity
    fastest = max(float(np.linalg.norm(m.velocity)) for m in (one, other))
    travel = fastest * (scene.time_of(other.began) - scene.time_of(one.before) + scene.period)
    near = float(np.linalg.norm(way)) < TOUCH_RADII * scene.radius + travel + SURE_SD * scene.sigma
    return near and float(velocity @ way) > 0


def _first_contact(scene: TrackedScene, move: Move) -> int:
    """The detection before which a ball has certainly touched neither ball nor cushion."""
    track, r = move.track, scene.radius
    rows = slice(move.first, move.stop)
    time, xy = track.time[rows], track.xy[rows]
    step = np.linalg.norm(np.diff(xy, axis=0, append=xy[-1:]), axis=1)
    half = np.array([scene.table.length, scene.table.width]) / 2 - r
    room = (half - np.abs(xy)).min(axis=1) - 0.3 * r - step
    for other in scene.tracks:
        if other.name != track.name:
            other_xy = np.column_stack([np.interp(time, other.time, other.xy[:, k]) for k in (0, 1)])
            room = np.minimum(room, np.linalg.norm(xy - other_xy, axis=1) - TOUCH_RADII * r - step)
    touched = np.flatnonzero(room < 0)
    return move.first + (int(touched[0]) if touched.size else len(time))


def _fault(scene: TrackedScene, move: Move) -> str:
    """Why this was no clean stroke of a cue; empty if it was."""
    velocity = move.velocity
    for other in scene.tracks:
        k = int(np.searchsorted(other.frame, move.before, side="right")) - 1
        if move.place is None or other.name == move.name or k < 0:
            continue
        offset = move.place - other.xy[k]
        gap, speed = float(np.linalg.norm(offset)), float(np.linalg.norm(velocity))
        if (
            gap < TOUCH_RADII * scene.radius + SURE_SD * scene.sigma
            and velocity @ offset > MIN_BEHIND_COSINE * gap * speed
        ):
            return f"was struck through {other.name}, which touched it: left out"
    return "gained speed slowly, as if moved by hand: left out" if gains_speed(scene, move) else ""


def gains_speed(scene: TrackedScene, move: Move) -> bool:
    """Whether a ball gains more speed on free cloth than its spin can give, before it touches another or a cushion."""
    track, stop, begun = move.track, _first_contact(scene, move), math.inf
    for one in move.phases:
        first, last = max(one.first, move.first), min(one.stop, stop) - 1
        if one.rest or last - first < 1:
            continue
        for time in (float(track.time[first]), float(track.time[last])):
            speed, sd = float(np.linalg.norm(one.velocity(time))), SURE_SD * one.velocity_sd(time)
            if speed - sd > MAX_ROLLING_GAIN * begun:
                return True
            begun = speed + sd if math.isinf(begun) else begun
    return False


def _shot(
    scene: TrackedScene, struck: Move, group: Sequence[Move], moves: Sequence[Move], limit: int
) -> tuple[TrackedShot | None, str]:  # fmt: skip
    """The shot that a strike begins, or why there is none."""
    track = struck.track
    time = min(struck.onset, *(m.onset for m in group))
    k = struck.first
    while k < struck.stop - 1 and track.time[k] - time < 0.5 * scene.period + MAX_CONTACT_S:
        k += 1
    first = int(track.frame[k])
    after = [m for m in moves if m.name != struck.name and struck.before - 2 <= m.before and m.before < limit]
    touched = any(m.onset < track.time[k] for m in [*group, *after] if m is not struck and m.place is not None)
    if touched or any(struck.before <= one.frame[-1] < first for one in scene.tracks):
        first = min(m.before for m in group)
    for move in moves:
        if move not in group and move.began <= struck.before and move.ended > struck.began:
            return None, f"{move.name} was still moving"
    last, ends = ending(scene, first, min(struck.ended, limit), after, limit)
    remarks = [f"hidden for {struck.hidden:.2f} s when struck: timed by where its path begins"] * bool(struck.hidden)
    seen, why = balls_there(scene, (struck.name,), first, last, after)
    if seen is None:
        return None, why
    if ((track.frame >= first) & (track.frame <= last)).sum() < MIN_STRUCK_SAMPLES:
        return None, "is seen in too few frames"
    remarks += [*ends, *seen.remarks]
    speed = float(np.linalg.norm(struck.velocity))
    return TrackedShot(struck.name, time, first, last, seen.names, speed, seen.potted, tuple(remarks)), ""
