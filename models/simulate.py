"""Many shots -> many tracks, on mujoco.batch, with step sizes chosen by what happens next.

Where the cloth is an effect, forces are constant between its switches (slide to roll, stop, end of sidespin), so a
step lands on the next switch or touch, and is exact: MuJoCo's semi-implicit position is ahead by a h^2 / 2, which is
taken back. Impacts that an effect resolves are landed on and carried through by impulse (models/impulse.py), two
bodies at a time. Native contacts take small steps around a touch instead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import mujoco.batch
import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.effect import Balls, Effect, Impact, of
from models.impulse import collide_rows
from models.model_file import Model
from models.native import GRAVITY
from models.shot import NOSE_COSINE, NOSE_SINE, Array, Event, Shot, Track
from models.touch import BALL, CUSHION, POCKET, native_step, next_touch
from models.world import POCKET_MOUTH, build_spec

CHUNK = 1024  # simulations at a time
NATIVE_STEP = 2e-3  # longest step on native cloth [s]; its contact time is 4 ms
NATIVE_RUN = 4  # of them between two looks at what comes next
MIDDLE_ACCEPTANCE = 0.055  # half width that the jaws of a middle pocket let in [m] (Robotic Billiards 2015)
TINY = 1e-5  # [s]
DEAD = 1e-3  # approach speed below which an impact gives nothing back [m/s]
RAILS = ("+x", "-x", "+y", "-y")
FIELDS = ("pair_friction", "pair_solref", "opt.gravity", "body_mass", "body_inertia")  # that an edit may change
MAX_STEPS = 200_000


@njit(cache=True)
def _spin_to_world(quat: Array, w: Array, inverse: bool) -> Array:
    """Rotate (nsim, nball, 3) vectors from ball to table frame by (nsim, nball, 4) quaternions, or back."""
    out = np.empty_like(w)
    sign = -1.0 if inverse else 1.0
    for s in range(w.shape[0]):
        for i in range(w.shape[1]):
            q0, x, y, z = quat[s, i, 0], sign * quat[s, i, 1], sign * quat[s, i, 2], sign * quat[s, i, 3]
            a, b, c = w[s, i]
            tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
            out[s, i, 0] = a + q0 * tx + y * tz - z * ty
            out[s, i, 1] = b + q0 * ty + z * tx - x * tz
            out[s, i, 2] = c + q0 * tz + x * ty - y * tx
    return out


@njit(cache=True)
def _record(
    rows: NDArray[np.int64], t0: Array, h: Array, times: Array, count: NDArray[np.int64], next_: NDArray[np.int64],
    p0: Array, v0: Array, w0: Array, v1: Array, w1: Array, p1: Array, theta: Array, alive: NDArray[np.bool_],
    out: Array,
) -> None:  # fmt: skip
    """Sample the step that just ended: positions by its parabola, velocity and spin linearly."""
    for k in range(rows.size):
        s = rows[k]
        while next_[s] < count[s] and times[s, next_[s]] <= t0[k] + h[k]:
            f = (times[s, next_[s]] - t0[k]) / h[k] if h[k] > 0.0 else 1.0
            for i in range(p0.shape[1]):
                o = out[s, next_[s], i]
                if not alive[s, i]:
                    o[:] = np.nan
                    continue
                for x in range(2):
                    a = f * h[k] * (v0[k, i, x] + 0.5 * f * (v1[k, i, x] - v0[k, i, x]))
                    # What is not in the parabola (native contacts) is spread over the step.
                    b = p1[k, i, x] - p0[k, i, x] - 0.5 * h[k] * (v0[k, i, x] + v1[k, i, x])
                    o[x] = p0[k, i, x] + a + f * b
                    o[2 + x] = v0[k, i, x] + f * (v1[k, i, x] - v0[k, i, x])
                for x in range(3):
                    o[4 + x] = w0[k, i, x] + f * (w1[k, i, x] - w0[k, i, x])
                o[7] = theta[s, i] + f * h[k] * (w0[k, i, 2] + 0.5 * f * (w1[k, i, 2] - w0[k, i, 2]))
            next_[s] += 1


@dataclass
class _Group:
    """Shots of one number of balls, in one batch."""

    model: Model
    shots: Sequence[Shot]
    rows: NDArray[np.int64]  # of these shots among all, to pick per-simulation parameters
    threads: int

    def __post_init__(self) -> None:
        """Compile the world and lay out the state."""
        self.effects: list[Effect] = [e.select(self.rows) for e in self.model.stack()]
        self.doers = self.effects[1:]
        slots = {e.slot for e in self.doers}
        self.cloth = next((e for e in self.doers if e.slot == "cloth"), None)
        self.resolved = np.array([any(e.resolves == k for e in self.doers) for k in ("ball", "cushion")])
        self.exact = "cloth" in slots
        self.batch = self._compile()
        nsim, nball = len(self.shots), len(self.shots[0].names)
        self.qpos = self.batch.bind("qpos").reshape(nsim, nball, 7)
        self.qvel = self.batch.bind("qvel").reshape(nsim, nball, 6)
        self.push = self.batch.bind("xfrc_applied")
        self.timestep = self.batch.expand("opt.timestep")
        self.alive = np.ones((nsim, nball), bool)
        self.theta = np.zeros((nsim, nball))
        self.events: list[list[Event]] = [[] for _ in self.shots]
        table, ball = self.model.table, self.model.ball
        self.reach = table.reach(ball)
        self.half = np.array([table.length / 2, table.width / 2])
        mouth = POCKET_MOUTH if table.pockets else 0.0
        self.mouths = np.array([mouth / np.sqrt(2), MIDDLE_ACCEPTANCE if mouth else 0.0, mouth / 2])
        self._start()

    def _compile(self) -> Any:
        table, ball = self.model.table, self.model.ball
        names = [f"ball {i}" for i in range(len(self.shots[0].names))]

        def world(effects: Sequence[Effect]) -> mujoco.MjModel:
            spec = build_spec(table, ball, names, effects)
            if self.exact:
                # The cloth carries the weight and holds the height: steps of any size, no support to sink into.
                for pair in spec.pairs:
                    if self.resolved.all() or pair.classname.name == "ball_bed":
                        spec.delete(pair)
                for body in spec.bodies[1:]:
                    body.gravcomp = 1
            return spec.compile()

        editors = [
            type(e).edit is not Effect.edit and any(np.ndim(getattr(e, k)) for k in e.parameters())
            for e in self.effects
        ]
        nsim = len(self.shots)
        first = world([e.select(0) if any(editors) else e for e in self.effects] if any(editors) else self.effects)
        batch = mujoco.batch.Batch(first, nsim, nthread=self.threads)
        if any(editors) and first.npair:
            fields = {name: batch.expand(name) for name in FIELDS}
            for s in range(nsim):
                variant = world([e.select(s) for e in self.effects])
                for name, values in fields.items():
                    source = variant.opt.gravity if name == "opt.gravity" else getattr(variant, name)
                    values[s] = np.reshape(source, values[s].shape)
        return batch

    def _start(self) -> None:
        spin = np.array([s.spin for s in self.shots], float)
        velocity = np.array([s.velocity for s in self.shots], float)
        for effect in self.doers:
            if type(effect).strike is not Effect.strike:
                for i in range(velocity.shape[1]):
                    velocity[:, i], spin[:, i] = effect.strike(velocity[:, i], spin[:, i])
        self.qpos[:] = 0
        self.qpos[..., :2] = [s.position for s in self.shots]
        self.qpos[..., 2] = self.model.ball.radius
        self.qpos[..., 3] = 1
        self.qvel[:] = 0
        self.qvel[..., :2] = velocity
        self.qvel[..., 3:] = spin
        self.count = np.array([len(s.times) for s in self.shots])
        self.times = np.full((len(self.shots), max(self.count.max(), 1)), np.inf)
        for k, shot in enumerate(self.shots):
            self.times[k, : self.count[k]] = shot.times
        self.end = np.array([s.times[-1] if len(s.times) else 0.0 for s in self.shots])
        self.clock = np.zeros(len(self.shots))
        self.next = np.zeros(len(self.shots), np.int64)
        self.fine = np.array([s.impact_step for s in self.shots])
        self.longest = np.array([s.max_step for s in self.shots])
        self.samples = np.full((*self.times.shape, self.alive.shape[1], 8), np.nan)

    def run(self) -> list[Track]:
        """Step until every shot has its last sample."""
        rows = np.arange(len(self.shots))
        p, v = self.qpos[..., :3].copy(), self.qvel[..., :3].copy()
        w = self.qvel[..., 3:].copy()
        zero = np.zeros(len(rows))
        _record(
            rows, zero, zero, self.times, self.count, self.next, p, v, w, v, w, p, self.theta, self.alive, self.samples
        )
        for _ in range(MAX_STEPS):
            rows = rows[self.next[rows] < self.count[rows]]
            if rows.size == 0:
                break
            self._step(rows)
        else:
            raise RuntimeError(f"shot {self.rows[rows[0]]} has not come to its end after {MAX_STEPS} steps")
        return [self._track(k) for k in range(len(self.shots))]

    def _balls(self, rows: NDArray[np.int64]) -> Balls:
        p, v = self.qpos[rows, :, :3], self.qvel[rows, :, :3]
        w = _spin_to_world(self.qpos[rows, :, 3:], self.qvel[rows, :, 3:], False)
        ball = self.model.ball
        weight = np.where(self.alive[rows], ball.mass * GRAVITY, 0.0)
        return Balls(ball, p, v, w, weight, np.zeros_like(p), np.zeros_like(p))

    def _step(self, rows: NDArray[np.int64]) -> None:
        balls = self._balls(rows)
        whole = rows.size == len(self.shots)
        effects = self.doers if whole else [e.select(rows) for e in self.doers]
        limit = np.full(rows.size, np.inf if self.exact else NATIVE_RUN * NATIVE_STEP)
        for effect in effects:
            effect.forces(balls)
        for effect in effects:
            span = np.asarray(effect.horizon(balls))
            if span.ndim == 2:
                span = np.where(self.alive[rows], span, np.inf).min(axis=1)
            limit = np.minimum(limit, span)
        # A moving simulation takes no step beyond the longest; one at rest goes to its end at once.
        moving = np.any(balls.velocity[..., :2] != 0, axis=(1, 2)) | np.any(balls.force[..., :2] != 0, axis=(1, 2))
        limit = np.where(moving, np.minimum(limit, self.longest[rows]), limit)
        limit = np.minimum(limit, np.maximum(self.end[rows] - self.clock[rows], 1e-12))
        alive = self.alive[rows]
        acceleration = balls.force / balls.ball.mass
        step, hit = next_touch(
            balls.position, balls.velocity, acceleration, alive, balls.ball.radius, self.reach, self.half, self.mouths,
            self.resolved, limit,
        )  # fmt: skip
        rough = np.zeros(rows.size, bool)
        if not self.resolved.all():
            safe = native_step(
                balls.position, balls.velocity, alive, balls.ball.radius, self.reach, ~self.resolved,
                self.fine[rows], np.full(rows.size, np.inf),
            )  # fmt: skip
            hit[safe < step] = 0
            rough = safe <= self.fine[rows]
            step = np.minimum(step, safe)
        if any(e.varies for e in effects):
            middle = self._middle(balls, step)
            for effect in effects:
                effect.forces(middle)
            balls.force, balls.torque = middle.force, middle.torque
        self._advance(rows, balls, step, rough)
        for kind, number in (("ball", BALL), ("cushion", CUSHION)):
            found = np.flatnonzero(hit[:, 0] == number)
            if found.size:
                self._impact(kind, rows[found], hit[found])
        for k in np.flatnonzero(hit[:, 0] == POCKET):
            self._pot(int(rows[k]), int(hit[k, 1]))

    @staticmethod
    def _middle(balls: Balls, step: Array) -> Balls:
        """The state half a step ahead under the present forces, with nothing acting yet; now, where steps are tiny.

        Half of the last bit of speed would count as rest, and the ball never come to it.
        """
        half = np.where(step > TINY, 0.5 * step, 0.0)[:, None, None]
        velocity = balls.velocity + half * balls.force / balls.ball.mass
        velocity[..., 2] = balls.velocity[..., 2]
        return Balls(
            balls.ball,
            balls.position + 0.5 * half * (balls.velocity + velocity),
            velocity,
            balls.spin + half * balls.torque / balls.ball.inertia,
            balls.normal,
            np.zeros_like(balls.force),
            np.zeros_like(balls.torque),
        )

    def _advance(self, rows: NDArray[np.int64], balls: Balls, step: Array, rough: NDArray[np.bool_]) -> None:
        ball = balls.ball
        self.push[rows, 1:, :3] = balls.force
        self.push[rows, 1:, 3:] = balls.torque
        go = step > 0
        parts = np.ones(rows.size, np.int64) if self.exact else np.ceil(step / NATIVE_STEP - 1e-9).astype(np.int64)
        self.timestep[rows[go]] = (step[go] / parts[go]).reshape(-1, *self.timestep.shape[1:])
        for number in np.unique(parts[go]):
            self.batch.step(ids=rows[go & (parts == number)], nstep=int(number))
        v1 = self.qvel[rows, :, :3]
        if self.exact:
            # The semi-implicit step is ahead by half the change of velocity.
            behind = 0.5 * (step * ~rough)[:, None, None] * (v1 - balls.velocity)
            self.qpos[rows, :, :2] -= behind[..., :2] * go[:, None, None]
            # A native nose presses the ball down, on a slate that does not give.
            self.qpos[rows, :, 2] = np.where(self.alive[rows], ball.radius, self.qpos[rows, :, 2])
            self.qvel[rows, :, 2] = 0
            w1 = balls.spin + balls.torque / ball.inertia * step[:, None, None]
            if rough.any():
                w1[rough] = _spin_to_world(self.qpos[rows[rough], :, 3:], self.qvel[rows[rough], :, 3:], False)
        else:
            w1 = _spin_to_world(self.qpos[rows, :, 3:], self.qvel[rows, :, 3:], False)
        p1 = self.qpos[rows, :, :3]
        t0 = self.clock[rows]
        _record(
            rows, t0, step, self.times, self.count, self.next, balls.position, balls.velocity, balls.spin, v1, w1, p1,
            self.theta, self.alive, self.samples,
        )  # fmt: skip
        self.theta[rows] += 0.5 * step[:, None] * (balls.spin[..., 2] + w1[..., 2])
        self.clock[rows] = t0 + step

    def _impact(self, kind: str, rows: NDArray[np.int64], hit: NDArray[np.int64]) -> None:
        p, v = self.qpos[rows, :, :3], self.qvel[rows, :, :3]
        quat = self.qpos[rows, :, 3:]
        w = _spin_to_world(quat, self.qvel[rows, :, 3:], False)
        ball = self.model.ball
        n = np.arange(rows.size)
        i, j = hit[:, 1], hit[:, 2]
        if kind == "ball":
            normal = p[n, j, :2] - p[n, i, :2]
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            relative = v[n, i] - v[n, j]
            arm, turn = ball.radius * np.pad(normal, ((0, 0), (0, 1))), w[n, i] + w[n, j]
            approach = np.sum(relative[:, :2] * normal, axis=1)
        else:
            sign = 1.0 - 2.0 * (j % 2)
            normal = np.where((j < 2)[:, None], [[1.0, 0.0]], [[0.0, 1.0]]) * sign[:, None]
            relative, turn = v[n, i], w[n, i]
            approach = np.sum(relative[:, :2] * normal, axis=1)
            arm = ball.radius * np.column_stack([NOSE_COSINE * normal, np.full(rows.size, NOSE_SINE)])
        unit = arm / ball.radius
        at = relative + np.cross(turn, arm)
        slip = np.linalg.norm(at - unit * np.sum(at * unit, axis=1, keepdims=True), axis=1)
        impact = Impact(kind, ball, approach, slip, np.zeros(rows.size), np.zeros(rows.size))
        for effect in self.doers:
            effect.impact(impact, rows)
        e = np.where(approach < DEAD, 0.0, np.clip(impact.restitution, 0.0, 1.5))
        cloth = np.broadcast_to(of(getattr(self.cloth or self.effects[0], "slide", 0.0), rows), rows.shape).copy()
        mu = np.maximum(impact.friction, 0.0)
        collide_rows(kind == "cushion", hit, p, v, w, e, mu, cloth, ball.mass, ball.radius)
        self.qvel[rows, :, :3] = v
        self.qvel[rows, :, 3:] = _spin_to_world(quat, w, True)
        for k, s in enumerate(rows):
            names = self.shots[s].names
            hurt = (names[i[k]], names[j[k]]) if kind == "ball" else (names[i[k]],)
            self.events[s].append(Event(float(self.clock[s]), kind, hurt, "" if kind == "ball" else RAILS[j[k]]))

    def _pot(self, s: int, i: int) -> None:
        self.events[s].append(Event(float(self.clock[s]), "pocket", (self.shots[s].names[i],)))
        self.alive[s, i] = False
        self.qpos[s, i, 2] = -1.0 - i  # out of the way of native contacts
        self.qvel[s, i] = 0

    def _track(self, k: int) -> Track:
        data = self.samples[k, : self.count[k]]
        return Track(
            self.shots[k].names, self.shots[k].times, data[..., :2], data[..., 2:4], data[..., 4:7], data[..., 7],
            tuple(self.events[k]),
        )  # fmt: skip


def _check(model: Model, shots: Sequence[Shot]) -> None:
    """Raise ValueError, which names the offender, for shots and parameters that do not fit together."""
    for effect in model.stack():
        for key in effect.parameters():
            shape, name = np.shape(getattr(effect, key)), f"{effect.name()}.{key}"
            if shape not in ((), (len(shots),)):
                raise ValueError(f"{name} has shape {shape}; give one number, or one for each of {len(shots)} shots")
    for k, shot in enumerate(shots):
        n, times = len(shot.names), np.asarray(shot.times, float)
        if n == 0:
            raise ValueError(f"shot {k} has no balls; name at least one")
        for name, shape in (("position", (n, 2)), ("velocity", (n, 2)), ("spin", (n, 3)), ("times", (times.size,))):
            value = np.asarray(getattr(shot, name), float)
            if value.shape != shape:
                raise ValueError(f"shot {k}: {name} has shape {value.shape}; {n} balls need {shape}")
            if not np.isfinite(value).all():
                raise ValueError(f"shot {k}: {name} holds {value[~np.isfinite(value)][0]}; give finite numbers")
        if times.size and (times[0] < 0 or (times[1:] < times[:-1]).any()):
            raise ValueError(f"shot {k}: times go backwards or below 0; give increasing times from 0")
        if not (shot.max_step > 0 and shot.impact_step > 0):
            raise ValueError(f"shot {k}: max_step {shot.max_step}, impact_step {shot.impact_step}; both must exceed 0")


def simulate(
    model: Model, shots: Sequence[Shot], progress: Callable[[int], None] | None = None, *, threads: int = 0
) -> list[Track]:
    """Play shots on a model; a parameter that is an array gives each shot its own value.

    Args:
        model: table, ball and effects; parameters are numbers or (len(shots),) arrays.
        shots: the balls' states at t = 0 and the times wanted.
        progress: called with the number of shots done.
        threads: that step the simulations; 0 for one a core.

    Returns:
        A track for every shot, in order; the same bytes at any thread count, whatever else is in the batch.
    """
    _check(model, shots)
    tracks: list[Track | None] = [None] * len(shots)
    sizes = np.array([len(s.names) for s in shots])
    done = 0
    for size in np.unique(sizes):
        rows = np.flatnonzero(sizes == size)
        for start in range(0, rows.size, CHUNK):
            part = rows[start : start + CHUNK]
            for k, track in zip(part, _Group(model, [shots[r] for r in part], part, threads).run(), strict=True):
                tracks[k] = track
            done += part.size
            if progress:
                progress(done)
    return [t for t in tracks if t is not None]
