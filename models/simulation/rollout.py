"""Shots of one number of balls, side by side on mujoco.batch, with step sizes chosen by what happens next.

Where the cloth is an effect, forces are constant between its switches (slide to roll, stop, end of sidespin), so a
step lands on the next switch or touch, and is exact: MuJoCo's semi-implicit position is ahead by a h^2 / 2, which is
taken back. Impacts that effects resolve are landed on; where two bodies meet alone, their impulse carries them through
(models/analytic/impulse.py), where more do, small steps through MuJoCo's contacts (contact.py). Contacts of the
plain MJCF take small steps around a touch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models import record as rec
from models.analytic.cloth import STILL_SPEED
from models.analytic.events import DEAD_SPEED, LEAN_SPEED
from models.analytic.impulse import collide_rows
from models.analytic.pocket import NO_ARCS, Pockets, pockets_of, rail_of
from models.analytic.spring import CALM_TIME_S, CUSHION_TIME, MAX_CLUSTER_S, SPRING_STEP_S
from models.engine.cluster import CROWD_GAP_M
from models.engine.impacts import ask_rows, crowded, part_rows, strike_rows
from models.engine.motion import CURVE, POTTED, REST
from models.engine.play import CLOTH_CONSTANTS
from models.engine.rubber import delay_rebounds, push_out_rows
from models.hooks import hooks_of
from models.model_file import Model
from models.shot import Array, Event, Shot, Track
from models.simulation.act import Balls
from models.simulation.batch import batch
from models.simulation.contact import Contacts
from models.simulation.curve import TRIAL_MARGIN, Curve, follow, land
from models.simulation.sampling import record, record_curve, spin_to_world
from models.simulation.touch import BALL, CUSHION, LEAN_STEP, POCKET, native_step, next_touch

NATIVE_STEP = 2e-3  # longest step on native cloth [s]; its contact time is 4 ms
NATIVE_RUN = 4  # of them between two looks at what comes next
STOP_SPEED = 1e-3  # speed from which a rolling ball may stop within a step [m/s]
MAX_STEPS = 200_000


@dataclass
class Rollout:
    """Shots of one number of balls, in one batch."""

    model: Model
    shots: Sequence[Shot]
    rows: NDArray[np.int64]  # of these shots among all, to pick per-simulation parameters
    threads: int
    contacts: str = "clusters"
    jaws: bool = False

    def __post_init__(self) -> None:
        """Compile the world and lay out the state."""
        own = self.model.select(self.rows)
        self.effects = own.stack()
        acting = self.effects[1:]
        cloth = next((e for e in acting if e.slot == "cloth"), None)
        nsim = len(self.shots)
        self.hooks = hooks_of([e for e in acting if e is not cloth], nsim)
        self.varies = len(self.hooks.forces) > 0
        self.resolved = np.array([any(e.resolves == k for e in acting) for k in ("ball", "cushion")])
        self.exact = cloth is not None
        laws = CLOTH_CONSTANTS if cloth is not None else ()
        self.cloth: Array = np.zeros((nsim, len(laws)))
        for k, law in enumerate(laws):
            self.cloth[:, k] = getattr(cloth, law)
        self.slide: Array = np.zeros(nsim)
        self.slide[:] = getattr(cloth or own.native, "slide", 0.0)
        names = [f"ball {i}" for i in range(len(self.shots[0].names))]
        self.batch = batch(self.model, names, self.effects, self.exact, self.resolved, len(self.shots), self.threads)
        self.world: Contacts | None = None
        nsim, nball = len(self.shots), len(self.shots[0].names)
        self.qpos = self.batch.bind("qpos").reshape(nsim, nball, 7)
        self.qvel = self.batch.bind("qvel").reshape(nsim, nball, 6)
        self.push = self.batch.bind("xfrc_applied")
        self.timestep = self.batch.expand("opt.timestep")
        self.alive = np.ones((nsim, nball), bool)
        table, ball = self.model.table, self.model.ball
        self.pockets = pockets_of(table, ball) if self.jaws else Pockets(table.mouths(), NO_ARCS, NO_ARCS)
        # Until when; each ball with each other, each rail and jaw [s].
        self.quiet = np.full((nsim, nball, nball + 4 + len(self.pockets.jaws)), -np.inf)
        self.leaning = False
        self.theta = np.zeros((nsim, nball))
        self.rolled = np.zeros((nsim, nball))
        self.room = np.full(nsim, np.inf)  # that the last step would have had, where forces vary [s]
        self.events: list[list[Event]] = [[] for _ in self.shots]
        self.limits = table.centre_limits(ball)
        self.half = np.array([table.length / 2, table.width / 2])
        self.falls = np.array([[name not in s.staying for name in s.names] for s in self.shots])
        self._start()

    def _start(self) -> None:
        spin = np.array([s.spin for s in self.shots], float)
        velocity = np.array([s.velocity for s in self.shots], float)
        struck = np.array([s.struck for s in self.shots])
        strike_rows(
            self.hooks.own, self.hooks.strike, self.model.ball.radius, self.model.ball.mass, struck, velocity, spin
        )
        self.qpos[:] = 0
        self.qpos[..., :2] = [s.position for s in self.shots]
        self.qpos[..., 2] = self.model.ball.radius
        self.qpos[..., 3] = 1
        self.qvel[:] = 0
        self.qvel[..., :2] = velocity
        self.qvel[..., 3:] = spin
        self.session = np.array([s.session.row for s in self.shots])
        self.launch = np.hypot(velocity[:, 0, 0], velocity[:, 0, 1]) * struck
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
        record(
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
        w = spin_to_world(self.qpos[rows, :, 3:], self.qvel[rows, :, 3:], False)
        return Balls(
            self.model.ball, p, v, w, self.alive[rows], self.rolled[rows], self.clock[rows], self.launch[rows],
            self.session[rows], rows,
        )  # fmt: skip

    def _step(self, rows: NDArray[np.int64]) -> None:
        balls = self._balls(rows)
        limit = np.full(rows.size, np.inf if self.exact else NATIVE_RUN * NATIVE_STEP)
        limit = np.minimum(limit, balls.act(self.hooks, self.cloth))
        # A moving simulation takes no step beyond the longest; one at rest goes to its end at once.
        moving = np.any(balls.velocity[..., :2] != 0, axis=(1, 2)) | np.any(
            balls.acceleration[..., :2] != 0, axis=(1, 2)
        )
        limit = np.where(moving, np.minimum(limit, self.longest[rows]), limit)
        limit = np.minimum(limit, np.maximum(self.end[rows] - self.clock[rows], 1e-12))
        switch = limit
        if self.varies:
            limit = np.where(moving, np.minimum(limit, self.room[rows]), limit)
        alive, quiet, falls = self.alive[rows], self._quiet(rows), self.falls[rows]
        acceleration = balls.acceleration

        def touch(some: Any, acceleration: Array, limit: Array) -> tuple[Array, NDArray[np.int64]]:
            return next_touch(
                balls.position[some], balls.velocity[some], acceleration, alive[some], balls.ball.radius, self.limits,
                self.half, self.pockets.ends, self.pockets.jaws, self.pockets.falls, falls[some], self.resolved,
                quiet[some], limit,
            )  # fmt: skip

        step, hit = touch(slice(None), acceleration, limit)
        rough = np.zeros(rows.size, bool)
        if not self.resolved.all():
            safe = native_step(
                balls.position, balls.velocity, acceleration, alive, balls.ball.radius, self.limits, ~self.resolved,
                self.fine[rows], np.full(rows.size, np.inf),
            )  # fmt: skip
            hit[safe < step] = 0
            rough = safe <= self.fine[rows]
            step = np.minimum(step, safe)
        curve = None
        if self.varies:
            now = (hit[:, 0] > 0) & ~rough & (step <= 0)  # they touch already, and no curve has no length
            near = np.where(now, limit, np.minimum(TRIAL_MARGIN * step, limit))
            trial = np.where((hit[:, 0] > 0) & ~rough, near, step)
            curve, free = follow(self.hooks, self.cloth, balls, trial, self.end[rows] - self.clock[rows])
            if self.resolved.all():
                landed, met = land(touch, curve, curve.span)
                step, hit = np.where(now, step, landed), np.where(now[:, None], hit, met)
            else:
                hit[curve.span < step] = 0
                step = np.minimum(step, curve.span)
            self.room[rows] = np.where((step < switch) & (hit[:, 0] == 0), free, np.inf)
            balls.acceleration, balls.turning = curve.mean(curve.push, step), curve.mean(curve.turn, step)
        self._advance(rows, balls, step, rough, curve)
        for kind, number in (("ball", BALL), ("cushion", CUSHION)):
            found = np.flatnonzero(hit[:, 0] == number)
            if found.size:
                self._impact(kind, rows[found], hit[found])
        for k in np.flatnonzero(hit[:, 0] == POCKET):
            self._pot(int(rows[k]), int(hit[k, 1]))

    def _advance(
        self, rows: NDArray[np.int64], balls: Balls, step: Array, rough: NDArray[np.bool_], curve: Curve | None
    ) -> None:
        ball = balls.ball
        self.push[rows, 1:, :3] = ball.mass * balls.acceleration
        self.push[rows, 1:, 3:] = ball.inertia * balls.turning
        go = step > 0
        parts = (
            np.ones(rows.size, np.int64)
            if self.exact
            else np.maximum(np.ceil(step / NATIVE_STEP - 1e-9), 1).astype(int)
        )
        self.timestep[rows[go]] = (step[go] / parts[go]).reshape(-1, *self.timestep.shape[1:])
        for number in np.unique(parts[go]):
            self.batch.step(ids=rows[go & (parts == number)], nstep=int(number))
        v1 = self.qvel[rows, :, :3]
        if self.exact:
            # The semi-implicit step is ahead by half the change of velocity.
            behind = 0.5 * (step * ~rough)[:, None, None] * (v1 - balls.velocity)
            self.qpos[rows, :, :2] -= behind[..., :2] * go[:, None, None]
            if curve is not None:
                smooth = ~rough & go
                p1 = balls.position + curve.shift(balls.velocity, curve.push, step)
                self.qpos[rows[smooth], :, :2] = p1[smooth, :, :2]
            # A native nose presses the ball down, on a slate that does not give.
            self.qpos[rows, :, 2] = np.where(self.alive[rows], ball.radius, self.qpos[rows, :, 2])
            self.qvel[rows, :, 2] = 0
            w1 = balls.spin + balls.turning * step[:, None, None]
            # A rolling ball that would turn back within a step, or would but for a push across its way, is at rest.
            back = np.sum(balls.velocity[..., :2] * v1[..., :2], axis=-1) < 0
            if curve is not None:
                first = balls.velocity + step[:, None, None] * curve.push[0]
                back |= np.sum(balls.velocity[..., :2] * first[..., :2], axis=-1) < 0
            if back.any():
                slow = back & balls.rolling & (np.hypot(balls.velocity[..., 0], balls.velocity[..., 1]) < STOP_SPEED)
                v1[slow] = 0.0
                w1[..., :2][slow] = 0.0
                self.qvel[rows, :, :3] = v1
                self.qvel[rows, :, 3:] = spin_to_world(self.qpos[rows, :, 3:], w1, True)
            if rough.any():
                w1[rough] = spin_to_world(self.qpos[rows[rough], :, 3:], self.qvel[rows[rough], :, 3:], False)
        else:
            w1 = spin_to_world(self.qpos[rows, :, 3:], self.qvel[rows, :, 3:], False)
        self._record(rows, balls, step, self.qpos[rows, :, :3], v1, w1, curve)
        moved, moves = (np.hypot(v[..., 0], v[..., 1]) > STILL_SPEED for v in (balls.velocity, v1))
        if (moved & ~moves).any():
            p, kind = self.qpos[rows, :, :3], np.where(self.alive[rows], np.where(moves, CURVE, REST), POTTED)
            push_out_rows(moved, kind, p, self.pockets.jaws, ball.radius, self.limits, self.half, self.pockets.ends)
            self.qpos[rows, :, :3] = p

    def _record(
        self, rows: NDArray[np.int64], balls: Balls, step: Array, p1: Array, v1: Array, w1: Array,
        curve: Curve | None = None,
    ) -> None:  # fmt: skip
        """Sample the step from `balls` to the state after it, and let its time pass."""
        t0 = self.clock[rows]
        if self.varies:
            speeds = [np.hypot(v[..., 0], v[..., 1]) for v in (balls.velocity, v1)]
            rolls = balls.rolling * step[:, None] / balls.ball.radius
            self.rolled[rows] += rolls * (curve.way(balls.velocity, step) if curve else 0.5 * (speeds[0] + speeds[1]))
        if curve is not None:
            record_curve(
                rows, t0, step, self.times, self.count, self.next, balls.position, balls.velocity, balls.spin,
                curve.push, curve.turn, v1, w1, p1, self.theta, self.alive, self.samples,
            )  # fmt: skip
            self.theta[rows] += curve.shift(balls.spin, curve.turn, step)[..., 2]
            self.clock[rows] = t0 + step
            return
        record(
            rows, t0, step, self.times, self.count, self.next, balls.position, balls.velocity, balls.spin, v1, w1, p1,
            self.theta, self.alive, self.samples,
        )  # fmt: skip
        self.theta[rows] += 0.5 * step[:, None] * (balls.spin[..., 2] + w1[..., 2])
        self.clock[rows] = t0 + step

    def _coefficients(
        self, kind: str, rows: NDArray[np.int64], p: Array, v: Array, w: Array, i: NDArray[np.int64],
        j: NDArray[np.int64],
    ) -> Array:  # fmt: skip
        """Impacts, one row each, as the effects say: (n, IMPACT_FIELDS)."""
        out = np.zeros((rows.size, rec.IMPACT_FIELDS))
        ask_rows(
            kind == "cushion", p, v, w, i, j, self.pockets.jaws, self.model.ball.radius, self.session[rows],
            self.clock[rows], self.hooks.own, rows, self.hooks.impact, out,
        )  # fmt: skip
        return out

    def _impact(self, kind: str, rows: NDArray[np.int64], hit: NDArray[np.int64]) -> None:
        """Bodies that touch: two alone by their impulse, several at a time through MuJoCo's contacts."""
        p, v = self.qpos[rows, :, :3], self.qvel[rows, :, :3]
        quat = self.qpos[rows, :, 3:]
        w = spin_to_world(quat, self.qvel[rows, :, 3:], False)
        ball, i, j = self.model.ball, hit[:, 1], hit[:, 2]
        impact = self._coefficients(kind, rows, p, v, w, i, j)
        approach, e, mu = impact[:, rec.APPROACH], impact[:, rec.RESTITUTION], impact[:, rec.FRICTION]
        # A rolling ball that has met something rolls on against it: one event, looked at every LEAN_STEP.
        other, now = j + (kind == "cushion") * self.alive.shape[1], self.clock[rows]
        leans = now < self.quiet[rows, i, other] + LEAN_STEP
        slow = approach < np.where(leans, LEAN_SPEED, DEAD_SPEED)
        alone = np.ones(rows.size, bool)
        if self.resolved.all() and self.contacts != "never":
            near = np.maximum(CROWD_GAP_M, approach * CUSHION_TIME)
            there = np.where(self.alive[rows], REST, POTTED)
            crowd = crowded(
                kind == "cushion", hit, p, there, near, ball.radius, self.limits, self.half,
                self.pockets.ends,
            )  # fmt: skip
            jaw = (j >= 4) & (kind == "cushion")  # no contact of MuJoCo's stands for a jaw
            crowd &= ~jaw
            slow |= crowd & (approach < LEAN_SPEED)  # what leans pushes on through the others
            alone = slow | jaw | ~(crowd | (self.contacts == "always"))
        if not alone.all():
            self._through_contacts(rows[~alone])
        if not alone.any():
            return
        e = np.where(slow, 0.0, e)[alone]
        rows, hit, i, j, other = (a[alone] for a in (rows, hit, i, j, other))
        p, v, w, quat, mu, now = (a[alone] for a in (p, v, w, quat, mu, now))
        slow, leans = slow[alone], leans[alone]
        collide_rows(
            kind == "cushion", hit, p, v, w, e, mu, self.slide[rows], ball.mass, ball.radius, impact[alone, rec.GAIN],
            impact[alone, rec.DECAY], impact[alone, rec.MASS_FIRST] / impact[alone, rec.MASS_SECOND],
            impact[alone, rec.NOSE], impact[alone, rec.COMPLIANCE], impact[alone, rec.SINK], self.pockets.jaws,
        )  # fmt: skip
        self.qvel[rows, :, :3] = v
        self.qvel[rows, :, 3:] = spin_to_world(quat, w, True)
        if kind == "cushion":
            times = np.where(slow, 0.0, impact[alone, rec.CONTACT_TIME])
            delay_rebounds(hit, p, v, times, self.slide[rows], ball.radius, self.half, self.pockets.ends)
            self.qpos[rows, :, :2] = p[..., :2]
        if slow.any():
            self.leaning = True
            self.quiet[rows[slow], i[slow], other[slow]] = now[slow] + LEAN_STEP
            touching = p[slow]
            part_rows(kind == "cushion", hit[slow], touching, ball.radius, self.limits, self.pockets.jaws)
            self.qpos[rows[slow], :, :3] = touching
        for k in np.flatnonzero(~(slow & leans)):
            self._log(int(rows[k]), kind, int(i[k]), int(j[k]))

    def _quiet(self, rows: NDArray[np.int64]) -> Array:
        """For how long bodies that lean on each other need no other look (n, nball, nball + 4 + jaws) [s]."""
        if not self.leaning:
            return self.quiet[: rows.size]
        return np.maximum(self.quiet[rows] - self.clock[rows, None, None], 0.0)

    def _log(self, s: int, kind: str, i: int, j: int) -> None:
        names = self.shots[s].names
        hurt = (names[i], names[j]) if kind == "ball" else (names[i],)
        self.events[s].append(Event(float(self.clock[s]), kind, hurt, "" if kind == "ball" else rail_of(j)))

    def _through_contacts(self, rows: NDArray[np.int64]) -> None:
        """Carry simulations through impacts in small steps, until nothing in them touches."""
        if self.world is None:
            nsim, nball = self.alive.shape
            effects = [e.select(0) for e in self.effects]
            self.world = Contacts(self.model, effects, nball, nsim, self.threads, self.pockets.ends)
        world = self.world
        world.enter(rows, self.qpos[rows, :, :3], self.qvel[rows, :, :3], self.alive[rows])
        end, calm = self.clock[rows] + MAX_CLUSTER_S, np.zeros(rows.size)
        while rows.size:
            balls, alive, cloth = self._balls(rows), self.alive[rows], self.slide[rows]
            balls.act(self.hooks, self.cloth)
            which = world.closing(rows, balls, alive)
            for number, kind in enumerate(("ball", "cushion")):
                these = which[world.kind[which[:, 1]] == number]
                if len(these):
                    k, i, j = these[:, 0], world.first[these[:, 1]], world.second[these[:, 1]]
                    state = balls.position[k], balls.velocity[k], balls.spin[k]
                    begun = world.set(rows, these, kind == "cushion", self._coefficients(kind, rows[k], *state, i, j))
                    for n in np.flatnonzero(begun):
                        self._log(int(rows[k[n]]), kind, int(i[n]), int(j[n]))
            p, v, free, rests = world.step(rows, balls, alive, cloth)
            calm = np.where(rests, calm + SPRING_STEP_S, 0.0)
            w = balls.spin + balls.turning * SPRING_STEP_S
            self._record(rows, balls, np.full(rows.size, SPRING_STEP_S), p, v, w)
            self.qpos[rows, :, :2], self.qvel[rows, :, :2] = p[..., :2], v[..., :2]
            self.qvel[rows, :, 3:] = spin_to_world(self.qpos[rows, :, 3:], w, True)
            on = ~free & (calm < CALM_TIME_S) & (self.clock[rows] < end) & (self.next[rows] < self.count[rows])
            rows, end, calm = rows[on], end[on], calm[on]

    def _pot(self, s: int, i: int) -> None:
        x, y = self.qpos[s, i, :2]
        names = (self.shots[s].names[i],)
        self.events[s].append(Event(float(self.clock[s]), "pocket", names, place=(float(x), float(y))))
        self.alive[s, i] = False
        self.qpos[s, i, 2] = -1.0 - i  # out of the way of native contacts
        self.qvel[s, i] = 0

    def _track(self, k: int) -> Track:
        data = self.samples[k, : self.count[k]].copy()
        return Track(
            self.shots[k].names, self.shots[k].times, data[..., :2], data[..., 2:4], data[..., 4:7], data[..., 7],
            tuple(self.events[k]),
        )  # fmt: skip
