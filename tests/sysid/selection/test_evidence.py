"""Scores of effects that a model does not hold, the clock of the stamps, and the next shots."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from models.effect_catalogue import effect_class
from models.model_file import Model, full_model
from models.shot import Ball, Table
from sysid.clips import Clip, ClipSet, Observation, read_clip_set
from sysid.clips.tracker.clock import stamp_scale
from sysid.estimation.fitted import Point
from sysid.estimation.problem import Array
from sysid.estimation.shot_problem import ShotProblem, shot_problem
from sysid.estimation.solver.least_squares import fit_each
from sysid.estimation.states.initial_states import with_scatter
from sysid.selection.next_shot import (
    BALL_SPEEDS_M_S,
    MAX_NEXT_SHOTS,
    MAX_TIP_OFFSET_M,
    NextShot,
    Rival,
    propose_shots,
    sequence,
    shots_to_try,
    value_in_words,
)
from sysid.selection.scoring.score import score_all
from sysid.selection.scoring.signatures import candidate
from tests.truth.__main__ import jittered
from tests.truth.__main__ import main as generate

SIGMA = 0.0005
NAMES = ("decoupled_cloth.slide", "decoupled_cloth.roll", "cushion_impact.restitution", "cushion_impact.friction")


def at_the_truth(folder: Path, *words: str) -> Point:
    """A fit that stands at the true constants of a generated set."""
    assert generate([str(folder), "--seed", "9", *words]) == 0
    clip_set, c = read_clip_set(folder), jittered(9)
    values = {
        "decoupled_cloth.slide": c.mus, "decoupled_cloth.roll": c.mur, "decoupled_cloth.spin": c.spin,
        "ball_impact.restitution": c.ebb, "ball_impact.friction": c.mubb, "cushion_impact.restitution": c.ec,
        "cushion_impact.friction": c.muc,
    }  # fmt: skip
    model = full_model(clip_set.table, clip_set.ball).with_values(values)
    problem = shot_problem(model, NAMES, clip_set, SIGMA)
    at = np.array([values[n] for n in NAMES])
    x, _ = fit_each(problem.objective(4.0), problem.start, at, 40)
    return Point(problem, x, at, 0.0)


@pytest.fixture(scope="module")
def drag(tmp_path_factory: pytest.TempPathFactory) -> Point:
    """Clips with a little air drag hidden."""
    words = ("--clips", "6", "--seconds", "2", "--kind", "roll,stun,follow", "--effect", "air_drag=0.004")
    return at_the_truth(tmp_path_factory.mktemp("drag") / "set", *words)


def test_the_hidden_effect_scores_best_and_its_size_is_promised(drag: Point) -> None:
    names = ("table_tilt", "air_drag", "speed_drag", "side_curve", "lens_distortion", "cushion_restitution_speed")
    found = score_all(drag, [candidate(effect_class(n)) for n in names])
    gains = {row.candidate.name: row.predicted_improvement for row in found.rows}
    assert list(gains.values()) == sorted(gains.values(), reverse=True)
    assert found.rows[0].candidate.name == "air_drag"
    assert gains["air_drag"] > gains["speed_drag"] > 5 * gains["side_curve"]
    [best] = [row for row in found.rows if row.candidate.name == "air_drag"]
    assert best.values[0] == pytest.approx(0.004, abs=4 * best.sd[0])
    assert best.sd[0] < 0.001
    pair = found.correlations.get(("air_drag", "speed_drag"), found.correlations.get(("speed_drag", "air_drag"), 0.0))
    assert 0.9 < pair <= 1.0 + 1e-9
    assert found.correlations["table_tilt", "cushion_restitution_speed"] < 0.9


def test_constants_go_with_what_is_missing(drag: Point) -> None:
    """Without the drag of the air the cloth would have to brake for it; with it, it has its true friction."""
    found = score_all(drag, [candidate(effect_class("air_drag"))])
    roll, (row,) = drag.constants[NAMES.index("decoupled_cloth.roll")], found.rows
    assert found.constants.keys() == row.constants.keys() == set(NAMES)
    beside, alone = (at["decoupled_cloth.roll"] - roll for at in (row.constants, found.constants))
    assert alone > 1e-4 and abs(beside) < 0.2 * alone


def test_quick_scores_are_nearly_the_same(drag: Point) -> None:
    few = [candidate(effect_class(n)) for n in ("air_drag", "side_curve")]
    slow, quick = score_all(drag, few), score_all(drag, few, quick=True)
    assert quick.rows[0].predicted_improvement == pytest.approx(slow.rows[0].predicted_improvement, rel=0.05)


def test_an_effect_is_scored_within_its_bounds(tmp_path: Path) -> None:
    """The least lever takes the whole deceleration from a sliding ball's sidespin: its slope points below 0."""
    words = ("--clips", "3", "--seconds", "2", "--kind", "side,cushion_side", "--effect", "spin_slide_coupling=0.012")
    point = at_the_truth(tmp_path / "set", *words)
    one = candidate(effect_class("spin_slide_coupling"))
    slope, size = (score_all(point, [dataclasses.replace(one, size=size)]).rows[0] for size in (None, 3.0))
    assert (slope.values.tolist(), slope.predicted_improvement) == ([0.0], 0.0)
    assert size.values[0] > 0.0 and size.predicted_improvement > 1.0


