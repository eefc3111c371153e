"""A discovery in four sentences: what they say when something, nothing or something without a name is missing."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace
from typing import Any

import pytest

from models.effects.cloth.table_tilt import TableTilt
from models.model_file import Estimate, full_model
from models.shot import Ball, Table
from sysid.clips import CueCommand
from sysid.report.findings import miss_line, round_rows, unexplained_lines
from sysid.report.verdict import verdict_of
from sysid.selection.next_shot import NextShot
from sysid.selection.stability import Stability

NOISE = 0.0005
FORMULA = {
    "where": "rolling on the cloth", "depends_on": ["order of the clips"], "form": "deceleration: +0.05 * (order)",
    "delta_bic": 52671.0, "terms": [{"door": "along"}], "what": "deceleration", "size": 0.05, "unit": "m/s^2",
}  # fmt: skip


def found(*effects: str, held: int = 5, converged: bool = True, **more: Any) -> Any:
    """A discovery, as far as its verdict looks at it."""
    model = full_model(Table(3.569, 1.778), Ball(0.0525, 0.1406)).add(TableTilt(0.0007, -0.0016))
    model = dataclasses.replace(model, estimates={"table_tilt.slope_x": Estimate(1e-5)}, fitted={"converged": True})
    rms = [0.010, 0.0005]
    ladder = [SimpleNamespace(miss=r, held_miss=1.1 * r) for r in rms[: 1 + len(effects)]]
    best = SimpleNamespace(name=effects[0], evidence=SimpleNamespace(delta_bic=5120.0)) if effects else None
    values = {
        "verdict": effects, "unexplained": None, "explained": None, "model": model, "ladder": ladder,
        "last": ladder[-1], "converged": converged, "next_shot": None,
        "rounds": [SimpleNamespace(best=best, margin=1800.0)],
        "shown_once": {},
        "stability": Stability(100, 91, dict.fromkeys(effects, 97)),
        "parts": SimpleNamespace(noise=NOISE, held_out=SimpleNamespace(clips=range(held)) if held else None),
    }  # fmt: skip
    return SimpleNamespace(**(values | more))


def test_an_effect_is_told_with_its_size_its_evidence_and_its_next_shot() -> None:
    shot = NextShot(CueCommand(2.0, 0.5), (-1.0, 0.2), (0.0, 0.3), 9.0, "to separate table_tilt from cloth_nap", 0.01)
    headline, missing, size, certainty, step = verdict_of(found("table_tilt", next_shot=shot)).lines()
    slope = "+x end 2.5 mm low (nap along the table looks alike: check with a level)"
    assert headline == f"A table that is not level (certain): {slope}"
    assert missing == "missing: table_tilt (slope_x 0.000700 ± 0.000010 rad, slope_y -0.0016 ± – rad)"
    assert size.startswith("size: the rms miss falls from 10.0 mm to 0.500 mm (held out 11.0 mm to 0.550 mm);")
    assert size.endswith("noise alone leaves 0.707 mm")
    told = "table_tilt has a delta BIC of 5120, 1800 more than the next, and is found in 97 of 100 draws of the clips"
    assert certainty == f"certainty: {told}"
    balls = "the cue ball at x = -1.000, y = 0.200 m, a red at x = 0.000, y = 0.300 m"
    stroke = "strike the cue ball in the middle, to 2.00 m/s, azimuth 0.500 rad (28.6 degrees)"
    remedy = "raise the +x end by 2.5 mm, then film again; before that, "
    assert step == f"next: {remedy}film this shot (to separate table_tilt from cloth_nap): {balls}; {stroke}"
    assert verdict_of(found("table_tilt")).next_step == "raise the +x end by 2.5 mm, then film again"


def test_a_round_has_columns_of_misses_only_where_shots_were_fitted_whole() -> None:
    def heads(miss: float) -> tuple[str, ...]:
        fitted, evidence = SimpleNamespace(miss=miss, held_miss=miss), SimpleNamespace(delta_bic=9.0)
        fit = SimpleNamespace(name="table_tilt", converged=True, evidence=evidence, fitted=fitted)
        seen: Any = SimpleNamespace(fits=[fit], scores=SimpleNamespace(rows=[]))
        first, row = round_rows(seen)
        assert len(first) == len(row)
        return first

    assert heads(0.001) == ("candidate", "delta BIC", "miss mm", "held out mm", "")
    assert heads(math.nan) == ("candidate", "delta BIC", "")


def test_nothing_missing_is_said_plainly() -> None:
    said = verdict_of(found())
    assert said.headline == "These clips show nothing that the model lacks"
    assert said.missing == "nothing that these clips show; the model suffices"
    assert said.size == "the rms miss is 10.0 mm (held out 11.0 mm); noise alone leaves 0.707 mm"
    assert "nothing is likelier than that the model lacks nothing" in said.certainty
    for effects, size in (
        ((), "the rms miss is 10.0 mm"),
        (("table_tilt",), "the rms miss falls from 10.0 mm to 0.500 mm"),
    ):
        seen = found(*effects, held=0)
        for one in (seen.last, *seen.ladder):
            one.held_miss = math.nan
        assert verdict_of(seen).size == f"{size}; noise alone leaves 0.707 mm", "none is held out"
    one = seen.last
    assert miss_line("base", one) == "base: miss 0.500 mm"
    one.held_miss = 0.001
    assert miss_line("base", one) == "base: miss 0.500 mm, held out 1.000 mm"
    assert said.next_step.startswith("plan shots")


def test_what_one_clip_alone_shows_is_told() -> None:
    said = verdict_of(found(shown_once={"spin_decay_speed": "shot-05.csv"}))
    assert said.missing == "nothing that more than one clip shows; shot-05.csv alone shows spin_decay_speed"
    assert said.next_step == "film more shots like shot-05.csv, to see whether spin_decay_speed is there"
    named = verdict_of(found("table_tilt", shown_once={"spin_decay_speed": "shot-05.csv"}))
    assert named.missing.startswith("table_tilt (") and "shot-05" not in named.next_step


def test_what_has_no_name_has_its_formula_and_how_to_add_it() -> None:
    explained = SimpleNamespace(miss=0.0007, held_miss=0.0008)
    said = verdict_of(found(unexplained=FORMULA, explained=explained))
    assert said.missing == (
        "something outside the catalogue: rolling on the cloth, depending on order of the clips "
        "(deceleration: +0.05 * (order))"
    )
    assert said.headline == "Something that no known effect explains: rolling on the cloth"
    assert "to 0.700 mm" in said.size and "a delta BIC of 52671" in said.certainty
    assert "sysid new-effect NAME --from result.json" in said.next_step
    both = verdict_of(found("table_tilt", unexplained=FORMULA | {"form": None, "depends_on": [], "terms": []}))
    assert both.missing.endswith("rad), and beside it something outside the catalogue: rolling on the cloth")


def test_what_is_outside_the_catalogue_is_a_hint_where_no_clip_tests_it() -> None:
    explained = SimpleNamespace(miss=0.0107, held_miss=math.nan)
    said = verdict_of(found(unexplained=FORMULA, explained=explained, held=0))
    assert said.headline.endswith(
        "rolling on the cloth. This is a hint: no clip is held out to test it, so film more shots"
    )
    assert said.size == "the rms miss rises from 10.0 mm to 10.7 mm; noise alone leaves 0.707 mm"


def test_what_is_left_has_its_size_and_a_picture_is_calibrated_again() -> None:
    """A length on the table in its headline; a formula of the image is the camera's, before it is an effect."""
    left = {"where": "not located", "what": "error beyond the noise, rms", "size": 1.49e-4, "unit": "m", "form": None}
    said = verdict_of(found(unexplained=FORMULA | left | {"terms": []}))
    assert said.headline == "Something that no known effect explains: not located, 0.149 mm rms"
    image = {"where": "in the camera's image", "size": -4.7e-4, "unit": "m per m", "terms": [{"door": "image_x"}]}
    said = verdict_of(found("table_tilt", unexplained=FORMULA | image))
    assert said.headline.endswith("no known effect explains: in the camera's image, 0.47 mm per m")
    assert said.next_step.startswith("calibrate the camera again, as what is left is in its picture") and (
        "or add what is outside the catalogue as an effect: sysid new-effect" in said.next_step
    )


