"""From what is seen in single frames to the paths of balls: which sighting is which ball.

Every ball is predicted at constant velocity on the table, and through the impacts that this leads to (balls of equal
mass without friction, cushions). A sighting is explained as smooth motion, as an impact foreseen, or as a jump: an
impact or a strike that was not foreseen, anywhere that the ball can have come at the speeds about. Explanations are
weighed by their negative log likelihoods, those of balls of one name together (Hungarian assignment).

A jump is believed once more sightings bear it out; until then the motion before it is kept in mind, and gone back to
where that explains what is seen. A new ball is believed on the same terms, and is the lost ball of its name if there
is one. Nothing is put where a ball was not seen.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from models.shot import NOSE_COSINE
from sysid.vision.camera.projection import Array, Camera

if TYPE_CHECKING:
    from sysid.vision.balls.detect import Detection

PUSH = 3.0  # acceleration that the cloth may give [m/s^2]
LEVEL = 0.2  # least standard deviation of a sighting, beside its own [pixels]
STRIKE = 10.0  # speed of the fastest strikes [m/s]
LATE = 0.1  # a jump that was missed for longer than this is a new ball, until it is known which [s]
COAST = 0.25  # a prediction older than this is none [s]
BEND = 0.4  # uncertainty of the velocity after an impact, in the speed of the impact
RESTITUTION = {"ball": 0.95, "cushion": 0.8}  # for predictions
IMPACTS = 6  # between two frames
JUMP, SUDDEN, ODD = 6.0, 9.0, 12.0  # cost of an impact not foreseen, of a strike, and of one of a moving ball
MISS, DOUBT = 30.0, 20.0  # cost of a ball not seen, and of one not sure to be a ball
FAR = 12.0  # cost of a place alone from which on it is not what was predicted: five standard deviations
NEAR = 5.0  # cost of a ball found again where it lay
SURE = 4  # sightings that make a ball
SLIPS = 2  # frames without one that unmake it before
LEAST = 10  # sightings of a ball worth telling
DARING = ("jump", "again")  # explanations that want to be borne out
APART = 1.2  # radii between two sightings of two balls
BUNCH = 4000  # sightings that are brought to the table at a time


Place = tuple[float, float, float, float]  # time [s], x, y [m] and variance [m^2] of a sighting
Places = dict[int, Place]  # by number among those seen


class State(NamedTuple):
    """A ball's place [m] and velocity [m/s] at a time [s], with their variances, the same along both axes."""

    time: float
    x: float
    y: float
    u: float
    v: float
    pp: float  # of the place
    pv: float  # of place and velocity
    vv: float  # of the velocity

    @property
    def speed(self) -> float:
        """Speed [m/s]."""
        return math.hypot(self.u, self.v)

    def at(self, time: float) -> State:
        """The state later, if nothing is met."""
        dt = time - self.time
        push = (PUSH * dt) ** 2
        pp = self.pp + 2 * dt * self.pv + dt * dt * (self.vv + push / 4)
        pv = self.pv + dt * (self.vv + push / 2)
        return State(time, self.x + self.u * dt, self.y + self.v * dt, self.u, self.v, pp, pv, self.vv + push)

    def seen(self, x: float, y: float, variance: float) -> State:
        """The state after a sighting (Kalman)."""
        gain, turn = self.pp / (self.pp + variance), self.pv / (self.pp + variance)
        dx, dy = x - self.x, y - self.y
        return State(
            self.time, self.x + gain * dx, self.y + gain * dy, self.u + turn * dx, self.v + turn * dy,
            (1 - gain) * self.pp, (1 - gain) * self.pv, self.vv - turn * self.pv,
        )  # fmt: skip

    def cost(self, x: float, y: float, variance: float) -> float:
        """Negative log likelihood of a sighting, above that of one that is exactly known."""
        wide = self.pp + variance
        off = ((x - self.x) ** 2 + (y - self.y) ** 2) / (2 * wide)
        return off + math.log(wide / variance) if off < FAR else math.inf


