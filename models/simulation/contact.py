"""Bodies that touch several at a time: MuJoCo's own contacts, with the friction and restitution of the model.

In a world of their own the balls slide along the slate and do not leave it; a contact that is left to MuJoCo does not
turn them. At a low impedance a contact is a spring and a damper of its own, whatever else its bodies touch (at a high
one MuJoCo imposes its motion, and balls frozen to each other move off as one). Two balls: the spring of Hertz,
K d^1.5, with the damper a sqrt(K) d^0.25 (Tsuji, Tanaka, Ishida 1992), whose restitution knows no speed; a cushion:
linear, and softer. What a spring gives back of the work done on it does not depend on what else acts, so restitution
is energetic. It follows the approach speed while that still grows, as in the middle of a rack.
Friction at the contact, and of the cloth under a ball that is pressed down, come from the contact's force by the
increments of the impulse models. A ball may be heavier than the others: what its contacts say of it is written into
the world of its simulation. Leaves out that balls leave the slate, that real contacts last longer, and the jaws: before
them the straight cushions end, and a ball meets a jaw by its impulse once the others have done with it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import NDArray

from models import record as rec
from models.analytic.events import DEAD_SPEED, MIN_IMPACT_SPEED
from models.analytic.increments import ball_step, cushion_step
from models.analytic.spring import CONTACT_GAP_M, SLIP_PARTS, SPRING_STEP_S, dampings, depth_of, spring
from models.compiled import compiled
from models.effect import Effect
from models.mjcf.world import build_spec, rails
from models.shot import RAIL_NAMES, Array
from models.simulation.act import Balls

if TYPE_CHECKING:
    from models.model_file import Model

POTTED_DISTANCE_M = 100.0  # from the table, for potted balls [m]
MIN_IMPEDANCE = 1e-4  # the lowest that MuJoCo takes


@compiled
def _meet(
    kind: NDArray[np.int64], first: NDArray[np.int64], second: NDArray[np.int64], span: Array, c: int,
    p: Array, v: Array, alive: NDArray[np.bool_], radius: float, limits: Array,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Gap, approach speed and normal (first body into second) of contact c in one simulation."""
    i, j = first[c], second[c]
    if kind[c] == 0:
        if not (alive[i] and alive[j]):
            return np.inf, 0.0, 1.0, 0.0
        x, y = p[j, 0] - p[i, 0], p[j, 1] - p[i, 1]
        d = np.sqrt(x * x + y * y)
        x, y = x / d, y / d
        return d - 2.0 * radius, (v[i, 0] - v[j, 0]) * x + (v[i, 1] - v[j, 1]) * y, x, y
    k, sign = j // 2, 1.0 - 2.0 * (j % 2)
    if not alive[i] or not span[c, 0] <= p[i, 1 - k] <= span[c, 1]:
        return np.inf, 0.0, 1.0, 0.0
    return limits[k] - sign * p[i, k], sign * v[i, k], sign * (k == 0), sign * (k == 1)


@compiled
def overlaps(
    kind: NDArray[np.int64], first: NDArray[np.int64], second: NDArray[np.int64], span: Array,
    p: Array, v: Array, alive: NDArray[np.bool_], radius: float, limits: Array,
) -> Array:  # fmt: skip
    """Depth of every contact (n, ncontact) [m], 0 where it is open."""
    out = np.zeros((p.shape[0], kind.size))
    for n in range(p.shape[0]):
        for c in range(kind.size):
            gap, _, _, _ = _meet(kind, first, second, span, c, p[n], v[n], alive[n], radius, limits)
            if gap < 0.0:
                out[n, c] = depth_of(kind[c] == 1, gap, radius)[0]
    return out


@compiled
def _local(
    p: Array, v: Array, w: Array, cushion: bool, i: int, j: int, x: float, y: float, s: Array
) -> tuple[float, float, float, float]:
    """The state of a contact's bodies in its own axes, into s; returns the axes."""
    ax, ay, bx, by = (y, -x, x, y) if cushion else (x, y, -y, x)
    for n in range(1 if cushion else 2):
        ball, o = (i if n == 0 else j), 5 * n
        s[o] = v[ball, 0] * ax + v[ball, 1] * ay
        s[o + 1] = v[ball, 0] * bx + v[ball, 1] * by
        s[o + 2] = w[ball, 0] * ax + w[ball, 1] * ay
        s[o + 3] = w[ball, 0] * bx + w[ball, 1] * by
        s[o + 4] = w[ball, 2]
    return ax, ay, bx, by