def test_what_is_known_beside_the_clips_counts(drag: Point) -> None:
    """The stamps' interval tells of a clock as the tracks cannot."""
    few = [candidate(effect_class("clock_scale"))]
    told = dataclasses.replace(drag.problem, known={"clock_scale.factor": (1.01, 0.001)})
    blind = score_all(drag, few).rows[0]
    seen = score_all(dataclasses.replace(drag, problem=told), few).rows[0]
    assert seen.predicted_improvement > blind.predicted_improvement + 50
    assert seen.values[0] == pytest.approx(1.01, abs=0.003)


def test_squirt_shows_against_the_commands_as_far_as_they_are_kept(tmp_path: Path) -> None:
    """Thin cuts magnify the direction, and tell no more of it: the cue strays by 0.3 degrees from its commands."""
    kinds = ("--kind", "roll,cut_side,side,stun,cushion_side,draw", "--clips", "12", "--seconds", "2")
    for folder, squirt in (("set", 4.0), ("none", 0.0)):
        found = at_the_truth(tmp_path / folder, *kinds, *(("--effect", f"squirt={squirt}") if squirt else ()))
        problem = with_scatter(found.problem, found.initial_states)
        strays = problem.prior.sd[:, 3] / found.initial_states[:, 2]
        assert np.median(strays) == pytest.approx(np.radians(0.3), rel=0.5)
        [score] = score_all(dataclasses.replace(found, problem=problem), [candidate(effect_class("squirt"))]).rows
        assert score.values[0] == pytest.approx(squirt, abs=3 * score.sd[0])
        sides = [clip.cue.side for clip in problem.clips if clip.cue is not None]
        assert score.sd[0] == pytest.approx(np.radians(0.3) / np.linalg.norm(sides), rel=0.5)
        assert (score.predicted_improvement > 15.0) is (squirt > 0)


def filmed(interval: float, fps: float, frames: int = 80, noise: float = 0.0) -> ClipSet:
    keep = np.random.default_rng(2).random(frames) > 0.2
    time = (interval * np.arange(frames) + noise * np.random.default_rng(3).normal(size=frames))[keep]
    seen = Observation(time, np.zeros((len(time), 2)), np.full(len(time), np.nan))
    return ClipSet(Table(3.569, 1.778), Ball(0.0525, 0.1406), fps, (Clip("a", "cue", {"cue": seen}),), SIGMA)


def test_stamps_tell_a_clock_that_runs_fast() -> None:
    scale, sd = stamp_scale(filmed(1.012 / 120, 120.0))
    assert scale == pytest.approx(1.012, abs=1e-6)
    assert sd < 5e-4
    scale, sd = stamp_scale(filmed(1 / 120, 120.0, noise=2e-5))
    assert abs(scale - 1) < 3 * sd
    assert stamp_scale(filmed(0.0199, 50.2))[1] > 4e-4, "a rate given to one digit says less"
    assert stamp_scale(filmed(1 / 120, 120.0, frames=20))[1] == np.inf
    assert stamp_scale(filmed(1.4 / 120, 120.0))[1] == np.inf, "no whole number of frames"


def shots_for(fit: Point, truth: Model, covariance: Array, *, error_rate: float = 0.05) -> tuple[NextShot, ...]:
    return propose_shots(truth, [Rival("the rest", fit, covariance)], SIGMA, "to part it from", error_rate)


def test_the_next_shots_are_within_the_launcher_and_tell_most(drag: Point) -> None:
    other, known = drag.model.add(effect_class("air_drag")(0.01)), np.diag([1e-3, 1e-4, 1e-3, 1e-3]) ** 2
    shot = shots_for(drag, other, known)[0]
    assert BALL_SPEEDS_M_S[0] <= shot.cue.speed <= BALL_SPEEDS_M_S[1]
    assert np.hypot(shot.cue.side, shot.cue.height) <= MAX_TIP_OFFSET_M + 1e-4
    assert shot.sigmas > 5 and shot.why == "to part it from the rest"
    assert shot.to_dict()["cue"]["speed"] == shot.cue.speed
    same = shots_for(drag, drag.model, np.eye(4) * 1e-8)[0]
    assert same.sigmas < 1.0
    slower = drag.model.with_values({"decoupled_cloth.roll": float(drag.constants[1]) + 5e-5})
    free, held = (shots_for(drag, slower, np.eye(4) * size)[0] for size in (1.0, 1e-16))
    assert free.sigmas < 0.2 * held.sigmas


