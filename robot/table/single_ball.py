"""The cue ball alone on a real table: put back to one place, struck along one direction and filmed, repeatedly.

In: a camera, a launcher at a port, callbacks for questions to the person at the table. Out: a `SingleBallStroke` for
every stroke. The ball is first put within PLACING_TOLERANCE_M of a named place; its position then is its place, to
which it is put back within `tolerance`. Before every stroke the camera checks that it lies there, alone, and that the
stand is aligned; then the launcher homes if necessary, the tip is moved, and a stroke is made only after a yes. The
direction of the cue is measured by the camera. Left out: moving the ball and turning the stand, done by hand.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from models.errors import BadInput
from models.shot import Array, Ball, Table
from models.table.snooker import spots
from planner.from_picture import CUE_BALL_NAMES
from robot.camera.align import align, turn_for
from robot.device.launcher import Launcher
from robot.device.outcome import Done
from robot.play import ShotCamera, make_ready
from robot.table.placing import MAX_PLACING_TRIES, PLACING_TOLERANCE_M, words_of
from sysid.clips import Observation
from sysid.vision import Camera, Picture

PLACE_TOLERANCE_M = 2e-3  # tolerance of the place to which the ball is put back
MAX_FILMS = 3  # attempts at a stroke until a film shows the ball
UNPOCKETED_PLACE = 0.155  # distance from the end of a table without spots, over its length: about the brown spot


class TableCamera(ShotCamera, Protocol):
    """A camera that also shows the current picture; robot/camera/live.py."""

    @property
    def seen_with(self) -> Camera: ...

    def pictures(self) -> Iterator[Picture]:
        """Yield the current picture repeatedly."""
        ...


@dataclass(frozen=True)
class SingleBallStroke:
    """A stroke of a single ball."""

    done: Done
    start: Array  # (2,) initial position of the ball [m]
    azimuth: float  # of the cue, measured by the camera [rad]
    ball: Observation  # its path, t = 0 at the first picture after the hit
    end: Array | None  # (2,) resting place [m]; None if the ball has left the table, or was not looked for


def place_of(table: Table, end: str) -> tuple[Array, float]:
    """Place (2,) [m] and direction [rad] of a ball struck straight up the table from its -x or +x end.

    The brown spot, or a similar place on a table without spots.
    """
    brown = spots(table)["brown"] if table.pockets else np.array([(UNPOCKETED_PLACE - 0.5) * table.length, 0.0])
    return (brown, 0.0) if end == "-x" else (-brown, math.pi)


@dataclass
class SingleBall:
    """A table with one ball, a launcher at a port, a camera, and a person."""

    camera: TableCamera
    connect: Callable[[], Launcher]  # a launcher, not yet connected
    place: Array  # (2,) of the ball [m]; from the first stroke on its actual position
    azimuth: float  # direction of the stand [rad]
    confirm: Callable[[str], bool]  # question before every stroke
    ready: Callable[[str], bool]  # gives an instruction and waits until it is done; False ends the series
    say: Callable[[str], None] = print
    tolerance: float = PLACE_TOLERANCE_M  # of the ball's position when put back [m]
    clear: Callable[[], None] = lambda: None  # called after every stroke, once its film is evaluated
    placed: bool = False  # whether the ball was put to its place before

    @property
    def table(self) -> Table:
        """Of the camera."""
        return self.camera.table

    @property
    def ball(self) -> Ball:
        """Of the camera."""
        return self.camera.ball

    def strike(self, string: int, x0_mm: float, y0_mm: float, what: str, look: bool = False) -> SingleBallStroke:
        """Have the ball put back, strike it once, and film it; repeated if the film does not show the ball.

        Args:
            string: 1 to 200.
            x0_mm: offset of the cue's axis from the ball's centre, to the right.
            y0_mm: likewise, upwards.
            what: name of the stroke, for the person.
            look: whether to measure the resting place of the ball.

        Raises:
            BadInput: ended by the person, not confirmed, a stand that is not aligned, or no film shows the ball.
            LauncherError: something went wrong; the launcher was stopped.
        """
        for _ in range(MAX_FILMS):
            start, azimuth = self._set_up(what)
            with self.connect() as launcher:
                make_ready(launcher, self.say)
                tip = launcher.move_tip(x0_mm, y0_mm)
                action = f"{what}, tip at {tip.x0_mm:+.2f}, {tip.y0_mm:+.2f} mm, string {string:03d}p"
                if not self.confirm(action):
                    raise BadInput(f"not confirmed ({action}), so nothing was struck; answer yes to strike")
                self.camera.arm()
                done = launcher.strike(string)
                launcher.retract()
            filmed = self.camera.film()
            self.clear()
            if name := _cue_ball(filmed):
                return SingleBallStroke(done, start, azimuth, filmed[name], self._resting() if look else None)
            self.say(f"{what}: the film does not show the ball; the stroke is made again")
        raise BadInput(f"{what}: {MAX_FILMS} films do not show the ball; check the camera with: sysid track")

    def _set_up(self, what: str) -> tuple[Array, float]:
        """Position of the ball (2,) [m] and direction of the cue [rad], once both are accepted."""
        words = words_of(self.table, "the cue ball", self.place)
        for _ in range(MAX_PLACING_TRIES):
            if not self.ready(f"{what}: put {words}, alone on the table, and keep clear"):
                raise BadInput(f"{what}: not set up; the launcher was not moved")
            fault, place = self._seen()
            if place is not None and not fault:
                if not self.placed:
                    self.place, self.placed = place, True
                line = align(self.camera.pictures(), self.camera.seen_with, self.azimuth, place, say=self.say)
                if (turn := turn_for(line, self.azimuth)).side:
                    raise BadInput(f"no more pictures came, and the stand is not aligned ({turn}); check the camera")
                return place, line.azimuth
            self.say(fault)
        raise BadInput(f"{what}: {fault}; check that the camera file fits the camera and its position")

    def _resting(self) -> Array | None:
        """Current position of the ball (2,) [m]; None if it is not seen."""
        try:
            seen = self.camera.look()
        except BadInput:  # no ball
            return None
        return seen.get(_cue_ball(seen))

    def _seen(self) -> tuple[str, Array | None]:
        """A fault of the balls, or "", and the position of the cue ball (2,) [m]."""
        try:
            seen = self.camera.look()
        except BadInput as error:  # no ball, or a person in the picture: no reason to end a series
            return str(error), None
        name = _cue_ball(seen)
        if not name:
            return "the cue ball is not seen", None
        if others := [other for other in seen if other != name]:
            return f"{', '.join(others)} must be taken off the table", None
        tolerance = self.tolerance if self.placed else PLACING_TOLERANCE_M
        off = seen[name] - self.place
        if float(np.hypot(*off)) <= tolerance:
            return "", seen[name]
        return (
            f"the cue ball is {1e3 * off[0]:+.1f} mm along x and {1e3 * off[1]:+.1f} mm along y from its place "
            f"(within {1e3 * tolerance:g} mm)"
        ), None


def _cue_ball(balls: Mapping[str, object]) -> str:
    return next((name for name in CUE_BALL_NAMES if name in balls), "")
