"""Pockets with jaws: shots end alike in MuJoCo and in the event engine, effects are told of jaws, what goes without."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from models import record as rec
from models.analytic.geometry import TableGeometry
from models.analytic.pocket import JAW_RAILS, outward, pockets_of
from models.effect_catalogue import effect_class
from models.engine.impacts import describe, part
from models.engine.play import finish, play
from models.engine.workspace import Contact, Pair
from models.model_file import Model, full_model
from models.shot import UNKNOWN_SESSION, Shot, Track
from models.simulation.simulate import simulate
from tests.support.pocket_shots import BALL, HALF, TABLE, R, into_pockets

POCKETS = pockets_of(TABLE, BALL)


def model(effect: str = "", engine: str = "mujoco") -> Model:
    """Mathavan's restitutions, and one more effect at its usual size."""
    values = {"ball_impact.restitution": 0.89, "cushion_impact.restitution": 0.98}
    base = dataclasses.replace(full_model(TABLE, BALL).with_values(values), engine=engine)
    return base.add(effect_class(effect)()) if effect else base


def fates(track: Track) -> list[tuple[str, tuple[str, ...], str]]:
    return [(e.kind, e.balls, e.rail) for e in track.events]


@pytest.mark.parametrize("effect", ["", "table_tilt", "slide_friction_speed"])
@pytest.mark.parametrize("balls", [1, 2])
def test_shots_into_pockets_have_the_same_fate_in_both(balls: int, effect: str) -> None:
    shots = into_pockets(102, 8, balls)
    both = zip(play(model(effect), shots, jaws=True), simulate(model(effect), shots, jaws=True), strict=True)
    potted, touched, far = 0, 0, []
    for a, b in both:
        if fates(a) != fates(b):  # a hair decides, where it rattles
            continue
        assert (np.isnan(a.position) == np.isnan(b.position)).mean() > 0.95
        far.append(np.nanmax(np.abs(a.position - b.position)))
        kinds = [e.kind for e in a.events if e.balls[0] == "ab"[balls - 1]]
        potted += "pocket" in kinds
        touched += "cushion" in kinds and "pocket" in kinds
    assert len(far) > 0.95 * len(shots) and np.median(far) < 3e-3
    assert 30 < potted < 100
    assert touched > 10  # fall off a jaw


def test_without_the_option_pockets_are_mouths() -> None:
    shots = into_pockets(24, 3, 1)
    plain, bent = simulate(model(), shots), simulate(model(), shots, jaws=True)
    same = [(a, b) for a, b in zip(play(model(), shots), plain, strict=True) if fates(a) == fates(b)]
    assert len(same) >= len(shots) - 1, "one comes to a mouth's edge by 40 um"
    assert max(np.nanmax(np.abs(a.position - b.position)) for a, b in same) < 1e-2
    assert [fates(a) for a in plain] != [fates(b) for b in bent]


@pytest.mark.parametrize("engine", ["events", "mujoco"])
def test_a_jaw_met_with_balls_close_by_ends_the_shot(engine: str) -> None:
    # Three balls together before a corner and a middle: springs for them, impulses for the jaws.
    d = 2 * R + 1e-9
    triangle = d * np.array([[0.0, 0.0], [-0.5, -np.sqrt(0.75)], [0.5, -np.sqrt(0.75)], [0.0, -4.0]])
    shots = []
    for place, turn in ((HALF - 0.055, -np.pi / 4), (np.array([0.03, HALF[1] - 0.03]), 0.0)):
        c, s = np.cos(turn), np.sin(turn)
        m = np.array([[c, -s], [s, c]])
        v = np.zeros((4, 2))
        v[3] = m @ [0.02, 2.0]
        shots.append(Shot(tuple("abcd"), place + triangle @ m.T, v, np.zeros((4, 3)), np.linspace(0, 6, 61)))
    for track in simulate(model(engine=engine), shots, jaws=True):
        assert {"ball", "cushion", "pocket"} <= {e.kind for e in track.events}
        last = track.position[-1][~np.isnan(track.position[-1, :, 0])]
        gap = np.linalg.norm(last[:, None] - POCKETS.jaws[:, :2], axis=-1) - POCKETS.jaws[:, 2]
        assert gap.min() > -1e-6


@pytest.mark.parametrize("effect", ["", "table_tilt", "speed_drag", "off_centre_ball"])
def test_what_comes_back_from_between_the_jaws_rolls_on(effect: str) -> None:
    """Out of a pocket over the line of its cushions, whatever pushes it: no look at that line goes on for ever."""
    p, v, w = (np.array([getattr(s, k) for s in into_pockets(600, 5, 1)]) for k in ("position", "velocity", "spin"))
    end = finish(model(effect), p, v, w, jaws=True, events=8, most=2000)
    assert np.isfinite(end.time).all()
    back = ~end.potted[:, 0] & (end.event[..., 2] >= 4).any(axis=1)
    assert back.sum() > 30 and not end.velocity.any()


def test_effects_are_told_the_rail_of_a_jaw_and_its_own_normal() -> None:
    jaw = POCKETS.jaws[2]
    b, hit = np.zeros((1, 7)), np.zeros(rec.IMPACT_FIELDS)
    b[0, :2], b[0, 2] = jaw[:2] + jaw[2] * np.array([-0.6, 0.8]), 0.5
    describe(hit, b, Contact(0, -1, 6, *outward(6, b[0, 0], b[0, 1], POCKETS.jaws)), R, UNKNOWN_SESSION.row, 0.0)
    assert hit[rec.APPROACH] == pytest.approx(0.3)
    assert hit[rec.SECOND] == JAW_RAILS[2]


def test_what_lies_in_a_jaw_is_put_back_to_where_it_touches() -> None:
    b = np.zeros((1, 2))
    b[0] = POCKETS.jaws[5, :2] + (POCKETS.jaws[5, 2] - 1e-4) * np.array([0.6, -0.8])
    part(b, Pair(0, -1, 9), TableGeometry(R, TABLE.centre_limits(BALL), HALF, *POCKETS))
    assert b[0] == pytest.approx(POCKETS.jaws[5, :2] + POCKETS.jaws[5, 2] * np.array([0.6, -0.8]), abs=1e-15)


@pytest.mark.parametrize("engine", ["events", "mujoco"])
def test_a_ball_that_is_known_to_stay_does_so(engine: str) -> None:
    shots = [dataclasses.replace(s, staying=("a",)) for s in into_pockets(24, 3, 1)]
    assert all(e.kind != "pocket" for track in simulate(model(engine=engine), shots, jaws=True) for e in track.events)


def test_jaws_without_the_effects_that_meet_them_are_refused() -> None:
    shots = into_pockets(1, 3, 1)
    bare = dataclasses.replace(model(), effects=())
    with pytest.raises(ValueError, match="cloth, ball, cushion"):
        simulate(bare, shots, jaws=True)
    some = tuple(e for e in model().effects if e.name() != "cushion_impact")
    with pytest.raises(ValueError, match="none for cushion: add"):
        simulate(dataclasses.replace(model(), effects=some), shots, jaws=True)
