"""Formulas for structure outside the catalogue, and the effect files that they become."""

from __future__ import annotations

import dataclasses
import math
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import models.effect_catalogue
from models.analytic.factors import BEND, HAT, VARIABLE, FactorArguments, TermRow, factor_value
from models.effect_catalogue import add_folder, effect_class
from models.formula import MAX_TERMS, TERM_HOOKS
from models.hooks import address, hooks_of
from models.model_file import full_model
from models.shot import Session, Shot, Track
from models.simulation.observe import observed
from models.simulation.simulate import simulate
from models.variables import SESSION_VARIABLES, VARIABLES
from sysid.report.pictures.figures import curve_charts
from sysid.selection.formulas import terms as terms_room
from sysid.selection.formulas.description import describe, source_from
from sysid.selection.formulas.effect_file import effect_source
from sysid.selection.formulas.factors import SEEN_BY
from sysid.selection.formulas.families import (
    curve,
    shapes,
    shapes_at_one,
    shapes_beyond,
    shapes_times,
)
from sysid.selection.formulas.formula import SparseFormula
from sysid.selection.formulas.terms import Shape, Term, condition, effect_from_terms, library
from sysid.selection.formulas.terms_read import term_from_json
from tests.support.effect_files import file_faults
from tests.support.formula_terms import BALL, COUNTS, TABLE, TERMS, terms_of, told


def shots(order: float = 0.4) -> list[Shot]:
    """A ball that slides, meets two others and a rail; and one that spins by itself."""
    names, place = ("cue", "red", "blue"), np.array([[0.3, 0.0], [0.9, 0.05], [1.2, -0.3]])
    found = []
    for velocity, spin in (((1.5, 0.2), (5.0, -20.0, 15.0)), ((-0.7, 1.1), (0.0, 0.0, -30.0))):
        v, w = np.zeros((3, 2)), np.zeros((3, 3))
        v[0], w[0] = velocity, spin
        found.append(Shot(names, place, v, w, np.linspace(0, 2, 41), session=Session(order, 14.0, 2.5, 80.0, 2.0, 1.0)))
    return found


def track(*names: str, values: tuple[float, ...] = (), order: float = 0.0) -> Track:
    """A ball that rolls along x and comes back from the rail, under some terms."""
    model = full_model(TABLE, BALL)
    if names:
        model = model.add(effect_from_terms("odd_cloth", terms_of(*names), values))
    v, w = np.array([[1.5, 0.2]]), np.array([[-0.2, 1.5, 0.0]]) / BALL.radius
    shot = Shot(("cue",), np.array([[0.3, 0.0]]), v, w, np.linspace(0, 3, 31), session=Session(order))
    return simulate(model, [shot])[0]


def test_names_are_distinct_and_words_complete() -> None:
    every = library(TABLE, COUNTS)
    assert len({t.name for t in every}) == len(every)
    assert all(t.where and t.depends_on and t.unit and t.width > 0 and t.name.isidentifier() for t in TERMS)


@pytest.mark.parametrize("term", TERMS[::24], ids=lambda t: t.name)  # of each quantity one at least
def test_the_file_of_a_term_keeps_the_contract(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, term: Term) -> None:
    monkeypatch.setattr(models.effect_catalogue, "_added", {})
    path = tmp_path / "odd_cloth.py"
    path.write_text(effect_source("odd_cloth", (term,), (term.width / 4,), "Odd.", "a test of terms"))
    shows_elsewhere = "no shot is changed"  # in a cell, at a rail or with a ball not met there
    assert [f for f in file_faults(path) if shows_elsewhere not in f] == []