@compiled
def closing(
    kind: NDArray[np.int64], first: NDArray[np.int64], second: NDArray[np.int64], span: Array,
    p: Array, v: Array, alive: NDArray[np.bool_], radius: float, limits: Array, peak: Array,
    out: NDArray[np.int64],
) -> int:  # fmt: skip
    """Contacts that close, or close faster than ever since: fills rows of out: (row, contact)."""
    count = 0
    for n in range(p.shape[0]):
        for c in range(kind.size):
            gap, approach, _, _ = _meet(kind, first, second, span, c, p[n], v[n], alive[n], radius, limits)
            if gap > CONTACT_GAP_M:
                peak[n, c] = 0.0
            elif approach > max(peak[n, c], MIN_IMPACT_SPEED):
                peak[n, c] = approach
                out[count, 0], out[count, 1] = n, c
                count += 1
    return count


@compiled
def press(
    kind: NDArray[np.int64], first: NDArray[np.int64], second: NDArray[np.int64], span: Array,
    p: Array, v: Array, w: Array, alive: NDArray[np.bool_], limits: Array, given: Array, damping: Array, mu: Array,
    cloth: Array, heavier: Array, m: float, r: float, force: Array, torque: Array, solref: Array,
) -> None:  # fmt: skip
    """Set the springs of closed contacts, solref (n, ncontact, 2), and add the friction that goes with them.

    What a contact overlapped at the start, `given` (n, ncontact) [m], holds no energy; it shrinks as they part.
    `mu` (n, ncontact, 4) as in `ball_step`, then the sine of a nose; `heavier` (n, nball) is each ball's mass over m.
    Force and torque are those that would move a ball of mass m like this.
    """
    one, two = np.zeros(6), np.zeros(10)
    one_out, two_out = np.zeros(6), np.zeros(10)
    one_after, two_after = np.zeros(6), np.zeros(10)
    inertia = 0.4 * m * r * r
    for n in range(p.shape[0]):
        for c in range(kind.size):
            cushion = kind[c] == 1
            i, j = first[c], second[c]
            solref[n, c, 0] = solref[n, c, 1] = 0.0
            gap, approach, x, y = _meet(kind, first, second, span, c, p[n], v[n], alive[n], r, limits)
            if gap > CONTACT_GAP_M:
                given[n, c] = 0.0
                continue
            depth, level = depth_of(cushion, gap, r)
            given[n, c] = min(given[n, c], max(depth, 0.0))
            pressed = depth - given[n, c]
            approach *= level
            k, b = spring(cushion, pressed, damping[n, c])
            if k == 0.0:
                continue
            solref[n, c, 0], solref[n, c, 1] = -k * pressed / depth, -b
            own = m * heavier[n, i]
            other = own if cushion else m * heavier[n, j]
            moved = own if cushion else own / (1.0 + own / other)
            dp = SPRING_STEP_S * moved * max(k * pressed + b * approach, 0.0)
            if dp == 0.0:
                continue
            s, out, after = (one, one_out, one_after) if cushion else (two, two_out, two_after)
            ax, ay, bx, by = _local(p[n], v[n], w[n], cushion, i, j, x, y, s)
            rub, sine = (mu[n, c, 0], mu[n, c, 1], mu[n, c, 2]), mu[n, c, 3]
            out[:] = s
            for _ in range(SLIP_PARTS):
                if cushion:
                    cushion_step(out, dp / SLIP_PARTS, (rub[0], cloth[n], own, r), after, sine)
                else:
                    ball_step(out, dp / SLIP_PARTS, rub, (cloth[n], own, other, r), after)
                out[:] = after
            # What the normal force itself does is MuJoCo's.
            if cushion:
                out[1] += dp * math.sqrt(1.0 - sine * sine) / own
            else:
                out[0] += dp / own
                out[5] -= dp / other
            for q in range(1 if cushion else 2):
                ball, o = (i if q == 0 else j), 5 * q
                va, vb = (out[o] - s[o]) * m / SPRING_STEP_S, (out[o + 1] - s[o + 1]) * m / SPRING_STEP_S
                wa, wb = (
                    (out[o + 2] - s[o + 2]) * inertia / SPRING_STEP_S,
                    (out[o + 3] - s[o + 3]) * inertia / SPRING_STEP_S,
                )
                force[n, ball, 0] += va * ax + vb * bx
                force[n, ball, 1] += va * ay + vb * by
                torque[n, ball, 0] += wa * ax + wb * bx
                torque[n, ball, 1] += wa * ay + wb * by
                torque[n, ball, 2] += (out[o + 4] - s[o + 4]) * inertia / SPRING_STEP_S


