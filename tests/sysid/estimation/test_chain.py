"""Multiple shooting: windows, their normal equations, and what they find in shots of another program."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from models.effects.cloth.air_drag import AirDrag
from models.model_file import full_model
from sysid.clips import read_clip_set
from sysid.estimation.chains.chain import (
    FIRST_SPREAD,
    Chain,
    Spread,
    equations,
    likely_spread,
    limited_move,
    reduced,
)
from sysid.estimation.chains.chain_beside import Beside, information_beside
from sysid.estimation.chains.chain_fit import fit_chain, settled_states
from sysid.estimation.chains.chain_search import SAME_LOSS, searched_windows
from sysid.estimation.clip_fit import fit_clips
from sysid.estimation.from_nothing import WindowFit, from_other
from sysid.estimation.problem import values_of
from sysid.estimation.shot_problem import shot_problem
from sysid.estimation.states.initial_states import shot_losses, within_noise
from sysid.estimation.windows import columns, shot_states, windows_of
from sysid.selection.discover import discover
from tests.support.long_shots import CAROM, NOISE_M, long_shots, true_model


@pytest.fixture(scope="module")
def chain() -> tuple[Chain, np.ndarray]:
    """Windows at the true constants, and states that follow them."""
    model = true_model(*CAROM)
    names = tuple(model.parameters())
    problem = shot_problem(model, names, long_shots(model, 13, 4, impacts=(5, 8)), NOISE_M)
    chain = Chain(problem, windows_of(problem))
    return chain, searched_windows(chain, values_of(model, names))


def test_windows_share_out_the_samples_and_hang_together(chain: tuple[Chain, np.ndarray]) -> None:
    windows, problem = chain[0].windows, chain[0].problem
    assert len(windows.shot) > 4 * len(problem.clips)
    for k, clip in enumerate(problem.clips):
        mine = np.flatnonzero(windows.shot == k)
        for i, name in enumerate(problem.balls(k)):
            held = windows.data.count[mine, i].sum() - (mine.size if i == 0 else 0)  # the first has a stamp at each end
            assert held == len(clip.balls[name].time)
    assert windows.hit.sum(axis=1).max() <= windows.balls
    place, motion = columns(1, windows.balls)
    assert not (set(place) & set(motion)) and len(motion) == 5


def test_states_of_shots_and_of_their_first_windows_are_the_same(chain: tuple[Chain, np.ndarray]) -> None:
    problem, windows = chain[0].problem, chain[0].windows
    np.testing.assert_allclose(shot_states(problem, windows, windows.start), problem.start, atol=1e-12)


def test_shots_of_fewer_balls_than_their_set_have_windows_as_among_the_others(chain: tuple[Chain, np.ndarray]) -> None:
    problem, windows = chain[0].problem, chain[0].windows
    counts = np.array([len(problem.balls(k)) for k in range(len(problem.clips))])
    few = np.flatnonzero(counts < counts.max())
    assert few.size
    alone, among = windows_of(problem.only(few)), windows.only(few)
    np.testing.assert_array_equal(alone.start, among.start)
    np.testing.assert_array_equal(alone.free, among.free)


def test_with_the_true_model_windows_follow_each_other(chain: tuple[Chain, np.ndarray]) -> None:
    at, states = chain[0].with_spread(Spread(FIRST_SPREAD.impact, 0.0)), chain[1]
    c = values_of(at.model, at.names)
    r, ends = at.play(states, np.tile(c, (len(states), 1)), np.arange(len(states)))
    assert np.nanmedian(np.abs(r)) / 0.6745 == pytest.approx(1.0, abs=0.15)
    gaps = at.gaps(states, ends, at.gap_sd(states))
    assert np.nanmedian(np.abs(gaps)) < 0.2  # of what a model that lacks something may leave
    spread = likely_spread(at, states, c)
    assert spread.impact < FIRST_SPREAD.impact and spread.path < 0.1 * FIRST_SPREAD.path


def test_normal_equations_are_the_derivatives_of_the_loss(chain: tuple[Chain, np.ndarray]) -> None:
    at, states = chain
    c, rng = values_of(at.model, at.names), np.random.default_rng(1)
    sd = at.gap_sd(states)
    _, shots = equations(at, states, c, sd, at.shared.steps_from(c))
    shot, run = shots[2], at.windows.runs[2]
    direction = rng.normal(size=shot.free.sum()) * 1e-3 / np.sqrt(np.diag(shot.states) + 1e-6)
    step = np.zeros(shot.free.shape)
    step[shot.free] = direction

    def loss(share: float) -> float:
        moved = states.copy()
        moved[run] += share * step
        return float(at.losses(moved, c, sd)[2])

    assert shot.state_gradient @ direction == pytest.approx(0.5 * (loss(1.0) - loss(-1.0)), rel=0.02, abs=1e-5)


def test_all_shots_together_tell_what_each_tells_and_parameters_beside_what_they_tell_as_constants(
    chain: tuple[Chain, np.ndarray],
) -> None:
    """A drag beside the fit has the information that it has as a constant of the same model, where it is 0."""
    at, states = chain
    drag = AirDrag(0.0)
    more = at.with_model(at.model.add(drag), (*at.names, "air_drag.rate"))
    c, sd, probe = values_of(at.model, at.names), at.gap_sd(states), np.array([1e-4])
    steps = at.shared.steps_from(c)
    beside = [Beside(more, np.zeros(1), probe, None)]
    each, gradients, alone = information_beside(at, states, c, sd, steps, beside, together=False)
    total, gradient, alone_too = information_beside(at, states, c, sd, steps, beside, together=True)
    assert len(each) == len(at.windows.runs) and len(total) == 1
    np.testing.assert_allclose(total[0], each.sum(axis=0), rtol=1e-9, atol=1e-9 * np.abs(total).max())
    np.testing.assert_allclose(gradient[0], gradients.sum(axis=0), rtol=1e-9, atol=1e-9 * np.abs(gradient).max())
    np.testing.assert_allclose(alone_too, alone)
    _, shots = equations(more, states, np.append(c, 0.0), sd, np.append(steps, probe))
    _, information, slopes = reduced(shots)
    unit = np.append(np.ones(len(c)), probe)
    expected = information.sum(axis=0) * np.outer(unit, unit)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(total[0] / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-6)
    np.testing.assert_allclose(gradient[0] / scale, slopes.sum(axis=0) * unit / scale, atol=1e-5)


def test_a_jump_within_a_step_tells_of_no_slope(chain: tuple[Chain, np.ndarray]) -> None:
    at = np.array([1.0, 1.0, 1.0, 1.0])
    moved = limited_move(at, np.array([[1.1, 9.0, 1.1, np.nan]]), np.array([[0.9, 0.9, 1.2, 0.9]]))
    np.testing.assert_allclose(moved, [[1.1, 1.1, 1.0, 1.0]])
    windows, states = chain  # where nothing jumps, the derivatives are what they were
    c, sd = values_of(windows.model, windows.names), windows.gap_sd(states)
    steps = windows.shared.steps_from(c)
    one, two = (
        np.diag(reduced(equations(windows, states, c, sd, steps, limited=limited)[1])[1].sum(axis=0))
        for limited in (False, True)
    )
    assert np.all(two < 1.001 * one) and np.median(two / one) == pytest.approx(1.0, abs=0.02)


def test_some_of_the_shots_are_what_they_are_among_all(chain: tuple[Chain, np.ndarray]) -> None:
    at, states = chain
    c, some = values_of(at.model, at.names), np.array([1, 3])
    rows = np.isin(at.windows.shot, some)
    part = at.only(some)
    np.testing.assert_array_equal(part.gap_sd(states[rows]), at.gap_sd(states)[rows[at.windows.following[1]]])
    few = part.losses(states[rows], c, part.gap_sd(states[rows]))
    np.testing.assert_allclose(few, at.losses(states, c, at.gap_sd(states))[some], rtol=1e-12)


def test_searches_agree_on_the_states_at_the_true_constants(chain: tuple[Chain, np.ndarray]) -> None:
    at, states = chain
    c, sd = values_of(at.model, at.names), at.gap_sd(at.windows.start)
    again = at.losses(searched_windows(at, c, states, 1), c, sd)
    np.testing.assert_array_less(again, at.losses(states, c, sd) + 1e-9)  # nothing that was known is lost
    from_nothing = at.losses(searched_windows(at, c, searches=2), c, sd)
    assert np.sum(np.abs(from_nothing - again) < SAME_LOSS) >= len(again) - 1


def test_known_states_that_are_wrong_are_found_anew(chain: tuple[Chain, np.ndarray]) -> None:
    """Every ball spins the other way and wildly: nothing of that is needed to find them."""
    at, states = chain
    c, sd = values_of(at.model, at.names), at.gap_sd(at.windows.start)
    wrong = states.copy()
    for i in range(at.windows.balls):
        spin = columns(i, at.windows.balls)[1][2:]
        wrong[:, spin] *= -3.0
    best = at.losses(states, c, sd)
    assert np.median(at.losses(wrong, c, sd) / best) > 3
    found = at.losses(searched_windows(at, c, wrong, 2), c, sd)
    assert np.sum(np.abs(found - best) < SAME_LOSS) >= len(best) - 1


def test_intervals_hold_the_step_that_remains_and_what_halves_differ_by(chain: tuple[Chain, np.ndarray]) -> None:
    at, states = chain
    found = fit_chain(at, states, values_of(at.model, at.names), 10, "test")
    rough = dataclasses.replace(found, chain=dataclasses.replace(at, roughness=4.0))
    still = dataclasses.replace(found, step=0 * found.step)
    wider = dataclasses.replace(rough, step=0 * found.step)
    k = at.names.index("cushion_impact.restitution")  # of which nothing is known beside the shots
    assert wider.covariance[k, k] == pytest.approx(4 * still.covariance[k, k], rel=0.1)
    sd, step = np.sqrt(np.diag(rough.covariance)), np.abs(found.step)
    assert (sd[np.isfinite(sd)] >= step[np.isfinite(sd)]).all()
    far = fit_chain(at, states, np.clip(1.02 * found.constants, *at.shared.bounds.T), 0, "test")
    assert found.converged and not far.converged


def test_a_fit_takes_over_the_windows_that_another_follows_better(chain: tuple[Chain, np.ndarray]) -> None:
    at, states = chain
    c, lost = values_of(at.model, at.names), states.copy()
    mine = np.flatnonzero(at.windows.shot == 2)
    lost[mine[1]][columns(0, at.windows.balls)[1][:2]] += 0.8
    good, bad = (WindowFit(fit_chain(at, one, c, 0, "test"), at, one) for one in (states, lost))
    assert bad.fitted.losses[2] > good.fitted.losses[2] + 100
    mended = from_other(bad, good, 2)
    assert (mended.fitted.losses < good.fitted.losses + 2.5).all()
    assert (mended.held_losses() < good.held_losses() + 2.5).all()
    assert from_other(good, bad, 2).fitted.losses.sum() <= good.fitted.losses.sum() + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2])
def test_shots_too_few_for_halves_are_fitted_without_what_halves_differ_by(count: int) -> None:
    model = true_model(*CAROM)
    found = fit_clips(long_shots(model, 13, count, impacts=(5, 8)), full_model(*CAROM)).fitted
    assert found.rms < 3 * NOISE_M and found.names


def test_constants_that_are_off_by_a_twentieth_come_back(chain: tuple[Chain, np.ndarray]) -> None:
    at, states = chain
    c = values_of(at.model, at.names)
    start = np.clip(1.05 * c, *at.shared.bounds.T)
    found = fit_chain(at, settled_states(at, states, start, 4), start, 10, "test")
    sd = np.sqrt(np.diag(np.linalg.pinv(found.information.sum(axis=0))))
    for name in ("cushion_impact.restitution", "decoupled_cloth.roll", "decoupled_cloth.slide"):
        k = at.names.index(name)
        assert found.constants[k] == pytest.approx(c[k], abs=max(4 * sd[k], 3e-3 * c[k])), name


@pytest.mark.slow
@pytest.mark.thorough
def test_an_effect_of_impacts_is_found_in_long_shots(data_folder: Path) -> None:
    """In shots of another program, which knows no model of ours: the restitution of cushions falls with the speed."""
    clip_set = read_clip_set(data_folder / "long" / "set-51")
    truth = json.loads((data_folder / "long" / "set-51.truth.json").read_text(encoding="utf-8"))["constants"]
    found = discover(clip_set, full_model(clip_set.table, clip_set.ball))
    assert found.verdict == ("cushion_restitution_speed",)
    assert found.last.value("cushion_restitution_speed.rate")[0] == pytest.approx(truth["ec_v"], rel=0.01)
    assert found.last.value("cushion_impact.friction")[0] == pytest.approx(truth["muc"], rel=0.01)
    assert found.last.held_rms < 1.05 * 0.0004
    last = found.last  # of one training shot in twenty the start is not found
    losses = shot_losses(last.problem, last.initial_states, last.constants)
    assert within_noise(*losses, last.problem.correlation_time).mean() >= 0.95
    assert found.rounds[0].base is found.ladder[0]
    assert {e.name() for e in found.rounds[-1].base.model.effects} > {e.name() for e in found.ladder[0].model.effects}
