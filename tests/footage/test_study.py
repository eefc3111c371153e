"""The study of random films: what of a track's errors counts as noise."""

from __future__ import annotations

import numpy as np
import pytest

from tests.footage.study import smooth_errors

PERIOD = 0.04


def test_a_picture_exposed_through_an_impact_shows_no_noise() -> None:
    noise, times = 2e-4, np.arange(200) * PERIOD
    errors = np.random.default_rng(0).normal(0, noise, (200, 2))
    impacts = times[20::25] + PERIOD / 3
    errors[20::25] += 3e-3  # of both motions, the mean
    errors += 1e-3 * times[:, None]  # and of the camera
    assert np.sqrt(np.mean(smooth_errors(times, errors, impacts, PERIOD) ** 2)) == pytest.approx(noise, rel=0.15)
    assert np.sqrt(np.mean(smooth_errors(times, errors, np.zeros(0), PERIOD) ** 2)) > 2 * noise


def test_samples_that_are_missing_join_no_others() -> None:
    times, errors = np.arange(40) * PERIOD, np.zeros((40, 2))
    errors[17:20] = np.nan
    assert len(smooth_errors(times, errors, np.zeros(0), PERIOD)) == 2 * (14 + 17)
