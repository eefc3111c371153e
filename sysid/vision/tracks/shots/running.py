"""Motion without a strike: footage that begins in mid-motion, or whose strike is hidden, as running clips.

In: the tracked scene, split into shots, and the motion that belongs to none. Out: `TrackedShot`s that begin in
mid-motion, and why the rest is left out. A running clip begins with the first frame in which all balls that move are
followed, and freely so (sysid/clips/running.py); it ends before the next strike, and before a ball that was hidden
appears in motion. A ball that gains speed on free cloth is moved by hand: then there is none.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from models.shot import Ball
from sysid.clips import Clip, ClipSet, Observation
from sysid.clips.running import from_free_motion
from sysid.vision.tracks.moves import MAX_UNSEEN_S, Move, TrackedScene, phase_at
from sysid.vision.tracks.shots.clip_extent import balls_there, ending
from sysid.vision.tracks.shots.strikes import FoundShots, TrackedShot, Unstruck, gains_speed

UNUSED_MASS_KG = 1.0  # of a ball, which no motion shows
TOO_SHORT = "too little of it is free motion"


def running_shots(scene: TrackedScene, struck: FoundShots) -> tuple[list[TrackedShot], list[tuple[float, str]]]:
    """Running clips in order of time, and times [s] and messages of motion that makes none."""
    found: list[TrackedShot] = []
    notes: list[tuple[float, str]] = []
    covered = [(shot.first, shot.last) for shot in struck.shots]
    pending = [*struck.unstruck, *(one for shot in struck.shots for one in _cut_off(scene, shot, struck.strikes))]
    while pending:
        one = min(pending, key=lambda u: u.frame)
        pending.remove(one)
        if any(first <= one.frame <= last for first, last in covered):
            continue
        shot, why = _running(scene, one, [*struck.strikes, *(shot.first for shot in struck.shots)])
        if shot is not None:
            found.append(shot)
            covered.append((one.frame, shot.last))
            pending += _cut_off(scene, shot, struck.strikes)
        else:
            notes.append((scene.time_of(one.frame), f"{one.why}; {why}: left out"))
    return found, notes


def _cut_off(scene: TrackedScene, shot: TrackedShot, strikes: Iterable[int]) -> list[Unstruck]:
    """Motion that goes on after a clip was cut short, as where a ball jumps; none where the next strike ends it."""
    stop = min((frame for frame in strikes if frame >= shot.last), default=int(scene.frames[-1]))
    going = [m for m in scene.moves if m.began <= shot.last and min(m.ended, stop) > shot.last]
    if not going:
        return []
    after = [int(m.track.frame[np.searchsorted(m.track.frame, shot.last, side="right")]) for m in going]
    names = _listed(list(dict.fromkeys(m.name for m in going)))
    return [Unstruck(min(after), f"{names} moved on after a clip that ends early, at frame {shot.last}")]


def _running(scene: TrackedScene, one: Unstruck, strikes: Iterable[int]) -> tuple[TrackedShot | None, str]:
    """The running clip that begins with some motion, or why there is none."""
    start, unseen = one.frame, [m for m in scene.moves if m.place is None]
    for move in sorted(unseen, key=lambda m: m.began):
        hidden = scene.time_of(move.began) - scene.time_of(start)
        start = move.began if 0 < hidden < MAX_UNSEEN_S else start
    limit = min((frame for frame in strikes if frame > start), default=int(scene.frames[-1]))
    for move in unseen:
        if move.began > start:
            last_seen = int(move.track.frame[move.first - 1]) if move.first else start
            limit = min(limit, max(last_seen, start) if last_seen > start else move.began - 1)
    moving = [_since(move, start) for move in scene.moves if move.began <= start <= move.ended]
    moving = [move for move in moving if move.stop - move.first > 1]
    if not moving:
        return None, TOO_SHORT
    after = [m for m in scene.moves if start < m.began <= limit]
    last, ends = ending(scene, start, min(max(m.ended for m in moving), limit), after, limit)
    names = tuple(move.name for move in moving)
    seen, why = balls_there(scene, names, start, last, [m for m in after if m.name not in names])
    if seen is None:
        return None, why
    by_hand = [move for move in moving if gains_speed(scene, move)]
    if by_hand:
        return None, f"{by_hand[0].name} gains speed, as if moved by hand"
    shot = TrackedShot(
        names[0], scene.time_of(start), start, last, seen.names, 0.0, seen.potted, (*ends, *seen.remarks), running=names
    )
    return _begun(scene, shot, one.why)


def _since(move: Move, frame: int) -> Move:
    """A move without what precedes a frame."""
    return dataclasses.replace(move, first=max(move.first, int(np.searchsorted(move.track.frame, frame))))


def _begun(scene: TrackedScene, shot: TrackedShot, why: str) -> tuple[TrackedShot | None, str]:
    """A running clip from the first frame on in which all that moves does so freely; None where there is none."""
    tracks = {track.name: track for track in scene.tracks}
    balls = {}
    for name in shot.balls:
        track = tracks[name]
        rows = np.flatnonzero((track.frame >= shot.first) & (track.frame <= shot.potted.get(name, shot.last)))
        if rows.size:
            balls[name] = Observation(track.time[rows], track.xy[rows], np.full(rows.size, np.nan))
    of = ClipSet(scene.table, Ball(2 * scene.radius, UNUSED_MASS_KG), 1 / scene.period, ())
    clip = from_free_motion(Clip("", "", balls), of, scene.sigma) if balls else None
    if clip is None:
        return None, TOO_SHORT
    k = min(int(np.searchsorted(scene.times, clip.origin - scene.period / 2)), len(scene.frames) - 1)
    first, track = int(scene.frames[k]), tracks[clip.struck]
    row = int(np.searchsorted(track.frame, first))
    speed = float(np.linalg.norm(phase_at(scene, track, row).velocity(float(track.time[row]))))
    remark = f"begins in mid-motion at frame {first}, {_listed(clip.running)} moving: {why}"
    return dataclasses.replace(
        shot, struck=clip.struck, time=scene.time_of(first), first=first, speed=speed, running=clip.running,
        balls=(*clip.running, *[name for name in clip.balls if name not in clip.running]),
        potted={name: frame for name, frame in shot.potted.items() if name in clip.balls},
        remarks=(remark, *shot.remarks),
    ), ""  # fmt: skip


def _listed(names: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
