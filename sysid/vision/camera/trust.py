"""How far a calibration from a table's sides is to be trusted: what is uncertain, and what speaks against it."""

from __future__ import annotations

import dataclasses

import numpy as np

from models.shot import RAIL_NAMES
from sysid.vision.camera.pose import Fit, distances, fit, moved
from sysid.vision.camera.projection import Array, Camera

BEND = 2e-3, 0.75  # by which sides may leave their lines: [m], or [pixels] if that is more
LIKE = 6e-3  # by which they may fit a wider table better [m]
OUTLINE = 0.015  # by which the cloth may end farther out at one side than at the others [m]
VAGUE = 3e-3  # standard deviation of a place that is not trusted [m]
CLICK = 2.0  # rms by which corners given by hand may miss [pixels]
FLAT = 70.0  # tilt from which a table is hardly seen from above [degrees]
LOST = 0.4  # of the points that may be set aside
WRONG = 0.1  # error of the focal length whose effect is told [fraction]
K1 = {"k1": (0.0, 0.2)}  # what is expected of lenses
BINS = 12  # of a side
REMEDY = "check --length and --width, or give --corners"


def with_focal(camera: Camera, focal: float) -> Camera:
    """The same view with another focal length [pixels], from another height."""
    ratio = focal / camera.matrix[0, 0]
    matrix = camera.matrix.copy()
    matrix[[0, 1], [0, 1]] *= ratio
    distortion = camera.distortion * np.array([ratio**2, ratio**4, ratio, ratio, ratio**6])
    translation = camera.translation * np.array([1.0, 1.0, ratio])
    return dataclasses.replace(camera, matrix=matrix, translation=translation, distortion=distortion)


def parallax(lines: Fit) -> tuple[float, float]:
    """Error on the balls' plane if the focal length is 10 % off, all else fitted anew: rms and worst [m]."""
    grid, pixels = _seen(lines.camera)
    free = ("k1",) if "k1" in lines.free else ()
    errors = []
    for factor in (1 - WRONG, 1 + WRONG):
        other = with_focal(lines.camera, lines.camera.matrix[0, 0] * factor)
        other = fit(other, lines.pixels[lines.kept], lines.rails[lines.kept], free, prior=K1).camera
        errors.append(np.linalg.norm(other.centres(pixels) - grid, axis=1))
    return float(np.sqrt(np.mean(np.square(errors)))), float(np.max(errors))


def uncertainty(lines: Fit) -> tuple[float, float]:
    """Standard deviation of places on the balls' plane, from the scatter of the edge points: rms and worst [m]."""
    grid, pixels = _seen(lines.camera)
    names = tuple(name for name in lines.free if name != "margin")
    rows = [*range(6), *(6 + lines.free.index(name) for name in names)]
    sizes, ways = np.linalg.eigh(lines.covariance[np.ix_(rows, rows)])
    square = np.zeros(len(grid))
    for size, way in zip(sizes, ways.T, strict=True):
        other = moved(lines.camera, np.sqrt(max(size, 0.0)) * way, names)
        square += np.sum((other.centres(pixels) - grid) ** 2, axis=1)
    return float(np.sqrt(square.mean())), float(np.sqrt(square.max()))


def doubts(lines: Fit, found_focal: bool, only_edge: bool) -> list[str]:
    """What speaks against a fit to edge points.

    Args:
        lines: the fit.
        found_focal: whether its focal length was fitted too.
        only_edge: whether the edge taken is the end of the cloth, none lying farther in.
    """
    said = []
    table, drift = lines.camera.table, _drift(lines)
    limit = max(BEND[0], BEND[1] * lines.rms / lines.noise)
    if drift > limit:
        said.append(f"the sides leave their lines by {1e3 * drift:.1f} mm, {1e3 * limit:.1f} would pass: {REMEDY}")
    if len(set(lines.rails.tolist())) == 4:
        free = ("margin", *(("k1",) if "k1" in lines.free else ()), *(("focal",) if found_focal else ()))
        wider = fit(lines.camera, lines.pixels, lines.rails, free, prior={"focal": (0.0, 0.3), **K1})
        sure = max(LIKE, 4 * wider.wide["margin"])
        if abs(wider.margin) > sure and wider.noise < 0.8 * lines.noise:
            said.append(
                f"a table {2e3 * wider.margin:.0f} mm longer and wider than {table.length:g} x {table.width:g} m would"
                f" fit the sides better: {REMEDY}"
            )
        elif only_edge and found_focal and wider.wide["margin"] > 0.01:
            said.append(
                "the only edge seen may be the cushions' outer one, this view cannot tell: give --fov or --corners"
            )
    vague = uncertainty(lines)[1]
    if vague > VAGUE:
        said.append(f"places are known to {1e3 * vague:.0f} mm only: show more of the sides, or film a board")
    lost = 1 - float(lines.kept.mean())
    if lost > LOST:
        said.append(f"{100 * lost:.0f} % of the edge points lie off the lines: give --corners")
    return said


def corner_doubts(first: Fit) -> list[str]:
    """What speaks against corners given by hand, beside which no edges were found."""
    axis = float(np.degrees(np.arccos(np.clip(-first.camera.axes[2, 2], -1, 1))))
    missed = float(np.sqrt(np.mean(first.away**2)))  # with the points that the fit has set aside
    if missed < CLICK * first.camera.eye[2] / first.camera.matrix[0, 0] and axis < FLAT:
        return []
    text = f"the corners given miss those of such a table by {1e3 * missed:.0f} mm"
    return [f"{text}, seen at a tilt of {axis:.0f} degrees: give them anew"]


def outline_doubts(lines: Fit, first: Fit, left: int) -> list[str]:
    """Whether the cloth ends as far behind the nose that was left out as behind the others.

    Args:
        lines: the fit to the noses.
        first: the one to the outline of the cloth.
        left: the rail that was left out.
    """
    away = distances(lines.camera, first.pixels, first.rails)
    behind = {rail: float(np.median(away[first.rails == rail])) for rail in set(first.rails.tolist())}
    farther = behind.pop(left) - float(np.mean(list(behind.values())))
    if abs(farther) < OUTLINE:
        return []
    at = f"at {RAIL_NAMES[left]}, which is left out,"
    return [f"{at} the cloth ends {1e3 * farther:+.0f} mm farther out than at the other sides: {REMEDY}"]


def _seen(camera: Camera) -> tuple[Array, Array]:
    """Places on the table that are in the picture (n, 2) [m], and where they show a ball (n, 2) [pixels]."""
    half = np.array([camera.table.length, camera.table.width]) / 2 - camera.radius
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 13), np.linspace(-1, 1, 9)), axis=-1).reshape(-1, 2) * half
    pixels = camera.outline(grid)
    inside = ((pixels > 0) & (pixels < np.array(camera.size) - 1)).all(axis=1)
    return grid[inside], pixels[inside]


def _drift(lines: Fit) -> float:
    """How far the sides leave their lines, the scatter of single points left out: rms [m]."""
    means = []
    for rail in set(lines.rails.tolist()):
        own = lines.kept & (lines.rails == rail)
        if own.any():
            order = np.argsort(lines.pixels[own][:, int(np.argmax(np.ptp(lines.pixels[own], axis=0)))])
            means += [part.mean() for part in np.array_split(lines.away[own][order], BINS) if part.size > 2]
    return float(np.sqrt(np.mean(np.square(means)))) if means else lines.rms
