"""What the tracks of a whole clip set contradict: the ball's diameter, the table, the commands, the frame rate.

In: a `ClipSet`. Out: `Contradiction`s: beyond doubt, or to be looked at.

    diameter    a resting ball that is struck moves off when the other's centre is a diameter away: where that one is,
                extrapolated to the moment at which this one began to move, gives the distance
    cushions    lines through the samples before and after a rebound meet where the ball's centre turned
    azimuths    the struck ball first moves where the cue was aimed
    frame rate  intervals of the stamps are whole frames
    speeds      no cue gives a ball more than some 13 m/s

A camera may be off by as much as the catalogue's effects of it at their usual size; that is no contradiction.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from models.shot import NOSE_COSINE, Array, Ball, Table
from sysid.clips.clip_set import Clip, ClipSet, Observation
from sysid.clips.names import CLIPS_TOML

ALL_CLIPS = "all clips"
MIN_COMMANDS, MIN_IMPACTS = 4, 2  # below which nothing is said
MIN_CERTAIN_REBOUNDS, MIN_INTERVALS = 2, 20
IMPACT_ERROR = 0.02  # of the distance at one impact, over the diameter: scatter of few may be too small by chance
REBOUND_ERROR = 0.003  # of the place of one rebound, over half the table
MIN_SIGNIFICANCE = 5.0  # standard errors
SOUND_DIAMETER, CERTAIN_DIAMETER = 0.04, 0.08  # relative departures: none, and one beyond doubt
SOUND_TABLE, CERTAIN_TABLE = 0.025, 0.06  # of half the table; a lens at its usual size moves a cushion by 2 %
SOUND_TURN, FITTING_TURN = 0.25, 0.1  # of the first direction from the aim [rad]
SOUND_INTERVAL = 0.1  # relative departure of the stamps' interval from a frame's; the clock's scale is fitted
MAX_CUE_SPEED, MAX_SPEED = 13.0, 30.0  # of a hard break, and beyond doubt [m/s]
SPEED_STEPS = 5  # of which the median is a speed: single samples may be wild
REST_M = 0.003  # of a ball that has not moved
REBOUND_BIAS_M = 0.004  # of the cushions' distance: lines through samples cut the corner of a rebound by some mm
NOTED_ERRORS = 2.0  # standard errors of it, which REBOUND_ERROR makes generous
BEGINNING_S = 0.03  # of a track, whose median is where the ball rests
ALONE_M = 0.15  # from others, for an impact of two balls
SLIDE_M_S2 = 2.0  # deceleration of a ball that has just been struck, 0.2 g
BEGIN_ROUNDS = 5  # of the moment at which it began to move
STRUCK_SAMPLES, STRIKING_SAMPLES = 5, 7  # after and before an impact
MAX_BEGIN_S = 0.1  # from the moment at which a struck ball begins to move to its next sample
MIN_STRIKING_M = 0.01  # along which the other ball moves in those samples
MIN_STRUCK_SPEED = 0.15  # of a ball that was struck [m/s]
MAX_BENT_M = 0.003  # residual of a parabola before an impact of balls, of lines before and after a rebound
REBOUND_SAMPLES = 4  # before and after a rebound
MIN_TURN_RATIO = 2.0  # change of velocity over what the cloth may cause: a ball drawn back turns as well
POCKET_M = 0.15  # from a pocket, within which jaws may turn a ball
MIN_TOWARDS, MIN_AWAY = 0.2, 0.1  # speeds at a cushion [m/s]
NEAR_CUSHION = 0.3  # of half the table, from where the stated table has a cushion
MAX_PLACE_M, MIN_STEP_S = 100.0, 1e-6  # of rows that can be computed with
AIMED_M = 0.08  # along which the first direction is measured


@dataclass(frozen=True)
class Contradiction:
    """One line with its remedy."""

    where: str  # the file whose statement the tracks contradict, or all clips
    text: str
    certain: bool  # beyond doubt: a fault, else a warning
    places: bool = False  # whether many balls must lie off the stated table


@dataclass(frozen=True)
class Typical:
    """The median of some values, and its standard error."""

    value: float
    error: float
    count: int

    def departs(self, from_value: float, tolerance: float) -> bool:
        """Whether it differs by more than a tolerance, and by more than chance explains."""
        off = abs(self.value - from_value)  # NaN of none
        return off > max(tolerance, MIN_SIGNIFICANCE * self.error)


def contradictions(clip_set: ClipSet) -> list[Contradiction]:
    """All of a clip set's, each once; its clips must be sound: `is_sound`."""
    found = [_frame_rate(clip_set), _speeds(clip_set)]
    if found[1] is None:  # else all that is derived from speeds is wrong
        found += [_diameter(clip_set), *_cushions(clip_set), _azimuths(clip_set)]
    return [one for one in found if one is not None]


