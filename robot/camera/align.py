"""The cue's direction in one picture from above, and how far the launcher's stand must still be turned.

The stand is turned by hand, watched by the camera over the table (Robotic Billiards 2015, section V). A cue at rest is
a thin bar that leads to the ball: in all directions around it, strips are looked for that stand out from what lies on
both sides in the same way. Sections across the best ones give both edges to a part of a pixel, and a robust line goes
through their middles; a taper is symmetric, so they lie on the axis.

The camera sees a plane through its eye and the axis. With n its normal, e the eye, and d = (cos a cos r, sin a cos r,
-sin r) the way of a cue raised by r that pushes along the azimuth a,

    n . d = 0,  hence  nx cos a + ny sin a = nz tan r,

which is solved for a; where the line passes the ball follows from n . (p - e) = 0 for a point p beside its centre.
Leaves out how far above or below the centre the axis passes, which shifts what is seen but does not turn it, and that
a shaft lit from one side seems to lie up to half a pixel to that side. The elevation is taken as told; what an error of
it does is noted.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from models.errors import BadInput
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.cue.axis import CUE_WIDTHS_M, SECTION_LENGTH_M, CueAxis, Image, fit_axis, plane_pixels, sample_colours
from sysid.vision.frames import Picture

ELEVATION = math.radians(6.5)  # of the launcher's cue
TOLERANCE = math.radians(0.1)  # within which a stand is aligned
REACH, FAR = 0.8, 1.2  # behind the ball in which a cue is looked for, and up to which its edges are measured [m]
LANE = 0.014  # from a cue's axis to what lies beside it [m]
BESIDE = 0.024  # of the ball's centre that its axis may pass [m]
WING = 0.020  # from a cue's axis up to which its sections go [m]
FINE = 4  # samples of them in a pixel
SOFT = 0.4  # blur with which their rise is taken [pixels]
STEEP = 3.0  # rise of an edge, at least [grey levels a pixel]
AROUND = 5  # sections that show what an edge is like
STEP = 0.012  # between places along a strip [m]
FAINT = 8.0  # contrast at which a strip begins to stand out [grey levels]
FEWEST = 0.06  # length of a strip that stands out, at least [m]
THIN, THIN_PX = 0.0065, 2.3  # width up to which it may be a chalk line [m], and as a camera blurs one [pixels]
LIGHT = 0.1  # by which light and pixels may shift the middles at one end [pixels]
TRIED, RIVAL = 6, 0.6  # strips that are measured; part of the best one's weight that makes it doubtful
NEAR = math.radians(6)  # by which a cue may be turned from one picture to the next [rad]
STEADY, ENOUGH = 5, 5  # pictures that are averaged, and that must be aligned one after another
MOVED = math.radians(0.05)  # between pictures, from which on the stand has been turned
CHANGED = 0.02  # of the turn that is told anew [degrees]


@dataclass(frozen=True)
class CueLine:
    """Where a cue at rest points."""

    azimuth: float  # in which it would push the ball [rad]
    azimuth_sd: float  # from the scatter of its edges, and what light does to them [rad]
    offset: float  # of its axis from the ball's centre, > 0 to the left of the aim [m]
    length: float  # of it that was seen and measured [m]
    noted: tuple[str, ...] = ()


@dataclass(frozen=True)
class Turn:
    """What to do with the stand."""

    degrees: float  # 0 or more
    side: str  # "left" (anticlockwise from above), "right", or "" where it is aligned

    def __str__(self) -> str:
        """For the operator."""
        if not self.side:
            return f"aligned ({self.degrees:.2f} degrees off)"
        way = "anticlockwise" if self.side == "left" else "clockwise"
        return f"turn {self.degrees:.2f} degrees to the {self.side} ({way})"


@dataclass(frozen=True)
class _Bar:
    """What was measured of a strip."""

    line: CueAxis
    sd: float  # of its slope
    count: int  # of sections
    width: float  # in the middle [m]
    steep: float  # rise at its edges, in the middle [grey levels a pixel]

    @property
    def weight(self) -> float:
        """How much of a bar it is: a cue's shadow is as long, but fainter."""
        return self.count * self.steep


