"""The laws see what breaks them: samples of sound shots, with a fault put in."""

from __future__ import annotations

import dataclasses

import numpy as np

from models.engine.rubber import MAX_RAIL_DEPTH
from models.shot import Array
from tests.random_shots.draws import Batch, batch, picked
from tests.random_shots.laws import ENERGY_WINDOW, Played, breaches, play, pushes

STILL_M_S = 0.02  # by which balls are made faster


def sound(seed: int, effect: str = "") -> tuple[Batch, Played]:
    """The first shot of a batch, which has an effect where one is named, and breaks no law."""
    one = picked(batch(seed, 64, others=0.0), np.array([0]))
    assert not effect or effect in [e.name() for e in one.model.effects]
    played = play(one)
    assert breaches(one, played) == []
    return one, played


def with_samples(played: Played, samples: Array) -> Played:
    return dataclasses.replace(played, samples=samples)


def test_energy_from_nowhere_is_seen_where_balls_stay_in_cushions() -> None:
    one, played = sound(44, "cushion_contact_time")
    samples = played.samples.copy()
    k = samples.shape[1] // 2
    samples[0, k:, :, 2] += STILL_M_S
    assert [b.law for b in breaches(one, with_samples(played, samples))] == ["energy"]


def test_what_was_fast_before_does_not_excuse_what_a_slow_ball_gains() -> None:
    """A millionth of a break's energy moves a ball at 1 cm/s."""
    one, played = sound(0)
    samples = played.samples.copy()
    samples[0, 0, :, 2] = 30.0
    samples[0, 1:, :, 2:7] = 0.0
    samples[0, 2 * ENERGY_WINDOW, 0, 2] = 0.2 * STILL_M_S
    assert [b.law for b in breaches(one, with_samples(played, samples))] == ["energy"]


def test_a_ball_may_be_laid_into_a_cushion_uphill() -> None:
    """As deep as it may be there, it has more potential energy than it came with."""
    one, played = sound(14, "cushion_contact_time")
    slope, nap = pushes(one, 0)
    uphill = -np.sign(slope[0] + nap)
    samples = played.samples.copy()
    samples[0, :, :, :2], samples[0, :, :, 2:7] = 0.0, 0.0
    samples[0, :, 0, 0] = uphill * played.game.limits[0, 0]
    samples[0, 3 * ENERGY_WINDOW :, 0, 0] += uphill * 0.9 * MAX_RAIL_DEPTH * one.model.ball.radius
    assert "energy" not in [b.law for b in breaches(one, with_samples(played, samples))]


def test_a_nap_does_no_work_on_a_ball_in_flight() -> None:
    """The flight's way is left out of it, and what is gained in flight is seen."""
    seed = next(s for s in range(10_000) if {"cloth_nap", "cue_hop"} <= {e.name() for e in batch(s, 1).model.effects})
    one = picked(batch(seed, 64), np.array([0]))
    played = play(one)
    assert breaches(one, played) == []
    samples = played.samples.copy()
    samples[0, 2 * ENERGY_WINDOW, 0, 2] += np.copysign(1.0, samples[0, 2 * ENERGY_WINDOW, 0, 2])
    assert [b.law for b in breaches(one, with_samples(played, samples))] == ["energy"]
