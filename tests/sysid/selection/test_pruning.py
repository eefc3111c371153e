"""Effects that a fit does not need, on data made by a program that shares no code with the model."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from models.model_file import full_model
from sysid.clips import read_clip_set
from sysid.estimation import FittedModel, begin
from sysid.estimation.clip_fit import ClipFit
from sysid.selection.discover import DiscoveryResult, without_idle
from sysid.selection.pruning import distance_from_absence, without_minor, without_unclear
from sysid.selection.score import score_all
from sysid.selection.screening import candidates_for, fit_candidate
from tests.truth.__main__ import main as generate


@pytest.mark.slow
def test_what_explains_little_beside_much_is_not_named(tmp_path: Path) -> None:
    """Air drag is missing: a rolling shutter fits a little of it, drag in proportion to the speed most of it."""
    folder = str(tmp_path / "set")
    words = ("--seed", "36", "--clips", "6", "--seconds", "2.5", "--kind", "roll,follow", "--effect", "air_drag=0.05")
    assert generate([folder, *words]) == 0
    clip_set = read_clip_set(Path(folder))
    parts, base = begin(clip_set, full_model(clip_set.table, clip_set.ball))

    def added(name: str) -> FittedModel:
        [score] = [s for s in score_all(base, candidates_for(base.model)).rows if s.candidate.name == name]
        return fit_candidate(parts, base, score).fitted

    shutter, dragged = added("rolling_shutter"), added("speed_drag")
    now, verdict = without_minor(parts, shutter, ("rolling_shutter",))
    assert verdict == ()
    assert "rolling_shutter.delay" not in now.names
    assert without_minor(parts, dragged, ("speed_drag",)) == (dragged, ("speed_drag",))
    assert without_unclear(parts, dragged, ("speed_drag",)) == (dragged, ("speed_drag",))

    # The same fit on clips that do not agree on the size.
    value, sd = dragged.value("speed_drag.rate")
    assert distance_from_absence(dragged, "speed_drag") == pytest.approx(abs(value) / sd)
    vague = dataclasses.replace(dragged, covariance=dragged.covariance * (value / sd) ** 2)
    assert distance_from_absence(vague, "speed_drag") == pytest.approx(1.0)
    now, verdict = without_unclear(parts, vague, ("speed_drag",))
    assert verdict == () and "speed_drag.rate" not in now.names

    # Of shots that were cut, whole ones decide.
    named = DiscoveryResult(parts, (base, dragged), ((), ("speed_drag",)), ())
    for whole, expected in ((dragged, ("speed_drag",)), (vague, ())):
        fits = {(): base, ("speed_drag",): whole}
        fitted = {names: ClipFit(parts, fit, fit.model, 1.0, 0.0) for names, fit in fits.items()}
        assert without_idle(parts, clip_set, dataclasses.replace(named, whole=fitted)).verdict == expected
