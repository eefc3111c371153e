"""Alignment of the launcher's stand: the remaining turn, shown live from a camera's pictures of the cue.

In: pictures from above, their camera, the wanted azimuth. Out: instructions to the operator, and the last `CueLine`.
The stand is turned by hand, watched by the camera over the table (Robotic Billiards 2015, section V). The cue is
measured by sysid/vision/cue/line.py and averaged over pictures between which it did not move.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from models.errors import BadInput
from models.mjcf.stroke import CUE_TILT
from models.shot import Array
from sysid.vision import Camera, CueLine, Picture, angle_between, cue_direction

ALIGNED_TOLERANCE = math.radians(0.1)  # of the azimuth, within which a stand is aligned [rad]
AVERAGED_PICTURES, ALIGNED_PICTURES = 5, 5  # averaged; that must be aligned in succession
MOVED_ANGLE = math.radians(0.05)  # between pictures, from which the stand has been turned [rad]
REPORT_STEP_DEG = 0.02  # change of the remaining turn that is reported anew


@dataclass(frozen=True)
class Turn:
    """The remaining turn of the stand."""

    degrees: float  # 0 or more
    side: str  # "left" (anticlockwise from above), "right", or "" if it is aligned

    def __str__(self) -> str:
        """The instruction to the operator."""
        if not self.side:
            return f"aligned ({self.degrees:.2f} degrees off)"
        sense = "anticlockwise" if self.side == "left" else "clockwise"
        return f"turn {self.degrees:.2f} degrees to the {self.side} ({sense})"


def turn_for(line: CueLine, wanted: float, tolerance: float = ALIGNED_TOLERANCE) -> Turn:
    """The turn to a wanted azimuth; wanted and tolerance in [rad]."""
    off = math.remainder(wanted - line.azimuth, 2 * math.pi)
    side = "" if abs(off) <= tolerance else "left" if off > 0 else "right"
    return Turn(abs(math.degrees(off)), side)


def align(
    frames: Iterable[Picture], camera: Camera, wanted: float, ball_xy: Array | None = None, *,
    elevation: float = CUE_TILT, tolerance: float = ALIGNED_TOLERANCE, say: Callable[[str], None] = print,
) -> CueLine:  # fmt: skip
    """Show how to turn the stand, until ALIGNED_PICTURES successive pictures are aligned or no more come.

    Args:
        frames: pictures as they come.
        camera: of the pictures.
        wanted: azimuth of the plan [rad].
        ball_xy: (2,) of the ball to be struck [m]; None to find the cue ball in the first picture.
        elevation: of the butt [rad].
        tolerance: of the azimuth [rad].
        say: called with an instruction when it changes.

    Returns:
        The last line, averaged over the pictures since the last turn; `turn_for` returns whether it is aligned.

    Raises:
        BadInput: there was no picture, no cue ball, or no cue in any of them.
    """
    recent: list[CueLine] = []
    shown, shown_degrees, aligned = "", math.inf, 0
    last: CueLine | None = None
    for picture in frames:
        if ball_xy is None:
            ball_xy = _cue_ball(picture, camera)
        try:
            line = _next(picture, camera, ball_xy, elevation, recent)
        except BadInput as error:
            recent, aligned = [], 0
            if str(error) != shown:
                shown, shown_degrees = str(error), math.inf
                say(shown)
            continue
        still = [one for one in recent if angle_between(one, line) < MOVED_ANGLE]
        recent = [*(still if len(still) == len(recent) else []), line][-AVERAGED_PICTURES:]
        last = _averaged(recent)
        turn = turn_for(last, wanted, tolerance)
        signed = turn.degrees if turn.side == "left" else -turn.degrees
        if abs(signed - shown_degrees) > REPORT_STEP_DEG or bool(turn.side) == shown.startswith("aligned"):
            shown, shown_degrees = str(turn), signed
            say(shown)
        aligned = aligned + 1 if not turn.side else 0
        if aligned == ALIGNED_PICTURES:
            return last
    if last is None:
        raise BadInput(shown or "no picture came from the camera; check that it is filming")
    return last


def _next(
    picture: Picture, camera: Camera, ball_xy: Array, elevation: float, recent: Sequence[CueLine]
) -> CueLine:  # fmt: skip
    """The cue near its previous direction, or else in any direction."""
    if recent:
        with contextlib.suppress(BadInput):
            return cue_direction(picture, camera, ball_xy, elevation, recent[-1].azimuth)
    return cue_direction(picture, camera, ball_xy, elevation)


def _averaged(lines: Sequence[CueLine]) -> CueLine:
    """The mean of lines that agree; pictures of a cue at rest share their error, so its sd is not reduced."""
    late = lines[-1]
    off = np.array([math.remainder(one.azimuth - late.azimuth, 2 * math.pi) for one in lines])
    sd = math.sqrt(float(np.mean([one.azimuth_sd**2 for one in lines])))
    azimuth = math.remainder(late.azimuth + float(off.mean()), 2 * math.pi)
    return replace(late, azimuth=azimuth, azimuth_sd=sd, offset=float(np.mean([one.offset for one in lines])))


def _cue_ball(picture: Picture, camera: Camera) -> Array:
    """Position of the cue ball: (2,) [m]."""
    from planner.from_picture import CUE_BALL_NAMES
    from robot.camera.live import balls_in

    found = balls_in([picture], camera)
    name = next((name for name in CUE_BALL_NAMES if name in found.names), None)
    if name is None:
        raise BadInput(f"no white ball among {', '.join(found.names)}; give its position")
    return found.position[found.names.index(name)]