def ahead(states: Sequence[State], until: float, reach: Array, diameter: float) -> list[State | None]:
    """States at a time [s] of those balls that meet something before; None for the others.

    `states` are of all balls at one time; their centres reach to |x|, |y| = reach (2,) [m].
    """
    n, left = len(states), until - (states[0].time if states else 0.0)
    at = [[s.x, s.y] for s in states]
    go = [[s.u, s.v] if s.speed > 0.02 else [0.0, 0.0] for s in states]
    hard, since = [0.0] * n, [0.0] * n  # speed of a ball's hardest impact, and the time left at its first
    for _ in range(IMPACTS):
        when, what = _next_impact(at, go, left, reach, diameter)
        for place, velocity in zip(at, go, strict=True):
            place[0] += velocity[0] * when
            place[1] += velocity[1] * when
        left -= when
        if what is None:
            break
        i, j, axis = what
        if j < 0:
            speed = abs(go[i][axis])
            go[i][axis] *= -RESTITUTION["cushion"]
        else:
            nx, ny = at[j][0] - at[i][0], at[j][1] - at[i][1]
            size, u, v = math.hypot(nx, ny), go[i][0] - go[j][0], go[i][1] - go[j][1]
            nx, ny, speed = nx / size, ny / size, math.hypot(u, v)
            push = 0.5 * (1 + RESTITUTION["ball"]) * (u * nx + v * ny)
            go[i] = [go[i][0] - push * nx, go[i][1] - push * ny]
            go[j] = [go[j][0] + push * nx, go[j][1] + push * ny]
        for k in (i, j):
            if k >= 0:
                since[k], hard[k] = max(since[k], left), max(hard[k], speed)
    found: list[State | None] = [None] * n
    for k, state in enumerate(states):
        if hard[k]:
            later, bend = state.at(until), BEND * hard[k]
            pp = later.pp + (bend * (since[k] + 0.1 * (until - state.time))) ** 2
            (x, y), (u, v) = at[k], go[k]
            found[k] = State(until, x, y, u, v, pp, 0.0, later.vv + bend**2)
    return found


def _next_impact(
    at: list[list[float]], go: list[list[float]], limit: float, reach: Array, diameter: float
) -> tuple[float, tuple[int, int, int] | None]:
    """Time to the next impact within a limit [s], and of which balls, or of one ball (and -1) along which axis."""
    when, what = limit, None
    for i, (place, velocity) in enumerate(zip(at, go, strict=True)):
        moving = velocity[0] != 0.0 or velocity[1] != 0.0
        for axis in (0, 1) if moving else ():
            if velocity[axis]:
                gap = float(reach[axis]) - math.copysign(place[axis], place[axis] * velocity[axis])
                time = max(gap, 0.0) / abs(velocity[axis])
                if time < when:
                    when, what = time, (i, -1, axis)
        for j in range(i + 1, len(at)):
            u, v = go[j][0] - velocity[0], go[j][1] - velocity[1]
            speed = u * u + v * v
            if speed == 0.0:
                continue
            x, y = at[j][0] - place[0], at[j][1] - place[1]
            closing = x * u + y * v
            gap = x * x + y * y - diameter * diameter
            inside = closing * closing - speed * gap
            if closing < 0 and inside > 0:
                time = max((-closing - math.sqrt(inside)) / speed, 0.0)
                if time < when:
                    when, what = time, (i, j, 0)
    return when, what


class Row(NamedTuple):
    """One sighting of a ball."""

    frame: int
    time: float  # when its row of the picture was exposed [s]
    u: float  # [pixels]
    v: float
    sd: float
    radius: float
    change: float


def _row(frame: int, time: float, seen: Detection) -> Row:
    return Row(frame, time, float(seen.xy[0]), float(seen.xy[1]), float(seen.sd), float(seen.radius), seen.change)


@dataclass
class _Ball:
    """A ball as it is followed."""

    name: str
    state: State
    rows: list[Row]
    sure: bool = False
    fresh: int = 1  # sightings since it appeared or jumped
    missed: int = 0  # frames since it was seen
    before: tuple[State, int] | None = None  # a jump that is not sure: the state before it, and rows until then
    smooth: State | None = None  # predictions for the frame at hand
    impact: State | None = None

    def undo(self) -> None:
        """Go back to what was before the last jump."""
        if self.before is not None:
            self.state, kept = self.before
            del self.rows[kept:]
            self.before, self.fresh = None, SURE


@dataclass(frozen=True)
class Path:
    """Where one ball was seen over the footage."""

    name: str
    frame: NDArray[np.int64]  # (n,) index of the frame, increasing
    time: Array  # (n,) when the ball's row of the picture was exposed [s]
    pixels: Array  # (n, 2) centre of its outline
    xy: Array  # (n, 2) [m], table frame
    sd: Array  # (n,) of a sighting, as the detector has it [pixels]
    radius: Array  # (n,) of its outline [pixels]
    change: Array  # (n,) of its face since the frame before, 1 for noise alone; NaN where not known


