"""A search for causes: what windows and whole shots name, what they do not, and what goes."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from models.effects.cloth.worn_patch import WornPatch
from models.model_file import full_model
from models.shot import Ball, Table
from sysid.clips import read_clip_set
from sysid.estimation.fitted import FittedModel
from sysid.estimation.from_nothing import WindowFit, fit_from_nothing
from sysid.estimation.problem import Array
from sysid.estimation.split import Split, fit_on, split
from sysid.selection.fits.by_whole_shots import ByWholeShots
from sysid.selection.fits.by_windows import ByWindows
from sysid.selection.fits.view import ShotLosses
from sysid.selection.formulas.causes import causes
from sysid.selection.formulas.formula import SparseFormula
from sysid.selection.formulas.shapes import shape_candidates
from sysid.selection.formulas.terms import library
from sysid.selection.judgement import Threshold, Unknown, judged, over_one_shot, over_scatter, unknowns_of
from sysid.selection.names import Found, with_likelier_name
from sysid.selection.rivals import likeliest_first
from sysid.selection.scoring.signatures import candidate
from sysid.selection.screening import candidates_for
from sysid.selection.search import next_cause, search, without_needless
from sysid.selection.shaping import is_at_bound, outdoes
from tests.truth.__main__ import main as generate

Made = tuple[Split, WindowFit, FittedModel]


LARGEST_PATCH_M = WornPatch.parameters()["radius"]["bounds"][1]


@pytest.fixture(scope="module")
def drag(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Clips with a speed drag, which an air drag explains in part, fitted without it."""
    folder = tmp_path_factory.mktemp("judge") / "drag"
    words = ("--seed", "8", "--clips", "5", "--seconds", "1.5", "--kind", "roll,stun", "--effect", "speed_drag=0.06")
    assert generate([str(folder), *words]) == 0
    clip_set = read_clip_set(folder)
    parts, _, model = split(clip_set, full_model(clip_set.table, clip_set.ball))
    return fit_from_nothing(parts, model)


def test_windows_name_the_hidden_effect_and_not_what_resembles_it(drag: Made) -> None:
    _, at, base = drag
    windows = ByWindows(at, base)
    found = next_cause(windows)
    seen = found.screening
    assert seen.windows == len(at.fitted.states) and seen.best is not None and seen.base is base
    assert found.name == seen.best.name == "speed_drag" and found.formula is None
    after = next_cause(found.view)
    assert after.name is None and after.screening.best is None and after.view is found.view


def test_windows_do_not_need_an_effect_that_does_not_help(drag: Made) -> None:
    _, at, base = drag
    found = next_cause(ByWindows(at, base))
    row = next(row for row in found.screening.scores.rows if row.candidate.name == "side_curve")
    more = found.view.with_effect(row)
    seen = judged(found.view, more, unknowns_of(row.candidate, more.names))
    threshold = Threshold(290, 0.05)
    assert seen.log_odds < 1.0 < threshold.least, "no more than chance gives"
    assert more.without("side_curve") is more.without("side_curve"), "fitted once"
    kept = without_needless(more, ("speed_drag", "side_curve"), None, threshold)
    assert kept[1:] == (("speed_drag",), None)
    assert not any(name.startswith("side_curve") for name in kept[0].names)


def test_rivals_are_compared_with_each_other_whatever_each_was_judged_against(drag: Made) -> None:
    """A cause with better states has a better fit without it, which begins from them, and so seems to gain less."""
    _, at, base = drag
    windows = ByWindows(at, base)
    rows = {row.candidate.name: row for row in windows.scores(candidates_for(windows.model)).rows}
    right, similar = (
        judged(windows, more, unknowns_of(rows[name].candidate, more.names))
        for name in ("speed_drag", "air_drag")
        for more in (windows.with_effect(rows[name]),)
    )
    similar = dataclasses.replace(similar, log_odds=right.log_odds + 500.0)
    (first, best, _), (second, _, less) = likeliest_first([right, similar], [1, 1])
    assert (first, second) == (0, 1) and less < best.log_odds
    (first, *_), _ = likeliest_first([right, right], [2, 1])
    assert first == 1, "of causes that are alike the one with fewer variables"
    held = dataclasses.replace(right, held=-1000.0)
    (first, *_), _ = likeliest_first([held, right], [1, 2])
    assert first == 1, "held-out shots count"


def test_a_shape_that_is_the_law_of_an_effect_gets_its_name(drag: Made) -> None:
    _, at, base = drag
    term = next(t for t in library(base.model.table) if t.name == "drag_speed")
    windows = ByWindows(at, base)
    (alone,) = causes(windows.scores(shape_candidates([(term,)])))
    formula = SparseFormula((term,), (0.0,), alone.mean, ((),))
    instead = with_likelier_name(Found(windows.with_effect(formula.score()), (), formula))
    assert instead is not None
    found, fit = instead
    assert found.verdict == ("speed_drag",) and found.formula is None and fit.name == "speed_drag"
    assert fit.evidence.log_odds > 10.0 and with_likelier_name(found) is None


def test_a_likelier_effect_takes_the_place_of_one_that_resembles_it(drag: Made) -> None:
    _, at, base = drag
    windows = ByWindows(at, base)
    row = next(row for row in next_cause(windows).screening.scores.rows if row.candidate.name == "air_drag")
    instead = with_likelier_name(Found(windows.with_effect(row), ("air_drag",)))
    assert instead is not None
    assert instead[0].verdict == ("speed_drag",) and instead[0].dropped == ("air_drag",)


