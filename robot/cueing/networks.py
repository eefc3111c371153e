"""The paper's two networks for ball speed and squirt, and the physical map beside them on strokes held out.

Robotic Billiards (2015), section V.C: feed-forward networks of 3-5-1 neurons, trained by back-propagation on cue speed,
x'0 and y'0. Here: tanh, inputs and output scaled to unit spread, trained by L-BFGS from several seeded starts; the one
with the least training loss counts. The paper tells no error of its own.

The comparison holds out whole strokes with all their repeats, trains on the rest, and tells root mean squares over the
shots held out. `floor` is what a perfect map would show: the scatter of repeats about their own mean. Where the
stroke's exact outcome is known (emulated), errors against it are told too. Leaves out how either map does off the grid.
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPRegressor
from threadpoolctl import threadpool_limits

from models.errors import BadInput
from planner.launcher.cueing_map import CueingMap
from robot.cueing.campaign import CueShot
from robot.cueing.map_fit import fit_map

Array = NDArray[np.float64]
NEURONS = 5  # in the one hidden layer (Robotic Billiards 2015)
STARTS = 8
ROUNDS = 3000  # of L-BFGS at most
Told = tuple[int, float, float]  # string, x0_mm, y0_mm


@dataclass(frozen=True)
class Networks:
    """A network for ball speed and one for squirt, with the scales of inputs and outputs."""

    nets: tuple[MLPRegressor, MLPRegressor]
    centre: Array  # of cue speed [m/s], x0_mm, y0_mm: (3,)
    width: Array  # (3,)
    out_centre: Array  # of ball speed [m/s] and squirt [rad]: (2,)
    out_width: Array  # (2,)
    converged: int  # starts of both networks that L-BFGS ended by itself

    def predict(self, cue_speed: Array, x0_mm: Array, y0_mm: Array) -> tuple[Array, Array]:
        """Ball speed [m/s] and squirt [rad] of strokes (n,)."""
        given = (np.stack([cue_speed, x0_mm, y0_mm], axis=-1) - self.centre) / self.width
        out = np.stack([net.predict(given) for net in self.nets], axis=-1) * self.out_width + self.out_centre
        return out[:, 0], out[:, 1]


def train_networks(shots: Sequence[CueShot], rng: np.random.Generator, starts: int = STARTS) -> Networks:
    """Train both networks; BadInput where there are fewer shots than weights."""
    rows, out = _table([s for s in shots if not s.miscue])
    weights = NEURONS * 5 + 1
    if len(rows) < weights:
        raise BadInput(f"{len(rows)} shots for {weights} weights of a 3-5-1 network; strike {weights} or more")
    centre, width = rows.mean(axis=0), np.maximum(rows.std(axis=0), 1e-9)
    out_centre, out_width = out.mean(axis=0), np.maximum(out.std(axis=0), 1e-9)
    given, wanted = (rows - centre) / width, (out - out_centre) / out_width
    nets, converged = [], 0
    for k in range(2):
        tried: list[tuple[float, int, MLPRegressor]] = []
        for _ in range(starts):
            net = MLPRegressor(
                hidden_layer_sizes=(NEURONS,), activation="tanh", solver="lbfgs", alpha=1e-6,
                max_iter=ROUNDS, max_fun=20 * ROUNDS, tol=1e-7, random_state=int(rng.integers(2**31)),
            )  # fmt: skip
            with warnings.catch_warnings(), threadpool_limits(1):  # matrices so small make threads wait for each other
                warnings.simplefilter("ignore", ConvergenceWarning)  # counted below instead
                net.fit(given, wanted[:, k])
            converged += net.n_iter_ < ROUNDS
            tried.append((float(net.loss_), len(tried), net))
        nets.append(min(tried)[2])
    return Networks((nets[0], nets[1]), centre, width, out_centre, out_width, converged)


@dataclass(frozen=True)
class Score:
    """Root mean square errors of one map on shots held out; `exact` against what is known of the stroke, or nan."""

    name: str
    trained_on: int  # shots
    speed_percent: float  # of the ball's speed, shot by shot
    speed_m_s: float  # the same, absolute: what the networks are trained to make small
    squirt_deg: float
    exact_speed_percent: float = math.nan
    exact_speed_m_s: float = math.nan
    exact_squirt_deg: float = math.nan


@dataclass(frozen=True)
class Contest:
    """What came of a comparison."""

    scores: tuple[Score, ...]  # networks, map from all shots, map from a tenth; floor last
    held: tuple[CueShot, ...]
    told: dict[str, tuple[Array, Array]]  # by name of the map: ball speed and squirt of the shots held
    networks: Networks
    whole: CueingMap
    tenth: CueingMap


def compare_maps(
    shots: Sequence[CueShot],
    rng: np.random.Generator,
    *,
    held_out: float = 0.2,
    starts: int = STARTS,
    exact: Callable[[Sequence[Told]], Mapping[Told, tuple[float, float]]] | None = None,
) -> Contest:
    """Networks and physical map on strokes that neither has seen.

    Args:
        shots: a campaign with repeats.
        rng: chooses the strokes held out, the tenth, and the networks' starts.
        held_out: part of the strokes.
        starts: of each network.
        exact: ball speed [m/s] and squirt [rad] of strokes without any error, where somebody knows.

    Raises:
        BadInput: too few shots for either map.
    """
    good = [s for s in shots if not s.miscue]
    strokes = sorted({(s.string, s.x0_mm, s.y0_mm) for s in good})
    out = {strokes[k] for k in rng.permutation(len(strokes))[: max(round(held_out * len(strokes)), 1)]}
    train = [s for s in good if (s.string, s.x0_mm, s.y0_mm) not in out]
    held = [s for s in good if (s.string, s.x0_mm, s.y0_mm) in out]
    few = [train[k] for k in sorted(rng.permutation(len(train))[: round(len(train) / 10)])]
    networks, whole, tenth = train_networks(train, rng, starts), fit_map(train), fit_map(few)
    rows, measured = _table(held)
    whole_told, tenth_told = (m.predict(*rows.T) for m in (whole, tenth))
    told = {
        "networks 3-5-1": (networks.predict(*rows.T), len(train)),
        "physical map": ((whole_told.ball_speed, whole_told.squirt), len(train)),
        "physical map, a tenth": ((tenth_told.ball_speed, tenth_told.squirt), len(few)),
    }
    truth = np.full(measured.shape, np.nan)
    if exact is not None:
        known = exact(sorted(out))
        truth = np.array([known[s.string, s.x0_mm, s.y0_mm] for s in held])
    scores = [Score(k, n, *_rms(*pair, measured), *_rms(*pair, truth)) for k, (pair, n) in told.items()]
    scores.append(Score("floor: repeats", len(held), *noise_floor(held)))
    return Contest(tuple(scores), tuple(held), {k: pair for k, (pair, _) in told.items()}, networks, whole, tenth)


def noise_floor(shots: Sequence[CueShot]) -> tuple[float, float, float]:
    """Scatter of repeats about their mean: of ball speed [%], [m/s] and squirt [deg]; nan without repeats."""
    groups: defaultdict[Told, list[tuple[float, float]]] = defaultdict(list)
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


def average(contests: Sequence[Contest]) -> list[Score]:
    """Root mean squares of the scores of several splits, name by name."""
    out = []
    for same in zip(*(c.scores for c in contests), strict=True):
        values = {
            f.name: float(np.sqrt(np.mean([getattr(s, f.name) ** 2 for s in same])))
            for f in dataclasses.fields(Score)
            if f.name not in ("name", "trained_on")
        }
        out.append(Score(same[0].name, same[0].trained_on, **values))
    return out


def _table(shots: Sequence[CueShot]) -> tuple[Array, Array]:
    """Inputs (n, 3) and measured ball speed and squirt (n, 2)."""
    rows = np.array([(s.cue_speed, s.x0_mm, s.y0_mm) for s in shots], float).reshape(-1, 3)
    return rows, np.array([(s.ball_speed, s.squirt_rad) for s in shots], float).reshape(-1, 2)


def _rms(speed: Array, squirt: Array, right: Array) -> tuple[float, float, float]:
    """Of the ball's speed [%], [m/s] and of squirt [deg]; nan where the right ones are."""
    off = 100.0 * (speed / right[:, 0] - 1.0), speed - right[:, 0], np.degrees(squirt - right[:, 1])
    part, size, turn = (float(np.sqrt(np.mean(v**2))) for v in off)
    return part, size, turn