def test_terms_do_what_they_say() -> None:
    plain = track()
    rail = next(e.time for e in plain.events if e.kind == "cushion")
    before = plain.times < rail
    after = ~before
    dead = track("cushion_e_rail_0", values=(-0.2,))
    assert np.array_equal(dead.position[before], plain.position[before])
    assert np.abs(dead.velocity[after][0, 0, 0]) < np.abs(plain.velocity[after][0, 0, 0]) - 0.1
    assert np.array_equal(track("cushion_e_rail_1", values=(-0.2,)).position, plain.position)
    slower = track("drag_cos2", values=(0.05,))
    lost = plain.velocity[5, 0, 0] - slower.velocity[5, 0, 0]
    heading = np.arctan2(0.2, 1.5)
    assert lost == pytest.approx(0.05 * np.cos(2 * heading) * np.cos(heading) * plain.times[5], rel=2e-3)
    left = track("side_one", values=(0.02,))
    assert left.position[5, 0, 1] > plain.position[5, 0, 1]
    late = track("drag_order", values=(0.05,), order=1.0)
    first = track("drag_order", values=(0.05,), order=0.0)
    np.testing.assert_allclose(first.position[before], plain.position[before], atol=2e-5)
    assert late.velocity[5, 0, 0] < plain.velocity[5, 0, 0] - 0.02
    crown = track("push_x_x", values=(0.1,))
    assert crown.velocity[5, 0, 0] > plain.velocity[5, 0, 0]


def test_a_cell_acts_in_its_place_alone() -> None:
    plain, far = track(), track("drag_at_0_0", values=(0.05,))
    assert np.abs(far.position - plain.position).max() < 1e-4
    near = track("drag_at_3_1", values=(0.05,))
    assert np.abs(near.position - plain.position).max() > 1e-3


@pytest.mark.slow
def test_every_shape_is_read_again_as_it_was_written() -> None:
    """Of every variable that a quantity may depend on; on the cloth both engines know where a step lies."""
    counted = ("rail", 2)
    for quantity, variables in SEEN_BY.items():
        for variable in (v for v in variables if v not in terms_room.COUNTED_VARIABLES):
            low, high = (-0.7, 1.1) if variable in "xy" else (0.0, 3.0)
            families = shapes(quantity, variable, low, high)
            families += shapes_beyond(families[-1][0], "order", 0.0, 1.0) if variable != "order" else []
            families += shapes_at_one(quantity, *counted, variable, 0.0, 3.0) if variable == "along" else []
            plain = variable not in ("heading", "time")
            families += shapes_times(quantity, variable, "time", low, high) if plain else []
            terms = list(dict.fromkeys(term for family in families for shape in family for term in shape))
            assert len({(term.name, term.factor) for term in terms}) == len(terms)
            for term in terms:
                value = term.width / 10
                at_numbers = dataclasses.replace(term, limits=None, only_limits=None, only_moves=False)
                assert term_from_json(told(term, value)) == (at_numbers, value)
            at_lines = [t for t in terms if t.kind != HAT and effect_from_terms("one", (t,), (0.01,)).opens("horizon")]
            on_cloth = quantity in ("drag", "grip", "spin", "push_x", "push_y", "side")
            assert bool(at_lines) == (variable in ("x", "y") and on_cloth)
    half = next(t for family in shapes("grip", "y", -1.0, 1.0) for (t, *_) in family if t.factor == "y > 0")
    assert half.where == "sliding on the cloth, where y > 0 m" and half.place is None


def values_of(shape: Shape, values: dict[str, float]) -> list[float]:
    """Factors of terms for a ball, or an impact."""
    rows = [TermRow(0.0, 0.0, float(t.kind), *t.constants, *[0.0] * 4) for t in shape]
    return [factor_value(row, FactorArguments(values[VARIABLES[int(row.a)]], *[0.0] * 7)) for row in rows]


