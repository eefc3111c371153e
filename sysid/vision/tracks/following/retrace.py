"""Which ball is which once several were hit at once: followed back from where they are clearly apart.

In: a follower and the pictures since the event. Out: its balls, joined anew to those before. The picture in which a
pack has just flown apart shows least: every ball may be anywhere, and is blurred. Some pictures later balls are apart,
their paths smooth and their motions known. From there they are followed back in time, each sought where its path comes
from, swept as it must be; then they are assigned to the balls before the event by all that was seen of both: a straight
way from the place that a ball left at any moment since, or another impact on the way, and the colours of their faces.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linear_sum_assignment

from sysid.clips.consistency.tempo import MAX_CUE_SPEED
from sysid.vision.tracks.following.follow import JUMP_COST, MISSED_COST, Follower
from sysid.vision.tracks.following.followed_ball import CONFIRMING_DETECTIONS, FollowedBall, TrackPoint
from sysid.vision.tracks.following.prediction import State

if TYPE_CHECKING:
    from sysid.vision.balls.detect import Detection
    from sysid.vision.balls.discs import Expected
    from sysid.vision.camera.projection import Array
    from sysid.vision.frames import Frame

    Find = Callable[[Frame, Sequence[Expected], bool], list[Detection]]

MAX_PICTURES = 16  # that are kept in memory, 100 MB of 1080p: four times as many as confirm a jump


@dataclass(frozen=True)
class _Past:
    """A ball before an event."""

    ball: FollowedBall
    state: State
    colour: Array | None
    kept: int  # of its points, that are certain,
    tail: list[TrackPoint]  # and those after them

    @classmethod
    def of(cls, ball: FollowedBall) -> _Past:
        """A ball as it is now."""
        kept = ball.before_jump[1] if ball.before_jump else len(ball.points)
        return cls(ball, ball.state, ball.colour, kept, ball.points[kept:])

    @property
    def points(self) -> list[TrackPoint]:
        """Its points before the event."""
        return [*self.ball.points[: self.kept], *self.tail]


@dataclass
class Retracer:
    """Joins the tracks of a follower anew after each event in which balls may have been exchanged."""

    follower: Follower
    find: Find  # balls in a frame: those expected, and all others too if the whole picture is to be searched
    _before: list[_Past] = field(default_factory=list)
    _frames: list[Frame] = field(default_factory=list)  # since the event
    _open: bool = False

    def begin(self) -> None:
        """To be called before the follower takes a frame."""
        if not self._open:
            self._before = [_Past.of(ball) for ball in self.follower.balls if ball.confirmed]
            self._frames = []

    def end(self, frame: Frame, period: float) -> None:
        """To be called once the follower has taken a frame; frames are a period [s] apart."""
        self._frames.append(frame)
        if not self._open:
            self._open = self._may_exchange()
        elif self.follower.settled or len(self._frames) == MAX_PICTURES:
            self.finish(period)

    def finish(self, period: float) -> None:
        """Join the tracks anew if there was an event; also to be called after the last frame."""
        if self._open:
            self._open = False
            now = [ball for ball in self.follower.balls if ball.confirmed and not ball.missed]
            self._join(now, self._followed_back(now, period))

    def _may_exchange(self) -> bool:
        """Whether a ball jumped in the last frame, or was hit and missed, and another of its name may have been hit."""
        lost, hit = Counter[str](), Counter[str]()
        for ball in (past.ball for past in self._before):
            lost[ball.name] += (ball.before_jump is not None and ball.streak == 1) or (
                ball.impact is not None and ball.missed == 1
            )
            hit[ball.name] += ball.impact is not None and not ball.missed and ball.before_jump is None
        return any(count and count + hit[name] > 1 for name, count in lost.items())

    def _followed_back(self, now: Sequence[FollowedBall], period: float) -> list[FollowedBall]:
        """The balls that are seen now, followed back to the event in a time that runs backwards."""
        follower = self.follower
        camera = replace(follower.camera, readout=-follower.camera.readout)
        back = Follower(camera, follower.counts, follower.time_sd, [ball.backwards() for ball in now])
        own = list(back.balls)
        for frame in self._frames[-2::-1]:
            expected = back.expected(-frame.time, period)
            back.update(-frame.index, -frame.time, self.find(frame, expected, back.seeking))
        return own

    def _join(self, now: Sequence[FollowedBall], back: Sequence[FollowedBall]) -> None:
        """Assign the balls that were followed back to those before, and join their tracks."""
        costs = np.full((len(self._before), len(now) + len(self._before)), MISSED_COST)
        for i, past in enumerate(self._before):
            costs[i, : len(now)] = [min(_cost(past, ball), MISSED_COST) for ball in back]
        pairs = [(i, j) for i, j in zip(*linear_sum_assignment(costs), strict=True) if costs[i, j] < MISSED_COST]
        points = {j: self._before[i].points for i, j in pairs}
        left = {i: past.points for i, past in enumerate(self._before) if i not in dict(pairs)}
        for j, (ball, followed) in enumerate(zip(now, back, strict=True)):
            ball.points = points.get(j, []) + followed.forwards()
            ball.colour, ball.looks = followed.colour, followed.looks
            ball.before_jump, ball.streak = None, CONFIRMING_DETECTIONS
        seen = {id(ball) for ball in now}
        self.follower.balls = [
            ball for ball in self.follower.balls
            if id(ball) in seen or all(ball is not past.ball for past in self._before)
        ]  # fmt: skip
        for i, points_before in left.items():
            past = self._before[i]
            missed = max(past.ball.missed, len(self._frames))
            gone = replace(past.ball, state=past.state, colour=past.colour, points=points_before, missed=missed)
            self.follower.balls.append(replace(gone, before_jump=None, streak=CONFIRMING_DETECTIONS))


def _cost(past: _Past, ball: FollowedBall) -> float:
    """Negative log likelihood of a ball that was followed back, as that of a ball before."""
    if past.ball.name != ball.name:
        return math.inf
    was, now = past.state, ball.state.backwards
    elapsed, variance = now.time - was.time, was.pp + now.pp
    dx, dy = now.x - was.x, now.y - was.y
    # It may have left at any moment since, on the path that it is on.
    ago = min(max((dx * now.u + dy * now.v) / max(now.speed**2, 1e-12), 0.0), elapsed)
    total = variance + ago * ago * now.vv
    straight = ((dx - ago * now.u) ** 2 + (dy - ago * now.v) ** 2) / (2 * total) + math.log(total / variance)
    farthest = MAX_CUE_SPEED * elapsed
    jump = JUMP_COST + math.log(farthest**2 / variance) if math.hypot(dx, dy) < farthest else math.inf
    return min(straight, jump) + ball.colour_cost(past.colour)
