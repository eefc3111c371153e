"""The `planner` command: exit statuses, one-line errors, files that are whole or absent; plans and scenes."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import planner.planning
from models.analytic.cue_impulse import Geometry
from models.effects.cue.squirt import Squirt
from models.model_file import full_model, write_model
from models.shot import Ball, Table
from planner.cli.verbs import main
from planner.launcher.cueing_map import CueingMap, write_map
from planner.launcher.execution import Execution
from planner.planning import make_plan, read_plan
from planner.scene import read_scene, write_scene
from tests.support.clip_samples import contents, edit
from tests.support.commands import EXAMPLE, Said, said_by
from tests.support.planned_shots import BALL, HALF, MODEL, TABLE, TRUE, R, scene, straight
from tests.support.quick_plans import QUICK

RUBBISH = "[execution]\nspeed = 0.1\n"


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Any:
    """The command with little effort."""

    def quick(*args: Any, **kwargs: Any) -> dict[str, Any]:
        return make_plan(*args, **kwargs | {"effort": QUICK})

    monkeypatch.setattr(planner.planning, "make_plan", quick)

    def play(*words: str | Path) -> Said:
        return said_by(main, words, capsys)

    return play


@pytest.fixture
def asked(tmp_path: Path) -> Path:
    """An easy pot into a corner, with a place wanted."""
    path = tmp_path / "scene.toml"
    write_scene(straight(0.5, 0.4, [-1.0, 0.3], pocket=(1, 1), rest=HALF - 0.6), path)
    return path


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "m.toml"
    write_model(MODEL, path)
    return path


def refused(run: Any, folder: Path, verb: str, *words: str | Path) -> str:
    """The error of a refused command: one line, the verb first, no file touched."""
    before = contents(folder)
    said = run(verb, *words)
    assert said.status == 2, said
    [line] = said.err.splitlines()
    assert line.startswith(f"planner {verb}: ") and line.isprintable() and "Traceback" not in said.out
    assert contents(folder) == before
    return str(line)


def test_no_verb_and_unknown_verbs_are_usage(run: Any) -> None:
    for words in ((), ("pln",), ("plan",), ("plan", "s.toml", "--method", "best", "--out", "p")):
        said = run(*words)
        assert said.status == 2 and said.err.startswith("planner") and len(said.err.splitlines()) == 1
    said = run("--help")
    assert said.status == 0 and all(verb in said.out for verb in ("scene", "plan", "study"))


@pytest.mark.slow
def test_a_plan_is_written_told_and_drawn(run: Any, asked: Path, model: Path, tmp_path: Path) -> None:
    out = {kind: tmp_path / f"p.{kind}" for kind in ("json", "html", "png", "rrd")}
    drawn = [
        w for flag, kind in (("report", "html"), ("picture", "png"), ("rrd", "rrd")) for w in (f"--{flag}", out[kind])
    ]
    said = run("plan", asked, "--model", model, "--out", out["json"], *drawn)
    assert (said.status, said.err) == (0, "")
    plan = read_plan(out["json"])
    assert plan["format"] == "billiard-plan/1" and plan["model"]["file"] == "m.toml"
    assert plan["pot_probability"]["value"] > 0.95
    string = plan["launcher"]["string"]
    for words in (string, "corner pocket +x +y", str(out["json"]), str(out["html"]), str(out["rrd"]), "yaw: "):
        assert words in said.out, words
    page = out["html"].read_text()
    assert "<html" in page and string in page
    assert out["png"].read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" and out["png"].stat().st_size > 5000
    assert out["rrd"].stat().st_size > 5000
    assert not [
        p for p in tmp_path.iterdir() if p.name not in {"scene.toml", "m.toml", *(q.name for q in out.values())}
    ]


def test_the_same_seed_writes_the_same_plan(run: Any, asked: Path, tmp_path: Path) -> None:
    first = run("plan", asked, "--out", tmp_path / "1.json", "--seed", "5")
    assert "no --model" in first.out and "no --execution" in first.out
    assert run("plan", asked, "--out", tmp_path / "2.json", "--seed", "5").status == first.status == 0
    one, two = ((tmp_path / f"{k}.json").read_bytes() for k in (1, 2))
    assert one == two and read_plan(tmp_path / "1.json")["seed"] == 5


def test_options_reach_the_plan(run: Any, asked: Path, tmp_path: Path) -> None:
    given = dataclasses.replace(MODEL, execution={"speed_sd": 0.03, "azimuth_sd": 0.002})
    write_model(given.add(Squirt(1.5)), tmp_path / "m.toml")
    words = ("plan", asked, "--model", tmp_path / "m.toml", "--out", tmp_path / "p.json")
    assert run(*words).status == 0
    told = read_plan(tmp_path / "p.json")
    assert told["execution"]["speed_sd"] == 0.03 and told["execution"]["side_sd"] == 0.0005
    assert "squirt" in told["model"]["effects"] and told["launcher"]["squirt"] == 0.0
    (tmp_path / "e.toml").write_text("[execution]\nazimuth_sd = 0.004\n")
    more = ("--execution", tmp_path / "e.toml", "--cue-speed", "0.9", "1.3", "--rest-weight", "0.7", "--far", "0.3")
    assert run(*words, *more, "--foul-cost", "1", "--overwrite").status == 0
    told = read_plan(tmp_path / "p.json")
    assert told["execution"]["azimuth_sd"] == 0.004 and told["execution"]["speed_sd"] == 0.012
    assert told["weights"] == {"rest": 0.7, "far": 0.3, "foul": 1.0}
    for one in (told, *told["alternatives"]):
        assert 0.9 <= one["launcher"]["cue_speed"] <= 1.3


@pytest.mark.slow
def test_a_map_makes_terms_of_its_own_launcher(run: Any, asked: Path, tmp_path: Path) -> None:
    out, file = tmp_path / "p.json", tmp_path / "map.toml"
    made = CueingMap(TRUE, Geometry(BALL), np.full((8, 8), np.nan), Execution(0.01, 8e-4, 3e-4, 3e-4))
    write_map(file, made)
    assert run("plan", asked, "--out", out, "--map", file).status == 0
    plan = read_plan(out)
    told, stroke = plan["launcher"], plan["stroke"]
    given = made.forward(*(np.array([v]) for v in (told["cue_speed"], 1e-3 * told["x0_mm"], 1e-3 * told["y0_mm"])))
    wanted = [stroke["speed"], told["squirt"], stroke["side"], stroke["height"]]
    assert np.ravel(given) == pytest.approx(wanted, abs=2e-6)
    assert plan["execution"]["speed_sd"] == 0.01, "the map's repeatability"
    write_map(file, dataclasses.replace(made, geometry=Geometry(Ball(0.0572, 0.17))))
    assert "the cueing map is for balls of 57.2 mm" in refused(
        run, tmp_path, "plan", asked, "--out", tmp_path / "p2.json", "--map", file
    )


def test_the_papers_method_by_name(run: Any, asked: Path, tmp_path: Path) -> None:
    assert run("plan", asked, "--method", "ga", "--out", tmp_path / "p.json").status == 0
    told = read_plan(tmp_path / "p.json")
    assert told["method"] == "ga" and "differential evolution" in told["why"] and told["launcher"]["cue_speed"] < 2.2


def test_where_no_shot_is_reasonable(run: Any, tmp_path: Path) -> None:
    red = np.array([0.6, 0.2])
    ring = [red + 2.04 * R * np.array([math.cos(a), math.sin(a)]) for a in np.arange(6) * math.pi / 3 + 0.1]
    write_scene(scene([-0.5, 0.0], red, *ring), tmp_path / "s.toml")
    names = [tmp_path / name for name in ("p.json", "p.html", "p.png", "p.rrd")]
    said = run(
        "plan", tmp_path / "s.toml", "--out", names[0], "--report", names[1], "--picture", names[2], "--rrd", names[3]
    )
    assert (said.status, said.err) == (1, "")
    plan = json.loads(names[0].read_text())
    assert (
        plan["stroke"] is None
        and plan["alternatives"] == []
        and "b0 is in the red's way" in plan["why"]
        and plan["why"] in said.out
    )
    assert all(p.stat().st_size > 0 for p in names)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--cue-speed", "2", "1"), "--cue-speed 2 1"),
        (("--cue-speed", "0.1", "2"), "0.3 to 2.75 m/s"),
        (("--cue-speed", "1", "9"), "--cue-speed 1 9"),
        (("--cue-speed", "nan", "2"), "--cue-speed nan 2"),
        (("--rest-weight", "1.5"), "--rest-weight 1.5"),
        (("--rest-weight", "nan"), "--rest-weight nan"),
        (("--far", "0"), "--far 0"),
        (("--foul-cost", "-1"), "--foul-cost -1"),
        (("--model", "absent.toml"), "absent.toml"),
        (("--execution", "absent.toml"), "absent.toml"),
        (("--report", "nowhere/p.html"), "nowhere"),
        (("--rrd", "nowhere/p.rrd"), "nowhere"),
        (("--effects", "nowhere"), "nowhere"),
    ],
)
def test_bad_options_of_plan(run: Any, asked: Path, tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    assert said in refused(run, tmp_path, "plan", asked, "--out", tmp_path / "p.json", *words)


def test_bad_files_of_plan(run: Any, asked: Path, model: Path, tmp_path: Path) -> None:
    def line(*words: str | Path, out: str = "p.json", source: Path = asked) -> str:
        return refused(run, tmp_path, "plan", source, "--out", tmp_path / out, *words)

    assert "absent.toml" in line(source=tmp_path / "absent.toml")
    assert "nowhere" in line(out="nowhere/p.json")
    (tmp_path / "e.toml").write_text(RUBBISH)
    assert "unknown key 'speed': did you mean 'speed_sd'?" in line("--execution", tmp_path / "e.toml")
    write_model(full_model(Table(2.54, 1.27), Ball(0.05715, 0.17)), tmp_path / "pool.toml")
    text = line("--model", tmp_path / "pool.toml")
    assert "the scene and the model differ in table.length (3.569 and 2.54) and table.width (1.778 and 1.27)" in text
    write_model(dataclasses.replace(MODEL, effects=MODEL.effects[1:]), tmp_path / "bare.toml")
    assert "it has no effect for cloth; fit one" in line("--model", tmp_path / "bare.toml")
    write_model(dataclasses.replace(MODEL, execution={"sped_sd": 0.1}), tmp_path / "sped.toml")
    assert "sped_sd" in line("--model", tmp_path / "sped.toml")
    edit(asked, "pocket = [\n    1,\n    1,\n]", "pocket = [1, 0]")
    assert "is not a pocket" in line("--model", model)


# Scenes.


def test_a_scene_from_the_example_and_a_plan_for_it(run: Any, tmp_path: Path) -> None:
    out = tmp_path / "s.toml"
    goal = ("--object", "red", "--pocket=+x-y", "--rest-region", "0.2", "-0.1", "0.3", "--out", out)
    said = run("scene", EXAMPLE, "--clip", "10", *goal)
    assert (said.status, said.err) == (0, "")
    made = read_scene(out)
    assert (made.table, made.ball, made.names) == (TABLE, BALL, ("cue", "red"))
    assert made.goal.pocket == (1, -1) and made.goal.rest_radius == 0.3 and made.goal.cue == "cue"
    assert str(out) in said.out and f"{made.position[1, 0]:.4f}" in said.out
    assert run("plan", out, "--out", tmp_path / "p.json").status in (0, 1)
    assert read_plan(tmp_path / "p.json")["scene"]["balls"]["red"] == made.position[1].tolist()


@pytest.mark.parametrize(
    ("text", "pocket"),
    [("any", None), ("+x+y", (1, 1)), ("-y-x", (-1, -1)), ("-y", (0, -1)), ("+y", (0, 1)), ("+y-x", (-1, 1))],
)
def test_pockets_by_their_sides(run: Any, tmp_path: Path, text: str, pocket: Any) -> None:
    words = ("--clip", "10", "--object", "red", f"--pocket={text}", "--out", tmp_path / "s.toml")
    assert run("scene", EXAMPLE, *words).status == 0
    assert read_scene(tmp_path / "s.toml").goal.pocket == pocket


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--pocket=+x+x",), "--pocket +x+x"),
        (("--pocket=x",), "--pocket x"),
        (("--pocket=+x",), "--pocket +x"),
        (("--pocket=",), "--pocket"),
        (("--pocket=+x+y+x",), "--pocket +x+y+x"),
        (("--camera", "cam.toml"), "omit it"),
        (("--clip", "13"), "13"),
        (("--object", "rde"), "'rde'"),
        (("--rest", "9", "0"), "rest"),
        (("--rest-for", "blue"), "blue"),
        (("--avoid", "red"), "avoid"),
    ],
)
def test_bad_options_of_scene(run: Any, tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    base = (EXAMPLE, "--clip", "10", "--object", "red", "--out", tmp_path / "s.toml")
    assert said in refused(run, tmp_path, "scene", *base, *words)


def test_bad_sources_of_scene(run: Any, tmp_path: Path) -> None:
    rest = ("--object", "red", "--out", tmp_path / "s.toml")
    (tmp_path / "photo.png").write_bytes(b"no picture")
    (tmp_path / "cam.toml").write_text("x = 1")
    assert "needs --camera" in refused(run, tmp_path, "scene", tmp_path / "photo.png", *rest)
    camera = ("--camera", tmp_path / "cam.toml")
    assert "cam.toml" in refused(run, tmp_path, "scene", tmp_path / "photo.png", *camera, *rest)
    assert "absent" in refused(run, tmp_path, "scene", tmp_path / "absent", "--camera", tmp_path / "absent.toml", *rest)
    words = ("scene", EXAMPLE, "--clip", "10", "--object", "red", "--out", tmp_path / "nowhere" / "s.toml")
    assert "nowhere" in refused(run, tmp_path, *words)
    said = run("scene", EXAMPLE, *rest, "--rest", "0", "0", "--rest-for", "blue")
    assert said.status == 2 and "--rest and --rest-for" in said.err
