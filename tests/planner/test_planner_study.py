"""A study of plans: its scenes and truths, its folder, its figures, and that nobody's clock or core shows in them."""

from __future__ import annotations

import copy
import dataclasses
import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import planner.cli
from models.commands.console import Progress, Status
from models.effect_catalogue import effect_class
from models.model_file import Estimate, full_model, read_model
from models.shot import Ball, Table, largest_overlap
from models.workers import open_workers
from planner.cli.study import StudyOptions
from planner.cli.study import study as cli_study
from planner.evaluation.play import Player
from planner.launcher.stroke import LauncherModel
from planner.scene import POCKETS, read_scene, scene_dict, scene_from
from planner.search.candidates import all_routes
from planner.study import folder as study_folder
from planner.study.draws import (
    AREA_M,
    AREA_POCKETS,
    CUSHION_CLEARANCE_M,
    MAX_CALLED_CUT_RAD,
    MIN_SEPARATION_RADII,
    PRIOR_SDS,
    UNMODELLED_EFFECTS,
    Study,
    draw_scene,
    draw_truth,
)
from planner.study.figures import figures
from planner.study.pictures import draw_study
from planner.study.report import markdown, text_table, write_report
from tests.support.clip_samples import refusal
from tests.support.quick_plans import STUDY

MODEL = STUDY.model
R = MODEL.ball.radius


def refused(action: Callable[..., object], *args: Any, **more: Any) -> str:
    return refusal(lambda: action(*args, **more))


def untimed(told: dict[str, Any]) -> str:
    return json.dumps({k: v for k, v in told.items() if k != "seconds"}, sort_keys=True)


@pytest.mark.parametrize("balls", [2, 5])
def test_scenes_are_what_a_strategist_would_ask_for(balls: int) -> None:
    study = dataclasses.replace(STUDY, balls=balls)
    pockets = set()
    for number in range(1, 9):
        scene, tries = draw_scene(study, number)
        xy, reach = scene.position, MODEL.table.centre_limits(MODEL.ball)
        assert tries >= 1 and len(scene.names) == balls and scene.goal.avoid == scene.names[2:]
        assert (xy[:, 0] <= AREA_M[0] - MODEL.table.length / 2).all() and (np.abs(xy[:, 1]) <= AREA_M[1] / 2).all()
        assert (np.abs(xy) <= reach).all() and (np.abs(xy[1]) <= reach - CUSHION_CLEARANCE_M + 1e-12).all()
        assert -largest_overlap(xy, MODEL.ball)[0] >= (MIN_SEPARATION_RADII - 2) * R - 1e-12
        pocket, rest = scene.goal.pocket, scene.goal.rest
        assert pocket in AREA_POCKETS and rest is not None and (np.abs(rest) <= reach).all()
        direct = [w for w in all_routes(scene) if w.bank < 0 and w.kick < 0]
        assert [POCKETS[w.pocket] for w in direct if not w.obstacle and w.cut < MAX_CALLED_CUT_RAD] == [pocket]
        assert scene_dict(scene_from(scene_dict(scene), "drawn")) == scene_dict(scene)
        pockets.add(pocket)
    assert len(pockets) > 1


def test_a_scene_is_its_number_and_seed_alone() -> None:
    one = [scene_dict(draw_scene(STUDY, number)[0]) for number in (4, 5)]
    assert [scene_dict(draw_scene(STUDY, number)[0]) for number in (5, 4)] == one[::-1]
    assert one[0] != one[1]
    assert scene_dict(draw_scene(dataclasses.replace(STUDY, seed=1), 4)[0]) != one[0]


def test_truths_differ_from_the_model_by_its_uncertainty_and_one_small_effect() -> None:
    known = MODEL.parameters()
    off: dict[str, list[float]] = {name: [] for name in PRIOR_SDS}
    seen = set()
    for number in range(1, 121):
        truth, drawn = draw_truth(STUDY, number)
        assert not truth.estimates  # it knows itself
        assert {e.name() for e in truth.effects} - {e.name() for e in MODEL.effects} == {drawn["effect"]}
        for name, value in drawn["constants"].items():
            off[name].append((value - known[name]) / PRIOR_SDS[name])
            assert truth.parameters()[name] == value
        for key, value in drawn["values"].items():
            meta = effect_class(drawn["effect"]).parameters()[key]
            size = abs(value - meta["off"]) / abs(meta["default"] - meta["off"])
            assert 0 < size <= 0.4 + 1e-9 and meta["bounds"][0] <= value <= meta["bounds"][1]
        if drawn["effect"] == "table_tilt":
            assert math.hypot(*drawn["values"].values()) == pytest.approx(2e-4)
        seen.add(drawn["effect"])
    assert seen == set(UNMODELLED_EFFECTS)
    for name, values in off.items():
        if name != "cushion_impact.restitution":  # whose bound of 1 is one sd away
            assert abs(np.mean(values)) < 0.35 and 0.8 < np.std(values) < 1.2, name


