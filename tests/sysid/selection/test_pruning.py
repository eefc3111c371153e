"""Effects that a fit does not need, on data made by a program that shares no code with the model."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from models.effects.cloth.worn_patch import WornPatch
from models.model_file import full_model
from models.shot import Ball, Table
from sysid.clips import read_clip_set
from sysid.estimation import FittedModel, begin
from sysid.selection import pruning
from sysid.selection.pruning import distance_from_absence, without_minor, without_unclear, without_unsettled
from sysid.selection.score import score_all
from sysid.selection.screening import candidates_for, fit_candidate
from tests.truth.__main__ import main as generate


def test_a_patch_that_may_lie_anywhere_is_not_shown() -> None:
    """Its size is far beyond its uncertainty; what counts besides is whether the clips say where it lies."""
    plain = full_model(Table(3.569, 1.778), Ball(0.0525, 0.1406))
    model = dataclasses.replace(plain, effects=(WornPatch(roll=-0.15, slide=0.03),))
    names = [name for name in model.parameters() if name.startswith("worn_patch.")]
    constants = np.array([float(model.parameters()[name]) for name in names])
    problem = SimpleNamespace(model=model, names=names)

    def distance(*sds: float) -> float:
        fit = FittedModel(problem, np.zeros(0), constants, 0.0, np.diag(sds) ** 2, True, 1.0, 1.0)  # type: ignore[arg-type]
        return distance_from_absence(fit, "worn_patch")

    assert distance(0.013, 0.26, 0.01, 0.01, 0.02) == pytest.approx(np.hypot(0.15 / 0.013, 0.03 / 0.26), abs=0.1)
    assert distance(0.013, 0.26, np.nan, 0.01, np.nan) > 10.0  # as high as its y is
    assert distance(0.013, 0.26, np.nan, np.nan, np.nan) == 0.0


def test_an_effect_with_which_the_fit_no_longer_converges_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where it converges without it: it is then known how well the other effects are."""
    fits = {("tilt",): SimpleNamespace(converged=True), ("tilt", "patch"): SimpleNamespace(converged=False)}
    both, tilt = fits["tilt", "patch"], fits["tilt",]
    monkeypatch.setattr(pruning, "fit_without", lambda parts, now, name: tilt)
    monkeypatch.setattr(pruning, "loss_ratio_without", lambda now, name: {"tilt": 9.0, "patch": 1.2}[name])
    whole = SimpleNamespace()
    assert without_unsettled(whole, both, ("tilt", "patch")) == (tilt, ("tilt",))  # type: ignore[arg-type]
    assert without_unsettled(whole, both, ("tilt",)) == (both, ("tilt",))  # type: ignore[arg-type]
    tilt.converged = False
    assert without_unsettled(whole, both, ("tilt", "patch")) == (both, ("tilt", "patch"))  # type: ignore[arg-type]
    both.converged = tilt.converged = True
    assert without_unsettled(whole, both, ("tilt", "patch")) == (both, ("tilt", "patch"))  # type: ignore[arg-type]


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
