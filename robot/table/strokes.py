"""Strokes of a single ball measured at a real table, for the cueing map and for the launcher's repeatability.

In: a `SingleBall`, the launcher's settings, strokes. Out: a `CueShot` for every stroke of a campaign
(robot/cueing/campaign.py), `Repeated` for every string (robot/cueing/repeated.py).

Speed and squirt are those of the path up to the first cushion, relative to the cue's direction measured by the camera
(robot/cueing/first_track.py). The path gives the time of the hit, since a tracker may miss the first pictures. A stroke
whose ball is far slower than the usual constants predict, or leaves in a far different direction, is a miscue. A path
length is that of the filmed path, with corners no closer than PATH_STEP_M, so that noise does not lengthen it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from models.analytic.cue_impulse import Constants, Geometry, ball_speed_and_squirt
from models.errors import BadInput
from models.shot import Array
from robot.cueing.campaign import CueShot
from robot.cueing.first_track import MIN_TRACK_FRAMES, MIN_TRACK_S, TRACK_LENGTH_S, read_track
from robot.cueing.repeated import Repeated, summarised
from robot.device.settings import Settings
from robot.order import check_radius
from robot.play import pocket_near
from robot.table.single_ball import MAX_FILMS, SingleBall, SingleBallStroke

HIT_PICTURES = 2  # possible error of the time of the hit, estimated from the path
CUSHION_GAP_M = 0.005  # distance of a ball's edge from a cushion beyond which its path is free
MIN_SPEED_RATIO = 0.6  # speed of the ball over the usual constants' prediction; below it the tip has slipped
MAX_SQUIRT_ERROR = 0.15  # deviation from their prediction beyond which the tip has slipped [rad]
PATH_STEP_M = 0.05  # least distance of a path's corners


def check_strokes(settings: Settings, strokes: Sequence[tuple[int, float, float]], rig: SingleBall) -> None:
    """Raise BadInput for a stroke (string, x0_mm, y0_mm) beyond the launcher's limits, or too short a table."""
    check_radius(settings, rig.ball, "the balls of the camera file", "calibrate for these balls")
    fastest = max(settings.check_speed(string) for string, _, _ in strokes)
    for x0_mm, y0_mm in {(x, y) for _, x, y in strokes}:
        settings.stage_um(x0_mm, y0_mm)
    along = abs(float(rig.place @ np.array([math.cos(rig.azimuth), math.sin(rig.azimuth)])))
    room = rig.table.length / 2 + along - rig.ball.radius - CUSHION_GAP_M  # for a ball struck from one end to the other
    speed, _ = ball_speed_and_squirt(Constants(), Geometry(rig.ball), np.array([fastest]), *np.zeros((2, 1)))
    until = min(room / float(speed[0]), TRACK_LENGTH_S)
    seen = int((until - MIN_TRACK_S) * rig.camera.fps)
    if seen < MIN_TRACK_FRAMES:
        raise BadInput(
            f"a ball of {speed[0]:.1f} m/s is at the cushion after {seen} pictures of {rig.camera.fps:g} a second; "
            f"{MIN_TRACK_FRAMES} or more are needed: use a faster camera, or a longer table"
        )


class TableStriker:
    """A launcher and a camera at a table, a striker for `run_campaign`."""

    def __init__(self, rig: SingleBall, friction: float, played: int, total: int) -> None:
        """Create a striker: sliding `friction` of the ball [1], `played` strokes of the campaign's `total`."""
        self.rig, self.friction, self.played, self.total = rig, friction, played, total

    def __call__(self, string: int, x0_mm: float, y0_mm: float) -> CueShot:
        """Strike once and measure; a stroke that cannot be measured is repeated."""
        what, fault = f"stroke {self.played + 1} of {self.total}", ""
        for _ in range(MAX_FILMS):
            stroke = self.rig.strike(string, x0_mm, y0_mm, what)
            try:
                shot = measured(stroke, self.rig, self.friction, string, x0_mm, y0_mm)
            except BadInput as error:
                fault = str(error)
                self.rig.say(f"{what}: {fault}; the stroke is made again")
                continue
            self.played += 1
            return shot
        raise BadInput(f"{what}: {fault}")


