"""What a ball meets next, and when: on parabolas in closed form, on curves by steps that cannot pass a touch.

A gap g that closes at speed v, while no more than A accelerates it, is open for at least the time in which
g - v t - A t^2 / 2 falls to zero. Stepping on by that time again and again comes to the first touch from before it,
quadratically fast where it is met at a speed, and to none where there is none. For two balls the gap is their distance
less a diameter, which only curves outwards beside that. A time of -1 says that things are pressed together at rest.
"""

from __future__ import annotations

import math

import numpy as np

from models.analytic.events import (
    CLOSED_GAP_M,
    INSIDE_M,
    LEAN_SPEED,
    MIN_IMPACT_SPEED,
    in_mouth,
    line,
    meeting,
    mouth_sides,
)
from models.analytic.geometry import Parabola
from models.analytic.pocket import is_behind, is_facing, meet_jaw, straight
from models.compiled import compiled, compiled_in_place
from models.engine import columns as col
from models.engine.motion import CURVE, POTTED, REST, place, pull
from models.engine.workspace import Chord, Motion

BALL, CUSHION, POCKET, SWITCH = 0, 1, 2, 3
MOUTH_DEPTH_M = 1e-4  # depth beyond the line of contact from which a ball is in a pocket's mouth for certain [m]
# Until what is pressed together at rest is looked at again [s]: at most what lets it sink by PRESSED_DEPTH_M, but for
# the shortest time, and what lets it come to this part of the speed at which it no longer leans.
PRESSED_RECHECK_S, MAX_RECHECK_S, PRESSED_DEPTH_M, LEAN_SHARE = 1e-3, 4e-3, 5e-7, 0.8
BESIDE_MOUTH_M = 1e-9  # distance beyond a mouth's side or nose line at which a ball is certainly outside or inside [m]
MOST_STEPS = 200  # largest number of steps towards a touch
NO_STEP_S = 1e-15  # step below which there is none [s]


@compiled
def recheck(push):  # type: ignore[no-untyped-def]
    """Until what is pressed by an acceleration `push` [m/s^2] is looked at again [s]."""
    push = max(push, 1e-9)
    soon = min(PRESSED_RECHECK_S, LEAN_SHARE * LEAN_SPEED / push)
    return min(max(math.sqrt(2.0 * PRESSED_DEPTH_M / push), soon), MAX_RECHECK_S)


@compiled
def _wait(gap, closing, bound):  # type: ignore[no-untyped-def]
    """The time for which a gap is open for certain."""
    if gap <= CLOSED_GAP_M:  # it has just been closed, and opens
        back = 1.0 if gap < -INSIDE_M else 2.0  # it may turn before it comes out
        return max(-back * closing / bound, 1e-9) if bound > 0.0 else np.inf
    low = closing + math.sqrt(closing * closing + 2.0 * bound * gap)
    return 2.0 * gap / low if low > 0.0 else np.inf


@compiled_in_place
def _keeps_to(b, m, nx, ny, end):  # type: ignore[no-untyped-def]
    """Whether a ball on a curve neither leaves a line with the normal (nx, ny) nor crosses it: it rolls along it."""
    most = 0.0
    for n in range(1, col.TERM_COUNT - 1):
        most += abs(nx * m[col.VX, n] + ny * m[col.VY, n])
    return most * (end - b[col.BEGIN]) <= CLOSED_GAP_M


@compiled_in_place
def _to_line(motion, nx, ny, level, t, end):  # type: ignore[no-untyped-def]
    """When a ball on a curve comes to the line nx x + ny y = level; inf for not before the end."""
    (b, m, kind), first = motion, True
    for _ in range(MOST_STEPS):
        x, y, vx, vy = place(b, m, kind, t)
        gap, closing = level - (nx * x + ny * y), nx * vx + ny * vy
        if gap <= CLOSED_GAP_M and closing > MIN_IMPACT_SPEED:
            return t
        if gap <= CLOSED_GAP_M and closing >= -MIN_IMPACT_SPEED and first:
            if _keeps_to(b, m, nx, ny, end):
                return np.inf
            ax, ay = pull(b, m, kind, t)
            if nx * ax + ny * ay > 0.0:
                return -1.0
        first = False
        wait = _wait(gap, closing, b[col.BOUND])
        t += wait
        if t > end:
            return np.inf
        if wait <= NO_STEP_S:
            return t
    return t


