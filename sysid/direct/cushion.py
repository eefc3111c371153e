"""Restitution and friction of the cushion.

In: segments with their fitted slide and roll. Out: `Measured` ratio of the velocities, restitution and friction.

Velocities before and after are taken at the instant at which the two paths meet. Their ratio along the normal is the
APPARENT restitution: the nose is above the centre and the cloth acts, so it depends on the spin (0.91 rolling, 0.84 in
stun, of an energetic 0.98). For balls that came rolling, the velocity after and the slip are turned into the energetic
restitution and the friction of the impact model of models/analytic/impulse.py.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from models.analytic.impulse import rebound_rows
from models.shot import Ball
from sysid.clips import ClipSet
from sysid.clips.segments import MAX_IMPACT_GAP_S, Segment
from sysid.direct.at_impact import (
    MAX_IMPACT_SD,
    MIN_APPROACH_M_S,
    Before,
    Known,
    motion_after,
    motion_before,
    next_segment,
)
from sysid.direct.measured import MIN_VALUES_FOR_SPEED, Kind, Measured, Single, combine
from sysid.direct.slide_roll import Array, SegmentMotion, SlideRoll

MAX_REBOUND_CHI2 = 14.0  # chi-square of four velocities beyond which a rebound is left out
MAX_RATIO_ANGLE_RAD, MAX_RESTITUTION_ANGLE_RAD = np.radians([25.0, 50.0])  # largest angles of incidence
MAX_RATIO_SIDESPIN = 0.35  # largest R w / v of a rebound whose ratio is used
MAX_RAIL_DISTANCE_M = 0.02  # largest distance of a rebound from the cushion
USUAL_FRICTION = (0.14, 0.05)  # a cushion's friction and its sd, if the tracks do not determine it: Mathavan 2010
MIN_REBOUNDS, MAX_REBOUNDS = 5, 40  # rebounds from which the cushion's friction is estimated

CUSHION_RATIO = Kind(
    "cushion velocity ratio", "1", "rebounds", "normal velocity after over before, rolling, within 25 deg",
    "film balls that roll straight at a cushion", 1.0, "cushion_restitution_speed", "s/m",
)  # fmt: skip
CUSHION_RESTITUTION = Kind(
    "cushion_impact.restitution", "1", "rebounds", "energetic, of velocity and slip after a rolling ball's",
    "film balls that roll at a cushion", 1.0, "cushion_restitution_speed", "s/m",
)  # fmt: skip
CUSHION_FRICTION = Kind(
    "cushion_impact.friction", "1", "rebounds", "the one with which rebounds agree best",
    "film five or more balls that roll at a cushion at angles",
)  # fmt: skip


@dataclass(frozen=True)
class Rebound:
    """A ball at a cushion: its velocity before, and its motion after."""

    ratio: Single  # of the normal velocities
    into: Array  # (2,) velocity before [m/s]
    cov_into: Array  # (2, 2)
    after: SlideRoll
    normal: Array  # (2,) into the cushion
    angle: float  # of incidence, off the normal [rad]
    rolled: bool  # whether it came rolling


def rebounds(found: Sequence[SegmentMotion], clip_set: ClipSet, known: Known) -> list[Rebound]:
    """Every rebound with enough samples before and after it."""
    used = []
    centre_limit = clip_set.table.centre_limits(clip_set.ball)
    for k in found:
        s, end = k.segment, float(k.segment.time[-1])
        after = next_segment(found, s.clip, s.ball, "cushion", end) if s.after == "cushion" else None
        before = motion_before(k, known) if after is not None else None
        if after is None or before is None:
            continue
        axis, sign = "xy".index(after.rail[1]), 1.0 if after.rail[0] == "+" else -1.0
        contact = _contact(before, after, axis, known)
        if contact is None or not end < contact[0] < after.time[0]:
            continue
        time, fit = contact
        (into, cov_into), (out, cov_out) = before.fit.state(time - before.start), fit.state(0.0)
        v, w, n = sign * float(into[2 + axis]), -sign * float(out[2 + axis]), 2 + axis
        if v > MIN_APPROACH_M_S and w > 0 and abs(sign * into[axis] - centre_limit[axis]) < MAX_RAIL_DISTANCE_M:
            sd = math.hypot(math.sqrt(cov_out[n, n]), w / v * math.sqrt(cov_into[n, n])) / v
            ratio = Single(clip_set.clips[s.clip].file, s.ball, time, w / v, sd, v)
            angle = math.acos(min(v / math.hypot(*into[2:]), 1.0))
            normal = sign * np.eye(2)[axis]
            used.append(Rebound(ratio, into[2:], cov_into[2:, 2:], fit, normal, angle, before.rolls))
    return used


def _contact(before: Before, after: Segment, axis: int, known: Known) -> tuple[float, SlideRoll] | None:
    """The time at which the two paths of a rebound meet, along the normal [s], and the motion from then on."""
    contact = float(after.time[0]) - known.frame
    fit = motion_after(after, contact, known)
    for _ in range(2):
        if fit is None:
            return None
        here, there = before.fit.state(contact - before.start)[0], fit.state(0.0)[0]
        closing = max(abs(float(here[2 + axis] - there[2 + axis])), MIN_APPROACH_M_S)
        gap = float(
            np.clip(abs(there[axis]) - abs(here[axis]), -MAX_IMPACT_GAP_S * closing, MAX_IMPACT_GAP_S * closing)
        )
        contact += gap / closing
        fit = motion_after(after, contact, known)
    return None if fit is None else (contact, fit)


def solved(came: Sequence[Rebound], ball: Ball, cloth: float, frictions: Array) -> Array:
    """Energetic restitution, its sd, R omega_z over the normal speed, chi-square, for every friction: (g, n, 4).

    Gauss-Newton for restitution and sidespin with which the impact model predicts the velocity after, and the slip,
    which the slide after the impact takes up. (Frame: y into the cushion.)

    Args:
        came: n balls that came rolling.
        ball: their mass and size.
        cloth: friction of the cloth, mu_s.
        frictions: of the cushion (g,).
    """
    if not came:
        return np.zeros((len(frictions), 0, 4))
    turn = np.array([[[r.normal[1], -r.normal[0]], r.normal] for r in came])
    both = np.array([np.kron(np.eye(2), k) for k in turn])
    into = np.einsum("nij,nj->ni", turn, [r.into for r in came])
    seen = np.einsum("nij,nj->ni", both, [r.after.parameters[2:6] for r in came])

    def predicted(x: Array, v: Array, mu: Array) -> Array:
        return _after_cushion(x, v, mu, cloth, ball)

    usual, loose = np.array([0.9, 0.0]), np.diag([4.0, 0.4])  # a weak prior of restitution and sidespin
    carried = _jacobian(lambda d: predicted(usual, into + d, np.array(USUAL_FRICTION[0]))) @ turn
    cov = both @ np.array([r.after.covariance[2:6, 2:6] for r in came]) @ both.transpose(0, 2, 1)
    weight = np.linalg.inv(cov + carried @ np.array([r.cov_into for r in came]) @ carried.transpose(0, 2, 1))
    mu = frictions[:, None, None]
    x = np.tile(usual, (len(frictions), 3, len(came), 1))
    x[..., 1] += np.array([-0.7, 0.0, 0.7])[:, None]  # where the slip sticks, its sign before is not seen
    for _ in range(10):
        j = _jacobian(lambda d: predicted(x + d, into, mu))  # noqa: B023 (called at once)
        residual = seen - predicted(x, into, mu)
        weighted = np.swapaxes(j, -1, -2) @ weight
        square = weighted @ j + loose
        step = np.linalg.solve(square, weighted @ residual[..., None] + loose @ (usual - x)[..., None])[..., 0]
        x = np.clip(x + np.clip(step, -0.2, 0.2), [0.2, -3.0], [1.2, 3.0])
    chi2 = np.einsum("gsni,nij,gsnj->gsn", residual, weight, residual)
    found = np.stack([x[..., 0], np.sqrt(np.linalg.inv(square)[..., 0, 0]), x[..., 1], chi2], axis=-1)
    return np.take_along_axis(found, np.argmin(chi2, axis=1)[:, None, :, None], axis=1)[:, 0]


def _after_cushion(x: Array, v: Array, mu: Array, cloth: float, ball: Ball) -> Array:
    """Velocity after, and -2/7 of the slip, of rolling balls (..., 4) [m/s].

    From restitution and sidespin x (..., 2), velocities before v (..., 2) and frictions mu (...,), broadcast.
    """
    shape = np.broadcast_shapes(x.shape[:-1], v.shape[:-1], mu.shape)
    e, side, friction = (np.broadcast_to(k, shape).flatten() for k in (x[..., 0], x[..., 1], mu))
    n = len(e)
    velocity = np.zeros((n, 3))
    velocity[:, :2] = np.broadcast_to(v, (*shape, 2)).reshape(n, 2)
    spin = np.column_stack([-velocity[:, 1], velocity[:, 0], side * velocity[:, 1]]) / ball.radius
    rebound_rows(velocity, spin, e, friction, cloth, ball.radius)
    slip = velocity[:, :2] + ball.radius * np.column_stack([-spin[:, 1], spin[:, 0]])
    return np.concatenate([velocity[:, :2], -2 / 7 * slip], axis=1).reshape(*shape, 4)


def _jacobian(f: Callable[[Array], Array]) -> Array:
    """Derivatives by two unknowns at 0, from central differences."""
    return np.stack([f(d) - f(-d) for d in 1e-4 * np.eye(2)], axis=-1) / 2e-4


def friction(came: Sequence[Rebound], ball: Ball, cloth: float) -> Measured:
    """Friction of the cushion that predicts rebounds best and gives the most consistent restitution."""
    best = sorted(came, key=lambda r: r.ratio.sd / r.ratio.value)[:MAX_REBOUNDS]
    grid, rows, value = np.zeros(0), np.zeros((0, len(best), 4)), 0.0
    for more in (np.linspace(0.02, 0.42, 15), np.linspace(-0.05, 0.05, 21)):
        more = np.clip(more + value, 0.005, 0.43)
        rows = np.concatenate([rows, solved(best, ball, cloth, more)])[np.argsort(np.concatenate([grid, more]))]
        grid = np.sort(np.concatenate([grid, more]))
        fitting = rows[..., 3].min(axis=0) < MAX_REBOUND_CHI2
        n = int(fitting.sum())
        if n < MIN_REBOUNDS:
            return combine(CUSHION_FRICTION, [])
        e, sd, _, chi2 = np.moveaxis(rows[:, fitting], -1, 0)
        speed = np.array([r.ratio.speed for r in best])[fitting]
        columns = np.column_stack([np.ones(n), speed])[:, : 2 if n >= MIN_VALUES_FOR_SPEED else 1]  # e may fall
        root = (np.abs(e - np.median(e, axis=1)[:, None]) < 9 * np.hypot(sd, 0.03)) / sd
        line = (columns @ (np.linalg.pinv(columns * root[..., None]) @ (e * root)[..., None]))[..., 0]
        disagreement = np.minimum(((e - line) / sd) ** 2, MAX_REBOUND_CHI2)
        total = np.sum(np.minimum(chi2, MAX_REBOUND_CHI2) + disagreement, axis=1)
        usual, usual_sd = USUAL_FRICTION
        total = total / max(float(total.min()) / (3 * n - 2), 1.0) + ((grid - usual) / usual_sd) ** 2
        value = float(grid[np.argmin(total)])
    chance = np.exp(-0.5 * (total - total.min())) * np.gradient(grid)
    value = float(np.average(grid, weights=chance))
    width = math.hypot(math.sqrt(np.average((grid - value) ** 2, weights=chance)), 0.001)
    if width < USUAL_FRICTION[1] / 2:
        return Measured(CUSHION_FRICTION, value, width, n)
    return combine(CUSHION_FRICTION, [])


def cushion(found: Sequence[Rebound], ball: Ball, cloth: float, notes: Sequence[str]) -> list[Measured]:
    """Ratio of the normal velocities, energetic restitution, friction; of balls that came rolling."""
    came = [r for r in found if r.rolled and r.angle < MAX_RESTITUTION_ANGLE_RAD]
    nose = friction(came, ball, cloth)
    mu, mu_sd = (nose.value, nose.sd) if nose.value is not None and nose.sd is not None else USUAL_FRICTION
    rows = solved(came, ball, cloth, np.array([mu, mu - mu_sd, mu + mu_sd]))

    def energetic(row: Array) -> list[Single]:
        values = [(r, float(x[0]), float(x[1])) for r, x in zip(came, row, strict=True) if x[3] < MAX_REBOUND_CHI2]
        return [dataclasses.replace(r.ratio, value=e, sd=sd) for r, e, sd in values if sd < MAX_IMPACT_SD]

    slid = len(found) - sum(r.rolled for r in found)
    sliding = [f"{slid} of {len(found)} balls came sliding and are left out: their spin is unknown"] if slid else []
    assumed = [] if nose.value else ["the cushion's friction is not measured here; 0.14 +- 0.05 is assumed"]
    e, low, high = (combine(CUSHION_RESTITUTION, energetic(row), [*notes, *sliding, *assumed]) for row in rows)
    if e.value is not None and e.sd is not None and low.value is not None and high.value is not None:
        e = dataclasses.replace(e, sd=math.hypot(e.sd, (high.value - low.value) / 2))
    straight = [
        r.ratio for r, x in zip(came, rows[0], strict=True)
        if r.angle < MAX_RATIO_ANGLE_RAD and abs(x[2]) < MAX_RATIO_SIDESPIN
    ]  # fmt: skip
    return [combine(CUSHION_RATIO, [k for k in straight if k.sd < MAX_IMPACT_SD], sliding), e, nose]
