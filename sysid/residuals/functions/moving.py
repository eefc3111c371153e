"""Residuals of balls that roll, or slide, as smooth functions are looked for in them.

In: samples of segments. Out: `Phases` of one kind of motion, and the rows that accelerations leave in them.
"""

from __future__ import annotations

import numpy as np

from sysid.residuals.accelerations import Array, Phases, phases_of
from sysid.residuals.functions.smooth import Residuals
from sysid.residuals.samples import Samples


def phases_of_motion(samples: Samples, motion: str, sigma: float) -> Phases | None:
    """Residuals of all phases of one kind of motion."""
    inside = np.array([one == motion for one in samples.motion], dtype=bool)
    if not inside.any():
        return None
    change = np.diff(inside.astype(int), prepend=0) != 0
    number = np.cumsum(change | (np.diff(samples.segment, prepend=-1) != 0))
    return phases_of(np.where(inside, number, -1), samples.clip, samples.time, -samples.residual, sigma)


def residuals_of(phases: Phases) -> Residuals:
    """Of both axes one after the other; a phase has an acceleration of its own along each."""
    own = phases.response(np.ones((len(phases.time), 1)))[:, 0]
    count = len(phases.first)
    group = np.concatenate([phases.phase, phases.phase + count])
    return Residuals(phases.residual.T.ravel(), np.tile(own, 2), group, 2 * len(phases.time) - 4 * count)


def along_way(phases: Phases, direction: Array, basis: Array) -> Array:
    """What accelerations (m, k) along unit vectors (m, 2) leave in both axes: (2m, k)."""
    return np.concatenate([phases.response(basis * direction[:, [axis]]) for axis in (0, 1)])


def headings(phases: Phases, samples: Samples) -> Array:
    """Directions of motion of blocks (m, 2)."""
    return phases.mean(np.column_stack([np.cos(samples.heading), np.sin(samples.heading)]))