def test_truths_use_the_uncertainty_that_a_fit_tells_and_no_effect_that_the_model_holds() -> None:
    tight = {name: Estimate(1e-9, "fit") for name in PRIOR_SDS if name != "decoupled_cloth.spin"}
    model = dataclasses.replace(MODEL, estimates=tight).add(effect_class("table_tilt")())
    for number in range(1, 60):
        _, drawn = draw_truth(dataclasses.replace(STUDY, model=model), number)
        assert drawn["effect"] != "table_tilt"
        for name in tight:
            assert drawn["constants"][name] == pytest.approx(model.parameters()[name], abs=1e-7)
        assert drawn["constants"]["decoupled_cloth.spin"] != model.parameters()["decoupled_cloth.spin"]


def test_effects_of_a_truth_change_no_more_than_the_cue_delivers() -> None:
    """Every one that may be drawn can be played, and none is of the camera."""
    scene, _ = draw_scene(STUDY, 1)
    for name in UNMODELLED_EFFECTS:
        kind = effect_class(name)
        assert kind.opens("edit", "forces", "impact") or name == "squirt"
        assert name in {e.name() for e in Player(MODEL.add(kind()), scene, LauncherModel()).model.effects}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scenes, then a third."""
    out = tmp_path_factory.mktemp("plans") / "study"
    for count in (2, 3):
        study_folder.begin(out, STUDY)
        study_folder.carry_out(out, STUDY, count, None, Progress())
    return out


@pytest.mark.slow
def test_jobs_and_order_change_no_figure(folder: Path, tmp_path: Path) -> None:
    """The second scene is the first of its process."""
    kept = study_folder.read_scenes(folder, 3)
    assert [s["number"] for s in kept] == [1, 2, 3] and not any("error" in s for s in kept)
    study_folder.begin(tmp_path / "study", STUDY)
    with open_workers(None, 2) as workers:
        study_folder.carry_out(tmp_path / "study", STUDY, 2, workers, Progress())
    assert [*map(untimed, study_folder.read_scenes(tmp_path / "study", 2))] == [*map(untimed, kept[:2])]


def test_what_is_told_of_a_scene_holds_together(folder: Path) -> None:
    for told in study_folder.read_scenes(folder, 3):
        one, top = told["methods"]["risk"], told["ceiling"]
        seen = one["seen"]
        assert 0 <= seen["made"] <= seen["potted"] <= 1 and seen["made"] <= 1 - seen["foul"] + 1e-12
        assert len(seen["away"]) <= round(seen["potted"] * STUDY.plays)
        assert top["by"] in ("search", "risk") and 0 <= top["made"] <= 1
        if top["by"] == "risk":  # the same stroke on the same plays
            assert top["made"] == seen["made"] and top["stroke"] == one["stroke"]


def test_a_study_goes_on_from_what_is_there(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    worked: list[int] = []

    def fake(_: Study, number: int) -> dict[str, Any]:
        worked.append(number)
        return {"number": number, "error": "not worked out", "seconds": {}}

    monkeypatch.setattr("planner.study.runs.study_scene", fake)
    before = [study_folder.scene_path(folder, k).read_bytes() for k in (1, 2, 3)]
    study_folder.scene_path(folder, 5).write_text("{half a")
    study_folder.carry_out(folder, STUDY, 5, None, Progress())
    assert worked == [4, 5]
    assert [study_folder.scene_path(folder, k).read_bytes() for k in (1, 2, 3)] == before
    for k in (4, 5):
        study_folder.scene_path(folder, k).unlink()
    assert not list(folder.rglob(".*"))


def test_ctrl_c_keeps_what_is_done(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stopped(_: Study, number: int) -> dict[str, Any]:
        raise KeyboardInterrupt

    monkeypatch.setattr("planner.study.runs.study_scene", stopped)
    monkeypatch.setattr(StudyOptions, "study", lambda self: STUDY)
    words = ["study", "--out", str(folder), "--scenes", "4", "--jobs", "1"]
    assert planner.cli.main(words) == Status.INTERRUPTED
    assert f"3 of 4 scenes are kept in {folder}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"seed": 7}, "seed 0, now it is 7"),
        ({"balls": 3}, "balls 2, now it is 3"),
        ({"method": "both"}, "method risk, now it is both"),
        ({"plays": 25}, "plays 8, now it is 25"),
        (
            {"execution": dataclasses.replace(STUDY.execution, azimuth_sd=0.002)},
            "0.001, now it is azimuth_sd",
        ),
        ({"model": MODEL.with_values({"decoupled_cloth.slide": 0.21})}, "started with model "),
    ],
)
def test_other_settings_are_refused(folder: Path, change: dict[str, Any], told: str) -> None:
    text = refused(study_folder.begin, folder, dataclasses.replace(STUDY, **change))
    assert told in text and "--out" in text


def test_other_sources_are_refused(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study_folder, "fingerprint", lambda: "another")
    assert "started with sources" in refused(study_folder.begin, folder, STUDY)


def made_up(number: int, promised: float, seen: float, paper: float, top: float) -> dict[str, Any]:
    """A scene of which everything is known."""
    scene = scene_dict(draw_scene(STUDY, 1)[0])

    def method(share: float) -> dict[str, Any]:
        told = {"potted": share, "made": share, "foul": 0.0, "away": [0.01, 0.03], "median": 0.02, "median_all": 0.05}
        rest = {"distance_median": 0.02}
        return {
            "stroke": {"speed": 1.0}, "tracks": [{"ball": "white", "xy": [[0, 0], [0.5, 0.1]]}],
            "predicted": {"pot_probability": {"value": promised}, "value": share, "rest": rest},
            "seen": told | {"fouls": dict.fromkeys(("in-off", "wrong ball first", "another ball potted",
                                                    "forbidden touch"), 0.0)},
        }  # fmt: skip

    return {
        "number": number, "scene": scene, "methods": {"risk": method(seen), "ga": method(paper)},
        "truth": {"effect": "squirt", "values": {"per_offset": 0.3}, "constants": {"decoupled_cloth.roll": 0.0127}},
        "ceiling": {"made": top, "potted": top, "by": "search"},
        "seconds": {"risk": float(number), "ga": 1.0, "all": 9.0},
    }  # fmt: skip


def test_figures_of_known_scenes() -> None:
    scenes = [made_up(k, 0.65, 0.5 + 0.02 * k, 0.6, 0.9) for k in range(1, 7)]
    scenes += [made_up(7, 0.05, 1.0, 0.5, 1.0), {"number": 8, "error": "IndexError", "seconds": {}}]
    told = figures(scenes)
    assert told["scenes"] == 7 and told["failed"] == [[8, "IndexError"]]
    made = np.array([0.52, 0.54, 0.56, 0.58, 0.60, 0.62, 1.0])
    assert told["methods"]["risk"]["made"]["mean"] == pytest.approx(made.mean())
    assert told["methods"]["risk"]["made"]["se"] == pytest.approx(made.std(ddof=1) / math.sqrt(7))
    assert told["methods"]["risk"]["seconds_median"] == 4.0
    assert told["methods"]["ga"]["away_pooled"] == pytest.approx(0.02)
    bins = told["calibration"]["risk"]["bins"]
    assert [(b["from"], b["scenes"]) for b in bins] == [(0.0, 1), (0.6, 6)]
    assert told["calibration"]["risk"]["largest_gap"] == pytest.approx(0.65 - 0.57)  # the lone scene's does not count
    against = told["against"]
    assert [against[k] * 7 for k in ("better", "equal", "worse")] == pytest.approx([2, 1, 4])
    assert against["overlooked"] == [1, 2, 3, 4]
    assert told["worst"][0]["number"] == 1


def test_a_scene_without_a_stroke_counts_as_not_potted() -> None:
    scene = made_up(1, 0.9, 0.0, 0.4, 0.8)
    scene["methods"]["risk"] |= {"stroke": None, "predicted": None}
    scene["methods"]["risk"]["seen"] |= {"away": [], "median": None, "median_all": None}
    scene["methods"]["risk"].pop("tracks")
    scenes = [scene, made_up(2, 0.9, 1.0, 0.4, 1.0)]
    told = figures(scenes)
    assert told["methods"]["risk"]["none"] == 1 and told["methods"]["risk"]["made"]["mean"] == 0.5
    assert sum(b["scenes"] for b in told["calibration"]["risk"]["bins"]) == 1
    assert draw_study(scenes, told).startswith(b"\x89PNG")


def test_the_report_is_the_same_for_the_same_scenes(folder: Path, tmp_path: Path) -> None:
    scenes = study_folder.read_scenes(folder, 3)
    for name in ("one", "two"):
        write_report(tmp_path / f"{name}.md", scenes, study_folder.describe(STUDY), folder)
        scenes = copy.deepcopy(scenes)
    one, two = ((tmp_path / f"{n}.md").read_text(encoding="utf-8") for n in ("one", "two"))
    assert one == two.replace("two.png", "one.png")
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()
    for text in ("3 random scenes of 2 balls", "(one.png)", "| potted without a foul |", "## Calibration, ours",
                 f"planner study --out {folder.name} --scene N"):  # fmt: skip
        assert text in one


def test_no_scene_yet_is_told() -> None:
    told = figures([])
    assert text_table(told).startswith("0 scenes") and "No scene yet" in markdown(
        told, study_folder.describe(STUDY), "x", "y"
    )
    assert draw_study([], told).startswith(b"\x89PNG")


def run(out: Path, *more: str) -> int:
    """The verb as the command line runs it."""
    return int(cli_study.main(["--out", str(out), *more], standalone_mode=False, obj=Progress()))


def test_the_verb_tells_and_writes(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(StudyOptions, "study", lambda self: STUDY)
    wanted = [tmp_path / name for name in ("r.md", "f.json")]
    words = (folder, "--scenes", "3", "--report", str(wanted[0]), "--json", str(wanted[1]))
    assert run(*words) == 0
    said = capsys.readouterr().out
    assert "3 scenes" in said and "potted without a foul" in said and str(wanted[0]) in said
    assert json.loads(wanted[1].read_text(encoding="utf-8"))["scenes"] == 3
    assert (tmp_path / "r.png").read_bytes().startswith(b"\x89PNG")


def test_a_scene_can_be_looked_at(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    assert run(folder, "--scene", "2", str(path)) == 0
    assert scene_dict(read_scene(path)) == scene_dict(draw_scene(STUDY, 2)[0])
    kept = read_model(folder / "model.toml")
    assert kept.parameters() == MODEL.parameters()
    assert {n: kept.estimates[n].sd for n in PRIOR_SDS} == PRIOR_SDS
    for number in ("9", "two"):
        text = refused(run, folder, "--scene", number, str(path))
        assert f"--scene {number}" in text


def test_bad_input_is_refused_in_a_line(tmp_path: Path) -> None:
    full = tmp_path / "full"
    full.mkdir()
    (full / "other.txt").write_text("x")
    (tmp_path / "file").write_text("x")
    for more, told in (
        (("--scenes", "0"), "--scenes 0"), (("--jobs", "0"), "--jobs 0"), (("--balls", "1"), "1 balls"),
        (("--balls", "9"), "9 balls"), (("--seed", "-1"), "seed -1"), (("--report", "no/such/r.md"), "no/such/r.md"),
        (("--report", str(tmp_path / "r.png")), "r.png"), (("--model", str(tmp_path / "no.toml")), "no.toml"),
    ):  # fmt: skip
        assert told in refused(run, tmp_path / "new", *more)
        assert not (tmp_path / "new").exists()
    assert "something other than a study" in refused(study_folder.begin, full, STUDY)
    assert "is a file" in refused(study_folder.begin, tmp_path / "file", STUDY)
    (full / "study.json").write_text("[]")
    assert "not made by this program" in refused(study_folder.begin, full, STUDY)
    bare = full_model(Table(2.0, 1.0, pockets=False), Ball(0.0525, 0.1406))
    assert "no pockets" in refused(Study, bare)
    assert "'best'" in refused(Study, MODEL, method="best")


@pytest.mark.parametrize("text", ["{}", '{"number": 1, "methods": 3}', '{"methods": {"risk": []}, "ceiling": null}'])
def test_a_damaged_scene_is_named_in_a_line(
    folder: Path, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(folder, tmp_path / "study")
    study_folder.scene_path(tmp_path / "study", 1).write_text(text)
    monkeypatch.setattr(StudyOptions, "study", lambda self: STUDY)
    assert planner.cli.main(["study", "--out", str(tmp_path / "study"), "--scenes", "3"]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert "scenes" in line and "remove the scene's file" in line
