"""The camera's effects and squirt: definition on numbers, resting balls undone, recovery from distorted clips."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from models.effect import Effect
from models.effect_catalogue import effect_class
from models.errors import BadInput
from models.model_file import Model, full_model
from models.shot import Array, Ball, Shot, Table, Track
from models.simulation.observe import camera, observed, undone
from models.simulation.simulate import simulate
from sysid.clips import ClipSet, Observation
from sysid.clips.segments import split_all
from sysid.estimation.chains.chain_search import found_states
from sysid.estimation.open_cloth import cloth_constants
from sysid.estimation.problem import CAUCHY_SD, shared_constants, values_of
from sysid.estimation.segment_problem import segment_problem
from sysid.estimation.shot_problem import shot_problem
from sysid.estimation.solver.joint_fit import fit_joint
from sysid.estimation.solver.least_squares import fit_each
from tests.support.hidden_truth import changed, make, truth_of
from tests.truth.camera import image
from tests.truth.cloth import Constants
from tests.truth.physics import Cue, strike

BALL, TABLE = Ball(0.0525, 0.1406), Table(3.569, 1.778, pockets=False)
BASE = full_model(TABLE, BALL)
STAMPS = np.linspace(0, 1.2, 25)
SIGMA = 5e-4


def effect(name: str, **values: float | Array) -> Effect:
    return effect_class(name)(**values)


def shot(times: Array = STAMPS) -> Shot:
    """A spinning ball into another one, and a third at rest in the corner."""
    place = np.array([[-0.9, 0.5], [-0.2, 0.31], [1.6, -0.7]])
    v, w = np.zeros((3, 2)), np.zeros((3, 3))
    v[0], w[0] = [1.6, -0.42], [5.0, 30.0, 25.0]
    return Shot(("cue", "red", "black"), place, v, w, times)


@pytest.fixture(scope="module")
def plain() -> Track:
    [track] = simulate(BASE, [shot()])
    return track


def seen(*effects: Effect, played: Shot | None = None) -> Track:
    model = BASE
    for one in effects:
        model = model.add(one)
    [track] = observed(model, [played or shot()])
    return track


def test_without_a_camera_it_is_simulate_itself(plain: Track) -> None:
    track = seen()
    for name in ("times", "position", "velocity", "spin", "theta"):
        assert getattr(track, name).tobytes() == getattr(plain, name).tobytes()
    assert track.events == plain.events
    assert camera(BASE.add(effect("lens_distortion", barrel=0.0))) == ()


def test_lens_distortion(plain: Track) -> None:
    x, y = np.moveaxis(plain.position, -1, 0)
    track = seen(effect("lens_distortion", barrel=0.006))
    shrink = 1 - 0.006 * (x * x + y * y)
    np.testing.assert_allclose(track.position, np.stack([x * shrink, y * shrink], axis=-1), atol=1e-14)
    assert track.position[0, 2, 0] == pytest.approx(1.6 - 0.006 * 1.6 * (1.6**2 + 0.7**2))
    assert track.velocity.tobytes() == plain.velocity.tobytes() and track.times.tolist() == STAMPS.tolist()


def test_camera_tilt(plain: Track) -> None:
    track = seen(effect("camera_tilt", along_x=0.004, along_y=0.002))
    x, y = np.moveaxis(plain.position, -1, 0)
    np.testing.assert_allclose(track.position[..., 0], x / (1 + 0.004 * x + 0.002 * y), atol=1e-14)
    assert track.position[0, 2, 1] == pytest.approx(-0.7 / (1 + 0.0064 - 0.0014))


def test_image_scale(plain: Track) -> None:
    np.testing.assert_allclose(seen(effect("image_scale", stretch=0.01)).position, 1.01 * plain.position, atol=1e-14)


def test_image_aspect(plain: Track) -> None:
    made = seen(effect("image_aspect", aspect=0.01)).position
    np.testing.assert_allclose(made, np.array([1.01, 0.99]) * plain.position, atol=1e-14)


def test_clock_scale(plain: Track) -> None:
    track = seen(effect("clock_scale", factor=1.012), played=shot(1.012 * STAMPS))
    np.testing.assert_allclose(track.position, plain.position, atol=1e-12)
    assert track.times.tolist() == (1.012 * STAMPS).tolist(), "the stamps, not the true times"
    when = [e.time for e in plain.events]
    assert when and [e.time for e in track.events] == pytest.approx([1.012 * t for t in when], abs=1e-9)


def test_rolling_shutter() -> None:
    """A ball at y is where it was, or will be, delay y away."""
    delay, late = 0.004, []
    track = seen(effect("rolling_shutter", delay=delay))
    [exact] = simulate(BASE, [shot()])
    for k in range(4, len(STAMPS)):
        when = STAMPS[k] + delay * exact.position[k, 0, 1]
        [there] = simulate(BASE, [shot(np.array([0.0, when]))])
        late.append(np.abs(track.position[k, 0] - there.position[1, 0]).max())
    assert np.median(late) < 1e-5, "to first order in the delay"
    assert np.abs(track.position - exact.position).max() > 2e-3
    assert track.position[:, 2].tobytes() == exact.position[:, 2].tobytes(), "a ball at rest is where it is"


def test_effects_act_in_the_order_of_the_stack(plain: Track) -> None:
    scale, lens = effect("image_scale", stretch=0.1), effect("lens_distortion", barrel=0.01)
    x = plain.position
    r2 = np.sum(x**2, axis=-1, keepdims=True)
    np.testing.assert_allclose(seen(lens, scale).position, 1.1 * x * (1 - 0.01 * r2), atol=1e-14)
    np.testing.assert_allclose(seen(scale, lens).position, 1.1 * x * (1 - 0.0121 * r2), atol=1e-14)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("lens_distortion", {"barrel": [0.0, 0.003, -0.01]}), ("clock_scale", {"factor": [1.0, 0.99, 1.02]}),
        ("camera_tilt", {"along_x": [0.0, 0.01, -0.01], "along_y": [0.0, 0.02, 0.0]}),
        ("image_scale", {"stretch": [0.0, 0.01, -0.03]}), ("image_aspect", {"aspect": [0.0, 0.01, -0.03]}),
        ("rolling_shutter", {"delay": [0.0, 0.003, -0.003]}),
        ("squirt", {"per_offset": [0.0, 3.0, -2.0]}), ("lens_distortion_r4", {"fourth": [0.0, 0.001, -0.002]}),
    ],
)  # fmt: skip
def test_each_simulation_has_its_own_parameters(name: str, values: dict[str, list[float]]) -> None:
    together = observed(BASE.add(effect(name, **{k: np.array(v) for k, v in values.items()})), [shot()] * 3)
    for k, track in enumerate(together):
        alone = seen(effect(name, **{key: v[k] for key, v in values.items()}))
        np.testing.assert_allclose(track.position, alone.position, atol=1e-13)
    assert np.ptp([t.position[-1] for t in together], axis=0).max() > 1e-4


def test_a_shot_may_begin_late() -> None:
    """A segment starts at a stamp of its own: what counts is how the camera's clock runs from there on."""
    track = seen(effect("clock_scale", factor=1.05))
    model = BASE.add(effect("clock_scale", factor=1.05))
    [later] = observed(model, [shot()], begun=[3.7])
    np.testing.assert_allclose(later.position, track.position, atol=1e-12)


