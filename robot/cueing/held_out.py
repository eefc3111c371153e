"""Errors of a cueing map on held-out strokes.

In: the shots of a campaign with repeats (robot/cueing/campaign.py). Out: root mean square errors of ball speed and
squirt, by map, for a report (robot/cueing/report.py).

Whole strokes are held out with all their repeats. The map is fitted to all other shots, and again to a tenth of them,
but no fewer than a map needs. The noise floor is the scatter of repeats about their own mean,
sqrt(sum |x - mean|^2 / (shots - strokes)), which no map can beat. If the exact outcome of a stroke is known
(emulated launcher), errors against it are given too.
Left out: errors between the positions of the grid.
"""

from __future__ import annotations

import dataclasses
import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from models.analytic.cue_impulse import Geometry
from models.shot import Array
from planner.launcher.cueing_map import CueingMap
from robot.cueing.campaign import CueShot
from robot.cueing.map_fit import MIN_SHOTS, fit_map

Stroke = tuple[int, float, float]  # string, x0_mm, y0_mm
Predict = Callable[[Array, Array, Array], tuple[Array, Array]]  # cue speed [m/s], x0_mm, y0_mm -> speed [m/s], squirt


@dataclass(frozen=True)
class HeldOutErrors:
    """Root mean square errors of one map on held-out shots; `exact`: against the error-free stroke, nan if unknown."""

    name: str
    trained_on: int  # shots
    speed_percent: float  # relative to each shot's ball speed [%]
    speed_m_s: float
    squirt_deg: float
    exact_speed_percent: float = math.nan
    exact_speed_m_s: float = math.nan
    exact_squirt_deg: float = math.nan


@dataclass(frozen=True)
class MapComparison:
    """Errors of several maps on the same held-out shots."""

    scores: tuple[HeldOutErrors, ...]  # other maps, the map from all shots, the map from a tenth, the noise floor
    held: tuple[CueShot, ...]
    predicted: dict[str, tuple[Array, Array]]  # by name of the map: ball speed [m/s] and squirt [rad] of these shots
    whole: CueingMap
    tenth: CueingMap


def compare_maps(
    shots: Sequence[CueShot],
    rng: np.random.Generator,
    *,
    geometry: Geometry | None = None,
    held_out: float = 0.2,
    exact: Callable[[Sequence[Stroke]], Mapping[Stroke, tuple[float, float]]] | None = None,
    fit_others: Callable[[Sequence[CueShot]], Mapping[str, Predict]] | None = None,
) -> MapComparison:
    """Evaluate the cueing map on held-out strokes.

    Args:
        shots: a campaign with repeats.
        rng: chooses the strokes held out, and the tenth.
        geometry: of tip, cue and ball, as for `fit_map`.
        held_out: fraction of the strokes.
        exact: ball speed [m/s] and squirt [rad] of error-free strokes, if known.
        fit_others: fits other maps to the same training shots, by name, for comparison.

    Raises:
        BadInput: too few shots for a map.
    """
    good = [s for s in shots if not s.miscue]
    strokes = sorted({(s.string, s.x0_mm, s.y0_mm) for s in good})
    out = {strokes[k] for k in rng.permutation(len(strokes))[: max(round(held_out * len(strokes)), 1)]}
    train = [s for s in good if (s.string, s.x0_mm, s.y0_mm) not in out]
    held = [s for s in good if (s.string, s.x0_mm, s.y0_mm) in out]
    count = max(round(len(train) / 10), MIN_SHOTS)
    few = [train[k] for k in sorted(rng.permutation(len(train))[:count])]
    others = fit_others(train) if fit_others is not None else {}
    inputs, measured = stroke_table(held)
    predicted = {name: (predict(*inputs.T), len(train)) for name, predict in others.items()}
    whole, tenth = fit_map(train, geometry), fit_map(few, geometry)
    for name, fitted, count in (("physical map", whole, len(train)), ("physical map, a tenth", tenth, len(few))):
        balls = fitted.predict(*inputs.T)
        predicted[name] = (balls.ball_speed, balls.squirt), count
    truth = np.full(measured.shape, np.nan)
    if exact is not None:
        known = exact(sorted(out))
        truth = np.array([known[s.string, s.x0_mm, s.y0_mm] for s in held])
    scores = [HeldOutErrors(k, n, *_rms(*pair, measured), *_rms(*pair, truth)) for k, (pair, n) in predicted.items()]
    scores.append(HeldOutErrors("floor: repeats", len(held), *noise_floor(held)))
    return MapComparison(tuple(scores), tuple(held), {k: pair for k, (pair, _) in predicted.items()}, whole, tenth)


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


def average_errors(comparisons: Sequence[MapComparison]) -> list[HeldOutErrors]:
    """Root mean squares of the errors over several splits, for each name."""
    out = []
    for same in zip(*(c.scores for c in comparisons), strict=True):
        values = {
            f.name: float(np.sqrt(np.mean([getattr(s, f.name) ** 2 for s in same])))
            for f in dataclasses.fields(HeldOutErrors)
            if f.name not in ("name", "trained_on")
        }
        out.append(HeldOutErrors(same[0].name, same[0].trained_on, **values))
    return out


def stroke_table(shots: Sequence[CueShot]) -> tuple[Array, Array]:
    """Cue speed [m/s], x0_mm and y0_mm (n, 3); measured ball speed [m/s] and squirt [rad] (n, 2)."""
    inputs = np.array([(s.cue_speed, s.x0_mm, s.y0_mm) for s in shots], float).reshape(-1, 3)
    return inputs, np.array([(s.ball_speed, s.squirt_rad) for s in shots], float).reshape(-1, 2)


def _rms(speed: Array, squirt: Array, right: Array) -> tuple[float, float, float]:
    """Errors of the ball's speed [%], [m/s] and of squirt [deg]; nan where the true values are nan."""
    errors = 100.0 * (speed / right[:, 0] - 1.0), speed - right[:, 0], np.degrees(squirt - right[:, 1])
    percent, speed_m_s, squirt_deg = (float(np.sqrt(np.mean(v**2))) for v in errors)
    return percent, speed_m_s, squirt_deg
