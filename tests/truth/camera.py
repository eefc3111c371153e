"""What the camera makes of the motion: stamps, image, readout, noise and lost frames.

The reported place of a ball truly at x is the chain of scale, aspect, tilt, lens and shake, each exact by itself:

    x (1 + image_scale)    x (1 + aspect), y (1 - aspect)
    x / (1 + k x + k/2 y)    x (1 - lens r^2 - lens4 r^4)

and then x + shake sin(2 pi f t + phase) along x.

A rolling shutter reads a ball at the time t + shutter y, y its place at t. Before the stroke the balls lie still.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tests.truth.cloth import Array, Constants
from tests.truth.physics import STEP, Motion, Start, Table, simulate

PHASE = 2.4  # of the camera's swing from clip to clip: they begin all round the circle [rad]
FAR = (0.02, 0.08)  # nearest and farthest that an outlier is displaced [m]


@dataclass(frozen=True)
class Camera:
    """What the camera sees, and how well."""

    fps: float = 120.0  # [1/s]
    sigma: float = 0.0005  # noise of a position, one standard deviation per axis [m]
    sigma_theta: float = 0.02  # noise of the mark's angle [rad]
    marked: bool = False  # does the struck ball bear a mark in every clip? Otherwise only one spun by hand does
    missing: float = 0.01  # fraction of a ball's frames that are missing
    outliers: float = 0.0  # fraction of the positions that are displaced by some centimetres
    told: bool = True  # is the noise written to clips.toml?


def image(xy: Array, times: Array, c: Constants, clip: int = 1) -> Array:
    """Where balls at xy [m] at times [s] are reported in the clip of that number; xy and back: (n, nball, 2)."""
    xy = xy * (1.0 + c.image_scale)
    xy = xy * np.array([1.0 + c.image_aspect, 1.0 - c.image_aspect])
    xy = xy / (1.0 + c.camera_tilt * (xy[..., :1] + 0.5 * xy[..., 1:]))
    squared = np.sum(xy**2, axis=-1, keepdims=True)
    xy = xy * (1.0 - c.lens * squared - c.lens4 * squared**2)
    swing = c.shake * np.sin(2 * np.pi * c.shake_hz * times + PHASE * clip)
    return np.asarray(xy + np.stack([swing, np.zeros_like(swing)], axis=-1)[:, None])


def stamps(times: Array, c: Constants) -> Array:
    """What the camera's clock says at times: (n,) [s]."""
    return times * c.clock


def rolled(motion: Motion, table: Table, c: Constants, balls: Mapping[str, Start], step: float = STEP) -> Motion:
    """The motion with each ball's place, velocity, spin and angle as they are when its row is read."""
    if c.shutter == 0.0:
        return motion
    y = motion.xy[..., 1]
    read = np.maximum(motion.times[:, None] + c.shutter * np.where(np.isfinite(y), y, 0.0), 0.0)
    instants = np.unique(np.append(read, 0.0))
    fine = simulate(table, c, balls, instants, step)
    at = np.searchsorted(instants, read)
    xy, velocity, omega, theta = (
        np.stack([values[at[:, b], b] for b in range(len(motion.names))], axis=1)
        for values in (fine.xy, fine.velocity, fine.omega, fine.theta)
    )
    return replace(motion, xy=xy, velocity=velocity, omega=omega, theta=theta)


def displaced(xy: Array, fraction: float, rng: np.random.Generator) -> Array:
    """The positions with a fraction of them some centimetres off, any way: (n, nball, 2) [m]."""
    n, balls, _ = xy.shape
    way, far = rng.uniform(-np.pi, np.pi, (n, balls)), rng.uniform(*FAR, (n, balls))
    hit = rng.random((n, balls)) < fraction
    return np.asarray(xy + (hit * far)[..., None] * np.stack([np.cos(way), np.sin(way)], axis=-1))
