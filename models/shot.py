"""Shots and their tracks: frozen values that all other rooms use.

Table frame: origin at the centre of the playing surface, x along the length, y along the width, z up,
angles counter-clockwise from +x seen from above. Spin is angular velocity in that frame; omega_z > 0 is
counter-clockwise from above (right side).
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from models.files.decode import Allowed
from models.table.pocket_shape import SNOOKER_POCKETS, PocketShapes, read_pockets

Array = NDArray[np.float64]

GRAVITY = 9.81  # gravitational acceleration [m/s^2]
MAX_SPEED_M_S = 30.0  # largest speed of a ball, beyond any stroke
MAX_BREAK_SPEED_M_S = 15.0  # no break shot is faster
RAIL_NAMES = ("+x", "-x", "+y", "-y")  # names of the cushions, by the side of the table
NOSE_HEIGHT = 1.4  # cushion nose over ball radius: 7R/5 (Mathavan, Jackson, Parkin 2010)
NOSE_SINE = NOSE_HEIGHT - 1.0  # sine of the contact normal's elevation at the nose
NOSE_COSINE = float(np.sqrt(1.0 - NOSE_SINE**2))


@dataclass(frozen=True)
class Table:
    """A table's playing surface, cushion nose to cushion nose."""

    length: Annotated[float, Allowed(0.2, 10.0, "m")]  # along x
    width: Annotated[float, Allowed(0.1, 10.0, "m")]  # along y
    pockets: Annotated[bool | PocketShapes, Allowed(reader=read_pockets)] = True  # True: those of snooker; False: none

    @property
    def shapes(self) -> PocketShapes:
        """The shapes of its pockets, if it has any."""
        return self.pockets if isinstance(self.pockets, PocketShapes) else SNOOKER_POCKETS

    def corners(self, inset: float = 0.0) -> Array:
        """Where the nose lines cross, or lines so far inside of them [m]: (4, 2) [m], round from +x, +y."""
        half = np.array([self.length, self.width]) / 2 - inset
        return np.array([[1, 1], [-1, 1], [-1, -1], [1, -1.0]]) * half

    def centre_limits(self, ball: Ball) -> Array:
        """Largest |x|, |y| of a ball's centre, touching the noses: (2,) [m]."""
        return np.array([self.length / 2, self.width / 2]) - ball.radius * NOSE_COSINE

    def mouths(self) -> Array:
        """Where a rail takes no ball but a pocket does: from a corner, from a middle; capture at a corner: (3,) [m]."""
        corner, middle = self.shapes.corner.acceptance, self.shapes.middle.acceptance
        return np.array([2 * corner / np.sqrt(2), middle, corner]) * bool(self.pockets)

    def to_pocket(self, xy: Array) -> Array:
        """From places (..., 2) to where the nose lines meet, or to the middle of a long one, the nearest: (...) [m]."""
        if not self.pockets:
            return np.full(np.shape(xy)[:-1], np.inf)
        over = np.abs(xy) - np.array([self.length, self.width]) / 2
        corner, middle = np.hypot(over[..., 0], over[..., 1]), np.hypot(xy[..., 0], over[..., 1])
        return np.asarray(np.minimum(corner, middle))


@dataclass(frozen=True)
class Ball:
    """A solid homogeneous ball."""

    diameter: Annotated[float, Allowed(0.02, 0.1, "m")]
    mass: Annotated[float, Allowed(2e-4, 6.0, "kg")]

    @property
    def radius(self) -> float:
        """Radius [m]."""
        return self.diameter / 2

    @property
    def inertia(self) -> float:
        """Moment of inertia about any diameter, 2/5 M R^2 [kg m^2]."""
        return 0.4 * self.mass * self.radius**2


@dataclass(frozen=True)
class Session:
    """The conditions of a shot; 0 stands for unknown or usual."""

    order: float = 0.0  # place among the shots, 0 for the first, 1 for the last
    hour: float = 0.0  # of the day [h]
    warmth: float = 0.0  # of the room, over USUAL_TEMPERATURE [K]
    cloth_age: float = 0.0  # play since the cloth was laid [h]
    table: float = 0.0  # its number, of several of one kind
    player: float = 0.0  # his number

    @property
    def row(self) -> Array:
        """As compiled code has it: (SESSION_FIELDS,)."""
        return np.array(dataclasses.astuple(self), float)


USUAL_TEMPERATURE = 20.0  # usual temperature of a room [degrees Celsius]
SESSION_FIELDS = len(dataclasses.fields(Session))
UNKNOWN_SESSION = Session()


@dataclass(frozen=True, repr=False)
class Shot:
    """The state of every ball at t = 0, and the times at which the track is wanted.

    A struck ball starts with the velocity and spin that the cue gave it; resting balls with zeros.
    """

    names: tuple[str, ...]
    position: Array  # (nball, 2) [m], ball centres
    velocity: Array  # (nball, 2) [m/s]
    spin: Array  # (nball, 3) [rad/s]
    times: Array  # (n,) [s], increasing, from 0
    session: Session = UNKNOWN_SESSION
    struck: bool = True  # whether the first ball was struck at t = 0; otherwise it was on its way
    staying: tuple[str, ...] = ()  # balls that are known to be on the table after: no pocket takes them

    def __repr__(self) -> str:
        """Its balls and times in a line, not its arrays."""
        return f"<Shot of {', '.join(self.names)}: {len(self.times)} times>"


@dataclass(frozen=True)
class Event:
    """Something that happened to one or two balls."""

    time: float  # [s]
    kind: str  # "ball", "cushion", "pocket"
    balls: tuple[str, ...]
    rail: str = ""  # "+x", "-x", "+y", "-y" of a cushion; "" otherwise
    place: tuple[float, float] | None = field(default=None, compare=False)  # of a potted ball's centre as it fell [m]


@dataclass(frozen=True, repr=False)
class Track:
    """Places of all balls over time; NaN for a ball once it is potted."""

    names: tuple[str, ...]
    times: Array  # (n,) [s]
    position: Array  # (n, nball, 2) [m]
    velocity: Array  # (n, nball, 2) [m/s]
    spin: Array  # (n, nball, 3) [rad/s]
    theta: Array  # (n, nball) [rad], turned about the vertical since t = 0
    events: tuple[Event, ...] = field(default=())

    def __repr__(self) -> str:
        """Its balls and times in a line, not its arrays."""
        return f"<Track of {', '.join(self.names)}: {len(self.times)} times, {len(self.events)} events>"


def largest_overlap(position: Array, ball: Ball) -> tuple[float, int, int]:
    """Largest overlap [m] of two balls at (n, 2) [m], negative for a gap, and their indices."""
    if len(position) < 2:
        return -math.inf, 0, 0
    one, other = np.triu_indices(len(position), 1)
    distance = np.hypot(*(position[other] - position[one]).T)
    k = int(distance.argmin())
    return ball.diameter - float(distance[k]), int(one[k]), int(other[k])
