"""Contradictions between the tracks of a clip set and its entries: ball diameter, table, commands, times.

In: a `ClipSet`. Out: `Contradiction`s: certain faults, or warnings.

    diameter    sysid/clips/consistency/contact_distance.py: how far apart centres are when balls meet
    cushions    lines through the samples before and after a rebound meet where the ball's centre turned
    scale       all these are off by one factor
    commands    sysid/clips/consistency/aims.py: azimuth and speed of the struck ball
    marks       sysid/clips/consistency/marks.py: how fast they turn
    times       sysid/clips/consistency/tempo.py: frame rate, speeds, how balls slow down

A camera may be off by as much as the catalogue's effects of it at their usual size; that is no contradiction.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from models.shot import NOSE_COSINE, Array, Ball, Table
from models.table.pocket_shape import PocketShapes
from models.table.presets import TABLE_SETS
from sysid.clips.clip_set import Clip, ClipSet
from sysid.clips.consistency.aims import azimuths, speeds_of_cue
from sysid.clips.consistency.contact_distance import ALONE_M, MAX_BENT_M, SLIDE_M_S2, contact_distance, distance_at
from sysid.clips.consistency.contradiction import ALL_CLIPS, Contradiction, Typical, typical
from sysid.clips.consistency.marks import marks
from sysid.clips.consistency.strike import struck_fault
from sysid.clips.consistency.tempo import frame_rate, rolling, speeds
from sysid.clips.names import CLIPS_TOML

MIN_CERTAIN_REBOUNDS = 2
REBOUND_ERROR = 0.003  # least error of the position of one rebound, over half the table
SOUND_DIAMETER, CERTAIN_DIAMETER = 0.04, 0.06  # relative departures: no fault up to here, and a certain fault
SOUND_TABLE, CERTAIN_TABLE = 0.025, 0.06  # relative departures of half the table; a lens moves a cushion by 2 %
SAME_SIZE = 0.015  # relative difference up to which table and balls count as those of a named table
SAME_FACTOR = 0.04  # largest spread of the factors by which diameter and cushions are off, for one common cause
REBOUND_BIAS_M = 0.004  # bias of the cushions' distance: lines through samples cut the corner of a rebound by some mm
NOTED_ERRORS = 2.0  # standard errors for a warning; REBOUND_ERROR makes them large
REBOUND_SAMPLES = 4  # samples used before and after a rebound
MIN_TURN_RATIO = 2.0  # change of velocity over what the cloth can cause: a drawn ball turns back as well
POCKET_M = 0.15  # distance from a pocket within which jaws may deflect a ball
MIN_TOWARDS, MIN_AWAY = 0.2, 0.1  # least speeds towards and away from a cushion [m/s]
NEAR_CUSHION = 0.3  # largest distance from the stated cushion, over half the table


def contradictions(clip_set: ClipSet) -> list[Contradiction]:
    """All contradictions of a clip set, each once; its clips must be sound (`is_sound`)."""
    if struck := struck_fault(clip_set):
        return [Contradiction(*struck, True)]
    too_fast = speeds(clip_set)
    if too_fast:  # everything derived from speeds is wrong
        return [one for one in (frame_rate(clip_set), too_fast) if one is not None]
    turns = rebounds(clip_set)
    times, off_scale = _first_of(rolling(clip_set), speeds_of_cue(clip_set)), _scale(clip_set, turns)
    rate = frame_rate(clip_set, times is not None)
    diameter = None if times else _diameter(clip_set)  # impacts are dated by how balls slow down
    sizes = [off_scale] if off_scale else [diameter, *_cushions(clip_set, turns)]
    found = [*sizes, azimuths(clip_set), rate or times, marks(clip_set)]
    return [one for one in found if one is not None]


def _first_of(one: Contradiction | None, other: Contradiction | None) -> Contradiction | None:
    """Of two contradictions with the same cause, the more certain one."""

    def certainty(found: Contradiction) -> tuple[bool, bool]:
        return found.certain, not found.unless

    return other if one is None or (other is not None and certainty(other) > certainty(one)) else one


def _diameter(clip_set: ClipSet) -> Contradiction | None:
    stated, seen = clip_set.ball.diameter, contact_distance(clip_set)
    if not seen.departs(stated, SOUND_DIAMETER * stated):
        return None
    text = (
        f"diameter = {stated:g} m, but balls meet with their centres {seen.value:.4f} m apart "
        f"({seen.count} impacts): correct the diameter, or the scale of the tracks"
    )
    return Contradiction(CLIPS_TOML, text, seen.departs(stated, CERTAIN_DIAMETER * stated))


def rebounds(clip_set: ClipSet) -> dict[str, Typical]:
    """Distance from the table's centre at which balls rebound, for each cushion [m]."""
    found: dict[str, list[float]] = {"+x": [], "-x": [], "+y": [], "-y": []}
    table, limits = clip_set.table, clip_set.table.centre_limits(clip_set.ball)
    for clip in clip_set.clips:
        for name, seen in clip.balls.items():
            for axis, letter in enumerate("xy"):
                for sign, mark in ((1.0, "+"), (-1.0, "-")):
                    least = (1 - NEAR_CUSHION) * float(limits[axis])
                    turns = _turns(clip, name, sign * seen.xy[:, axis], least)
                    found[mark + letter] += [far for far, place in turns if table.to_pocket(place) > POCKET_M]
    errors = {rail: REBOUND_ERROR * float(limits["xy".index(rail[1])]) for rail in found}
    return {rail: typical(values, 1, errors[rail]) for rail, values in found.items()}