@compiled
def apart(
    kind: NDArray[np.int64], first: NDArray[np.int64], second: NDArray[np.int64], span: Array,
    p: Array, v: Array, alive: NDArray[np.bool_], radius: float, limits: Array, given: Array,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:  # fmt: skip
    """Simulations in which nothing presses or closes, and those in which nothing does so at a speed: (n,) each."""
    free, calm = np.ones(p.shape[0], np.bool_), np.ones(p.shape[0], np.bool_)
    for n in range(p.shape[0]):
        for c in range(kind.size):
            cushion = kind[c] == 1
            gap, approach, _, _ = _meet(kind, first, second, span, c, p[n], v[n], alive[n], radius, limits)
            if gap > CONTACT_GAP_M:
                continue
            calm[n] = calm[n] and abs(approach) < DEAD_SPEED
            if approach > MIN_IMPACT_SPEED:
                free[n] = False
                continue
            depth = depth_of(cushion, gap, radius)[0]
            free[n] = free[n] and depth - min(given[n, c], depth) <= CONTACT_GAP_M
    return free, calm


class Contacts:
    """A batch in which balls and cushions touch through MuJoCo's contacts."""

    def __init__(
        self, model: Model, effects: Sequence[Effect], balls: int, nsim: int, threads: int, ends: Array
    ) -> None:
        """Compile the world of `balls` balls, `nsim` times; cushions end at `ends` (3,) from a corner, a middle [m]."""
        spec = self._spec(model, effects, balls)
        compiled = spec.compile()
        self.radius, self.mass = model.ball.radius, model.ball.mass
        self.limits = model.table.centre_limits(model.ball)
        self.batch = mujoco.batch.Batch(compiled, nsim, nthread=threads)
        self.qpos = self.batch.bind("qpos").reshape(nsim, balls, 2)
        self.qvel = self.batch.bind("qvel").reshape(nsim, balls, 2)
        self.push = self.batch.bind("xfrc_applied")
        self.solref = self.batch.expand("pair_solref")
        # MuJoCo takes the inertia of what only slides from dof_M0, and the stiffness of contacts from body_invweight0.
        self.inert = self.batch.expand("dof_M0").reshape(nsim, balls, 2)
        self.give = self.batch.expand("body_invweight0")
        self.plain_mass, self.plain_give = float(self.inert[0, 0, 0]), self.give[0, 1].copy()
        self.heavier = np.ones((nsim, balls))  # mass of each ball over that of the model's, known from its first touch
        ncontact = compiled.npair
        self.kind = np.zeros(ncontact, np.int64)
        self.first, self.second = np.zeros(ncontact, np.int64), np.zeros(ncontact, np.int64)
        self.span = np.zeros((ncontact, 2))
        pieces, middle = rails(model.table), ends[1]
        half = np.array([model.table.length, model.table.width]) / 2 - ends[0]
        start = compiled.geom("cushion 0 +x").id
        for c in range(ncontact):
            one, two = sorted((compiled.pair_geom1[c], compiled.pair_geom2[c]), reverse=True)
            bodies = [int(compiled.geom_bodyid[g]) - 1 for g in (one, two)]
            if min(bodies) < 0:
                piece = pieces[two - start]
                k = "xy".index(piece.side[1])
                self.kind[c], self.first[c], self.second[c] = 1, bodies[0], RAIL_NAMES.index(piece.side)
                far = half[1 - k]
                both = sorted(min(max(x, -far), far) for x in (piece.start[1 - k], piece.end[1 - k]))
                # Beside a pocket the jaws let in what the straight rail would turn back.
                self.span[c] = [
                    max(x, middle) if 0 < x < middle else min(x, -middle) if -middle < x < 0 else x for x in both
                ]
            else:
                self.first[c], self.second[c] = min(bodies), max(bodies)
        self.damping = np.zeros((nsim, ncontact))
        self.friction = np.zeros((nsim, ncontact, 4))
        self.peak = np.zeros((nsim, ncontact))
        self.given = np.zeros((nsim, ncontact))  # overlap that is nobody's doing in this cluster [m]
        self.first_time = np.ones((nsim, ncontact), bool)  # in this cluster

    def enter(self, rows: NDArray[np.int64], p: Array, v: Array, alive: NDArray[np.bool_]) -> None:
        """Take over simulations at the moment of a touch; p, v (n, nball, 3). Potted balls are put out of the way."""
        away = POTTED_DISTANCE_M * (1.0 + np.arange(p.shape[1]))[:, None]
        self.qpos[rows] = np.where(alive[..., None], p[..., :2], away)
        self.qvel[rows] = np.where(alive[..., None], v[..., :2], 0.0)
        self.given[rows] = overlaps(
            self.kind, self.first, self.second, self.span, p, v, alive, self.radius, self.limits
        )  # fmt: skip
        self.peak[rows] = 0.0
        self.first_time[rows] = True

    def closing(self, rows: NDArray[np.int64], balls: Balls, alive: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Contacts that close, or do so faster than since they began: (k, 2) of index into rows, and contact."""
        peak = self.peak[rows]
        found = np.zeros((rows.size * self.kind.size, 2), np.int64)
        count = closing(
            self.kind, self.first, self.second, self.span, balls.position, balls.velocity, alive, self.radius,
            self.limits, peak, found,
        )  # fmt: skip
        self.peak[rows] = peak
        return found[:count]

    def set(
        self, rows: NDArray[np.int64], which: NDArray[np.int64], cushion: bool, impacts: Array
    ) -> NDArray[np.bool_]:
        """Give contacts of `which` (k, 2) what impacts (k, IMPACT_FIELDS) say of them; returns which are new."""
        at = rows[which[:, 0]], which[:, 1]
        self.friction[at] = impacts[:, [rec.FRICTION, rec.GAIN, rec.DECAY, rec.NOSE]]
        self.damping[at] = dampings(cushion, impacts[:, rec.RESTITUTION])
        for n in range(1 if cushion else 2):
            heavier, ball = impacts[:, rec.MASS_FIRST + n], impacts[:, rec.FIRST + n].astype(np.int64)
            self.heavier[at[0], ball] = heavier
            self.inert[at[0], ball] = self.plain_mass * heavier[:, None]
            self.give[at[0], ball + 1] = self.plain_give / heavier[:, None]
        new = self.first_time[at]
        self.first_time[at] = False
        return new

    def step(
        self, rows: NDArray[np.int64], balls: Balls, alive: NDArray[np.bool_], cloth: Array
    ) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_]]:
        """One STEP, with the friction that goes with the contacts' forces added to the balls'.

        Returns position and velocity after it, (n, nball, 3), which simulations touch no more, and which do so at rest.
        """
        solref, damping, given = self.solref[rows], self.damping[rows], self.given[rows]
        force, torque = self.mass * balls.acceleration, balls.ball.inertia * balls.turning
        press(
            self.kind, self.first, self.second, self.span, balls.position, balls.velocity, balls.spin, alive,
            self.limits, given, damping, self.friction[rows], cloth, self.heavier[rows], self.mass, self.radius,
            force, torque, solref,
        )  # fmt: skip
        self.solref[rows], self.given[rows] = solref, given
        balls.turning = torque / balls.ball.inertia
        self.push[rows, 1:, :3] = force * self.heavier[rows][..., None]
        self.batch.step(ids=rows)
        p, v = balls.position.copy(), balls.velocity.copy()
        p[..., :2] = np.where(alive[..., None], self.qpos[rows], p[..., :2])
        v[..., :2] = np.where(alive[..., None], self.qvel[rows], v[..., :2])
        free, calm = apart(
            self.kind, self.first, self.second, self.span, p, v, alive, self.radius, self.limits, given
        )  # fmt: skip
        return p, v, free, calm

    @staticmethod
    def _spec(model: Model, effects: Sequence[Effect], balls: int) -> mujoco.MjSpec:
        spec = build_spec(model.table, model.ball, [f"ball {i}" for i in range(balls)], effects)
        spec.option.timestep = SPRING_STEP_S
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_GRAVITY
        for body in spec.bodies[1:]:
            spec.delete(body.joints[0])
            for axis in np.eye(3)[:2]:
                body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        for pair in spec.pairs:
            if pair.classname.name == "ball_bed":
                spec.delete(pair)
                continue
            pair.condim, pair.solimp = 1, [MIN_IMPEDANCE, MIN_IMPEDANCE, 0.001, 0.5, 2.0]
        return spec
