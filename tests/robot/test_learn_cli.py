"""`robot learn`: a series that ends with the truth beside what was found, goes on where it broke off, and refusals."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import robot.learning.loop
from models.analytic.cue_impulse import Constants, Geometry
from models.model_file import Model, full_model, read_model, write_model
from models.shot import Ball, Table
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE
from planner.launcher.cueing_map import CueingMap, write_map
from planner.launcher.execution import Execution
from robot.cli.learn import learn
from robot.cli.verbs import main
from robot.learning.emulated_rig import EmulatedRig, draw_hidden_cue, draw_hidden_table
from robot.learning.history import History, read_history
from robot.learning.loop import LearningConfig
from robot.learning.refit import Learnt
from robot.learning.summary import figures, text_of
from tests.support.clip_samples import contents
from tests.support.commands import Said
from tests.support.quick_plans import QUICK
from tests.support.series_samples import COURSE, MAP, MODEL, RESULT, STAND, TRUE, refit, shot, story

Run = Callable[..., Said]
ENDED = ("ended.txt", "hidden.toml", "hidden_cue.json", "report.html", "story.png", "story.rrd")


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*words: str | Path | int) -> Said:
        capsys.readouterr()
        status = main(["learn", *map(str, words)])
        out, err = capsys.readouterr()
        return Said(status, out, err)

    return call


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plans that are made in a moment."""
    monkeypatch.setattr(robot.learning.loop, "LearningConfig", functools.partial(LearningConfig, effort=QUICK))


@pytest.fixture
def simple(monkeypatch: pytest.MonkeyPatch) -> None:
    """Refits that find the same without a look at any film."""

    def relearn(clips: Any, played: Any, start: Model, *more: Any) -> Learnt:
        made = dataclasses.replace(MAP, constants=dataclasses.replace(MAP.constants, aim_zero=-0.002))
        return Learnt(start.with_values({"decoupled_cloth.roll": 0.0125}), made, RESULT)

    monkeypatch.setattr(robot.learning.loop, "relearn", relearn)


def interrupt_at(monkeypatch: pytest.MonkeyPatch, name: str, call: int) -> None:
    """Ctrl-C in the n-th call of a function of robot/learning/loop.py."""
    real, calls = getattr(robot.learning.loop, name), iter(range(1, 1000))

    def broken(*given: Any, **more: Any) -> Any:
        if next(calls) == call:
            raise KeyboardInterrupt
        return real(*given, **more)

    monkeypatch.setattr(robot.learning.loop, name, broken)


def kept(folder: Path) -> dict[str, bytes]:
    """What a series comes to, without what tells the time."""
    parts = ("shots", "fits", "clips/clips/", "start.toml", "start_map.toml", "course.json", "emulated.json", "hidden")
    return {
        name: data for name, data in contents(folder).items()
        if name.startswith(parts) and not name.endswith((".played.json", "fit.json"))
    }  # fmt: skip


def test_options_say_what_a_course_and_a_stand_are_without_them() -> None:
    given = learn.make_context("learn", ["--out", "x"]).params
    numbers = [given[name] for name in ("shots", "every", "seed", "balls", "chosen")]
    assert numbers == [60, 10, 0, 2, 3]
    assert LearningConfig(MODEL, MAP) == LearningConfig(MODEL, MAP, *numbers, not given["all_shots"])
    assert given["repeats"] == EmulatedRig(MODEL, Constants()).repeats


def test_figures_are_those_of_the_shots() -> None:
    seen = story((0.1, 0.02), ended="all 8 shots are played")
    lost = shot(6, math.nan, pot_probability=0.5, potted=None, floor=math.nan)
    seen = dataclasses.replace(seen, shots=(*seen.shots[:5], lost, *seen.shots[6:]))
    told = figures(seen, COURSE, STAND)
    first, second = told["blocks"]
    assert [(b["first"], b["last"], b["learnt"]) for b in told["blocks"]] == [(1, 4, 0), (5, 8, 4)]
    assert first["miss_median_m"] == pytest.approx(0.1)
    assert first["from_wanted_median_m"] == pytest.approx(0.2)
    assert second["miss_median_m"] == pytest.approx(0.02 * np.median([0.5, 1.5 - 1 / 3, 1.5]))
    assert (first["potted"], first["seen"], first["predicted"]) == (4, 4, pytest.approx(3.2))
    assert (second["potted"], second["seen"], second["predicted"]) == (3, 3, pytest.approx(2.4))
    assert first["foreseen_median_m"] == 0.018 and second["scatter_median_m"] == 0.018
    text = text_of(told)
    [row] = [line for line in text.splitlines() if line.startswith("1 to 4 ")]
    assert row.split()[3:] == ["0", "100", "18", "18", "4", "of", "4", "3.2", "200"]
    assert "after 8 shots: table_tilt" in text and "ended: all 8 shots are played" in text