@compiled
def _apart(x, y, u, v):  # type: ignore[no-untyped-def]
    """Least distance of the origin from the chord between (x, y) and (u, v)."""
    dx, dy = u - x, v - y
    size = dx * dx + dy * dy
    s = min(max(-(x * dx + y * dy) / size, 0.0), 1.0) if size > 0.0 else 0.0
    x, y = x + s * dx, y + s * dy
    return math.sqrt(x * x + y * y)


@compiled_in_place
def _to_ball(motion, other, rho, t, end):  # type: ignore[no-untyped-def]
    """When two balls, one of them on a curve at least, come within rho of each other."""
    (b, m, kind), (c, n, does) = motion, other
    first, bound = True, b[col.BOUND] + c[col.BOUND]
    for _ in range(MOST_STEPS):
        x, y, vx, vy = place(b, m, kind, t)
        qx, qy, qvx, qvy = place(c, n, does, t)
        x, y, vx, vy = qx - x, qy - y, vx - qvx, vy - qvy
        d = math.sqrt(x * x + y * y)
        gap, closing = d - rho, (x * vx + y * vy) / d
        if gap <= CLOSED_GAP_M and closing > MIN_IMPACT_SPEED:
            return t
        if gap <= CLOSED_GAP_M and closing >= -MIN_IMPACT_SPEED and first:
            ax, ay = pull(b, m, kind, t)
            bx, by = pull(c, n, does, t)
            if x * (ax - bx) + y * (ay - by) > 0.0:
                return -1.0
        if first and gap > CLOSED_GAP_M:
            h = end - t
            ux, uy, _, _ = place(b, m, kind, end)
            qx, qy, _, _ = place(c, n, does, end)
            if _apart(x, y, qx - ux, qy - uy) > rho + 0.125 * bound * h * h:
                return np.inf
        first = False
        wait = _wait(gap, closing, bound)
        t += wait
        if t > end:
            return np.inf
        if wait <= NO_STEP_S:
            return t
    return t


@compiled
def _to_point(motion, px, py, rho, t, end):  # type: ignore[no-untyped-def]
    """When a ball on a curve comes within rho of a point, which is a body that rests."""
    point = np.zeros(col.COLUMN_COUNT)
    point[col.X], point[col.Y] = px, py
    return _to_ball(motion, Motion(point, motion.curve, REST), rho, t, end)


@compiled
def _next_depth(gap):  # type: ignore[no-untyped-def]
    """How deep in a mouth a ball at a gap is looked at again: just behind the line, since it may leave it sideways."""
    return BESIDE_MOUTH_M if gap >= -CLOSED_GAP_M else 2.0 * MOUTH_DEPTH_M


