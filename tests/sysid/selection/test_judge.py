"""A diagnosis: whether whole shots confirm what segments named, and the order of fits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from models.model_file import effect_class, full_model
from sysid.clips import read_clip_set
from sysid.estimation import FittedModel, begin
from sysid.estimation.split import Split
from sysid.selection.judge import diagnose_fit
from sysid.selection.runs import Confirmation, confirm
from sysid.selection.score import candidate, score_all
from sysid.selection.screening import FittedCandidate, PartialScreening, fit_candidate, ranking
from tests.truth.__main__ import main as generate

CANDIDATES = ("speed_drag", "air_drag", "side_curve")
Fits = dict[str, FittedCandidate]
Made = tuple[Split, FittedModel, PartialScreening, Fits]


def fitted(folder: Path, *words: str) -> Made:
    """A small generated set, its fit, and every candidate scored and fitted."""
    assert (
        generate([str(folder), "--seed", "8", "--clips", "5", "--seconds", "1.5", "--kind", "roll,stun", *words]) == 0
    )
    clip_set = read_clip_set(folder)
    parts, base = begin(clip_set, full_model(clip_set.table, clip_set.ball))
    scores = score_all(base, [candidate(effect_class(name)) for name in CANDIDATES])
    fits = [fit_candidate(parts, base, row) for row in scores.rows]
    return parts, base, PartialScreening(scores), {one.name: one for one in fits}


@pytest.fixture(scope="module")
def drag(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Clips with a speed drag, which an air drag explains in part."""
    return fitted(tmp_path_factory.mktemp("judge") / "drag", "--effect", "speed_drag=0.06")


def confirmed(made: Made, by_segments: str, by_whole_shots: str) -> Confirmation:
    """Whether whole shots confirm one effect where their own screening has fitted another."""
    parts, base, partial, fits = made
    return confirm(parts, base, fits[by_segments], replace(partial, fitted=(fits[by_whole_shots],)))


def test_whole_shots_confirm_the_effect_that_they_predict_as_well(drag: Made) -> None:
    found = confirmed(drag, "speed_drag", "speed_drag")
    assert found.partial is None
    assert found.fitted is not None and "speed_drag.rate" in found.fitted.names


def test_whole_shots_confirm_an_effect_that_explains_more_than_their_candidate(drag: Made) -> None:
    found = confirmed(drag, "speed_drag", "air_drag")
    assert found.fitted is not None and "speed_drag.rate" in found.fitted.names


def test_a_candidate_that_explains_more_overrules_and_both_fits_are_kept(drag: Made) -> None:
    found = confirmed(drag, "air_drag", "speed_drag")
    assert found.fitted is None and found.partial is not None
    assert [one.name for one in found.partial.fitted] == ["speed_drag", "air_drag"]
    assert found.partial.fitted[0] is drag[3]["speed_drag"]


def test_an_effect_at_impacts_alone_does_not_overrule_one_between_them(drag: Made) -> None:
    """However much it explains: segments do not show it, so both may be missing."""
    parts, base, partial, fits = drag
    better = fits["speed_drag"]
    at_impacts = replace(better.score, candidate=candidate(effect_class("cushion_restitution_speed")))
    known = replace(partial, fitted=(replace(better, score=at_impacts),))
    found = confirm(parts, base, fits["air_drag"], known)
    assert found.fitted is not None and "air_drag.rate" in found.fitted.names


def test_an_effect_that_does_not_help_whole_shots_is_not_confirmed(drag: Made) -> None:
    found = confirmed(drag, "side_curve", "speed_drag")
    assert found.fitted is None and found.partial is not None
    assert found.partial.fitted[0].name == "speed_drag"


def test_the_hidden_effect_is_the_diagnosis(drag: Made) -> None:
    parts, base, _, fits = drag
    found = diagnose_fit(parts, base)
    assert found.name == "speed_drag" and found.formula is None
    assert found.rounds[-1] is found.screening
    assert diagnose_fit(parts, fits["speed_drag"].fitted).name is None


def test_of_tied_fits_the_one_with_the_fewest_constants_is_first() -> None:
    fits = {
        "speed_drag": (390.0, 8, True),
        "tilt": (405.0, 9, True),
        "nap": (402.0, 8, True),
        "lost": (900.0, 7, False),
    }
    assert [list(fits)[k] for k in ranking(list(fits.values()))] == ["nap", "tilt", "lost", "speed_drag"]
    assert ranking([]) == []
