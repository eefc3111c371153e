"""A plan on paper, as a picture and as a recording: its figures are there, whole or not at all, the same again."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from models.errors import BadInput
from models.recording.plan import write_plan
from models.recording.planned import dropped, fate, outline, sentence
from models.shot import Array, Table
from planner.report import write_picture, write_report
from tests.support.html_pages import STRANGE, Page
from tests.support.outputs import check_bad_places, check_page, check_recording
from tests.support.plan_samples import BALL, BALLS, HALF, REST, TABLE, sample
from tests.support.reviewed_clips import column, read, seconds


def no_shot() -> dict[str, Any]:
    """A plan that says that there is nothing to play."""
    keys = ("format", "method", "seed", "scene", "model", "execution")
    why = "Every way to the red leads through the blue."
    return {key: sample(2, 2)[key] for key in keys} | {"stroke": None, "why": why}


@pytest.fixture(scope="module")
def plan() -> dict[str, Any]:
    return sample()


@pytest.fixture(scope="module")
def page(plan: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("plan") / "plan.html"
    write_report(path, plan, "Red into the corner")
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def recorded(plan: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Any]]:
    path = tmp_path_factory.mktemp("plan") / "plan.rrd"
    write_plan(path, plan, title="Red into the corner")
    return read(path)


def inside(ring: Array, points: Array) -> Array:
    """Which points (n, 2) a closed convex line (m, 2), counter-clockwise or clockwise, holds: (n,)."""
    side = np.diff(ring, axis=0)
    to = points[:, None] - ring[None, :-1]
    turn = side[:, 0] * to[..., 1] - side[:, 1] * to[..., 0]
    return np.asarray((turn >= 0).all(axis=1) | (turn <= 0).all(axis=1))


def test_an_outline_holds_its_share_whatever_the_cloud() -> None:
    rng = np.random.default_rng(0)
    for cloud in (rng.normal(size=(800, 2)) * [0.2, 0.01], rng.random((800, 2)) ** 3, rng.standard_t(3, (800, 2))):
        for share in (0.5, 0.9):
            assert inside(outline(cloud, share), cloud).mean() == pytest.approx(share, abs=0.01)


def test_an_outline_turns_and_moves_with_its_cloud() -> None:
    cloud = np.random.default_rng(1).normal(size=(300, 2)) * [0.1, 0.02]
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    here, there = outline(cloud, 0.5), outline(cloud @ turn.T + [0.3, -1.0], 0.5)
    grid = np.random.default_rng(2).uniform(-0.2, 0.2, (2000, 2))
    assert (inside(here, grid) == inside(there, grid @ turn.T + [0.3, -1.0])).all()
    assert 50 < inside(here, grid).sum() < 1000


def test_few_or_equal_places_have_a_small_outline_or_none() -> None:
    assert outline(np.zeros((3, 2)), 0.5).shape == (0, 2)
    assert np.abs(outline(np.ones((9, 2)), 0.9) - 1).max() < 1e-3


@pytest.mark.parametrize("sx", (-1, 1))
@pytest.mark.parametrize("sy", (-1, 1))
def test_what_lies_in_a_pocket_has_dropped_and_what_rests_at_a_cushion_has_not(sx: int, sy: int) -> None:
    reach, sign = TABLE.centre_limits(BALL), np.array([sx, sy])
    for place in (HALF, HALF - 0.031, HALF + 0.03, np.array([0.01, reach[1] + 0.002]), np.array([0, HALF[1] + 0.04])):
        assert dropped(TABLE, BALL, sign * place), place
    for place in (reach - [0.2, 0], reach - [0, 0.2], np.array([0.0, reach[1] - 0.01]), np.array([0.02, reach[1]])):
        assert not dropped(TABLE, BALL, sign * place), place
    assert not dropped(Table(3.569, 1.778, pockets=False), BALL, HALF)


def test_a_foul_outweighs_the_pot() -> None:
    said = [fate({"potted": potted, "foul": foul}) for potted in (True, False) for foul in ("", "in-off")]
    assert said == ["potted", "foul", "missed", "foul"]


def test_the_figures_of_the_plan_are_on_paper(page: str) -> None:
    words = " ".join(Page(page).words)
    for figure in (
        "073p", "-3.0 mm", "+5.0 mm", "22.70°", "0.3962", "-0.12° to +0.10°", "1.86 m/s", "2.31 m/s", "6.5°",
        "87 % (84 to 90)", "5 % (3 to 7)", "touches pink", "3.6 %", "in-off", "1.0 %", "6 mm of yaw", "0.074°", "1.2 %",
        "0.5 mm", "0.8 mm", "fitted.toml", "ball_impact", "0.83", "61 % (50 to 70)", "120p", "3.50 m/s",
        "40 drawn as lines, 500 as resting positions", "strike the white 3 mm left and 5 mm above centre",
        "the red goes into the corner pocket +x +y, in about 87 of 100 plays", "3.569 m × 1.778 m",
    ):  # fmt: skip
        assert figure in words, figure


def test_the_page_is_whole_and_needs_nothing_else(page: str) -> None:
    check_page(page, 6)  # face, table, resting places, three alternatives


def test_figures_count_samples_by_outcome(page: str, plan: dict[str, Any]) -> None:
    _, above, rest, *_ = Page(page).pictures()
    count = [sum(fate(draw) == word for draw in plan["fan"]) for word in ("potted", "missed", "foul")]
    assert sum(count) == 40
    assert min(count) > 0
    for word, number in zip(("potted", "missed", "foul"), count, strict=True):
        assert f"{word} in {number} of 40 samples" in above
    far = 1e3 * np.hypot(*(np.array(plan["places"]["cue"]) - REST).T)
    assert f"50 % within {np.median(far):#.3g} mm" in rest
    assert "red, object ball" in above


def test_the_same_plan_gives_the_same_bytes(page: str, tmp_path: Path) -> None:
    again = json.loads(json.dumps(sample()))
    write_report(tmp_path / "a.html", again, "Red into the corner")
    assert (tmp_path / "a.html").read_text(encoding="utf-8") == page
    for name in ("a.png", "b.png"):
        write_picture(tmp_path / name, again)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_the_picture_is_the_table_with_its_balls(tmp_path: Path, plan: dict[str, Any]) -> None:
    write_picture(tmp_path / "plan.png", plan)
    picture = cv2.imread(str(tmp_path / "plan.png"))[..., ::-1].astype(int)
    assert picture.shape[1] > 1400
    assert (np.abs(picture - (18, 92, 58)).sum(axis=2) < 6).mean() > 0.5  # cloth
    for colour in ((255, 215, 0), (215, 25, 35), (45, 100, 255), (0, 185, 85)):
        spot = np.abs(picture - colour).sum(axis=2) < 6
        assert spot.sum() > 100, colour
    yellow = np.argwhere(np.abs(picture - (255, 215, 0)).sum(axis=2) < 6)
    assert np.ptp(yellow, axis=0)[0] == pytest.approx(np.ptp(yellow, axis=0)[1], abs=2)  # a ball is round


def test_a_plan_without_a_stroke_tells_why(tmp_path: Path) -> None:
    plan = no_shot()
    write_report(tmp_path / "none.html", plan, "Nothing")
    write_picture(tmp_path / "none.png", plan)
    write_plan(tmp_path / "none.rrd", plan, title="Nothing")
    words = " ".join(Page((tmp_path / "none.html").read_text(encoding="utf-8")).words)
    assert "No shot on the red is reasonable here." in words
    assert "Every way to the red leads through the blue." in words
    assert "What to set" not in words
    text = column(read(tmp_path / "none.rrd")["/text/plan"], "TextDocument:text")[0][0]
    assert "leads through the blue" in text


@pytest.mark.parametrize("rest", ({}, {"rest_for": "black"}, {"rest_region": [0.8, -0.2, 0.15]}))
def test_a_plan_of_few_words_is_drawn(rest: dict[str, Any], tmp_path: Path) -> None:
    """No draws, no launcher's terms, no interval, a cue ball that may go anywhere, a table without pockets."""
    plan = sample(0, 6)
    del plan["scene"]["goal"]["rest"], plan["launcher"], plan["fan"], plan["execution"], plan["alternatives"]
    plan["scene"]["goal"] |= rest
    plan["scene"]["table"]["pockets"] = False
    plan["rest"] = {"mean": [0.1, 0.2], "sd": None, "distance_median": None, "distance_90": None}
    plan["pot_probability"] = {"value": 0.5, "low": None, "high": None}
    write_report(tmp_path / "few.html", plan, "t")
    write_plan(tmp_path / "few.rrd", plan, title="t")
    page = (tmp_path / "few.html").read_text(encoding="utf-8")
    assert "50 % (– to –)" in page
    assert "nan" not in re.sub(r"base64,[^\"]+", "", page)
    if "rest_for" in rest:
        assert "wanted: a shot on black" in Page(page).pictures()[1]


