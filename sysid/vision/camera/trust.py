"""Uncertainty of a calibration from the sides of a table, and doubts about it.

In: the fit of the camera. Out: standard deviations of places on the balls' plane, and messages on what contradicts it.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from models.shot import RAIL_NAMES
from sysid.vision.camera.pose import CameraFit, distances, fit_camera, moved
from sysid.vision.camera.projection import Array, Camera

MAX_BEND_M = 2e-3  # of a side from its line,
MAX_BEND_PX = 0.75  # or this if it is more; edges err by it, so another size of the table must explain more
MAX_OUTLINE_STEP_M = 0.015  # of the end of the cloth behind one nose relative to the others
MAX_PLACE_SD_M = 3e-3  # of a place on the table, at worst,
MAX_RMS_SD_M = 2.5e-3  # and rms over it
MAX_CORNER_RMS_PX = 2.0  # of corners given by hand
MAX_TILT_DEG = 70.0  # beyond which the table is hardly seen from above
OBLIQUE_DEG = 45.0  # beyond which a view is nearer to level than to straight down
MAX_OUTLIER_FRACTION = 0.4  # of the edge points
FOCAL_ERROR = 0.1  # relative, whose effect is reported
K1_PRIOR = {"k1": (0.0, 0.2)}  # mean and standard deviation of the distortion of lenses
SMALL_M = 2e-4  # by which places are moved to see how they depend on the camera,
SMALLER_STEPS = 0.25 ** np.arange(30)  # in the first of these parts of a standard deviation that moves them by less
ASSUMED_FOCAL = "the focal length is assumed"
SIDE_BINS = 12  # averages along a side
TABLE_SIZE_REMEDY = "check the table's length and width, or calibrate with --corners"  # kept in the camera's file


def with_focal(camera: Camera, focal: float) -> Camera:
    """The same view with another focal length [pixels], from another height."""
    ratio = focal / camera.matrix[0, 0]
    matrix = camera.matrix.copy()
    matrix[[0, 1], [0, 1]] *= ratio
    distortion = camera.distortion * np.array([ratio**2, ratio**4, ratio, ratio, ratio**6])
    translation = camera.translation * np.array([1.0, 1.0, ratio])
    return dataclasses.replace(camera, matrix=matrix, translation=translation, distortion=distortion)


def parallax(lines: CameraFit) -> tuple[float, float]:
    """Error on the balls' plane if the focal length is 10 % off, the rest fitted again: rms and worst [m]."""
    grid, pixels = _visible_places(lines.camera)
    free = ("k1",) if "k1" in lines.free else ()
    errors = []
    for factor in (1 - FOCAL_ERROR, 1 + FOCAL_ERROR):
        other = with_focal(lines.camera, lines.camera.matrix[0, 0] * factor)
        other = fit_camera(other, lines.pixels[lines.kept], lines.rails[lines.kept], free, prior=K1_PRIOR).camera
        errors.append(np.linalg.norm(other.centres(pixels) - grid, axis=1))
    return float(np.sqrt(np.mean(np.square(errors)))), float(np.max(errors))


def uncertainty(lines: CameraFit) -> tuple[float, float]:
    """Standard deviation of places on the balls' plane, from the scatter of the edge points: rms and worst [m]."""
    grid, pixels = _visible_places(lines.camera)
    names = tuple(name for name in lines.free if name != "margin")
    rows = [*range(6), *(6 + lines.free.index(name) for name in names)]
    variances, directions = np.linalg.eigh(lines.covariance[np.ix_(rows, rows)])
    total = np.zeros(len(grid))
    for variance, direction in zip(variances, directions.T, strict=True):
        change = np.sqrt(max(variance, 0.0)) * direction
        # Both ways in small steps: over a standard deviation of a focal length that is hardly known, nothing is linear.
        for part in SMALLER_STEPS:
            ahead, behind = (moved(lines.camera, way * part * change, names).centres(pixels) for way in (1, -1))
            if max(np.abs(ahead - grid).max(), np.abs(behind - grid).max()) < SMALL_M:
                break
        else:
            return float("inf"), float("inf")
        total += np.sum(((ahead - behind) / (2 * part)) ** 2, axis=1)
    return float(np.sqrt(total.mean())), float(np.sqrt(total.max()))


