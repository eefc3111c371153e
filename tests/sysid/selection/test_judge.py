"""Whom one look believes: runs between impacts, or whole shots. The fits are given, the decision is tested."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sysid.selection import judge as judging
from sysid.selection import runs
from sysid.selection.judge import Judgement, judge
from sysid.selection.screening import _ranked

NOW = SimpleNamespace(gain=0.0, model=None)
PARTS: Any = SimpleNamespace(follows=lambda found: False)


def told(name: str) -> Any:
    return SimpleNamespace(candidate=SimpleNamespace(name=name), gain=50.0)


def looked(monkeypatch: pytest.MonkeyPatch, by_runs: float, own: str, by_own: float) -> tuple[Judgement, list[str]]:
    """A look where runs name speed_drag: evidence of whole shots for it, what they promise most, evidence for that."""
    with_runs, with_own = (SimpleNamespace(gain=gain, model=None) for gain in (by_runs, by_own))
    fitted: list[str] = []

    def try_one(parts: Any, base: Any, score: Any) -> Any:
        fitted.append(score.candidate.name)
        return SimpleNamespace(name=score.candidate.name, fitted=with_own, converged=True)

    def look(parts: Any, base: Any, candidates: Any, beside: Any, share: float, begun: Any) -> Any:
        known = begun.fitted[0] if begun else None
        return SimpleNamespace(base=base, best=known or try_one(parts, base, told(own)), scores=begun)

    asked = SimpleNamespace(best=SimpleNamespace(name="speed_drag", fitted=with_runs), base=NOW)
    for module, key, stands in (
        (runs, "fit_anew", lambda parts, model, what: with_runs),
        (runs, "compare_fits", lambda a, b: SimpleNamespace(delta_bic=b.gain - a.gain)),
        (runs, "candidates_for", lambda model: []),
        (runs, "score_all", lambda *known: SimpleNamespace(rows=(told(own), told("speed_drag")))),
        (runs, "try_one", try_one),
        (judging, "look_at_runs", lambda parts, now: asked),
        (judging, "candidates_for", lambda model: []),
        (judging, "look", look),
        (judging, "left_over", lambda found: 0.0),
    ):
        monkeypatch.setattr(module, key, stands)
    return judge(PARTS, NOW), fitted  # type: ignore[arg-type]


def test_runs_are_believed_where_whole_shots_promise_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    seen, fitted = looked(monkeypatch, 200.0, "speed_drag", 0.0)
    assert seen.name == "speed_drag" and seen.believed is not None and fitted == ["speed_drag"]


def test_runs_are_believed_where_what_whole_shots_promise_explains_less(monkeypatch: pytest.MonkeyPatch) -> None:
    seen, fitted = looked(monkeypatch, 200.0, "squirt", 205.0)
    assert seen.name == "speed_drag" and seen.believed is not None and fitted == ["squirt"]


def test_whole_shots_name_what_explains_more_and_it_is_fitted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    seen, fitted = looked(monkeypatch, 200.0, "spin_slide_coupling", 900.0)
    assert seen.name == "spin_slide_coupling" and seen.believed is None and fitted == ["spin_slide_coupling"]
    assert len(seen.rounds) == 2, "what runs said is kept"


def test_runs_that_whole_shots_gain_nothing_by_are_not_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    seen, _ = looked(monkeypatch, 5.0, "squirt", 100.0)
    assert seen.name == "squirt" and seen.believed is None


def trial(name: str, delta_bic: float, constants: int, converged: bool = True) -> Any:
    fitted = SimpleNamespace(constants=np.zeros(constants))
    return SimpleNamespace(name=name, evidence=SimpleNamespace(delta_bic=delta_bic), fitted=fitted, converged=converged)


def test_of_fits_that_are_not_told_apart_the_simplest_is_the_verdict() -> None:
    tilt, nap, drag = trial("table_tilt", 405.0, 9), trial("cloth_nap", 402.0, 8), trial("speed_drag", 390.0, 8)
    lost = trial("squirt", 900.0, 7, converged=False)
    assert [t.name for t in _ranked([drag, tilt, nap, lost])] == ["cloth_nap", "table_tilt", "squirt", "speed_drag"]
