"""A ball that spins in place: found by its face that changes, timed by what else happens, measured from footage."""

from __future__ import annotations

from pathlib import Path as File

import numpy as np
import pytest

from models.shot import Table
from sysid import cli
from sysid.clips import read_clip_set
from sysid.direct.measure import measure
from sysid.vision.tracks.following.follow import BallTrack
from sysid.vision.tracks.moves import TrackedScene
from sysid.vision.tracks.shots.spins import face_change, spins
from tests.footage.__main__ import main as film
from tests.truth.__main__ import main as generate

FPS, NOISE = 120, 5.0
TRUE = 22.0  # deceleration of sidespin [rad/s^2]


def path(name: str, place: tuple[float, float], turns: tuple[float, float] | None, n: int = 240) -> BallTrack:
    """A ball at rest, whose face changes between two times [s]."""
    rng, time = np.random.default_rng(0), np.arange(n) / FPS
    xy = np.array(place) + rng.normal(0, 1e-4, (n, 2))
    alive = np.zeros(n, bool) if turns is None else (time >= turns[0]) & (time <= turns[1])
    face = np.where(alive, 2.5, 1.0) + rng.normal(0, 0.05, n)
    return BallTrack(name, np.arange(n), time, xy * 400, xy, np.full(n, 0.1), np.full(n, 11.0), face)


def scene(*paths: BallTrack) -> TrackedScene:
    """What was seen of these balls."""
    return TrackedScene(paths, paths[0].frame, paths[0].time, Table(2.0, 1.0), 0.026, 1e-4)


def test_a_face_that_turns_is_told_from_noise_and_from_light() -> None:
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:40, :40]
    plain = np.repeat(np.where((x - 24) ** 2 + (y - 20) ** 2 < 9, 40.0, 200.0)[..., None], 3, axis=2)
    moved = np.roll(plain, 1, axis=1)

    def taken(light: np.ndarray) -> np.ndarray:
        return np.clip(np.rint(light + NOISE * rng.standard_normal(light.shape)), 0, 255).astype(np.uint8)

    def of(one: np.ndarray, two: np.ndarray) -> float:
        return face_change(taken(one), taken(two), np.array([20.0, 20.0]), 12.0, NOISE)

    assert of(plain, plain) == pytest.approx(1.0, abs=0.1)
    assert of(plain, plain + 12) == pytest.approx(1.0, abs=0.1)
    assert of(plain, moved) > 2
    assert np.isnan(face_change(taken(plain), taken(plain), np.array([3.0, 20.0]), 12.0, NOISE))


def test_faces_that_change_all_at_once_are_no_spins() -> None:
    """As in a film made of fields, whose pictures lie a row higher in turn."""
    white, red = path("white", (0.3, 0.1), (0.5, 1.4)), path("red", (-0.4, 0.0), (0.4, 1.5))
    assert spins(scene(white, red), ()) == []


def test_a_spin_in_place_is_a_clip_of_the_time_it_lasts() -> None:
    white, red = path("white", (0.3, 0.1), (0.5, 1.4)), path("red", (-0.4, 0.0), None)
    (found,) = spins(scene(white, red), ())
    assert found.spun and found.struck == "white" and found.balls == ("white", "red") and found.speed == 0.0
    assert found.first / FPS == pytest.approx(0.5, abs=0.02)
    assert found.last / FPS == pytest.approx(1.4, abs=0.02)
    assert spins(scene(red), ()) == []
    assert spins(scene(path("white", (0.3, 0.1), (0.5, 0.7))), ()) == [], "too short to tell"


def test_what_hides_or_moves_cuts_a_spin() -> None:
    white = path("white", (0.3, 0.1), (0.2, 1.8))
    (found,) = spins(scene(_without(white, 0.2, 0.5)), ())
    assert found.first / FPS == pytest.approx(0.6, abs=0.02), "fingers that spin a ball hide it"
    rolls = path("red", (-0.4, 0.0), None)
    rolls.xy[120:] += np.outer(np.arange(120) / FPS, [0.3, 0.0])
    (found,) = spins(scene(white, rolls), ())
    assert found.last < 120
    assert found.balls == ("white",) or found.balls == ("white", "red")


def _without(whole: BallTrack, begin: float, end: float) -> BallTrack:
    keep = (whole.time < begin) | (whole.time > end)
    columns = (whole.frame, whole.time, whole.pixels, whole.xy, whole.sd, whole.radius, whole.face_change)
    return BallTrack(whole.name, *(column[keep] for column in columns))


@pytest.mark.slow
@pytest.mark.parametrize("marks", ["1", pytest.param("8", marks=pytest.mark.thorough)])
def test_deceleration_of_sidespin_from_footage_alone(tmp_path: File, marks: str) -> None:
    played, video = tmp_path / "played", tmp_path / "film.mkv"
    shots = ("--clips", "1", "--kind", "spin", "--seconds", "1.5", "--length", "0.8", "--width", "0.45")
    constants = ("--constant", f"spin={TRUE}", "--no-jitter")
    assert generate([str(played), "--seed", "3", *shots, *constants]) == 0
    assert film([str(played), str(video), "--size", "400x240", "--marks", marks]) == 0
    tracked = tmp_path / "tracked"
    assert cli.main(["track", str(video), "--camera", str(tmp_path / "film.camera.toml"), "--out", str(tracked)]) == 0
    (clip,) = read_clip_set(tracked).clips
    assert "spins in place" in clip.note
    found = {m.kind.name: m for m in measure(read_clip_set(tracked)).all}["decoupled_cloth.spin"]
    assert found.value == pytest.approx(TRUE, rel=0.02)