@pytest.mark.parametrize("intervals", [4, 8, 16])
def test_a_curve_is_straight_between_its_hats_and_level_beyond(intervals: int) -> None:
    push, drag = (curve(quantity, "y", -0.9, 0.9, intervals) for quantity in ("push_x", "drag"))
    assert len(push) == intervals + 1 and len(drag) == intervals and len({t.group for t in push}) == 1
    at = np.array([t.constants[1] for t in push])
    np.testing.assert_allclose(at, np.linspace(-0.9, 0.9, intervals + 1), atol=1e-3)
    heights = np.random.default_rng(4).normal(size=len(at))
    for y in np.linspace(-1.5, 1.5, 41):
        found = np.array(values_of(push, {"y": float(y)}))
        assert found.sum() == pytest.approx(1.0) and heights @ found == pytest.approx(np.interp(y, at, heights))
    assert not any(values_of(drag, {"y": 0.0}))  # the model has a rolling friction already


def test_a_curve_is_told_by_its_values_and_written_whole() -> None:
    shape = curve("drag", "y", -0.9, 0.9, 4)
    found = describe(SparseFormula(shape, (1.0,) * 4, np.array([0.01, 0.02, 0.03, -0.04])), None, None)
    (one,) = found["curves"]
    assert one["at"] == [-0.9, -0.45, 0.0, 0.45, 0.9] and one["value"] == [0.01, 0.02, 0.0, 0.03, -0.04]
    assert one["sd"] == [None, None, 0.0, None, None] and (one["variable"], one["variable_unit"]) == ("y", "m")
    assert "a curve of y: +0.01 at -0.9, +0.02 at -0.45, +0 at 0, +0.03 at 0.45, -0.04 at 0.9 m" in found["form"]
    assert found["size"] == -0.04 and found["depends_on"] == ["place"]
    assert source_from("odd_cloth", found, "a test").count("until_bend(ball, ") == 4
    (drawn,) = curve_charts(found)
    assert list(drawn.data[-1]["x"]) == [0.0] and "deceleration" in drawn.title.lower()
    assert curve_charts(None) == curve_charts({"curves": []}) == []


@pytest.mark.parametrize(
    "names", [("cushion_e_rail_2",), ("drag_cos",), ("drag_at_1_1", "push_y_order"), ("image_x_xy", "ball_mu_order")]
)
def test_the_file_is_clean(tmp_path: Path, names: tuple[str, ...]) -> None:
    """What is written passes a linter, and holds nothing that it does not use."""
    chosen = terms_of(*names)
    path = tmp_path / "odd_cloth.py"
    path.write_text(effect_source("odd_cloth", chosen, [0.01] * len(chosen), "Odd.", "a test"))
    words = [sys.executable, "-m", "ruff", "check", "--isolated", "--select", "F,E9", str(path)]
    said = subprocess.run(words, capture_output=True, text=True)
    assert said.returncode == 0, said.stdout


@pytest.mark.parametrize("quantity", sorted({term.quantity for term in TERMS}))
def test_the_text_of_a_factor_says_what_its_code_does(quantity: str) -> None:
    rng = np.random.default_rng(5)
    for term in [term for term in TERMS if term.quantity == quantity for _ in range(50)]:
        x, y = rng.uniform(-1.8, 1.8), rng.uniform(-0.9, 0.9)
        vx, vy, wz, time, slip = rng.normal(size=5)
        first, second = float(rng.integers(4)), float(rng.integers(4))
        numbers = (*term.constants, *[0.0] * (4 - len(term.constants)))
        approach = rng.uniform(0.0, math.hypot(vx, vy))
        variables = {
            "x": x, "y": y, "wz": wz, "time": time, "first": first, "second": second, "rail": second,
            **dict(zip(SESSION_VARIABLES, rng.uniform(0.0, 3.0, len(SESSION_VARIABLES)), strict=True)),
            "number": first, "slip": slip, "approach": approach,
            "grazing": math.sqrt(1 - (approach / math.hypot(vx, vy)) ** 2),
            "along": y if second < 2 else x, "speed": math.hypot(vx, vy),
            "heading": math.atan2(vy, vx), "abs": abs, "min": min, "max": max, "cos": math.cos,
            "sin": math.sin, "exp": math.exp,
        }  # fmt: skip
        v = variables[VARIABLES[int(numbers[0])]] if VARIABLE <= term.kind <= HAT or term.kind == BEND else 0.0
        row = TermRow(0.0, 0.0, float(term.kind), *numbers, 0.0, 0.0, 0.0, 0.0)
        found = factor_value(row, FactorArguments(v, x, y, vx, vy, wz, first, second))
        found *= 1.0 if term.times is None else variables[term.times]
        if term.only is not None and not eval(condition(term.only), {"__builtins__": {}}, variables):
            found = 0.0
        said = eval(term.factor, {"__builtins__": {}}, variables)  # our own text
        assert found == pytest.approx(float(said), rel=1e-12, abs=1e-12), term.name


