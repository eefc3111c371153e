"""What rolling balls lack over the cloth: a push, and a change of speed, each a smooth function of the place.

In: residuals of rolling balls. Out: a `ClothField`.

A rolling ball lacks a = g(x, y) + h(x, y) d with its direction of motion d: a push g, the same whichever way it rolls,
down the gradient of a height (a slope, a hollow; the nap looks like a slope), and a change of speed h (more or less
friction, as on a worn patch). Height and h are smooth functions of the place (sysid/residuals/functions/smooth.py).

Left out: sliding balls, since friction where they slide hides a push; that friction may turn a ball.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.shot import Table
from sysid.residuals.accelerations import Array, Phases
from sysid.residuals.functions.moving import headings
from sysid.residuals.functions.smooth import Columns, Explanation, Residuals, cosines, posterior
from sysid.residuals.samples import Samples

CLOTH_WAVES = (16, 8)  # half waves along and across the table: of some 0.22 m on one of full size
FIELD_CELLS = (16, 8)  # in which the cloth is drawn, as long as the shortest half wave


@dataclass(frozen=True)
class ClothField:
    """What rolling balls lack over the cloth, in cells (nx, ny)."""

    x: Array  # (nx,) middles of cells [m]
    y: Array  # (ny,)
    push: Array  # (nx, ny, 2) along x and y [m/s^2]
    push_sd: Array  # (nx, ny) of each
    everywhere: tuple[float, float]  # change of speed along the way all over the cloth, and its sd [m/s^2]
    change: Array  # (nx, ny) beside that: below 0 where balls slow down more than elsewhere [m/s^2]
    change_sd: Array  # (nx, ny)
    crossed: NDArray[np.bool_]  # (nx, ny) where balls rolled


def _gradients(at: Array, size: Array, waves: Sequence[int]) -> Array:
    """Gradients of the same cosines but the constant: (n, k - 1, d) [1/m]."""
    step = 1e-6 * size
    sides = [[cosines(at + sign * shift, size, waves)[0] for sign in (1, -1)] for shift in np.diag(step)]
    found = [(after - before) / (2 * h) for (after, before), h in zip(sides, step, strict=True)]
    return np.stack(found, axis=-1)[:, 1:]


def _cloth_basis(at: Array, size: Array) -> tuple[Array, Array, Columns]:
    """What columns push (n, k, 2), and change along the way (n, k), at places (n, 2); the columns without a design.

    The columns are slopes along x and y, waves of the height, the same change everywhere, and its waves.
    """
    basis, wave = cosines(at, size, CLOTH_WAVES)
    slopes = np.broadcast_to(np.eye(2), (len(at), 2, 2))
    push = np.concatenate([slopes, -_gradients(at, size, CLOTH_WAVES)], axis=1)
    count, many = push.shape[1], len(wave)
    nothing = np.zeros((len(at), many, 2))
    block = np.repeat([0, 1, 2, 3], [2, many - 1, 1, many - 1])
    waves = np.concatenate([[0.0, 0.0], wave[1:], wave])
    return (
        np.concatenate([push, nothing], axis=1), np.hstack([np.zeros((len(at), count)), basis]),
        Columns(np.empty((0, count + many)), block, waves, usual=2),
    )  # fmt: skip


def cloth_field(phases: Phases, samples: Samples, table: Table, residuals: Residuals) -> Explanation[ClothField]:
    size = np.array([table.length, table.width])
    place = np.clip(phases.mean(samples.xy), -size / 2, size / 2)
    push, change, columns = _cloth_basis(place, size)
    acceleration = push + change[:, :, None] * headings(phases, samples)[:, None, :]
    design = np.concatenate([phases.response(acceleration[:, :, axis]) for axis in (0, 1)])
    found = posterior(residuals, dataclasses.replace(columns, design=design))
    middles = [(np.arange(n) + 0.5) / n * side - side / 2 for n, side in zip(FIELD_CELLS, size, strict=True)]
    grid = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, 2)
    pushes, changes, _ = _cloth_basis(grid, size)
    same = columns.block == 2
    alike, alike_sd = (float(one[0]) for one in found.values(same[None, :].astype(float)))
    (px, px_sd), (py, py_sd), (value, sd) = (
        (v.reshape(FIELD_CELLS), s.reshape(FIELD_CELLS))
        for v, s in map(found.values, (pushes[:, :, 0], pushes[:, :, 1], np.where(same, 0.0, changes)))
    )
    rolled = np.array([one == "roll" for one in samples.motion], dtype=bool)
    where = np.clip(((samples.xy[rolled] / size + 0.5) * FIELD_CELLS).astype(int), 0, np.array(FIELD_CELLS) - 1)
    crossed = np.zeros(FIELD_CELLS, dtype=bool)
    crossed[where[:, 0], where[:, 1]] = True
    push_sd = np.sqrt(0.5 * (px_sd**2 + py_sd**2))
    x, y = middles
    field = ClothField(x, y, np.stack([px, py], axis=-1), push_sd, (alike, alike_sd), value, sd, crossed)
    return Explanation(field, found.evidence, design @ found.mean)