def turns_in_the_open(clip_set: ClipSet) -> Array:
    """Distances at which balls turn back, away from other balls and pockets, over the cushion's distance: (n,)."""
    table, limits = clip_set.table, clip_set.table.centre_limits(clip_set.ball)
    found = [
        far / float(limits[axis])
        for clip in clip_set.clips
        for name, seen in clip.balls.items()
        for axis in (0, 1)
        for sign in (1.0, -1.0)
        for far, place in _turns(clip, name, sign * seen.xy[:, axis], -np.inf)
        if table.to_pocket(place) > POCKET_M
    ]
    return np.array(found)


def _turns(clip: Clip, name: str, out: Array, least: float) -> Iterator[tuple[float, Array]]:
    """Largest distances `out` at which a ball turns back, beyond `least`, and where; no other ball is near."""
    n, time, xy = REBOUND_SAMPLES, clip.balls[name].time, clip.balls[name].xy
    if len(out) <= 2 * n:
        return
    peaks = 1 + np.flatnonzero((out[1:-1] >= out[:-2]) & (out[1:-1] > out[2:]) & (out[1:-1] > least))
    peaks = peaks[(peaks >= n) & (peaks < len(out) - n)]
    parts = [peaks[:, None] + steps for steps in (np.arange(-n, 0), np.arange(1, n + 1))]
    clocks = [time[part] - time[peaks, None] for part in parts]
    (towards, there, bent), (away, back, bent_after) = (
        _lines(c, out[part]) for c, part in zip(clocks, parts, strict=True)
    )
    by_cloth = SLIDE_M_S2 * (clocks[1].mean(axis=1) - clocks[0].mean(axis=1))
    turns = (towards >= MIN_TOWARDS) & (away <= -MIN_AWAY) & (towards - away >= MIN_TURN_RATIO * by_cloth)
    turns &= np.maximum(bent, bent_after) <= MAX_BENT_M
    met = (back - there) / np.where(turns, towards - away, 1.0)
    turns &= (clocks[0][:, -1] <= met) & (met <= clocks[1][:, 0])
    for j in np.flatnonzero(turns).tolist():
        k = int(peaks[j])
        if all(distance_at(seen, xy[k], float(time[k])) > ALONE_M for o, seen in clip.balls.items() if o != name):
            yield float(there[j] + towards[j] * met[j]), xy[k]


def _lines(clock: Array, values: Array) -> tuple[Array, Array, Array]:
    """Straight lines through the rows of (n, m): slopes, values at 0, and the largest residuals, (n,) each."""
    middle, mean = clock.mean(axis=1, keepdims=True), values.mean(axis=1, keepdims=True)
    off = clock - middle
    slope = (off * (values - mean)).sum(axis=1, keepdims=True) / (off**2).sum(axis=1, keepdims=True)
    bent = np.abs(values - mean - slope * off).max(axis=1)
    return slope[:, 0], (mean - slope * middle)[:, 0], bent


