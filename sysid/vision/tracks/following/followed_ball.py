"""One ball that is being followed: its detections so far, its state, and a jump that is not confirmed yet.

In: detections that are taken to be this ball. Out: `TrackPoint`s, in order of time. Which detection is which ball:
follow.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from sysid.vision.balls.detect import Detection
from sysid.vision.balls.discs import face_cost
from sysid.vision.camera.projection import Array
from sysid.vision.tracks.following.prediction import State

CONFIRMING_DETECTIONS = 4  # that make a ball, or a jump
COLOUR_MEMORY = 0.1  # part of a detection in the mean colour


class TrackPoint(NamedTuple):
    """One detection of a ball in its track."""

    frame: int
    time: float  # when its row of the picture was exposed [s]
    u: float  # [pixels]
    v: float
    sd: float
    radius: float
    face_change: float

    @property
    def backwards(self) -> TrackPoint:
        """The same in a time that runs backwards."""
        return self._replace(frame=-self.frame, time=-self.time)


def track_point(frame: int, time: float, seen: Detection) -> TrackPoint:
    return TrackPoint(
        frame, time, float(seen.xy[0]), float(seen.xy[1]), float(seen.sd), float(seen.radius), seen.face_change
    )


@dataclass
class FollowedBall:
    """A track in the making."""

    name: str
    state: State
    points: list[TrackPoint]
    confirmed: bool = False
    streak: int = 1  # detections since it appeared or jumped
    missed: int = 0  # frames since it was seen
    before_jump: tuple[State, int] | None = None  # of an unconfirmed jump: state and number of points before it
    smooth: State | None = None  # predicted for the current frame without impacts
    impact: State | None = None  # and through impacts
    colour: Array | None = None  # (3,) of its face, mean over the last detections
    looks: int = 1  # detections in it
    last_colour: Array | None = None  # (3,) of its last detection

    def look(self, seen: Detection) -> None:
        """Take the colour of a detection into the mean."""
        self.last_colour = seen.colour
        if self.colour is None or seen.colour is None:
            self.colour = seen.colour if self.colour is None else self.colour
        else:
            self.looks += 1
            part = max(COLOUR_MEMORY, 1 / self.looks)
            self.colour = part * seen.colour + (1 - part) * self.colour

    def colour_cost(self, seen: Array | None) -> float:
        """Negative log likelihood of a colour (3,) as this ball's, which turns as it rolls; 0 where it is not known."""
        if self.colour is None or seen is None:
            return 0.0
        return face_cost(seen, self.colour)

    def undo(self) -> None:
        """Return to the state before an unconfirmed jump."""
        if self.before_jump is not None:
            self.state, kept = self.before_jump
            del self.points[kept:]
            self.before_jump, self.streak = None, CONFIRMING_DETECTIONS

    def backwards(self) -> FollowedBall:
        """A ball just seen, to be followed in a time that runs backwards; only its last colour is surely its own."""
        points = [self.points[-1].backwards]
        return FollowedBall(
            self.name, self.state.backwards, points, True, CONFIRMING_DETECTIONS, colour=self.last_colour
        )

    def forwards(self) -> list[TrackPoint]:
        """Its points in order of time, when it was followed in one that runs backwards."""
        if self.missed:
            self.undo()
        return [point.backwards for point in reversed(self.points)]