def test_the_truth_stands_beside_what_was_found() -> None:
    values = {"decoupled_cloth.roll": (0.0125, 1e-5), "table_tilt.slope_x": (7e-4, 1e-5), "air_drag.rate": (0.01, 1e-3)}
    last = refit(4, ("table_tilt", "air_drag"), values=values, launcher={"aim_zero": (0.002, 1e-4)})
    told = figures(dataclasses.replace(story((0.1,)), refits=(last,)), COURSE, STAND)["truth"]
    assert (told["effects"], told["found"]) == (["table_tilt"], ["table_tilt", "air_drag"])
    rows = {c["name"]: c for c in told["constants"]}
    hidden = STAND.model.parameters()
    assert rows["decoupled_cloth.roll"] == {
        "name": "decoupled_cloth.roll", "unit": "1", "began": 0.0127, "value": 0.0125, "sd": 1e-5,
        "hidden": hidden["decoupled_cloth.roll"],
    }  # fmt: skip
    assert rows["table_tilt.slope_x"]["began"] is None and rows["table_tilt.slope_x"]["unit"] == "rad"
    assert rows["table_tilt.slope_x"]["hidden"] == hidden["table_tilt.slope_x"]
    assert rows["air_drag.rate"]["hidden"] is None, "found, and not there"
    assert rows["aim_zero"]["hidden"] == TRUE.aim_zero and rows["aim_zero"]["value"] == 0.002
    assert math.isnan(rows["cue_mass"]["value"]), "nobody learnt it"


def test_a_series_without_a_refit_is_told_as_well() -> None:
    short = History({}, story((0.1,)).shots[:2], (), "all 2 shots are played")
    text = text_of(figures(short, COURSE, STAND))
    assert "1 to 2" in text and "no refit: the first is made after 4 shots" in text and "found: none" in text
    assert "ended: none" in text_of(figures(History({}, (), (), "none"), COURSE, STAND))