def is_sound(clip: Clip) -> bool:
    """Whether times increase and everything is finite and of a size that can be computed with."""
    return bool(clip.balls) and all(
        len(seen.time) > 0
        and bool(np.isfinite(seen.time).all())
        and bool((np.abs(seen.xy) < MAX_PLACE_M).all())
        and bool((np.diff(seen.time) > MIN_STEP_S).all())
        for seen in clip.balls.values()
    )


def _typical(values: list[float], least_count: int, least_spread: float = 0.0) -> Typical:
    """Of too few values the standard error is infinite."""
    if len(values) < least_count:
        return Typical(np.nan, np.inf, len(values))
    median = float(np.median(values))
    spread = max(1.4826 * float(np.median(np.abs(np.array(values) - median))), least_spread)
    return Typical(median, 1.2533 * spread / np.sqrt(len(values)), len(values))


def contact_distance(clip_set: ClipSet) -> Typical:
    """Distance of the centres at impacts of two balls, one of them at rest [m]."""
    found = [d for clip in clip_set.clips for d in _distances(clip)]
    return _typical(found, MIN_IMPACTS, IMPACT_ERROR * clip_set.ball.diameter)


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
        if name == clip.struck or first < 1 or len(struck.time) < first + STRUCK_SAMPLES:
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
    """How far a ball is from a place at about a time [m]."""
    k = int(np.argmin(np.abs(seen.time - time)))
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
    """Where a ball that moved smoothly until then was [m]; None where it did not, or was not seen."""
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
    """How far from the table's centre balls' centres turn at each cushion [m]."""
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
    return {rail: _typical(values, 1, errors[rail]) for rail, values in found.items()}


def _turns(clip: Clip, name: str, out: Array, least: float) -> Iterator[tuple[float, Array]]:
    """Largest distances `out` at which a ball turns back, beyond `least`, and where; no other ball is near."""
    n, time, xy = REBOUND_SAMPLES, clip.balls[name].time, clip.balls[name].xy
    if len(out) <= 2 * n:
        return
    peaks = 1 + np.flatnonzero((out[1:-1] >= out[:-2]) & (out[1:-1] > out[2:]) & (out[1:-1] > least))
    for k in peaks[(peaks >= n) & (peaks < len(out) - n)].tolist():
        clock, parts = time - time[k], (slice(k - n, k), slice(k + 1, k + n + 1))
        lines = [np.polyfit(clock[part], out[part], 1) for part in parts]
        bent = max(float(np.abs(out[p] - np.polyval(fit, clock[p])).max()) for p, fit in zip(parts, lines, strict=True))
        (towards, there), (away, back) = lines
        by_cloth = SLIDE_M_S2 * float(np.mean(clock[parts[1]]) - np.mean(clock[parts[0]]))
        if towards < MIN_TOWARDS or away > -MIN_AWAY or towards - away < MIN_TURN_RATIO * by_cloth or bent > MAX_BENT_M:
            continue
        met = (back - there) / (towards - away)
        alone = all(_gap(seen, xy[k], float(time[k])) > ALONE_M for o, seen in clip.balls.items() if o != name)
        if clock[k - 1] <= met <= clock[k + 1] and alone:
            yield float(there + towards * met), xy[k]


def _cushions(clip_set: ClipSet) -> Iterator[Contradiction]:
    """Cushions of an axis that are not where the stated table has them."""
    seen, limits = rebounds(clip_set), clip_set.table.centre_limits(clip_set.ball)
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
    """Cushions that stand noticeably closer or farther apart than stated: the table or the camera is a little off."""
    seen, found = rebounds(clip_set), []
    for axis, (letter, key) in enumerate((("x", "length"), ("y", "width"))):
        plus, minus, stated = seen["+" + letter], seen["-" + letter], _stated(clip_set.table, axis)
        size = plus.value + minus.value + 2 * NOSE_COSINE * clip_set.ball.radius
        error = float(np.hypot(plus.error, minus.error))
        if min(plus.count, minus.count) and abs(size - stated) > max(REBOUND_BIAS_M, NOTED_ERRORS * error):
            found.append(
                f"{CLIPS_TOML}: {key} = {stated:g} m, but rebounds put the cushions {size:.3f} m apart, give or take "
                f"{error * 1e3:.0f} mm: measure it again from nose to nose, or calibrate the camera; "
                "sysid discover says which of them is off"
            )
    return found


def _stated(table: Table, axis: int) -> float:
    return (table.length, table.width)[axis]