def test_resting_balls_are_put_where_they_lie() -> None:
    """Reported places go in, and come out of the camera again, in every variant."""
    barrels = np.array([0.0, 0.006, -0.02, 0.03])
    model = BASE.add(effect("lens_distortion", barrel=barrels)).add(effect("camera_tilt", along_x=0.02, along_y=-0.01))
    shots = [shot(np.zeros(1))] * 4
    moved = undone(model, shots)
    assert all(m.position[0].tolist() == shots[0].position[0].tolist() for m in moved), "the struck ball stays"
    assert np.ptp([m.position[2, 0] for m in moved]) > 0.05
    for track in observed(model, moved):
        np.testing.assert_allclose(track.position[0, 1:], shots[0].position[1:], atol=1e-12)
    assert undone(BASE, shots) == shots
    strong = BASE.add(effect("lens_distortion", barrel=0.2))
    [kept] = undone(strong, shots[:1])
    assert kept.position[2].tolist() == shots[0].position[2].tolist(), "no place is seen there: nothing runs away"
    [back] = observed(strong, [kept])
    np.testing.assert_allclose(back.position[0, 1], shots[0].position[1], atol=1e-12)


def test_exposures_that_run_backwards_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = effect("clock_scale", factor=1.05)
    monkeypatch.setattr(type(clock), "exposures", lambda self, stamps: -self.factor * stamps)
    with pytest.raises(BadInput, match="clock_scale: exposures go backwards"):
        seen(clock)