@dataclass
class Follower:
    """Follows balls from frame to frame."""

    camera: Camera
    counts: Mapping[str, int] = field(default_factory=dict)  # of balls of a name there can be, where that is known
    balls: list[_Ball] = field(default_factory=list)
    _forecast: float = math.nan  # the time that the balls' predictions are for

    def expected(self, time: float) -> list[tuple[str, Array]]:
        """What the detector calls each ball, and where its outline's centre should be at a time: (2,) [pixels]."""
        self._predict(time)
        near = [(ball.name, ball.impact or ball.smooth) for ball in self.balls]
        points = [(name, (s.x, s.y, self.camera.radius)) for name, s in near if s is not None]
        pixels = self.camera.project(np.array([place for _, place in points]))
        return [(name, px) for (name, _), px in zip(points, pixels, strict=True)]

    @property
    def seeking(self) -> bool:
        """Whether a ball that should have been seen in the last frames was not."""
        return any(ball.sure and 0 < ball.missed <= SLIPS + 1 for ball in self.balls)

    @property
    def in_sight(self) -> int:
        """How many balls the last frame showed."""
        return sum(ball.sure and not ball.missed for ball in self.balls)

    def take(self, index: int, time: float, seen: Sequence[Detection]) -> None:
        """Give what was seen in a frame to the balls."""
        if self._forecast != time:
            self._predict(time)
        places = self._places(seen)
        found: dict[int, _Ball] = {}
        for name in dict.fromkeys(seen[k].name for k in places):
            mine = {k: place for k, place in places.items() if seen[k].name == name}
            found |= self._share([b for b in self.balls if b.name == name], mine)
        for k, ball in found.items():
            ball.rows.append(_row(index, places[k][0], seen[k]))
        self._miss({id(ball) for ball in found.values()})
        self._join([ball for ball in found.values() if not ball.sure and len(ball.rows) >= SURE])
        self._appear(index, seen, places, found)

    def paths(self) -> tuple[Path, ...]:
        """All balls that were surely there, several of a name numbered from left to right as first seen."""
        for ball in self.balls:
            ball.undo()
        balls = [b for b in self.balls if b.sure and len(b.rows) >= LEAST]
        first = min((b.rows[0].frame for b in balls), default=0) + SURE

        def order(ball: _Ball) -> tuple[int, float]:
            begun = ball.rows[0]
            return (begun.frame if begun.frame > first else first), begun.u

        named = []
        for name in dict.fromkeys(ball.name for ball in balls):
            mine = sorted((ball for ball in balls if ball.name == name), key=order)
            named += [(name if len(mine) == 1 else f"{name}_{k}", ball) for k, ball in enumerate(mine, 1)]
        return tuple(self._path(name, ball.rows) for name, ball in named)

    def _path(self, name: str, rows: Sequence[Row]) -> Path:
        frame, time, u, v, sd, radius, change = np.array(rows).T
        px = np.column_stack([u, v])
        xy = [self.camera.centres(px[k : k + BUNCH]) for k in range(0, len(px), BUNCH)]
        return Path(name, frame.astype(np.int64), time, px, np.concatenate(xy), sd, radius, change)

    def _late(self, row: float) -> float:
        """When a row of the picture is exposed, after the middle one [s]."""
        return self.camera.readout * (row / max(self.camera.size[1] - 1, 1) - 0.5)

    def _places(self, seen: Sequence[Detection]) -> Places:
        """The sightings that lie on the table."""
        if not seen:
            return {}
        table, radius = self.camera.table, self.camera.radius
        places = self.camera.on_plane(np.array([one.xy for one in seen]), radius)
        out = {}
        for k, (one, (x, y)) in enumerate(zip(seen, places.tolist(), strict=True)):
            if abs(x) < table.length / 2 + 1.5 * radius and abs(y) < table.width / 2 + 1.5 * radius:
                scale = radius / max(float(one.radius), 1.0)
                variance = scale**2 * (LEVEL**2 + float(one.sd) ** 2)
                out[k] = (self._forecast + self._late(float(one.xy[1])), x, y, variance)
        return out

    def _predict(self, time: float) -> None:
        """Where every ball should be at a time."""
        near = []
        for ball in self.balls:
            ball.impact = ball.smooth = None
            if time - ball.state.time <= COAST:
                ball.smooth = ball.state.at(time + self._late(ball.rows[-1].v))
                near.append(ball)
        self._forecast = time
        since = max((b.state.time for b in near), default=time)
        until = max((b.smooth.time for b in near if b.smooth), default=time)
        reach = np.array([self.camera.table.length, self.camera.table.width]) / 2 - self.camera.radius * NOSE_COSINE
        met = ahead([b.state.at(since) for b in near], until, reach, self.camera.diameter)
        for ball, state in zip(near, met, strict=True):
            ball.impact = state

    def _share(self, balls: Sequence[_Ball], places: dict[int, tuple[float, float, float, float]]) -> dict[int, _Ball]:
        """Give sightings of one name to the balls of that name; their states follow."""
        keys = list(places)
        fastest = max((b.state.speed + math.sqrt(b.state.vv) for b in self.balls if b.smooth and b.sure), default=0.0)
        options = [[_explained(ball, places[k], fastest, self.camera.radius) for k in keys] for ball in balls]
        costs = np.empty((len(balls), len(keys) + len(balls)))
        for i, row in enumerate(options):
            costs[i] = MISS if balls[i].sure else DOUBT
            costs[i, : len(keys)] = [min(cost, MISS) for cost, _, _ in row]
        found = {}
        for i, j in zip(*linear_sum_assignment(costs), strict=True) if len(balls) else ():
            if j >= len(keys) or costs[i, j] >= costs[i, -1]:
                continue
            ball, (_, how, prior) = balls[i], options[i][j]
            _, x, y, variance = places[keys[j]]
            if how == "before":
                ball.undo()
            elif how in DARING and ball.before is None:
                ball.before = (ball.state, len(ball.rows))
            ball.fresh = 1 if how in DARING else ball.fresh + 1
            ball.before = ball.before if ball.fresh < SURE else None
            ball.state = prior.seen(x, y, variance)
            found[keys[j]] = ball
        return found

    def _miss(self, taken: Iterable[int]) -> None:
        """Count the balls not seen; what was not sure of them is taken back."""
        for ball in self.balls:
            ball.missed = 0 if id(ball) in taken else ball.missed + 1
            if ball.missed >= SLIPS:
                ball.undo()
        self.balls = [ball for ball in self.balls if ball.sure or ball.missed < SLIPS]

    def _join(self, risen: Sequence[_Ball]) -> None:
        """Balls that have become sure: each is the nearest of its name that was lost before, or a new one."""
        for ball in risen:
            # The first sighting of the new one may be false, and older than the last of the lost one.
            place, first = ball.state, ball.rows[1].frame
            mine = [b for b in self.balls if b.sure and b.name == ball.name]
            lost = [b for b in mine if b.missed and b.rows[-1].frame < first]
            if lost:
                old = min(lost, key=lambda b: math.hypot(b.state.x - place.x, b.state.y - place.y))
                old.rows += [row for row in ball.rows if row.frame > old.rows[-1].frame]
                old.state, old.missed, old.fresh, old.before = ball.state, 0, SURE, None
                self.balls.remove(ball)
            else:
                ball.sure = len(mine) < self.counts.get(ball.name, len(mine) + 1)

    def _appear(self, index: int, seen: Sequence[Detection], places: Places, found: dict[int, _Ball]) -> None:
        """Begin a ball with every sighting left, unless it lies in one that was seen, or should have been."""
        there = [places[k][1:3] for k in found] + [(b.smooth.x, b.smooth.y) for b in self.balls if b.smooth and b.sure]
        for k in sorted(places.keys() - found.keys(), key=lambda k: -float(seen[k].score)):
            time, x, y, variance = places[k]
            if all(math.hypot(x - a, y - b) > APART * self.camera.radius for a, b in there):
                state = State(time, x, y, 0.0, 0.0, variance, 0.0, (STRIKE / 3) ** 2)
                self.balls.append(_Ball(seen[k].name, state, [_row(index, time, seen[k])]))
                there.append((x, y))


