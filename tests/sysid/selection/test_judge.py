"""A diagnosis: what windows and whole shots name, and the order of fits."""

from __future__ import annotations

from pathlib import Path

import pytest

from models.model_file import full_model
from sysid.clips import read_clip_set
from sysid.estimation.fitted import FittedModel
from sysid.estimation.from_nothing import WindowFit, fit_from_nothing
from sysid.estimation.split import Split, fit_on, split
from sysid.selection.by_windows import outdoes, score_windows, screen_windows, with_effect
from sysid.selection.formula import SparseFormula, term_candidates
from sysid.selection.free_forms import causes
from sysid.selection.judge import diagnose_fit
from sysid.selection.screening import fit_candidate, ranking
from sysid.selection.terms import library
from tests.truth.__main__ import main as generate

Made = tuple[Split, WindowFit, FittedModel]


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
    found = screen_windows(at, base)
    seen = found.screening
    assert seen.windows == len(at.fitted.states) and seen.best is not None
    assert found.name == seen.best.name == "speed_drag" and found.formula is None
    assert [one.evidence.delta_bic for one in seen.fits] == sorted(
        (one.evidence.delta_bic for one in seen.fits), reverse=True
    )
    after = screen_windows(found.fitted, base)
    assert after.name is None and after.screening.best is None and after.fitted is found.fitted


def test_windows_do_not_need_an_effect_that_does_not_help(drag: Made) -> None:
    _, at, base = drag
    found = screen_windows(at, base)
    rows = found.screening.scores.rows
    row = next(row for row in rows if row.candidate.name == "side_curve")
    assert row.predicted_improvement < 0.1 * rows[0].predicted_improvement
    assert "side_curve" not in [one.name for one in found.screening.fits if one.generalises]
    more = with_effect(at, row)
    assert more.fitted.losses.sum() > found.fitted.fitted.losses.sum()


def test_a_term_that_is_the_law_of_an_effect_does_not_take_its_place(tmp_path: Path) -> None:
    """However many steps each of the two has come: beside the effect such a term explains nothing."""
    words = ("--seed", "9", "--clips", "8", "--kind", "cushion", "--effect", "cushion_restitution_speed=0.09")
    assert generate([str(tmp_path / "set"), *words]) == 0
    clip_set = read_clip_set(tmp_path / "set")
    parts, _, model = split(clip_set, full_model(clip_set.table, clip_set.ball))
    _, at, base = fit_from_nothing(parts, model)
    found = screen_windows(at, base)
    assert found.name == "cushion_restitution_speed"
    term = next(t for t in library(clip_set.table) if t.name == "cushion_e_approach")
    (alone,), (beside,) = (causes(score_windows(fit, term_candidates([term]))) for fit in (at, found.fitted))
    assert alone.log_odds > 10.0 and beside.log_odds < 0.0
    with_term = with_effect(at, SparseFormula((term,), (0.0,), alone.mean).score())
    assert not outdoes([term], with_term, found.fitted)


def test_whole_shots_name_it_as_well(drag: Made) -> None:
    parts, _, base = drag
    base = fit_on(parts, base, base, "whole shots")
    found = diagnose_fit(parts, base)
    assert found.name == "speed_drag" and found.formula is None
    row = next(row for row in found.screening.scores.rows if row.candidate.name == "speed_drag")
    assert diagnose_fit(parts, fit_candidate(parts, base, row).fitted).name is None


def test_of_tied_fits_the_one_with_the_fewest_constants_is_first() -> None:
    fits = {
        "speed_drag": (390.0, 8, True),
        "tilt": (405.0, 9, True),
        "nap": (402.0, 8, True),
        "lost": (900.0, 7, False),
    }
    assert [list(fits)[k] for k in ranking(list(fits.values()))] == ["nap", "tilt", "lost", "speed_drag"]
    assert ranking([]) == []
