"""The cue before the strike: its axis, its tip in each picture, and its speed at contact.

In: pictures before a strike and the place of the struck ball. Out: `CueMotion`. Everything is measured on the plane of
the balls' centres, z = R, in which a level cue lies; how a raised cue would be misjudged is noted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from models.analytic.cueing import CueStick, miscue_limit
from models.errors import BadInput
from models.messages import counted
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.cue.axis import CueAxis, align_axis, candidate_axes, plane_pixels
from sysid.vision.cue.tip import tip_distances
from sysid.vision.sources.pictures import Picture

REPORTED_ELEVATION_RAD = math.radians(5.0)  # whose effect on direction and speed is noted
SPEED_WINDOW_S = 0.15  # before contact, from which the speed is taken
MAX_SPEED_FRAMES = 16  # of that window
MAX_SWING_RAD = math.radians(0.3)  # of the axis, above which a note is made
MAX_GAIN = 2.0  # of a ball's speed over the tip's: an elastic tip on a cue of any mass
MAX_TIP_FRICTION = 0.7  # of chalked leather, which is some 0.6
SURE_SD = 3.0  # beyond which a limit is passed for sure


@dataclass(frozen=True)
class CueMotion:
    """The motion of the cue up to the strike. Values are NaN where the pictures do not show them."""

    speed: float  # of its tip at contact [m/s]
    speed_sd: float
    acceleration: float  # at contact [m/s^2]; 0 where a constant speed explains the positions
    azimuth: float  # of its direction of travel [rad]
    azimuth_sd: float
    side: float  # offset of its axis from the centre of the ball, positive to the right as the player sees it [m]
    side_sd: float
    contact: float  # when the tip touches the ball [s]
    contact_sd: float
    time: Array  # (k,) of the pictures that show the tip [s]
    tip: Array  # (k, 2) position of the tip [m], table frame
    lean: float  # error of the azimuth per elevation of the cue [rad/rad]
    notes: tuple[str, ...] = ()  # for the user

    def off(self, azimuth: float) -> float:
        """Angle of the cue from another azimuth, counter-clockwise [rad]."""
        return math.remainder(self.azimuth - azimuth, 2 * math.pi)


def against_ball(cue: CueMotion, speed: float, radius: float) -> CueMotion:
    """The motion, without its figures where no cue that moves so can have given the ball its speed.

    Args:
        cue: as seen; an arm, a shadow or a line may have been followed instead.
        speed: of the ball after the strike [m/s].
        radius: of the ball [m].
    """
    if not math.isfinite(cue.azimuth):
        return cue
    # The dome of a tip touches nearer to the middle than its axis passes.
    why, farthest = "", miscue_limit(MAX_TIP_FRICTION) * (radius + CueStick.tip_radius)
    if abs(cue.side) - SURE_SD * cue.side_sd > farthest:
        why = f"a tip {1e3 * abs(cue.side):.0f} mm beside the ball's centre would slip off"
    elif speed > MAX_GAIN * (cue.speed + SURE_SD * cue.speed_sd):
        why = f"a tip at {cue.speed:.2f} m/s cannot give the ball {speed:.2f} m/s"
    if not why:
        return cue
    nan = math.nan
    return replace(
        cue, speed=nan, speed_sd=nan, acceleration=nan, azimuth=nan, azimuth_sd=nan, side=nan, side_sd=nan, contact=nan,
        contact_sd=nan, notes=(f"{why}: what was tracked is not the cue, and is left out",),
    )  # fmt: skip


def watch_cue(frames: Sequence[tuple[float, Picture]], camera: Camera, ball_xy: Array) -> CueMotion | None:
    """Measure the cue that is about to strike a ball; None where there is no cue.

    Args:
        frames: times [s] and pictures (height, width, 3) before the strike, and perhaps a few after it.
        camera: that took them.
        ball_xy: (2,) the struck ball's centre [m].
    """
    time = np.array([t for t, _ in frames], float)
    if len(frames) < 2 or np.any(np.diff(time) <= 0):
        raise BadInput(f"{len(frames)} frames at {time.tolist()[:4]}... s: give two or more, in order of time")
    ball = np.asarray(ball_xy, float).reshape(2)
    scale = camera.radius / float(camera.radius_px(ball[None])[0])  # of a pixel [m]
    pictures = [p for _, p in frames]
    axes = candidate_axes(pictures, camera, ball, scale)
    found = [fit for axis in axes if (fit := align_axis(axis, pictures, camera, scale)) is not None]
    if not found:
        return None
    axis, fits = max(found, key=lambda fit: float(fit[1][:, 5].sum()))
    contact = math.sqrt(max(camera.radius**2 - axis.side**2, 0.0))
    distance = tip_distances(axis, contact, pictures, camera, scale)
    return _motion(camera, axis, fits, time, distance, contact, scale)


def _motion(
    camera: Camera, axis: CueAxis, fits: Array, time: Array, distance: Array, contact: float, scale: float
) -> CueMotion:
    """The motion from the axis in pictures `fits` (k, 6) and the distances of the tip `distance` (n,) [m]."""
    tip = axis.points(contact + distance, np.zeros(1))[:, 0]
    seen, rows = np.flatnonzero(np.isfinite(distance)), plane_pixels(camera, np.nan_to_num(tip)[None])[0, :, 1]
    time = time + camera.row_delay(rows)
    notes: list[str] = []
    speed = _speed(time, distance, scale, notes)
    approaching = fits[np.isin(fits[:, 0], seen[distance[seen] > 0])]
    late = (approaching if len(approaching) else fits)[-8:]
    axis = axis.shifted(float(np.median(late[:, 1])), float(np.median(late[:, 2])))
    # Errors of the pictures of one stroke are correlated, as the same pixels see the same edges: no division by n.
    sd = np.sqrt(np.mean(late[:, 3:5] ** 2, axis=0) + np.var(late[:, 1:3], axis=0) / len(late))
    sd[0] = math.hypot(sd[0], 0.05 * scale)
    if np.ptp(late[:, 2]) > MAX_SWING_RAD + 4 * float(np.mean(late[:, 4])):
        notes.append(f"the cue swings by {math.degrees(float(np.ptp(late[:, 2]))):.2f} degrees")
    x, y = (camera.eye[:2] - axis.ball + contact * axis.direction) / (camera.eye[2] - camera.radius)
    (c, s), degrees = axis.direction, math.degrees(REPORTED_ELEVATION_RAD)
    lean = float(c * y - s * x)
    percent = 100 * (math.cos(REPORTED_ELEVATION_RAD) + math.sin(REPORTED_ELEVATION_RAD) * float(c * x + s * y) - 1)
    turned = f"turned by {lean * degrees:+.2f} degrees and {percent:+.1f} % faster"
    notes.append(f"a cue raised by {degrees:.0f} degrees would appear {turned}")
    return CueMotion(
        *speed[:3], math.remainder(axis.azimuth, 2 * math.pi), float(sd[1]), axis.side, float(sd[0]), *speed[3:],
        time[seen], tip[seen], lean, tuple(notes),
    )  # fmt: skip


def _speed(time: Array, distance: Array, scale: float, notes: list[str]) -> tuple[float, float, float, float, float]:
    """Speed, its sd and acceleration at contact; time of contact and its sd. Appends to `notes` where there is none."""
    touching = np.flatnonzero(distance < 0)
    seen = np.flatnonzero(np.isfinite(distance[: touching[0]] if len(touching) else distance))
    t, x = time[seen], distance[seen]
    first = max(len(x) - 1, 0)
    while first > 0 and x[first - 1] > x[first] - 0.05 * scale:  # it approaches
        first -= 1
    recent = np.arange(len(x)) >= max(first, len(x) - MAX_SPEED_FRAMES)
    recent &= t > (t[-1] if len(t) else 0.0) - SPEED_WINDOW_S
    t, x = t[recent], x[recent]
    if len(x) < 3 or x[0] - x[-1] < scale:
        notes.append(f"the tip approaches in only {counted(len(x), 'frame')} before contact: too few for a speed")
        return (math.nan,) * 5
    noise = 0.02 * scale
    if len(x) > 6:
        noise = max(noise, float(np.median(np.abs(np.diff(x, 3)))) / 0.6745 / math.sqrt(20))
    while True:
        value, spread = np.polyfit(t - t[-1], x, 1, cov=True)
        quadratic = np.polyfit(t - t[-1], x, 2, cov=True) if len(x) > 4 else None
        if quadratic is not None and abs(quadratic[0][0]) > 4 * math.sqrt(quadratic[1][0, 0]):
            value, spread = quadratic
        residual = x - np.polyval(value, t - t[-1])
        if residual @ residual < (1.8 * noise) ** 2 * (len(x) - len(value)) or len(x) <= 5:
            break
        t, x = t[1:], x[1:]
    until_contact = -float(value[-1] / value[-2])
    for _ in range(10):
        until_contact -= float(np.polyval(value, until_contact) / np.polyval(np.polyder(value), until_contact))
    speed = -float(np.polyval(np.polyder(value), until_contact))
    if not speed > 0 or not until_contact > -2 * SPEED_WINDOW_S:
        notes.append("the cue stops short of the ball: no speed")
        return (math.nan,) * 5
    if until_contact > 0.05:
        notes.append(f"the frames end {until_contact:.3f} s before contact: the speed is extrapolated")
    powers = np.arange(len(value))[::-1]
    place, rise = until_contact**powers, powers * until_contact ** np.maximum(powers - 1, 0)
    # The front of a tip is known to half a pixel.
    contact_sd = math.sqrt(place @ spread @ place + (0.5 * scale) ** 2) / speed
    acceleration = 0.0 - float(np.polyval(np.polyder(value, 2), until_contact))
    return speed, math.sqrt(rise @ spread @ rise), acceleration, float(t[-1]) + until_contact, contact_sd
