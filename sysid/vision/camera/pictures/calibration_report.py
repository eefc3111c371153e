"""The figures of a calibration, as text and as JSON."""

from __future__ import annotations

import math
from typing import Any

from sysid.vision.camera.calibrate import Calibration
from sysid.vision.camera.trust import FOCAL_ERROR


def rows(found: Calibration) -> list[tuple[str, str]]:
    """What is printed and drawn: name and text of every figure."""
    camera, sides = found.camera, found.rails
    worst = max(sides, key=lambda rail: sides[rail])
    lost = 100 * (1 - found.lines.kept.mean())
    sure = f" +- {100 * found.focal_sd:.2g} %" if math.isfinite(found.focal_sd) else ""
    points = f"{found.lines.kept.sum()} on {len(sides)} sides, {lost:.0f} % left out" if found.edges else "none"
    rms, most = place_sd(found)
    known = f"sd {1e3 * rms:.2f} mm rms, {1e3 * most:.2f} mm at worst" if math.isfinite(rms) else "-"
    k1_sd = found.lines.sd.get("k1", math.nan)
    k1 = f"{camera.distortion[0]:.4f}" + (f" +- {k1_sd:.4f}" if math.isfinite(k1_sd) else "")
    k2 = f", k2 {camera.distortion[1]:.4f}" if camera.distortion[1] else ""
    return [
        ("residual", f"{1e3 * camera.residual_m:.2f} mm rms, worst side {worst} {1e3 * sides[worst]:.2f} mm"),
        ("edge points", points),
        ("edge used", found.edge),
        ("focal length", f"{camera.matrix[0, 0]:.0f} pixels{sure}, {found.fov:.1f} degrees across; {found.focal_from}"),
        ("height", f"{camera.eye[2]:.3f} m above the cloth"),
        ("tilt", f"{found.tilt:.2f} degrees"),
        ("distortion", f"k1 {k1}{k2}"),
        ("ball positions", known),
        (
            "focal length 10 % off",
            f"{1e3 * found.parallax[0]:.2f} mm rms, {1e3 * found.parallax[1]:.2f} mm at worst, in ball positions",
        ),
    ]


def place_sd(found: Calibration) -> tuple[float, float]:
    """Standard deviation of balls' places, with that of the focal length: rms over the table, and most [m].

    NaN where it is not known.
    """
    if not found.edges:
        return math.nan, math.nan
    part = found.apart_sd / FOCAL_ERROR
    rms, most = (math.hypot(sd, part * moved) for sd, moved in zip(found.spread, found.parallax, strict=True))
    return rms, most


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
        "place_sd_m": dict(zip(("rms", "worst"), place_sd(found), strict=True)),
        "focal_10_percent_off_m": {"rms": found.parallax[0], "worst": found.parallax[1]},
        "diamonds": len(found.diamonds.pixels), "balls": len(found.balls.radius),
        "markers": [] if found.markers is None else found.markers.numbers.tolist(),
        "ball_size_ratio": found.balls.ratio(camera)[0], "source": camera.source,
        "notes": list(found.notes), "doubts": list(found.doubts),
    }  # fmt: skip
