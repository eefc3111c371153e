"""A series, or one plan, at a real table: a person lays the balls and turns the stand, a camera looks and films.

The camera decides when a scene is laid: every ball within reach of its place is enough, as the plan is made for where
it really lies. The stand's turn is told live from the camera's picture of the cue (robot/camera/align.py) until it is
aligned; nothing is struck from a stand that never was.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from models.errors import BadInput
from models.shot import Array
from planner.scene import Scene
from robot.camera.align import align, turn_for
from robot.camera.live import LiveCamera
from robot.device.launcher import Launcher
from robot.device.settings import Settings
from robot.learning.loop import Setup

REACH = 0.03  # within which a ball counts as laid [m]
TRIES = 20  # times that somebody is asked to lay a scene


@dataclass
class LiveRig:
    """A table, a launcher at a port, a camera, and whoever stands there."""

    camera: LiveCamera
    settings: Settings
    connect: Callable[[], Launcher]  # a launcher, not yet connected
    confirm: Callable[[str], bool]  # asked before every stroke
    ready: Callable[[str], bool]  # told what to do, answers when it is done; no: the series ends here
    say: Callable[[str], None] = print

    def lay(self, scene: Scene, number: int) -> Setup:
        """Have the balls of a shot laid, until the camera sees them there.

        Raises:
            BadInput: nobody goes on, or they are not laid after many tries.
        """
        if (scene.table, scene.ball) != (self.camera.table, self.camera.ball):
            raise BadInput(
                f"the series is for {scene.table}, {scene.ball}; the camera sees {self.camera.table}, "
                f"{self.camera.ball}: begin with a model of this table (robot learn --model)"
            )
        text = self._words(scene)
        for _ in range(TRIES):
            if not self.ready(f"shot {number}: lay {text}"):
                raise BadInput(f"shot {number}: not laid; the same command goes on from here")
            faults, ball = self._faults(scene)
            if not faults:
                return Setup(self.camera, self.connect(), partial(self.turn, ball_xy=ball), self.confirm)
            self.say("; ".join(faults))
        raise BadInput(f"shot {number}: {faults[0]}; see that the camera's file fits, and names the balls as they are")

    def turn(self, azimuth: float, ball_xy: Array | None = None) -> None:
        """Say how to turn the stand until it is aligned.

        Args:
            azimuth: wanted [rad].
            ball_xy: (2,) of the ball that will be struck [m]; without, it is looked for.

        Raises:
            BadInput: the stand does not reach it, or no more pictures come and it is not aligned.
        """
        low, high = self.settings.limits.yaw_deg
        degrees = self.settings.check_yaw(round(math.degrees(azimuth), 6))
        self.say(f"turn the stand to {degrees:.1f} degrees (it reaches {low:g} to {high:g})")
        line = align(self.camera.pictures(), self.camera.seen_with, azimuth, ball_xy, say=self.say)
        left = turn_for(line, azimuth)
        if left.side:
            raise BadInput(f"no more pictures came, and the stand is not aligned ({left}); see that the camera films")

    def repeat(self, plan: Path, number: int) -> Array | None:
        """Nobody lays a scene twenty times."""
        return None

    def _faults(self, scene: Scene) -> tuple[list[str], Array | None]:
        """What is not yet laid, and where the cue ball is seen (2,) [m]."""
        try:
            seen = self.camera.look()
        except BadInput as error:  # no ball at all, or somebody in the picture: nothing that ends a series
            return [str(error)], None
        told = [f"{name} is not seen" for name in scene.names if name not in seen]
        told += [f"{name} is one too many" for name in seen if name not in scene.names]
        for name, place in zip(scene.names, scene.position, strict=True):
            away = float(np.hypot(*(seen[name] - place))) if name in seen else 0.0
            if away > REACH:
                told.append(f"{name} lies {1e3 * away:.0f} mm from its place")
        return told, seen.get(scene.names[0])

    def _words(self, scene: Scene) -> str:
        """Where the balls go, from the cushions."""
        half = np.array([scene.table.length, scene.table.width]) / 2
        ends = (("-x", "+x"), ("-y", "+y"))
        parts = []
        for name, xy in zip(scene.names, scene.position, strict=True):
            sides = [
                f"{1e2 * (half[k] - abs(xy[k])):.1f} cm from the {ends[k][int(xy[k] > 0)]} cushion" for k in range(2)
            ]
            parts.append(f"{name} {' and '.join(sides)}")
        return "; ".join(parts)
