"""A table and balls that were measured wrong, and shots that determine a constant nearly alone."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from models.model_file import full_model
from models.shot import Ball, Table
from models.table.sizes import BALL_DIAMETER, SIZE_NAMES, TABLE_LENGTH, TABLE_WIDTH
from sysid.clips import ClipSet, read_clip_set
from sysid.estimation import ClipFit, fit_clips
from sysid.estimation.shot_problem import shot_problem
from sysid.estimation.sizes import known_sizes, with_free_sizes
from sysid.report.health import health_lines
from tests.bench.accuracy import CONSTANTS
from tests.study.plan import SOILED_OPTIONS
from tests.truth.__main__ import main as make_truth
from tests.truth.physics import Table as TruthTable

SEED = 7004  # its one training clip with two balls has a sidespin that imitates restitution and friction of balls


@pytest.fixture(scope="module")
def soiled(tmp_path_factory: pytest.TempPathFactory) -> tuple[ClipSet, dict[str, float]]:
    folder = tmp_path_factory.mktemp("sizes") / "set"
    assert make_truth([str(folder), "--seed", str(SEED), "--clips", "16", *SOILED_OPTIONS]) == 0
    truth = json.loads(Path(f"{folder}.truth.json").read_text())["parameters"]
    sizes = {TABLE_LENGTH: TruthTable.length, TABLE_WIDTH: TruthTable.width, BALL_DIAMETER: 2 * truth["R"]}
    return read_clip_set(folder), {name: truth[short] for name, short in CONSTANTS.items()} | sizes


@pytest.fixture(scope="module")
def found(soiled: tuple[ClipSet, dict[str, float]]) -> ClipFit:
    return fit_clips(soiled[0], full_model(soiled[0].table, soiled[0].ball))


def test_a_table_measured_wrong_is_found_and_bends_no_other_constant(
    soiled: tuple[ClipSet, dict[str, float]], found: ClipFit
) -> None:
    clip_set, truth = soiled
    assert found.converged and found.fitted.chi2 < 1.1
    off = {name: (value - truth[name]) / sd for name, (value, sd) in found.constants.items()}
    assert off.keys() == truth.keys()
    assert max(map(abs, off.values())) < 4, off
    for name in (TABLE_LENGTH, TABLE_WIDTH):
        value, sd = found.constants[name]
        assert abs(value / truth[name] - 1) < 5e-4 < abs(found.model.meta(name)["default"] / truth[name] - 1)
        assert sd < 1e-3
    assert (found.model.table, found.model.ball) == (clip_set.table, clip_set.ball)  # as stated
    told = [line for line in health_lines(found.model) if "nose to nose" in line]
    assert len(told) == 2 and all("correct" in line for line in told)


def test_a_lone_shot_finds_its_sidespin(soiled: tuple[ClipSet, dict[str, float]], found: ClipFit) -> None:
    value, sd = found.constants["ball_impact.restitution"]
    assert abs(value - soiled[1]["ball_impact.restitution"]) < 3 * sd < 0.03  # 35 sd off with the sidespin at 0


def test_both_engines_see_the_same_change_of_a_size(soiled: tuple[ClipSet, dict[str, float]]) -> None:
    clip_set = dataclasses.replace(soiled[0], clips=soiled[0].clips[7:9])
    model = with_free_sizes(full_model(clip_set.table, clip_set.ball))
    change = []
    for engine in ("events", "mujoco"):
        one = shot_problem(dataclasses.replace(model, engine=engine), SIZE_NAMES, clip_set, 5e-4, known_sizes(model))
        stated = np.array([model.meta(name)["default"] for name in SIZE_NAMES])
        c = np.repeat([stated, stated * [1.003, 0.997, 1.005]], 2, axis=0)
        r = one.evaluate(np.tile(one.start, (2, 1)), c, np.array([0, 1, 0, 1]))
        change.append(r[2:] - r[:2])
    assert np.nanmax(np.abs(change[0])) > 1.0
    assert np.nanmedian(np.abs(change[1] - change[0])) < 0.1


def test_sizes_are_known_as_stated_where_the_event_engine_plays() -> None:
    model = full_model(Table(3.569, 1.778), Ball(0.0525, 0.1406))
    assert known_sizes(model) == {}
    free = with_free_sizes(model)
    assert known_sizes(free)[TABLE_LENGTH] == pytest.approx((3.569, 0.003 * 3.569))
    assert with_free_sizes(dataclasses.replace(model, engine="mujoco")).sizes == {}
    assert with_free_sizes(free.with_values({TABLE_LENGTH: 3.56})).sizes[TABLE_LENGTH] == 3.56
