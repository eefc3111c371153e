"""Balls in pictures as webcams make them: compressed, swept by motion, with a hand and projected light in them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.shot import Array
from sysid.vision.balls.background import View
from sysid.vision.balls.colours.palette import default_palette
from sysid.vision.balls.cover import DiscFit, _settled, cover, fit_disc, swept_share
from sysid.vision.balls.detect import Detector
from sysid.vision.balls.discs import Expected, Shutter, is_clear, known_disc, near_disc
from sysid.vision.balls.learning import learn_detector
from sysid.vision.balls.sweeps import strips
from sysid.vision.frames import open_footage
from sysid.vision.sources.pictures import Picture
from sysid.vision.tracks.track import Tracked, track
from tests.footage.film import Look, film
from tests.footage.motion import Motion
from tests.footage.webcam import Webcam, webcam
from tests.support.drawn_balls import footage_of
from tests.support.webcam_shots import CAMERA, FPS, NAMES, rolling

EXPOSURE = 0.02
LOOK = Look(exposure=EXPOSURE, noise=2.0, parts=9, shadow=0.45, light=(0.05, 0.03, 1.0))

Shot = tuple[Motion, list[Picture], Detector, Path]


def filmed(motion: Motion, seconds: float, how: Webcam) -> list[Picture]:
    return list(webcam(film(CAMERA, motion, np.arange(0, seconds, 1 / FPS), LOOK), how))


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Shot:
    folder = tmp_path_factory.mktemp("webcam")
    motion = rolling(np.array([[-0.45, -0.2], [0.3, 0.2]]), [(0.9, 0.35), (0.0, 0.0)], 2.0, 0.5)
    pictures = filmed(motion, 1.6, Webcam(quality=35, hand=(0.05, 0.95), ring=(0.1, -0.15), seed=1))
    return motion, pictures, learn_detector(CAMERA, footage_of(folder, pictures), default_palette()), folder


def place(motion: Motion, time: float, ball: int) -> Array:
    xy = motion.position[:, ball]
    return np.array([np.interp(time, motion.times, xy[:, axis]) for axis in (0, 1)])


def sought(view: View, colour: Array | None, at: Array, step: Array, shutter: Shutter) -> DiscFit | None:
    """A ball expected at a pixel (2,) after a step (2,) [pixels]."""
    near = near_disc(view, colour, at, step, shutter)
    return near if is_clear(near) else known_disc(view, colour, Expected("", at, step), near, shutter, None, [])


def test_pixels_are_parts_of_ball_and_table_and_shadows_are_none() -> None:
    table = np.full((4, 6, 3), (130.0, 160.0, 140.0), np.float32)
    ball = np.array([60.0, 10.0, 230.0])
    share = np.linspace(0, 1, 6)[None, :, None]
    mixed = ((1 - share) * table + share * ball).astype(np.float32)
    assert cover(mixed, table, ball) == pytest.approx(np.broadcast_to(share[..., 0], (4, 6)), abs=1e-3)
    assert np.abs(cover(0.7 * table, table, ball)).max() < 0.15


def test_a_swept_disc_covers_what_its_exposure_says() -> None:
    """On its path the cover is the time for which the disc is there."""
    x = np.arange(-60.0, 61.0)
    share = swept_share(x, np.zeros_like(x), 10.0, np.array([40.0, 0.0]))
    assert share[60] == pytest.approx(20 / 40, abs=0.04)
    assert share.sum() == pytest.approx(20.0, abs=0.3)
    assert share[0] == share[-1] == 0


@pytest.mark.slow
def test_a_ball_struck_hard_is_found_where_it_is_swept_far_at_once(tmp_path: Path) -> None:
    """At 4 m/s and with the shutter nearly always open it covers four diameters, the first time after it rested."""
    motion = rolling(np.array([[-0.45, -0.1], [0.3, 0.2]]), [(4.0, 0.9), (0.0, 0.0)], 1.0, 0.5)
    look = replace(LOOK, exposure=0.03)
    times = np.arange(0, 0.68, 1 / FPS)
    pictures = list(webcam(film(CAMERA, motion, times, look), Webcam(quality=50, seed=1)))
    detector = replace(learn_detector(CAMERA, footage_of(tmp_path, pictures), default_palette()), rough=True)
    found = track(open_footage(tmp_path, FPS), CAMERA, detector, {"white": 1, "red": 15})
    (white,) = (one for one in found.scene.tracks if one.name == "white")
    moving = np.flatnonzero(times > 0.5 + 1 / FPS)
    assert set(moving) <= set(white.frame.tolist())
    off = [white.xy[white.frame == k][0] - place(motion, float(times[k]), 0) for k in moving]
    assert np.hypot(*np.array(off).T).max() < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("light", [(0.45, 0.3), pytest.param((-0.1, -0.5), marks=pytest.mark.thorough)])
def test_light_from_aside_does_not_draw_a_ball_to_its_side(light: tuple[float, float], tmp_path: Path) -> None:
    """It did by 0.6 pixels."""
    motion = rolling(np.array([[-0.1, -0.05], [0.25, 0.1]]), [(0.0, 0.0), (0.0, 0.0)], 1.0, 0.0)
    look = replace(LOOK, light=(*light, 1.0), shadow=0.2)
    pictures = list(webcam(film(CAMERA, motion, np.arange(6) / FPS, look), Webcam(quality=70)))
    detector = replace(learn_detector(CAMERA, footage_of(tmp_path, pictures), default_palette()), rough=True)
    found = {one.name: one.xy for one in detector.find(pictures[-1])}
    true = dict(zip(NAMES, CAMERA.outline(motion.position[0]), strict=True))
    assert max(np.hypot(*(found[name] - true[name])) for name in NAMES) < 0.5


@pytest.mark.slow
def test_a_webcam_s_pictures_are_known_to_be_rough(shot: Shot) -> None:
    _, _, detector, _ = shot
    assert detector.rough
    assert {name for name, _ in detector.ball_colours} == set(NAMES), "neither the hand nor the ring is a ball"


@pytest.mark.slow
def test_a_shot_is_followed_and_its_noise_told(shot: Shot) -> None:
    motion, pictures, detector, folder = shot
    shutter = Shutter()
    found = track(footage_of(folder, pictures), CAMERA, detector, {"white": 1, "red": 15}, shutter=shutter)
    scale = 100.0 / FPS  # the folder's pictures are read as if taken at 100 frames a second
    assert {t.name for t in found.scene.tracks} == set(NAMES)
    off, pixel = [], CAMERA.radius / float(CAMERA.radius_px(np.zeros((1, 2)))[0])
    for path in found.scene.tracks:
        ball = NAMES.index(path.name)
        error = path.xy - [place(motion, t * scale, ball) for t in path.time]
        assert np.abs(np.median(error, axis=0)).max() < 0.6 * pixel, "shading shifts a ball, always the same way"
        off.append(error - np.median(error, axis=0))
        assert len(path.time) >= len(pictures) - 2
    rms = float(np.sqrt(np.mean(np.concatenate(off) ** 2)))
    assert rms < 0.4 * pixel
    assert [s.struck for s in found.shots if not s.spun] == ["white"]
    assert shutter.fraction == pytest.approx(EXPOSURE * FPS, abs=0.2)
    assert moving_scatter(found, motion, scale) == pytest.approx(found.noise.moving, rel=0.35)


def moving_scatter(found: Tracked, motion: Motion, scale: float) -> float:
    """Standard deviation per axis of the struck ball's errors while it moves, without their slow part."""
    path = next(t for t in found.scene.tracks if t.name == "white")
    moving = path.time * scale > 0.6
    off = (path.xy - np.array([place(motion, t * scale, 0) for t in path.time]))[moving]
    trend = np.vander(np.linspace(-1, 1, len(off)), 5)
    left = off - trend @ np.linalg.lstsq(trend, off, rcond=None)[0]
    return float(np.sqrt(np.sum(left**2) / (2 * (len(off) - 5))))


