"""Contradictions between the tracks of a clip set and its entries: ball diameter, table, commands, times.

In: a `ClipSet`. Out: `Contradiction`s: certain faults, or warnings.

    diameter    a resting ball that is struck moves off when the other's centre is a diameter away: where that one is,
                extrapolated to the moment at which this one began to move, gives the distance
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
from sysid.clips.clip_set import Clip, ClipSet, Observation
from sysid.clips.consistency.aims import azimuths, speeds_of_cue
from sysid.clips.consistency.contradiction import ALL_CLIPS, Contradiction, Typical, typical
from sysid.clips.consistency.marks import marks
from sysid.clips.consistency.strike import REST_M, struck_fault
from sysid.clips.consistency.tempo import frame_rate, rolling, speeds
from sysid.clips.names import CLIPS_TOML

MIN_IMPACTS = 2  # fewer impacts are not judged
MIN_CERTAIN_REBOUNDS = 2
IMPACT_ERROR = 0.02  # least error of the distance at one impact, over the diameter: a few may agree by chance
REBOUND_ERROR = 0.003  # least error of the position of one rebound, over half the table
SOUND_DIAMETER, CERTAIN_DIAMETER = 0.04, 0.06  # relative departures: no fault up to here, and a certain fault
SOUND_TABLE, CERTAIN_TABLE = 0.025, 0.06  # relative departures of half the table; a lens moves a cushion by 2 %
SAME_SIZE = 0.015  # relative difference up to which table and balls count as those of a named table
SAME_FACTOR = 0.04  # largest spread of the factors by which diameter and cushions are off, for one common cause
REBOUND_BIAS_M = 0.004  # bias of the cushions' distance: lines through samples cut the corner of a rebound by some mm
NOTED_ERRORS = 2.0  # standard errors for a warning; REBOUND_ERROR makes them large
BEGINNING_S = 0.03  # duration of a track's beginning, whose median is the ball's resting place
ALONE_M = 0.15  # smallest distance of other balls from an impact of two balls
SLIDE_M_S2 = 2.0  # deceleration of a ball just after it was struck, 0.2 g
BEGIN_ROUNDS = 5  # iterations for the moment at which a ball began to move
STRUCK_SAMPLES, STRIKING_SAMPLES = 5, 7  # after and before an impact
MAX_BEGIN_S = 0.1  # from the moment at which a struck ball begins to move to its next sample
MIN_STRIKING_M = 0.01  # least distance that the other ball moves in those samples
MIN_STRUCK_SPEED = 0.15  # least speed of a ball that was struck [m/s]
MAX_BENT_M = 0.003  # largest residual of the parabola before an impact of balls, and of the lines at a rebound
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


def contact_distance(clip_set: ClipSet) -> Typical:
    """Distance between centres at impacts with a resting ball [m]."""
    found = [d for clip in clip_set.clips for d in _distances(clip)]
    return typical(found, MIN_IMPACTS, IMPACT_ERROR * clip_set.ball.diameter)


def _diameter(clip_set: ClipSet) -> Contradiction | None:
    stated, seen = clip_set.ball.diameter, contact_distance(clip_set)
    if not seen.departs(stated, SOUND_DIAMETER * stated):
        return None
    text = (
        f"diameter = {stated:g} m, but balls meet with their centres {seen.value:.4f} m apart "
        f"({seen.count} impacts): correct the diameter, or the scale of the tracks"
    )
    return Contradiction(CLIPS_TOML, text, seen.departs(stated, CERTAIN_DIAMETER * stated))


def _distances(clip: Clip) -> Iterator[float]:
    for name, struck in clip.balls.items():
        begins = struck.time <= struck.time[0] + BEGINNING_S
        moved = np.flatnonzero(np.hypot(*(struck.xy - np.median(struck.xy[begins], axis=0)).T) > REST_M)
        first = int(moved[0]) if len(moved) else 0
        if name in clip.first or first < 1 or len(struck.time) < first + STRUCK_SAMPLES:
            continue
        place, part = np.median(struck.xy[: max(first - 1, 1)], axis=0), slice(first, first + STRUCK_SAMPLES)
        begin = float(struck.time[first])
        near = [other for other in clip.balls if other != name and _gap(clip.balls[other], place, begin) < ALONE_M]
        when = _began(struck.time[part], struck.xy[part] - place) if len(near) == 1 else None
        if when is None or not begin - MAX_BEGIN_S < when < begin:
            continue
        striking = _position(clip.balls[near[0]], when)
        if striking is not None:
            yield float(np.hypot(*(striking - place)))


def _gap(seen: Observation, place: Array, time: float) -> float:
    """Distance of a ball from a place at about a given time [m]."""
    after = int(np.searchsorted(seen.time, time))
    near = range(max(after - 1, 0), min(after + 1, len(seen.time)))
    k = min(near, key=lambda one: abs(seen.time[one] - time))
    return float(np.hypot(*(seen.xy[k] - place)))


def _began(time: Array, off: Array) -> float | None:
    """When a ball that slides, then rolls, began to move, from its first samples relative to its place [s]."""
    far = float(np.hypot(*off[-1]))
    if far < REST_M:
        return None
    along = off @ (off[-1] / far)
    when, speed = float(time[0]), 1.0
    for _ in range(BEGIN_ROUNDS):
        sliding = np.minimum(time - when, 2 * speed / (7 * SLIDE_M_S2))
        lost = SLIDE_M_S2 * sliding * (time - when - sliding / 2)
        speed, start = np.polyfit(time - time[0], along + lost, 1)
        if speed < MIN_STRUCK_SPEED:
            return None
        when = float(time[0] - start / speed)
    return when


def _position(seen: Observation, when: float) -> Array | None:
    """Position of a ball at a time, extrapolated from smooth motion [m]; None if it was unseen or not smooth."""
    end = int(np.searchsorted(seen.time, when))
    part = slice(max(end - STRIKING_SAMPLES, 0), end)
    time, xy = seen.time[part] - when, seen.xy[part]
    if len(time) < STRIKING_SAMPLES or -time[-1] > 2 * float(np.median(np.diff(time))):
        return None
    if float(np.hypot(*(xy[-1] - xy[0]))) < MIN_STRIKING_M:
        return None
    fit = np.polyfit(time, xy, 2)
    bent = xy - np.vander(time, 3) @ fit
    return np.asarray(fit[-1]) if float(np.sqrt(np.mean(bent**2))) < MAX_BENT_M else None


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
        if all(_gap(seen, xy[k], float(time[k])) > ALONE_M for o, seen in clip.balls.items() if o != name):
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
