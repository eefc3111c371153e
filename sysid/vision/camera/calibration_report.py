"""A calibration on paper: its figures as text and JSON, and the picture with lines, edge points and a grid drawn in."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from models.files import write_whole
from sysid.vision.camera.calibrate import Calibration
from sysid.vision.camera.table_edges import nose_points

Picture = NDArray[np.uint8]
GRID_SPACING_M = 0.25  # of the lines drawn on the plane of the balls
MIN_REPORT_WIDTH_PX = 1000  # below which the text is not legible


def rows(found: Calibration) -> list[tuple[str, str]]:
    """What is printed and drawn: name and text of every figure."""
    camera, sides = found.camera, found.rails
    worst = max(sides, key=lambda rail: sides[rail])
    lost = 100 * (1 - found.lines.kept.mean())
    sure = f" +- {100 * found.focal_sd:.2g} %" if math.isfinite(found.focal_sd) else ""
    points = f"{found.lines.kept.sum()} on {len(sides)} sides, {lost:.0f} % left out" if found.edges else "none"
    known = f"sd {1e3 * found.spread[0]:.2f} mm rms, {1e3 * found.spread[1]:.2f} mm at worst" if found.edges else "-"
    k1_sd = found.lines.sd.get("k1", math.nan)
    k1 = f"{camera.distortion[0]:.4f}" + (f" +- {k1_sd:.4f}" if math.isfinite(k1_sd) else "")
    k2 = f", k2 {camera.distortion[1]:.4f}" if camera.distortion[1] else ""
    return [
        ("residual", f"{1e3 * camera.residual_m:.2f} mm rms, worst side {worst} {1e3 * sides[worst]:.2f} mm"),
        ("edge points", points),
        ("edge taken", found.edge),
        ("focal length", f"{camera.matrix[0, 0]:.0f} pixels{sure}, {found.fov:.1f} degrees across, {found.focal_from}"),
        ("height", f"{camera.eye[2]:.3f} m over the cloth"),
        ("tilt", f"{found.tilt:.2f} degrees"),
        ("distortion", f"k1 {k1}{k2}"),
        ("places of balls", known),
        (
            "focal length 10 % off",
            f"{1e3 * found.parallax[0]:.2f} mm rms, {1e3 * found.parallax[1]:.2f} mm at worst, places of balls",
        ),
    ]


def to_json(found: Calibration) -> dict[str, Any]:
    """The same figures, SI units."""
    camera = found.camera
    return {
        "format": "billiard-calibration/1", "residual_m": camera.residual_m, "sides_m": found.rails,
        "edge_points": int(found.lines.kept.sum()) if found.edges else 0,
        "set_aside": float(1 - found.lines.kept.mean()) if found.edges else math.nan,
        "edge": found.edge, "focal_px": camera.matrix[0, 0], "focal_from": found.focal_from,
        "focal_sd": found.focal_sd, "fov_deg": found.fov, "height_m": camera.eye[2], "tilt_deg": found.tilt,
        "distortion": camera.distortion.tolist(), "k1_sd": found.lines.sd.get("k1", math.nan),
        "place_sd_m": {"rms": found.spread[0], "worst": found.spread[1]},
        "focal_10_percent_off_m": {"rms": found.parallax[0], "worst": found.parallax[1]},
        "source": camera.source, "notes": list(found.notes), "doubts": list(found.doubts),
    }  # fmt: skip


def draw(path: Path, picture: Picture, found: Calibration) -> None:
    """The picture with the nose lines, the edge points by their residual, and a grid on the plane of the balls."""
    camera, canvas = found.camera, picture.copy()
    half = np.array([camera.table.length, camera.table.width]) / 2
    thick = max(1, round(picture.shape[1] / 1000))

    def draw(points: NDArray[np.float64], colour: tuple[int, int, int], width: int) -> None:
        # What lies far outside the picture may be folded back into it by the distortion.
        inside = np.abs(camera.on_plane(camera.project(points), float(points[0, 2])) - points[:, :2]).max(axis=1) < 1e-3
        pixels = np.rint(16 * camera.project(points[inside])).astype(np.int32)
        cv2.polylines(canvas, [pixels], False, colour, width, cv2.LINE_AA, 4)

    for axis in (0, 1):
        for k in range(-int(half[axis] / GRID_SPACING_M), int(half[axis] / GRID_SPACING_M) + 1):
            line = np.full((60, 3), camera.radius)
            line[:, axis], line[:, 1 - axis] = k * GRID_SPACING_M, np.linspace(-1, 1, 60) * half[1 - axis]
            draw(line, (235, 235, 235) if k else (255, 255, 0), thick)
    for rail in sorted(set(found.lines.rails.tolist())):
        along = np.linspace(-1, 1, 200) * half[1 - rail // 2]
        draw(nose_points(camera, rail, along, np.zeros(200)), (255, 0, 255), thick)
    unit = max(camera.residual_m, 1e-6)
    for (u, v), away, kept in zip(found.lines.pixels, found.lines.away, found.lines.kept, strict=True):
        outlying = min(abs(away) / (3 * unit), 1.0)
        colour = (0, int(255 * (1 - outlying)), int(255 * outlying)) if kept else (160, 160, 160)
        cv2.circle(canvas, (round(16 * u), round(16 * v)), 16 * (thick + 1), colour, cv2.FILLED, cv2.LINE_AA, 4)
    larger = max(1, -(-MIN_REPORT_WIDTH_PX // canvas.shape[1]))
    canvas = cv2.resize(canvas, None, fx=larger, fy=larger, interpolation=cv2.INTER_NEAREST)
    scale = canvas.shape[1] / 1600
    texts = [f"{name}: {text}" for name, text in rows(found)] + [f"NOT to be trusted: {t}" for t in found.doubts]
    below = np.zeros((int((14 + 24 * len(texts)) * scale), canvas.shape[1], 3), np.uint8)
    for k, text in enumerate(texts):
        place = (int(12 * scale), int((26 + 24 * k) * scale))
        cv2.putText(below, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.6 * scale, (255, 255, 255), 1, cv2.LINE_AA)
    canvas = np.vstack([canvas, below])
    write_whole(path, cv2.imencode(".png", canvas)[1].tobytes())
