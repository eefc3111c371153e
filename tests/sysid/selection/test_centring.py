"""The mean of an unknown function lies in the constant that the model has of its quantity."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from models.model_file import full_model
from sysid.clips import read_clip_set
from sysid.estimation.from_nothing import fit_from_nothing
from sysid.estimation.split import split
from sysid.selection.centring import centred
from sysid.selection.fits.by_whole_shots import ByWholeShots
from sysid.selection.fits.by_windows import ByWindows
from sysid.selection.fits.view import FitView
from sysid.selection.formulas.formula import UNNAMED_EFFECT
from sysid.selection.formulas.free_forms import Span, blocks
from sysid.selection.scoring.score import Score
from sysid.selection.scoring.signatures import candidate
from tests.truth.__main__ import main as generate


@pytest.fixture(scope="module")
def views(tmp_path_factory: pytest.TempPathFactory) -> tuple[ByWindows, ByWholeShots]:
    folder = tmp_path_factory.mktemp("centring") / "set"
    assert generate([str(folder), "--seed", "8", "--clips", "5", "--seconds", "1.5", "--kind", "roll,cushion"]) == 0
    clip_set = read_clip_set(folder)
    parts, _, model = split(clip_set, full_model(clip_set.table, clip_set.ball))
    parts, at, base = fit_from_nothing(parts, model)
    return ByWindows(at, base), ByWholeShots(parts, base)


@pytest.mark.parametrize("quantity", ["drag", "cushion_e"])
@pytest.mark.parametrize("of", [0, 1], ids=["windows", "whole shots"])
def test_the_shots_are_played_alike_and_the_function_has_no_mean(
    views: tuple[ByWindows, ByWholeShots], of: int, quantity: str
) -> None:
    view: FitView = views[of]
    seen = {"speed": Span(0.0, 3.0), "approach": Span(0.0, 3.0)}
    block = next(one for one in blocks(seen, {}) if one.quantity == quantity)
    one = candidate(block.effect(UNNAMED_EFFECT))
    size = 0.004
    free = view.with_effect(Score(one, 0.0, np.full(len(one.keys), size), np.full(len(one.keys), np.inf)))
    rows = [k for k, name in enumerate(free.names) if name.startswith(UNNAMED_EFFECT)]
    c = free.point.constants.copy()
    c[rows] += size  # and another mean
    free = free.at_constants(c)
    same = centred(free, UNNAMED_EFFECT, block)
    weight = same.shots[0].sum(axis=0)[np.ix_(rows, rows)].sum(axis=0)
    moved = same.point.constants
    assert abs(weight @ moved[rows]) < 0.02 * size * weight.sum() and np.ptp(moved - c) > 0.0
    if isinstance(same, ByWholeShots) and isinstance(free, ByWholeShots):
        np.testing.assert_allclose(same.now.residuals(), free.now.residuals(), atol=1e-3)
    for without in ("push_x", "grip"):
        assert centred(free, UNNAMED_EFFECT, dataclasses.replace(block, quantity=without)) is free