def test_text_of_any_kind_stays_text(tmp_path: Path) -> None:
    plan = sample(2, 20)
    plan["why"] = plan["kind"] = plan["alternatives"][0]["kind"] = plan["model"]["file"] = STRANGE
    plan["fouls"] = {STRANGE: 0.5}
    write_report(tmp_path / "x.html", plan, STRANGE)
    page = Page((tmp_path / "x.html").read_text(encoding="utf-8"))
    assert page.open == []
    assert "script" not in {tag for tag, _ in page.seen}


def test_the_sentence_names_the_tip_and_the_pocket() -> None:
    plan = sample(0, 6)
    for launcher, where in (
        ({"x0_mm": 0.0, "y0_mm": 0.0}, "in the centre"),
        ({"x0_mm": 4.0, "y0_mm": 0.0}, "4 mm right of centre"),
        ({"x0_mm": 0.0, "y0_mm": -2.5}, "2.5 mm below centre"),
    ):
        plan["launcher"] |= launcher
        assert f"strike the white {where} with string 073p" in sentence(plan)


def test_balls_run_as_planned_and_a_potted_one_goes(recorded: dict[str, list[Any]], plan: dict[str, Any]) -> None:
    for track in plan["tracks"]:
        batches = [b for b in recorded[f"/top/shot/ball/{track['ball']}"] if "shot_time" in b.schema.names]
        rows, times = column(batches, "Points2D:positions"), seconds(batches)
        points = np.array([row[0] for row in rows if row])
        assert points == pytest.approx(np.array(track["xy"]), abs=1e-6)
        assert times[: len(track["t"])] == pytest.approx(track["t"], abs=1e-6)
        assert (rows[-1] == []) is (track["ball"] == "red")
    (blue,) = column(recorded["/top/shot/ball/blue"], "Points2D:positions")
    assert blue[0] == pytest.approx(BALLS["blue"])
    high = column(recorded["/space/shot/ball/blue"], "Points3D:positions")[0][0]
    assert high[2] == pytest.approx(BALL.radius)


