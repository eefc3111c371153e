"""The native MJCF, tuned as well as its terms allow: least squares against the analytic models, term by term.

The fit of the workbench (sysid/estimation/least_squares.py) with the terms as unknowns. Cloth: positions and sidespin
over 3 s; impacts: velocity and R omega after them, over the speed before. `sysid match --tune M.toml` runs it;
models/mjcf/native.py holds what it found.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from models.engine.play import play
from models.mjcf.native import TUNED, Native
from models.model_file import Estimate, Model
from models.shot import Array, Shot, Track
from models.simulation.simulate import simulate
from sysid.estimation.least_squares import Objective, Prior, fit_each
from sysid.validation.match import (
    ANALYTIC,
    BALL,
    CONSTANTS,
    OPEN,
    ROLL,
    SETTLED,
    SLIDE,
    SPIN,
    TABLE,
    impact_shot,
    impact_states,
    random_states,
)

COUNT = 60  # random states and impacts, half of them impacts of two balls
STEP = 0.01  # relative, of finite differences
ROBUST = 10.0
PLACE, SIDE, SHARE = 0.02, 0.1, 0.02  # misses that count one: of places [m], R times sidespin [m/s], and of the speed
TERMS = {
    "cloth": ("slide", "roll", "spin"),
    "ball": ("ball_restitution", "ball_friction", "ball_grip"),
    "cushion": ("cushion_restitution", "cushion_friction", "cushion_grip"),
}


def shots_of(case: str) -> list[Shot]:
    """The shots a term is tuned on."""
    if case == "cloth":
        still, times = np.zeros((1, 2)), np.linspace(0, 3, 13)
        velocity, spin = random_states(COUNT)
        return [Shot(("white",), still, v[None], w[None], times) for v, w in zip(velocity, spin, strict=True)]
    states = np.concatenate(impact_states(case, COUNT))
    return [impact_shot(case, v, angle, top, side, SETTLED["native"]) for v, angle, top, side in states]


def misses(case: str, shots: list[Shot], ours: list[Track], theirs: list[Track]) -> Array:
    """How far tracks are apart, over what counts one: (m,)."""
    found = []
    for shot, a, b in zip(shots, ours, theirs, strict=True):
        if case == "cloth":
            found.append((a.position - b.position).ravel() / PLACE)
            found.append(BALL.radius * (a.spin[..., 2] - b.spin[..., 2]).ravel() / SIDE)
        else:
            speed = float(np.linalg.norm(shot.velocity[0]))
            found.append((a.velocity[-1] - b.velocity[-1]).ravel() / speed / SHARE)
            found.append(BALL.radius * (a.spin[-1] - b.spin[-1]).ravel() / speed / SHARE)
    return np.concatenate(found)


def tune(case: str, native: Native, report: Callable[[str], None] | None = None) -> Native:
    """The native terms of a case, fitted; the others as they are."""
    names, shots = TERMS[case], shots_of(case)
    table = OPEN if case == "cloth" else TABLE
    truth = play(dataclasses.replace(ANALYTIC, table=table), shots)
    bounds = np.log(np.maximum([Native.parameters()[name]["bounds"] for name in names], 1e-6))

    def evaluate(x: Array, _c: Array, _which: Any) -> Array:
        """Residuals (k, m) for the logarithms of k sets of terms (k, p), all in one batch."""
        values = np.exp(np.clip(x, bounds[:, 0], bounds[:, 1]))
        each = {f"native.{name}": np.repeat(values[:, i], len(shots)) for i, name in enumerate(names)}
        model = Model(table, BALL, native).with_values(each)
        tracks = simulate(model, shots * len(x))
        parts = [tracks[k * len(shots) : (k + 1) * len(shots)] for k in range(len(x))]
        found = np.stack([misses(case, shots, part, truth) for part in parts])
        if report:
            report(f"{case}: " + ", ".join(f"{n} {v:.4g}" for n, v in zip(names, values[0], strict=True)))
        return found

    start = np.log([[getattr(native, name) for name in names]])
    none = Prior(start, np.full_like(start, np.inf))
    x, _ = fit_each(Objective(evaluate, np.full(len(names), STEP), none, ROBUST), start, np.zeros(0), 25)
    found = np.exp(np.clip(x[0], bounds[:, 0], bounds[:, 1]))
    return dataclasses.replace(native, **{n: float(v) for n, v in zip(names, found, strict=True)})


def tuned(report: Callable[[str], None] | None = None) -> Model:
    """The native model nearest to the analytic ones, from the analytic models' own constants on."""
    c = CONSTANTS
    native = Native(
        slide=SLIDE, roll=ROLL, spin=SPIN, ball_restitution=c["ball_impact.restitution"],
        ball_friction=c["ball_impact.friction"], ball_grip=0.002, cushion_restitution=0.9,
        cushion_friction=c["cushion_impact.friction"], cushion_grip=0.002,
    )  # fmt: skip
    for case in TERMS:
        native = tune(case, native, report)
    known = {f"native.{name}": Estimate(source=TUNED) for name in Native.parameters()}
    return Model(TABLE, BALL, native, estimates=known)
