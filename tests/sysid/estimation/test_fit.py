"""Recovery of hidden truths: constants, their uncertainty, and what a fit does with poor data."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from models.errors import BadInput
from models.model_file import Model, full_model, read_model, write_model
from models.shot import Ball, Shot, Table
from models.simulation.simulate import simulate
from models.table.sizes import SIZE_NAMES
from sysid.clips import Clip, ClipSet, Observation, read_clip_set
from sysid.clips.tracker.noise import position_noise
from sysid.estimation import ClipFit, fit_clips
from sysid.estimation.fitting import fit_held_out
from sysid.estimation.shot_problem import shot_problem
from sysid.estimation.split import HELD_OUT_EVERY, training_clips
from sysid.residuals.compare import compare
from tests.bench.accuracy import CONSTANTS
from tests.support.hidden_truth import Case, changed, make, miss, truth_of


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    return make(tmp_path_factory.mktemp("fit") / "set", 3)


@pytest.fixture(scope="module")
def start(case: Case) -> Model:
    return full_model(case[0].table, case[0].ball)


@pytest.fixture(scope="module")
def found(case: Case, start: Model) -> ClipFit:
    return fit_clips(case[0], start)


def test_all_constants_are_recovered(case: Case, start: Model, found: ClipFit) -> None:
    assert found.fitted.converged
    assert set(found.fitted.names) == {*CONSTANTS, *SIZE_NAMES}
    off = miss(found, case[1])
    assert max(map(abs, off.values())) < 4, off
    roll = "decoupled_cloth.roll"
    assert found.model.parameters()[roll] == pytest.approx(case[1][roll], rel=0.01)
    worse = [abs(start.parameters()[n] / case[1][n] - 1) for n in CONSTANTS]
    better = [abs(found.model.parameters()[n] / case[1][n] - 1) for n in CONSTANTS]
    assert max(better) < 0.2 * max(worse)


def test_the_uncertainty_is_neither_absurdly_small_nor_large(case: Case, found: ClipFit) -> None:
    values = found.model.parameters()
    relative = {n: found.model.estimates[n].sd / values[n] for n in found.fitted.names}
    assert all(1e-5 < r < 0.1 for r in relative.values()), relative
    assert 0 < relative["decoupled_cloth.roll"] < 0.05
    # Of ten constants, not all lie absurdly close to the truth either.
    assert np.sqrt(np.mean(np.square(list(miss(found, case[1]).values())))) > 0.15
    np.testing.assert_allclose(found.fitted.covariance, found.fitted.covariance.T)
    assert np.all(np.linalg.eigvalsh(found.fitted.covariance) > 0)


def test_what_is_left_is_noise(case: Case, found: ClipFit) -> None:
    assert found.segment_ratio == pytest.approx(1.0, abs=0.1)
    assert found.fitted.discrepancy_rate < 1e-3
    comparison = compare(case[0], found.model)
    rms = np.sqrt(np.mean([c.rms_m**2 for c in comparison.clips]))
    assert rms == pytest.approx(5e-4 * np.sqrt(2), rel=0.1)
    assert all(0.7 < c.chi2_reduced < 1.4 for c in comparison.clips)
    held = [c for c in comparison.clips if c.held_out]
    assert [c.file for c in held] == [
        case[0].clips[k].file for k in range(12) if k % HELD_OUT_EVERY == HELD_OUT_EVERY - 1
    ]
    assert max(c.rms_m for c in held) < 3 * 5e-4 * np.sqrt(2)


def test_every_fifth_clip_is_held_out(case: Case, found: ClipFit) -> None:
    rows = training_clips(case[0])
    assert found.fitted.problem.clips == tuple(found.parts.training.clips) and len(rows) == 10
    assert list(found.model.fitted["clips"]) == [case[0].clips[k].file for k in rows]
    few = dataclasses.replace(case[0], clips=case[0].clips[:3])
    assert training_clips(few) == [0, 1, 2]


def test_a_fitted_model_survives_its_file(case: Case, found: ClipFit, tmp_path: Path) -> None:
    write_model(found.model, tmp_path / "m.toml")
    again = read_model(tmp_path / "m.toml")
    assert again.parameters() == found.model.parameters()
    assert {n: again.estimates[n] for n in found.fitted.names} == {
        n: found.model.estimates[n] for n in found.fitted.names
    }
    assert again.fitted["converged"] is True
    assert (again.table, again.ball) == (case[0].table, case[0].ball)
    write_model(again, tmp_path / "again.toml")
    assert (tmp_path / "again.toml").read_bytes() == (tmp_path / "m.toml").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["again.toml", "m.toml"]


def test_a_second_run_gives_the_same_bytes(case: Case, start: Model, found: ClipFit, tmp_path: Path) -> None:
    again = fit_clips(case[0], start)
    for name, one in (("a", found), ("b", again)):
        write_model(one.model, tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    np.testing.assert_array_equal(found.fitted.covariance, again.fitted.covariance)


def test_progress_is_logged(case: Case, start: Model, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("INFO", logger="sysid"):
        fit_clips(dataclasses.replace(case[0], clips=case[0].clips[:4]), start)
    assert any("segments" in line for line in caplog.messages) and any("whole shots" in m for m in caplog.messages)


def test_clips_without_any_command(tmp_path: Path) -> None:
    clip_set, truth = make(tmp_path / "set", 33, "--no-cue", "--clips", "8", kinds="stun,draw,cushion,cushion,cut,roll")
    assert all(c.cue is None for c in clip_set.clips)
    start = full_model(clip_set.table, clip_set.ball)
    found = fit_clips(clip_set, start)
    assert found.fitted.converged
    told = {n: v for n, v in miss(found, truth).items() if np.isfinite(v)}
    assert {"decoupled_cloth.slide", "decoupled_cloth.roll", "cushion_impact.restitution"} <= set(told)
    assert max(map(abs, told.values())) < 4, told
    for name in set(found.fitted.names) - set(told):
        assert found.model.parameters()[name] == pytest.approx(start.parameters()[name]), "not told, so it stays"


def test_outliers_do_no_harm(case: Case, start: Model) -> None:
    """One position in a hundred is off by 20 mm, and the noise of the others is not told."""
    rng = np.random.default_rng(12)

    def spoil(seen: Observation) -> Observation:
        bad = rng.random(len(seen.time)) < 0.01
        bad[:3] = False
        way = rng.uniform(0, 2 * np.pi, len(seen.time))
        off = 0.02 * bad[:, None] * np.column_stack([np.cos(way), np.sin(way)])
        return dataclasses.replace(seen, xy=seen.xy + off)

    found = fit_clips(dataclasses.replace(changed(case[0], spoil), sigma=None), start)
    assert found.fitted.converged
    # An outlier spoils four third differences, so that the median of them is a little high.
    assert 0.95 * 5e-4 < found.model.fitted["noise_m"] < 1.2 * 5e-4
    off = miss(found, case[1])
    assert max(map(abs, off.values())) < 4, off
    roll = "decoupled_cloth.roll"
    assert found.model.parameters()[roll] == pytest.approx(case[1][roll], rel=0.01)


def test_the_angle_at_which_a_mark_begins_is_not_taken_as_exact(tmp_path: Path) -> None:
    """The first sample of a mark is as noisy as the others; here it is two standard deviations off."""
    clip_set, truth = make(tmp_path / "set", 53, "--clips", "4", kinds="stun,spin,cut,stun")

    def moved(seen: Observation) -> Observation:
        return dataclasses.replace(seen, theta=seen.theta + np.where(np.arange(len(seen.theta)) == 0, 0.04, 0.0))

    found = fit_clips(changed(clip_set, moved), full_model(clip_set.table, clip_set.ball))
    assert abs(miss(found, truth)["decoupled_cloth.spin"]) < 4


@pytest.mark.parametrize("sigma", [3e-4, 2e-3])
def test_noise_is_estimated_where_none_is_given(case: Case, sigma: float) -> None:
    """From tracks of 0.5 mm with more noise put on."""
    rng = np.random.default_rng(13)
    noisy = changed(case[0], lambda o: dataclasses.replace(o, xy=o.xy + sigma * rng.normal(size=o.xy.shape)))
    blind = dataclasses.replace(noisy, sigma=None)
    assert position_noise(blind) == pytest.approx(np.hypot(5e-4, sigma), rel=0.1)
    assert position_noise(dataclasses.replace(noisy, sigma=7e-4)) == 7e-4


def test_what_the_clips_do_not_show_is_not_claimed(tmp_path: Path) -> None:
    """Shots of one ball on open cloth say nothing of impacts: those constants stay, with no uncertainty."""
    clip_set, truth = make(tmp_path / "set", 5, "--open", kinds="stun,draw,roll,swerve")
    start = full_model(clip_set.table, clip_set.ball)
    found = fit_clips(clip_set, start)
    for name in ("ball_impact.restitution", "ball_impact.friction", "cushion_impact.restitution"):
        assert found.model.parameters()[name] == pytest.approx(start.parameters()[name], rel=1e-3)
        assert np.isnan(found.model.estimates[name].sd)
        assert "not determined" in found.model.estimates[name].source
    told = miss(found, truth)
    assert found.fitted.converged
    for name in ("decoupled_cloth.slide", "decoupled_cloth.roll"):
        assert abs(told[name]) < 4


def test_a_ball_seen_to_stay_is_not_potted_by_a_pocket_that_is_smaller_than_modelled() -> None:
    """It rebounds 40 mm from the middle of a long cushion, where the model's pocket takes it."""
    model = full_model(Table(3.569, 1.778), Ball(0.0525, 0.1406))
    times, clips = np.linspace(0, 1.2, 145), []
    for staying in (("white",), ()):
        velocity, spin = np.array([[0.0, 1.5]]), np.array([[-1.5 / model.ball.radius, 0.0, 0.0]])
        shot = Shot(("white",), np.array([[0.04, 0.3]]), velocity, spin, times, staying=staying)
        xy = simulate(model, [shot])[0].position[:, 0]
        seen = np.isfinite(xy[:, 0])
        ball = Observation(times[seen], xy[seen], np.full(seen.sum(), np.nan))
        clips.append(Clip(f"clips/{len(clips)}.csv", "white", {"white": ball}))
    problem = shot_problem(model, (), ClipSet(model.table, model.ball, 120.0, tuple(clips), 5e-4), 5e-4)
    assert problem.staying == (("white",), ())
    own = np.tile([0.04, 0.3, 1.5, 0.0, 0.0, 1.5, 0.0], (2, 1))
    missed = problem.evaluate(own, np.zeros((2, 0)), np.arange(2))
    assert np.nanmax(np.abs(missed)) < 0.01 and np.isfinite(missed[0, : 2 * len(times)]).sum() > 250