@pytest.mark.parametrize(
    ("name", "values", "hidden"),
    [
        ("lens_distortion", {"barrel": 0.006}, {"lens": 0.006}),
        ("lens_distortion_r4", {"fourth": 0.0012}, {"lens4": 0.0012}),
        ("image_scale", {"stretch": 0.01}, {"image_scale": 0.01}),
        ("image_aspect", {"aspect": 0.01}, {"image_aspect": 0.01}),
        ("camera_tilt", {"along_x": 0.004, "along_y": 0.002}, {"camera_tilt": 0.004}),
    ],
)  # fmt: skip
def test_the_image_is_the_generator_s(
    plain: Track, name: str, values: dict[str, float], hidden: dict[str, float]
) -> None:
    there = image(plain.position, plain.times, Constants(**hidden))
    np.testing.assert_allclose(seen(effect(name, **values)).position, there, atol=1e-14)


def struck(one: Effect, velocity: Array, spin: Array) -> tuple[Array, Array]:
    """Velocity (2,) and spin (3,) with which a ball leaves the cue that is told others."""
    hit = Shot(("cue",), np.zeros((1, 2)), np.array([velocity]), np.array([spin]), np.zeros(1))
    [track] = simulate(BASE.add(one), [hit])
    return track.velocity[0, 0], track.spin[0, 0]


@pytest.mark.parametrize("elevation", [0.0, 0.35, 0.7])
@pytest.mark.parametrize("side", [0.009, -0.006, 0.0])
def test_squirt_turns_the_stroke_as_the_generator_does(side: float, elevation: float) -> None:
    cue = Cue(1.7, 0.6, side, 0.004, elevation)
    aimed, left = strike((0.0, 0.0), cue, BALL.radius), strike((0.0, 0.0), cue, BALL.radius, squirt=3.0)
    v, w = struck(effect("squirt", per_offset=3.0), aimed.velocity, aimed.omega)
    np.testing.assert_allclose(v, left.velocity, atol=2e-3 * 1.7 * 3 * abs(side) / 0.01 + 1e-12)
    np.testing.assert_allclose(w, left.omega, atol=0.02)


def test_squirt_is_away_from_the_tip() -> None:
    """The right side turns the ball counter-clockwise, and sends it to the left."""
    v, _ = struck(effect("squirt"), np.array([1.5, 0.0]), np.array([0.0, 0.0, 30.0]))
    assert v[1] > 0


def test_squirt_turns_the_struck_ball_only() -> None:
    squirting = BASE.add(effect("squirt"))
    both = dataclasses.replace(shot(), velocity=np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 0.0]]))
    both = dataclasses.replace(both, spin=np.tile([0.0, 0.0, 40.0], (3, 1)), times=np.zeros(1))
    [track] = simulate(squirting, [both])
    assert track.velocity[0, 0, 1] > 0.02 and track.velocity[0, 1, 1] == 0
    angle = np.arctan2(*track.velocity[0, 0, ::-1])
    assert angle == pytest.approx(3.0 * 0.4 * BALL.radius**2 * 40.0, rel=1e-9)
    spun = dataclasses.replace(both, velocity=0.01 * both.velocity)
    [track] = simulate(squirting, [spun])
    assert np.arctan2(*track.velocity[0, 0, ::-1]) == pytest.approx(3.0 * BALL.radius / 2), "at most the miscue limit"


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> tuple[ClipSet, Model]:
    """Clips that hide no effect, and the model that made them."""
    folder = tmp_path_factory.mktemp("camera") / "set"
    clip_set, _ = make(folder, 21, kinds="roll,stun,follow,draw,cushion,cut")
    return clip_set, full_model(clip_set.table, clip_set.ball).with_values(truth_of(folder))


