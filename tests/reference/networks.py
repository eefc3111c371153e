"""The paper's two networks for ball speed and squirt, beside the physical map on the same held-out strokes.

    python -m tests.reference.networks CAMPAIGN.csv [--report OUT.html] [--picture OUT.png] [--splits N]

Robotic Billiards (2015), section V.C: feed-forward networks of 3-5-1 neurons, trained by back-propagation on cue speed,
x'0 and y'0. Here: tanh, inputs and output scaled to unit spread, trained by L-BFGS from several seeded starts; the one
with the least training loss counts. The paper reports no error of its own.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPRegressor
from threadpoolctl import threadpool_limits

from models.console import table
from models.errors import BadInput
from robot.cueing.campaign import CueShot, read_campaign
from robot.cueing.held_out import MapComparison, Predict, average_errors, compare_maps, stroke_table
from robot.cueing.report import SCORE_HEADS, score_cells, write_picture, write_report

Array = NDArray[np.float64]
HIDDEN_NEURONS = 5  # in the one hidden layer (Robotic Billiards 2015)
START_COUNT = 8
MAX_ITERATIONS = 3000  # of L-BFGS


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


def train_networks(shots: Sequence[CueShot], rng: np.random.Generator, starts: int = START_COUNT) -> Networks:
    """Train both networks; BadInput where there are fewer shots than weights."""
    inputs, out = stroke_table([s for s in shots if not s.miscue])
    weights = HIDDEN_NEURONS * 5 + 1
    if len(inputs) < weights:
        raise BadInput(f"{len(inputs)} shots for {weights} weights of a 3-5-1 network; strike {weights} or more")
    centre, width = inputs.mean(axis=0), np.maximum(inputs.std(axis=0), 1e-9)
    out_centre, out_width = out.mean(axis=0), np.maximum(out.std(axis=0), 1e-9)
    given, wanted = (inputs - centre) / width, (out - out_centre) / out_width
    nets, converged = [], 0
    for k in range(2):
        tried: list[tuple[float, int, MLPRegressor]] = []
        for _ in range(starts):
            net = MLPRegressor(
                hidden_layer_sizes=(HIDDEN_NEURONS,), activation="tanh", solver="lbfgs", alpha=1e-6,
                max_iter=MAX_ITERATIONS, max_fun=20 * MAX_ITERATIONS, tol=1e-7, random_state=int(rng.integers(2**31)),
            )  # fmt: skip
            with warnings.catch_warnings(), threadpool_limits(1):  # matrices so small make threads wait for each other
                warnings.simplefilter("ignore", ConvergenceWarning)  # counted below instead
                net.fit(given, wanted[:, k])
            converged += net.n_iter_ < MAX_ITERATIONS
            tried.append((float(net.loss_), len(tried), net))
        nets.append(min(tried)[2])
    return Networks((nets[0], nets[1]), centre, width, out_centre, out_width, converged)


def compare_with_networks(
    shots: Sequence[CueShot], rng: np.random.Generator, *, starts: int = START_COUNT, **rest: Callable[..., object]
) -> MapComparison:
    """Networks and physical map on strokes that neither has seen; further arguments as compare_maps takes them."""

    def fit_networks(train: Sequence[CueShot]) -> dict[str, Predict]:
        return {"networks 3-5-1": train_networks(train, rng, starts).predict}

    return compare_maps(shots, rng, fit_others=fit_networks, **rest)


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare the cueing map of a campaign with the paper's networks on held-out strokes."""
    from models.mjcf.gl import choose_backend

    choose_backend()
    from robot.cueing.striker import draw_hidden, exact_strokes

    parser = argparse.ArgumentParser(prog="python -m tests.reference.networks", description=main.__doc__)
    parser.add_argument("campaign", type=Path, metavar="CAMPAIGN.csv")
    parser.add_argument("--report", type=Path, metavar="OUT.html")
    parser.add_argument("--picture", type=Path, metavar="OUT.png")
    parser.add_argument("--splits", type=int, default=1, help="comparisons, each with other strokes held out")
    parser.add_argument("--emulated", type=int, metavar="SEED", help="of an emulated campaign: exact errors too")
    given = parser.parse_args(arguments)
    try:
        if given.splits < 1:
            raise BadInput(f"--splits {given.splits}: give 1 or more")
        shots = read_campaign(given.campaign)
        rest: dict[str, Callable[..., object]] = {}
        if given.emulated is not None:
            rest["exact"] = partial(exact_strokes, draw_hidden(np.random.default_rng(given.emulated)))
        found = [compare_with_networks(shots, np.random.default_rng(k), **rest) for k in range(given.splits)]
        scores = average_errors(found)
        print(table([SCORE_HEADS, *([s.name, *score_cells(s)] for s in scores)]))
        if given.report:
            write_report(given.report, f"Cueing map: {given.campaign.name}", shots, found[0], scores=scores)
        if given.picture:
            write_picture(given.picture, shots, found[0])
    except BadInput as error:
        print(f"tests.reference.networks: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