def _table_remedy(ball: Ball, plus: Typical, minus: Typical, letter: str, key: str, limit: float) -> str:
    """What would make both cushions of an axis fit."""
    if min(plus.count, minus.count) == 0:
        return f"correct {key}, measured from nose to nose, or calibrate the camera"
    shift, half_size = (plus.value - minus.value) / 2, (plus.value + minus.value) / 2
    if abs(shift) > SOUND_TABLE * limit / 2 and abs(half_size - limit) < abs(shift):
        return f"the origin lies off the table's centre: subtract {shift:.3f} from {letter}"
    size = 2 * (half_size + ball.radius)
    return f"correct {key}, measured from nose to nose (about {size:.2f} m), or calibrate the camera"


READINGS_OF_AZIMUTH = {  # (factor, offset) of the azimuth, and the remedy where tracks fit that
    (-1.0, 0.0): "y is counted downwards, or azimuths clockwise: change the sign of y",
    (-1.0, np.pi): "x is counted from right to left: change the sign of x",
    (1.0, np.pi): "both axes are reversed: change the signs of x and y",
    (-1.0, np.pi / 2): "x and y are exchanged, or azimuths count from y: exchange the columns",
    (1.0, np.pi / 2): "azimuths are counted from -y: add a quarter turn to them",
    (1.0, -np.pi / 2): "azimuths are counted from +y: subtract a quarter turn from them",
}


def _azimuths(clip_set: ClipSet) -> Contradiction | None:
    """Commands that point elsewhere than the tracks."""
    aims = [(c.cue.azimuth, went) for c in clip_set.clips if c.cue and (went := _first_direction(c)) is not None]
    if len(aims) < MIN_COMMANDS:
        return None
    stated, went = np.array(aims).T

    def off(factor: float, offset: float) -> float:
        return float(np.median(np.abs((went - factor * stated - offset + np.pi) % (2 * np.pi) - np.pi)))

    here = off(1.0, 0.0)
    if here < SOUND_TURN:
        return None
    best = min(READINGS_OF_AZIMUTH, key=lambda reading: off(*reading))
    head = f"struck balls set off {here:.2f} rad beside the commanded azimuth (median of {len(aims)})"
    if off(*best) < FITTING_TURN:
        return Contradiction(ALL_CLIPS, f"{head}; {READINGS_OF_AZIMUTH[best]}", True)
    return Contradiction(
        ALL_CLIPS, f"{head}: correct cue.azimuth, counted from +x to +y in rad, or leave cue out", False
    )


def _first_direction(clip: Clip) -> float | None:
    """The struck ball's first direction [rad]; None where it hardly moves."""
    xy = clip.balls[clip.struck].xy if clip.struck in clip.balls else np.zeros((0, 2))
    far = np.flatnonzero(np.hypot(*(xy - xy[:1]).T) > AIMED_M)
    if not len(far):
        return None
    step = xy[far[0]] - xy[0]
    return float(np.arctan2(step[1], step[0]))


def _frame_rate(clip_set: ClipSet) -> Contradiction | None:
    """Stamps whose interval is not that of the stated frame rate."""
    steps = [np.diff(np.unique(np.concatenate([o.time for o in c.balls.values()]))) for c in clip_set.clips]
    pooled = np.concatenate([np.zeros(0), *steps])
    if len(pooled) < MIN_INTERVALS:
        return None
    step = float(np.median(pooled))
    if abs(step * clip_set.fps - 1) < SOUND_INTERVAL:
        return None
    text = (
        f"fps = {clip_set.fps:g}, but rows are {step:.4g} s apart, as at {1 / step:.4g} frames a second: "
        f"correct fps if t is right, else multiply t by {1 / (step * clip_set.fps):.4g}"
    )
    return Contradiction(CLIPS_TOML, text, False)


def _speeds(clip_set: ClipSet) -> Contradiction | None:
    """Balls that are faster than any cue makes them."""
    fastest = [(max(map(_top_speed, c.balls.values()), default=0.0), c.file) for c in clip_set.clips]
    fast = [one for one in fastest if one[0] > MAX_CUE_SPEED]
    if not fast:
        return None
    speed, file = max(fast)
    more = f" ({len(fast) - 1} more clips have such)" if len(fast) > 1 else ""
    text = f"a ball moves at {speed:.3g} m/s{more}, and no cue gives more than {MAX_CUE_SPEED:g}: correct t or fps"
    return Contradiction(file, text, speed > MAX_SPEED)


def _top_speed(seen: Observation) -> float:
    """The largest median speed over some steps [m/s]."""
    if len(seen.time) <= SPEED_STEPS:
        return 0.0
    step = np.hypot(*np.diff(seen.xy, axis=0).T) / np.diff(seen.time)
    return float(np.median(np.lib.stride_tricks.sliding_window_view(step, SPEED_STEPS), axis=1).max())