WRITTEN = [
    ("drag_at_3_1", "push_x_xy", "side_spin_cos", "cushion_e_rail_0", "grip_cos"),
    ("drag_sin2", "drag_wz", "ball_e_with_2", "ball_mu_order", "image_x_r5"),
    ("drag_at_3_1", "drag_at_4_1", "cushion_mu_slip", "cushion_e_along", "image_y_one"),
    ("cushion_e_grazing", "cushion_mu_grazing", "ball_mu_approach", "ball_e_slip", "push_x_order"),
    ("drag_warmth", "cushion_e_hour", "ball_mu_cloth_age", "image_x_table_2", "grip_player_1"),
    ("cushion_e_wz", "ball_mu_wz", "drag_x_curve_16_5", "drag_speed_curve_16_16", "image_x_order", "image_y_number_1"),
    ("drag_x_down_from", "cushion_e_along_up_from", "cushion_mu_rail_0_along_above", "cushion_mu_rail_1_along_up_from"),
    ("push_x_x_below", "image_y_order_below", "cushion_mu_rail_1_along_below"),
    (
        "drag_x_times_order",
        "cushion_mu_wz_times_hour",
        "ball_e_approach_times_cloth_age",
        "image_x_y_times_order",
        "grip_slip_times_warmth",
    ),
    ("spin_x", "spin_wz_times_order", "clock_time_times_order", "clock_y", "image_x_xy"),
    ("image_x_x_times_order_curve_8_3", "drag_x_times_order_fade", "grip_x_times_order_curve_4_2", "ball_e_order"),
]


@pytest.mark.parametrize("names", WRITTEN)
def test_the_file_does_what_the_formula_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, names: tuple[str, ...]
) -> None:
    monkeypatch.setattr(models.effect_catalogue, "_added", {})
    # A file has places as numbers.
    chosen = [dataclasses.replace(t, limits=None, only_moves=False) for t in terms_of(*names)]
    values = [0.3 * t.width for t in chosen]
    path = tmp_path / "odd_cloth.py"
    path.write_text(effect_source("odd_cloth", chosen, values, "Odd.", "a test"))
    add_folder(path)
    written, formula = effect_class("odd_cloth")(), effect_from_terms("odd_cloth", chosen, values)
    for key, meta in formula.parameters().items():
        theirs = written.parameters()[key]
        assert (meta["unit"], meta["off"]) == (theirs["unit"], theirs["off"])
        assert meta["bounds"] == pytest.approx(theirs["bounds"]) and meta["default"] == pytest.approx(theirs["default"])
    model, plain = full_model(TABLE, BALL), observed(full_model(TABLE, BALL), shots())
    both = (observed(model.add(effect), shots()) for effect in (written, formula))
    for one, two, none in zip(*both, plain, strict=True):
        np.testing.assert_allclose(one.position, two.position, atol=1e-8)
        assert np.abs(one.position - none.position).max() > 1e-4


