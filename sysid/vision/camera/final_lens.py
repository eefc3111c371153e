"""The last fit of a lens: its focal length and distortion, as far as the sides of the table determine them.

In: a fit to points along the sides. Out: the fit with what they determine, and how well they do so.
"""

from __future__ import annotations

import numpy as np

from sysid.vision.camera.pose import CameraFit, Mask, fit_camera
from sysid.vision.camera.trust import K1_PRIOR, with_focal

MAX_FITTED_FOCAL_SD = 0.2  # relative; above, the focal length is assumed rather than fitted
MAX_K2_ERROR_RATIO = 0.8  # of the reprojection errors with and without k2, up to which k2 is used


def with_lens(lines: CameraFit, focal: float, unknown: tuple[str, ...], sure: Mask) -> tuple[CameraFit, float]:
    """The final fit, with the intrinsic parameters that the lines determine; relative sd of the focal length or NaN.

    Where they do not determine the focal length, it is the one given, in pixels.
    """
    pixels, rails, focal_sd = lines.pixels, lines.rails, np.nan
    free = tuple(name for name in unknown if name != "focal")
    if "focal" in unknown:
        if "focal" in lines.free:
            lines = fit_camera(lines.camera, pixels, rails, unknown, prior={"focal": (0.0, 1.0), **K1_PRIOR}, sure=sure)
            focal_sd = lines.total_sd["focal"]
        if focal_sd < MAX_FITTED_FOCAL_SD:
            free = unknown
        else:
            focal_sd = np.nan
            lines = fit_camera(with_focal(lines.camera, focal), pixels, rails, free, prior=K1_PRIOR, sure=sure)
    if "k1" in unknown:
        more = fit_camera(lines.camera, pixels, rails, (*free, "k2"), prior=K1_PRIOR, sure=sure)
        if (
            more.reprojection_error < MAX_K2_ERROR_RATIO * lines.reprojection_error
            and more.kept.sum() >= 0.98 * lines.kept.sum()
        ):
            return more, focal_sd
    return lines, focal_sd
