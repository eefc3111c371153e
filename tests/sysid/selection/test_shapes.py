"""Shapes at one rail, bends, and the places where steps over the clips may lie."""

from __future__ import annotations

import numpy as np
import pytest

from models.errors import BadInput
from models.shot import Session
from sysid.clips import Clip, Observation
from sysid.selection.formulas.description import describe
from sysid.selection.formulas.families import counted_shapes, curve, shapes
from sysid.selection.formulas.formula import SparseFormula
from sysid.selection.formulas.free_forms import ranges
from sysid.selection.formulas.shapes import without_terms
from sysid.selection.formulas.terms import bend, only_at, only_beyond, step, straight
from sysid.selection.formulas.terms_read import term_from_json

DEEP = 3000  # conditions within conditions, more than Python has calls


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("cushion_e_rail_7_along_above", "(rail == 7) * (along > 0.3)"),
        ("cushion_e_number_100_speed", "(number == 100) * (approach)"),
        ("cushion_e_rail_1_rail_2_along", "(rail == 1) * ((rail == 2) * (along))"),
        ("cushion_e_rail_1_along", "(rail == 1) * (" * DEEP + "along" + ")" * DEEP),
        ("cushion_e_rail_1_along", "(rail == 1) * (open)"),
    ],
)
def test_a_condition_that_no_table_has_is_refused_in_a_line(name: str, factor: str) -> None:
    entry = {"name": name, "door": "cushion_e", "factor": factor, "value": 0.01}
    with pytest.raises(BadInput, match=r"no term .* is known; name a result\.json"):
        term_from_json(entry)


def test_a_curve_along_one_cushion_says_along_which() -> None:
    terms = tuple(only_at(term, "rail", 2) for term in curve("cushion_mu", "along", -1.7, 1.7, 4))
    told = describe(SparseFormula(terms, (1.0,) * len(terms), np.full(len(terms), 0.1)), None, None)
    assert told["form"].startswith("change of the cushion's friction where rail == 2, a curve of along: ")
    assert told["where"] == "the cushion at +y: its friction"
    (only,) = told["curves"]
    assert only["quantity"] == "change of the cushion's friction where rail == 2"
    push = curve("push_x", "y", -0.8, 0.8, 4)
    told = describe(SparseFormula(push, (1.0,) * 5, np.full(5, 0.01), (("by ball", "by speed"),) * 5), None, None)
    (plain,) = told["curves"]
    assert told["alike"] == ["by ball", "by speed"], "once for a curve, not once for each of its terms"
    assert plain["quantity"] == "push along x [m/s^2], 5/7 of it on rolling balls"


def test_bends_and_steps_say_where_they_are() -> None:
    assert bend("drag", "x", 0.6, 1.0).where == "rolling on the cloth, where x > 0.6 m"
    assert bend("drag", "x", 0.6, -1.0).where == "rolling on the cloth, where x < 0.6 m"
    assert bend("ball_e", "approach", 1.1, 1.0).where == "collisions of balls, speed above 1.1 m/s"
    assert step("drag", "x", 0.6).where == bend("drag", "x", 0.6, 1.0).where


def test_short_and_long_cushions_are_named() -> None:
    ((long,),) = counted_shapes("cushion_e", "rail", 4)[1]
    assert (long.factor, long.where) == ("rail > 1.5", "the long cushions")
    short = only_beyond(straight("cushion_mu", "warmth", 0)[0], "rail", 1.5, -1.0)
    assert (short.factor, short.where) == ("(rail < 1.5) * (warmth)", "the short cushions")
    assert not short.places and not short.is_on_one_side


def clip_of(**session: float) -> Clip:
    time = np.linspace(0.0, 1.0, 11)
    return Clip(
        "a.csv",
        "cue",
        {"cue": Observation(time, np.column_stack([time, time]), np.full(11, np.nan))},
        session=Session(**session),
    )


@pytest.mark.parametrize(
    ("warmth", "places"),
    [
        ((0.0, 1.0, 2.0, 3.0, 4.0), (1.5, 2.5)),
        ((0.0, 0.0, 2.0, 2.0), (1.0,)),
        ((0.0, 1.0, 1.0, 1.0), ()),
    ],
)
def test_a_step_over_clips_leaves_two_on_either_side(warmth: tuple[float, ...], places: tuple[float, ...]) -> None:
    seen = ranges([clip_of(warmth=one) for one in warmth], 2.0, 1.0, 0.03)["warmth"]
    assert (seen.low, seen.high, seen.places) == (0.0, max(warmth), places)


def test_a_band_of_clips_holds_two_at_least_and_shapes_of_a_formula_are_not_again() -> None:
    places = (0.125, 0.375, 0.625, 0.875)  # between five clips
    bands = [
        tuple(term.constants[1] for term in shape)
        for family in shapes("drag", "order", 0.0, 1.0, places) for shape in family
        if len(shape) == 2 and shape[1].name.endswith("beyond")
    ]  # fmt: skip
    assert bands == [(0.125, 0.625), (0.125, 0.875), (0.375, 0.875)]
    few = [family for family in shapes("drag", "order", 0.0, 1.0, ()) if family]
    assert not any(term.limits for family in few for (term, *_) in family if not term.name.endswith("fade"))
    assert any(len(shape) == 2 for family in shapes("drag", "x", 0.0, 1.0) for shape in family)
    have = {term.name for term in straight("grip", "heading", 0)}
    assert all(not without_terms(family, have) for family in shapes("grip", "heading", 0.0, 1.0))