def test_the_engine_and_mujoco_play_the_same_formula() -> None:
    """Forces that jump at the edges of cells too, along a whole roll of one ball."""
    chosen = terms_of("drag_at_3_1", "drag_at_4_1", "push_y_x", "side_speed", "grip_cos")
    chosen += curve("drag", "x", -1.2, 1.2, 8)
    model = full_model(TABLE, BALL).add(effect_from_terms("odd", chosen, [0.3 * t.width for t in chosen]))
    v, w = np.array([[1.5, 0.2]]), np.array([[-0.2, 1.5, 0.0]]) / BALL.radius
    shot = Shot(("cue",), np.array([[-0.3, 0.0]]), v, w, np.linspace(0, 3, 31))
    one, two = (simulate(dataclasses.replace(model, engine=e), [shot])[0] for e in ("events", "mujoco"))
    np.testing.assert_allclose(one.position, two.position, atol=1e-3)


def test_formulas_share_their_compiled_hooks() -> None:
    hooks_of([effect_from_terms("first", terms_of("drag_at_3_1", "cushion_e_slip", "image_x_x"), [0.01] * 3)], 2)
    before = address.cache_info().currsize
    for k, term in enumerate(TERMS):
        hooks_of([effect_from_terms(f"term{k}", (term,), (term.width / 10,))], 2)
    hooks_of([effect_from_terms("unexplained", TERMS[:MAX_TERMS], [0.01] * MAX_TERMS)], 2)
    assert address.cache_info().currsize == before


def test_a_formula_is_an_effect_like_any_other() -> None:
    chosen = terms_of("drag_at_3_1", "cushion_e_order")
    effect = effect_from_terms("unexplained", chosen, (0.02, 0.05))
    assert effect.name() == "unexplained" and list(effect.parameters()) == ["drag_at_3_1", "cushion_e_order"]
    assert effect.parameters()["drag_at_3_1"]["bounds"] == (-0.1, 0.1)
    assert pickle.loads(pickle.dumps(effect)) == effect and effect == effect_from_terms(
        "unexplained", chosen, (0.02, 0.05)
    )
    assert effect.opens("forces") and effect.opens("horizon") and not effect.opens("observe", "strike", "edit")
    assert not effect_from_terms("smooth", terms_of("drag_cos"), (0.01,)).opens("horizon", "impact")
    model = full_model(TABLE, BALL).add(effect)
    both = model.with_values({"unexplained.drag_at_3_1": np.array([0.0, 0.05])})
    together = simulate(both, shots())
    for k, shot in enumerate(shots()):
        alone = simulate(model.with_values({"unexplained.drag_at_3_1": 0.05 * k}), [shot])
        assert np.array_equal(together[k].position, alone[0].position)
    off = model.with_values({"unexplained.drag_at_3_1": 0.0, "unexplained.cushion_e_order": np.zeros(2)})
    for one, two in zip(simulate(off, shots()), simulate(full_model(TABLE, BALL), shots()), strict=True):
        assert one.position.tobytes() == two.position.tobytes() and one.velocity.tobytes() == two.velocity.tobytes()
    with pytest.raises(ValueError, match=f"{MAX_TERMS + 1} terms"):
        effect_from_terms("more", TERMS[: MAX_TERMS + 1], [0.01] * (MAX_TERMS + 1))
    assert {t.quantity for t in TERMS} == set(TERM_HOOKS)


def test_a_parameter_stands_where_its_row_has_it() -> None:
    """Of a formula with two steps: a fit moves columns of the row."""
    steps = [next(t for every in shapes(q, "x", -1.0, 1.0) for (t, *_) in every if t.limits) for q in ("drag", "grip")]
    (steps[1],) = shapes_beyond(tuple(steps[1:]), "y", -0.5, 0.5)[0][0]
    effect = effect_from_terms("odd_cloth", [t.moved(0.5) for t in steps], (0.05, 0.3))
    beside = ["grip_y_over_x_above", "grip_y_over_x_above_at", "grip_y_over_x_above_from"]
    assert list(effect.parameters()) == ["drag_x_above", "drag_x_above_at", *beside]
    for key in effect.parameters():
        moved = dataclasses.replace(effect, **{key: 0.8 * getattr(effect, key)})
        assert np.flatnonzero(moved.row(1)[0] != effect.row(1)[0]).tolist() == [effect.column(key)]