def cue_direction(
    picture: Picture, camera: Camera, ball_xy: Array, elevation: float = ELEVATION, near: float | None = None
) -> CueLine:  # fmt: skip
    """Measure the cue that lies behind a ball.

    Args:
        picture: (height, width, 3) or (height, width).
        camera: that took it.
        ball_xy: (2,) the ball's centre [m].
        elevation: of the butt [rad].
        near: azimuth about which it is looked for alone, which is quicker [rad]; all around without.

    Raises:
        BadInput: no cue is seen, or the picture is not the camera's.
    """
    ball = np.asarray(ball_xy, float).reshape(-1)
    if ball.shape != (2,) or not np.isfinite(ball).all():
        raise BadInput(f"the ball is at {ball.tolist()}; give two numbers in metres")
    if not abs(elevation) < math.radians(60):
        raise BadInput(f"the cue's elevation is {elevation:g} rad; give radians, less than 1")
    if picture.shape[:2] != (camera.size[1], camera.size[0]):
        sizes = f"{picture.shape[1]} x {picture.shape[0]} pixels, the camera's file {camera.size[0]} x {camera.size[1]}"
        raise BadInput(f"the picture has {sizes}; calibrate with pictures of this size")
    scale = camera.radius / float(camera.radius_px(ball[None])[0])  # [m] a pixel
    tried = [_measured(strip, picture, camera, scale) for strip in _strips(picture, camera, ball, scale, near)]
    found = [bar for bar in tried if bar is not None and bar.width > max(THIN, THIN_PX * scale)]
    if not found:
        raise BadInput(
            f"no cue is seen behind the ball at {ball[0]:.3f}, {ball[1]:.3f} m; put it there with nothing over it, "
            "and light it so that it stands out from the cloth"
        )
    best = max(found, key=lambda bar: bar.weight)
    line, noted = best.line, []
    others = [bar for bar in found if _off(bar.line, line) > NEAR and bar.weight > RIVAL * best.weight]
    if others:
        way = math.degrees(math.remainder(others[0].line.azimuth, 2 * math.pi))
        noted.append(f"another bar leads to the ball at {way:.1f} degrees: take it away")
    azimuth, offset = _raised(line, camera, elevation)
    lean = _raised(line, camera, elevation + math.radians(1))[0] - azimuth
    noted.append(f"an elevation 1 degree higher would turn it by {math.degrees(lean):+.2f} degrees")
    length = SECTION_LENGTH_M * best.count
    return CueLine(azimuth, math.hypot(best.sd, LIGHT * scale / length), offset, length, tuple(noted))


def turn_for(line: CueLine, wanted: float, tolerance: float = TOLERANCE) -> Turn:
    """How the stand must be turned to a wanted azimuth; wanted and tolerance in [rad]."""
    off = math.remainder(wanted - line.azimuth, 2 * math.pi)
    side = "" if abs(off) <= tolerance else "left" if off > 0 else "right"
    return Turn(abs(math.degrees(off)), side)


def align(
    frames: Iterable[Picture], camera: Camera, wanted: float, ball_xy: Array | None = None, *,
    elevation: float = ELEVATION, tolerance: float = TOLERANCE, say: Callable[[str], None] = print,
) -> CueLine:  # fmt: skip
    """Say how to turn the stand, picture by picture, until it is aligned in five of them or there are no more.

    Args:
        frames: pictures as they come.
        camera: that takes them.
        wanted: azimuth of the plan [rad].
        ball_xy: (2,) of the ball that will be struck [m]; without, the cue ball is looked for in the first picture.
        elevation: of the butt [rad].
        tolerance: of the azimuth [rad].
        say: told what to do, when it changes.

    Returns:
        The last line, averaged over the pictures since it was turned last; `turn_for` says whether it is aligned.

    Raises:
        BadInput: there was no picture, no cue ball, or no cue in any of them.
    """
    recent: list[CueLine] = []
    told, told_degrees, row = "", math.inf, 0
    last: CueLine | None = None
    for picture in frames:
        if ball_xy is None:
            ball_xy = _cue_ball(picture, camera)
        try:
            line = _next(picture, camera, ball_xy, elevation, recent)
        except BadInput as error:
            recent, row = [], 0
            if str(error) != told:
                told, told_degrees = str(error), math.inf
                say(told)
            continue
        still = [one for one in recent if _off(one, line) < MOVED]
        recent = [*(still if len(still) == len(recent) else []), line][-STEADY:]
        last = _averaged(recent)
        turn = turn_for(last, wanted, tolerance)
        signed = turn.degrees if turn.side == "left" else -turn.degrees
        if abs(signed - told_degrees) > CHANGED or bool(turn.side) == told.startswith("aligned"):
            told, told_degrees = str(turn), signed
            say(told)
        row = row + 1 if not turn.side else 0
        if row == ENOUGH:
            return last
    if last is None:
        raise BadInput(told or "no picture came from the camera; see that it films")
    return last


def _next(
    picture: Picture, camera: Camera, ball_xy: Array, elevation: float, recent: Sequence[CueLine]
) -> CueLine:  # fmt: skip
    """The cue about where it was, or anywhere."""
    if recent:
        with contextlib.suppress(BadInput):
            return cue_direction(picture, camera, ball_xy, elevation, recent[-1].azimuth)
    return cue_direction(picture, camera, ball_xy, elevation)


