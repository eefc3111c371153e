"""A campaign and repeated strokes at a table: what is asked for, what is struck, what is measured, what is refused."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.analytic.cue_impulse import Constants, Geometry, ball_speed_and_squirt
from models.errors import BadInput
from models.model_file import full_model, write_model
from models.shot import Ball, Table
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE, spots
from planner.launcher.cueing_map import read_map
from robot.cueing.campaign import read_campaign, run_campaign
from robot.device.settings import Settings, write_settings
from robot.emulator.table import EmulatedOptions, EmulatedTable
from robot.table.placing import PLACING_TOLERANCE_M
from robot.table.single_ball import MAX_FILMS, PLACE_TOLERANCE_M, SingleBall, place_of
from robot.table.strokes import TableStriker, check_strokes, measure_repeats, path_length
from tests.support.clip_samples import contents
from tests.support.robot_commands import Eye, at_port, by_the_words, refused, run
from tests.support.robot_plans import struck

MODEL = full_model(SNOOKER_TABLE, SNOOKER_BALL)
SLIDE_FRICTION = float(MODEL.parameters()["decoupled_cloth.slide"])
OURS, BROWN = Settings(), spots(SNOOKER_TABLE)["brown"]


class SingleBallEye(Eye):
    """Over a table on which the white is put back as it is asked for, a little beside it each time."""

    def __init__(self, off_m: float = 3e-4) -> None:
        self.table, self.ball = MODEL.table, MODEL.ball
        self.devices, self.asked, self.said, self.lost = [], [], [], 0
        self.off, self.blind, self.rng, self.beside = 0.0, False, np.random.default_rng(4), off_m
        self.put({"white": BROWN})

    def put(self, laid: Any) -> None:
        self.empty = not laid
        options = EmulatedOptions(yaw_sd=0.0)
        self.now = EmulatedTable(MODEL, laid or {"white": (0.0, 0.0)}, 0.0, len(self.asked), options)

    def ready(self, text: str) -> bool:
        self.note("asked")
        self.said.append(text)
        [place] = by_the_words(text.replace("the cue ball", "white")).values()
        self.put({"white": tuple(place + self.rng.normal(0.0, self.beside, 2))})
        return True

    def confirm(self, action: str) -> bool:
        self.note("confirmed")
        return True

    def film(self) -> Any:
        seen = super().film()
        self.lost -= 1
        return {} if self.lost >= 0 else seen


@pytest.fixture
def eye(monkeypatch: pytest.MonkeyPatch) -> SingleBallEye:
    one = SingleBallEye()
    monkeypatch.setattr("robot.camera.live.LiveCamera.open", lambda *named, **rest: contextlib.nullcontext(one))
    monkeypatch.setattr("robot.table.single_ball.align", one.align)
    return one


@pytest.fixture
def options(eye: SingleBallEye) -> Iterator[tuple[str, ...]]:
    with at_port(eye, 60.0, 115200) as words:
        yield words


def rig_of(eye: SingleBallEye, **change: Any) -> SingleBall:
    place, azimuth = place_of(MODEL.table, "-x")
    rig: Any = SingleBall(eye, eye.connect, place, azimuth, eye.confirm, eye.ready, eye.said.append)  # type: ignore[arg-type]
    return dataclasses.replace(rig, **change)


def typed(eye: SingleBallEye, monkeypatch: pytest.MonkeyPatch, *words: str) -> list[str]:
    """At the terminal, somebody who puts the ball where it is asked for, and answers."""
    asked, left = list[str](), list(words)

    def say(prompt: str) -> str:
        asked.append(prompt)
        if "return" in prompt:
            eye.put({"white": tuple(BROWN + eye.rng.normal(0.0, eye.beside, 2))})
        eye.note("asked")
        return left.pop(0) if left else "yes"

    monkeypatch.setattr("builtins.input", say)
    return asked


def test_strokes_are_measured_as_they_were_made(eye: SingleBallEye) -> None:
    strike = TableStriker(rig_of(eye), SLIDE_FRICTION, 0, 3)
    for string, x0_mm, y0_mm in ((60, 0.0, 0.0), (120, 8.0, -4.0), (30, 4.0, 10.0)):
        shot = strike(string, x0_mm, y0_mm)
        speed, squirt = ball_speed_and_squirt(
            Constants(), Geometry(SNOOKER_BALL), *(np.array([v]) for v in (shot.cue_speed, 1e-3 * x0_mm, 1e-3 * y0_mm))
        )
        assert shot.ball_speed == pytest.approx(speed[0], rel=0.05), "but for what does not repeat"
        assert shot.squirt_rad == pytest.approx(squirt[0], abs=6e-3)
        assert shot.ball_speed_sd < 0.02 * shot.ball_speed and shot.squirt_sd < 0.01 and not shot.miscue
    assert [what for what, _ in eye.asked] == [
        "asked",
        "aligned to 0.00, ball told",
        "confirmed",
        "armed",
        "filmed",
    ] * 3
    assert [made for what, made in eye.asked if what == "confirmed"] == [0, 1, 2], "asked before every stroke"


def test_from_the_other_end_the_same_is_measured(eye: SingleBallEye) -> None:
    place, azimuth = place_of(MODEL.table, "+x")
    assert place == pytest.approx(-BROWN) and azimuth == math.pi
    shots = []
    for at, turned in ((BROWN, 0.0), (place, azimuth)):
        eye.asked.clear()
        eye.devices.clear()
        shots.append(TableStriker(rig_of(eye, place=at, azimuth=turned), SLIDE_FRICTION, 0, 1)(80, 6.0, 2.0))
    assert shots[1].ball_speed == pytest.approx(shots[0].ball_speed, rel=0.01)
    assert shots[1].squirt_rad == pytest.approx(shots[0].squirt_rad, abs=3e-3)


def test_a_ball_beside_its_place_or_not_alone_is_asked_for_again(eye: SingleBallEye) -> None:
    laid = [
        ({"white": BROWN + np.array([0.0, 1.1 * PLACING_TOLERANCE_M])}, r"[+]33\.\d mm along y from its place"),
        ({"white": BROWN, "red": (0.5, 0.2)}, "red must be taken off the table"),
        ({"red": BROWN}, "the cue ball is not seen"),
        ({}, "no ball is seen"),
        ({"white": BROWN + np.array([0.0, 0.01])}, ""),
        ({"white": BROWN + np.array([0.0, 0.01 + 1.5 * PLACE_TOLERANCE_M])}, r"[+](2\.[89]|3\.[0-2]) mm along y"),
        ({"white": BROWN + np.array([0.0, 0.01])}, ""),
    ]
    calls = iter(laid)

    def ready(text: str) -> bool:
        eye.put(next(calls)[0])
        return True

    rig = rig_of(eye, ready=ready)
    for _ in range(2):
        rig.strike(100, 0.0, 0.0, "stroke")
    faults = [fault for _, fault in laid if fault]
    told = [line for line in eye.said if "homing" not in line]
    assert len(told) == len(faults)
    assert all(re.search(fault, line) for fault, line in zip(faults, told, strict=True)), told
    assert rig.place == pytest.approx(BROWN + np.array([0.0, 0.01]), abs=5e-4), "where it really lay"


def test_a_stroke_that_no_film_shows_is_made_again_and_then_given_up(eye: SingleBallEye) -> None:
    eye.lost = 1
    assert rig_of(eye).strike(100, 0.0, 0.0, "stroke 1", look=True).end is not None
    assert eye.strokes == 2 and any("the stroke is made again" in line for line in eye.said)
    eye.lost = MAX_FILMS
    with pytest.raises(BadInput, match="stroke 2: 3 films do not show the ball"):
        rig_of(eye).strike(100, 0.0, 0.0, "stroke 2")


def test_repeats_scatter_as_the_launcher_does(eye: SingleBallEye) -> None:
    told: list[Any] = []
    [slow, fast] = measure_repeats(rig_of(eye), (160, 80), 5, told.append)
    assert told == [slow, fast] and (slow.ended, fast.ended) == (5, 5)
    assert slow.asked_speed == pytest.approx(OURS.check_speed(160)) == pytest.approx(slow.cue_speed, rel=0.03)
    assert 1e-3 < slow.scatter < 0.2 and slow.run == pytest.approx(free_run(slow.cue_speed), rel=0.1)
    assert fast.run > 2 * slow.run


def free_run(cue_speed: float) -> float:
    """2.165 V^2 of a ball struck at its centre at V [m/s], by the cloth's published coefficients."""
    return 2.165 * (1.366 * math.cos(math.radians(6.5)) * cue_speed) ** 2