def test_too_little_to_fit_is_one_clear_line(case: Case, start: Model) -> None:
    short = changed(case[0], lambda o: Observation(o.time[:4], o.xy[:4], o.theta[:4]))
    with pytest.raises(BadInput, match=r"\d+ smooth paths.* takes 3 or more: film more shots"):
        fit_clips(short, start)
    with pytest.raises(BadInput, match=r"add \[camera\] sigma"):
        position_noise(dataclasses.replace(short, sigma=None))


@pytest.mark.slow
def test_a_hidden_set_of_another_program(data_folder: Path) -> None:
    folder = data_folder / "hidden" / "set-11"
    if not folder.is_dir():
        pytest.skip(f"{folder.name} is not among the data")
    clip_set, truth = read_clip_set(folder), truth_of(folder)
    found = fit_clips(clip_set, full_model(clip_set.table, clip_set.ball))
    assert found.fitted.converged
    off = miss(found, truth)
    assert max(map(abs, off.values())) < 3, off
    roll = "decoupled_cloth.roll"
    assert found.model.parameters()[roll] == pytest.approx(truth[roll], rel=0.01)


@pytest.mark.slow
def test_real_shots_are_compared(data_folder: Path) -> None:
    """A dozen shots of a carom match, filmed by a broadcaster."""
    folder = data_folder / "carom-match"
    if not folder.is_dir():
        pytest.skip("carom-match is not among the data")
    whole = read_clip_set(folder)
    clip_set = dataclasses.replace(whole, clips=whole.clips[:12])
    comparison = compare(clip_set, full_model(clip_set.table, clip_set.ball))
    assert len(comparison.clips) == 12
    for clip in comparison.clips:
        assert np.isfinite([clip.struck_rms_m, clip.rms_m, clip.chi2_reduced]).all()
        assert 0 < clip.struck_rms_m < 2
    assert all(np.isfinite(s.ratio) for s in comparison.segments) and len(comparison.segments) > 20
    assert all(np.isfinite(d.ratio) for d in comparison.where)


