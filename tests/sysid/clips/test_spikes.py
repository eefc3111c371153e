"""Samples that a tracker threw elsewhere."""

from __future__ import annotations

import numpy as np

from models.shot import Ball, Table
from sysid.clips import Clip, ClipSet, Observation
from sysid.clips.outliers import find_outliers, remove_outliers

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
