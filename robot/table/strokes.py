"""Strokes of a lone ball measured at a real table: for the cueing map, and for how well the launcher repeats.

In: a `LoneBall`, the launcher's settings, strokes. Out: a `CueShot` for every stroke of a campaign
(robot/cueing/campaign.py), `Repeated` for every string (robot/cueing/repeated.py).

Speed and squirt are those of the first path, up to the first cushion, against the direction in which the camera sees
the cue (robot/cueing/first_track.py). The path says when the hit was: a tracker may miss the first pictures. A stroke
whose ball is far slower than the usual constants say, or leaves far from where they say, is a miscue. A path length is
that of the filmed path, with corners no shorter than PATH_STEP_M, so that noise does not lengthen it.
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
from robot.play import check_radius, pocket_near
from robot.table.lone_ball import MAX_FILMS, LoneBall, LoneStroke

HIT_PICTURES = 2  # by which the time of the hit, estimated from the path, may be wrong
CUSHION_GAP_M = 0.005  # of a ball's edge from a cushion, from which on its path is free
MIN_SPEED_RATIO = 0.6  # of the ball, over what the usual constants say; below, the tip has slipped
MAX_SQUIRT_ERROR = 0.15  # from what they say, beyond which it has slipped too [rad]
PATH_STEP_M = 0.05  # between corners of a path


def check_strokes(settings: Settings, strokes: Sequence[tuple[int, float, float]], rig: LoneBall) -> None:
    """BadInput names a stroke (string, x0_mm, y0_mm) beyond the launcher's limits, or a table too short for a film."""
    check_radius(settings, rig.ball, "the balls of the camera file", "calibrate for these balls")
    fastest = max(settings.check_speed(string) for string, _, _ in strokes)
    for x0_mm, y0_mm in {(x, y) for _, x, y in strokes}:
        settings.stage_um(x0_mm, y0_mm)
    along = abs(float(rig.place @ np.array([math.cos(rig.azimuth), math.sin(rig.azimuth)])))
    room = rig.table.length / 2 + along - rig.ball.radius - CUSHION_GAP_M  # struck from one end to the other
    speed, _ = ball_speed_and_squirt(Constants(), Geometry(rig.ball), np.array([fastest]), *np.zeros((2, 1)))
    until = min(room / float(speed[0]), TRACK_LENGTH_S)
    seen = int((until - MIN_TRACK_S) * rig.camera.fps)
    if seen < MIN_TRACK_FRAMES:
        raise BadInput(
            f"a ball of {speed[0]:.1f} m/s is at the cushion after {seen} pictures of {rig.camera.fps:g} a second; "
            f"{MIN_TRACK_FRAMES} or more are needed: use a faster camera, or a longer table"
        )


class TableStriker:
    """A launcher and a camera at a table, as `run_campaign` strikes with them."""

    def __init__(self, rig: LoneBall, friction: float, played: int, total: int) -> None:
        """`friction` of the sliding ball [1]; `played` strokes into the campaign, to be played until `total` are."""
        self.rig, self.friction, self.played, self.total = rig, friction, played, total

    def __call__(self, string: int, x0_mm: float, y0_mm: float) -> CueShot:
        """Strike once and measure; a stroke that cannot be measured is made again."""
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
    stroke: LoneStroke, rig: LoneBall, friction: float, string: int, x0_mm: float, y0_mm: float
) -> CueShot:  # fmt: skip
    """Ball speed and squirt of a filmed stroke, x along the cue; BadInput where the film is too short."""
    times, xy = first_path(stroke, rig)
    asked = stroke.done.asked_speed
    read = read_track(times, xy, friction, max(rig.camera.sigma, 1e-6), x0_mm, y0_mm, rig.ball)
    one = (np.array([v]) for v in (asked, 1e-3 * x0_mm, 1e-3 * y0_mm))
    speed, squirt = (float(v[0]) for v in ball_speed_and_squirt(Constants(), Geometry(rig.ball), *one))
    miscue = read[0] < MIN_SPEED_RATIO * speed or abs(read[3] - squirt) > MAX_SQUIRT_ERROR
    return CueShot(string, asked, x0_mm, y0_mm, *read, miscue=miscue)


def first_path(stroke: LoneStroke, rig: LoneBall) -> tuple[Array, Array]:
    """Times (n,) [s] and places (n, 2) [m], x along the cue: at rest until 0, then free until the first cushion."""
    half = np.array([rig.table.length, rig.table.width]) / 2 - rig.ball.radius - CUSHION_GAP_M
    near = np.flatnonzero((np.abs(stroke.ball.xy) > half).any(axis=1))
    free = slice(0, int(near[0]) if near.size else None)
    times, xy = stroke.ball.time[free], turned(stroke.ball.xy[free] - stroke.start, -stroke.azimuth)
    early = times <= TRACK_LENGTH_S
    times, xy = times[early], xy[early]
    if len(times) < MIN_TRACK_FRAMES:
        raise BadInput(f"{len(times)} pictures of the ball before a cushion are too few; use a faster camera")
    speed = float(np.hypot(*np.polyfit(times, xy, 1)[0]))
    times = times - times[0] + float(np.hypot(*xy[0])) / max(speed, 1e-3)  # the hit at about 0
    rest = -HIT_PICTURES / rig.camera.fps  # one picture: what a place at rest is off by is the same in all of them
    return np.append(rest, times), np.concatenate([np.zeros((1, 2)), xy])


def measure_repeats(
    rig: LoneBall, strings: Sequence[int], repeats: int, report: Callable[[Repeated], None]
) -> tuple[Repeated, ...]:
    """Strike each string again and again, tip at the ball's centre.

    Args:
        rig: the table.
        strings: to be struck, 1 to 200.
        repeats: of each, 2 or more.
        report: called with the figures of each string once it is done.

    Raises:
        BadInput, LauncherError: as `LoneBall.strike`.
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


def _until_seen(rig: LoneBall, string: int, what: str) -> tuple[LoneStroke, Array]:
    """A stroke, and where its ball stopped (2,) [m]; nan where a pocket took it."""
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
    """Vectors (n, 2), turned to the left [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(xy @ np.array([[c, s], [-s, c]]))
