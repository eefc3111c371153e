"""The native MJCF, tuned as well as its terms allow: least squares against a model, case by case.

In: a model; the analytic models' constants for models/mjcf/native.py, which holds what was found (`sysid match --tune
M.toml`). Out: native terms.

The unknowns are the terms, the solver is that of the workbench (sysid/estimation/solver). Cloth: positions and sidespin
over 3 s; impacts: velocity and R omega after them, over the speed before.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from models.engine.play import play
from models.mjcf.native import TUNING_SOURCE, Native
from models.model_file import Estimate, Model
from models.shot import Array, Ball, Shot, Table, Track
from models.simulation.simulate import simulate
from sysid.estimation.solver.least_squares import Objective, Prior, fit_each
from sysid.validation.match import SETTLING_TIME_S
from sysid.validation.shots import (
    ANALYTIC_MODEL,
    MATHAVAN_TABLE,
    OPEN_TABLE,
    SNOOKER_BALL,
    impact_shot,
    impact_states,
    random_states,
)

RANDOM_STATES = 60  # states of motion, or impacts, that a case is fitted to
RELATIVE_STEP = 0.01  # of finite differences
CAUCHY_SCALE = 10.0  # of the robust loss
POSITION_SCALE_M, SIDESPIN_SCALE_M_S, SPEED_SCALE = (
    0.02,
    0.1,
    0.02,
)  # error that counts one: of R omega_z, and over speed
TERMS_BY_CASE = {
    "cloth": ("slide", "roll", "spin"),
    "ball": ("ball_restitution", "ball_friction", "ball_grip"),
    "cushion": ("cushion_restitution", "cushion_friction", "cushion_grip"),
}


def shots_of(case: str, table: Table = MATHAVAN_TABLE, ball: Ball = SNOOKER_BALL) -> list[Shot]:
    """The shots that the terms of a case are fitted to."""
    if case == "cloth":
        still, times = np.zeros((1, 2)), np.linspace(0, 3, 13)
        velocity, spin = random_states(RANDOM_STATES, ball.radius)
        return [Shot(("white",), still, v[None], w[None], times) for v, w in zip(velocity, spin, strict=True)]
    states = np.concatenate(impact_states(case, RANDOM_STATES))
    after = SETTLING_TIME_S["native"]
    return [impact_shot(case, v, angle, top, side, after, table, ball) for v, angle, top, side in states]


def residuals(case: str, shots: list[Shot], ours: list[Track], theirs: list[Track], radius: float) -> Array:
    """Differences of two sets of tracks, over their scales: (m,)."""
    found = []
    for shot, a, b in zip(shots, ours, theirs, strict=True):
        if case == "cloth":
            found.append((a.position - b.position).ravel() / POSITION_SCALE_M)
            found.append(radius * (a.spin[..., 2] - b.spin[..., 2]).ravel() / SIDESPIN_SCALE_M_S)
        else:
            speed = float(np.linalg.norm(shot.velocity[0]))
            found.append((a.velocity[-1] - b.velocity[-1]).ravel() / speed / SPEED_SCALE)
            found.append(radius * (a.spin[-1] - b.spin[-1]).ravel() / speed / SPEED_SCALE)
    return np.concatenate(found)


def tune(
    case: str, native: Native, truth: Model, report: Callable[[str], None] | None = None, fixed: Collection[str] = ()
) -> Native:
    """Fit the native terms of a case to what a model plays; the others, and those that are fixed, keep their values."""
    ball = truth.ball
    table = OPEN_TABLE if case == "cloth" else dataclasses.replace(truth.table, pockets=False)
    names, shots = [name for name in TERMS_BY_CASE[case] if name not in fixed], shots_of(case, table, ball)
    played = play(dataclasses.replace(truth, table=table), shots)
    bounds = np.log(np.maximum([Native.parameters()[name]["bounds"] for name in names], 1e-6))

    def evaluate(x: Array, _c: Array, _which: Any) -> Array:
        """Residuals (k, m) for the logarithms of k sets of terms (k, p), all in one batch."""
        values = np.exp(np.clip(x, bounds[:, 0], bounds[:, 1]))
        each = {f"native.{name}": np.repeat(values[:, i], len(shots)) for i, name in enumerate(names)}
        model = Model(table, ball, native).with_values(each)
        tracks = simulate(model, shots * len(x))
        parts = [tracks[k * len(shots) : (k + 1) * len(shots)] for k in range(len(x))]
        found = np.stack([residuals(case, shots, part, played, ball.radius) for part in parts])
        if report:
            report(f"{case}: " + ", ".join(f"{n} {v:.4g}" for n, v in zip(names, values[0], strict=True)))
        return found

    start = np.log([[getattr(native, name) for name in names]])
    none = Prior(start, np.full_like(start, np.inf))
    steps = np.full(len(names), RELATIVE_STEP)
    x, _ = fit_each(Objective(evaluate, steps, none, CAUCHY_SCALE, rough=True), start, np.zeros(0), 25)
    found = np.exp(np.clip(x[0], bounds[:, 0], bounds[:, 1]))
    return dataclasses.replace(native, **{n: float(v) for n, v in zip(names, found, strict=True)})


def nearest_native(truth: Model, report: Callable[[str], None] | None = None, fixed: Collection[str] = ()) -> Native:
    """The native terms nearest to what a model plays, begun at its constants; `fixed` ones stay there."""
    c = truth.parameters()
    native = Native(
        slide=c["decoupled_cloth.slide"], roll=c["decoupled_cloth.roll"], spin=c["decoupled_cloth.spin"],
        ball_restitution=c["ball_impact.restitution"], ball_friction=c["ball_impact.friction"], ball_grip=0.002,
        cushion_restitution=min(c["cushion_impact.restitution"], 0.9),
        cushion_friction=c["cushion_impact.friction"], cushion_grip=0.002,
    )  # fmt: skip
    for case in TERMS_BY_CASE:
        native = tune(case, native, truth, report, fixed)
    return native


def tuned(report: Callable[[str], None] | None = None) -> Model:
    """The native model closest to the analytic ones, fitted from the constants of the analytic models."""
    known = {f"native.{name}": Estimate(source=TUNING_SOURCE) for name in Native.parameters()}
    return Model(MATHAVAN_TABLE, SNOOKER_BALL, nearest_native(ANALYTIC_MODEL, report), estimates=known)
