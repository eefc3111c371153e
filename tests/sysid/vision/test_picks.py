"""Frames picked from a finer sequence: what the steps of balls tell of the times between them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from models.shot import Array
from sysid.vision.tracks.following.follow import BallTrack, Follower
from sysid.vision.tracks.following.prediction import State
from sysid.vision.tracks.noise import _parabola_residual
from sysid.vision.tracks.times.picks import find_picks, seem_uneven
from sysid.vision.tracks.times.picture_times import TimedTracks, set_right
from tests.support.followed_balls import CAMERA, FPS, NAMES, Recording, sightings

PERIOD = 1 / 30
NOISE_PX = 0.3


def picked(parts: int, seed: int = 0, noise: float = NOISE_PX) -> tuple[tuple[BallTrack, ...], Array, Array]:
    """A shot of two balls that move, 30 frames a second by their stamps; with stamps and true times (n,) [s].

    A frame is taken a whole number of parts of a period late, at random.
    """
    made = Recording(fps=120.0).wait(0.5).shot((1.2, 0.42), seconds=3.0).wait(0.3)
    rows, rng = np.concatenate(made.rows), np.random.default_rng(seed)
    every = round(120 * PERIOD)
    count = len(rows) // every - 1
    late = rng.integers(0, parts, count) * (every // parts)
    taken = np.arange(count) * every + late
    follower = Follower(CAMERA, time_sd=0.0 if parts == 1 else 0.4 * PERIOD)
    for k, some in enumerate(sightings(rows[taken], NAMES, rng, noise=noise)):
        follower.update(k, k * PERIOD, some)
    return follower.tracks(), np.arange(count) * PERIOD, taken / 120.0


def frames_of(times: Array) -> NDArray[np.int64]:
    return np.arange(len(times), dtype=np.int64)


def test_uneven_times_are_told_by_the_steps_of_all_balls() -> None:
    tracks, stamps, true = picked(2)
    assert seem_uneven(tracks, frames_of(stamps))
    found = find_picks(tracks, frames_of(stamps), stamps, PERIOD, 0.0)
    assert found is not None
    told = {k: parts / 2 for k, parts in found.durations.items()}
    wrong = [k for k, lasts in told.items() if abs(lasts - (true[k] - true[k - 1]) / PERIOD) > 0.01]
    assert len(told) > 20
    assert len(wrong) <= 0.05 * len(told)
    found = set_right(TimedTracks(tracks, frames_of(stamps), stamps), np.zeros(len(stamps), bool), CAMERA)
    times = found.times
    assert any("picked from 60 a second" in text for text in found.notes)
    moving = slice(18, 60)
    before, after = (np.diff(t[moving]) - np.diff(true[moving]) for t in (stamps, times))
    assert np.std(after) < 0.5 * np.std(before)


@pytest.mark.parametrize("seed", range(4))
def test_no_frame_is_later_than_its_stamp_by_a_period_however_many_impacts_there_are(seed: int) -> None:
    tracks, stamps, true = picked(2, seed)
    times = set_right(TimedTracks(tracks, frames_of(stamps), stamps), np.zeros(len(stamps), bool), CAMERA).times
    assert np.ptp(times - stamps) < 0.6 * PERIOD
    off = (times - true)[18:75]
    assert np.mean(np.abs(off - np.median(off)) < 0.1 * PERIOD) > 0.93


@pytest.mark.parametrize("noise", [0.05, 0.3, 2.0])
def test_even_times_are_left_alone_however_much_balls_scatter(noise: float) -> None:
    tracks, stamps, _ = picked(1, noise=noise)
    assert not seem_uneven(tracks, frames_of(stamps))
    assert find_picks(tracks, frames_of(stamps), stamps, PERIOD, 0.0) is None


@pytest.mark.parametrize("seed", range(4))
def test_times_of_a_sequence_four_times_as_fine_are_not_rounded_to_halves(seed: int) -> None:
    tracks, stamps, _ = picked(4, seed)
    assert seem_uneven(tracks, frames_of(stamps))
    assert find_picks(tracks, frames_of(stamps), stamps, PERIOD, 0.0) is None


def test_balls_at_rest_tell_nothing() -> None:
    follower = Follower(CAMERA)
    rows = np.concatenate(Recording().wait(1.0).rows)
    for k, some in enumerate(sightings(rows, NAMES, np.random.default_rng(0))):
        follower.update(k, k / FPS, some)
    times = np.arange(len(rows)) / FPS
    assert not seem_uneven(follower.tracks(), frames_of(times))
    assert find_picks(follower.tracks(), frames_of(times), times, 1 / FPS, 0.0) is None


def test_the_velocity_of_an_evenly_moving_ball_does_not_swing() -> None:
    """Exact detections, the first velocity unknown: the error of the velocity dies out."""
    state = State(0.0, 0.0, 0.0, 0.0, 0.0, 1e-12, 0.0, 10.0)
    errors = []
    for k in range(1, 12):
        state = state.predicted(k * PERIOD).updated(0.5 * k * PERIOD + 1e-3 * (k == 4), 0.0, 1e-12)
        errors.append(abs(state.u - 0.5))
    assert max(errors[-3:]) < 0.02 * max(errors[3:5])


def test_a_smooth_motion_at_uneven_times_is_no_noise() -> None:
    """A ball that slides, then rolls: two parabolas, joined at a fifth of the way."""
    time = np.cumsum(np.random.default_rng(4).choice([0.5, 1.0, 1.5], 40)) * PERIOD
    way = 2 * (time - time[0]) / np.ptp(time) - 1
    slides = np.minimum(way - 0.2, 0.0) ** 2
    xy = np.column_stack([way - 0.1 * way**2 - 0.3 * slides, 0.4 * way + 0.05 * slides])
    assert _parabola_residual(time, xy, 0.2) < 1e-20


def test_uneven_times_in_a_part_of_a_film_are_told() -> None:
    """A break in the first seconds, converted unevenly, then slow balls for long, at even times."""
    rng, n = np.random.default_rng(4), 400
    steps = np.where(np.arange(n) < 60, np.where(np.arange(n) % 3 == 0, 10.0, 24.0), 4.0) * 1e-3
    at = np.cumsum(steps)

    def moving(direction: float, uneven: bool) -> BallTrack:
        way = at if uneven else np.arange(n) * 4e-3
        xy = way[:, None] * (np.cos(direction), np.sin(direction)) + rng.normal(0, 4e-4, (n, 2))
        ones = np.ones(n)
        return BallTrack("ball", np.arange(n), np.arange(n) * PERIOD, 400 * xy, xy, 0.1 * ones, 10 * ones, ones)

    assert seem_uneven([moving(d, True) for d in (0.1, 1.0, 2.5)], np.arange(n))
    assert not seem_uneven([moving(d, False) for d in (0.1, 1.0, 2.5)], np.arange(n))
