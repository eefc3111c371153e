"""A campaign as a Rerun recording: measured ball motion of each stroke, and a cueing map's prediction."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from models.analytic.cue_impulse import Constants, Geometry, ball_speed_and_squirt
from models.errors import BadInput
from models.recording.campaign import Strokes, write_campaign
from models.table.snooker import SNOOKER_BALL
from planner.launcher.cueing_map import CueingMap
from robot.cueing.campaign import CueShot


def write_recording(path: Path | str, shots: Sequence[CueShot], cueing_map: CueingMap | None, title: str) -> None:
    """Write one Rerun recording, completely or not at all.

    Args:
        path: the recording.
        shots: of the campaign.
        cueing_map: for predictions; None for the constants of a regular cue.
        title: of the recording.

    Raises:
        BadInput: there are no shots, or it cannot be written.
    """
    if not shots:
        raise BadInput(f"{title}: holds no shot yet; continue it with: robot campaign")
    ordered = sorted(shots, key=lambda shot: shot.order)
    constants, geometry = (
        (Constants(), Geometry(SNOOKER_BALL)) if cueing_map is None else (cueing_map.constants, cueing_map.geometry)
    )
    speed, place = np.array([s.cue_speed for s in ordered]), 1e-3 * np.array([(s.x0_mm, s.y0_mm) for s in ordered])
    strokes = Strokes(
        number=np.array([s.order + 1.0 for s in ordered]), place=place, cue_speed=speed,
        measured=np.array([(s.ball_speed, s.squirt_rad) for s in ordered]),
        predicted=np.column_stack(ball_speed_and_squirt(constants, geometry, speed, *place.T)),
        miscue=np.array([s.miscue for s in ordered]),
    )  # fmt: skip
    good = ~strokes.miscue
    rms = np.sqrt(np.mean((strokes.measured - strokes.predicted)[good] ** 2, axis=0)) if good.any() else np.zeros(2)
    by = "a regular cue's constants" if cueing_map is None else "the cueing map"
    words = (
        f"{len(ordered)} strokes, {int((~good).sum())} of them miscues. Rms difference from the prediction by {by}"
        f"{'s' * (cueing_map is not None)}: {1e3 * rms[0]:.0f} mm/s of ball speed, {1e3 * rms[1]:.1f} mrad of squirt."
    )
    write_campaign(path, strokes, geometry.ball, title=title, words=words)
