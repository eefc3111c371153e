"""The rig of a series, or of one plan, at a real table: an operator sets up balls and stand, a camera films.

In: a live camera, a launcher and callbacks for questions to the operator. Out: a `robot.learning.loop.Rig`. The camera
decides when a scene is set up: every ball must be within PLACING_TOLERANCE_M of its place, since the plan is made for
the actual positions. The remaining turn of the stand is shown live from the camera's picture of the cue
(robot/camera/align.py) until it is aligned; there is no stroke from a stand that is not.
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
from robot.learning.loop import SceneSetup
from robot.table.placing import MAX_PLACING_TRIES, PLACING_TOLERANCE_M, words_of


@dataclass
class LiveRig:
    """A table, a launcher at a port, a camera, and an operator."""

    camera: LiveCamera
    settings: Settings
    connect: Callable[[], Launcher]  # a launcher, not yet connected
    confirm: Callable[[str], bool]  # question before every stroke
    ready: Callable[[str], bool]  # gives an instruction and waits until it is done; False ends the series
    say: Callable[[str], None] = print

    def set_up(self, scene: Scene, number: int) -> SceneSetup:
        """Ask for the balls of a shot to be set up, until the camera sees them in their places.

        Raises:
            BadInput: the operator ends the series, or the balls are not in their places after many tries.
        """
        if (scene.table, scene.ball) != (self.camera.table, self.camera.ball):
            raise BadInput(
                f"the series is for {scene.table}, {scene.ball}; the camera sees {self.camera.table}, "
                f"{self.camera.ball}: start with a model of this table (robot learn --model)"
            )
        text = "; ".join(words_of(scene.table, name, xy) for name, xy in zip(scene.names, scene.position, strict=True))
        for _ in range(MAX_PLACING_TRIES):
            if not self.ready(f"shot {number}: put {text}"):
                raise BadInput(f"shot {number}: not set up; the same command continues from here")
            faults, ball = self._faults(scene)
            if not faults:
                return SceneSetup(self.camera, self.connect(), partial(self.turn, ball_xy=ball), self.confirm)
            self.say("; ".join(faults))
        raise BadInput(f"shot {number}: {faults[0]}; check that the camera file fits and names these balls")

    def turn(self, azimuth: float, ball_xy: Array | None = None) -> None:
        """Show how to turn the stand until it is aligned.

        Args:
            azimuth: wanted [rad].
            ball_xy: (2,) of the ball to be struck [m]; None to find it in the picture.

        Raises:
            BadInput: the azimuth is beyond the stand's range, or no more pictures come and it is not aligned.
        """
        low, high = self.settings.limits.yaw_deg
        degrees = self.settings.check_yaw(round(math.degrees(azimuth), 6))
        self.say(f"turn the stand to {degrees:.1f} degrees (its range is {low:g} to {high:g})")
        line = align(self.camera.pictures(), self.camera.seen_with, azimuth, ball_xy, say=self.say)
        remaining = turn_for(line, azimuth)
        if remaining.side:
            raise BadInput(
                f"no more pictures came, and the stand is not aligned ({remaining}); check that the camera is filming"
            )

    def repeat(self, plan: Path, number: int) -> Array | None:
        """None: at a real table strokes are not repeated."""
        return None

    def _faults(self, scene: Scene) -> tuple[list[str], Array | None]:
        """The balls that are not in their places yet, and the position of the cue ball (2,) [m]."""
        try:
            seen = self.camera.look()
        except BadInput as error:  # no ball, or a person in the picture: no reason to end a series
            return [str(error)], None
        faults = [f"{name} is not seen" for name in scene.names if name not in seen]
        faults += [f"{name} is not in the scene" for name in seen if name not in scene.names]
        for name, place in zip(scene.names, scene.position, strict=True):
            distance = float(np.hypot(*(seen[name] - place))) if name in seen else 0.0
            if distance > PLACING_TOLERANCE_M:
                faults.append(f"{name} is {1e3 * distance:.0f} mm from its place")
        return faults, seen.get(scene.names[0])
