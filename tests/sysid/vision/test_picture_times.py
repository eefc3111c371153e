"""Films stored at another rate than that at which their pictures were taken, and pictures that were lost on the way."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from sysid.vision.tracks.following.follow import Follower
from sysid.vision.tracks.times.picture_times import TimedTracks, set_right
from sysid.vision.tracks.times.rates import regular_gaps
from tests.support.followed_balls import CAMERA, NAMES, Recording, sightings

RATE = 60.0  # of the camera
MADE = Recording(fps=RATE).wait(0.5).shot((1.0, 0.35)).wait(0.5)
COUNT = sum(map(len, MADE.rows))
STOPPED = sum(map(len, MADE.rows[:2])) / RATE  # when all have come to rest [s]


def timed(shown: NDArray[np.int64], stored_rate: float) -> TimedTracks:
    """A film whose k-th picture is picture shown[k] of the camera, at even stamps."""
    follower = Follower(CAMERA)
    twice = np.diff(shown, prepend=-1) == 0
    seen = list(sightings(np.concatenate(MADE.rows)[shown], NAMES, np.random.default_rng(0), noise=0.05))
    for index, some in enumerate(seen):
        if not twice[index]:
            follower.update(index, index / stored_rate, some)
    frames = np.arange(len(shown))
    return set_right(TimedTracks(follower.tracks(), frames, frames / stored_rate), twice, CAMERA)


def worst_time(found: TimedTracks, shown: NDArray[np.int64]) -> float:
    """How far times are off, beside the film's beginning [s]; of pictures in which something moves."""
    true = shown[found.frames] / RATE
    off = (found.times - true)[(true > MADE.struck[0] + 0.3) & (true < STOPPED)]
    return float(np.abs(off - np.median(off)).max())


def test_stamps_that_are_right_stay() -> None:
    found = timed(np.arange(COUNT), RATE)
    assert (found.notes, found.rate) == ((), None)
    assert np.array_equal(found.times, found.frames / RATE)


@pytest.mark.parametrize("interval", [4, 5])
def test_a_film_converted_to_a_lower_rate(interval: int) -> None:
    """Of 60 pictures a second 48 or 50 are stored: stamps are right in the mean, steps are not."""
    shown = np.array([k for k in range(COUNT) if k % (interval + 1) != 2])
    found = timed(shown, RATE * interval / (interval + 1))
    assert found.rate == pytest.approx(RATE)
    assert worst_time(found, shown) < 0.02 / RATE
    assert found.notes[0].startswith(f"one of {interval + 1} pictures is missing, as of 60 frames/s stored as")


def test_pictures_lost_before_a_conversion_are_found_as_well() -> None:
    lost = 60
    taken = [k for k in range(COUNT) if not lost <= k < lost + 4]
    shown = np.array([k for number, k in enumerate(taken) if number % 6 != 2])
    found = timed(shown, RATE * 5 / 6)
    assert worst_time(found, shown) < 0.02 / RATE
    assert len(found.notes) == 2 and "missing" in found.notes[1]


@pytest.mark.parametrize("stored_rate", [72.0, 75.0])
def test_a_recorder_that_stores_pictures_of_a_slower_camera_twice(stored_rate: float) -> None:
    shown = np.arange(int(COUNT * stored_rate / RATE)) * RATE / stored_rate
    shown = np.floor(shown + 1e-9).astype(np.int64)
    found = timed(shown, stored_rate)
    assert found.rate == pytest.approx(RATE, rel=0.01)
    assert worst_time(found, shown) < 0.15 / RATE
    assert "were taken at a constant" in found.notes[1]


def test_irregular_gaps_are_no_conversion() -> None:
    assert regular_gaps({29: 1, 66: 1, 109: 1}) is None
    assert regular_gaps({7: 1, 19: 1, 30: 1, 52: 1, 61: 1, 79: 1}) is None
    assert regular_gaps({10: 3, 15: 3, 20: 3, 25: 3, 30: 3}) is None
    assert regular_gaps({}) is None
