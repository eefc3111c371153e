"""Common parts of all least-squares problems here: the unknowns of a moving ball, and the constants.

In: a model, the names of its constants, initial states. Out: steps, bounds and priors of the constants; a moving ball.

The initial state of a shot, or of a segment, is the moving ball's position (2) [m], velocity (2) [m/s] and surface
speed of its spin, R omega (3) [m/s], all in a frame turned into the direction of motion: along, across, up. A rolling
ball has R omega across equal to its speed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from models.engine.play import lacking
from models.model_file import Model
from models.shot import MAX_BREAK_SPEED_M_S, Ball, Table
from sysid.estimation.solver.joint_fit import SharedConstants
from sysid.estimation.solver.least_squares import Prior

Array = NDArray[np.float64]
Index = NDArray[np.int64]

STATE_STEPS = np.array([1e-6, 1e-6, 1e-5, 1e-5, 1e-4, 1e-4, 1e-4])  # finite differences, [m] and [m/s]
CONSTANT_STEP, VARIED_CONSTANT_STEP = 1e-5, 1e-3  # the same of constants, of their bounds' width
MAX_SPIN_M_S = 20.0  # largest surface speed of its spin: the miscue limit at that speed, with a margin
OPEN_TABLE_M = 1e3  # length and width of a table whose cushions are out of range
CAUCHY_SD = 4.0  # Cauchy's constant, in standard deviations


def by_events(model: Model) -> bool:
    """Whether the event engine can play a model; otherwise MuJoCo does."""
    return model.engine == "events" and not lacking(model)


def is_varied(model: Model) -> bool:
    """Whether effects act on balls in motion, so that the engine has adaptive steps."""
    return any(e.opens("forces") for e in model.stack())


def constant_steps(model: Model, names: Sequence[str]) -> Array:
    """Finite-difference steps of constants, from their bounds' width: (q,).

    They are larger if forces vary: the engine's adaptive steps then cause tiny jumps.
    """
    part = VARIED_CONSTANT_STEP if is_varied(model) else CONSTANT_STEP
    return np.array([part * np.subtract(*model.meta(n)["bounds"][::-1]) for n in names])


def constant_bounds(model: Model, names: Sequence[str]) -> Array:
    """(q, 2) bounds of constants."""
    return np.array([model.meta(n)["bounds"] for n in names])


def values_of(model: Model, names: Sequence[str]) -> Array:
    """Constants of a model as a vector: (q,)."""
    known = model.parameters()
    return np.array([float(known[n]) for n in names])


def turn(azimuth: float) -> Array:
    """Rotation that takes (along, across) to table axes: (2, 2)."""
    c, s = np.cos(azimuth), np.sin(azimuth)
    return np.array([[c, -s], [s, c]])


def state_bounds(table: Table, ball: Ball) -> Array:
    """Largest absolute values of the initial state of a moving ball: (7,)."""
    return np.array([*table.centre_limits(ball), *[MAX_BREAK_SPEED_M_S] * 2, *[MAX_SPIN_M_S] * 3])


def on_open_table(model: Model) -> Model:
    """The model on a table so large that no ball meets a cushion; sizes are not constants there."""
    table = dataclasses.replace(model.table, length=OPEN_TABLE_M, width=OPEN_TABLE_M, pockets=False)
    return dataclasses.replace(model, table=table, sizes={})


def shared_constants(
    model: Model, names: Sequence[str], known: Mapping[str, tuple[float, float]] | None = None
) -> SharedConstants:
    """Steps, bounds and priors (mean and standard deviation) of constants."""
    prior = None
    if known and any(n in known for n in names):
        prior = Prior(*np.array([known.get(n, (0.0, np.inf)) for n in names]).T)
    return SharedConstants(constant_steps(model, names), constant_bounds(model, names), prior)


def ball_of(x: Array, azimuth: float, radius: float) -> tuple[Array, Array, Array]:
    """Position (2,) [m], velocity (2,) [m/s] and spin (3,) [rad/s] of the moving ball of an initial state (7,)."""
    q = turn(azimuth)
    return x[:2], q @ x[2:4], np.array([*(q @ x[4:6]), x[6]]) / radius
