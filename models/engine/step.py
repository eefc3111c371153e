"""One timestep of a shot, from what a row of numbers keeps to what it keeps next: for MuJoCo's state in anyone's loop.

The motions, impulses and clusters are those of models/engine/loop.py. As the step is short, and anyone may have changed
the state since the last one, all motions are laid anew at its beginning and after each event in it, all balls at one
time. What a step must remember of the one before is in the row: see simulation/step.py, which says what it is for. A
step that ends within a cluster keeps the state that the cluster began with, since contacts that are pressed together
say nothing of the work that is in them; the next one plays it again from there.
"""

from __future__ import annotations

import math

import numpy as np

from models import record as rec
from models.analytic.cloth import STILL_SPIN
from models.analytic.events import LEAN_SPEED, in_mouth
from models.analytic.spring import CUSHION_TIME
from models.compiled import compiled, compiled_within
from models.engine import columns as col
from models.engine.cluster import CROWD_GAP_M, through
from models.engine.curve import curve, lay_record
from models.engine.impacts import is_crowded, part
from models.engine.leaning import LEAN_MEMORY_S
from models.engine.motion import POTTED, REST, advance, arrive, plain_phase, pot
from models.engine.rigid import approach_speed, collide_alone, settle
from models.engine.rubber import delay_rebound, push_out, stopped_in_rail
from models.engine.touch import BALL, CUSHION, POCKET, SWITCH, meet_balls, meet_table
from models.shot import SESSION_FIELDS

PARKED_DEPTH = 1.0  # of potted balls below the slate [m], under the floor of a furnished table
MAX_STEP_EVENTS = 10_000  # events within a step, beyond which it is given up
NO_TIME_S = 1e-12  # rest of a step that is none [s]
# The row begins with when the kept state is of, when the strike was [s], the launch speed [m/s], when MuJoCo's state
# was written [s], whether it was, and the shot's session.
STATE_TIME, STRUCK_AT, LAUNCH, WRITTEN_AT, WRITTEN, SESSION = 0, 1, 2, 3, 4, 5
HEAD = SESSION + SESSION_FIELDS
# Then come the balls: the state of each as the engine has it (models/engine/motion.py, X to ROLLED), its orientation,
# until when it is known to lean, whether it is in play, and whether it came past a nose line within a mouth: then it is
# the pocket's, wherever it is when it comes to where it falls.
QUATERNION, LEANING, IN_PLAY, ENTERED, KEPT = 9, 13, 14, 15, 16
POSE, JOINT = 7, 13  # last, of each ball the numbers of qpos, and of qpos and qvel, that were written
JUST_POTTED = -1.0  # in the column IN_PLAY, otherwise 0 or 1


def row_length(balls: int) -> int:
    """How many numbers the row of so many balls has."""
    return HEAD + balls * (KEPT + JOINT)


@compiled
def _rotated(w, q, inverse):  # type: ignore[no-untyped-def]
    """A vector turned by a quaternion, or back."""
    sign = -1.0 if inverse else 1.0
    x, y, z = sign * q[1], sign * q[2], sign * q[3]
    tx, ty, tz = 2.0 * (y * w[2] - z * w[1]), 2.0 * (z * w[0] - x * w[2]), 2.0 * (x * w[1] - y * w[0])
    return w[0] + q[0] * tx + y * tz - z * ty, w[1] + q[0] * ty + z * tx - x * tz, w[2] + q[0] * tz + x * ty - y * tx


@compiled
def _turn(q, x, y, z):  # type: ignore[no-untyped-def]
    """Turn an orientation by the rotation vector (x, y, z), table frame [rad]."""
    angle = math.sqrt(x * x + y * y + z * z)
    if angle == 0.0:
        return
    c, s = math.cos(0.5 * angle), math.sin(0.5 * angle) / angle
    x, y, z = s * x, s * y, s * z
    a, b, d, e = q[0], q[1], q[2], q[3]
    q[0], q[1] = c * a - x * b - y * d - z * e, c * b + x * a + y * e - z * d
    q[2], q[3] = c * d - x * e + y * a + z * b, c * e + x * d - y * b + z * a
    q[:4] /= math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])