@pytest.mark.slow
def test_the_sweep_says_where_a_fast_ball_is(shot: Shot) -> None:
    """At 3 m/s a ball covers more than its radius during the exposure."""
    _, _, detector, _ = shot
    motion = rolling(np.array([[-0.5, 0.0]]), [(3.0, 0.6)], 0.3, 0.0)
    pictures = filmed(motion, 0.2, Webcam(quality=50))
    colour = detector._in_picture(detector.background.view(pictures[0]), dict(detector.ball_colours)["white"])
    outline = [CAMERA.outline(place(motion, k / FPS, 0)[None])[0] for k in range(len(pictures))]
    for k in range(2, 5):
        view, step = detector.background.view(pictures[k]), outline[k] - outline[k - 1]
        fit = sought(view, colour, outline[k] + [2.0, -1.0], step, Shutter(EXPOSURE * FPS))
        assert fit is not None
        assert np.hypot(*(fit.xy - outline[k])) < 1.0
        still = fit_disc(view, colour, outline[k], fit.radius, np.zeros(2))
        assert still is None or still.residual > fit.residual


@pytest.mark.parametrize("off", [(-8.0, 0.0), (5.0, 4.0), (0.0, -9.0)])
@pytest.mark.slow
def test_where_a_disc_is_found_does_not_depend_on_where_it_was_expected(shot: Shot, off: tuple[float, float]) -> None:
    motion, pictures, detector, _ = shot
    colour = detector._in_picture(detector.background.view(pictures[0]), dict(detector.ball_colours)["white"])
    for k in (24, 30, 36):
        view, true = detector.background.view(pictures[k]), CAMERA.outline(place(motion, k / FPS, 0)[None])[0]
        step = true - CAMERA.outline(place(motion, (k - 1) / FPS, 0)[None])[0]
        for shown in (colour, None):
            near, far = (
                fit_disc(view, shown, true + start, view.geometry.radius(true), EXPOSURE * FPS * step)
                for start in (np.zeros(2), np.array(off))
            )
            assert near is not None
            assert far is not None
            assert np.hypot(*(near.xy - far.xy)) < 0.05 * near.radius


