"""The paper's two networks for ball speed and squirt, beside the physical map on the same held-out strokes.

    python -m tests.reference.networks CAMPAIGN.csv [--report OUT.html] [--picture OUT.png] [--splits N]

Robotic Billiards (2015), section V.C: feed-forward networks of 3-5-1 neurons, trained by back-propagation on cue speed,
x'0 and y'0. Here: tanh, inputs and output scaled to unit spread, trained by L-BFGS from several seeded starts; the one
with the least training loss counts. The paper reports no error of its own.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPRegressor
from threadpoolctl import threadpool_limits

from models.commands.console import table
from models.errors import BadInput
from planner.launcher.stroke import LauncherModel
from robot.cueing.campaign import CueShot, read_campaign
from robot.cueing.held_out import HeldOutErrors, MapComparison, compare_maps, rms_errors, stroke_table
from robot.cueing.report import SCORE_HEADS, score_cells, write_picture, write_report
from robot.cueing.striker import Hidden, draw_hidden, hidden_launcher, strike

Array = NDArray[np.float64]
HIDDEN_NEURONS = 5  # in the one hidden layer (Robotic Billiards 2015)
START_COUNT = 8
MAX_ITERATIONS = 3000  # of L-BFGS
NETWORKS = "networks 3-5-1"


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
    shots: Sequence[CueShot], rng: np.random.Generator, *, starts: int = START_COUNT
) -> MapComparison:  # fmt: skip
    """The physical map's comparison on strokes held out, and the networks on the same: trained on the same others."""
    contest = compare_maps(shots, rng)
    held = {(s.string, s.x0_mm, s.y0_mm) for s in contest.held}
    train = [s for s in shots if not s.miscue and (s.string, s.x0_mm, s.y0_mm) not in held]
    inputs, measured = stroke_table(contest.held)
    predicted = train_networks(train, rng, starts).predict(*inputs.T)
    score = HeldOutErrors(NETWORKS, len(train), *rms_errors(*predicted, measured))
    return dataclasses.replace(
        contest, scores=(*contest.scores, score), predicted={NETWORKS: predicted} | contest.predicted
    )  # fmt: skip


def exact_strokes(hidden: Hidden, shots: Sequence[CueShot]) -> Array:
    """Ball speed [m/s] and squirt [rad] of shots, had they been without errors of execution: (n, 2)."""
    launcher, strings, known = hidden_launcher(hidden), LauncherModel(), {}
    for string, x0_mm, y0_mm in sorted({(s.string, s.x0_mm, s.y0_mm) for s in shots}):
        side, height = 1e-3 * x0_mm + hidden.side_zero, 1e-3 * y0_mm + hidden.height_zero
        stroke = strike(launcher, strings.cue_speed(string), side, height)
        known[string, x0_mm, y0_mm] = float(np.hypot(*stroke.velocity[:2])), stroke.squirt + hidden.aim_zero
    return np.array([known[s.string, s.x0_mm, s.y0_mm] for s in shots])


def errors_against(contest: MapComparison, exact: Array) -> dict[str, HeldOutErrors]:
    """Errors of every map against the exact ball speed [m/s] and squirt [rad] of the shots held out (n, 2), by name."""
    trained = {s.name: s.trained_on for s in contest.scores}
    return {k: HeldOutErrors(k, trained[k], *rms_errors(*pair, exact)) for k, pair in contest.predicted.items()}


def average(splits: Sequence[Sequence[HeldOutErrors]]) -> list[HeldOutErrors]:
    """Root mean squares of the errors over several splits, for each name."""
    means = []
    for same in zip(*splits, strict=True):
        errors = np.array([(s.speed_percent, s.speed_m_s, s.squirt_deg) for s in same])
        means.append(HeldOutErrors(same[0].name, same[0].trained_on, *np.sqrt(np.mean(errors**2, axis=0)).tolist()))
    return means


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare the cueing map of a campaign with the paper's networks on held-out strokes."""
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
        found = [compare_with_networks(shots, np.random.default_rng(k)) for k in range(given.splits)]
        scores = average([one.scores for one in found])
        print(table([SCORE_HEADS, *([s.name, *score_cells(s)] for s in scores)]))
        if given.emulated is not None:
            hidden = draw_hidden(np.random.default_rng(given.emulated))
            exact = average([[*errors_against(c, exact_strokes(hidden, c.held)).values()] for c in found])
            print("\nagainst strokes without errors of execution")
            print(table([SCORE_HEADS, *([s.name, *score_cells(s)] for s in exact)]))
        if given.report:
            averaged = dataclasses.replace(found[0], scores=tuple(scores))
            write_report(given.report, f"Cueing map: {given.campaign.name}", shots, averaged)
        if given.picture:
            write_picture(given.picture, shots, found[0])
    except BadInput as error:
        print(f"tests.reference.networks: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