@compiled_in_place
def meet_table(motion, what, geometry, stays, until, left_out):  # type: ignore[no-untyped-def]
    """What of the table a ball meets next, within its motion and the time wanted; no pocket takes one that stays.

    `what` (2,): filled with the kind of event and the number of the rail, jaw or pocket.
    `left_out`: a bit for each rail, and each jaw after them, that is not looked at.
    """
    b, _, kind = motion
    b[col.MEET] = np.inf
    if kind in (REST, POTTED):
        return
    if kind == CURVE:
        _meet_table_on_curve(motion, what, geometry, stays, until, left_out)
        return
    _, limits, half, mouths, _, falls = geometry
    h = min(b[col.END], until) - b[col.CLOCK]
    bent = falls.shape[0] > 0 and not stays
    for rail in range(4):
        if left_out >> rail & 1:
            continue
        k, sign = rail // 2, 1.0 - 2.0 * (rail % 2)
        if not bent and not stays:
            _leave_sideways(motion, what, rail, geometry, b[col.CLOCK] + h)
        if bent:
            t = straight(rail, geometry, b[col.X : col.VX], b[col.VX : col.WX], b[col.AX : col.END], h)
        else:
            t = line(limits[k] - sign * b[k], sign * b[col.VX + k], sign * b[col.AX + k], h)
        if t == np.inf:
            continue
        if t < 0.0:
            _look_again(b, what, sign * b[col.AX + k])
            continue
        o = 1 - k
        found = CUSHION
        gap, along = limits[k] - sign * b[k], b[o] + b[col.VX + o] * t + 0.5 * b[col.AX + o] * t * t
        if not bent and not stays and gap < -MOUTH_DEPTH_M and in_mouth(b[o], rail, half, mouths):
            found = POCKET
            t = line(half[k] - sign * b[k], sign * b[col.VX + k], sign * b[col.AX + k], h)
        elif not bent and not stays and in_mouth(along, rail, half, mouths):
            found = SWITCH  # once it is in the mouth, it is looked at again
            t = line(gap + _next_depth(gap), sign * b[col.VX + k], sign * b[col.AX + k], h)
        if t >= 0.0 and b[col.CLOCK] + t < b[col.MEET]:
            b[col.MEET], what[0], what[1] = b[col.CLOCK] + t, found, rail
    if bent:
        _meet_jaws(b, what, geometry, h, left_out)
    elif mouths[0] > 0.0 and not stays:
        for corner in range(4):
            sx, sy = 1.0 - 2.0 * (corner % 2), 1.0 - 2.0 * (corner // 2)
            t = meeting(_seen_from(b, sx * half[0], sy * half[1]), mouths[2], h)
            if t >= 0.0 and b[col.CLOCK] + t < b[col.MEET]:
                b[col.MEET], what[0], what[1] = b[col.CLOCK] + t, POCKET, -1


@compiled_in_place
def _meet_jaws(b, what, geometry, h, left_out):  # type: ignore[no-untyped-def]
    """What of the jaws, and of the edges behind them, a ball on no curve meets within h [s]."""
    jaws, falls = geometry.jaws, geometry.falls
    for k in range(jaws.shape[0] + falls.shape[0]):
        fall = k >= jaws.shape[0]
        if not fall and left_out >> (4 + k) & 1:
            continue
        if fall:
            at = falls[k - jaws.shape[0]]
            t = meeting(_seen_from(b, at[0], at[1]), at[2], h)
        else:
            t = meet_jaw(jaws[k], _seen_from(b, 0.0, 0.0), h)
        if t == -1.0:
            if not fall:
                _look_again(b, what, b[col.BOUND])
        elif b[col.CLOCK] + t < b[col.MEET]:
            b[col.MEET] = b[col.CLOCK] + t
            what[0], what[1] = (POCKET, k - jaws.shape[0]) if fall else (CUSHION, 4 + k)


@compiled_in_place
def _seen_from(b, x, y):  # type: ignore[no-untyped-def]
    """The parabola of a ball that is on no curve, relative to a point."""
    return Parabola(b[col.X] - x, b[col.Y] - y, b[col.VX], b[col.VY], b[col.AX], b[col.AY])


@compiled_in_place
def _leave_sideways(motion, what, rail, geometry, end):  # type: ignore[no-untyped-def]
    """A ball that would leave a mouth sideways, beyond the cushions' line: to the pocket, or to meet the cushion."""
    b, m, kind = motion
    limits, half, mouths = geometry.limits, geometry.half, geometry.mouths
    k, sign, now = rail // 2, 1.0 - 2.0 * (rail % 2), b[col.CLOCK]
    o = 1 - k
    if mouths[0] <= 0.0 or limits[k] - sign * b[k] >= MOUTH_DEPTH_M or not in_mouth(b[o], rail, half, mouths):
        return
    for side in range(2):
        way, level = 1.0 - 2.0 * side, mouth_sides(b[o], rail, half, mouths)[1 - side]
        if abs(level) == np.inf:
            continue
        level += way * BESIDE_MOUTH_M
        if kind == CURVE:
            nx, ny = (way, 0.0) if o == 0 else (0.0, way)
            t = _to_line(motion, nx, ny, way * level, now, end)
        else:
            t = now + line(way * (level - b[o]), way * b[col.VX + o], way * b[col.AX + o], end - now)
        if not now <= t < b[col.MEET] or t > end:
            continue
        x, y, _, _ = place(b, m, kind, t)
        gap = limits[k] - sign * (x if k == 0 else y)
        if gap < -CLOSED_GAP_M:
            b[col.MEET], what[0], what[1] = t, POCKET if gap < -MOUTH_DEPTH_M else SWITCH, rail


@compiled_in_place
def _look_again(b, what, push):  # type: ignore[no-untyped-def]
    later = b[col.CLOCK] + recheck(push)
    if later < b[col.MEET]:
        b[col.MEET], what[0] = later, SWITCH


@compiled_in_place
def _meet_facing_on_curve(motion, what, jaw, number, now, end):  # type: ignore[no-untyped-def]
    b, m, kind = motion
    nx, ny = jaw[3], jaw[4]
    level = nx * jaw[0] + ny * jaw[1]
    if is_behind(jaw, b[col.X], b[col.Y]):  # once it has come out, it is looked at again
        t = _to_line(motion, -nx, -ny, -level, now, end)
        if t != -1.0 and t < b[col.MEET]:
            b[col.MEET], what[0] = t, SWITCH
        return
    t = _to_line(motion, nx, ny, level, now, end)
    if t == np.inf:
        return
    x, y, _, _ = place(b, m, kind, max(t, now))
    if abs(nx * (y - jaw[1]) - ny * (x - jaw[0])) > jaw[2]:
        return
    if t < 0.0:
        _look_again(b, what, b[col.BOUND])
    elif t < b[col.MEET]:
        b[col.MEET], what[0], what[1] = t, CUSHION, number


@compiled_in_place
def _meet_table_on_curve(motion, what, geometry, stays, until, left_out):  # type: ignore[no-untyped-def]
    (b, m, kind), (_, limits, half, mouths, _, falls) = motion, geometry
    now, end = b[col.CLOCK], min(b[col.END], until)
    if end <= now:
        return
    bent = falls.shape[0] > 0 and not stays
    # A curve keeps within A h^2 / 8 of its chord: which excludes most of the table.
    ex, ey, _, _ = place(b, m, kind, end)
    sagitta = 0.125 * b[col.BOUND] * (end - now) ** 2
    for rail in range(4):
        if left_out >> rail & 1:
            continue
        k, sign = rail // 2, 1.0 - 2.0 * (rail % 2)
        o, gap = 1 - k, limits[k] - sign * b[k]
        nx, ny = (sign, 0.0) if k == 0 else (0.0, sign)
        if not bent and not stays:
            _leave_sideways(motion, what, rail, geometry, end)
        if gap > CLOSED_GAP_M and min(gap, limits[k] - sign * (ex if k == 0 else ey)) > sagitta:
            continue
        if bent and gap < -CLOSED_GAP_M and in_mouth(b[o], rail, half, mouths):
            # Between the jaws, beyond the line: once it has come out, it is looked at again.
            t = _to_line(motion, -nx, -ny, -limits[k], now, end)
            if t != np.inf and t != -1.0 and t < b[col.MEET]:
                b[col.MEET], what[0] = t, SWITCH
            continue
        t = _to_line(motion, nx, ny, limits[k], now, end)
        if t == np.inf:
            continue
        if t < 0.0:
            _look_again(b, what, sign * b[col.AX + k])
            continue
        x, y, _, _ = place(b, m, kind, t)
        found = CUSHION
        if not stays and in_mouth(y if k == 0 else x, rail, half, mouths):
            if bent:
                continue
            found, level = SWITCH, limits[k] + _next_depth(gap)
            if gap < -MOUTH_DEPTH_M and in_mouth(b[o], rail, half, mouths):
                found, level = POCKET, half[k]
            t = _to_line(motion, nx, ny, level, now, end)
        if t >= 0.0 and t < b[col.MEET]:
            b[col.MEET], what[0], what[1] = t, found, rail
    if bent:
        _meet_jaws_on_curve(motion, what, geometry, Chord(ex, ey, sagitta, end), left_out)
    elif mouths[0] > 0.0 and not stays:
        for corner in range(4):
            px, py = (1.0 - 2.0 * (corner % 2)) * half[0], (1.0 - 2.0 * (corner // 2)) * half[1]
            if _apart(px - b[col.X], py - b[col.Y], px - ex, py - ey) > mouths[2] + CLOSED_GAP_M + sagitta:
                continue
            t = _to_point(motion, px, py, mouths[2], now, end)
            if t >= 0.0 and t < b[col.MEET]:
                b[col.MEET], what[0], what[1] = t, POCKET, -1


@compiled_in_place
def _meet_jaws_on_curve(motion, what, geometry, chord, left_out):  # type: ignore[no-untyped-def]
    """What of the jaws, and of the edges behind them, a ball on a curve meets before the end of its `Chord`."""
    b, now, jaws, falls = motion.ball, motion.ball[col.CLOCK], geometry.jaws, geometry.falls
    for k in range(jaws.shape[0] + falls.shape[0]):
        fall = k >= jaws.shape[0]
        if not fall and left_out >> (4 + k) & 1:
            continue
        at = falls[k - jaws.shape[0]] if fall else jaws[k]
        apart = _apart(at[0] - b[col.X], at[1] - b[col.Y], at[0] - chord.x, at[1] - chord.y)
        if apart > at[2] + CLOSED_GAP_M + chord.sagitta:
            continue
        if not fall and is_facing(at):
            _meet_facing_on_curve(motion, what, at, 4 + k, now, chord.end)
            continue
        t = _to_point(motion, at[0], at[1], at[2], now, chord.end)
        if t == -1.0:
            if not fall:
                _look_again(b, what, b[col.BOUND])
        elif t < b[col.MEET]:
            b[col.MEET] = t
            what[0], what[1] = (POCKET, k - jaws.shape[0]) if fall else (CUSHION, 4 + k)


@compiled_in_place
def meet_balls(balls, notes, i, radius, now, until):  # type: ignore[no-untyped-def]
    """When a ball meets each other one, within both motions: fills the times `pair`, and `again` where pressed."""
    b, m, kind, pair, again = balls.rows, balls.curves, balls.kind, notes.pair, notes.again
    for j in range(b.shape[0]):
        if j == i:
            continue
        at = i * (i - 1) // 2 + j if j < i else j * (j - 1) // 2 + i
        pair[at], again[at] = np.inf, False
        if kind[i] == POTTED or kind[j] == POTTED or (kind[i] == REST and kind[j] == REST):
            continue
        end = min(b[i, col.END], b[j, col.END], until)
        if kind[i] == CURVE or kind[j] == CURVE:
            one, other = Motion(b[i], m[i], kind[i]), Motion(b[j], m[j], kind[j])
            t = _to_ball(one, other, 2.0 * radius, now, end) if end > now else np.inf
            if t == -1.0:
                pair[at], again[at] = now + recheck(b[i, col.BOUND] + b[j, col.BOUND]), True
            else:
                pair[at] = t
            continue
        d = now - b[j, col.CLOCK]
        x = b[i, col.X] - b[j, col.X] - (b[j, col.VX] + 0.5 * b[j, col.AX] * d) * d
        y = b[i, col.Y] - b[j, col.Y] - (b[j, col.VY] + 0.5 * b[j, col.AY] * d) * d
        vx, vy = b[i, col.VX] - b[j, col.VX] - b[j, col.AX] * d, b[i, col.VY] - b[j, col.VY] - b[j, col.AY] * d
        way = Parabola(x, y, vx, vy, b[i, col.AX] - b[j, col.AX], b[i, col.AY] - b[j, col.AY])
        t = meeting(way, 2.0 * radius, end - now)
        if t == -1.0:
            pair[at], again[at] = now + PRESSED_RECHECK_S, True
        else:
            pair[at] = now + t
