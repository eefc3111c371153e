"""From detections in single frames to the tracks of balls: which detection is which ball.

In: the detections of every frame. Out: `BallTrack` of every ball. A detection is explained by one of these hypotheses:
smooth motion; a predicted impact (prediction.py); or a jump, which is an impact or a strike that was not predicted,
anywhere that the ball can have come at the speeds present. Hypotheses are weighed by their negative log likelihoods,
those of balls of one name together (Hungarian assignment).

A jump is confirmed by further detections; until then the state before it is stored, and restored if that explains them
better. A new ball is confirmed in the same manner, and continues the track of a lost ball of its name if there is one.
Where several balls were hit at once, retrace.py joins their tracks anew. No position is made up where a ball was not
detected.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from models.shot import NOSE_COSINE
from sysid.clips.consistency.tempo import MAX_CUE_SPEED
from sysid.vision.balls.detect import Detection
from sysid.vision.balls.discs import Expected
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.tracks.following.followed_ball import CONFIRMING_DETECTIONS, FollowedBall, TrackPoint, track_point
from sysid.vision.tracks.following.prediction import MIN_MOVING_SPEED_M_S, State, predict_impacts

MIN_DETECTION_SD_PX = 0.2  # added to the standard deviation that the detector estimates
MAX_JUMP_GAP_S = 0.1  # a jump that was unseen for longer starts a new track, until it is known which ball it is
MAX_PREDICTION_S = 0.25  # older states are not extrapolated
JUMP_COST = 6.0  # of an impact that was not predicted,
STRIKE_COST = 9.0  # of a strike of a ball at rest, and
MOVING_STRIKE_COST = 12.0  # of a strike of a moving ball [negative log likelihood]
MISSED_COST = 30.0  # of a confirmed ball without a detection
UNCONFIRMED_COST = 20.0  # of an unconfirmed ball without a detection
REAPPEARANCE_COST = 5.0  # of a lost ball detected where it was at rest
MAX_MISSED_FRAMES = 2  # in a row, after which it is undone if unconfirmed
MIN_TRACK_DETECTIONS = 10  # of a track that is returned
UNCONFIRMED_HYPOTHESES = ("jump", "again")  # that need further detections
MIN_SEPARATION_RADII = 1.2  # between the detections of two balls
CONVERSION_BATCH = 4000  # detections projected to the table at a time

Position = tuple[float, float, float, float]  # time [s], x, y [m] and variance [m^2] of a detection
Positions = dict[int, Position]  # by index of the detection


@dataclass(frozen=True)
class BallTrack:
    """The track of one ball: its detections over the footage."""

    name: str
    frame: NDArray[np.int64]  # (n,) index of the frame, increasing
    time: Array  # (n,) when the row of the picture that shows the ball was exposed [s]
    pixels: Array  # (n, 2) centre of its outline [pixels]
    xy: Array  # (n, 2) [m], table frame
    sd: Array  # (n,) of a detection, estimated by the detector [pixels]
    radius: Array  # (n,) of its outline [pixels]
    face_change: Array  # (n,) of its face since the previous frame, 1 for noise alone; NaN where unknown

    def without(self, dropped: NDArray[np.bool_]) -> BallTrack:
        """The track without some of its detections (n,)."""
        keep = ~dropped
        return replace(
            self, frame=self.frame[keep], time=self.time[keep], pixels=self.pixels[keep], xy=self.xy[keep],
            sd=self.sd[keep], radius=self.radius[keep], face_change=self.face_change[keep],
        )  # fmt: skip


@dataclass
class Follower:
    """Associates detections with tracks, frame by frame."""

    camera: Camera
    counts: Mapping[str, int] = field(default_factory=dict)  # greatest number of balls of a name, where it is known
    time_sd: float = 0.0  # of the times of frames [s]
    balls: list[FollowedBall] = field(default_factory=list)
    _forecast: float = math.nan  # time of the current predictions [s]

    def expected(self, time: float, period: float) -> list[Expected]:
        """The balls that are followed, where they are expected at a time [s], frames being a period [s] apart."""
        self._predict(time)
        states = [(ball, state) for ball in self.balls if (state := ball.impact or ball.smooth) is not None]
        if not states:
            return []
        radius = self.camera.radius
        # A ball that is hit as it rests comes from there, however fast it is then.
        before = [
            (ball.state.x, ball.state.y)
            if ball.impact and ball.state.speed < MIN_MOVING_SPEED_M_S
            else (s.x - s.u * period, s.y - s.v * period)
            for ball, s in states
        ]
        pixels = self.camera.project(np.array([(*at, radius) for at in [*((s.x, s.y) for _, s in states), *before]]))
        steps = pixels[: len(states)] - pixels[len(states) :]
        farthest = MAX_CUE_SPEED * period / radius  # [radii]
        return [
            Expected(
                ball.name, at, step, ball.colour, (1 + ball.missed) * farthest * ball.points[-1].radius, not ball.impact
            )
            for (ball, _), at, step in zip(states, pixels, steps, strict=False)
        ]

    @property
    def seeking(self) -> bool:
        """Whether a confirmed ball was missed in the last frames."""
        return any(ball.confirmed and 0 < ball.missed <= MAX_MISSED_FRAMES + 1 for ball in self.balls)

    @property
    def settled(self) -> bool:
        """Whether no ball was missed in the last frames, and none has yet to be confirmed where it is."""
        return not self.seeking and all(ball.confirmed and ball.before_jump is None for ball in self.balls)

    @property
    def in_sight(self) -> int:
        """Number of confirmed balls detected in the last frame."""
        return sum(ball.confirmed and not ball.missed for ball in self.balls)

    def update(self, index: int, time: float, seen: Sequence[Detection]) -> None:
        """Associate the detections of a frame with the tracks."""
        if self._forecast != time:
            self._predict(time)
        positions = self._positions(seen)
        found: dict[int, FollowedBall] = {}
        for name in dict.fromkeys(seen[k].name for k in positions):
            same_name = {k: place for k, place in positions.items() if seen[k].name == name}
            found |= self._associate([b for b in self.balls if b.name == name], same_name, seen)
        for k, ball in found.items():
            ball.points.append(track_point(index, positions[k][0], seen[k]))
            ball.look(seen[k])
        self._count_missed({id(ball) for ball in found.values()})
        new = [ball for ball in found.values() if not ball.confirmed]
        self._confirm([ball for ball in new if len(ball.points) >= CONFIRMING_DETECTIONS])
        self._start_tracks(index, seen, positions, found)

    def tracks(self) -> tuple[BallTrack, ...]:
        """The confirmed tracks; several of one name are numbered from left to right as first seen."""
        for ball in self.balls:
            ball.undo()
        balls = [b for b in self.balls if b.confirmed and len(b.points) >= MIN_TRACK_DETECTIONS]
        first = min((b.points[0].frame for b in balls), default=0) + CONFIRMING_DETECTIONS

        def order(ball: FollowedBall) -> tuple[int, float]:
            begun = ball.points[0]
            return (begun.frame if begun.frame > first else first), begun.u

        named_balls = []
        for name in dict.fromkeys(ball.name for ball in balls):
            same_name = sorted((ball for ball in balls if ball.name == name), key=order)
            single = len(same_name) == 1
            named_balls += [(name if single else f"{name}_{k}", ball) for k, ball in enumerate(same_name, 1)]
        return tuple(self._track(name, ball.points) for name, ball in named_balls)

    def _track(self, name: str, points: Sequence[TrackPoint]) -> BallTrack:
        frame, time, u, v, sd, radius, face_change = np.array(points).T
        px = np.column_stack([u, v])
        xy = [self.camera.centres(px[k : k + CONVERSION_BATCH]) for k in range(0, len(px), CONVERSION_BATCH)]
        return BallTrack(name, frame.astype(np.int64), time, px, np.concatenate(xy), sd, radius, face_change)

    def _row_delay(self, row: float) -> float:
        """Time of exposure of a row of the picture after that of the middle row [s]."""
        return float(self.camera.row_delay(row))

    def _positions(self, seen: Sequence[Detection]) -> Positions:
        """Positions of the detections that lie on the table."""
        if not seen:
            return {}
        table, radius = self.camera.table, self.camera.radius
        positions = self.camera.on_plane(np.array([one.xy for one in seen]), radius)
        kept = {}
        for k, (one, (x, y)) in enumerate(zip(seen, positions.tolist(), strict=True)):
            if abs(x) < table.length / 2 + 1.5 * radius and abs(y) < table.width / 2 + 1.5 * radius:
                scale = radius / max(float(one.radius), 1.0)
                variance = scale**2 * (MIN_DETECTION_SD_PX**2 + float(one.sd) ** 2)
                kept[k] = (self._forecast + self._row_delay(float(one.xy[1])), x, y, variance)
        return kept

    def _predict(self, time: float) -> None:
        """Predict all balls at a time [s]."""
        recent = []
        for ball in self.balls:
            ball.impact = ball.smooth = None
            if time - ball.state.time <= MAX_PREDICTION_S:
                ball.smooth = ball.state.predicted(time + self._row_delay(ball.points[-1].v), self.time_sd)
                recent.append(ball)
        self._forecast = time
        since = max((b.state.time for b in recent), default=time)
        until = max((b.smooth.time for b in recent if b.smooth), default=time)
        limits = np.array([self.camera.table.length, self.camera.table.width]) / 2 - self.camera.radius * NOSE_COSINE
        after_impact = predict_impacts([b.state.predicted(since) for b in recent], until, limits, self.camera.diameter)
        for ball, state in zip(recent, after_impact, strict=True):
            ball.impact = state

    def _associate(
        self, balls: Sequence[FollowedBall], positions: Positions, seen: Sequence[Detection]
    ) -> dict[int, FollowedBall]:  # fmt: skip
        """Assign detections to the balls of one name at the least total cost, and update their states."""
        keys = list(positions)
        known = [b.state for b in self.balls if b.smooth and b.confirmed]
        fastest = max((state.speed + math.sqrt(state.vv) for state in known), default=0.0)
        radius = self.camera.radius
        options = [[_cheapest_hypothesis(ball, positions[k], fastest, radius) for k in keys] for ball in balls]
        costs = np.empty((len(balls), len(keys) + len(balls)))
        for i, hypotheses in enumerate(options):
            costs[i] = MISSED_COST if balls[i].confirmed else UNCONFIRMED_COST
            costs[i, : len(keys)] = [
                min(cost + balls[i].colour_cost(seen[k].colour), MISSED_COST)
                for k, (cost, _, _) in zip(keys, hypotheses, strict=True)
            ]
        found = {}
        for i, j in zip(*linear_sum_assignment(costs), strict=True) if len(balls) else ():
            if j >= len(keys) or costs[i, j] >= costs[i, -1]:
                continue
            ball, (_, kind, prior) = balls[i], options[i][j]
            _, x, y, variance = positions[keys[j]]
            if kind == "before":
                ball.undo()
            elif kind in UNCONFIRMED_HYPOTHESES and ball.before_jump is None:
                ball.before_jump = (ball.state, len(ball.points))
            ball.streak = 1 if kind in UNCONFIRMED_HYPOTHESES else ball.streak + 1
            ball.before_jump = ball.before_jump if ball.streak < CONFIRMING_DETECTIONS else None
            ball.state = prior.updated(x, y, variance)
            found[keys[j]] = ball
        return found

    def _count_missed(self, taken: Iterable[int]) -> None:
        """Count missed frames; unconfirmed jumps of missed balls are undone, unconfirmed balls dropped."""
        for ball in self.balls:
            ball.missed = 0 if id(ball) in taken else ball.missed + 1
            if ball.missed >= MAX_MISSED_FRAMES:
                ball.undo()
        self.balls = [ball for ball in self.balls if ball.confirmed or ball.missed < MAX_MISSED_FRAMES]

    def _confirm(self, ready: Sequence[FollowedBall]) -> None:
        """Confirm balls: each continues the track of the nearest lost ball of its name, or is a new one."""
        for ball in ready:
            # The first detection of the new one may be false, and older than the last of the lost one.
            place, first = ball.state, ball.points[1].frame
            same_name = [b for b in self.balls if b.confirmed and b.name == ball.name]
            lost = [b for b in same_name if b.missed and b.points[-1].frame < first]
            lost = [b for b in lost if b.colour_cost(ball.colour) < JUMP_COST]
            if lost:
                old = min(lost, key=lambda b: math.hypot(b.state.x - place.x, b.state.y - place.y))
                old.points += [point for point in ball.points if point.frame > old.points[-1].frame]
                old.state, old.missed, old.streak, old.before_jump = ball.state, 0, CONFIRMING_DETECTIONS, None
                self.balls.remove(ball)
            else:
                ball.confirmed = len(same_name) < self.counts.get(ball.name, len(same_name) + 1)

    def _start_tracks(
        self, index: int, seen: Sequence[Detection], positions: Positions, found: dict[int, FollowedBall]
    ) -> None:
        """Start a track with every detection left, unless it overlaps a ball detected or predicted there."""
        there = [positions[k][1:3] for k in found]
        there += [(b.smooth.x, b.smooth.y) for b in self.balls if b.smooth and b.confirmed]
        for k in sorted(positions.keys() - found.keys(), key=lambda k: -float(seen[k].score)):
            time, x, y, variance = positions[k]
            if all(math.hypot(x - a, y - b) > MIN_SEPARATION_RADII * self.camera.radius for a, b in there):
                state = State(time, x, y, 0.0, 0.0, variance, 0.0, (MAX_CUE_SPEED / 3) ** 2)
                self.balls.append(
                    FollowedBall(seen[k].name, state, [track_point(index, time, seen[k])], colour=seen[k].colour)
                )
                there.append((x, y))


def _cheapest_hypothesis(
    ball: FollowedBall, position: Position, fastest: float, radius: float
) -> tuple[float, str, State]:
    """The cheapest hypothesis of a detection as this ball: its cost, its kind, and the predicted state."""
    time, x, y, variance = position
    old = ball.state
    dt = time - old.time
    distance = math.hypot(x - old.x, y - old.y)
    best = (math.inf, "", old)
    resting = old.speed < 0.05 + 3 * math.sqrt(old.vv)
    if ball.smooth is None:  # lost for long: accepted only where it was at rest
        if resting and distance < radius / 2:
            return (REAPPEARANCE_COST, "again", State(time, old.x, old.y, 0.0, 0.0, radius**2, 0.0, 1.0))
        return best
    before_jump = None
    if ball.before_jump and time - ball.before_jump[0].time <= MAX_PREDICTION_S:
        before_jump = ball.before_jump[0].predicted(time)
    near = distance < MAX_CUE_SPEED * dt + radius
    for kind, state in (("smooth", ball.smooth), ("impact", ball.impact), ("before", before_jump)):
        if state is not None and near and (cost := state.cost(x, y, variance)) < best[0]:
            best = (cost, "again" if kind != "before" and dt > MAX_JUMP_GAP_S else kind, state)
    if not (0 < dt < MAX_JUMP_GAP_S and ball.confirmed):
        return best
    strike = STRIKE_COST if resting else MOVING_STRIKE_COST
    for speed, base_cost in ((fastest, JUMP_COST), (MAX_CUE_SPEED, strike)):
        max_distance = 1.15 * speed * dt + 0.1 * radius
        cost = base_cost + math.log(max(max_distance**2 / variance, 1.0))
        if distance < max_distance and cost < best[0]:
            velocity_sd = max(3 * distance / dt, fastest)  # the impact may have been late in the interval
            best = (cost, "jump", State(time, x, y, (x - old.x) / dt, (y - old.y) / dt, variance, 0.0, velocity_sd**2))
    return best
