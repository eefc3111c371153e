"""What changes with the session of which the clips tell, found in clips of a generator that shares no code."""

from __future__ import annotations

from pathlib import Path

import pytest

from models.model_file import full_model
from sysid.clips import read_clip_set
from sysid.selection.discover import discover
from tests.examination.__main__ import make


@pytest.mark.slow
def test_cushions_that_are_livelier_in_a_warm_room_are_found(tmp_path: Path) -> None:
    """Their restitution grows by 0.006 a degree, whatever the order of the clips."""
    make(tmp_path / "set", "warm_room", 5, clips=15)
    clip_set = read_clip_set(tmp_path / "set")
    found = discover(clip_set, full_model(clip_set.table, clip_set.ball))
    assert found.verdict == () and found.unexplained is not None
    (term,) = found.unexplained["terms"]
    assert term["name"] == "cushion_e_warmth" and term["value"] == pytest.approx(0.006, rel=0.05)
    assert found.unexplained["depends_on"] == ["temperature"]
    assert found.explained is not None and found.explained.held_rms < 1.1 * 0.0005
