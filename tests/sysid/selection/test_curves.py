"""Curves of a formula: over a part of a range, and where the clips say nothing."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sysid.selection.formulas.description import describe
from sysid.selection.formulas.families import curve, shapes_beyond
from sysid.selection.formulas.formula import SparseFormula
from sysid.selection.formulas.free_forms import Span, blocks
from sysid.selection.formulas.terms import Shape, Term, only_at, step, straight
from sysid.selection.formulas.terms_read import term_from_json


def _entry(term: Term) -> dict[str, Any]:
    """A term as an earlier result names it."""
    return {"name": term.name, "door": term.quantity, "factor": term.factor, "value": 0.01}


def _fit_of(shape: Shape, value: float) -> SimpleNamespace:
    """A fit in which all its coefficients have one value."""
    names = tuple(f"unexplained.{one.name}" for one in shape)
    return SimpleNamespace(names=names, constants=np.full(len(shape), value), value=lambda name: (value, 1e-4))


def test_a_curve_bridges_what_the_clips_do_not_tell() -> None:
    shape = tuple(only_at(one, "rail", 2) for one in curve("cushion_e", "along", -0.8, 0.8, 4, at_one=True))
    assert len(shape) == 5  # all cushions together have a constant, one alone has none
    values, names = np.array([0.04, 0.0, 0.02, 0.0, 0.0]), tuple(f"unexplained.{one.name}" for one in shape)
    sds = dict(zip(names, (0.002, math.inf, 0.002, 0.002, 5.0), strict=True))
    fit = SimpleNamespace(
        names=names, constants=values, value=lambda name: (float(values[names.index(name)]), sds[name])
    )
    found = describe(SparseFormula(shape, (1.0,) * 5, values), fit, None)  # type: ignore[arg-type]
    assert [one["value"] for one in found["terms"]] == pytest.approx([0.04, 0.03, 0.02, 0.0, 0.0])
    assert found["curves"][0]["sd"] == [0.002, None, 0.002, 0.002, None]
    assert "+0.04 at -0.8, +0.02 at 0, +0 at 0.4 m" in found["form"]


def test_a_formula_that_leaves_something_is_refined_over_parts_of_its_range() -> None:
    seen = {"x": Span(-1.8, 1.8), "y": Span(-0.9, 0.9)}
    coarse, fine = (blocks(seen, {}, known) for known in ((), [(step("drag", "x", 0.4),)]))
    most = max(one.axes[0].intervals for one in coarse)
    (one,) = [block for block in fine if block.axes[0].intervals > most]
    assert (one.quantity, one.variables) == ("drag", ("x",)) and len(one.correlations()) > len(coarse[0].correlations())
    narrow = [shape for family in one.shapes(seen) for shape in family if shape[0].name.startswith("drag_x_curve_64_")]
    spans = [max(t.constants[1] for t in shape) - min(t.constants[1] for t in shape) for shape in narrow]
    assert len(narrow) == 15 and max(spans) == pytest.approx(3.6 / 8, abs=1e-3)
    assert all(term_from_json(_entry(t))[0].name == t.name for shape in narrow for t in shape)


def test_what_is_proportional_to_one_variable_may_change_with_another() -> None:
    seen = {"x": Span(-1.8, 1.8), "order": Span(0.0, 1.0)}
    both = dict[str, list[Shape]]()
    for known in ((straight("image_x", "x", 0)[0],), curve("image_x", "order", 0.0, 1.0, 8)):
        beside = [block for block in blocks(seen, {}, [known]) if block.known]
        both[known[0].name] = [shape for block in beside for family in block.shapes(seen) for shape in family]
    for known, found in both.items():
        sizes = {len(shape) for shape in found if shape[0].name.startswith("image_x_x_times_order_curve_")}
        assert sizes == ({4, 8, 16} if known == "image_x_x" else {5, 9, 17}), "the line itself is known"
        assert any(shape[0].name == "image_x_x_times_order_fade" for shape in found)
    whole = next(one for one in found if one[0].name == "image_x_x_times_order_curve_8_0")
    assert {t.times for t in whole} == {"x"} and {t.unit for t in whole} == {"m per m"}
    told = describe(SparseFormula(whole, (1.0,) * 9, np.full(9, 0.003)), _fit_of(whole, 0.003), None)  # type: ignore[arg-type]
    assert told["curves"][0]["quantity"] == "shift of the image along x, times x [m per m]"
    assert told["curves"][0]["variable"] == "order" and len(told["curves"][0]["at"]) == 9


def test_what_a_rail_or_a_ball_does_may_depend_on_anything_else() -> None:
    seen = {"approach": Span(0.0, 3.0), "order": Span(0.0, 1.0, (0.3, 0.7)), "along": Span(-1.8, 1.8)}
    alone = {(one.quantity, *one.variables) for one in blocks(seen, {"rail": 4, "number": 2})}
    joint = blocks(seen, {"rail": 4, "number": 2}, joint=True)
    more = {(one.quantity, *one.variables): one for one in joint if (one.quantity, *one.variables) not in alone}
    assert ("cushion_e", "rail", "along") in alone  # a worn part of one cushion is looked for in any case
    every = {(one.quantity, *one.variables): one for one in joint}
    for wanted in (("cushion_e", "rail", "order"), ("cushion_mu", "rail", "approach"), ("drag", "number", "heading")):
        assert (wanted in more) == (wanted[1] == "number")  # each rail is a body of its own, and looked at in any case
        assert every[wanted].effect().name() == "_".join(("free", wanted[0], "by", *wanted[1:]))
    factors = {t.factor for family in every["cushion_e", "rail", "order"].shapes(seen) for s in family for t in s}
    assert "(rail == 0) * (order)" in factors and "(rail == 3) * (order > 0.7)" in factors
    (last,) = more["drag", "number", "heading"].shapes(seen)[-1]
    assert all("heading" in term.factor and term.factor.startswith("(number == 1)") for term in last)


def test_what_depends_on_one_variable_may_do_so_on_one_side_of_another() -> None:
    """Beside a shape of a formula functions of its variable and another one are sought, and no others of two."""
    seen = {"x": Span(-1.8, 1.8), "order": Span(0.0, 1.0, (0.3, 0.7)), "speed": Span(0.0, 3.0)}
    late = (step("drag", "order", 0.6),)
    two = [one for one in blocks(seen, {"number": 2}, [late]) if len(one.variables) > 1]
    found = {one.variables: one for one in two if not one.is_drift}
    assert {one.quantity for one in found.values()} == {"drag"}
    assert set(found) == {("order", "x"), ("order", "speed"), ("number", "order")}
    factors = [t.factor for family in found["order", "x"].shapes(seen) for shape in family for t in shape]
    assert {"(x > -1.62) * (order > 0.6)", "(x < 1.62) * (order > 0.6)", "(order < 0.3) * (x)"} < set(factors)
    sides = [one for one in factors if one.startswith(("(x ", "(order "))]
    assert len(sides) == 38 + 4, "and a line of the other on either side of the places between clips"
    places = {one.variables: one for one in blocks(seen, {}, [tuple(straight("drag", "x", 0))]) if one.known}
    factors = [t.factor for family in places["x", "order"].shapes(seen) for shape in family for t in shape]
    assert factors[:4] == [f"(order {sign} {at}) * (x)" for sign in "><" for at in (0.3, 0.7)], "between clips alone"
    (fast,) = shapes_beyond(late, "speed", 0.0, 3.0, (1.2,))[0][0]
    pairs = {one.variables: one for one in blocks(seen, {}, [(fast,)]) if one.known}
    assert {("order", "x"), ("speed", "x"), ("order", "speed"), ("speed", "order")} == set(pairs)
    assert [shape[0].factor for one in ("order", "speed") for shape in pairs[one, "x"].known] == [
        "order > 0.6",
        "speed > 1.2",
    ]


def test_what_an_effect_does_may_drift() -> None:
    """A quantity in proportion to a variable, times an unknown function of the session without its mean."""
    seen = {
        "time": Span(0.0, 4.0), "order": Span(0.0, 1.0, (0.3, 0.7)), "warmth": Span(-3.0, 5.0, (1.0,)),
        "wz": Span(-50.0, 50.0),
    }  # fmt: skip
    drifts = {(one.quantity, one.variables): one for one in blocks(seen, {}) if one.is_drift}
    assert {variables for quantity, variables in drifts if quantity == "clock"} == {
        ("order", "time"),
        ("warmth", "time"),
    }
    assert {quantity for quantity, _ in drifts} == {
        "drag",
        "grip",
        "spin",
        "push_x",
        "push_y",
        "side",
        "image_x",
        "image_y",
        "clock",
    }
    one = drifts["clock", ("order", "time")]
    assert one.name == "free_clock_by_order_times_time" and one.effect().name() == one.name
    for covariance in one.correlations():
        np.testing.assert_allclose(covariance.sum(axis=0), 0.0, atol=1e-12)
    factors = {shape[0].factor for family in one.shapes(seen) for shape in family}
    assert {"order * time", "(order > 0.3) * time", "(order < 0.7) * time", "exp(-order / 0.3) * time"} <= factors
    assert {"(order > 0.3) * (time > 0.8)", "(order > 0.3) * (time < 3.2)"} <= factors
    assert any("min(max(" in factor and factor.endswith(" * time") for factor in factors)