@pytest.mark.slow
def test_a_term_that_is_the_law_of_an_effect_does_not_take_its_place(tmp_path: Path) -> None:
    """However many steps each of the two has come: beside the effect such a term explains nothing."""
    words = ("--seed", "9", "--clips", "8", "--kind", "cushion", "--effect", "cushion_restitution_speed=0.09")
    assert generate([str(tmp_path / "set"), *words]) == 0
    clip_set = read_clip_set(tmp_path / "set")
    parts, _, model = split(clip_set, full_model(clip_set.table, clip_set.ball))
    _, at, base = fit_from_nothing(parts, model)
    windows = ByWindows(at, base)
    found = next_cause(windows)
    best = found.screening.best
    assert best is not None and best.name == "cushion_restitution_speed"
    term = next(t for t in library(clip_set.table) if t.name == "cushion_e_approach")
    (alone,), (beside,) = (causes(view.scores(shape_candidates([(term,)]))) for view in (windows, found.view))
    assert alone.log_odds > 5.0 and beside.log_odds < 0.0
    with_term = windows.with_effect(SparseFormula((term,), (0.0,), alone.mean).score())
    named = judged(windows, found.view, unknowns_of(best.score.candidate, found.view.names))
    assert not outdoes(with_term, (term,), named)
    formula = SparseFormula((term,), (0.0,), np.array([1e-3]), ((),))
    both = found.view.with_effect(formula.score())
    assert without_needless(both, (best.name,), formula, Threshold(290, 0.05))[1:] == ((best.name,), None)


@pytest.mark.slow
def test_whole_shots_name_it_as_well(drag: Made) -> None:
    parts, _, base = drag
    view = ByWholeShots(parts, fit_on(parts, base, base, "whole shots"))
    *_, (found, last) = search(Found(view))
    assert found.verdict == ("speed_drag",) and found.formula is None and last.best is None


def test_a_cause_is_shared_only_where_shots_agree_on_its_size() -> None:
    """Twenty shots do so, one cannot, and shots that differ by more than their errors speak for values of their own."""
    rng = np.random.default_rng(6)
    unknown = [Unknown("it", 0.0, 1.0, True)]

    def odds(values: Array, sd: float) -> float:
        information = np.full((len(values), 1, 1), sd**-2)
        mean = values.mean()
        return over_scatter(np.array([mean]), unknown, information, ((mean - values) / sd**2)[:, None])

    assert odds(1.0 + 0.1 * rng.normal(size=20), 0.1) > 20.0
    assert odds(np.array([1.0]), 0.1) == pytest.approx(0.0, abs=1e-9)
    assert odds(1.0 + rng.normal(size=20), 0.1) < -20.0


def test_a_cause_does_not_rest_on_one_shot() -> None:
    """Fifteen shots measure a constant and a cause; if one of them errs in the constant, a cause seems to be there."""
    rng = np.random.default_rng(7)
    jacobian = np.stack([np.ones((15, 40)), rng.normal(0.5, 0.5, (15, 1)) + 0.1 * rng.normal(size=(15, 40))], axis=2)

    def fit(measured: Array, known: int) -> ShotLosses:
        rows = jacobian[:, :, :known]
        information = np.einsum("nru,nrv->nuv", rows, rows)
        at = np.linalg.solve(information.sum(axis=0), np.einsum("nru,nr->u", rows, measured))
        left = rows @ at - measured
        return ShotLosses(0.5 * (left**2).sum(axis=1), information, np.einsum("nru,nr->nu", rows, left))

    def odds(measured: Array) -> tuple[float, float]:
        less, more = fit(measured, 1), fit(measured, 2)
        return float((less.losses - more.losses).sum()), float(over_one_shot(less, more, 1.0, np.full(15, -2.0)).min())

    noise = rng.normal(size=(15, 40))
    everywhere, one = odds(noise + jacobian[:, :, 1])
    assert everywhere > 10.0 and one > 10.0
    far = int(np.argmax(np.abs(jacobian[:, :, 1].mean(axis=1) - 0.5)))
    everywhere, one = odds(noise + np.where(np.arange(15) == far, 3.0, 0.0)[:, None])
    assert everywhere > 10.0 and one < 3.0


@pytest.mark.parametrize(("values", "there"), [
    ({"radius": 0.4}, False), ({"radius": LARGEST_PATCH_M}, True), ({"slide": 0.0}, False),
])  # fmt: skip
def test_an_effect_that_ends_at_a_bound_is_known_by_it(values: dict[str, float], there: bool) -> None:
    """A patch as large as one may be stands for half of the table; one that does nothing stands where it vanishes."""
    patch = WornPatch(**{"roll": 0.3, "slide": 0.2, "radius": 0.4} | values)
    model = full_model(Table(3.569, 1.778), Ball(0.0525, 0.1406)).add(patch)
    names = tuple(f"worn_patch.{key}" for key in WornPatch.parameters())
    view: Any = SimpleNamespace(
        names=names, model=model, point=SimpleNamespace(constants=np.array([model.parameters()[n] for n in names]))
    )
    assert is_at_bound(view, [Unknown(name, 0.0, 1.0, True) for name in names]) is there


def test_what_a_parameter_may_be_is_known_beforehand() -> None:
    one = candidate(WornPatch)
    unknowns = {
        u.name.split(".")[1]: u for u in unknowns_of(one, [f"worn_patch.{key}" for key in one.effect.parameters()])
    }
    assert unknowns["roll"].sized and unknowns["roll"].middle == 0.0
    assert not unknowns["x"].sized and unknowns["x"].sd > 0.1
