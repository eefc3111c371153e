"""Soiled clips: the dirt is there, as large as it is said to be, and a clean set has none of it."""

from __future__ import annotations

import dataclasses
import json
import tomllib
from pathlib import Path

import numpy as np

from tests.truth.__main__ import main
from tests.truth.soil import SOILED, Soil, gaps, hanging, measured_wrong, swapped


def test_noise_that_hangs_together_has_its_size_and_memory() -> None:
    times = np.arange(40000) / 120.0
    noise = hanging(times, (len(times), 2), SOILED, np.random.default_rng(0))
    np.testing.assert_allclose(noise.std(0), SOILED.hanging, rtol=0.03)
    np.testing.assert_allclose(np.corrcoef(noise[1:, 0], noise[:-1, 0])[0, 1], 0.6, atol=0.02)


def test_gaps_come_as_often_as_said_and_spare_the_first_frame() -> None:
    times = np.arange(0, 200, 0.01)
    seen = gaps(times, 3, SOILED, np.random.default_rng(0))
    starts = np.sum(seen[:-1] & ~seen[1:])
    assert seen[0].all()
    assert abs(starts / 3 - SOILED.gaps * 200) < 3 * np.sqrt(SOILED.gaps * 200)


def test_two_balls_are_exchanged_where_they_are_nearest() -> None:
    xy = np.zeros((20, 2, 2))
    xy[:, 0, 0], xy[:, 1, 0] = np.linspace(0, 1, 20), 0.5
    changed = swapped(xy, dataclasses.replace(SOILED, swaps=1.0), np.random.default_rng(0))
    frames = np.flatnonzero(np.any(changed != xy, axis=(1, 2)))
    assert 2 <= len(frames) <= 4
    assert 9 <= frames[0] <= 11
    np.testing.assert_array_equal(changed[frames, 0], xy[frames, 1])
    assert swapped(xy, Soil(), np.random.default_rng(0)) is xy


def test_sizes_are_told_a_little_wrong() -> None:
    told = {measured_wrong(2.0, 0.003, np.random.default_rng(k)) for k in range(20)}
    assert told == {2.006, 1.994}


def test_a_soiled_set_says_so_and_a_clean_one_is_as_before(tmp_path: Path) -> None:
    words = ["--clips", "3", "--seed", "4", "--seconds", "0.5"]
    assert main([str(tmp_path / "clean"), *words]) == 0
    assert main([str(tmp_path / "dirty"), *words, "--soiled"]) == 0
    assert "soil" not in json.loads((tmp_path / "clean.truth.json").read_text())
    assert json.loads((tmp_path / "dirty.truth.json").read_text())["soil"]["table"] == SOILED.table
    sizes = [tomllib.loads((tmp_path / n / "clips.toml").read_text())["ball"]["diameter"] for n in ("clean", "dirty")]
    assert abs(sizes[1] / sizes[0] - 1) > 0.004
    first = (tmp_path / "dirty" / "clips" / "0001.csv").read_text().splitlines()[1]
    assert float(first.split(",")[0]) != 0.0