def test_a_folder_goes_on_with_its_own_series_alone(
    run: Run, quick: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, words = tmp_path / "series", ("--shots", 1, "--every", 4, "--repeats", 3)
    with monkeypatch.context() as patch:
        interrupt_at(patch, "make_plan", 1)
        said = run("--out", folder, *words)
    assert said.status == 130 and "the same command continues from there" in said.err
    assert not any((folder / name).exists() for name in ENDED)
    assert run("--out", folder, *words).status == 0
    assert all((folder / name).stat().st_size for name in ENDED)
    recorded = (folder / "story.rrd").stat().st_mtime_ns
    again = run("--out", folder, *words)  # only the reports again
    assert again.status == 0 and "shot   1: " not in again.out and "ended: all 1 shots are played" in again.out
    assert (folder / "story.rrd").stat().st_mtime_ns > recorded
    before = contents(folder)
    for change, says in (
        (("--seed", 1), "another seed"), (("--repeats", 4), "another number of repetitions"),
        (("--effect", "air_drag"), "an emulated table or launcher with other constants"),
        (("--every", 5), "another number of shots between refits"),
    ):  # fmt: skip
        said = run("--out", folder, *words, *change)
        assert said.status == 2 and len(said.err.splitlines()) == 1 and says in said.err, said
    assert contents(folder) == before


@pytest.mark.slow
def test_a_series_broken_off_anywhere_comes_to_the_same(
    run: Run, quick: None, simple: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    words = ("--shots", 5, "--every", 4, "--repeats", 3, "--seed", 2)
    said = run("--out", whole, *words)
    assert said.status == 0, said
    for name, call, played, refits in (("make_plan", 3, 2, 0), ("relearn", 1, 4, 0), ("make_plan", 1, 4, 1)):
        with monkeypatch.context() as patch:
            interrupt_at(patch, name, call)
            said = run("--out", broken, *words)
        assert said.status == 130
        last = said.err.splitlines()[-1]
        assert last == f"robot learn: interrupted; {broken} is kept: the same command continues from there"
        so_far = read_history(broken)
        assert (len(so_far.shots), len(so_far.refits)) == (played, refits)
        assert not any((broken / name).exists() for name in ENDED)
    assert run("--out", broken, *words).status == 0
    assert kept(broken) == kept(whole)
    assert sum(name.startswith("shots/") for name in kept(whole)) == 10  # plans, and the repeats of each
    more = run("--out", whole, *words, "--shots", 6)
    assert more.status == 0 and "shot   6: " in more.out and "shot   5: " not in more.out
    assert kept(whole).items() >= kept(broken).items(), "what was there stays as it was"


@pytest.mark.slow
def test_a_tiny_series_tells_the_truth_beside_what_it_found(run: Run, quick: None, tmp_path: Path) -> None:
    folder, out = tmp_path / "series", tmp_path / "told.json"
    said = run("--out", folder, "--shots", 4, "--every", 4, "--repeats", 3, "--effect", "table_tilt", "--json", out)
    assert said.status == 0, said
    assert all((folder / name).stat().st_size for name in ENDED)
    before, after = said.out.split("\nshots ")
    assert before.splitlines()[0] == "no --port: using the emulated launcher and table"
    hidden = read_model(folder / "hidden.toml")
    rng = np.random.default_rng([0, 7])
    cue = draw_hidden_cue(rng)
    assert hidden.parameters() == draw_hidden_table(MODEL, rng, "table_tilt").parameters()
    assert json.loads((folder / "hidden_cue.json").read_text())["constants"] == dataclasses.asdict(cue)
    assert "effects of the emulated table: table_tilt" in after and "shot   4: " in before
    told = json.loads(out.read_text())
    assert told["format"] == "billiard-learn/1" and told["shots"] == 4 and len(told["refits"]) == 1
    rows = {c["name"]: c for c in told["truth"]["constants"]}
    for name in ("decoupled_cloth.slide", "decoupled_cloth.roll", "table_tilt.slope_x"):
        assert rows[name]["hidden"] == pytest.approx(hidden.parameters()[name])
    roll = rows["decoupled_cloth.roll"]
    assert abs(roll["value"] - roll["hidden"]) < 0.1 * abs(roll["began"] - roll["hidden"])


def test_bad_input_is_one_line_status_2_and_leaves_nothing(run: Run, tmp_path: Path) -> None:
    other, bare, balls = tmp_path / "other.toml", tmp_path / "bare.toml", tmp_path / "balls.toml"
    write_model(full_model(Table(3.0, 1.5), SNOOKER_BALL), other)
    write_model(Model(SNOOKER_TABLE, SNOOKER_BALL), bare)
    pool = Ball(0.05715, 0.17)
    write_map(balls, CueingMap(Constants(), Geometry(pool), np.full((8, 8), math.nan), Execution()))
    full = tmp_path / "full"
    full.mkdir()
    (full / "thesis.txt").write_text("mine")
    before = contents(tmp_path)
    for words, part in (
        (("--shots", 0), "0 shots"),
        (("--every", 3), "a refit every 3"),
        (("--chosen", 10), "10 chosen shots"),
        (("--chosen", -1), "-1 chosen shots"),
        (("--balls", 1), "1 balls"),
        (("--balls", 9), "9 balls"),
        (("--seed", -1), "--seed -1"),
        (("--repeats", -1), "--repeats -1"),
        (("--effect", "tilt"), "unknown effect 'tilt'"),
        (("--effect", "table_tild"), "did you mean table_tilt"),
        (("--effect", "lens_distortion"), "changes no shot"),
        (("--hidden", tmp_path / "none.toml"), "none.toml"),
        (("--hidden", other), "its table or ball"),
        (("--hidden", bare), "lacks"),
        (("--model", bare), "lacks"),
        (("--model", tmp_path / "none.toml"), "none.toml"),
        (("--map", balls), "cueing map is for balls of 57.15 mm"),
        (("--map", other), "format"),
        (("--json", tmp_path / "no" / "told.json"), "its folder does not exist"),
        (("--out", full), "holds no series"),
        (("--out", other), "holds no series"),
    ):
        said = run("--out", tmp_path / "series", *words)
        assert said.status == 2, (words, said)
        [line] = said.err.splitlines()
        assert line.startswith("robot learn: ") and part in line, line
        assert contents(tmp_path) == before and not (tmp_path / "series").exists()
    for usage in ((), ("--out", "x", "--effect", "table_tilt", "--hidden", "y"), ("--out", "x", "--shots", "many")):
        assert run(*usage).status == 2
    assert contents(tmp_path) == before


def test_a_launcher_that_fails_ends_it_with_status_1(
    run: Run, quick: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from robot.device.protocol import LauncherError

    def dead(*given: Any, **more: Any) -> None:
        raise LauncherError("the line is dead")

    monkeypatch.setattr(robot.learning.loop, "play_plan", dead)
    said = run("--out", tmp_path / "series", "--shots", 1, "--every", 4)
    assert said.status == 1 and said.err.splitlines()[-1] == "robot learn: the line is dead"
    assert len(read_history(tmp_path / "series").shots) == 0