@pytest.mark.slow
@pytest.mark.parametrize("row", [3, 4], ids=["training", "held out"])
def test_a_shot_that_cannot_be_followed_is_set_aside_and_named(
    case: Case, start: Model, found: ClipFit, row: int
) -> None:
    """The samples of one clip in the wrong order are no shot of any table."""

    def shuffled(clip: Clip) -> Clip:
        if clip.file != odd:
            return clip
        rng = np.random.default_rng(1)
        half = np.array([case[0].table.length, case[0].table.width]) / 2 - 0.1
        balls = {
            name: dataclasses.replace(seen, xy=np.vstack([seen.xy[:1], rng.uniform(-half, half, seen.xy[1:].shape)]))
            for name, seen in clip.balls.items()
        }
        return dataclasses.replace(clip, balls=balls)

    odd = case[0].clips[row].file
    damaged = dataclasses.replace(case[0], clips=tuple(shuffled(c) for c in case[0].clips))
    fit = fit_clips(damaged, start)
    assert len(fit.parts.excluded) == 1 and fit.parts.excluded[0].startswith(f"{odd}: excluded")
    assert fit.parts.held_out is not None and fit.fitted.held_out is not None and fit.fitted.converged
    assert odd not in [c.file for c in (*fit.parts.training.clips, *fit.parts.held_out.clips)]
    assert fit.fitted.held_out.rms < 2 * fit.parts.noise
    for name in fit.fitted.names:
        (value, sd), (other, _) = fit.fitted.value(name), found.fitted.value(name)
        assert abs(value - other) < 4 * sd, name
    assert fit.parts.states_of(fit.fitted, [c.file for c in damaged.clips]) is None


def test_held_out_clips_speak_of_constants_that_a_fit_leaves_open(case: Case, found: ClipFit) -> None:
    """A collision among them, where the training clips have none, is no reason against a model."""
    fitted, held = found.fitted, found.parts.held_out
    assert held is not None and fitted.held_out is not None
    k = fitted.names.index("cushion_impact.restitution")
    off, states = fitted.constants.copy(), fitted.held_out.initial_states
    off[k] -= 0.02

    def squares(sd: float) -> tuple[float, float]:
        covariance = fitted.covariance.copy()
        covariance[k, :] = covariance[:, k] = 0.0
        covariance[k, k] = sd**2
        other = dataclasses.replace(fitted, constants=off, covariance=covariance)
        seen = fit_held_out(other, held, states)
        return float(np.nanmean(seen.residuals**2)), float(np.nanmean(seen.open_residuals**2))

    at_constants, left_open = squares(0.02)
    assert at_constants > 1.5 and left_open < 1.15
    assert squares(1e-5)[1] > 1.3