def test_draws_and_alternatives_lie_on_paths_of_their_own(recorded: dict[str, list[Any]], plan: dict[str, Any]) -> None:
    for word in ("potted", "missed", "foul"):
        tracks = sum(len(draw["tracks"]) for draw in plan["fan"] if fate(draw) == word)
        assert len(column(recorded[f"/top/fan/{word}"], "LineStrips2D:strips")[0]) == tracks > 0
    potted = np.array(plan["places"]["potted"])
    assert len(column(recorded["/top/rest/potted"], "Points2D:positions")[0]) == potted.sum()
    assert len(column(recorded["/top/rest/missed"], "Points2D:positions")[0]) == (~potted).sum() > 0
    assert len(column(recorded["/top/rest/outline"], "LineStrips2D:strips")[0]) == 2
    for number in (1, 2, 3):
        assert f"/top/alternative/{number}/ball/red" in recorded
    assert "/top/alternative/4/ball/red" not in recorded
    assert {"/top/wanted", "/top/avoid/pink", "/top/table/pockets"} <= set(recorded)


def test_the_recording_tells_what_to_play(recorded: dict[str, list[Any]]) -> None:
    text = column(recorded["/text/plan"], "TextDocument:text")[0][0]
    for figure in ("073p", "-3.0 mm", "22.70°", "87 % (84 to 90)", "foul: touches pink", "3.6 %", "6 mm of yaw"):
        assert figure in text, figure
    assert "touches blue" not in text  # it never happened
    assert "double into the middle pocket" in column(recorded["/text/alternatives"], "TextDocument:text")[0][0]


def test_views_of_the_recording(tmp_path: Path, plan: dict[str, Any]) -> None:
    views = {"The plan", "In 3-D", "Alternative 1", "Alternative 3", "What to play", "How to read this"}
    check_recording(tmp_path, lambda path, title: write_plan(path, plan, title=title), views, {"shot_time"})


@pytest.mark.slow
def test_a_bad_place_is_named_and_nothing_is_left(tmp_path: Path, plan: dict[str, Any]) -> None:
    check_bad_places(
        tmp_path, lambda at: write_report(at, plan, "t"), lambda at: write_picture(at, plan),
        lambda at: write_plan(at, plan, title="t"),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("change", "match"),
    (
        ({"format": "billiard-scene/1"}, r"format = 'billiard-scene/1' is no plan"),
        ({"scene": {}}, r"scene of the plan is incomplete"),
        ({"scene": None}, r"scene of the plan is incomplete"),
    ),
)
def test_what_is_no_plan_is_refused(change: dict[str, Any], match: str, tmp_path: Path) -> None:
    plan = no_shot() | change
    with pytest.raises(BadInput, match=match):
        write_report(tmp_path / "x.html", plan, "t")
    with pytest.raises(BadInput, match=match):
        write_plan(tmp_path / "x.rrd", plan, title="t")
    assert list(tmp_path.iterdir()) == []