def recovered(clip_set: ClipSet, model: Model, names: tuple[str, ...]) -> tuple[Array, Array]:
    """Constants from the segments of open cloth, and their standard deviations."""
    segments = split_all(clip_set.clips, clip_set.table, clip_set.ball, SIGMA, clip_set.fps)
    problem = segment_problem(model, names, segments, SIGMA)
    c = values_of(model, names)
    x, _ = fit_each(problem.objective(10.0), problem.start, c, 8)
    joint = fit_joint(problem.objective(CAUCHY_SD), x, c, shared_constants(model, names))
    assert joint.converged
    return joint.constants, np.sqrt(np.diag(joint.covariance))


def test_a_lens_is_recovered_with_the_cloth(clean: tuple[ClipSet, Model]) -> None:
    clip_set, model = clean

    def bent(ball: Observation) -> Observation:
        return dataclasses.replace(ball, xy=ball.xy * (1 - 0.006 * np.sum(ball.xy**2, axis=1, keepdims=True)))

    model = model.add(effect("lens_distortion"))
    names = (*cloth_constants(BASE), "lens_distortion.barrel")
    constants, sd = recovered(changed(clip_set, bent), model, names)
    assert constants[-1] == pytest.approx(0.006, abs=4 * sd[-1])
    assert sd[-1] < 0.002
    roll = names.index("decoupled_cloth.roll")
    assert constants[roll] == pytest.approx(model.parameters()["decoupled_cloth.roll"], abs=4 * sd[roll])


def test_a_clock_is_recovered_where_the_cloth_is_known(clean: tuple[ClipSet, Model]) -> None:
    clip_set, model = clean
    slow = changed(clip_set, lambda ball: dataclasses.replace(ball, time=1.02 * ball.time))
    [factor], [sd] = recovered(slow, model.add(effect("clock_scale")), ("clock_scale.factor",))
    assert factor == pytest.approx(1.02, abs=4 * sd)
    assert sd < 0.004


def test_whole_shots_meet_resting_balls_through_the_camera(clean: tuple[ClipSet, Model]) -> None:
    """At the true values, distorted clips of whole shots are followed as well as clean ones."""
    clip_set, model = clean

    def bent(ball: Observation) -> Observation:
        return Observation(1.02 * ball.time, ball.xy / (1 + 0.01 * ball.xy @ [[1.0], [0.5]]), ball.theta)

    rows = [k for k, clip in enumerate(clip_set.clips) if len(clip.balls) > 1]
    few = dataclasses.replace(clip_set, clips=tuple(clip_set.clips[k] for k in rows))
    filmed = model.add(effect("camera_tilt", along_x=0.01, along_y=0.005)).add(effect("clock_scale", factor=1.02))
    left = []
    for clips, table in ((few, model), (changed(few, bent), filmed)):
        problem = shot_problem(table, (), clips, SIGMA)
        n = len(clips.clips)
        x = found_states(problem, np.zeros(0))
        r = problem.evaluate(x, np.zeros((n, 0)), np.arange(n))
        left.append(np.sqrt(np.nanmedian(r**2, axis=1)))
        tracks = problem.tracks(x, np.zeros((n, 0)), np.arange(n))
        assert all(t.times.tolist() == problem.times(k).tolist() for k, t in enumerate(tracks))
        for k, track in enumerate(tracks):
            moved = x[k, 7:].reshape(-1, 2)[: len(problem.rest[k])]
            np.testing.assert_allclose(track.position[0, 1:], problem.rest[k] + moved, atol=1e-11)
    assert len(rows) >= 2 and np.median(left[1]) < 1.3 * np.median(left[0]) < 2.0
