"""What a model lacks: over the cloth, at the rails, and over speed, slip, spin, angle and the order of clips.

In: a `Comparison`. Out: a `Lacking`: a `ClothField`, `Rails` and `Curve`s, each with its uncertainty and its evidence,
for drawing. What is alike everywhere, a constant of the model has: it is no evidence of any of these.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from sysid.estimation.solver.blas import on_one_blas_thread
from sysid.residuals.comparison import Comparison
from sysid.residuals.functions.cloth_field import ClothField, cloth_field
from sysid.residuals.functions.curves import (
    Curve,
    Rails,
    Scans,
    impact_curves,
    impact_residuals,
    motion_curves,
    rails_of,
)
from sysid.residuals.functions.moving import phases_of_motion, residuals_of
from sysid.residuals.functions.smooth import Explanation, Residuals
from sysid.residuals.samples import Samples
from sysid.residuals.segment_fits import sidespin

Array = NDArray[np.float64]
T = TypeVar("T")


@dataclass(frozen=True)
class Lacking:
    """What a model lacks, each with its evidence; None where too little was seen."""

    cloth: Explanation[ClothField] | None
    rails: Explanation[Rails] | None
    curves: tuple[Explanation[Curve], ...]  # of each kind of residuals that which explains most, and more than these


@on_one_blas_thread
def lacking(comparison: Comparison, best: Comparison, like: Lacking | None = None) -> Lacking:
    """What a model lacks, from the residuals of segments and impacts.

    Args:
        comparison: of the model.
        best: of the best model of the same clips, whose sidespins are taken: until its effects are known, no track
            determines the sidespin.
        like: what another model lacks, for comparison: the same curves are computed.
    """
    seen, noise = comparison.impacts, comparison.noise_m
    samples = dataclasses.replace(comparison.segment_samples, spin=_sidespins(comparison.segment_samples, best))
    if not noise > 0:
        return Lacking(None, None, ())
    known = None if like is None else [one.found for one in like.curves]
    curves: list[Explanation[Curve] | None] = []
    cloth: Explanation[ClothField] | None = None
    rails: Explanation[Rails] | None = None
    for motion, who in (("roll", "rolling balls"), ("slide", "sliding balls")):
        phases = phases_of_motion(samples, motion, noise)
        if phases is None:
            continue
        scans = motion_curves(phases, samples, len(comparison.clips), who)
        if motion == "roll":
            field = partial(cloth_field, phases, samples, comparison.clip_set.table)
            cloth, curve = _pursued(residuals_of(phases), field, scans, known)
        else:
            curve = _best(residuals_of(phases), scans, known)
        curves.append(curve)
    for kind, who in (("cushion", "balls that leave a cushion"), ("hit ball", "balls hit by another")):
        rows = np.array([one == kind for one in seen.kind], dtype=bool)
        for axis, way in enumerate(("normal", "tangent")):
            residuals = impact_residuals(seen, rows, axis)
            if residuals is None:
                continue
            scans = impact_curves(seen, rows, who, way)
            if (kind, way) == ("cushion", "normal"):
                rails, curve = _pursued(residuals, partial(rails_of, np.array(seen.rail)[rows]), scans, known)
            else:
                curve = _best(residuals, scans, known)
            curves.append(curve)
    return Lacking(cloth, rails, tuple(curve for curve in curves if curve is not None))


def _best(residuals: Residuals, scans: Scans, known: Sequence[Curve] | None) -> Explanation[Curve] | None:
    """The curve that explains most, where it is likelier than none; one that is known in any case."""
    keys = list(scans) if known is None else [one.key for one in known if one.key in scans]
    fits = [fitted for key in keys if (fitted := scans[key](residuals)) is not None]
    best = max(fits, key=lambda one: one.evidence, default=None)
    return best if best is not None and (known is not None or best.evidence > 0) else None


def _pursued(
    residuals: Residuals, table: Callable[[Residuals], Explanation[T] | None], scans: Scans,
    known: Sequence[Curve] | None,
) -> tuple[Explanation[T] | None, Explanation[Curve] | None]:  # fmt: skip
    """What the table from above shows, and the curve that explains most, if that is more.

    They explain the same residuals in part: balls are fast in other places than where they are slow. So where the curve
    explains more, the table is of what is left beside it; where it explains less, there is none.
    """
    curve = _best(residuals, scans, known)
    if known is None or curve is None:
        plain = table(residuals)
        if curve is None or (plain is not None and plain.evidence >= curve.evidence):
            return plain, None
    return table(residuals.without(curve.explained)), curve


def _sidespins(samples: Samples, best: Comparison) -> Array:
    """Of the samples' balls in the whole shots of a model [rad/s]: (n,)."""
    found, ball = samples.spin.copy(), np.array(samples.ball)
    for clip, track in enumerate(best.tracks):
        for number, name in enumerate(track.names):
            rows = (samples.clip == clip) & (ball == name)
            found[rows] = sidespin(track, number, samples.time[rows])
    return found
