"""Balls on a cloth in small steps, and the laws that hide in it.

In: a `World` and balls as lists x, y, vx, vy, wx, wy, wz (SI). Out: the same balls a while later.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

GRAVITY, STEP_S = 9.81, 2e-4
IMPULSE_STEPS = 4000  # of the normal impulse, up to the end of compression
TOUCH_M = 1e-9  # within which an impact is landed on
NOSE_SIN, NOSE_COS = 0.4, math.sqrt(0.84)  # of the height at which a cushion meets a ball

Ball = list[float]
Law = Callable[["Seen"], float]


@dataclass
class Seen:
    """What a law may depend on."""

    ball: Ball
    number: int  # of the ball
    slip: float = 0.0
    approach: float = 0.0
    rail: str = ""
    incidence: float = 0.0  # of a rebound, from the normal [rad]
    other: int = -1
    order: float = 0.0  # of the clip in the session, 0 to 1
    celsius: float = 20.0  # in the room


def _constant(value: float) -> Law:
    return lambda seen: value


@dataclass
class World:
    """A table, its balls and what they obey."""

    length: float = 3.569
    width: float = 1.778
    radius: float = 0.02625
    mass: float = 0.1406
    order: float = 0.0
    celsius: float = 20.0
    slide: Law = field(default_factory=lambda: _constant(0.2))
    roll: Law = field(default_factory=lambda: _constant(0.0127))
    spin: Law = field(default_factory=lambda: _constant(22.0))  # deceleration of sidespin [rad/s^2]
    across: Law = field(default_factory=lambda: _constant(0.0))  # of a rolling ball, to the left of its way [m/s^2]
    frame: float = 1.0  # how long a frame lasts, over what the camera states
    cushion_e: Law = field(default_factory=lambda: _constant(0.88))
    cushion_mu: Law = field(default_factory=lambda: _constant(0.17))
    ball_e: Law = field(default_factory=lambda: _constant(0.93))
    ball_mu: Law = field(default_factory=lambda: _constant(0.055))

    def play(self, balls: list[Ball], times: list[float]) -> list[list[tuple[float, float]]]:
        """Places (x, y) of every ball at these times."""
        places: list[list[tuple[float, float]]] = [[] for _ in balls]
        clock = 0.0
        for time in times:
            while clock < time - 1e-12:
                step = min(STEP_S, time - clock)
                self._advance(balls, step)
                clock += step
            for ball, seen in zip(balls, places, strict=True):
                seen.append((ball[0], ball[1]))
        return places

    def _advance(self, balls: list[Ball], step: float) -> None:
        """Let a time pass; where bodies meet meanwhile, up to then, and from there on."""
        while step > 0.0:
            before, part = [ball[:] for ball in balls], step
            self._glide_all(balls, step)
            if self._deepest(balls) > TOUCH_M:
                low = 0.0
                while part - low > 1e-15 and not 0.0 <= self._deepest(balls) <= TOUCH_M:
                    middle = 0.5 * (low + part)
                    balls[:] = [ball[:] for ball in before]
                    self._glide_all(balls, middle)
                    low, part = (middle, part) if self._deepest(balls) < 0.0 else (low, middle)
                self._collide(balls)
            step -= part

    def _glide_all(self, balls: list[Ball], step: float) -> None:
        for number, ball in enumerate(balls):
            if any(ball[2:]):
                self._glide(ball, number, step)

    def _deepest(self, balls: list[Ball]) -> float:
        """How deep those are in each other that come closer; below 0 where none are [m]."""
        reach, found = self.radius * NOSE_COS, -math.inf
        for k, ball in enumerate(balls):
            for axis, half in ((0, self.length / 2), (1, self.width / 2)):
                for side in (1.0, -1.0):
                    if side * ball[2 + axis] > 0.0:
                        found = max(found, side * ball[axis] - (half - reach))
            for other in balls[:k]:
                dx, dy = ball[0] - other[0], ball[1] - other[1]
                if (ball[2] - other[2]) * dx + (ball[3] - other[3]) * dy < 0.0:
                    found = max(found, 2 * self.radius - math.hypot(dx, dy))
        return found

    def _collide(self, balls: list[Ball]) -> None:
        """The impacts of all that touch."""
        for a in range(len(balls)):
            for b in range(a + 1, len(balls)):
                self._meet(balls[a], balls[b], a, b)
        for number, ball in enumerate(balls):
            self._rebound(ball, number)

    def _glide(self, ball: Ball, number: int, step: float) -> None:
        """One ball on the cloth: sliding until its slip is gone, then rolling."""
        x, y, vx, vy, wx, wy, wz = ball
        radius, whole = self.radius, step
        ux, uy = vx - radius * wy, vy + radius * wx
        slip = math.hypot(ux, uy)
        seen = Seen(ball, number, slip=slip, order=self.order, celsius=self.celsius)
        ax = ay = 0.0
        if slip > 1e-9:
            a = self.slide(seen) * GRAVITY
            left = slip / (3.5 * a)
            part = min(step, left)
            ax, ay = -a * ux / slip, -a * uy / slip
            x, y = x + vx * part + 0.5 * ax * part**2, y + vy * part + 0.5 * ay * part**2
            vx, vy = vx + ax * part, vy + ay * part
            turn = 2.5 / radius * part
            wx, wy = wx + turn * ay, wy - turn * ax
            step -= part
            if left <= part + 1e-15:
                wx, wy = -vy / radius, vx / radius
        speed = math.hypot(vx, vy)
        if step > 0.0 and speed > 0.0:
            a = self.roll(seen) * GRAVITY
            part = min(step, speed / a)
            aside = self.across(seen)
            ax, ay = (-a * vx - aside * vy) / speed, (-a * vy + aside * vx) / speed
            x, y = x + vx * part + 0.5 * ax * part**2, y + vy * part + 0.5 * ay * part**2
            vx, vy = (vx + ax * part, vy + ay * part) if part < speed / a else (0.0, 0.0)
            wx, wy = -vy / radius, vx / radius
        wz = math.copysign(max(abs(wz) - self.spin(seen) * whole, 0.0), wz)
        ball[:] = [x, y, vx, vy, wx, wy, wz]

    def _rebound(self, ball: Ball, number: int) -> None:
        reach = self.radius * NOSE_COS
        for axis, half in ((0, self.length / 2), (1, self.width / 2)):
            for side in (1.0, -1.0):
                depth = side * ball[axis] - (half - reach)
                speed = side * ball[2 + axis]
                if depth < 0.0 or speed <= 0.0:
                    continue
                outward = (side, 0.0) if axis == 0 else (0.0, side)
                slip = math.hypot(*self._slip(ball, (outward[0] * NOSE_COS, outward[1] * NOSE_COS, NOSE_SIN)))
                rail = "+-"[side < 0] + "xy"[axis]
                angle = math.acos(min(speed / math.hypot(ball[2], ball[3]), 1.0))
                seen = Seen(ball, number, slip, speed, rail, angle, order=self.order, celsius=self.celsius)
                self._strike_cushion(ball, outward, speed, seen)

    def _strike_cushion(self, ball: Ball, out: tuple[float, float], speed: float, seen: Seen) -> None:
        """Impulses at the nose and at the cloth below, until the work is returned."""
        e, mu, cloth = self.cushion_e(seen), self.cushion_mu(seen), self._cloth(ball, seen.number)
        point = (out[0] * NOSE_COS, out[1] * NOSE_COS, NOSE_SIN)
        step = self.mass * speed / IMPULSE_STEPS
        work, least, returned = 0.0, 0.0, False
        while True:
            before = (ball[2] * out[0] + ball[3] * out[1]) * NOSE_COS
            kept = ball[:]
            self._push(ball, point, step, mu, cloth)
            after = (ball[2] * out[0] + ball[3] * out[1]) * NOSE_COS
            done = 0.5 * (before + after) * step
            if not returned and after <= 0.0:
                part = before / (before - after)
                ball[:] = kept
                self._push(ball, point, step * part, mu, cloth)
                work += 0.5 * before * step * part
                least, returned = (1.0 - e**2) * work, True
                continue
            if returned and work + done <= least:
                share = (work - least) / -done
                ball[:] = kept
                self._push(ball, point, step * min(share, 1.0), mu, cloth)
                return
            work += done

    def _push(self, ball: Ball, point: tuple[float, float, float], impulse: float, mu: float, cloth: float) -> None:
        """One step of the normal impulse at a point of the ball (unit vector from its centre), by its middle."""
        middle = ball[:]
        self._push_from(middle, ball[:], point, 0.5 * impulse, mu, cloth)
        self._push_from(ball, middle, point, impulse, mu, cloth)

    def _push_from(
        self, ball: Ball, now: Ball, point: tuple[float, float, float], impulse: float, mu: float, cloth: float
    ) -> None:
        """The same by the slips of a state."""
        px, py, pz = point
        sx, sy, sz = self._slip(now, point)
        slip = math.hypot(sx, sy, sz)
        size = min(mu * impulse, 2.0 / 7.0 * self.mass * slip) / slip if slip > 1e-12 else 0.0
        fx, fy, fz = -size * sx, -size * sy, -size * sz
        self._add(ball, (-impulse * px + fx, -impulse * py + fy), (fx, fy, fz), point)
        down = impulse * pz - fz
        self._press(ball, now, down, cloth)

    def _slip(self, now: Ball, point: tuple[float, float, float]) -> tuple[float, float, float]:
        """Velocity of the ball's surface at a point (unit vector from its centre), without that towards the point."""
        radius, (px, py, pz), (_, _, vx, vy, wx, wy, wz) = self.radius, point, now
        sx, sy, sz = vx + radius * (wy * pz - wz * py), vy + radius * (wz * px - wx * pz), radius * (wx * py - wy * px)
        normal = sx * px + sy * py + sz * pz
        return sx - normal * px, sy - normal * py, sz - normal * pz

    def _add(
        self, ball: Ball, linear: tuple[float, float], force: tuple[float, float, float],
        point: tuple[float, float, float],
    ) -> None:  # fmt: skip
        """A linear impulse, and the turn by a tangential one at a point."""
        k = 2.5 / (self.mass * self.radius)
        px, py, pz = point
        fx, fy, fz = force
        ball[2] += linear[0] / self.mass
        ball[3] += linear[1] / self.mass
        ball[4] += k * (py * fz - pz * fy)
        ball[5] += k * (pz * fx - px * fz)
        ball[6] += k * (px * fy - py * fx)

    def _press(self, ball: Ball, now: Ball, down: float, cloth: float) -> None:
        """Friction at the cloth under a ball that is pressed down by an impulse, by the slip of a state."""
        if down <= 0.0:
            return
        ux, uy = now[2] - self.radius * now[5], now[3] + self.radius * now[4]
        slip = math.hypot(ux, uy)
        if slip > 1e-12:
            size = min(cloth * down, 2.0 / 7.0 * self.mass * slip) / slip
            self._add(ball, (-size * ux, -size * uy), (-size * ux, -size * uy, 0.0), (0.0, 0.0, -1.0))

    def _cloth(self, ball: Ball, number: int) -> float:
        """Friction of the cloth under a ball as it comes to an impact."""
        slip = math.hypot(ball[2] - self.radius * ball[5], ball[3] + self.radius * ball[4])
        return self.slide(Seen(ball, number, slip=slip, order=self.order, celsius=self.celsius))

    def _meet(self, one: Ball, two: Ball, a: int, b: int) -> None:
        dx, dy = two[0] - one[0], two[1] - one[1]
        gap = math.hypot(dx, dy)
        if gap >= 2 * self.radius:
            return
        closing = ((one[2] - two[2]) * dx + (one[3] - two[3]) * dy) / gap
        if closing <= 0.0:
            return
        n = (dx / gap, dy / gap)
        slip = math.hypot(*self._slips(one, two, n))
        seen = Seen(one, a, slip, closing, other=b, order=self.order, celsius=self.celsius)
        e, mu, cloth = self.ball_e(seen), self.ball_mu(seen), (self._cloth(one, a), self._cloth(two, b))
        step = 0.5 * self.mass * closing / IMPULSE_STEPS
        work, least, returned = 0.0, 0.0, False
        while True:
            before = (one[2] - two[2]) * n[0] + (one[3] - two[3]) * n[1]
            kept = one[:], two[:]
            self._pair(one, two, n, step, mu, cloth)
            after = (one[2] - two[2]) * n[0] + (one[3] - two[3]) * n[1]
            done = 0.5 * (before + after) * step
            if not returned and after <= 0.0:
                part = before / (before - after)
                one[:], two[:] = kept
                self._pair(one, two, n, step * part, mu, cloth)
                work += 0.5 * before * step * part
                least, returned = (1.0 - e**2) * work, True
                continue
            if returned and work + done <= least:
                one[:], two[:] = kept
                self._pair(one, two, n, step * min((work - least) / -done, 1.0), mu, cloth)
                break
            work += done

    def _pair(
        self, one: Ball, two: Ball, n: tuple[float, float], impulse: float, mu: float, cloth: tuple[float, float]
    ) -> None:
        """One step of the normal impulse between two balls, by its middle; `cloth`: its friction under each."""
        middle = one[:], two[:]
        self._pair_from(*middle, (one[:], two[:]), n, 0.5 * impulse, mu, cloth)
        self._pair_from(one, two, middle, n, impulse, mu, cloth)

    def _pair_from(
        self, one: Ball, two: Ball, now: tuple[Ball, Ball], n: tuple[float, float], impulse: float, mu: float,
        cloth: tuple[float, float],
    ) -> None:  # fmt: skip
        """The same by the slips of two states."""
        mass = self.mass
        (p, q), (tx, ty) = now, (n[1], -n[0])
        st, sz = self._slips(p, q, n)
        slip = math.hypot(st, sz)
        size = min(mu * impulse, mass * slip / 7.0) / slip if slip > 1e-12 else 0.0
        fx, fy, fz = -size * st * tx, -size * st * ty, -size * sz
        self._add(one, (-impulse * n[0] + fx, -impulse * n[1] + fy), (fx, fy, fz), (n[0], n[1], 0.0))
        self._add(two, (impulse * n[0] - fx, impulse * n[1] - fy), (-fx, -fy, -fz), (-n[0], -n[1], 0.0))
        self._press(one, p, -fz, cloth[0])
        self._press(two, q, fz, cloth[1])

    def _slips(self, one: Ball, two: Ball, n: tuple[float, float]) -> tuple[float, float]:
        """Velocity of one ball's surface over the other's where they touch, across and up."""
        tx, ty = n[1], -n[0]
        across = (one[2] - two[2]) * tx + (one[3] - two[3]) * ty - self.radius * (one[6] + two[6])
        return across, self.radius * ((one[4] + two[4]) * tx + (one[5] + two[5]) * ty)