def test_a_fit_settles_where_the_disc_does_not_match() -> None:
    y, x = np.mgrid[:60, :90].astype(float)
    swept = swept_share((x - 45).ravel(), (y - 30).ravel(), 16.0, np.array([20.0, 0.0]))
    seen, start = (0.4 * swept).reshape(x.shape).astype(np.float32), np.array([50.0, 27.0])
    fits = [_settled(seen, np.zeros(2), start, 16.0, np.zeros(2), 1.0, 0.3, steps) for steps in (59, 60)]
    assert fits[0] is not None and fits[1] is not None
    assert np.hypot(*(fits[1].xy - fits[0].xy)) < 0.02


@pytest.mark.slow
def test_of_balls_of_any_colour_the_nearest_is_meant(shot: Shot) -> None:
    """A white ball fits better than a dark one, for all that is expected beside it."""
    _, _, detector, _ = shot
    h, w = detector.background.picture.shape[:2]
    radius = float(CAMERA.radius_px(np.zeros((1, 2)))[0])
    picture = detector.background.picture.astype(float)
    y, x = np.mgrid[:h, :w]
    places = np.array([[w / 2 - 60.2, h / 2 + 40.4], [w / 2 - 60.2 - 3.2 * radius, h / 2 + 40.1]])
    for at, ball in zip(places, ([60.0, 110.0, 40.0], [235.0, 245.0, 250.0]), strict=True):
        share = np.clip(radius - np.hypot(x - at[0], y - at[1]) + 0.5, 0, 1)[..., None]
        picture = (1 - share) * picture + share * np.array(ball)
    dark = np.hypot(x - places[0, 0] - 3, y - places[0, 1]) < 3
    picture[dark] = (200, 200, 200)
    view = detector.background.view(picture.clip(0, 255).astype(np.uint8))
    fit = sought(view, None, places[0] - [0.75 * radius, 0.0], np.zeros(2), Shutter(0.0))
    assert fit is not None
    assert np.hypot(*(fit.xy - places[0])) < 0.1 * radius


@pytest.mark.slow
def test_nothing_is_seen_out_of_the_picture(shot: Shot) -> None:
    """A ball that was expected there ended the tracking."""
    _, pictures, detector, _ = shot
    view = detector.background.view(pictures[0])
    other = DiscFit(np.array([40.0, 40.0]), 10.0, np.zeros(2), 1.0, 0.0, 0.0, 0.0, 1.0, 1.0)
    for out in ([-200.0, 40.0], [3000.0, 40.0], [40.0, -200.0], [40.0, 3000.0]):
        assert strips(view, None, np.array(out), 10.0, 60.0, [other]) == []


