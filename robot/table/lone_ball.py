"""The cue ball alone on a real table: put back to one place, struck along one direction, filmed, again and again.

In: a camera, a launcher at a port, callbacks that ask the person at the table. Out: a `LoneStroke` for every stroke.
The ball is first put within PLACING_TOLERANCE_M of a place that is named; where it then lies is its place, to which it
is put back within `tolerance`. Before every stroke the camera checks that it lies there, alone, and that the stand is
aligned; then the launcher homes if it must, the tip is moved, and a stroke is made only after a yes. The direction of
the cue is the one that the camera measures. Leaves out moving the ball and turning the stand, which are done by hand.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from models.errors import BadInput
from models.mjcf.snooker import spots
from models.shot import Array, Ball, Table
from planner.from_picture import CUE_BALL_NAMES
from robot.camera.align import align, turn_for
from robot.device.launcher import Launcher
from robot.device.outcome import Done
from robot.play import ShotCamera, make_ready
from robot.table.placing import MAX_PLACING_TRIES, PLACING_TOLERANCE_M, words_of
from sysid.clips import Observation
from sysid.vision import Camera, Picture

PLACE_TOLERANCE_M = 2e-3  # of the ball that is put back, each time
MAX_FILMS = 3  # of one stroke, until the ball is seen in one
UNPOCKETED_PLACE = 0.155  # of a table without spots, from its end, over its length: about where the brown spot is


class TableCamera(ShotCamera, Protocol):
    """A camera that also shows the present picture; robot/camera/live.py."""

    @property
    def seen_with(self) -> Camera: ...

    def pictures(self) -> Iterator[Picture]:
        """The present picture, again and again."""
        ...


@dataclass(frozen=True)
class LoneStroke:
    """A stroke of the ball that lay alone."""

    done: Done
    start: Array  # (2,) where the ball lay [m]
    azimuth: float  # of the cue, as the camera saw it [rad]
    ball: Observation  # its path, t = 0 at the first picture after the hit
    end: Array | None  # (2,) where it came to rest [m]; None where it is not on the table any more, or nobody looked


def place_of(table: Table, end: str) -> tuple[Array, float]:
    """Place (2,) [m] and direction [rad] of a ball struck straight up the table from its -x or +x end.

    The brown spot, or the like on a table without spots.
    """
    brown = spots(table)["brown"] if table.pockets else np.array([(UNPOCKETED_PLACE - 0.5) * table.length, 0.0])
    return (brown, 0.0) if end == "-x" else (-brown, math.pi)


@dataclass
class LoneBall:
    """A table with one ball, a launcher at a port, a camera, and a person."""

    camera: TableCamera
    connect: Callable[[], Launcher]  # a launcher, not yet connected
    place: Array  # (2,) of the ball [m]; from the first stroke on where it really lay
    azimuth: float  # to which the stand is turned [rad]
    confirm: Callable[[str], bool]  # asks before every stroke
    ready: Callable[[str], bool]  # says what to do and waits until it is done; False ends the series
    say: Callable[[str], None] = print
    tolerance: float = PLACE_TOLERANCE_M  # of the ball that is put back [m]
    clear: Callable[[], None] = lambda: None  # called after every stroke, once its film has been read
    placed: bool = False  # the ball has been put to its place once

    @property
    def table(self) -> Table:
        """Of the camera."""
        return self.camera.table

    @property
    def ball(self) -> Ball:
        """Of the camera."""
        return self.camera.ball

    def strike(self, string: int, x0_mm: float, y0_mm: float, what: str, look: bool = False) -> LoneStroke:
        """Have the ball put back, strike it once, and film it; made again where the film does not show it.

        Args:
            string: 1 to 200.
            x0_mm: of the cue's axis from the ball's centre, to the right.
            y0_mm: the same, up.
            what: which stroke it is, for the person.
            look: whether to look where the ball came to rest.

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
                    raise BadInput(f"not confirmed ({action}); nothing was struck, say yes to strike")
                self.camera.arm()
                done = launcher.strike(string)
                launcher.retract()
            filmed = self.camera.film()
            self.clear()
            if name := _cue_ball(filmed):
                return LoneStroke(done, start, azimuth, filmed[name], self._resting() if look else None)
            self.say(f"{what}: the film does not show the ball; the stroke is made again")
        raise BadInput(f"{what}: {MAX_FILMS} films do not show the ball; check the camera with: sysid track")

    def _set_up(self, what: str) -> tuple[Array, float]:
        """Where the ball lies (2,) [m] and the cue's direction [rad], once both are as they must be."""
        words = words_of(self.table, "the cue ball", self.place)
        for _ in range(MAX_PLACING_TRIES):
            if not self.ready(f"{what}: put {words}, alone on the table, and keep clear"):
                raise BadInput(f"{what}: not set up; the launcher has not been moved for it")
            fault, place = self._seen()
            if place is not None and not fault:
                if not self.placed:
                    self.place, self.placed = place, True
                line = align(self.camera.pictures(), self.camera.seen_with, self.azimuth, place, say=self.say)
                if (turn := turn_for(line, self.azimuth)).side:
                    raise BadInput(f"no more pictures came, and the stand is not aligned ({turn}); check the camera")
                return place, line.azimuth
            self.say(fault)
        raise BadInput(f"{what}: {fault}; check that the camera file fits the camera and its place")

    def _resting(self) -> Array | None:
        """Where the ball lies now (2,) [m]; None where it is not seen."""
        try:
            seen = self.camera.look()
        except BadInput:  # no ball
            return None
        return seen.get(_cue_ball(seen))

    def _seen(self) -> tuple[str, Array | None]:
        """What is not right with the balls, or nothing, and where the cue ball is seen (2,) [m]."""
        try:
            seen = self.camera.look()
        except BadInput as error:  # no ball at all, or somebody in the picture: not a reason to end a series
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