def doubts(lines: CameraFit, found_focal: bool, only_edge: bool) -> list[str]:
    """Doubts about a fit to edge points.

    Args:
        lines: the fit.
        found_focal: whether its focal length was fitted, too.
        only_edge: whether the edge used is the end of the cloth, as there is none farther in.
    """
    messages = []
    table, drift = lines.camera.table, _drift(lines)
    limit = max(MAX_BEND_M, MAX_BEND_PX * lines.rms / lines.reprojection_error)
    if drift > limit:
        messages.append(
            f"the sides depart from lines by {1e3 * drift:.1f} mm, more than {1e3 * limit:.1f} mm: {TABLE_SIZE_REMEDY}"
        )
    if len(set(lines.rails.tolist())) == 4:
        free = ("margin", *(("k1",) if "k1" in lines.free else ()), *(("focal",) if found_focal else ()))
        wider = fit_camera(lines.camera, lines.pixels, lines.rails, free, prior={"focal": (0.0, 0.3), **K1_PRIOR})
        explained = lines.reprojection_error**2 - wider.reprojection_error**2  # [pixels^2]
        if explained > MAX_BEND_PX**2:
            way = "longer and wider" if wider.margin > 0 else "shorter and narrower"
            messages.append(
                f"a table {abs(2e3 * wider.margin):.0f} mm {way} than {table.length:g} x {table.width:g} m would"
                f" fit the sides better: {TABLE_SIZE_REMEDY}"
            )
        elif only_edge and found_focal and wider.total_sd["margin"] > 0.01:
            messages.append(
                "the only edge seen may be the outer one of the cushions: calibrate with --fov or --corners"
            )
    place_sd = uncertainty(lines)[1]
    if place_sd > MAX_PLACE_SD_M:
        messages.append(f"positions are known to {1e3 * place_sd:.0f} mm only: show more of the sides, or film a board")
    outliers = 1 - float(lines.kept.mean())
    if outliers > MAX_OUTLIER_FRACTION:
        messages.append(f"{100 * outliers:.0f} % of the edge points lie off the lines: calibrate with --corners")
    return messages


def assumed_focal_doubts(shift: float, focal_sd: float, spread: float) -> list[str]:
    """Doubts about places where the focal length is assumed, and nothing but the sides shows it.

    Args:
        shift: rms error of places for a focal length that is 10 % off [m].
        focal_sd: of the focal length, relative.
        spread: standard deviation of places for that focal length, rms [m].
    """
    error = float(np.hypot(focal_sd / FOCAL_ERROR * shift, spread))
    if error < MAX_RMS_SD_M:
        return []
    return [
        f"{ASSUMED_FOCAL}, and may be wrong by {100 * focal_sd:.0f} %: positions would be wrong by {1e3 * error:.0f}"
        " mm; calibrate with --fov, or film a board"
    ]


def tilt(camera: Camera) -> float:
    """Of a camera's axis against the vertical [degrees]."""
    return float(np.degrees(np.arccos(np.clip(-camera.axes[2, 2], -1, 1))))


def oblique_notes(camera: Camera) -> list[str]:
    """Notes on a view that is nearer to level than to straight down."""
    if (lean := tilt(camera)) < OBLIQUE_DEG:
        return []
    return [
        f"an oblique view, {lean:.0f} degrees from the vertical: along the line of sight a pixel covers"
        f" {1 / max(np.cos(np.radians(lean)), 1e-3):.1f} times as much of the table, and balls hide each other;"
        " film from higher up"
    ]


def is_of_focal_length(doubt: str) -> bool:
    """Whether a doubt is that of an assumed focal length."""
    return doubt.startswith(ASSUMED_FOCAL)


def corner_doubts(first: CameraFit) -> list[str]:
    """Doubts about corners given by hand, beside which no edges were found."""
    lean = tilt(first.camera)
    error = float(np.sqrt(np.mean(first.away**2)))  # including outliers
    if error < MAX_CORNER_RMS_PX * first.camera.eye[2] / first.camera.matrix[0, 0] and lean < MAX_TILT_DEG:
        return []
    text = f"the corners given miss those of such a table by {1e3 * error:.0f} mm"
    return [f"{text}, seen at a tilt of {lean:.0f} degrees: give them anew"]


def outline_doubts(lines: CameraFit, first: CameraFit, left: int) -> list[str]:
    """Doubts about a side whose nose was not seen, by where the cloth ends behind it.

    Args:
        lines: the fit to the noses.
        first: the one to the outline of the cloth.
        left: the rail whose nose was not seen.
    """
    distance = distances(lines.camera, first.pixels, first.rails)
    behind = {rail: float(np.median(distance[first.rails == rail])) for rail in set(first.rails.tolist())}
    step = behind.pop(left) - float(np.mean(list(behind.values())))
    if abs(step) < MAX_OUTLINE_STEP_M:
        return []
    at = f"at {RAIL_NAMES[left]}, whose nose is not seen,"
    way = "out" if step > 0 else "in"
    return [f"{at} the cloth ends {1e3 * abs(step):.0f} mm farther {way} than at the other sides: {TABLE_SIZE_REMEDY}"]


def _visible_places(camera: Camera) -> tuple[Array, Array]:
    """Places on the table in the picture (n, 2) [m], and outline centres of balls there (n, 2) [pixels]."""
    half = np.array([camera.table.length, camera.table.width]) / 2 - camera.radius
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 13), np.linspace(-1, 1, 9)), axis=-1).reshape(-1, 2) * half
    pixels = camera.outline(grid)
    inside = ((pixels > 0) & (pixels < np.array(camera.size) - 1)).all(axis=1)
    return grid[inside], pixels[inside]


def _drift(lines: CameraFit) -> float:
    """Distance of the sides from their lines, averaged over bins to remove the scatter of points: rms [m]."""
    means = []
    for rail in set(lines.rails.tolist()):
        inliers = lines.kept & (lines.rails == rail)
        if inliers.any():
            order = np.argsort(lines.pixels[inliers][:, int(np.argmax(np.ptp(lines.pixels[inliers], axis=0)))])
            means += [part.mean() for part in np.array_split(lines.away[inliers][order], SIDE_BINS) if part.size > 2]
    return float(np.sqrt(np.mean(np.square(means)))) if means else lines.rms