def _explained(ball: _Ball, place: Place, fastest: float, radius: float) -> tuple[float, str, State]:
    """The best explanation of a sighting as a ball: its cost, what it is, and the state that it expects."""
    time, x, y, variance = place
    old = ball.state
    dt = time - old.time
    way = math.hypot(x - old.x, y - old.y)
    best = (math.inf, "", old)
    resting = old.speed < 0.05 + 3 * math.sqrt(old.vv)
    if ball.smooth is None:  # lost for long: only where it lay
        if resting and way < radius / 2:
            return (NEAR, "again", State(time, old.x, old.y, 0.0, 0.0, radius**2, 0.0, 1.0))
        return best
    before = ball.before[0].at(time) if ball.before and time - ball.before[0].time <= COAST else None
    for how, state in (("smooth", ball.smooth), ("impact", ball.impact), ("before", before)):
        if state is not None and way < STRIKE * dt + radius and (cost := state.cost(x, y, variance)) < best[0]:
            best = (cost, "again" if how != "before" and dt > LATE else how, state)
    if not (0 < dt < LATE and ball.sure):
        return best
    for speed, price in ((fastest, JUMP), (STRIKE, SUDDEN if resting else ODD)):
        reach = 1.15 * speed * dt + 0.1 * radius
        cost = price + math.log(max(reach**2 / variance, 1.0))
        if way < reach and cost < best[0]:
            swift = max(3 * way / dt, fastest)  # it may have begun late in the time between
            best = (cost, "jump", State(time, x, y, (x - old.x) / dt, (y - old.y) / dt, variance, 0.0, swift**2))
    return best
