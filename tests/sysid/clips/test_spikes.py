"""Samples that a tracker threw elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from models.shot import Ball, Table
from sysid.clips import Clip, ClipSet, Observation
from sysid.clips.tracker.noise import noise_correlation, position_noise
from sysid.clips.tracker.outliers import find_outliers, find_swaps, remove_outliers

SIGMA = 0.0005


def path(bounce: float = 0.7) -> Observation:
    """A ball of 2 m/s that slows down, meets a rail and comes back."""
    rng = np.random.default_rng(4)
    time = np.arange(150) / 120
    way = 2.0 * time - 0.2 * time**2
    x = np.where(way < 1.2, way, 1.2 - bounce * (way - 1.2))
    return Observation(time, np.column_stack([x, 0.1 * time]) + rng.normal(0, SIGMA, (150, 2)), np.full(150, np.nan))


def test_a_bounce_is_no_spike() -> None:
    for bounce in (0.3, 0.7, 1.0):
        assert not find_outliers(path(bounce), SIGMA).any()


def test_thrown_samples_are_found_and_no_others() -> None:
    seen = path()
    bad = np.array([10, 40, 70, 90, 120])
    seen.xy[bad] += np.array([[0.02, 0.0], [0.0, -0.03], [0.015, 0.02], [-0.05, 0.0], [0.0, 0.012]])
    assert np.flatnonzero(find_outliers(seen, SIGMA)).tolist() == bad.tolist()


@pytest.mark.parametrize("at", [1, 148])
def test_the_second_and_the_last_but_one_may_be_thrown(at: int) -> None:
    seen = path()
    seen.xy[at] += (0.03, 0.02)
    assert np.flatnonzero(find_outliers(seen, SIGMA)).tolist() == [at]
    struck = np.where(np.arange(150) < 2, 0.0, 0.02)[:, None] + path().xy  # it leaps where the cue meets it
    assert not find_outliers(Observation(seen.time, struck, seen.theta), SIGMA).any()


def test_missing_frames_do_not_make_spikes() -> None:
    seen = path()
    keep = np.random.default_rng(1).random(150) > 0.3
    assert not find_outliers(Observation(seen.time[keep], seen.xy[keep], seen.theta[keep]), SIGMA).any()
    few = Observation(seen.time[:4], seen.xy[:4], seen.theta[:4])
    assert not find_outliers(few, SIGMA).any()


def test_what_is_set_aside_is_counted_and_the_rest_kept() -> None:
    seen = path()
    seen.xy[60] += 0.1
    clip = Clip("a.csv", "cue", {"cue": seen, "red": path()})
    whole = ClipSet(Table(3.569, 1.778), Ball(0.0525, 0.1406), 120.0, (clip,), SIGMA)
    part, count = remove_outliers(whole, SIGMA)
    assert count == 1
    assert np.array_equal(part.clips[0].balls["cue"].time, np.delete(seen.time, 60))
    assert part.clips[0].balls["red"] is clip.balls["red"]
    assert remove_outliers(part, SIGMA) == (part, 0)


def meeting() -> tuple[Observation, Observation]:
    """A ball that meets one at rest and stops, and the one that goes on."""
    rng = np.random.default_rng(7)
    time = np.arange(60) / 60
    first = np.where(time < 0.5, 1.5 * time, 0.75 - 0.02 * (time - 0.5))
    second = 0.75 + 0.0525 + np.where(time < 0.5, 0.0, 1.4 * (time - 0.5))
    one, two = (np.column_stack([x, np.zeros(60)]) + rng.normal(0, SIGMA, (60, 2)) for x in (first, second))
    nothing = np.full(60, np.nan)
    return Observation(time, one, nothing), Observation(time, two, nothing)


@pytest.mark.parametrize(("begin", "end"), [(28, 30), (29, 33), (31, 34)])
def test_exchanged_balls_are_found(begin: int, end: int) -> None:
    one, two = meeting()
    assert [rows.tolist() for rows in find_swaps(one, two)] == [[], []]
    part = slice(begin, end)
    one.xy[part], two.xy[part] = two.xy[part].copy(), one.xy[part].copy()
    assert [rows.tolist() for rows in find_swaps(one, two)] == [list(range(begin, end))] * 2
    clip = Clip("a.csv", "one", {"one": one, "two": two})
    whole = ClipSet(Table(3.569, 1.778), Ball(0.0525, 0.1406), 60.0, (clip,), SIGMA)
    assert remove_outliers(whole, SIGMA)[1] == 2 * (end - begin)


def test_a_sample_beyond_a_cushion_is_an_outlier() -> None:
    seen = path()
    seen.xy[1] = (1.0, 0.93)
    whole = ClipSet(Table(3.569, 1.778), Ball(0.0525, 0.1406), 120.0, (Clip("a.csv", "cue", {"cue": seen}),), SIGMA)
    assert 1 / 120 not in remove_outliers(whole, SIGMA)[0].clips[0].balls["cue"].time


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_size_and_correlation_of_the_noise(share: float) -> None:
    """White noise, and with a part of its variance a first-order process, correlated by 0.4 from sample to sample."""
    rng, clips = np.random.default_rng(3), []
    for k in range(60):
        noise = rng.normal(size=(150, 2))
        hanging = noise.copy()
        for i in range(1, 150):
            hanging[i] = 0.4 * hanging[i - 1] + np.sqrt(1 - 0.4**2) * noise[i]
        time = np.arange(150) / 120
        smooth = np.column_stack([1.2 * time - 0.1 * time**2, 0.3 * time])
        white = rng.normal(size=(150, 2))
        xy = smooth + SIGMA * (np.sqrt(1 - share) * white + np.sqrt(share) * hanging)
        clips.append(Clip(f"{k}.csv", "cue", {"cue": Observation(time, xy, np.full(150, np.nan))}))
    clip_set = ClipSet(Table(3.569, 1.778), Ball(0.0525, 0.1406), 120.0, tuple(clips))
    assert abs(position_noise(clip_set) / SIGMA - 1) < 0.03
    if share:
        assert 1 + 2 * 0.3 * 0.3 < noise_correlation(clip_set) < 1 + 2 * 0.3 * 0.4 / 0.6  # low by the lags left out
    else:
        assert noise_correlation(clip_set) == 1.0