def test_shots_follow_until_nothing_is_in_doubt(drag: Point) -> None:
    """Each leaves less, the last no more than is allowed, or there are as many as may be told."""
    weak, known = drag.model.add(effect_class("air_drag")(0.0008)), np.diag([1e-3, 1e-4, 1e-3, 1e-3]) ** 2
    shots = shots_for(drag, weak, known, error_rate=0.01)
    doubts = [shot.doubt for shot in shots]
    assert len(shots) > 1 and doubts == sorted(doubts, reverse=True)
    assert doubts[-1] < 0.01 <= doubts[-2] or len(shots) == MAX_NEXT_SHOTS
    assert doubts == pytest.approx(0.5 * np.exp(-np.cumsum([shot.sigmas**2 for shot in shots]) / 8.0), rel=1e-9)
    assert len(set(shots)) == len(shots)
    assert len(shots_for(drag, weak, known, error_rate=0.4)) <= len(shots)


def test_shots_part_all_rivals_and_not_one_alone(drag: Point) -> None:
    """A rival that is far from the truth in every shot is not what the sequence is for."""
    known = np.diag([1e-3, 1e-4, 1e-3, 1e-3]) ** 2
    truth = drag.model.add(effect_class("air_drag")(0.0008))
    far = dataclasses.replace(drag, constants=drag.constants * 1.3)
    rivals = [Rival("far", far, known * 1e-6), Rival("near", drag, known)]
    shots = propose_shots(truth, rivals, SIGMA, "from", 0.01)
    assert shots[-1].why == "from near"


def test_what_clips_may_hide_is_sought_by_shots_that_show_it() -> None:
    """Of two effects the second shows in no shot: there is one for the first alone."""
    planned = shots_to_try(full_model(Table(3.569, 1.778), Ball(0.0525, 0.1406)), 0)[:4]
    apart = np.array([[30.0, 9.0, 1.0, 0.0], [0.1, 0.1, 0.2, 0.1]])
    assert [shot.why for shot in sequence(planned, apart, ("one", "two"), 0.05, whole=False)] == ["one"]
    assert len(sequence(planned, apart, ("one", "two"), 0.05, whole=True)) == 4
    assert (
        value_in_words("factor", 1.00002, 1.0) == "factor = 1 +2e-05"
        and value_in_words("rate", 0.01234, 0.0) == "rate = 0.0123"
    )


def test_a_problem_with_other_balls_has_their_places_as_unknowns(tmp_path: Path) -> None:
    assert generate([str(tmp_path / "cut"), "--seed", "3", "--clips", "2", "--seconds", "1", "--kind", "cut"]) == 0
    clip_set = read_clip_set(tmp_path / "cut")
    problem: ShotProblem = shot_problem(full_model(clip_set.table, clip_set.ball), (), clip_set, SIGMA)
    assert problem.start.shape == (2, 9)
    assert len(problem.steps) == 9
    moved = problem.start.copy()
    moved[:, 7] += 0.001
    one, two = (problem.shot(x[0], 0, np.array([0.0]), clip_set.ball.radius) for x in (problem.start, moved))
    assert two.position[1] - one.position[1] == pytest.approx([0.001, 0.0])
    assert dataclasses.replace(one, position=two.position).velocity is one.velocity


def test_states_may_move_along_with_what_a_camera_reports(tmp_path: Path) -> None:
    """So that a picture on trial is one of the same shot: of a cut, a stretched one would be one of another."""
    now = at_the_truth(tmp_path / "cut", "--clips", "3", "--seconds", "1.5", "--kind", "cut")
    stretched = candidate(effect_class("image_scale")(0.003))
    x = now.problem.seen_alike(now.initial_states, stretched.effect)
    there = now.problem.with_model(now.model.add(stretched.effect), now.names)
    c, rows = np.tile(now.constants, (len(x), 1)), np.arange(len(x))
    before, left, moved = (
        np.nan_to_num(problem.evaluate(states, c, rows))
        for problem, states in ((now.problem, now.initial_states), (there, now.initial_states), (there, x))
    )
    assert np.sum((moved - before) ** 2) < 0.1 * np.sum((left - before) ** 2)
    (row,) = score_all(now, [stretched]).rows
    assert abs(row.values[0]) < 4 * row.sd[0], "nothing is hidden"
