"""Balls that rest all the time stand out from the empty table; pieces of a hand that stays, or of a cue, do not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from models.shot import NOSE_COSINE, Table
from sysid.vision.balls.background import learn_background
from sysid.vision.balls.intruders import intruding
from sysid.vision.balls.view_geometry import view_geometry
from sysid.vision.camera.projection import Camera
from tests.footage.__main__ import camera_over
from tests.footage.cameras import aimed, overhead
from tests.footage.motion import Cue
from tests.footage.study import RAIL_WIDTH_M, recipe
from tests.support.drawn_balls import LOOK, THREE, camera_of, errors, learnt, rms, shown


@pytest.mark.slow
def test_balls_at_rest_all_along_do_not_hide_in_the_backdrop(tmp_path: Path) -> None:
    camera = camera_of(10)
    half = camera.table.width / 2 - 0.95 * camera.radius
    places = np.array([[(0.2, 0.1), (-0.25, half), (-0.3 + 0.08 * k, -0.15)] for k in range(7)])
    pictures = shown(camera, THREE, places)
    detector = learnt(tmp_path / "f", camera, pictures)
    off, _ = errors(detector, camera, pictures, THREE, places)
    assert np.isfinite(off).all()
    assert rms(off) < 0.1
    assert any("at rest" in line for line in detector.notes)
    empty = shown(camera, (), np.zeros((1, 0, 2)))[0]
    assert detector.find(empty) == [], "what is painted below them looks like the table"
    single = learnt(tmp_path / "one", camera, pictures[:1])
    assert sorted(s.name for s in single.find(pictures[0])) == sorted(THREE)


@pytest.mark.slow
def test_a_ball_at_rest_out_of_focus_does_not_hide_in_the_backdrop(tmp_path: Path) -> None:
    camera = camera_of(10)
    places = np.array([[(0.2, 0.1), (-0.3 + 0.06 * k, -0.15)] for k in range(9)])
    pictures = shown(camera, THREE[:2], places, replace(LOOK, blur=1.6, noise=2.0))
    detector = learnt(tmp_path / "f", camera, pictures)
    truth = camera.outline(places[0])[0]
    for picture in pictures:
        assert [s.name for s in detector.find(picture) if np.hypot(*(s.xy - truth)) < 2.0] == ["white"]


@pytest.mark.slow
def test_balls_that_touch_each_other_and_a_cushion_all_along_are_balls(tmp_path: Path) -> None:
    camera = overhead(Table(1.2, 0.65), 0.0523, (640, 380), 1.5, 1.36)
    row = np.array([(0.1 + 0.0005 * k, 0.65 / 2 - 0.026 * NOSE_COSINE - 0.0525 * k) for k in range(4)])
    places = np.repeat(np.concatenate([row, [(-0.3, -0.1)]])[None], 8, axis=0)
    names = ("red", "yellow", "blue", "black", "white")
    detector = learnt(tmp_path, camera, shown(camera, names, places))
    found = detector.find(shown(camera, names, places[:1])[0])
    assert sorted(one.name for one in found) == sorted(names)


def test_an_arm_that_stays_for_most_of_a_film_is_no_part_of_the_table() -> None:
    """When it moved on, the cloth that it uncovered stood out from the table, and pieces of the arm were balls."""
    camera = camera_of(10)
    pictures = shown(camera, ("white",), np.array([[(-0.3 + 0.05 * k, 0.1)] for k in range(12)]))
    empty = shown(camera, (), np.zeros((1, 0, 2)))[0]
    for picture in pictures[:9]:
        cv2.line(picture, (200, 359), (200, 200), (120, 150, 200), 24, cv2.LINE_AA)
    learnt_of, _ = learn_background(view_geometry(camera), pictures, lambda view: [], intruding)
    off = learnt_of.picture - empty
    uncovered, elsewhere = (
        np.abs(cv2.GaussianBlur(part, (0, 0), 3)).max() for part in (off[190:262, 180:220], off[60:160, 300:380])
    )
    assert uncovered < 1.5 * elsewhere


def test_knuckles_are_no_balls_to_learn_from(tmp_path: Path) -> None:
    camera = camera_of(10)
    pictures = shown(camera, ("white",), np.array([[(-0.3 + 0.05 * k, 0.1)] for k in range(12)]))
    for picture in pictures[:9]:
        cv2.line(picture, (200, 359), (200, 200), (120, 150, 200), 24, cv2.LINE_AA)
        for knuckle in ((189, 192), (211, 192), (200, 182)):
            cv2.circle(picture, knuckle, 10, (110, 140, 190), -1, cv2.LINE_AA)
    assert [name for name, _ in learnt(tmp_path / "f", camera, pictures).ball_colours] == ["white"]


def snooker_from_afar(number: int) -> Camera:
    """The camera of a random film, in which balls have 4 pixels in radius."""
    one = recipe(number)
    return aimed(camera_over(Table(3.569, 1.778), 0.0525, one.size, one.tilt, one.lens), one.aside, RAIL_WIDTH_M)


@pytest.mark.slow
def test_a_hand_that_stays_has_no_ball_in_it(tmp_path: Path) -> None:
    """Its fist was mended out of the empty table, and so was a ball from then on."""
    places = np.array([[(0.3 - 0.05 * k, -0.44 + 0.02 * k)] for k in range(10)])
    camera, look = snooker_from_afar(42), replace(recipe(42).look, exposure=0.0)
    detector = learnt(tmp_path, camera, shown(camera, ("white",), places, look))
    assert {name for name, _ in detector.ball_colours} == {"white"}


@pytest.mark.slow
def test_the_butt_of_a_cue_is_no_ball_of_its_colour(tmp_path: Path) -> None:
    camera, look = snooker_from_afar(31), replace(recipe(31).look, exposure=0.0, player=False)
    cue = Cue(0.35, (0.05, -0.12, 0.03), 0.2, 0.02)
    pictures = shown(camera, ("white",), np.repeat(np.array([[(0.1, -0.1)]]), 10, axis=0), look, cue)
    detector = learnt(tmp_path, camera, pictures)
    assert {name for name, _ in detector.ball_colours} == {"white"}
