"""What is lacking over cloth, at rails and over a variable: recovered from residuals of a known cause, or nothing."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from sysid.residuals.comparison import Comparison
from sysid.residuals.functions.lacking import Lacking, lacking
from sysid.residuals.functions.smooth import Columns, Residuals, posterior
from sysid.residuals.impacts import Impacts
from tests.support.comparison_samples import rolled

Array = np.ndarray
PUSH = np.array([0.005, -0.011])  # [m/s^2]


def found(one: Comparison) -> Lacking:
    return lacking(one, one)


def test_a_tilt_is_a_push_alike_all_over_the_cloth() -> None:
    seen = found(rolled(lambda xy, way, speed: np.tile(PUSH, (len(xy), 1))))
    assert seen.cloth is not None and seen.cloth.evidence > 10
    field = seen.cloth.found
    off = (field.push - PUSH) / field.push_sd[..., None]
    assert np.abs(off).max() < 5 and np.ptp(field.push, axis=(0, 1)).max() < 0.2 * np.hypot(*PUSH)
    assert np.hypot(*np.moveaxis(field.push, -1, 0)).min() > 2.45 * field.push_sd.max(), "known everywhere"
    assert not (np.abs(field.change) > 1.96 * field.change_sd).any()
    assert not [one for one in seen.curves if one.found.of == "motion"]


def test_a_worn_patch_slows_where_it_is_and_pushes_nowhere() -> None:
    centre, radius, more = np.array([0.6, 0.2]), 0.35, 0.1

    def worn(xy: Array, way: Array, speed: Array) -> Array:
        inside = np.hypot(*(xy - centre).T) < radius
        return np.where(inside[:, None], -more * way, 0.0)

    seen = found(rolled(worn, balls=120))
    assert seen.cloth is not None and seen.cloth.evidence > 10
    field = seen.cloth.found
    slowest = np.unravel_index(np.argmin(field.change), field.change.shape)
    assert np.hypot(field.x[slowest[0]] - centre[0], field.y[slowest[1]] - centre[1]) < radius
    assert field.change.min() == pytest.approx(-more, rel=0.4)
    away = np.hypot(field.x[:, None] - centre[0], field.y[None, :] - centre[1]) > 2 * radius
    assert np.abs(field.change[away]).mean() < 0.2 * more
    assert np.abs(field.push).mean() < 0.1 * more


def test_drag_is_a_curve_over_speed_and_leaves_the_cloth_plain() -> None:
    seen = found(rolled(lambda xy, way, speed: -0.04 * (speed - 0.6)[:, None] * way))
    curve = next(one.found for one in seen.curves if one.found.of == "motion")
    assert (curve.name, curve.variable) == ("rolling balls", "speed")
    middle = slice(8, -8)
    slope = np.polyfit(curve.at[middle], curve.value[middle], 1)[0]
    assert slope == pytest.approx(-0.04, rel=0.2)
    where, value, sd = curve.data.T
    assert (np.abs(value - np.interp(where, curve.at, curve.value)) < 5 * sd + 1e-4).all()
    assert seen.cloth is not None and seen.cloth.evidence < 0, "what is left beside the curve"
    assert not (np.hypot(*np.moveaxis(seen.cloth.found.push, -1, 0)) > 2.45 * seen.cloth.found.push_sd).any()


def test_where_nothing_is_lacking_nothing_is_likely() -> None:
    seen = found(rolled(lambda xy, way, speed: np.zeros_like(xy)))
    assert seen.cloth is not None and seen.cloth.evidence < 0 and not seen.curves
    assert seen.rails is None, "no rail was hit"


def test_friction_that_is_wrong_everywhere_is_no_pattern() -> None:
    seen = found(rolled(lambda xy, way, speed: -0.02 * way))
    assert seen.cloth is not None and seen.cloth.evidence < 0 and not seen.curves
    value, sd = seen.cloth.found.everywhere
    assert value == pytest.approx(-0.02, abs=5 * sd)


def impacts(jump: Callable[[Array, Array], Array], count: int = 120) -> Impacts:
    """Rebounds, and what their speeds along the normal lack by rail (n,) and approach (n,)."""
    rng = np.random.default_rng(8)
    rail = np.array(["+x", "-x", "+y", "-y"])[np.arange(count) % 4]
    approach, sd = rng.uniform(0.3, 2.5, count), np.full(count, 0.004)
    lacks = np.column_stack([jump(rail, approach), np.zeros(count)]) + rng.normal(0, 0.005, (count, 2))
    zero = np.zeros(count)
    return Impacts(
        np.arange(count), zero, np.zeros((count, 2)), ("cushion",) * count, tuple(rail.tolist()), approach,
        rng.uniform(0.1, 1.2, count), zero, lacks, sd,
    )  # fmt: skip


def at_rails(jump: Callable[[Array, Array], Array], count: int = 120) -> Lacking:
    rolling = rolled(lambda xy, way, speed: np.zeros_like(xy), balls=6)
    one = dataclasses.replace(rolling, impacts=impacts(jump, count))
    return lacking(one, one)


def test_a_few_impacts_at_each_speed_are_points_beside_the_curve() -> None:
    seen = at_rails(lambda rail, approach: -0.05 * (approach - 1.0), count=24)
    curve = next(one.found for one in seen.curves if one.found.of == "impacts")
    where, value, sd = curve.data.T
    assert len(where) >= 3 and np.ptp(where) > 1.0, "four impacts are a group, as elsewhere"
    assert (np.abs(value + 0.05 * (where - 1.0)) < 5 * sd).all()


def test_a_lively_rail_is_that_rail() -> None:
    seen = at_rails(lambda rail, approach: np.where(rail == "-y", 0.08, 0.0))
    assert seen.rails is not None and seen.rails.evidence > 10
    value = dict(zip(seen.rails.found.names, seen.rails.found.value, strict=True))
    assert value.pop("-y") == pytest.approx(0.08, abs=0.01)
    assert all(abs(one) < 0.01 for one in value.values())
    assert not [one for one in seen.curves if one.found.of == "impacts"]


def test_cushions_that_return_less_when_hit_harder_are_a_curve() -> None:
    seen = at_rails(lambda rail, approach: -0.05 * (approach - 1.0))
    curve = next(one.found for one in seen.curves if one.found.of == "impacts")
    assert (curve.variable, curve.quantity) == ("speed of approach", "velocity along the normal")
    assert np.interp([0.6, 2.0], curve.at, curve.value) == pytest.approx([0.02, -0.05], abs=0.008)
    assert seen.rails is not None and (np.abs(seen.rails.found.value) < 0.01).all(), "what is left beside the curve"


def test_a_second_model_is_shown_over_the_same_variable() -> None:
    before = rolled(lambda xy, way, speed: -0.04 * (speed - 0.6)[:, None] * way)
    after = rolled(lambda xy, way, speed: np.zeros_like(xy))
    first = lacking(before, after)
    second = lacking(after, after, first)
    assert [one.found.key for one in second.curves] == [one.found.key for one in first.curves]
    curve = second.curves[0].found
    assert (np.abs(curve.value) < 5 * curve.sd + 1e-3).all()


def test_the_posterior_is_that_of_the_plain_equations() -> None:
    rng = np.random.default_rng(5)
    rows, groups = 80, 16
    design, own = rng.normal(size=(rows, 4)), rng.normal(size=rows)
    group = np.repeat(np.arange(groups), rows // groups)
    truth = np.array([2.0, -1.0, 0.5, 0.0])
    y = design @ truth + (0.7 * rng.normal(size=groups))[group] * own + rng.normal(size=rows)
    columns = Columns(design, np.zeros(4, dtype=np.int64), np.zeros(4))
    seen = posterior(Residuals(y, own, group, rows), columns)
    shared = (group[:, None] == group) * np.outer(own, own)
    noise = seen.noise**2 * (np.eye(rows) + seen.group_variance * shared)
    inverse = np.linalg.inv(noise)
    prior = np.linalg.inv(seen.covariance) - design.T @ inverse @ design
    assert prior == pytest.approx(np.diag(np.diag(prior)), abs=1e-6 * np.abs(prior).max())
    assert seen.mean == pytest.approx(seen.covariance @ (design.T @ inverse @ y), rel=1e-6)
    assert np.abs(seen.mean - truth).max() < 4 * np.sqrt(np.diag(seen.covariance)).max()
    assert seen.evidence > 10
