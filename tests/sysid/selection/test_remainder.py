"""What is left where neither an effect nor a formula explains it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from models.errors import BadInput
from models.model_file import full_model
from sysid.clips import read_clip_set
from sysid.estimation import FittedModel, begin
from sysid.new_effect import source_of
from sysid.report.findings import unexplained_lines
from sysid.selection import remainder as room
from sysid.selection.remainder import remainder
from tests.truth.__main__ import main as generate


def fitted(folder: Path, *words: str) -> FittedModel:
    kinds = ("--kind", "roll,stun,cushion,draw", "--clips", "8", "--seconds", "2.5", "--seed", "41")
    assert generate([str(folder), *kinds, *words]) == 0
    clip_set = read_clip_set(folder)
    return begin(clip_set, full_model(clip_set.table, clip_set.ball))[1]


@pytest.mark.slow
def test_a_camera_that_swings_is_told_with_its_frequency(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    base = fitted(tmp_path / "set", "--hidden", "camera_shake=0.001,3.1")
    told = remainder(base)
    assert told is not None
    assert told["where"].startswith("the image: it oscillates along x")
    assert told["frequency_hz"] == pytest.approx(3.1, rel=0.02)
    assert told["size"] == pytest.approx(0.001, rel=0.15)
    assert told["delta_bic"] > 1000
    assert not any("new-effect" in line for line in unexplained_lines(told)), "phases differ from clip to clip"
    result = tmp_path / "result.json"
    result.write_text(json.dumps({"unexplained": told}))
    with pytest.raises(BadInput, match="has no formula"):
        source_of(result, "swing")
    monkeypatch.setattr(room, "oscillation", lambda point: None)
    told = remainder(base)
    assert told is not None
    assert told["where"] == "not located"
    assert 0.0003 < told["size"] < 0.0009
    assert unexplained_lines(told)[0] == "something else: not located"


@pytest.mark.slow
def test_noise_leaves_nothing(tmp_path: Path) -> None:
    base = fitted(tmp_path / "set", "--outliers", "0.01")
    assert remainder(base) is None