@pytest.mark.parametrize(
    ("held", "converged", "doubt"),
    [(0, True, "no clip is held out"), (2, True, "few clips are held out"), (5, False, "did NOT converge")],
)
def test_doubts_are_told(held: int, converged: bool, doubt: str) -> None:
    assert doubt in verdict_of(found("table_tilt", held=held, converged=converged)).certainty
    assert doubt not in verdict_of(found("table_tilt")).certainty


def test_what_returns_in_few_draws_is_likely_and_without_convergence_a_hint() -> None:
    seldom = verdict_of(found("table_tilt", stability=Stability(100, 40, {"table_tilt": 60}), converged=False))
    assert seldom.headline.startswith("A table that is not level (likely)")
    assert seldom.headline.endswith("this is a hint")


def test_what_is_left_without_a_formula_is_said_to_have_none_that_holds() -> None:
    left: dict[str, Any] = {
        "where": "not located", "depends_on": [], "what": "error, rms", "size": 3e-4, "unit": "m", "form": None,
        "terms": [],
    }  # fmt: skip
    assert unexplained_lines(left)[-1] == "what is left has no formula that holds on clips held out"
    swings = unexplained_lines(left | {"form": "x + a sine"})
    assert swings[-1] == "as a formula: x + a sine"
    alike = unexplained_lines(left | {"form": "x", "alike": ["deceleration by speed", "sliding friction by time"]})
    assert alike[-1] == "these clips hardly distinguish it from: deceleration by speed; sliding friction by time"
    offered = unexplained_lines(left | {"form": "+0.05 * (order)", "terms": [{}]})
    assert offered[-1].startswith("to add it: sysid new-effect")