@compiled
def take_over(qpos, qvel, push, begin, step, places, speeds, bodies, kept, mass, radius, half):  # type: ignore[no-untyped-def]
    """Take over what differs from what was written, and what pushes."""
    n = places.size
    balls, written = kept[HEAD : HEAD + n * KEPT].reshape((n, KEPT)), kept[HEAD + n * KEPT :].reshape((n, JOINT))
    same = kept[WRITTEN] > 0.0 and kept[WRITTEN_AT] == begin
    for i in range(n):
        for k in range(JOINT):
            same = same and written[i, k] == (qpos[places[i] + k] if k < POSE else qvel[speeds[i] + k - POSE])
        for k in range(6):
            same = same and push[bodies[i], k] == 0.0
    if same:
        return
    kept[STATE_TIME] = begin
    for i in range(n):
        b, p, v = balls[i], qpos[places[i] : places[i] + POSE], qvel[speeds[i] : speeds[i] + 6]
        there = abs(p[0]) <= half[0] and abs(p[1]) <= half[1] and p[2] > 0.0
        b[IN_PLAY] = 1.0 if there else 0.0
        size = math.sqrt(p[3] * p[3] + p[4] * p[4] + p[5] * p[5] + p[6] * p[6])
        b[QUATERNION : QUATERNION + 4] = p[3:7] / size if size > 0.0 else np.array([1.0, 0.0, 0.0, 0.0])
        b[col.TURN] = b[ENTERED] = 0.0
        if not there:
            b[col.VX : col.TURN] = 0.0
            continue
        f, w = push[bodies[i]], _rotated(v[3:6], b[QUATERNION : QUATERNION + 4], False)
        b[col.X], b[col.Y] = p[0], p[1]
        b[col.VX], b[col.VY] = v[0] + f[0] * step / mass, v[1] + f[1] * step / mass
        for k in range(3):
            b[col.WX + k] = w[k] + f[3 + k] * step / (0.4 * mass * radius * radius)
        if abs(b[col.WZ]) <= STILL_SPIN:
            b[col.WZ] = 0.0


@compiled
def _write(balls, kept, end, places, speeds, qpos, qvel, radius):  # type: ignore[no-untyped-def]
    """Hand the balls back to MuJoCo, and note what was written."""
    n = places.size
    written = kept[HEAD + n * KEPT :].reshape((n, JOINT))
    for i in range(n):
        b, p, v = balls[i], qpos[places[i] : places[i] + POSE], qvel[speeds[i] : speeds[i] + 6]
        if b[IN_PLAY] > 0.0:
            p[0], p[1], p[2] = b[col.X], b[col.Y], radius
            p[3:7] = b[QUATERNION : QUATERNION + 4]
            v[0], v[1], v[2] = b[col.VX], b[col.VY], 0.0
            v[3], v[4], v[5] = _rotated(b[col.WX : col.WZ + 1], p[3:7], True)
        else:
            v[:] = 0.0
            if b[IN_PLAY] == JUST_POTTED:
                p[0], p[1], p[2] = b[col.X], b[col.Y], -PARKED_DEPTH - 4.0 * radius * i
                b[IN_PLAY] = 0.0
        written[i, :POSE], written[i, POSE:] = p, v
    kept[WRITTEN_AT], kept[WRITTEN] = end, 1.0


@compiled
def _carry(b, m, kind, orientation, entered, t, radius, alpha, limits, half, mouths):  # type: ignore[no-untyped-def]
    """Carry all balls along their motions to a time, turn them by their mean spin, see which enter a mouth."""
    for i in range(b.shape[0]):
        if kind[i] == POTTED:
            continue
        h, wx, wy, turn = t - b[i, col.CLOCK], b[i, col.WX], b[i, col.WY], b[i, col.TURN]
        x, y = b[i, col.X], b[i, col.Y]
        advance(b[i], m[i], kind[i], t, radius, alpha)
        _turn(orientation[i], 0.5 * h * (wx + b[i, col.WX]), 0.5 * h * (wy + b[i, col.WY]), b[i, col.TURN] - turn)
        inside = True
        for rail in range(4):
            k, sign = rail // 2, 1.0 - 2.0 * (rail % 2)
            before, after = sign * (x if k == 0 else y) - limits[k], sign * b[i, k] - limits[k]
            inside = inside and after <= 0.0
            if before <= 0.0 < after:
                along, part = (y if k == 0 else x), before / (before - after)
                if in_mouth(along + part * (b[i, 1 - k] - along), rail, half, mouths):
                    entered[i] = 1.0
        if inside:
            entered[i] = 0.0


