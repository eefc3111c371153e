"""The direction of a cue in one picture from above.

In: a picture, its calibrated camera, the ball's place. Out: a `CueLine`, azimuth and offset of the cue's axis.

A cue at rest is a thin bar that points to the ball: all directions around it are searched for strips that contrast
with the cloth on both sides in the same way. Sections across the best ones give both edges to a fraction of a pixel,
and a robust line is fitted to their middles; a taper is symmetric, so they lie on the axis.

The camera sees a plane through its eye and the axis. With n its normal, e the eye, and d = (cos a cos r, sin a cos r,
-sin r) the direction of a cue raised by r that pushes along the azimuth a,

    n . d = 0,  hence  nx cos a + ny sin a = nz tan r,

which is solved for a; the offset of the axis from the ball follows from n . (p - e) = 0 for a point p at the height of
its centre. Left out: the height at which the axis passes the centre, which shifts the image but does not turn it, and
that a shaft lit from one side appears up to half a pixel to that side. The elevation is given; the effect of an error
in it is reported.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from models.errors import BadInput
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.cue.axis import CUE_WIDTHS_M, SECTION_LENGTH_M, CueAxis, Image, fit_axis, plane_pixels, sample_colours
from sysid.vision.sources.pictures import Picture

SEARCH_LENGTH_M, EDGE_LENGTH_M = 0.8, 1.2  # behind the ball: where a cue is searched, where its edges are measured
LANE_OFFSET_M = 0.014  # from a cue's axis to the cloth beside it, with which it is compared
MAX_AXIS_OFFSET_M = 0.024  # of the cue's axis from the ball's centre
SECTION_HALF_WIDTH_M = 0.020  # of a section across the cue
SAMPLES_PER_PIXEL = 4  # along a section
EDGE_BLUR_PX = 0.4  # of a section before its slope is taken
MIN_EDGE_SLOPE = 3.0  # of an edge [grey levels a pixel]
EDGE_SECTIONS = 5  # neighbouring sections averaged to find an edge
STATION_STEP_M = 0.012  # distance between stations along a strip
MIN_CONTRAST = 8.0  # least contrast of a strip [grey levels]
MIN_STRIP_LENGTH_M = 0.06  # least length with that contrast
MAX_LINE_WIDTH_M, MAX_LINE_WIDTH_PX = 0.0065, 2.3  # largest width of a chalk line, true and as blurred by a camera
LIGHT_SHIFT_PX = 0.1  # shift of the middles at one end by light and pixels
MAX_STRIPS = 6  # most strips that are measured
RIVAL_WEIGHT = 0.6  # weight of a second strip over that of the best one that makes the result doubtful
NEAR_ANGLE = math.radians(6)  # largest turn of a cue from one picture to the next [rad]


@dataclass(frozen=True)
class CueLine:
    """The axis of a cue at rest, seen from above."""

    azimuth: float  # direction in which it would push the ball [rad]
    azimuth_sd: float  # from the scatter of its edges, and the shift by light [rad]
    offset: float  # of its axis from the ball's centre, > 0 to the left of the aim [m]
    length: float  # of the measured part [m]
    noted: tuple[str, ...] = ()  # warnings for the operator


@dataclass(frozen=True)
class _Bar:
    """A strip with measured edges."""

    line: CueAxis
    sd: float  # of its slope
    count: int  # of sections
    width: float  # in the middle [m]
    steep: float  # rise at its edges, in the middle [grey levels a pixel]

    @property
    def weight(self) -> float:
        """Length times edge slope: a cue's shadow is equally long, but fainter."""
        return self.count * self.steep