def measured(
    stroke: SingleBallStroke, rig: SingleBall, friction: float, string: int, x0_mm: float, y0_mm: float
) -> CueShot:  # fmt: skip
    """Ball speed and squirt of a filmed stroke, x along the cue; BadInput if the film is too short."""
    times, xy = first_path(stroke, rig)
    asked = stroke.done.asked_speed
    read = read_track(times, xy, friction, max(rig.camera.sigma, 1e-6), x0_mm, y0_mm, rig.ball)
    one = (np.array([v]) for v in (asked, 1e-3 * x0_mm, 1e-3 * y0_mm))
    speed, squirt = (float(v[0]) for v in ball_speed_and_squirt(Constants(), Geometry(rig.ball), *one))
    miscue = read[0] < MIN_SPEED_RATIO * speed or abs(read[3] - squirt) > MAX_SQUIRT_ERROR
    return CueShot(string, asked, x0_mm, y0_mm, *read, miscue=miscue)


def first_path(stroke: SingleBallStroke, rig: SingleBall) -> tuple[Array, Array]:
    """Times (n,) [s] and positions (n, 2) [m], x along the cue: at rest until 0, then free up to the first cushion."""
    half = np.array([rig.table.length, rig.table.width]) / 2 - rig.ball.radius - CUSHION_GAP_M
    near = np.flatnonzero((np.abs(stroke.ball.xy) > half).any(axis=1))
    free = slice(0, int(near[0]) if near.size else None)
    times, xy = stroke.ball.time[free], turned(stroke.ball.xy[free] - stroke.start, -stroke.azimuth)
    early = times <= TRACK_LENGTH_S
    times, xy = times[early], xy[early]
    if len(times) < MIN_TRACK_FRAMES:
        raise BadInput(f"{len(times)} pictures of the ball before a cushion are too few; use a faster camera")
    speed = float(np.hypot(*np.polyfit(times, xy, 1)[0]))
    times = times - times[0] + float(np.hypot(*xy[0])) / max(speed, 1e-3)  # the hit is at about 0
    rest = -HIT_PICTURES / rig.camera.fps  # one picture: all of them share the error of the resting place
    return np.append(rest, times), np.concatenate([np.zeros((1, 2)), xy])


def measure_repeats(
    rig: SingleBall, strings: Sequence[int], repeats: int, report: Callable[[Repeated], None]
) -> tuple[Repeated, ...]:
    """Strike each string repeatedly, tip at the ball's centre.

    Args:
        rig: the table.
        strings: strings to strike, 1 to 200.
        repeats: of each, 2 or more.
        report: called with the figures of each finished string.

    Raises:
        BadInput, LauncherError: as `SingleBall.strike`.
    """
    found = []
    for n in strings:
        strokes, ends = [], []
        for k in range(repeats):
            what = f"stroke {k + 1} of {repeats}"
            stroke, end = _until_seen(rig, n, what)
            strokes.append(stroke)
            ends.append(end)
        speeds = np.array([stroke.done.cue_speed for stroke in strokes])
        lengths = np.array([path_length(stroke.ball.xy) for stroke in strokes])
        along = turned(np.array(ends) - rig.place, -rig.azimuth)
        found.append(summarised(n, strokes[0].done.asked_speed, speeds, along, lengths))
        report(found[-1])
    return tuple(found)


def _until_seen(rig: SingleBall, string: int, what: str) -> tuple[SingleBallStroke, Array]:
    """A stroke, and the resting place of its ball (2,) [m]; nan if it was pocketed."""
    for _ in range(MAX_FILMS):
        stroke = rig.strike(string, 0.0, 0.0, what, look=True)
        if stroke.end is not None:
            return stroke, stroke.end
        if pocket_near(stroke.ball.xy[-1], rig.table) is not None:
            return stroke, np.full(2, math.nan)
        rig.say(f"{what}: the ball was lost from view; the stroke is made again")
    raise BadInput(f"{what}: the ball was lost from view {MAX_FILMS} times; check the camera with: sysid track")


def path_length(xy: Array) -> float:
    """Length of a filmed path (n, 2) [m], with corners no nearer than PATH_STEP_M."""
    corners = [xy[0]]
    for place in xy[1:]:
        if math.dist(place, corners[-1]) >= PATH_STEP_M:
            corners.append(place)
    corners.append(xy[-1])
    return float(np.hypot(*np.diff(corners, axis=0).T).sum())


def turned(xy: Array, angle: float) -> Array:
    """Vectors (n, 2) turned to the left by an angle [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(xy @ np.array([[c, s], [-s, c]]))