def _off(one: CueLine | CueAxis, other: CueLine | CueAxis) -> float:
    """Angle between two cues [rad]."""
    return abs(math.remainder(one.azimuth - other.azimuth, 2 * math.pi))


def _averaged(lines: Sequence[CueLine]) -> CueLine:
    """The mean of lines that agree; pictures of a cue at rest err alike, so its sd does not shrink."""
    late = lines[-1]
    off = np.array([math.remainder(one.azimuth - late.azimuth, 2 * math.pi) for one in lines])
    sd = math.sqrt(float(np.mean([one.azimuth_sd**2 for one in lines])))
    azimuth = math.remainder(late.azimuth + float(off.mean()), 2 * math.pi)
    return replace(late, azimuth=azimuth, azimuth_sd=sd, offset=float(np.mean([one.offset for one in lines])))


def _cue_ball(picture: Picture, camera: Camera) -> Array:
    """Where the cue ball is seen: (2,) [m]."""
    from planner.from_picture import CUES
    from robot.camera.live import balls_in

    found = balls_in([picture], camera)
    name = next((name for name in CUES if name in found.names), None)
    if name is None:
        raise BadInput(f"no white ball among {', '.join(found.names)}; say where the cue ball is")
    return found.position[found.names.index(name)]


def _strips(picture: Picture, camera: Camera, ball: Array, scale: float, near: float | None) -> list[CueAxis]:
    """Lines to the ball along which a narrow strip stands out, the longest first."""
    step = max(scale, 0.0015)
    side = REACH + BESIDE + LANE + step
    ticks = np.arange(-side, side + step / 2, step)
    pixels = _between(camera, ball + np.stack(np.meshgrid(ticks, ticks), axis=-1), 16)
    view = cv2.GaussianBlur(np.nan_to_num(sample_colours(picture, pixels), nan=0.0), (0, 0), 0.8)
    view = np.asarray(view, np.float32).reshape(len(ticks), len(ticks), -1)
    behind = np.arange(camera.radius + 0.015, REACH, STEP)
    angles, sides = np.radians(np.arange(0, 360, 0.5)), np.arange(-BESIDE, BESIDE + 1e-9, 0.006)
    if near is not None:
        angles = near + np.arange(-NEAR, NEAR, angles[1])
    score = _standing(view, step, angles, sides, behind)
    found: list[CueAxis] = []
    for _ in range(TRIED):
        a, s = np.unravel_index(int(np.argmax(score)), score.shape)
        if score[a, s] * STEP < FEWEST:
            break
        about, fine = angles[a] + np.radians(np.arange(-0.8, 0.81, 0.1)), sides[s] + np.arange(-8, 8.1, 1.0) * 1e-3
        closer = _standing(view, step, about, fine, behind)
        i, j = np.nonzero(closer > 0.97 * closer.max())
        found.append(CueAxis(ball, float(about[i].mean()), float(fine[j].mean())))
        score[np.abs(np.angle(np.exp(1j * (angles - angles[a])))) < math.radians(2)] = 0
    return found


def _between(camera: Camera, points: Array, every: int) -> Array:
    """Pixels (n, m, 2) of an even grid of points (n, m, 2) [m]: one in so many is projected, the rest lie between."""
    some = [np.unique(np.append(np.arange(0, n, every), n - 1)) for n in points.shape[:2]]
    rows, columns = (
        np.stack([np.interp(np.arange(n), at, one) for one in np.eye(len(at))], axis=1)
        for n, at in zip(points.shape[:2], some, strict=True)
    )
    coarse = plane_pixels(camera, points[np.ix_(*some)])
    return np.asarray(np.stack([rows @ coarse[..., k] @ columns.T for k in (0, 1)], axis=-1))


def _standing(view: Image, step: float, angles: Array, sides: Array, behind: Array) -> Array:
    """How many places of strips at angles (n,) and sides (m,) stand out from both their sides alike: (n, m)."""
    middle = (view.shape[0] - 1) / 2
    way = np.exp(1j * angles)[:, None, None, None]
    lanes = sides[:, None, None] + np.array([0.0, -LANE, LANE])[:, None]
    spots = -1j * way * lanes - way * behind
    x, y = (np.clip(np.rint(v / step + middle), 0, 2 * middle).astype(int) for v in (spots.real, spots.imag))
    seen = view[y, x]  # (n, m, 3, stations, colours)
    left, right = seen[:, :, 0] - seen[:, :, 1], seen[:, :, 0] - seen[:, :, 2]
    alike = np.sum(left * right, axis=-1)
    least = np.sqrt(np.minimum(np.sum(left**2, axis=-1), np.sum(right**2, axis=-1)))
    stand = np.where(alike > 0.5 * least**2, least, 0.0)
    return np.asarray(np.clip(stand / FAINT - 1, 0, 1).sum(axis=2))


