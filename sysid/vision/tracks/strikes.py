"""From paths to shots: when a ball is struck, what belongs to the shot, and what is left out and why.

A ball is set in motion by a ball that moves and comes as near as a touch; otherwise it was struck, or moved by hand. A
strike takes a millisecond or two: the ball is as fast at once as it will be. A hand takes longer: a ball that gains
speed on free cloth was moved by hand. A shot lasts until all balls rest, are potted or lost, or something else is set
in motion. Its clip begins with the first frame that was exposed wholly after the strike; with the last one before it,
if the struck ball has touched another by then.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.vision.tracks.jumps import first_jump
from sysid.vision.tracks.moves import FEWEST, UNSEEN, Move, Scene, place_of, pocketed, speed_of

CONTACT = 0.002  # longest time that cue and ball touch [s]
TAIL = 0.3  # of rest at the end of a clip [s]
FORGOTTEN = 1.0  # a moving ball that was lost for longer sets nothing in motion: it was taken away [s]
GAIN = 0.75  # speed at once over the speed later, below which a ball is moved by hand
LULL = 1.0  # without motion, after which a shot is over [s]
TOGETHER = 1.5  # frames within which balls begin to move that may have been set in motion at once
BEHIND = 0.87  # cosine of the angle to its way within which a ball stands behind another
LEAST = 5  # sightings of a struck ball that make a clip


@dataclass(frozen=True)
class Shot:
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


def split(scene: Scene) -> tuple[tuple[Shot, ...], tuple[str, ...]]:
    """Shots in order, and in plain words what was left out."""
    resting, moves = scene.resting, scene.moves
    notes: list[tuple[float, str]] = []
    strikes: list[tuple[Move, list[Move], bool]] = []  # the struck ball, all that it sets off at once, is it clean
    for move in (m for m in moves if m.place is None):
        what = "was on its way when the video begins" if move.began <= scene.frames[0] + FEWEST else ""
        if not any(o.began < move.began <= o.ended for o in moves if o.name != move.name):
            notes.append((scene.when(move.began), f"{move.name} {what or 'was set in motion unseen'}"))
    for group in _groups(scene, [m for m in moves if m.place is not None and not _caused(scene, m, moves)]):
        struck = _struck(scene, group)
        why = _unclean(scene, struck)
        if why:
            notes.append((scene.when(struck.began), f"{struck.name} {why}"))
        strikes.append((struck, group, not why))
    shots = []
    strikes.sort(key=lambda one: one[0].began)
    for k, (struck, group, clean) in enumerate(strikes):
        later = [one for one, _, _ in strikes[k + 1 :] if one.began > struck.began]
        limit = min((one.before for one in later), default=int(scene.frames[-1]))
        if clean:
            shot, why = _shot(scene, struck, group, moves, resting, limit)
            if shot is not None:
                shots.append(shot)
            else:
                notes.append((scene.when(struck.began), f"shot of {struck.name}: {why}"))
    return tuple(shots), tuple(f"{time:.2f} s: {text}" for time, text in sorted(notes))


def _near(scene: Scene, other: Move, move: Move) -> bool:
    """Whether a moving ball comes, or may have come unseen, to touch one at rest just when that begins to move."""
    path, begun = other.path, float(move.path.time[move.first])
    left = float(move.path.time[move.first - 1])
    last = int(np.searchsorted(path.time, left, side="right")) - 1
    velocity = speed_of(path, max(last - 1, other.first - 1, 0), last + 1)
    speed, gone = float(np.linalg.norm(velocity)), begun - float(path.time[last])
    times = np.linspace(left, begun, 9)
    places = path.xy[last] + (times - path.time[last])[:, None] * velocity
    room = 2.3 * scene.radius + 6 * scene.sigma + 0.25 * speed * (begun - left)
    if last + 1 < len(path.time) and path.time[last + 1] - path.time[last] < UNSEEN:
        between = np.column_stack([np.interp(times, path.time, path.xy[:, k]) for k in (0, 1)])
        places = np.concatenate([places, between])
    elif gone > UNSEEN:
        dropped = other.lost and pocketed(scene, path, np.arange(other.first, other.stop)) is not None
        if dropped or (other.lost and gone > FORGOTTEN):
            return False
        places, room = path.xy[last][None], room + speed * gone
    return move.place is not None and float(np.linalg.norm(places - move.place, axis=1).min()) < room


def _caused(scene: Scene, move: Move, moves: Sequence[Move]) -> bool:
    """Whether a ball was set in motion by one that moved already."""
    return any(
        other.name != move.name
        and other.onset < move.onset - TOGETHER * scene.period
        and other.began <= move.began
        and (other.ended >= move.before - 1 or other.lost)
        and _near(scene, other, move)
        for other in moves
    )


def _groups(scene: Scene, moves: Sequence[Move]) -> list[list[Move]]:
    """Balls that begin to move between the same two frames, and lie as near as one of them gets in that time."""
    groups: list[list[Move]] = []
    for move in sorted(moves, key=lambda m: m.began):
        for group in groups:
            if any(_together(scene, move, other) for other in group):
                group.append(move)
                break
        else:
            groups.append([move])
    return groups


def _together(scene: Scene, one: Move, two: Move) -> bool:
    if one.place is None or two.place is None or abs(one.onset - two.onset) > TOGETHER * scene.period:
        return False
    fastest = max(float(np.linalg.norm(speed_of(m.path, m.first, m.stop))) for m in (one, two))
    between = float(np.linalg.norm(one.place - two.place))
    return between < 2.3 * scene.radius + (TOGETHER + 0.5) * fastest * scene.period + 6 * scene.sigma


def _struck(scene: Scene, group: Sequence[Move]) -> Move:
    """Of balls that begin to move together, the one that was struck: the others go away from where it lay."""
    if len(group) == 1:
        return group[0]

    def amiss(one: Move) -> tuple[float, bool]:
        total = 0.0
        for other in group:
            if other is not one and one.place is not None and other.place is not None:
                velocity, way = speed_of(other.path, other.first, other.stop), other.place - one.place
                total += float(np.linalg.norm(velocity) - velocity @ way / np.linalg.norm(way))
        return round(total, 3), one.name.split("_")[0] not in ("white", "cue")

    return min(group, key=amiss)


def _free(scene: Scene, move: Move) -> int:
    """The sighting before which a ball has met neither ball nor cushion, for sure."""
    path, r = move.path, scene.radius
    part = slice(move.first, move.stop)
    time, xy = path.time[part], path.xy[part]
    step = np.linalg.norm(np.diff(xy, axis=0, append=xy[-1:]), axis=1)
    half = np.array([scene.table.length, scene.table.width]) / 2 - r
    room = (half - np.abs(xy)).min(axis=1) - 0.3 * r - step
    for other in scene.paths:
        if other.name != path.name:
            there = np.column_stack([np.interp(time, other.time, other.xy[:, k]) for k in (0, 1)])
            room = np.minimum(room, np.linalg.norm(xy - there, axis=1) - 2.3 * r - step)
    met = np.flatnonzero(room < 0)
    return move.first + (int(met[0]) if met.size else len(time))


def _unclean(scene: Scene, move: Move) -> str:
    """Why this was no stroke of a cue; empty if it was."""
    path, xy = move.path, move.path.xy
    velocity = speed_of(path, move.first, move.stop)
    for other in scene.paths:
        k = int(np.searchsorted(other.frame, move.before, side="right")) - 1
        if move.place is None or other.name == move.name or k < 0:
            continue
        back = move.place - other.xy[k]
        between, speed = float(np.linalg.norm(back)), float(np.linalg.norm(velocity))
        if between < 2.1 * scene.radius + 6 * scene.sigma and velocity @ back > BEHIND * between * speed:
            return f"was struck through {other.name}, which touched it: left out"
    least = max(scene.radius / 2, 20 * scene.sigma)
    begin, stop, early = move.first, _free(scene, move), math.nan
    for k in range(move.first + 1, stop):
        way = float(np.linalg.norm(xy[k] - xy[begin]))
        if way >= least:
            speed = way / float(path.time[k] - path.time[begin])
            if early < GAIN * speed:
                return "gained speed slowly, as if moved by hand: left out"
            if math.isnan(early):
                early, least = speed, 2 * least
            begin = k
    return ""


def _shot(
    scene: Scene, struck: Move, group: Sequence[Move], moves: Sequence[Move],
    resting: Mapping[str, list[tuple[int, int]]], limit: int,
) -> tuple[Shot | None, str]:  # fmt: skip
    """The shot that a strike begins, or why there is none."""
    path = struck.path
    velocity = speed_of(path, struck.first, max(_free(scene, struck), struck.first + 2))
    speed = float(np.linalg.norm(velocity))
    time = min(struck.onset, *(m.onset for m in group))
    k = struck.first
    while k < struck.stop - 1 and path.time[k] - time < 0.5 * scene.period + CONTACT:
        k += 1
    first = int(path.frame[k])
    after = [m for m in moves if m.name != struck.name and struck.before - 2 <= m.before and m.before < limit]
    if any(m.onset < path.time[k] for m in [*group, *after] if m is not struck and m.place is not None):
        first = min(m.before for m in group)
    for move in moves:
        if move not in group and move.began <= struck.before and move.ended > struck.began:
            return None, f"{move.name} was still on its way: left out"
    cover = min(struck.ended, limit)
    for move in sorted(after, key=lambda m: m.began):
        # What sets the next ball in motion may be hidden.
        if scene.when(move.began) - scene.when(cover) < (LULL if move.place is not None else 1.5 * scene.period):
            cover = max(cover, min(move.ended, limit))
    last = min(int(scene.frames[np.searchsorted(scene.times, scene.when(cover) + TAIL, side="right") - 1]), limit)
    last, jumps = first_jump(scene.paths, first, last)
    remarks = [f"cut short at {scene.when(last):.2f} s, where {jumps} jumps"] if jumps else []
    if last >= scene.frames[-1] and cover >= scene.frames[-1] - 1:
        remarks.append("cut off by the end of the video")
    potted = {}
    balls = [struck.name]
    for other in scene.paths:
        part = np.flatnonzero((other.frame >= first) & (other.frame <= last))
        before = [place_of(other, a, b) for a, b in resting[other.name] if other.frame[a] <= first]
        there = part.size and before and np.linalg.norm(other.xy[part[0]] - before[-1]) < scene.radius / 2
        if other.name != struck.name and not there:
            if part.size > FEWEST:
                remarks.append(f"{other.name} appeared at {other.time[part[0]]:.2f} s, not in the clip")
            continue
        if other.name != struck.name:
            balls.append(other.name)
            gone = [m for m in after if m.name == other.name and m.began <= last]
            if any(m.place is None or m.path.frame[part[0]] >= m.began for m in gone):
                return None, f"{other.name} was hidden when it was set in motion: left out"
        drops = pocketed(scene, other, part)
        if drops is not None:
            potted[other.name] = drops
            remarks.append(f"{other.name} potted")
        elif scene.when(last) - other.time[part[-1]] > UNSEEN + scene.period:
            remarks.append(f"{other.name} lost at {other.time[part[-1]]:.2f} s")
    own = path.frame[(path.frame >= first) & (path.frame <= potted.get(struck.name, last))]
    if len(own) < LEAST:
        return None, f"{len(own)} sightings of it: left out"
    return Shot(struck.name, time, first, last, tuple(balls), speed, potted, tuple(remarks)), ""
