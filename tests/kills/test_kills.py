"""Kills at random moments lose nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.kills.course import SIGNALS, Course, Tally
from tests.kills.works import WORKS

SHORT = "campaign"  # the work that is killed in every run of the slow tests

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc"),
]


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.thorough] * (name != SHORT)) for name in WORKS])
def test_kills_at_random_moments_lose_nothing(name: str, tmp_path: Path) -> None:
    tally = Tally()
    Course(name, WORKS[name], tmp_path / "course").run(
        len(SIGNALS), np.random.default_rng([7, len(name)]), tally, SIGNALS
    )
    assert tally.wrong == []