def _measured(line: CueAxis, picture: Picture, camera: Camera, scale: float) -> _Bar | None:
    """The line through the middles of a bar, as seen on the plane of the balls' centres."""
    step = max(scale / FINE, 1e-4)
    across = np.arange(-WING, WING + step / 2, step)
    behind = np.arange(camera.radius + 0.008, FAR, SECTION_LENGTH_M / 4)
    bar = None
    for _ in range(4):
        seen = sample_colours(picture, _between(camera, line.points(behind, across), 8))
        place, middle, width, steep = _sides(seen, behind, across, scale)
        fit = fit_axis(place, middle, width, scale)
        if fit is None:
            return None
        line = line.shifted(fit[0], fit[1])
        bar = _Bar(line, fit[3], fit[4], float(np.median(width)), float(np.median(steep)))
        if abs(fit[0]) < 1e-5 and abs(fit[1]) < 1e-5:
            break
    return bar


def _sides(seen: Image, behind: Array, across: Array, scale: float) -> tuple[Array, Array, Array, Array]:
    """Where sections of a strip (n, m, c) are steepest on both sides.

    How far behind (k,), their middle and width [m], and how steep [grey levels a pixel]. Half the way from the colour
    within to that without would err where one side of the shaft is lit and the other is not; the steepest place does
    not, since shades change slowly within.
    """
    count = max(1, round(SECTION_LENGTH_M / (behind[1] - behind[0])))
    n = len(behind) // count
    block = seen[: n * count].reshape(n, count, len(across), -1).mean(axis=1)
    place = behind[: n * count].reshape(n, count).mean(axis=1)
    whole = np.isfinite(block).all(axis=(1, 2))
    block, place = np.asarray(block[whole], float), place[whole]
    if len(place) < AROUND:
        return (np.zeros(0),) * 4
    pixel = scale / (across[1] - across[0])
    rise = gaussian_filter1d(block, SOFT * pixel, axis=1, order=1) * pixel
    rise[:, [0, 1, -2, -1]] = 0
    usual = uniform_filter1d(rise, AROUND, axis=0)  # a single section is noisy, and the edges are nearly straight
    rows, reach = np.arange(len(place)), np.arange(len(across))
    edges, steep = [], []
    for sign in (-1, 1):
        size = np.linalg.norm(usual, axis=2) * (sign * across > 0.3 * CUE_WIDTHS_M[0])
        peak = size.argmax(axis=1)
        way = usual[rows, peak] / np.maximum(size.max(axis=1), 1e-9)[:, None]
        along = np.einsum("nmc,nc->nm", rise, way)
        along[np.abs(reach - peak[:, None]) > pixel] = -np.inf
        peak = np.clip(along.argmax(axis=1), 1, len(across) - 2)
        below, top, above = (np.einsum("nc,nc->n", rise[rows, peak + k], way) for k in (-1, 0, 1))
        bend = np.minimum(below - 2 * top + above, -1e-9)
        edges.append(across[peak] + (across[1] - across[0]) * np.clip(0.5 * (below - above) / bend, -1, 1))
        steep.append(top)
    middle, width, least = 0.5 * (edges[0] + edges[1]), edges[1] - edges[0], np.minimum(*steep)
    good = (width > CUE_WIDTHS_M[0]) & (width < CUE_WIDTHS_M[1]) & (least > STEEP)
    return place[good], middle[good], width[good], least[good]


def _raised(line: CueAxis, camera: Camera, elevation: float) -> tuple[float, float]:
    """Azimuth [rad] and offset to the left [m] of the raised cue that is seen as a line on the balls' plane."""
    eye = camera.eye
    ends = np.column_stack([line.points(np.array([0.0, 1.0]), np.zeros(1))[:, 0], np.full(2, camera.radius)])
    normal = np.cross(ends[0] - eye, ends[1] - eye)
    level = math.hypot(normal[0], normal[1])
    part = normal[2] * math.tan(elevation) / level
    if abs(part) >= 1:
        raise BadInput(
            f"a cue raised by {math.degrees(elevation):.1f} degrees cannot be seen like this; check the camera"
        )
    around = math.atan2(normal[1], normal[0])
    ways = [math.remainder(around + s * math.acos(part), 2 * math.pi) for s in (-1, 1)]
    azimuth = min(ways, key=lambda a: abs(math.remainder(a - line.azimuth, 2 * math.pi)))
    left = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    centre = np.array([*line.ball, camera.radius])
    return azimuth, float(normal @ (eye - centre) / (normal @ left))
