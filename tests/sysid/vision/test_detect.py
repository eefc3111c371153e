"""Balls in single pictures, against drawn footage whose truth is known: where, which, and when there are none."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import cv2
import numpy as np
import pytest

from models.errors import BadInput
from models.shot import Table
from sysid.vision.balls.colours.names import name_colours
from sysid.vision.balls.colours.palette import default_palette, group_colours, read_palette
from sysid.vision.balls.detect import Detection, Detector
from sysid.vision.balls.discs import Expected
from sysid.vision.balls.learning import distinct, learn_detector, steadier, unsteadiness
from sysid.vision.camera.projection import Camera
from sysid.vision.sources.pictures import Picture
from tests.footage.cameras import overhead
from tests.footage.film import Look, film
from tests.footage.motion import Cue, Motion
from tests.support.drawn_balls import (
    MARKS,
    THREE,
    Array,
    camera_of,
    crowded,
    errors,
    footage_of,
    learnt,
    rms,
    scattered,
    shown,
)

ALL = (*THREE, "green", "brown", "blue", "pink", "black")


@pytest.mark.parametrize("radius", [pytest.param(10, marks=pytest.mark.slow), 20])
def test_centres_are_known_to_a_fraction_of_a_pixel(tmp_path: Path, radius: int) -> None:
    camera, rng = camera_of(radius), np.random.default_rng(2)
    free = np.array([scattered(camera, 3, rng) for _ in range(8)])
    near = crowded(camera, 10, rng)
    places = np.concatenate([free, near])
    pictures = shown(camera, THREE, places)
    detector = learnt(tmp_path / "f", camera, pictures)
    off, seen = errors(detector, camera, pictures, THREE, places)
    assert np.isfinite(off).all(), "a ball was lost"
    assert rms(off[:8]) < 0.08
    assert rms(off[8:]) < 0.15
    assert 0.5 < rms(off) / rms(np.array([s.sd for s in seen])) < 2, "the estimated errors are about the true ones"
    assert detector.noise == pytest.approx(5.0, rel=0.15)
    for picture, row in zip(pictures[::3], places[::3], strict=True):  # the same without any expectation
        found = {s.name: s for s in detector.find(picture)}
        assert sorted(found) == sorted(THREE)
        assert max(np.hypot(*(found[n].xy - xy)) for n, xy in zip(THREE, camera.outline(row), strict=True)) < 0.6


Learnt = tuple[Detector, Camera, list[Picture], Array]


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> Learnt:
    """What is learnt from eight pictures of three balls far from each other; camera, pictures and places."""
    camera, rng = camera_of(10), np.random.default_rng(3)
    places = np.array([scattered(camera, 3, rng, gap=6) for _ in range(8)])
    pictures = shown(camera, THREE, places)
    return learnt(tmp_path_factory.mktemp("usual") / "f", camera, pictures), camera, pictures, places


@pytest.mark.slow
def test_a_ball_is_found_far_from_where_it_is_expected(usual: Learnt) -> None:
    detector, camera, pictures, places = usual
    off, _ = errors(detector, camera, pictures, THREE, places, off=12.0)
    assert np.isfinite(off).all()
    assert rms(off) < 0.08


@pytest.mark.slow
@pytest.mark.parametrize("tint", [(1.0, 0.8, 0.55), pytest.param((0.7, 0.85, 1.0), marks=pytest.mark.thorough)])
def test_all_colours_are_named_in_uneven_light_of_any_colour(tmp_path: Path, tint: tuple[float, float, float]) -> None:
    camera, rng = camera_of(20), np.random.default_rng(4)
    places = np.array([scattered(camera, 8, rng, gap=2.6) for _ in range(7)])
    pictures = shown(camera, ALL, places, Look(uneven=0.6))
    pictures = [np.clip(p * np.array(tint[::-1]), 0, 255).astype(np.uint8) for p in pictures]
    detector = learnt(tmp_path / "f", camera, pictures)
    assert sorted(name for name, _ in detector.ball_colours) == sorted(ALL)
    for picture, row in zip(pictures, places, strict=True):
        for s in detector.find(picture):
            far = np.hypot(*(camera.outline(row) - s.xy).T)
            assert (s.name, bool(far.min() < 2)) == (ALL[int(far.argmin())], True)


@pytest.mark.slow
def test_nothing_is_found_where_there_is_no_ball(usual: Learnt) -> None:
    (detector, camera, _, _), rng = usual, np.random.default_rng(5)
    bare = np.zeros((3, 0, 2))
    cue = Cue(0.0, (0.05, 0.02, 0.026), 0.4, 1.0)
    pictures = [*shown(camera, (), bare, seed=1), *shown(camera, (), bare, cue=cue, seed=2)]
    for picture in shown(camera, (), bare, seed=3):
        for _ in range(5):  # guide lines, and the ring of a ghost ball
            one, two = rng.integers(0, 480, 2), rng.integers(0, 360, 2)
            cv2.line(picture, (int(one[0]), int(two[0])), (int(one[1]), int(two[1])), (240, 255, 250), 2, cv2.LINE_AA)
        cv2.circle(picture, (240, 180), 10, (255, 255, 255), 2, cv2.LINE_AA)
        pictures.append(picture)
    assert [detector.find(p) for p in pictures] == [[]] * len(pictures)
    middle = np.array([240.0, 180.0])
    assert all(detector.find(p, [Expected("white", middle), Expected("red", middle + 30)]) == [] for p in pictures)


def test_a_circle_of_light_is_no_ball_however_long_it_stays(tmp_path: Path) -> None:
    """A projector shows where the ball will come to rest: a ring of its size, with a little light within."""
    camera, rng = camera_of(20), np.random.default_rng(8)
    places = np.array([scattered(camera, 2, rng, edge=4.0) for _ in range(8)])
    places[:, :, 0] = np.abs(places[:, :, 0])  # on one half of the table, the ring on the other
    places = places[[np.hypot(*(a - b)) > 3 * camera.radius for a, b in places]]
    pictures = shown(camera, THREE[:2], places)
    ring = camera.outline(np.array([[-0.2, 0.05]]))[0]
    for k, picture in enumerate(pictures):
        light = np.zeros(picture.shape, np.uint8)
        cv2.circle(light, tuple(np.rint(ring).astype(int).tolist()), 19, (12, 10, 4), -1)
        cv2.circle(light, tuple(np.rint(ring).astype(int).tolist()), 18, (110, 100, 40), 3, cv2.LINE_AA)
        pictures[k] = cv2.add(picture, cv2.GaussianBlur(light, (0, 0), 0.9))
    detector = learnt(tmp_path / "f", camera, pictures)
    assert sorted(name for name, _ in detector.ball_colours) == sorted(THREE[:2])
    assert all(np.hypot(*(one.xy - ring)) > camera.radius for p in pictures for one in detector.find(p))


@pytest.mark.slow
def test_a_ball_that_is_looked_for_in_a_black_pocket_is_not_there(tmp_path: Path) -> None:
    camera = camera_of(10)
    pictures = shown(camera, ("white",), np.array([[(0.2 - 0.06 * k, 0.1)] for k in range(5)]))
    pocket = camera.outline(np.array([[-0.3, -0.1]]))[0]
    for picture in pictures:
        cv2.circle(picture, (int(pocket[0]), int(pocket[1])), 24, (0, 0, 0), -1)
    detector = learnt(tmp_path / "f", camera, pictures)
    (found,) = detector.find(
        pictures[0], [Expected("white", camera.outline(np.array([[0.2, 0.1]]))[0]), Expected("red", pocket)]
    )
    assert found.name == "white"
    assert [
        s.name for s in detector.find(pictures[2], [Expected("white", pocket)]) if np.hypot(*(s.xy - pocket)) < 24
    ] == []


@pytest.mark.slow
def test_a_ball_with_the_cue_at_it_and_one_that_moves_are_found(tmp_path: Path) -> None:
    camera, rng = camera_of(20), np.random.default_rng(6)
    still = np.array([scattered(camera, 3, rng, gap=5) for _ in range(8)])
    detector = learnt(tmp_path / "f", camera, shown(camera, THREE, still))
    place = np.array([(0.02, 0.03), (-0.2, -0.1), (0.2, -0.1)])
    tip = place[0] - 1.05 * camera.radius * np.array([np.cos(0.4), np.sin(0.4)])
    picture = shown(camera, THREE, place[None], cue=Cue(0.0, (tip[0], tip[1], 0.026), 0.4, 1.0))
    off, _ = errors(detector, camera, picture, THREE, place[None])
    assert rms(off) < 0.15
    # Fast balls in a long exposure: half a radius of smear, then most of one.
    for smear, most in ((0.5, 0.3), (0.9, 0.7)):
        way = smear * camera.radius * np.array([[0.8, 0.6], [1.0, 0.0], [-0.3, 0.95]])
        moments = np.array([-0.5, 0.5])
        motion = Motion(THREE, moments, place + moments[:, None, None] * way, np.tile([0.0, 0, 0, 1], (2, 3, 1)))
        pictures = list(film(camera, motion, np.zeros(1), Look(exposure=1.0, parts=11, spots=MARKS)))
        off, seen = errors(detector, camera, pictures, THREE, place[None])
        assert np.isfinite(off).all()
        assert np.abs(off).max() < most
        assert min(s.sd for s in seen) > 0.03


@pytest.mark.slow
def test_changing_light_is_allowed_for(tmp_path: Path) -> None:
    camera, rng = camera_of(10), np.random.default_rng(7)
    places = np.array([scattered(camera, 3, rng) for _ in range(8)])
    pictures = shown(camera, THREE, places)
    pictures = [np.clip(p * (1 + 0.15 * np.sin(1.7 * k)), 0, 255).astype(np.uint8) for k, p in enumerate(pictures)]
    detector = learnt(tmp_path / "f", camera, pictures)
    off, _ = errors(detector, camera, pictures, THREE, places)
    assert rms(off) < 0.08
    assert any("brightness varies" in line for line in detector.notes)


@pytest.mark.slow
def test_learning_is_deterministic_and_minds_the_size(usual: Learnt, tmp_path: Path) -> None:
    one, camera, pictures, _ = usual
    two = learnt(tmp_path / "f", camera, pictures)
    assert one.notes == two.notes
    assert [s.xy.tolist() for s in one.find(pictures[0])] == [s.xy.tolist() for s in two.find(pictures[0])]
    with pytest.raises(BadInput, match=r"480 x 360 .* 560 x 420"):
        learnt(tmp_path / "f", camera_of(20), pictures)
    bare = learnt(tmp_path / "bare", camera, shown(camera, (), np.zeros((3, 0, 2))))
    assert bare.find(pictures[0]) == []
    assert "no ball was found" in bare.notes[0]


@pytest.mark.parametrize(
    ("discs", "more", "chosen"), [(0.10, True, True), (0.10, False, False), (0.08, False, True), (0.16, True, False)]
)
def test_discs_that_are_seen_more_often_need_only_be_steadier(discs: float, more: bool, chosen: bool) -> None:
    """Outlines that are lost in every sixth picture are kept only if they are the steadier ones."""
    assert steadier(discs, 0.15, more=more) == chosen


@pytest.mark.parametrize(("together", "balls"), [(0, 1), (1, 1), (3, 2)])
def test_a_ball_in_other_light_is_no_other_ball(together: int, balls: int) -> None:
    """Colours 0.15 to 0.2 apart, of one ball under two lamps; a stray outline in a frame does not part them."""
    here, there = np.array([0.88, 0.77, 0.52]), np.array([0.67, 0.76, 0.74])
    seen = [(k, here) for k in range(15)] + [(k, there) for k in range(15 - together, 29)]
    assert len(group_colours(seen)) == balls


def test_a_palette_of_ones_own(tmp_path: Path) -> None:
    path = tmp_path / "p.toml"
    path.write_text(
        '[[ball]]\nname = "cue"\nrgb = [240, 235, 215]\n\n[[ball]]\nname = "dot"\nrgb = [0.9, 0.75, 0.1]\ncount = 2\n'
    )
    palette = read_palette(path)
    assert (palette.names, palette.counts) == (("cue", "dot"), (1, 2))
    seen = 0.8 * np.array([[0.9, 0.75, 0.1], [0.94, 0.92, 0.84], [0.88, 0.7, 0.12], [0.05, 0.1, 0.9]])
    naming = name_colours(seen, palette)
    assert naming.names == ("dot", "cue", "dot", None)
    assert "no name" in naming.doubts[0]


def test_doubtful_names_are_told() -> None:
    palette = default_palette()
    assert name_colours(palette.colours * 0.8, palette).names == palette.names
    # Nearly as far from pink as from red, in a light that the white ball settles.
    roots = np.sqrt(palette.colours[[palette.names.index(name) for name in ("pink", "red")]])
    naming = name_colours(np.array([palette.colours[0], roots.mean(axis=0) ** 2]), palette)
    assert any("may be" in line for line in naming.doubts)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "names no ball"), ('[[ball]]\nname = " "\nrgb = [1, 1, 1]\n', "blanks"),
        ("[[ball]]\nrgb = [1, 1, 1]\n", "name is missing"),
        ('[[ball]]\nname = "a"\nrgb = [1, 2]\n', "3 numbers"),
        ('[[ball]]\nname = "a"\nrgb = [1, 1, 1]\ncount = 0\n', "count"), ("[[ball\n", "TOML"),
        ('[[ball]]\nname = "a"\nrgb = [1, 1, 1]\nsize = 3\n', "size"),
        ('[[ball]]\nname = "a"\nrgb = [1, 1, 1]\n' * 2, "twice"),
    ],
)  # fmt: skip
def test_a_bad_palette_is_named_in_one_line(tmp_path: Path, text: str, word: str) -> None:
    path = tmp_path / "p.toml"
    path.write_text(text)
    with pytest.raises(BadInput, match=word) as caught:
        read_palette(path)
    assert "\n" not in str(caught.value)
    assert "p.toml" in str(caught.value)


def test_colours_that_an_overexposed_picture_shows_alike_are_of_one_ball() -> None:
    """A hand beside the white had been named pink, and the white of some frames with it."""
    white, pink, red = np.array([1.15, 1.33, 1.01]), np.array([1.66, 1.37, 1.07]), np.array([0.81, 0.03, 0.22])
    named = [("pink", pink), ("white", white), ("red", red)]
    assert distinct(named, {"white": 24, "pink": 6, "red": 30}) == named[1:]
    real = [("pink", np.array([0.97, 0.6, 0.65])), *named[1:]]
    assert distinct(real, {"white": 24, "pink": 6, "red": 30})[0][0] == "pink"


def test_balls_at_rest_tell_how_steady_a_measure_is() -> None:
    """Places jump by a pixel between pictures, as where a shadow is taken for the ball; a mover counts for none."""

    class Jumping:
        def find(self, picture: Picture) -> list[Detection]:
            k = int(picture[0, 0, 0])
            at, seen = np.array([50.0 + k % 2, 40.0]), []
            for xy in (at, np.array([10.0 * k, 5.0])):
                seen.append(Detection("white", xy, 8.0, 0.1, 1.0, 1.0))
            return seen

    pictures = [np.full((2, 2, 3), k, np.uint8) for k in range(8)]
    assert unsteadiness(cast(Detector, Jumping()), pictures) == pytest.approx(np.sqrt(0.125))
    assert unsteadiness(cast(Detector, Jumping()), pictures[:2]) == 0.0


@pytest.mark.slow
def test_an_arm_and_a_cue_are_no_balls_however_small_these_are(tmp_path: Path) -> None:
    """Outlines of balls of 4 pixels hold all that is there: cue, hand and sleeve became four balls."""
    camera = overhead(Table(3.569, 1.778), 0.0525, (640, 360), 6.0, 4.2, (0.05, -0.05))
    places = np.array([[(1.2 - 0.2 * k, -0.5 + 0.03 * k)] for k in range(8)])
    cue = Cue(1.0, (-1.0, 0.4, 0.03), -1.0, 0.5)
    pictures = shown(camera, ("white",), places, Look(noise=2.7, blur=1.0, player=True), cue)
    footage = footage_of(tmp_path, pictures)
    detector = learn_detector(camera, footage, default_palette())
    assert {name for name, _ in detector.ball_colours} == {"white"}
    for picture, xy in zip(pictures, places, strict=True):
        (one,) = detector.find(picture)
        assert np.hypot(*(one.xy - camera.outline(xy)[0])) < 0.5 * one.radius
