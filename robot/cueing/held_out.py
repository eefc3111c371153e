"""Errors of a cueing map on held-out strokes.

In: the shots of a campaign with repeats (robot/cueing/campaign.py). Out: root mean square errors of ball speed and
squirt, by map, for a report (robot/cueing/report.py).

Whole strokes are held out with all their repeats. The map is fitted to all other shots, and again to a tenth of them,
but no fewer than a map needs. The noise floor is the scatter of repeats about their own mean,
sqrt(sum |x - mean|^2 / (shots - strokes)), which no map can beat.
Left out: errors between the positions of the grid.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.analytic.cue_impulse import Geometry
from models.shot import Array
from planner.launcher.cueing_map import CueingMap
from robot.cueing.campaign import CueShot
from robot.cueing.map_fit import MIN_SHOTS, fit_map

HELD_OUT_SHARE = 0.2  # of the strokes
Stroke = tuple[int, float, float]  # string, x0_mm, y0_mm


@dataclass(frozen=True)
class HeldOutErrors:
    """Root mean square errors of one map on held-out shots."""

    name: str
    trained_on: int  # shots
    speed_percent: float  # relative to each shot's ball speed [%]
    speed_m_s: float
    squirt_deg: float


@dataclass(frozen=True)
class MapComparison:
    """Errors of maps on the same held-out shots."""

    scores: tuple[HeldOutErrors, ...]  # the map from all other shots, the map from a tenth, the noise floor
    held: tuple[CueShot, ...]
    predicted: dict[str, tuple[Array, Array]]  # by name of the map: ball speed [m/s] and squirt [rad] of these shots
    whole: CueingMap
    tenth: CueingMap


def compare_maps(
    shots: Sequence[CueShot], rng: np.random.Generator, *, geometry: Geometry | None = None
) -> MapComparison:  # fmt: skip
    """Evaluate the cueing map on held-out strokes.

    Args:
        shots: a campaign with repeats.
        rng: chooses the strokes held out, and the tenth.
        geometry: of tip, cue and ball, as for `fit_map`.

    Raises:
        BadInput: too few shots for a map.
    """
    good = [s for s in shots if not s.miscue]
    strokes = sorted({(s.string, s.x0_mm, s.y0_mm) for s in good})
    out = {strokes[k] for k in rng.permutation(len(strokes))[: max(round(HELD_OUT_SHARE * len(strokes)), 1)]}
    train = [s for s in good if (s.string, s.x0_mm, s.y0_mm) not in out]
    held = [s for s in good if (s.string, s.x0_mm, s.y0_mm) in out]
    count = max(round(len(train) / 10), MIN_SHOTS)
    few = [train[k] for k in sorted(rng.permutation(len(train))[:count])]
    inputs, measured = stroke_table(held)
    whole, tenth = fit_map(train, geometry), fit_map(few, geometry)
    predicted, scores = {}, []
    for name, fitted, count in (("physical map", whole, len(train)), ("physical map, a tenth", tenth, len(few))):
        balls = fitted.predict(*inputs.T)
        predicted[name] = balls.ball_speed, balls.squirt
        scores.append(HeldOutErrors(name, count, *rms_errors(balls.ball_speed, balls.squirt, measured)))
    scores.append(HeldOutErrors("floor: repeats", len(held), *noise_floor(held)))
    return MapComparison(tuple(scores), tuple(held), predicted, whole, tenth)


def noise_floor(shots: Sequence[CueShot]) -> tuple[float, float, float]:
    """Scatter of repeats about their mean: of ball speed [%], [m/s] and squirt [deg]; nan without repeats."""
    groups: defaultdict[Stroke, list[tuple[float, float]]] = defaultdict(list)
    for s in shots:
        groups[s.string, s.x0_mm, s.y0_mm].append((s.ball_speed, s.squirt_rad))
    total, free = np.zeros(3), 0
    for group in groups.values():
        values = np.array(group)
        speed, squirt = np.sum((values - values.mean(axis=0)) ** 2, axis=0)
        total += speed / values[:, 0].mean() ** 2, speed, squirt
        free += len(values) - 1
    if not free:
        return math.nan, math.nan, math.nan
    part, speed, squirt = np.sqrt(total / free)
    return 100.0 * float(part), float(speed), math.degrees(float(squirt))


def stroke_table(shots: Sequence[CueShot]) -> tuple[Array, Array]:
    """Cue speed [m/s], x0_mm and y0_mm (n, 3); measured ball speed [m/s] and squirt [rad] (n, 2)."""
    inputs = np.array([(s.cue_speed, s.x0_mm, s.y0_mm) for s in shots], float).reshape(-1, 3)
    return inputs, np.array([(s.ball_speed, s.squirt_rad) for s in shots], float).reshape(-1, 2)


def rms_errors(speed: Array, squirt: Array, measured: Array) -> tuple[float, float, float]:
    """Root mean square errors of the ball's speed [%], [m/s] and of squirt [deg].

    Args:
        speed: predicted, (n,) [m/s].
        squirt: predicted, (n,) [rad].
        measured: speed [m/s] and squirt [rad] of the same shots, (n, 2).
    """
    errors = 100.0 * (speed / measured[:, 0] - 1.0), speed - measured[:, 0], np.degrees(squirt - measured[:, 1])
    percent, speed_m_s, squirt_deg = (float(np.sqrt(np.mean(v**2))) for v in errors)
    return percent, speed_m_s, squirt_deg