@compiled_within
def _first_event(  # type: ignore[no-untyped-def]
    b, m, kind, what, pair, again, records, entered, wide, now, until, own, forces, support, horizon, cloth, radius,
    limits, half, mouths, jaws, falls, y, k,
):  # fmt: skip
    """Time of what comes first until then, what it is, whose, and of which other ball, or -1; all are worked out."""
    t, event, one, two = until, SWITCH, -1, -1
    for i in range(b.shape[0]):
        b[i, col.END] = b[i, col.MEET] = np.inf
        if kind[i] == POTTED:
            continue
        b[i, col.TRY] = 0.0
        if forces.shape[0] > 0:
            kind[i] = curve(
                b[i], m[i], np.inf, until - now, records[i], records[i].ctypes.data, own, forces, support, horizon,
                cloth, y, k,
            )  # fmt: skip
        else:
            kind[i] = plain_phase(b[i], radius, cloth[0], cloth[1])
        ends = wide if entered[i] > 0.0 else mouths
        meet_table(b[i], m[i], what, i, kind[i], limits, half, ends, jaws, falls, False, until, 0)
        if b[i, col.MEET] < t:
            t, event, one = b[i, col.MEET], what[i, 0], i
        if b[i, col.END] < t:
            t, event, one = b[i, col.END], SWITCH, i
    for i in range(b.shape[0]):
        meet_balls(now, i, b[: i + 1], m, kind, pair, again, radius, until)
        for j in range(i):
            if pair[i * (i - 1) // 2 + j] < t:
                t, event, one, two = pair[i * (i - 1) // 2 + j], BALL, j, i
    return t, event, one, two


@compiled_within
def _turn_all(b, before, kind, orientation, since, now):  # type: ignore[no-untyped-def]
    """Turn the balls by the spin between two states of them."""
    for i in range(b.shape[0]):
        if kind[i] == POTTED:
            continue
        h, c = now - since, before[i]
        _turn(
            orientation[i],
            0.5 * h * (c[col.WX] + b[i, col.WX]),
            0.5 * h * (c[col.WY] + b[i, col.WY]),
            b[i, col.TURN] - c[col.TURN],
        )
        b[i, col.CLOCK] = now


@compiled
def play_step(  # type: ignore[no-untyped-def]
    kept, end, places, speeds, qpos, qvel, own, forces, support, horizon, impact, cloth, mass, radius, limits, half,
    mouths, jaws, falls, table,
):  # fmt: skip
    """Play the kept state up to a time, hand it back and keep it; False where that does not come to its end."""
    n = places.size
    balls = kept[HEAD : HEAD + n * KEPT].reshape((n, KEPT))
    curved, alpha = forces.shape[0] > 0, cloth[2]
    b, m, kind = (
        np.zeros((n, col.COLUMN_COUNT)),
        np.zeros((n, col.STATE_SIZE if curved else 1, col.TERM_COUNT)),
        np.zeros(n, np.int64),
    )
    what, pairs = np.zeros((n, 2), np.int64), n * (n - 1) // 2
    pair, again, touched = np.zeros(pairs), np.zeros(pairs, np.bool_), np.zeros(n, np.bool_)
    state, hit, records = np.zeros(10), np.zeros(rec.IMPACT_FIELDS), np.zeros((n, rec.BALL_FIELDS))
    y, k = np.zeros(col.STATE_SIZE), np.zeros((7, col.STATE_SIZE))
    now, until = kept[STATE_TIME] - kept[STRUCK_AT], end - kept[STRUCK_AT]  # the effects count from the strike
    session, leans = kept[SESSION:HEAD], balls[:, LEANING].copy()
    orientation = balls[:, QUATERNION : QUATERNION + 4].copy()
    entered, wide = balls[:, ENTERED], mouths.copy()
    if falls.shape[0] == 0:  # without jaws
        wide[:2] = np.inf
    for i in range(n):
        lay_record(records[i], i, kept[LAUNCH], session, radius, mass)
        b[i, : col.ROLLED + 1], b[i, col.CLOCK] = balls[i, : col.ROLLED + 1], now
        kind[i] = REST if balls[i, IN_PLAY] > 0.0 else POTTED
    moved, stays = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    for _ in range(MAX_STEP_EVENTS):
        for i in range(n):
            moved[i] = entered[i] == 0.0 and (moved[i] or b[i, col.VX] != 0.0 or b[i, col.VY] != 0.0)
        t, event, one, two = _first_event(
            b, m, kind, what, pair, again, records, entered, wide, now, until, own, forces, support, horizon, cloth,
            radius, limits, half, mouths, jaws, falls, y, k,
        )  # fmt: skip
        stopped = stopped_in_rail(b, kind, moved, jaws, limits, half, mouths)
        if stopped >= 0:
            push_out(b, kind, stopped, touched, jaws, radius, limits, half, mouths)
            continue
        if one < 0 or t >= until - NO_TIME_S:
            _carry(b, m, kind, orientation, entered, until, radius, alpha, limits, half, mouths)
            _keep(balls, b, kind, orientation, leans)
            kept[STATE_TIME] = end
            _write(balls, kept, end, places, speeds, qpos, qvel, radius)
            return True
        _carry(b, m, kind, orientation, entered, t, radius, alpha, limits, half, mouths)
        now = t
        if event == BALL and again[two * (two - 1) // 2 + one]:
            event, leans[two] = SWITCH, now + LEAN_MEMORY_S
        if event == SWITCH:
            if b[one, col.END] > t:  # pressed to something, and looked at again
                leans[one] = now + LEAN_MEMORY_S
            for i in range(n):
                if b[i, col.END] <= t:
                    arrive(b[i], kind[i], radius)
        elif event == POCKET:
            pot(b, kind, one)
            balls[one, IN_PLAY] = JUST_POTTED
        else:
            rail = what[one, 1] if event == CUSHION else -1
            speed = approach_speed(b, one, two, rail, jaws)
            near = max(CROWD_GAP_M, speed * CUSHION_TIME)
            if (
                rail < 4
                and speed >= LEAN_SPEED
                and is_crowded(b, kind, one, two, rail, near, radius, limits, half, mouths)
            ):
                seen, wanted, before, kinds = np.zeros((1, n, 8)), np.full(1, until), b.copy(), kind.copy()
                now, got, _ = through(
                    b, kind, stays, now, until, records, own, forces, support, impact, cloth, mass, radius, limits,
                    half, mouths, jaws, session, hit, table, wanted, 0, seen, np.zeros(0), np.zeros((0, 3), np.int64),
                    0, np.zeros(4, np.int64),
                )  # fmt: skip
                if got:  # the step ends within the cluster: its beginning is kept
                    _keep(balls, before, kinds, orientation, leans)
                    kept[STATE_TIME] = t + kept[STRUCK_AT]
                    for i in range(n):
                        if kind[i] != POTTED:
                            b[i, :8] = seen[0, i]
                    now = until
                _turn_all(b, before, kind, orientation, t, now)
                if got:
                    shown = balls.copy()
                    _fell(shown, kinds, kind)
                    _keep(shown, b, kind, orientation, leans)
                    _write(shown, kept, end, places, speeds, qpos, qvel, radius)
                    return True
                _fell(balls, kinds, kind)
                continue
            known = now < leans[one] <= now + LEAN_MEMORY_S or (two >= 0 and now < leans[two] <= now + LEAN_MEMORY_S)
            if collide_alone(
                b, one, two, rail, jaws, state, hit, known, own, impact, cloth, mass, radius, session, now
            ):
                leans[one] = now + LEAN_MEMORY_S
                if two >= 0:
                    leans[two] = now + LEAN_MEMORY_S
                part(b, one, two, rail, jaws, radius, limits)
                settle(
                    b, kind, one, two, touched, jaws, state, hit, own, impact, cloth, mass, radius, limits, half,
                    mouths, session, now,
                )  # fmt: skip
            else:
                delay_rebound(b[one], b[one, col.VX :], rail, hit[rec.CONTACT_TIME], cloth[0], radius, half, mouths)
    return False


@compiled
def _fell(balls, before, kind):  # type: ignore[no-untyped-def]
    """Note which balls were potted since `before`."""
    for i in range(kind.size):
        if kind[i] == POTTED and before[i] != POTTED:
            balls[i, IN_PLAY] = JUST_POTTED


@compiled
def _keep(balls, b, kind, orientation, leans):  # type: ignore[no-untyped-def]
    """Lay the balls in play down in what is kept, and those that have just been potted."""
    for i in range(b.shape[0]):
        balls[i, LEANING] = leans[i]
        if kind[i] != POTTED:
            balls[i, : col.ROLLED + 1] = b[i, : col.ROLLED + 1]
            balls[i, QUATERNION : QUATERNION + 4] = orientation[i]
        elif balls[i, IN_PLAY] == JUST_POTTED:
            balls[i, col.X], balls[i, col.Y] = b[i, col.X], b[i, col.Y]
            balls[i, col.VX : col.TURN] = 0.0
