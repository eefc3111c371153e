"""How far tracked places may be off, beside the noise that differs from frame to frame.

In: tracks, their camera and noise. Out: `PlaceError`. Its parts are independent and are added as squares: noise; the
camera, as its calibration estimates; the centres of balls in the picture, which light and shadows shift by a fraction
of a pixel for as long as a ball is lit alike; and the moment at which a picture's rows were exposed. Places along a
ball's way say nothing about that moment: early and late rows give the same path at other times, and balls slow too
evenly to show the difference. Where the readout is not known, any up to the time between two pictures is as likely.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.vision.camera.projection import Array, Camera
from sysid.vision.tracks.following.follow import BallTrack

CENTRE_ERROR_PX = 0.17  # rms distance between the centre found and the true one, of balls at rest in rendered films
ERROR_LABELS = {"noise": "noise", "centre": "light on the balls", "camera": "camera", "readout": "unknown readout"}


@dataclass(frozen=True)
class PlaceError:
    """Rms distance of places from the true ones [m], and what it comes from; a part is 0 where it is not known."""

    noise: float = 0.0
    centre: float = 0.0  # of balls in the picture
    camera: float = 0.0
    readout: float = 0.0  # of a shutter whose readout is not known

    @property
    def rms(self) -> float:
        """Of all parts together [m]."""
        return math.hypot(*asdict(self).values())

    def text(self) -> str:
        """For the user."""
        parts = sorted(asdict(self).items(), key=lambda part: -part[1])
        each = ", ".join(f"{ERROR_LABELS[name]} {1e3 * value:.2f}" for name, value in parts if value > 0)
        return f"positions within {1e3 * self.rms:.2f} mm rms: {each}"


def place_error(
    clips: Sequence[Mapping[str, tuple[BallTrack, NDArray[np.int64]]]], camera: Camera, sigma: float, period: float
) -> PlaceError:
    """The error of places of clips, each given as a track of every ball and which of its detections are in the clip.

    Args:
        clips: what they show.
        camera: that took them.
        sigma: noise, standard deviation per axis [m]; NaN where it is not known.
        period: time between two pictures [s].
    """
    pixels, early = [], []
    slowest = replace(camera, readout=period)
    for clip in clips:
        for track, rows in clip.values():
            pixels.append(camera.radius / np.maximum(track.radius[rows], 1.0))
            if math.isnan(camera.readout) and len(track.time) > 2:
                speed = np.linalg.norm(np.gradient(track.xy, track.time, axis=0), axis=1)
                early.append((speed * slowest.row_delay(track.pixels[:, 1]))[rows])
    return PlaceError(
        noise=math.sqrt(2) * sigma if math.isfinite(sigma) else 0.0,
        centre=CENTRE_ERROR_PX * _rms(pixels),
        camera=camera.place_sd_m if math.isfinite(camera.place_sd_m) else 0.0,
        readout=_rms(early) / math.sqrt(3),  # any from none to the whole period
    )


def _rms(values: Sequence[Array]) -> float:
    """Root of the mean square of all values; 0 for none."""
    return float(np.sqrt(np.mean(np.concatenate(values) ** 2))) if values else 0.0