def cue_direction(
    picture: Picture, camera: Camera, ball_xy: Array, elevation: float, near: float | None = None
) -> CueLine:  # fmt: skip
    """Measure the cue that lies behind a ball.

    Args:
        picture: (height, width, 3) or (height, width).
        camera: that took it.
        ball_xy: (2,) the ball's centre [m].
        elevation: of the butt [rad].
        near: azimuth around which the search is limited, for speed [rad]; None for all directions.

    Raises:
        BadInput: no cue is found, or the picture has not the camera's size.
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
    found = [bar for bar in tried if bar is not None and bar.width > max(MAX_LINE_WIDTH_M, MAX_LINE_WIDTH_PX * scale)]
    if not found:
        raise BadInput(
            f"no cue was found behind the ball at {ball[0]:.3f}, {ball[1]:.3f} m; put it there, uncovered, "
            "and light it so that it contrasts with the cloth"
        )
    best = max(found, key=lambda bar: bar.weight)
    line, noted = best.line, []
    others = [
        bar for bar in found if angle_between(bar.line, line) > NEAR_ANGLE and bar.weight > RIVAL_WEIGHT * best.weight
    ]
    if others:
        azimuth_deg = math.degrees(math.remainder(others[0].line.azimuth, 2 * math.pi))
        noted.append(f"another bar points to the ball at {azimuth_deg:.1f} degrees: remove it")
    azimuth, offset = _raised(line, camera, elevation)
    lean = _raised(line, camera, elevation + math.radians(1))[0] - azimuth
    noted.append(f"an elevation 1 degree higher would turn it by {math.degrees(lean):+.2f} degrees")
    length = SECTION_LENGTH_M * best.count
    return CueLine(azimuth, math.hypot(best.sd, LIGHT_SHIFT_PX * scale / length), offset, length, tuple(noted))


def angle_between(one: CueLine | CueAxis, other: CueLine | CueAxis) -> float:
    """Angle between two cues [rad]."""
    return abs(math.remainder(one.azimuth - other.azimuth, 2 * math.pi))


def _strips(picture: Picture, camera: Camera, ball: Array, scale: float, near: float | None) -> list[CueAxis]:
    """Lines to the ball along which a narrow strip contrasts with the cloth, the longest first."""
    step = max(scale, 0.0015)
    side = SEARCH_LENGTH_M + MAX_AXIS_OFFSET_M + LANE_OFFSET_M + step
    ticks = np.arange(-side, side + step / 2, step)
    pixels = _between(camera, ball + np.stack(np.meshgrid(ticks, ticks), axis=-1), 16)
    view = cv2.GaussianBlur(np.nan_to_num(sample_colours(picture, pixels), nan=0.0), (0, 0), 0.8)
    view = np.asarray(view, np.float32).reshape(len(ticks), len(ticks), -1)
    behind = np.arange(camera.radius + 0.015, SEARCH_LENGTH_M, STATION_STEP_M)
    angles, sides = np.radians(np.arange(0, 360, 0.5)), np.arange(-MAX_AXIS_OFFSET_M, MAX_AXIS_OFFSET_M + 1e-9, 0.006)
    if near is not None:
        angles = near + np.arange(-NEAR_ANGLE, NEAR_ANGLE, angles[1])
    score = _standing(view, step, angles, sides, behind)
    found: list[CueAxis] = []
    for _ in range(MAX_STRIPS):
        a, s = np.unravel_index(int(np.argmax(score)), score.shape)
        if score[a, s] * STATION_STEP_M < MIN_STRIP_LENGTH_M:
            break
        about, fine = angles[a] + np.radians(np.arange(-0.8, 0.81, 0.1)), sides[s] + np.arange(-8, 8.1, 1.0) * 1e-3
        closer = _standing(view, step, about, fine, behind)
        i, j = np.nonzero(closer > 0.97 * closer.max())
        found.append(CueAxis(ball, float(about[i].mean()), float(fine[j].mean())))
        score[np.abs(np.angle(np.exp(1j * (angles - angles[a])))) < math.radians(2)] = 0
    return found


def _between(camera: Camera, points: Array, every: int) -> Array:
    """Pixels (n, m, 2) of an even grid of points (n, m, 2) [m]: some are projected, the others interpolated."""
    some = [np.unique(np.append(np.arange(0, n, every), n - 1)) for n in points.shape[:2]]
    rows, columns = (
        np.stack([np.interp(np.arange(n), at, one) for one in np.eye(len(at))], axis=1)
        for n, at in zip(points.shape[:2], some, strict=True)
    )
    coarse = plane_pixels(camera, points[np.ix_(*some)])
    return np.asarray(np.stack([rows @ coarse[..., k] @ columns.T for k in (0, 1)], axis=-1))


def _standing(view: Image, step: float, angles: Array, sides: Array, behind: Array) -> Array:
    """Number of stations at which strips at angles (n,) and offsets (m,) contrast equally with both sides: (n, m)."""
    middle = (view.shape[0] - 1) / 2
    direction = np.exp(1j * angles)[:, None, None, None]
    lanes = sides[:, None, None] + np.array([0.0, -LANE_OFFSET_M, LANE_OFFSET_M])[:, None]
    spots = -1j * direction * lanes - direction * behind
    x, y = (np.clip(np.rint(v / step + middle), 0, 2 * middle).astype(int) for v in (spots.real, spots.imag))
    seen = view[y, x]  # (n, m, 3, stations, colours)
    left, right = seen[:, :, 0] - seen[:, :, 1], seen[:, :, 0] - seen[:, :, 2]
    alike = np.sum(left * right, axis=-1)
    least = np.sqrt(np.minimum(np.sum(left**2, axis=-1), np.sum(right**2, axis=-1)))
    stand = np.where(alike > 0.5 * least**2, least, 0.0)
    return np.asarray(np.clip(stand / MIN_CONTRAST - 1, 0, 1).sum(axis=2))


def _measured(line: CueAxis, picture: Picture, camera: Camera, scale: float) -> _Bar | None:
    """The line through the middles of a bar, projected onto the plane of the balls' centres."""
    step = max(scale / SAMPLES_PER_PIXEL, 1e-4)
    across = np.arange(-SECTION_HALF_WIDTH_M, SECTION_HALF_WIDTH_M + step / 2, step)
    behind = np.arange(camera.radius + 0.008, EDGE_LENGTH_M, SECTION_LENGTH_M / 4)
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

    Returns distances behind the ball (k,), middles and widths [m], and slopes [grey levels a pixel]. The half-way level
    between the colours inside and outside would be biased if one side of the shaft is lit and the other is not; the
    steepest place is not, since shades change slowly inside.
    """
    count = max(1, round(SECTION_LENGTH_M / (behind[1] - behind[0])))
    n = len(behind) // count
    block = seen[: n * count].reshape(n, count, len(across), -1).mean(axis=1)
    place = behind[: n * count].reshape(n, count).mean(axis=1)
    whole = np.isfinite(block).all(axis=(1, 2))
    block, place = np.asarray(block[whole], float), place[whole]
    if len(place) < EDGE_SECTIONS:
        return (np.zeros(0),) * 4
    pixel = scale / (across[1] - across[0])
    rise = gaussian_filter1d(block, EDGE_BLUR_PX * pixel, axis=1, order=1) * pixel
    rise[:, [0, 1, -2, -1]] = 0
    usual = uniform_filter1d(
        rise, EDGE_SECTIONS, axis=0
    )  # a single section is noisy, and the edges are nearly straight
    rows, columns = np.arange(len(place)), np.arange(len(across))
    edges, steep = [], []
    for sign in (-1, 1):
        size = np.linalg.norm(usual, axis=2) * (sign * across > 0.3 * CUE_WIDTHS_M[0])
        peak = size.argmax(axis=1)
        colour = usual[rows, peak] / np.maximum(size.max(axis=1), 1e-9)[:, None]
        along = np.einsum("nmc,nc->nm", rise, colour)
        along[np.abs(columns - peak[:, None]) > pixel] = -np.inf
        peak = np.clip(along.argmax(axis=1), 1, len(across) - 2)
        below, top, above = (np.einsum("nc,nc->n", rise[rows, peak + k], colour) for k in (-1, 0, 1))
        bend = np.minimum(below - 2 * top + above, -1e-9)
        edges.append(across[peak] + (across[1] - across[0]) * np.clip(0.5 * (below - above) / bend, -1, 1))
        steep.append(top)
    middle, width, least = 0.5 * (edges[0] + edges[1]), edges[1] - edges[0], np.minimum(*steep)
    good = (width > CUE_WIDTHS_M[0]) & (width < CUE_WIDTHS_M[1]) & (least > MIN_EDGE_SLOPE)
    return place[good], middle[good], width[good], least[good]


def _raised(line: CueAxis, camera: Camera, elevation: float) -> tuple[float, float]:
    """Azimuth [rad] and offset to the left [m] of a raised cue from its projected line on the balls' plane."""
    eye = camera.eye
    ends = np.column_stack([line.points(np.array([0.0, 1.0]), np.zeros(1))[:, 0], np.full(2, camera.radius)])
    normal = np.cross(ends[0] - eye, ends[1] - eye)
    level = math.hypot(normal[0], normal[1])
    part = normal[2] * math.tan(elevation) / level
    if abs(part) >= 1:
        raise BadInput(
            f"a cue raised by {math.degrees(elevation):.1f} degrees cannot appear like this; check the camera"
        )
    around = math.atan2(normal[1], normal[0])
    solutions = [math.remainder(around + s * math.acos(part), 2 * math.pi) for s in (-1, 1)]
    azimuth = min(solutions, key=lambda a: abs(math.remainder(a - line.azimuth, 2 * math.pi)))
    left = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    centre = np.array([*line.ball, camera.radius])
    return azimuth, float(normal @ (eye - centre) / (normal @ left))
