"""Shots that a model does not follow from any start: set aside by name, so that they do not pull the constants.

In: a fit from nothing (`FittedModel`), or held-out shots with their residuals. Out: the rows of shots that are lost.

A shot is lost if its residuals are not finite, or if it ends far from where it was seen and far beyond the others: a
track that is no shot of this table, two shots in one clip, another ball struck. An effect that the model lacks leaves
errors of millimetres to centimetres, in many shots.
"""

from __future__ import annotations

import numpy as np

from models.errors import BadInput
from sysid.estimation.problem import Array, Index
from sysid.estimation.shot_problem import ShotProblem

LOST_M = 0.3  # rms residual per axis from which a shot may be lost
LOST_RATIO = 20.0  # and over the median of all shots


def shot_errors(problem: ShotProblem, x: Array, c: Array) -> Array:
    """Rms residual of every shot per axis at initial states (n, p) and constants (q,): (n,) [m]."""
    r = problem.evaluate(x, np.tile(c, (len(x), 1)), np.arange(len(x)))
    count = np.maximum(np.isfinite(r).sum(axis=1), 1)
    return np.asarray(problem.noise * np.sqrt(np.nansum(r**2, axis=1) / count))


def lost_shots(errors: Array, typical: float) -> Index:
    """Shots that are lost, from their errors (n,) [m] and the median error of the training shots [m]."""
    return np.flatnonzero(~(errors <= max(LOST_M, LOST_RATIO * typical)))


def typical_error(errors: Array) -> float:
    """Median error of shots (n,) [m].

    Raises:
        BadInput: where most shots are lost, so that no constant means anything.
    """
    typical = float(np.median(errors))
    if not typical <= LOST_M:
        raise BadInput(
            f"most shots end {typical:.2g} m from where they were seen, from every start and spin that was tried; "
            "check the table's size, the units, and which ball is struck"
        )
    return typical


def said(problem: ShotProblem, rows: Index, errors: Array) -> tuple[str, ...]:
    """One line for each shot that is set aside."""
    return tuple(
        f"{problem.clips[k].file}: set aside, from every start and spin that was tried it ends {errors[k]:.2g} m away"
        for k in rows.tolist()
    )