def _cushions(clip_set: ClipSet, seen: dict[str, Typical]) -> Iterator[Contradiction]:
    """Cushions of an axis whose rebounds are not where the stated table has them."""
    limits = clip_set.table.centre_limits(clip_set.ball)
    for axis, (letter, key) in enumerate((("x", "length"), ("y", "width"))):
        limit = float(limits[axis])
        off = [r for r in ("+" + letter, "-" + letter) if seen[r].departs(limit, SOUND_TABLE * limit)]
        if not off:
            continue
        where = " and ".join(f"{r} at {r[0]}{seen[r].value:.3f} m (rebounds: {seen[r].count})" for r in off)
        count = sum(seen[r].count for r in off if seen[r].departs(limit, CERTAIN_TABLE * limit))
        text = f"{key} = {_stated(clip_set.table, axis):g} m puts the turn of a ball's centre at {limit:.3f} m"
        remedy = _table_remedy(clip_set.ball, seen["+" + letter], seen["-" + letter], letter, key, limit)
        text = f"{text}, but balls turn at {where}: {remedy}"
        beyond = any(
            seen[r].value > _stated(clip_set.table, axis) / 2 for r in off
        )  # then single rows are faults as well
        yield Contradiction(CLIPS_TOML, text, beyond or count >= MIN_CERTAIN_REBOUNDS, True)


def size_notes(clip_set: ClipSet) -> list[str]:
    """Cushions noticeably closer or farther apart than stated: the table's size or the camera is slightly wrong."""
    seen, found = rebounds(clip_set), []
    for axis, (letter, key) in enumerate((("x", "length"), ("y", "width"))):
        plus, minus, stated = seen["+" + letter], seen["-" + letter], _stated(clip_set.table, axis)
        size = plus.value + minus.value + 2 * NOSE_COSINE * clip_set.ball.radius
        error = float(np.hypot(plus.error, minus.error))
        if min(plus.count, minus.count) and abs(size - stated) > max(REBOUND_BIAS_M, NOTED_ERRORS * error):
            found.append(
                f"{CLIPS_TOML}: {key} = {stated:g} m, but rebounds put the cushions {size:.3f} m apart, within "
                f"{error * 1e3:.0f} mm: measure it again from nose to nose, or recalibrate the camera; "
                "sysid discover says which of them is off"
            )
    return found


def _scale(clip_set: ClipSet, seen: dict[str, Typical]) -> Contradiction | None:
    """Diameter and cushions that are all off by one factor: the scale of the tracks."""
    limits = clip_set.table.centre_limits(clip_set.ball)
    contact, stated = contact_distance(clip_set), clip_set.ball.diameter
    factors = {f"balls meet {contact.value:.4f} m apart": contact.value / stated} if contact.count else {}
    for axis, letter in enumerate("xy"):
        turns = [seen[rail].value for rail in ("+" + letter, "-" + letter) if seen[rail].count]
        if turns:
            key = f"turn at |{letter}| = {np.mean(turns):.3f} m"
            factors[key] = float(np.mean(turns) / limits[axis])
    values = [value for value in factors.values() if np.isfinite(value)]
    if len(values) < 2 or min(abs(v - 1) for v in values) < SOUND_TABLE or np.ptp(values) > SAME_FACTOR:
        return None
    factor = values[-1]  # cushions show it better
    certain = abs(factor - 1) > CERTAIN_TABLE
    text = (
        f"everything is {factor:.3f} of the size that {CLIPS_TOML} states ({', '.join(factors)}; diameter {stated:g}, "
        f"turns at {limits[0]:.3f} and {limits[1]:.3f}): multiply x and y by {1 / factor:.4g}, or correct the table"
    )
    return Contradiction(ALL_CLIPS, text, certain, True)


def pocket_note(clip_set: ClipSet) -> str | None:
    """A table with the size of another game but snooker pockets, the default when none are given."""
    table = clip_set.table
    if table.pockets is not True:
        return None
    for name, known in TABLE_SETS.items():
        sizes = np.array([table.length, table.width, clip_set.ball.diameter])
        meant = np.array([known.table.length, known.table.width, known.ball.diameter])
        if isinstance(known.table.pockets, PocketShapes) and (np.abs(sizes / meant - 1) < SAME_SIZE).all():
            return f'{CLIPS_TOML}: pockets are those of snooker on a table of the size of {name}: pockets = "{name}"'
    return None


def _stated(table: Table, axis: int) -> float:
    return (table.length, table.width)[axis]


def _table_remedy(ball: Ball, plus: Typical, minus: Typical, letter: str, key: str, limit: float) -> str:
    """The correction that makes both cushions of an axis fit, in words."""
    if min(plus.count, minus.count) == 0:
        return f"correct {key}, measured from nose to nose, or calibrate the camera"
    shift, half_size = (plus.value - minus.value) / 2, (plus.value + minus.value) / 2
    if abs(shift) > SOUND_TABLE * limit / 2 and abs(half_size - limit) < abs(shift):
        return f"the origin lies off the table's centre: subtract {shift:.3f} from {letter}"
    size = 2 * (half_size + ball.radius)
    return f"correct {key}, measured from nose to nose (about {size:.2f} m), or calibrate the camera"
