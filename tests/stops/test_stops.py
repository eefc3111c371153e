"""A series is stopped from outside, whatever it is doing; `python -m tests.stops` repeats each way at length."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.stops.__main__ import faults_of
from tests.stops.rounds import FROM_ELSEWHERE, WAYS, play

pytestmark = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc")


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_a_series_stops_in_time_and_says_so(way: str) -> None:
    rate = 0.05 if way in FROM_ELSEWHERE else 0.0
    assert faults_of(play(way, np.random.default_rng([3, len(way)]), rate)) == []
