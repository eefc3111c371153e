"""A plan on paper, as a picture and as a recording: its figures are there, whole or not at all, the same again."""

from __future__ import annotations

import copy
import json
import math
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from models.errors import BadInput
from models.recording.plan import dropped, fate, outline, sentence, write_plan
from models.shot import Array, Ball, Table
from planner.report import write_picture, write_report
from tests.models.recording.test_view import column, read, seconds
from tests.support.html_pages import STRANGE, Page

TABLE, BALL = Table(3.569, 1.778), Ball(0.0525, 0.1406)
HALF = np.array([TABLE.length, TABLE.width]) / 2
BALLS = {
    "white": [-0.62, -0.38], "red": [0.86, 0.31], "red 2": [1.21, -0.42], "blue": [0.0, 0.0], "pink": [0.8922, 0.02],
    "black": [1.4605, 0.0], "yellow": [-1.0475, -0.292], "green": [-1.0475, 0.292], "brown": [-1.0475, 0.0],
}  # fmt: skip
REST = np.array([0.75, -0.25])
AIM = REST + np.array([0.02, 0.03])  # where the sample's white stops without noise


def way(points: list[Array], speed: float, start: float = 0.0) -> dict[str, Any]:
    """A ball that waits, then slows down along straight lines and stops at the last point."""
    corners = np.array(points)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    last = 2 * along[-1] / speed
    t = np.arange(0.0, last, 0.02)
    gone = along[-1] * (1 - (1 - t / last) ** 2)
    xy = np.stack([np.interp(gone, along, axis) for axis in corners.T], axis=1)
    t = np.concatenate([[0.0], start + t]) if start else t
    xy = np.vstack([corners[:1], xy]) if start else xy
    return {"t": np.round(t, 4).tolist(), "xy": np.round(xy, 5).tolist()}


def shot(miss: float, pace: float, rest: Array) -> tuple[list[dict[str, Any]], bool]:
    """The white cuts the red into the corner +x +y and runs over the cushion +y to where it rests; or the red misses.

    `miss` turns the red's way [rad], `pace` is the factor on all speeds.
    """
    white, red, pocket = np.array(BALLS["white"]), np.array(BALLS["red"]), HALF
    to = (pocket - red) / np.hypot(*(pocket - red))
    touch = red - 2 * BALL.radius * to
    to = np.array([[math.cos(miss), -math.sin(miss)], [math.sin(miss), math.cos(miss)]]) @ to
    potted = abs(math.hypot(*(pocket - red)) * miss) < 0.03
    reach = HALF - BALL.radius
    if potted:
        reds = [red, pocket - 0.02]
    else:
        length = min((reach - red) / np.maximum(to, 1e-9))
        cushion = red + length * to
        back = to * (np.array([1, -1]) if cushion[1] > reach[1] - 1e-6 else np.array([-1, 1]))
        reds = [red, cushion, np.clip(cushion + 0.35 * pace * back, -reach, reach)]
    over = np.array([touch[0] - 0.12 + 2 * miss, reach[1]])
    tracks = [
        {"ball": "white", **way([white, touch, over, rest], 2.1 * pace)},
        {"ball": "red", **way(reds, 1.4 * pace, start=0.95 / pace)},
    ]
    return tracks, potted


