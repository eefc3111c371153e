"""What nobody measured on a table is promised less: constants without a standard deviation vary as published ones."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from models.model_file import Estimate, full_model
from models.table.presets import TABLE_SETS
from planner.evaluation.play import Player
from planner.evaluation.published import unfitted_spread, with_published_spread
from planner.evaluation.risk import draw_errors
from planner.launcher.execution import Execution
from planner.launcher.stroke import AZIMUTH, SPEED, LauncherModel
from planner.planning import plan_of
from planner.report import _computed
from planner.scene import Goal, Scene
from planner.search.search import Effort
from planner.words import plan_lines

POOL = TABLE_SETS["pool 7 ft"]
MODEL = full_model(POOL.table, POOL.ball)
SLIDE, CUSHION = "decoupled_cloth.slide", "cushion_impact.restitution"


def known(sd: float) -> dict[str, Estimate]:
    return {name: Estimate(sd, "a fit") for name in MODEL.parameters()}


def test_every_constant_of_the_base_has_published_values_and_their_spread() -> None:
    spread = unfitted_spread(MODEL)
    assert spread.keys() == MODEL.parameters().keys()
    assert spread[SLIDE] == pytest.approx(0.25 / math.sqrt(12)) and spread[CUSHION] == pytest.approx(
        0.38 / math.sqrt(12)
    )
    drawn = draw_errors(with_published_spread(MODEL), Execution(), 4096, 3).values
    for name, sd in spread.items():
        # Clipped to bounds, the spread is a little less.
        assert 0.75 * sd < drawn[name].std() < 1.05 * sd, name


def test_what_a_fit_determined_keeps_its_own() -> None:
    model = dataclasses.replace(MODEL, estimates={SLIDE: Estimate(0.004, "a fit"), CUSHION: Estimate(math.nan, "none")})
    found = with_published_spread(model)
    assert found.estimates[SLIDE] == Estimate(0.004, "a fit")
    assert found.estimates[CUSHION].sd == pytest.approx(0.38 / math.sqrt(12))
    assert "Alciatore" in found.estimates[CUSHION].source
    fitted = dataclasses.replace(MODEL, estimates=known(1e-4))
    assert with_published_spread(fitted) is fitted


def made(scene: Scene, bank: bool, spread: bool) -> float:
    """Share of plays that pot along the middle one of the aims that do, over one cushion or none; errors drawn."""
    model = with_published_spread(MODEL) if spread else MODEL
    player = Player(model, scene, LauncherModel())
    q = np.zeros((7200, 4))
    q[:, SPEED], q[:, AZIMUTH] = 2.0, np.linspace(-math.pi, math.pi, len(q))
    nominal = Player(MODEL, scene, LauncherModel()).screen(q)
    over = nominal.hits[:, 0] + nominal.hits[:, 2]
    potting = np.flatnonzero(nominal.potted & (over == 1 if bank else over == 0))
    runs = np.split(potting, np.flatnonzero(np.diff(potting) > 1) + 1)
    best = q[max(runs, key=len)[len(max(runs, key=len)) // 2]][None]
    samples = draw_errors(model, Execution(), 256, 5)
    return float(samples.play(player, best).potted.mean())


def test_what_rests_on_cushions_loses_most() -> None:
    """The same balls, potted directly and over one cushion."""
    names = ("white", "red")
    scene = Scene(POOL.table, POOL.ball, names, np.array([[-0.5, -0.2], [-0.1, 0.1]]), Goal(*names, None))
    direct, over = ([made(scene, bank, spread) for spread in (False, True)] for bank in (False, True))
    assert direct[0] > 0.95 and direct[1] > direct[0] - 0.05
    assert over[0] > 0.7 and over[1] < over[0] / 2


def test_a_plan_says_which_constants_vary_so() -> None:
    names = ("white", "red")
    scene = Scene(POOL.table, POOL.ball, names, np.array([[0.1, 0.0], [0.6, 0.25]]), Goal(*names, None))
    effort = Effort(fresh=16, checked=1)
    model = dataclasses.replace(MODEL, estimates={SLIDE: Estimate(0.004, "a fit")})
    stroke = np.array([1.5, 0.4636, 0.0, 0.0])
    plan = plan_of(scene, model, stroke, "to see", Execution(), LauncherModel(), effort=effort)
    assert plan["model"]["published_sd"].keys() == MODEL.parameters().keys() - {SLIDE}
    assert plan["model"]["published_sd"][CUSHION] == pytest.approx(0.11)
    assert any(CUSHION in text for _, text in _computed(plan, POOL.table, POOL.ball))
    plan |= {"launcher": plan["launcher"] | {"theta_tolerance_deg": [-1.0, 1.0]}}
    assert CUSHION in plan_lines(plan)[-1] and SLIDE not in plan_lines(plan)[-1]
    fitted = dataclasses.replace(MODEL, estimates=known(1e-4))
    assert not plan_of(scene, fitted, stroke, "", Execution(), LauncherModel(), effort=effort)["model"]["published_sd"]