@pytest.mark.parametrize("radii", [0.8, 2.5])
@pytest.mark.slow
def test_how_far_a_ball_of_several_colours_moves_is_seen(shot: Shot, radii: float) -> None:
    """Its mixed rim was taken for its colours, so that one at rest explained every picture best."""
    _, _, detector, _ = shot
    h, w = detector.background.picture.shape[:2]
    at, radius = np.array([w / 2 - 40.3, h / 2 + 30.6]), float(CAMERA.radius_px(np.zeros((1, 2)))[0])
    motion = radii * radius * np.array([0.8, 0.6])
    y, x = np.mgrid[:h, :w]
    picture = np.zeros((h, w, 3))
    for u, v in (at + s * motion for s in np.linspace(-0.5, 0.5, 57)):
        share = np.clip(radius - np.hypot(x - u, y - v) + 0.5, 0, 1)[..., None]
        stripe = np.where((np.abs(y - v - 0.2 * (x - u)) < 0.4 * radius)[..., None], (30.0, 40.0, 200.0), 235.0)
        picture += ((1 - share) * detector.background.picture + share * stripe) / 57
    view = detector.background.view(picture.clip(0, 255).astype(np.uint8))
    parts = (0.0, 0.5, 1.0, 1.5)
    start = at + np.array([2.0, -1.0])
    fits = [fit_disc(view, None, start, radius, part * motion) for part in parts]
    misfits = [np.inf if fit is None else fit.misfit for fit in fits]
    assert parts[int(np.argmin(misfits))] == 1.0
    assert fits[2] is not None
    assert np.hypot(*(fits[2].xy - at)) < 0.5


@pytest.mark.parametrize("gain", [1.0, 3.0])
@pytest.mark.slow
def test_a_ball_with_the_cue_still_at_it_is_found_where_it_is(shot: Shot, gain: float) -> None:
    """It was expected to rest, 0.7 radii behind; overexposed, its sweep is as bright as a ball at rest."""
    _, _, detector, _ = shot
    h, w = detector.background.picture.shape[:2]
    at, radius = np.array([w / 2 - 40.3, h / 2 + 30.6]), CAMERA.radius_px(np.zeros((1, 2)))[0]
    motion, ball = np.array([14.0, 0.0]), np.full(3, 255.0)
    y, x = np.mgrid[:h, :w]
    places = [at + s * motion for s in np.linspace(-0.5, 0.5, 57)]
    share = np.mean([np.clip(radius - np.hypot(x - u, y - v) + 0.5, 0, 1) for u, v in places], axis=0)
    cue = (np.abs(y - at[1]) < 4) & (x < at[0] - radius)
    light = np.where(cue, 1.0, np.minimum(gain * share, 1.0))[..., None]
    picture = ((1 - light) * detector.background.picture + light * ball).clip(0, 255).astype(np.uint8)
    view = detector.background.view(picture)
    expected = at - [0.7 * radius, 1.0]
    fit = sought(view, ball, expected, np.array([2.0, 0.0]), Shutter())
    assert fit is not None
    assert np.hypot(*(fit.xy - at)) < 0.06 * radius


@pytest.mark.slow
def test_doubled_and_missing_frames_are_told(shot: Shot, tmp_path: Path) -> None:
    _, pictures, detector, _ = shot
    changed = [*pictures[:24], pictures[23], *pictures[24:32], *pictures[34:]]
    found = track(footage_of(tmp_path / "changed", changed), CAMERA, detector, {"white": 1, "red": 15})
    said = " ".join(found.notes)
    assert "frame 24 shows the same picture as the frame before: left out" in said
    assert "before frame 33 2 missing" in said
    path = next(t for t in found.scene.tracks if t.name == "white")
    assert 24 not in path.frame
    # After the doubled frame stamps are a frame late, after the missing ones right but for that.
    assert float(path.time[-1]) == pytest.approx((len(pictures) - 1 + 1) / 100.0, abs=1e-9)


def test_how_overexposed_white_balls_are_is_known_after_some_fits() -> None:
    white, shutter = np.full(3, 255.0), Shutter(0.5)
    assert len(shutter.tried(white)) > 1
    assert len(shutter.tried(np.array([40.0, 40.0, 200.0]))) == 1
    shutter.gains += [1.0] * 15
    assert shutter.gain is None
    shutter.gains.append(1.0)
    assert shutter.tried(white) == [(0.5, 1.0)]
    shutter.gains += [1.5, 2.5, 2.5, 2.5]
    assert shutter.tried(white) == [(0.5, 2.5)]
