"""What is lacking over one variable (speed, slip, sidespin, angle, the order of clips), and at each rail.

In: residuals of balls in motion, or of velocities after impacts. Out: `Curve`s and `Rails`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from models.shot import RAIL_NAMES
from sysid.residuals.accelerations import Array, Phases
from sysid.residuals.bins import (
    ANGLE_EDGES_DEG,
    APPROACH_EDGES_M_S,
    MIN_CLIPS_FOR_ORDER,
    SIDESPIN_EDGES_RAD_S,
    SLIP_EDGES_M_S,
    SPEED_EDGES_M_S,
)
from sysid.residuals.functions.moving import along_way, headings
from sysid.residuals.functions.smooth import Columns, Explanation, Residuals, cosines, each, posterior
from sysid.residuals.impacts import Impacts
from sysid.residuals.localise import MIN_BLOCKS, MIN_IMPACTS, STATE_ERROR, clipped_jumps
from sysid.residuals.samples import Samples

Key = tuple[str, str, str]
Scans = dict[Key, Callable[[Residuals], "Explanation[Curve] | None"]]

CURVE_WAVES = 8
CURVE_POINTS = 41
CLIP_GROUPS = 5  # of the clips in their order, beside a curve


@dataclass(frozen=True)
class Curve:
    """What is lacking over one variable."""

    of: str  # "motion" or "impacts"
    name: str  # of what it is, in words
    variable: str
    unit: str
    quantity: str
    at: Array  # (n,) of the variable
    value: Array  # (n,) [m/s^2], of impacts [1]
    sd: Array  # (n,)
    data: Array  # (d, 3) of groups of residuals: the variable, the curve and what they lack beside it, its sd

    @property
    def key(self) -> Key:
        """What it is of, alike for every model."""
        return self.name, self.variable, self.quantity


@dataclass(frozen=True)
class Rails:
    """By how much balls leave each cushion faster than modelled, over their speed of approach."""

    names: tuple[str, ...]  # (r,) "+x", "-x", "+y", "-y", those that were hit often enough
    value: Array  # (r,) [1]
    sd: Array  # (r,)


@dataclass(frozen=True)
class _Scanned:
    """A curve that is looked for: what it is of, the variable, and what one unit leaves in the residuals."""

    name: tuple[str, str, str, str, str]  # see Curve: of, name, variable, unit, quantity
    values: Array  # (b,) of the variable
    edges: Sequence[float]  # of groups, which are shown beside the curve
    leaves: Callable[[Array], Array]  # what accelerations or velocities (b, k) leave: (m, k)

    def __call__(self, residuals: Residuals) -> Explanation[Curve] | None:
        """The curve; None where the variable hardly varies."""
        values, edges, leaves = self.values, self.edges, self.leaves
        low, high = float(values.min()), float(values.max())
        group = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
        fewest = MIN_IMPACTS if self.name[0] == "impacts" else MIN_BLOCKS
        used = [k for k in range(len(edges) - 1) if np.sum(group == k) >= fewest]
        if not high > low or not used:
            return None
        middle, span = 0.5 * (low + high), np.array([high - low])
        basis, wave = cosines((values - middle)[:, None], span, (CURVE_WAVES,))
        design = leaves(basis)
        found = posterior(residuals, Columns(design, (wave > 0).astype(np.int64), wave, usual=0))
        at = np.linspace(low, high, CURVE_POINTS)
        value, sd = found.values(cosines((at - middle)[:, None], span, (CURVE_WAVES,))[0])
        explained = design @ found.mean
        inside = np.column_stack([group == k for k in used]).astype(float)
        where = (inside * values[:, None]).sum(axis=0) / inside.sum(axis=0)
        beside, beside_sd = each(residuals.without(explained), leaves(inside), found)
        data = np.column_stack([where, np.interp(where, at, value) + beside, beside_sd])
        return Explanation(Curve(*self.name, at, value, sd, data), found.evidence, explained)


def motion_curves(phases: Phases, samples: Samples, clips: int, who: str) -> Scans:
    """Of balls between impacts: accelerations along and across their way."""
    along = headings(phases, samples)
    ways = {"along": along, "across": np.column_stack([-along[:, 1], along[:, 0]])}
    wanted: list[tuple[str, str, Array, Sequence[float], str]] = [
        ("speed", "m/s", phases.mean(samples.speed), SPEED_EDGES_M_S, "along"),
        ("sidespin", "rad/s", phases.mean(samples.spin), SIDESPIN_EDGES_RAD_S, "across"),
    ]
    if who == "sliding balls":  # their friction depends on how they slip
        wanted = [("slip", "m/s", phases.mean(samples.slip), SLIP_EDGES_M_S, "along")]
    if clips >= MIN_CLIPS_FOR_ORDER:
        edges = tuple(np.linspace(0.5, clips + 0.5, CLIP_GROUPS + 1).tolist())
        number = phases.clip.astype(np.float64) + 1.0
        wanted.append(("number of the clip", "count", number, edges, "along"))
    return _by_key(
        _Scanned(("motion", who, variable, unit, f"acceleration {way} the way"), values, edges,
                 partial(along_way, phases, ways[way]))
        for variable, unit, values, edges, way in wanted
    )  # fmt: skip


def impact_curves(seen: Impacts, rows: NDArray[np.bool_], who: str, way: str) -> Scans:
    """Of velocities after some impacts, along normal or tangent."""
    weight = _weights(seen, rows)[:, None]
    return _by_key(
        _Scanned(("impacts", who, variable, unit, f"velocity along the {way}"), values, edges, lambda b: weight * b)
        for variable, unit, values, edges in (
            ("speed of approach", "m/s", seen.approach[rows], APPROACH_EDGES_M_S),
            ("angle from the normal", "degrees", np.degrees(seen.angle[rows]), ANGLE_EDGES_DEG),
        )
    )


def _by_key(scanned: Iterable[_Scanned]) -> Scans:
    return {(one.name[1], one.name[2], one.name[4]): one for one in scanned}


def _weights(seen: Impacts, rows: NDArray[np.bool_]) -> Array:
    """One over the standard deviations of velocities after some impacts."""
    return 1.0 / np.hypot(seen.sd[rows], STATE_ERROR)


def impact_residuals(seen: Impacts, rows: NDArray[np.bool_], axis: int) -> Residuals | None:
    """Velocities after some impacts over the approach, along normal (0) or tangent (1); each has a cause of its own."""
    count, weight = int(rows.sum()), _weights(seen, rows)
    if count < MIN_IMPACTS:
        return None
    return Residuals(clipped_jumps(seen)[rows, axis] * weight, weight, np.arange(count), count)


def rails_of(hit: NDArray[np.str_], residuals: Residuals) -> Explanation[Rails] | None:
    """By the rails that were hit (m,)."""
    names = [name for name in RAIL_NAMES if np.sum(hit == name) >= MIN_IMPACTS]
    if not names:
        return None
    design = np.column_stack([residuals.own * (hit == name) for name in names])
    alike = np.hstack([residuals.own[:, None], design])
    block = np.minimum(np.arange(len(names) + 1), 1)
    found = posterior(residuals, Columns(alike, block, np.zeros(len(block)), usual=0))
    return Explanation(Rails(tuple(names), *each(residuals, design, found)), found.evidence, alike @ found.mean)
