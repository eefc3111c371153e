"""A camera from printed markers alone, which of them lie where they should, and what they say against a camera.

In: the markers of a picture, and a camera without pose. Out: `MarkerView`. Each marker gives three equations: its two
corners next to the bed lie a known margin outside of the nose, and its middle opposite to its place along the cushion.
All are fitted; where they contradict each other, the one or two are left out without which the others agree.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from models.messages import counted
from models.shot import NOSE_HEIGHT, RAIL_NAMES
from sysid.vision.camera.pose import distances, jacobian, moved
from sysid.vision.camera.printed.markers import Markers
from sysid.vision.camera.projection import Array, Camera

OUT_SD_M = 1.5e-3  # of a card's front edge from the nose, and of its height
ALONG_SD_M = 3e-3  # of its middle along the cushion
CORNER_SD_PX = 0.4  # of a corner in a picture
FOCAL_SD = 0.3  # of the logarithm of an unknown focal length
K1_SD = 0.1  # of the distortion
MIN_MARKERS = 4  # that agree
MAX_LEFT_OUT = 2
MIN_RAILS = 3  # on which they lie
MAX_EVALUATIONS = 10  # from a pose that is nearly right
POSE_UNKNOWNS = 6  # unknowns of it; those of the lens have priors
MAX_COST = 1.7  # of markers that agree, for each equation to spare
MAX_SD = 3.5  # of a marker among those that agree [standard deviations]
MAX_OUT_M = 6e-3  # of a card from the nose found,
MAX_ALONG_M = 0.015  # and from its place along it,
MAX_MISPLACED_PX = 2.5  # or these, if it is more
MAX_PRINT_ERROR = 0.015  # of the size of a print, relative
STAND_IN_POINTS = 12  # of a marker, where the nose beside it is not seen
LAY_REMEDY = "lay it as its sheet says"


@dataclass(frozen=True)
class MarkerView:
    """A camera from markers."""

    camera: Camera
    used: NDArray[np.bool_]  # (n,) which of the markers agree


def marker_errors(camera: Camera, markers: Markers) -> tuple[Array, Array]:
    """How far markers lie from their places: fronts out of the noses (n, 2), middles along them (n,) [m]."""
    pixels = markers.front.reshape(-1, 2)
    rails = np.repeat(markers.rails, 2)
    out = distances(camera, pixels, rails, markers.margin).reshape(-1, 2)
    xy = np.nan_to_num(camera.on_plane(pixels, NOSE_HEIGHT * camera.radius), nan=9.0)
    along = xy[np.arange(len(xy)), 1 - rails // 2].reshape(-1, 2).mean(axis=1)
    return out, along - markers.along


def marker_residuals(camera: Camera, markers: Markers) -> Array:
    """The same in standard deviations: (3 n,), those of the fronts first."""
    pixel = camera.eye[2] / camera.matrix[0, 0]
    out, along = marker_errors(camera, markers)
    both = out / np.hypot(OUT_SD_M, CORNER_SD_PX * pixel)
    return np.concatenate([both.ravel(), along / np.hypot(ALONG_SD_M, CORNER_SD_PX * pixel)])


def marker_view(start: Camera, markers: Markers, free: tuple[str, ...]) -> MarkerView | None:
    """The camera with which most markers agree; None where fewer than four do.

    Args:
        start: with its lens, without pose.
        markers: seen.
        free: unknown intrinsic parameters: "k1", "focal".
    """
    for left_out in range(min(MAX_LEFT_OUT, len(markers) - MIN_MARKERS) + 1):
        found = [
            one
            for lost in itertools.combinations(range(len(markers)), left_out)
            if (one := _agreeing(start, markers, lost, free)) is not None
        ]
        if found:
            return min(found, key=lambda pair: pair[0])[1]
    return None


def _agreeing(
    start: Camera, markers: Markers, lost: Sequence[int], free: tuple[str, ...]
) -> tuple[float, MarkerView] | None:
    """The cost and the camera of all markers but some; None where these do not agree."""
    used = np.ones(len(markers), bool)
    used[list(lost)] = False
    some = markers.where(used)
    if len(set(some.rails.tolist())) < MIN_RAILS:
        return None
    rough = _posed(start, some)
    if rough is None:
        return None

    def residuals(change: Array) -> Array:
        camera = moved(rough, change, free)
        priors = {"focal": float(change[6 + free.index("focal")]) / FOCAL_SD} if "focal" in free else {}
        priors |= {"k1": float(camera.distortion[0]) / K1_SD} if "k1" in free else {}
        return np.concatenate([marker_residuals(camera, some), list(priors.values())])

    zero = np.zeros(6 + len(free))
    fit = least_squares(residuals, zero, lambda c: jacobian(residuals, c), x_scale=0.01, max_nfev=MAX_EVALUATIONS)
    camera = moved(rough, fit.x, free)
    spare = 3 * len(some) - POSE_UNKNOWNS
    if camera.eye[2] <= 0 or 2 * fit.cost > MAX_COST * spare or np.abs(marker_residuals(camera, some)).max() > MAX_SD:
        return None
    return 2 * float(fit.cost), MarkerView(camera, used)


def _posed(start: Camera, markers: Markers) -> Camera | None:
    """The camera with a pose from the corners of markers, as if all were at the height of the noses."""
    half = np.array([start.table.length, start.table.width]) / 2
    points = []
    for rail, along in zip(markers.rails, markers.along, strict=True):
        axis, sign = rail // 2, 1.0 - 2.0 * (rail % 2)
        out = np.eye(2)[axis] * sign
        right = np.array([out[1], -out[0]])
        middle = out * (half[axis] + markers.margin) + np.eye(2)[1 - axis] * along
        for u, v in ((-0.5, 1.0), (0.5, 1.0), (0.5, 0.0), (-0.5, 0.0)):
            points.append([*(middle + markers.size * (u * right + v * out)), NOSE_HEIGHT * start.radius])
    good, turn, shift = cv2.solvePnP(np.array(points), markers.pixels.reshape(-1, 2), start.matrix, start.distortion)
    camera = dataclasses.replace(start, rotation=turn.ravel(), translation=shift.ravel())
    return camera if good and camera.eye[2] > 0 else None


def stand_ins(camera: Camera, markers: Markers) -> tuple[Array, NDArray[np.intp]]:
    """Points on the noses in front of markers, as a camera places them: pixels (m, 2), and the rail of each (m,)."""
    half = np.array([camera.table.length, camera.table.width]) / 2
    pixels: list[Array] = [np.zeros((0, 2))]
    for front, rail in zip(markers.front, markers.rails, strict=True):
        axis, sign = rail // 2, 1.0 - 2.0 * (rail % 2)
        out = np.eye(2)[axis] * sign * markers.margin
        xy = camera.on_plane(front, NOSE_HEIGHT * camera.radius) - out
        line = xy[0] + np.linspace(0, 1, STAND_IN_POINTS)[:, None] * (xy[1] - xy[0])
        if np.isfinite(line).all() and np.abs(line).max() < 2 * half.max():
            pixels.append(camera.project(np.column_stack([line, np.full(len(line), NOSE_HEIGHT * camera.radius)])))
    count = [STAND_IN_POINTS] * (len(pixels) - 1)
    return np.concatenate(pixels), np.repeat(markers.rails[: len(count)], count).astype(np.intp)


def print_ratio(camera: Camera, markers: Markers) -> tuple[float, float]:
    """Sides of markers over the size they should have, and the standard deviation of that; NaN without any."""
    if not len(markers):
        return np.nan, np.nan
    nose = NOSE_HEIGHT * camera.radius
    ends = [camera.on_plane(markers.front[:, k], nose) for k in (0, 1)]
    ratio = np.linalg.norm(ends[1] - ends[0], axis=1) / markers.size
    pixel = camera.eye[2] / camera.matrix[0, 0] / markers.size
    return float(np.median(ratio)), float(1.25 * np.hypot(CORNER_SD_PX * pixel, 0.005) / np.sqrt(len(markers)))


def misplaced(camera: Camera, markers: Markers) -> list[str]:
    """The markers that do not lie where they should, each with where it lies instead."""
    pixel = MAX_MISPLACED_PX * camera.eye[2] / camera.matrix[0, 0]
    outs, alongs = marker_errors(camera, markers)
    found = []
    for number, rail, out, along in zip(markers.numbers, markers.rails, outs, alongs, strict=True):
        where = []
        if np.abs(out).max() > max(MAX_OUT_M, pixel):
            where.append(f"{1e3 * out[np.argmax(np.abs(out))]:+.0f} mm out of the nose")
        if abs(along) > max(MAX_ALONG_M, pixel):
            where.append(f"{1e3 * along:+.0f} mm along it")
        if where:
            found.append(f"marker {number} lies {' and '.join(where)} from its place at {RAIL_NAMES[rail]}")
    return found


def marker_notes(camera: Camera, markers: Markers, view: MarkerView | None, seen: int) -> tuple[list[str], list[str]]:
    """What markers say of a camera: notes, and doubts.

    Args:
        camera: that was found.
        markers: seen.
        view: those that agree, and their own camera.
        seen: noses that were found.
    """
    if len(markers) < 2:  # one may be anything that looks like it
        return [], []
    if view is None and len(markers) < MIN_MARKERS:
        found = counted(len(markers), "marker")
        return [f"{found} seen, too few to be used: show {MIN_MARKERS} on {MIN_RAILS} cushions"], []
    wrong = misplaced(camera, markers)
    if view is None:
        named = "; ".join(wrong[:3]) or "any of them may be wrong"
        return [], [f"the markers contradict each other: {named}: lay them as their sheet says"]
    notes, doubts = [], []
    used = markers.where(view.used)
    amiss = misplaced(camera, used)
    others = [line for line in wrong if line not in amiss]
    errors = marker_errors(camera, used)[0]
    rms = float(np.sqrt(np.mean(errors**2)))
    notes.append(f"{counted(len(used), 'marker')}, front edges within {1e3 * rms:.1f} mm rms of the noses")
    doubts += [f"{line}: {LAY_REMEDY}, or the edge used there is not a nose" for line in amiss]
    left_out = markers.numbers[~view.used].tolist()
    sure = seen == 4 and len(left_out) == 1  # four that agree may do so by chance
    for line in others:
        (notes if sure else doubts).append(f"{line}: {LAY_REMEDY}" + "; it is left out" * sure)
    if len(left_out) > 1:
        doubts.append(f"markers {left_out[0]} and {left_out[1]} contradict the others: lay all as their sheet says")
    ratio, sd = print_ratio(camera, used)
    if abs(ratio - 1) > max(MAX_PRINT_ERROR, 3 * sd):
        doubts.append(
            f"the markers measure {1e3 * ratio * used.size:.0f} mm, not {1e3 * used.size:.0f}: print them at 100 %, or"
            " calibrate with --marker-size; or check the table's length and width"
        )
    return notes, doubts
