"""Departures planted in synthetic residuals are found, named and sized; noise alone names nothing."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from models.shot import RAIL_NAMES, Table
from sysid.residuals.impacts import Impacts, no_impacts
from sysid.residuals.localise import find
from sysid.residuals.samples import Array, Samples
from sysid.residuals.significance import Findings
from sysid.residuals.whiteness import whiteness

TABLE = Table(3.569, 1.778)
NOISE, TURN = 5e-4, 0.02  # [m], [rad]
CLIPS = 24
STEP = 1 / 120


def samples(seed: int, push: Any = None, clips: int = CLIPS, twist: float = 0.0) -> Samples:
    """Two segments a clip that roll straight; `push(xy, v, t, clip)` (n, 2) [m/s^2] is what the model lacks."""
    rng = np.random.default_rng(seed)
    parts: list[dict[str, Any]] = []
    for clip in range(clips):
        for leg in range(2):
            n = int(rng.integers(60, 200))
            t = np.arange(n) * STEP
            heading, speed = rng.uniform(-np.pi, np.pi), rng.uniform(0.5, 2.0) - 0.1 * t
            v = speed[:, None] * [np.cos(heading), np.sin(heading)]
            xy = rng.uniform(-0.5, 0.5, 2) * [TABLE.length, TABLE.width] + np.cumsum(v, axis=0) * STEP
            pushed = np.zeros((n, 2)) if push is None else np.asarray(push(xy, v, t, clip)) * np.ones((n, 2))
            gone = np.cumsum(np.cumsum(pushed, axis=0), axis=0) * STEP**2
            line = rng.normal(0, 1e-3, 2) + t[:, None] * rng.normal(0, 1e-3, 2)
            parts.append({
                "clip": np.full(n, clip), "ball": ("cue",) * n, "struck": np.full(n, leg == 0), "time": t + 2.0 * leg,
                "xy": xy, "residual": line - gone + rng.normal(0, NOISE, (n, 2)), "speed": speed,
                "heading": np.full(n, heading), "spin": np.full(n, rng.uniform(-40, 40)), "motion": ("roll",) * n,
                "last": (("strike", "cushion")[leg],) * n, "events": np.full(n, leg),
                "angle": rng.normal(0, TURN, n), "slip": np.zeros(n), "rail": (("", "+x")[leg],) * n, "since": t,
                "segment": np.full(n, 2 * clip + leg),
            })  # fmt: skip
            sign = np.sign(parts[-1]["spin"])
            parts[-1]["angle"] = parts[-1]["angle"] - sign * twist * t**2 / 2
    whole: dict[str, Any] = {
        key: sum((p[key] for p in parts), ()) if isinstance(parts[0][key], tuple)
        else np.concatenate([p[key] for p in parts])
        for key in parts[0]
    }  # fmt: skip
    return Samples(**whole)


def impacts(seed: int, jump: Any = None, n: int = 60) -> Impacts:
    """Rebounds; `jump(approach, rail)` (n,) is what the model lacks along the normal."""
    rng = np.random.default_rng(seed)
    approach = rng.uniform(0.3, 2.5, n)
    rail = tuple(RAIL_NAMES[k] for k in rng.integers(0, 4, n))
    value = np.zeros(n) if jump is None else np.asarray(jump(approach, np.array(rail)))
    noise: Array = rng.normal(0, 0.004, (n, 2))
    return Impacts(
        np.arange(n) % CLIPS, np.full(n, 1.0), rng.uniform(-0.8, 0.8, (n, 2)), ("cushion",) * n, rail, approach,
        rng.uniform(0, 1.2, n), rng.normal(0, 10, n), noise + np.column_stack([value, 0 * value]), np.full(n, 0.002),
    )  # fmt: skip


def found(s: Samples, i: Impacts | None = None) -> Findings:
    return find(s, s, no_impacts() if i is None else i, TABLE, CLIPS, NOISE, TURN)


@pytest.mark.parametrize("seed", range(12))
def test_noise_alone_names_nothing(seed: int) -> None:
    said = found(samples(seed), impacts(seed))
    assert said.named == ()
    assert said.tests > 100


def test_a_tilt_is_named_with_its_size_and_direction() -> None:
    tilt = np.array([0.0049, -0.0112])
    said = found(samples(1, lambda *_: tilt))
    one, two = said.named[:2]
    assert [(d.group, d.quantity) for d in (one, two)] == [
        ("rolling balls", "acceleration y"), ("rolling balls", "acceleration x"),
    ]  # fmt: skip
    for d, true in ((one, tilt[1]), (two, tilt[0])):
        assert abs(d.value - true) < 4 * d.sd and d.sd < 0.0005
        assert d.z == pytest.approx(d.value / d.sd)
    assert "are pulled by 11." in one.where and "mm/s^2 towards -y" in one.where
    assert len(said.named) == 2
    rows = {d.variable: d for d in said.dependence if d.of == "motion"}
    assert rows["direction on the table"].share > 0.95


def test_a_drag_that_grows_with_speed_depends_on_speed() -> None:
    said = found(samples(2, lambda xy, v, *_: -0.02 * v + 0.02 * v / np.hypot(*v.T)[:, None]))
    one = said.named[0]
    assert (one.variable, one.quantity) == ("speed", "acceleration along per speed")
    assert one.value == pytest.approx(-0.02, abs=4 * one.sd)
    assert "slow down by" in one.where and "more than modelled" in one.where


def test_a_patch_is_found_at_its_place() -> None:
    def patch(xy: Array, v: Array, *_: Any) -> Array:
        inside = (xy[:, 0] > 0) & (xy[:, 0] < 0.59) & (np.abs(xy[:, 1]) < 0.29)
        return np.asarray(-0.4 * inside[:, None] * v / np.hypot(*v.T)[:, None])

    said = found(samples(3, patch))
    assert said.named[0].variable == "place"
    assert "at x 0.00 to 0.59 m, y -0.30 to 0.30 m slow down" in said.named[0].where


def test_one_clip_alone_names_nothing() -> None:
    said = found(samples(4, lambda xy, v, t, clip: 0.5 * (clip == 3)))
    assert said.named == ()


def test_rebounds_that_depend_on_speed_are_named() -> None:
    said = found(samples(5), impacts(5, lambda v, rail: -0.05 * (v - 1.4)))
    one = said.named[0]
    assert (one.of, one.variable) == ("impacts", "speed of approach")
    assert one.value == pytest.approx(-0.05, abs=4 * one.sd) and "for each m/s of approach" in one.where


def test_a_dead_rail_is_named() -> None:
    said = found(samples(6), impacts(6, lambda v, rail: np.where(rail == "-y", -0.06, 0.0)))
    one = said.named[0]
    assert "rail -y" in one.where and "leave slower by" in one.where
    assert one.value == pytest.approx(-0.06, abs=4 * one.sd)


def test_sidespin_that_decays_faster_is_named() -> None:
    said = found(samples(7, twist=-2.0))
    assert said.named[0].of == "turning"
    assert said.named[0].value == pytest.approx(-2.0, abs=4 * said.named[0].sd)
    assert "more than modelled" in said.named[0].where


def test_the_same_samples_give_the_same_findings() -> None:
    assert repr(found(samples(8), impacts(8))) == repr(found(samples(8), impacts(8)))


def test_noise_is_white_and_a_drift_is_not() -> None:
    s = samples(9)
    plain = dataclasses.replace(s, residual=np.random.default_rng(9).normal(0, NOISE, s.residual.shape))
    white = whiteness(plain, NOISE)
    assert white.white and white.in_words().startswith("Residuals are white")
    assert white.ratio == pytest.approx(1.0, abs=0.03) and abs(white.z) < 4
    loud = whiteness(dataclasses.replace(plain, residual=1596 * plain.residual), NOISE)
    assert loud.uncorrelated and not loud.white
    assert "times the noise: too large to be noise, though neighbours correlate by" in loud.in_words()
    odd = whiteness(dataclasses.replace(plain, residual=3 * plain.residual), NOISE)
    assert "or the noise is larger than stated" in odd.in_words()
    drift = whiteness(dataclasses.replace(plain, residual=plain.residual + 2e-3 * np.sin(3 * s.since)[:, None]), NOISE)
    assert not drift.white and "not white" in drift.in_words()


def test_nothing_at_all_is_survived() -> None:
    s = samples(10, clips=1)
    assert found(s).named == ()
    none = Samples(**{k: v[:0] for k, v in vars(s).items()})
    assert found(none).named == ()
    assert "too few samples" in whiteness(none, NOISE).in_words()
