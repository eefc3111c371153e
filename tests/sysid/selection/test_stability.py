"""How often effects return on draws of the clips, in linear models where their share is known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from models.effect_catalogue import effect_class
from models.model_file import full_model
from models.shot import Ball, Table
from sysid.estimation.fitted import Point
from sysid.estimation.problem import Array
from sysid.report.findings import stability_lines
from sysid.selection.scoring.score import Linearised
from sysid.selection.scoring.signatures import Signature, candidate
from sysid.selection.stability import Stability, stability_of

SHOTS, SAMPLES = 30, 40
DRAG, LARGE = 0.02, 8.0
CONSTANTS = ("decoupled_cloth.slide", "decoupled_cloth.roll")


def seen(everywhere: float, some: tuple[int, ...] = (), verdict: tuple[str, ...] = ("air_drag",)) -> Stability:
    """Stability of a fit with air drag, which every shot shows by so many standard deviations a residual.

    `some` shots alone show a drag in proportion to the speed.
    """
    rng = np.random.default_rng(3)
    model = full_model(Table(3.569, 1.778), Ball(0.0525, 0.1406))
    fitted = model.add(effect_class("air_drag")(DRAG)) if verdict else model
    names = (*CONSTANTS, "air_drag.rate") if verdict else CONSTANTS
    one = candidate(effect_class("speed_drag"))
    jacobian = rng.normal(size=(SHOTS, SAMPLES, len(names) + 1))
    if verdict:
        jacobian[..., -2] *= everywhere / DRAG
    r = rng.normal(size=(SHOTS, SAMPLES))
    for k in some:
        r[k] -= LARGE * jacobian[k, :, -1]
    constants = np.array([float(fitted.parameters()[n]) for n in names])
    problem = cast(Any, SimpleNamespace(names=names, model=fitted, known={}))
    point = Point(problem, np.zeros((0, 0)), constants, 0.0)
    signature = Signature(one, np.array([0.1 * float(one.usual()[0])]), np.zeros((0, 0, 1)))
    losses = Linearised(
        (signature,), np.swapaxes(jacobian, 1, 2) @ jacobian, np.einsum("nmk,nm->nk", jacobian, r),
        np.array([squares(jacobian[..., -1])]), squares(r), r.size,
    )  # fmt: skip
    return stability_of(point, verdict, losses, 1.0)


def squares(values: Array) -> float:
    return float(np.sum(values**2))


def test_an_effect_that_every_shot_shows_returns_in_every_draw() -> None:
    found = seen(everywhere=0.5)
    assert found.times == {"air_drag": found.draws} and found.same == found.draws


@pytest.mark.slow
def test_what_few_shots_show_and_the_others_do_not_never_returns() -> None:
    """They depart by themselves: what they say of its size is not what the others say."""
    for some in ((7,), (7, 8, 9)):
        assert seen(everywhere=0.5, some=some).times == {"air_drag": 100}


def test_the_more_every_shot_shows_of_an_effect_the_more_often_it_returns() -> None:
    times = [seen(everywhere=size).times["air_drag"] for size in (0.08, 0.11, 0.14, 0.3)]
    assert times == sorted(times) and times[-1] == 100
    assert any(10 < one < 90 for one in times)


def test_an_effect_that_hardly_shows_returns_seldom() -> None:
    found = seen(everywhere=0.08)  # a fall of chi-square by some 8
    assert found.times["air_drag"] < 0.3 * found.draws


def test_nothing_returns_where_nothing_shows() -> None:
    found = seen(everywhere=0.0, verdict=())
    assert found.same >= 0.95 * found.draws, "but for the error rate"


def test_what_else_comes_up_is_told_where_it_does_so_often() -> None:
    told = Stability(100, 61, {"air_drag": 98, "speed_drag": 30, "squirt": 4})
    assert stability_lines(cast(Any, SimpleNamespace(verdict=("air_drag",), stability=told))) == [
        "selected anew on 100 draws of the clips: air_drag in 98; this verdict and nothing else in 61",
        "and not in the verdict: speed_drag in 30",
    ]
    for quiet in (Stability(100, 100, {}), None):
        assert stability_lines(cast(Any, SimpleNamespace(verdict=(), stability=quiet))) == []
