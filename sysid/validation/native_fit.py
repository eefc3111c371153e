"""Tuning of native MJCF: least squares of its terms against a model, case by case.

In: a model: the analytic models' constants for models/mjcf/native.py, which holds the result (`sysid match --tune
M.toml`), or a fitted one for its export (sysid/mjcf). Out: native terms.

The unknowns are the terms, the solver is that of the workbench (sysid/estimation/solver). Cloth: positions and sidespin
over 3 s; rolling: the same of balls that roll from the start; impacts: velocity and R omega after them, over the speed
before.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from models.effect import Effect
from models.mjcf.native import TUNING_SOURCE, Native
from models.model_file import Estimate, Model
from models.shot import Array, Ball, Shot, Table, Track
from models.simulation.simulate import simulate
from models.table.snooker import SNOOKER_BALL
from sysid.estimation.solver.least_squares import Objective, Prior, fit_each
from sysid.validation.shots import ANALYTIC_MODEL, MATHAVAN_TABLE, OPEN_TABLE, impact_shot, impact_states, random_states
from sysid.validation.tested_models import SETTLING_TIME_S

log = logging.getLogger(__name__)
RANDOM_STATES = 60  # random states of motion, or impacts, in the fit of a case
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
GRIP_START_S = 0.002  # start value of the grip time of all contacts [s]: the duration of a contact
REBOUND_START = 0.9  # largest start value of the cushions' restitution
Player = Callable[[Model, Sequence[Shot]], list[Track]]


def shots_of(case: str, table: Table = MATHAVAN_TABLE, ball: Ball = SNOOKER_BALL) -> list[Shot]:
    """The shots for the fit of a case: "cloth", "rolling", "ball" or "cushion"."""
    if case in ("cloth", "rolling"):
        still, times = np.zeros((1, 2)), np.linspace(0, 3, 13)
        velocity, spin = random_states(RANDOM_STATES, ball.radius)
        if case == "rolling":
            spin = np.column_stack([-velocity[:, 1], velocity[:, 0], np.zeros(len(velocity))]) / ball.radius
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
    case: str, names: Sequence[str], native: Native, truth: Model, move: Player = simulate,
    kept: tuple[Effect, ...] = (),
) -> Native:  # fmt: skip
    """Fit native terms to a model's motion in the shots of a case; the other terms keep their values.

    Args:
        case: of `shots_of`.
        names: of the terms.
        native: from which the fit starts.
        truth: the model to reproduce.
        move: plays models with native terms instead of the effects for cloth, balls and cushions.
        kept: effects that such a model keeps.
    """
    ball = truth.ball
    table = OPEN_TABLE if case in ("cloth", "rolling") else dataclasses.replace(truth.table, pockets=False)
    shots = shots_of(case, table, ball)
    played = simulate(dataclasses.replace(truth, table=table), shots)
    bare = Model(table, ball, native, kept)
    bounds = np.log(np.maximum([Native.parameters()[name]["bounds"] for name in names], 1e-6))

    def evaluate(x: Array, _c: Array, _which: Any) -> Array:
        """Residuals (k, m) for the logarithms of k sets of terms (k, p), all in one batch."""
        values = np.exp(np.clip(x, bounds[:, 0], bounds[:, 1]))
        each = {f"native.{name}": np.repeat(values[:, i], len(shots)) for i, name in enumerate(names)}
        tracks = move(bare.with_values(each), shots * len(x))
        parts = [tracks[k * len(shots) : (k + 1) * len(shots)] for k in range(len(x))]
        found = np.stack([residuals(case, shots, part, played, ball.radius) for part in parts])
        log.info("%s: %s", case, ", ".join(f"{n} {v:.4g}" for n, v in zip(names, values[0], strict=True)))
        return found

    start = np.clip(np.log(np.maximum([[getattr(native, name) for name in names]], 1e-6)), bounds[:, 0], bounds[:, 1])
    none = Prior(start, np.full_like(start, np.inf))
    steps = np.full(len(names), RELATIVE_STEP)
    x, _ = fit_each(Objective(evaluate, steps, none, CAUCHY_SCALE, rough=True), start, np.zeros(0), 25)
    found = np.exp(np.clip(x[0], bounds[:, 0], bounds[:, 1]))
    return dataclasses.replace(native, **{n: float(v) for n, v in zip(names, found, strict=True)})


def start_of(truth: Model) -> Native:
    """Start values of native terms: a model's constants, or else those of its native terms."""
    c, own = truth.parameters(), truth.native
    return dataclasses.replace(
        own,
        slide=c.get("decoupled_cloth.slide", own.slide), roll=c.get("decoupled_cloth.roll", own.roll),
        spin=c.get("decoupled_cloth.spin", own.spin),
        ball_restitution=c.get("ball_impact.restitution", own.ball_restitution),
        ball_friction=c.get("ball_impact.friction", own.ball_friction), ball_grip=GRIP_START_S,
        cushion_restitution=min(c.get("cushion_impact.restitution", own.cushion_restitution), REBOUND_START),
        cushion_friction=c.get("cushion_impact.friction", own.cushion_friction), cushion_grip=GRIP_START_S,
    )  # fmt: skip


def tuned() -> Model:
    """The native model closest to the analytic ones, fitted from the constants of the analytic models."""
    native = start_of(ANALYTIC_MODEL)
    for case, names in TERMS_BY_CASE.items():
        native = tune(case, names, native, ANALYTIC_MODEL)
    known = {f"native.{name}": Estimate(source=TUNING_SOURCE) for name in Native.parameters()}
    return Model(MATHAVAN_TABLE, SNOOKER_BALL, native, estimates=known)