def test_noise_does_not_lengthen_a_path() -> None:
    way = np.column_stack([np.linspace(0, 2, 1000), np.zeros(1000)]) + np.random.default_rng(0).normal(
        0, 5e-4, (1000, 2)
    )
    assert path_length(way) == pytest.approx(2.0, rel=2e-3)


def test_strokes_beyond_limits_or_a_short_table_are_refused_before_anything_is_asked(eye: SingleBallEye) -> None:
    rig = rig_of(eye)
    for settings, part in (
        (dataclasses.replace(OURS, limits=dataclasses.replace(OURS.limits, offset=0.1)), "offset|tip"),
        (dataclasses.replace(OURS, stage=dataclasses.replace(OURS.stage, ball_radius_mm=28.0)), "radius of 26.25 mm"),
    ):
        with pytest.raises(BadInput, match=part):
            check_strokes(settings, [(1, 12.0, 12.0)], rig)
    eye.table, eye.fps = Table(0.5, 0.3, pockets=False), 30.0
    with pytest.raises(BadInput, match=r"is at the cushion after \d pictures of 30 a second; 4 or more"):
        check_strokes(OURS, [(1, 0.0, 0.0)], rig_of(eye, place=place_of(eye.table, "-x")[0]))
    assert not eye.asked


def test_a_campaign_at_a_port_says_what_it_needs_and_is_gone_on_with(
    eye: SingleBallEye, options: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "c.csv"
    asked = typed(eye, monkeypatch)
    said = run("campaign", out, "--most", 2, *options)
    assert said.status == 0, said
    needs, _ = said.out.split("an interrupt (Ctrl-C) stops the launcher\n")
    assert needs.startswith(f"needed:\n  - the launcher at {options[1]}, powered on")
    for part in ("camera 0 in the position of cam.toml", "73.7 cm from the -x cushion", "a yes in full", "5 s"):
        assert part in needs, needs
    assert "put back there 2 times, within 2 mm" in needs.replace("\n", " ")
    assert len(asked) == 4 and len(struck(eye.devices[0])) == 2
    assert "stroke 1 of 2: put the cue ball" in " ".join([said.out, *asked]), "of those that are played now"
    said = run("campaign", out, "--most", 1, *options, "--yes")
    assert said.status == 0 and "put back there once" in said.out.replace("\n", " ")
    assert len(asked) == 5, "the ball is put back, and no yes is asked for"
    assert len(read_campaign(out)) == 3
    typed(eye, monkeypatch, "q")
    said = run("campaign", out, *options)
    assert said.status == 2 and "not set up" in said.err and "3 shots are kept" in said.err
    typed(eye, monkeypatch, "", "no")
    said = run("campaign", out, *options)
    assert said.status == 2 and "so nothing was struck; answer yes to strike" in said.err
    assert len(struck(eye.devices[0])) == len(read_campaign(out)) == 3


def test_repeats_at_a_port_are_told_string_by_string(
    eye: SingleBallEye, options: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    typed(eye, monkeypatch)
    out = tmp_path / "r.json"
    said = run("repeat", "--strings", 120, 160, "--repeats", 2, *options, "--yes", "--json", out)
    assert said.status == 0 and "this table" in said.out and "unlimited" not in said.out, said
    told = json.loads(out.read_text())
    assert [row["string"] for row in told["table"]["strings"]] == [120, 160] and told["seed"] is None
    words = ("", "", "q")
    typed(eye, monkeypatch, *words)
    said = run("repeat", "--strings", 120, 160, "--repeats", 2, *options, "--yes")
    assert said.status == 2 and "measure the rest with: --strings 160" in said.err, said


def test_a_map_is_of_the_balls_that_were_struck(eye: SingleBallEye, tmp_path: Path) -> None:
    out, model, made = tmp_path / "c.csv", tmp_path / "pool.toml", tmp_path / "map.toml"
    strike = TableStriker(rig_of(eye), SLIDE_FRICTION, 0, 16)
    run_campaign(strike, out, 1, grid=[(60, x, y) for x in (0.0, 4.0, 8.0, 12.0) for y in (-8.0, -4.0, 0.0, 4.0)])
    write_model(full_model(Table(2.54, 1.27), Ball(0.05715, 0.163)), model)
    for words, diameter in (((), 0.0525), (("--model", model), 0.05715)):
        assert run("map", out, "--out", made, *words, "--overwrite").status == 0
        assert read_map(made).geometry.ball.diameter == pytest.approx(diameter)


def test_nothing_moves_where_something_is_missing(eye: SingleBallEye, options: Any, tmp_path: Path) -> None:
    port, settings, other = options[:2], tmp_path / "l.toml", tmp_path / "m.toml"
    write_settings(dataclasses.replace(OURS, limits=dataclasses.replace(OURS.limits, cue_speed=(0.3, 0.4))), settings)
    write_model(full_model(Table(3.0, 1.5), SNOOKER_BALL), other)
    campaign, before = ("campaign", tmp_path / "c.csv"), contents(tmp_path)
    for words, part in (
        ((*campaign, *port), "--port: a campaign needs a camera"),
        (("repeat", *port), "--port: the measurement needs a camera"),
        ((*campaign, *options[2:]), "--camera requires a launcher at a --port"),
        (("repeat", "--end", "+x"), "--end requires a launcher at a --port"),
        ((*campaign, "--model", other), "--model requires a launcher at a --port"),
        ((*campaign, "--settings", settings), "--settings requires a launcher at a --port"),
        ((*campaign, *options, "--model", other), "its table or ball differs from cam.toml"),
        ((*campaign, *options, "--settings", settings), "the limits are 0.3 to 0.4"),
        (("repeat", *options, "--repeats", 1), "give 2 or more"),
        (("repeat", *options, "--strings", 300), "300"),
    ):
        refused(run(*words), str(words[0]), part)
    assert contents(tmp_path) == before and eye.devices[0].state == "UNHOMED" and not eye.asked