def sample(draws: int = 40, places: int = 500) -> dict[str, Any]:
    """A plan as the planner writes it, with the scatter of a careful launcher."""
    rng = np.random.default_rng(3)
    tracks, _ = shot(0.002, 1.0, AIM)

    def draw() -> tuple[float, float, Array]:
        """Turn of the red's way [rad], pace, and where the white rests."""
        miss, pace = rng.normal(0.004, 0.015), 1 + rng.normal(0, 0.03)
        rest = AIM + np.array([0.9 * (pace - 1) + 2.2 * miss, -2.6 * (pace - 1)]) + rng.normal(0, 0.012, 2)
        return float(miss), float(pace), rest

    fan = []
    for k in range(draws):
        run, potted = shot(*draw())
        fan.append({"potted": potted, "foul": "touches pink" if k in (7, 23) else "", "tracks": run})
    ends = [draw() for _ in range(places)]
    cloud = np.array([end[2] for end in ends]).reshape(-1, 2)
    potted = [abs(end[0]) * float(np.hypot(*(HALF - BALLS["red"]))) < 0.03 for end in ends]
    far = np.hypot(*(cloud - REST).T)
    stroke = {"speed": 2.31, "azimuth": 0.395, "side": -0.003, "height": 0.005, "elevation": math.radians(6.5)}
    launcher = {"string": "073p", "x0_mm": -3.0, "y0_mm": 5.0, "theta": 0.3962, "theta_deg": 22.7006,
                "theta_tolerance_deg": [-0.12, 0.1], "cue_speed": 1.86}  # fmt: skip
    plan = {
        "format": "billiard-plan/1", "method": "risk", "seed": 11,
        "why": "The cut is thin enough to hold the white, and 6 mm of yaw at the pocket still pots it.",
        "scene": {
            "format": "billiard-scene/1", "table": {"length": TABLE.length, "width": TABLE.width, "pockets": True},
            "ball": {"diameter": BALL.diameter, "mass": BALL.mass}, "balls": copy.deepcopy(BALLS),
            "goal": {"cue": "white", "object": "red", "pocket": [1, 1], "rest": REST.tolist(), "avoid": ["pink"]},
        },
        "model": {"file": "fitted.toml", "effects": ["decoupled_cloth", "ball_impact", "cushion_impact"]},
        "execution": {"speed_sd": 0.012, "azimuth_sd": 0.0013, "side_sd": 0.0005, "height_sd": 0.0008},
        "stroke": stroke, "launcher": launcher, "pocket": [1, 1],
        "kind": "cut into the corner pocket +x +y; cue ball over the +y cushion",
        "pot_probability": {"value": 0.873, "low": 0.841, "high": 0.899},
        "foul_probability": {"value": 0.046, "low": 0.031, "high": 0.068},
        "fouls": {"in-off": 0.01, "touches pink": 0.036, "touches blue": 0.0},
        "rest": {"mean": cloud.mean(axis=0).tolist(), "sd": cloud.std(axis=0).tolist(),
                 "distance_median": float(np.median(far)), "distance_90": float(np.quantile(far, 0.9))},
        "value": 0.83, "tracks": tracks, "fan": fan, "places": {"cue": cloud.tolist(), "potted": potted},
    }  # fmt: skip
    others = []
    for number, (kind, end) in enumerate(
        (
            ("straight into the corner pocket +x +y; cue ball stays", [0.9, 0.3]),
            ("cut into the corner pocket +x +y; cue ball over +y and +x", [1.2, 0.5]),
            ("double into the middle pocket +y; cue ball free", [0.3, -0.6]),
        )
    ):
        keys = ("pocket", "foul_probability", "fouls", "rest", "value")
        other = {key: copy.deepcopy(plan[key]) for key in keys}
        other |= {"kind": kind, "why": f"Safer by {number} parts in ten, but it leaves the white nowhere."}
        other |= {"stroke": {**stroke, "speed": 1.5 + number}, "launcher": {**launcher, "string": f"1{number}0p"}}
        other |= {"pot_probability": {"value": 0.61 - 0.1 * number, "low": 0.5, "high": 0.7}}
        others.append(other | {"tracks": shot(0.001, 0.8 + 0.2 * number, np.array(end))[0]})
    return plan | {"alternatives": others}


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
    read_page = Page(page)
    assert read_page.open == []
    assert not {tag for tag, _ in read_page.seen} & {"script", "link", "iframe"}
    assert "http" not in re.sub(r"base64,[^\"]+", "", page)
    assert len(read_page.pictures()) == 6  # face, table, resting places, three alternatives
    for picture in read_page.pictures():
        assert ElementTree.fromstring(picture).tag.endswith("svg")
    assert len(page) < 1_000_000


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
    from rerun.chunk import RrdReader

    for name, title in (("a", "one"), ("b", "one"), ("c", "other")):
        write_plan(tmp_path / name, plan, title=title)
    readers = [RrdReader(tmp_path / name) for name in "abc"]
    ids = [reader.recordings()[0].recording_id for reader in readers]
    assert ids[0] == ids[1] != ids[2]
    (blueprint,) = readers[0].blueprints()
    batches = [chunk.to_record_batch() for chunk in readers[0].stream(store=blueprint).to_chunks()]
    names = {row[0] for row in column(batches, "ViewBlueprint:display_name")}
    assert {"The plan", "In 3-D", "Alternative 1", "Alternative 3", "What to play", "How to read this"} <= names
    timelines = {name for chunk in readers[0].stream().to_chunks() for name in chunk.timeline_names}
    assert timelines == {"shot_time"}


@pytest.mark.slow
def test_a_bad_place_is_named_and_nothing_is_left(tmp_path: Path, plan: dict[str, Any]) -> None:
    for place in (tmp_path / "nowhere" / "x", tmp_path):
        for write in (
            lambda at: write_report(at, plan, "t"),
            lambda at: write_picture(at, plan),
            lambda at: write_plan(at, plan, title="t"),
        ):
            with pytest.raises(BadInput, match=re.escape(str(place))) as error:
                write(place)
            assert "\n" not in str(error.value)
    assert list(tmp_path.iterdir()) == []


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
