"""Normal equations of windows for a fit and hundreds of candidate effects, one parameter after the other.

In: a fitted chain (chain.py), and effects that it lacks. Out: information and gradient of constants and parameters, for
each shot or all together. The matrices of thousands of parameters are large, so they are summed as they come, and are
never held for each window.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sysid.estimation.chains.chain import Chain, Gaps
from sysid.estimation.problem import CAUCHY_SD, Array, Index
from sysid.estimation.solver.least_squares import Moves, batches, weights
from sysid.estimation.solver.normal_equations import from_columns
from sysid.estimation.windows import Mask


class Beside(NamedTuple):
    """Parameters of a candidate effect, each probed by a finite difference."""

    chain: Chain  # its constants are those of the fit, followed by these
    off: Array  # (j,) values at which the effect does nothing
    probe: Array  # (j,) finite change of each, which serves as its unit
    impacts: tuple[str, ...] | None = None  # "ball", "cushion": impacts at which alone it acts; None: elsewhere too


def _derivatives(moved: Array, at: Array, steps: Array) -> Array:
    """Finite differences (k, n, m) of residuals (k, n, m) moved by steps (k,) from those at a point."""
    found = moved - at
    found /= steps[:, None, None]
    return np.nan_to_num(found, copy=False)


def _meetings(chain: Chain, rows: Array, last: Array, first: int) -> dict[str, Mask]:
    """Windows in which balls meet, or meet a cushion: those that a change of that restitution affects.

    `rows` and `last` are residuals and ends, of windows as they are and with each unknown moved; that of the first
    constant is `first`. Kinds of impacts whose restitution is not fitted are left out.
    """
    found = {}
    for kind in ("ball", "cushion"):
        if (name := f"{kind}_impact.restitution") in chain.names:
            k = first + chain.names.index(name)
            moved = np.any(np.nan_to_num(rows[k] - rows[0]) != 0.0, axis=-1)
            found[kind] = moved | np.any(np.nan_to_num(last[k] - last[0]) != 0.0, axis=-1)
    return found


def _played_beside(
    one: Beside, x: Array, c: Array, which: Index, rows: Array, last: Array, meetings: dict[str, Mask]
) -> tuple[Array, Array]:
    """Residuals (j, w, m) and ends (j, w, p) of windows with each parameter of an effect moved.

    Windows without an impact at which it acts are unchanged.
    """
    more, some = one.off.size, np.arange(len(which))
    if one.impacts is not None and all(kind in meetings for kind in one.impacts):
        some = np.flatnonzero(np.any([meetings[kind] for kind in one.impacts], axis=0))
    changed, ends = np.tile(rows, (more, 1, 1)), np.tile(last, (more, 1, 1))
    if some.size:
        constants = np.hstack([np.tile(c, (more, 1)), one.off + np.diag(one.probe)])
        r, at_end = one.chain.play(
            np.tile(x[some], (more, 1)), constants.repeat(len(some), axis=0), np.tile(which[some], more)
        )
        changed[:, some, : r.shape[1]] = r.reshape(more, len(some), -1)
        ends[:, some] = at_end.reshape(more, len(some), -1)
    return changed, ends


def information_beside(
    chain: Chain, states: Array, c: Array, sd: Array, steps_c: Array, beside: Sequence[Beside], *, together: bool
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Information (n, u, u) and gradient (n, u) of constants and candidate effects, and the diagonal information (u,).

    For each shot with its states eliminated, or `together` with n = 1. The diagonal is of all shots, with states held.

    Args:
        chain: the windows.
        states: (w, p) of them.
        c: (q,) constants.
        sd: (k, p) of the gaps.
        steps_c: (q,) finite differences of the constants.
        beside: candidate effects, whose parameters follow the constants.
        together: whether to sum over all shots.
    """
    w, (count, p) = chain.windows, states.shape
    own = np.concatenate([w.steps, steps_c])
    steps = np.concatenate([own, *(np.sign(one.probe) for one in beside)])
    size = len(steps) - p
    shot = np.zeros(count, np.int64)
    for number, run in enumerate(w.runs):
        shot[run] = 0 if together else number
    groups = 1 if together else len(w.runs)
    rows, gradient = np.empty((count, p, len(steps))), np.empty((count, len(steps)))
    shared, ends = np.zeros((groups, size, size)), np.empty((1 + len(steps), count, p))
    for which in batches(w.lengths):
        moves = Moves.of(states[which], c, which, w.steps, steps_c, free=w.free[which])
        played, last = (moves.laid_out(part) for part in chain.play(moves.x, moves.c, moves.which))
        meetings = _meetings(chain, played, last, 1 + p)
        ends[: len(last), which] = last
        columns, at = [*_derivatives(played[1:], played[0], own)], len(last)
        for one in beside:
            more = one.off.size
            changed, last = _played_beside(one, states[which], c, which, played[0], ends[0, which], meetings)
            columns += [*_derivatives(changed, played[0], np.sign(one.probe))]
            ends[at : at + more, which] = last
            at += more
        for window, part in zip(which, from_columns(played[0], columns, CAUCHY_SD), strict=True):
            rows[window], gradient[window] = part.matrix[0, :p], part.gradient[0]
            shared[shot[window]] += part.matrix[0, p:, p:]
    ends[1:] = np.nan_to_num((ends[1:] - ends[0]) / steps[:, None, None])
    gaps = Gaps.of(chain, states, ends, sd)
    before, z = w.following[0], np.nan_to_num(gaps.z)
    weighted = gaps.derivatives * weights(gaps.z, CAUCHY_SD)
    rows[before] += np.moveaxis(weighted[:p], 0, 1) @ np.moveaxis(gaps.derivatives, 0, 2)
    gradient[before] += np.einsum("ukp,kp->ku", weighted, z)
    for number in range(groups):
        some = shot[before] == number
        shared[number] += weighted[p:, some].reshape(size, -1) @ gaps.derivatives[p:, some].reshape(size, -1).T
    alone, found = shared.sum(axis=0).diagonal().copy(), np.zeros((groups, size))
    joined = gaps.joined(rows, gradient, [np.zeros((0, 0))] * len(w.runs))
    for run, of_shot in zip(w.runs, joined, strict=True):
        number, follow = shot[run[0]], of_shot.solved(0.0)
        shared[number] -= of_shot.by_constant.T @ follow[:, :-1]
        found[number] += of_shot.constant_gradient - of_shot.by_constant.T @ follow[:, -1]
    return shared, found, alone
