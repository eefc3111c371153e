"""MuJoCo against the analytic spin models and against published measurements, figure by figure.

In: counts of states and shots. Out: `MatchResult`s, each an error with its tolerance.

Two models with the same constants are moved by `mj_step`: the native MJCF, tuned as well as its terms allow
(models/mjcf/native.py), and MJCF with effects (models/mujoco). Each plays the same shots as the analytic models, in
closed form (models/analytic) and from event to event (models/engine), which share the formulas of effects, but neither
time steps nor contacts. Finally every effect of the catalogue is tested at its usual size.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from models.analytic import cloth
from models.effect_catalogue import catalogue
from models.engine.play import lacking, play
from models.model_file import full_model
from models.mujoco import stroke
from models.shot import Array, Shot, Track
from models.simulation.observe import observed
from models.simulation.simulate import simulate
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE
from sysid.validation.match_result import MatchResult
from sysid.validation.published import CUSHION_2009, CUSHION_2010, OBLIQUE_2009
from sysid.validation.shots import (
    ANALYTIC_MODEL,
    FULL_TABLE,
    MATHAVAN_TABLE,
    OPEN_TABLE,
    RANDOM_SEED,
    ROLLING_FRICTION,
    SLIDING_FRICTION,
    SPIN_DECELERATION,
    impact_shot,
    impact_states,
    pocket_shots,
    random_shots,
    random_states,
    two_ball_shots,
)
from sysid.validation.tested_models import SETTLING_TIME_S, ModelUnderTest, in_mujoco, models_under_test

OPEN_TOLERANCE_MM, IMPACT_TOLERANCES = 1.0, {"ball": (0.1, 0.4), "cushion": (0.2, 0.6)}  # median and worst [%]
SOME_EFFECTS = ("table_tilt", "cushion_restitution_speed", "ball_friction_speed")


def motion(tested: ModelUnderTest, count: int = 500) -> list[MatchResult]:
    """Errors of position and sidespin on open cloth over 3 s, with random speeds and spins."""
    velocity, spin = random_states(count)
    times = np.linspace(0, 3, 61)
    still = np.zeros((1, 2))
    tracks = tested(
        OPEN_TABLE, [Shot(("white",), still, v[None], w[None], times) for v, w in zip(velocity, spin, strict=True)]
    )
    xy, _, turning = cloth.state_at(
        times, np.zeros((count, 1, 2)), velocity[:, None], spin[:, None], SNOOKER_BALL.radius,
        SLIDING_FRICTION, ROLLING_FRICTION, SPIN_DECELERATION,
    )  # fmt: skip
    away = np.array([np.linalg.norm(t.position[:, 0] - p, axis=-1).max() for t, p in zip(tracks, xy, strict=True)])
    side = np.array([np.abs(t.spin[:, 0, 2] - w[:, 2]).max() for t, w in zip(tracks, turning, strict=True)])
    effects = tested.name == "effects"
    name = f"cloth, {count} random states, 3 s"
    return [
        MatchResult(f"{name}: position, worst", tested.name, 1e3 * away.max(), "mm",
            OPEN_TOLERANCE_MM if effects else None),
        MatchResult(f"{name}: position, median", tested.name, 1e3 * float(np.median(away)), "mm"),
        MatchResult(f"{name}: sidespin, worst", tested.name, 100 * float(np.max(side / np.abs(spin[:, 2]))), "%"),
    ]  # fmt: skip


def impacts(tested: ModelUnderTest, kind: str, count: int = 500) -> list[MatchResult]:
    """Errors of velocity and R omega after an impact against the impulse models, over the speed before it."""
    after = SETTLING_TIME_S[tested.name]
    found = []
    label = {"ball": "ball-ball", "cushion": "cushion"}[kind]
    tolerance = IMPACT_TOLERANCES[kind] if tested.name == "effects" else (None, None)
    for name, states in zip(("golden", f"{count} random"), impact_states(kind, count), strict=True):
        shots = [impact_shot(kind, v, angle, top, side, after) for v, angle, top, side in states]
        ours, theirs = tested(MATHAVAN_TABLE, shots), play(ANALYTIC_MODEL, shots)
        v = np.array([np.abs(a.velocity[-1] - b.velocity[-1]).max() for a, b in zip(ours, theirs, strict=True)])
        w = np.array([np.abs(a.spin[-1] - b.spin[-1]).max() for a, b in zip(ours, theirs, strict=True)])
        for what, error in (("velocity", v / states[:, 0]), ("R omega", SNOOKER_BALL.radius * w / states[:, 0])):
            case = f"{label}, {name}: {what}"
            found.append(MatchResult(f"{case}, median", tested.name, 100 * float(np.median(error)), "%", tolerance[0]))
            found.append(MatchResult(f"{case}, worst", tested.name, 100 * float(error.max()), "%", tolerance[1]))
    return found


def _ends(tracks: Sequence[Track]) -> list[Array]:
    return [t.position[-1] for t in tracks]


def _apart(one: Sequence[Array], other: Sequence[Array]) -> Array:
    return np.array([np.linalg.norm(a - b, axis=-1).max() for a, b in zip(one, other, strict=True)])


def whole_shots(tested: ModelUnderTest, count: int = 200, moved: float = 1e-6) -> list[MatchResult]:
    """Errors of the positions of all balls when the struck ball of the analytic model stops.

    The analytic figure is the sensitivity: the error of the analytic model with every ball displaced by a micrometre.
    """
    shots, tracks = random_shots(count)
    rng = np.random.default_rng(RANDOM_SEED)
    other = [
        dataclasses.replace(s, position=s.position + moved * rng.choice([-1.0, 1.0], s.position.shape)) for s in shots
    ]
    away = 1e3 * _apart(_ends(tested(MATHAVAN_TABLE, shots)), _ends(tracks))
    sensitivity = 1e3 * _apart(_ends(play(ANALYTIC_MODEL, other)), _ends(tracks))
    name, tolerances = (
        f"whole shots, {count}, 1 to 4 impacts",
        (2.0, 10.0) if tested.name == "effects" else (None, None),
    )
    return [
        MatchResult(
            f"{name}: median", tested.name, float(np.median(away)), "mm", tolerances[0], float(np.median(sensitivity))
        ),
        MatchResult(
            f"{name}: 9 in 10",
            tested.name,
            float(np.quantile(away, 0.9)),
            "mm",
            tolerances[1],
            float(np.quantile(sensitivity, 0.9)),
        ),
        MatchResult(f"{name}: worst", tested.name, float(away.max()), "mm", None, float(sensitivity.max())),
    ]


def roughness(tested: ModelUnderTest, count: int = 200) -> list[MatchResult]:
    """Largest second difference of end points over a 0.2 % sweep of sliding friction: with a ball, with cushions."""
    direction = np.array([np.cos(0.42), np.sin(0.42)])
    velocity, spin = np.array([1.8 * direction, [0, 0]]), np.array([[5.0, 20.0, 25.0], [0, 0, 0]])
    places = np.array([[-0.6, -0.3], [-0.6, -0.3] + 0.5 * direction + 0.02 * np.array([-direction[1], direction[0]])])
    shot = Shot(("white", "red"), places, velocity, spin, np.array([0.0, 20.0]))
    slides = np.linspace(0.999, 1.001, count)
    name = "native.slide" if tested.name == "native" else "decoupled_cloth.slide"
    model = tested.model.with_values({name: tested.model.parameters()[name] * slides})
    rough = np.abs(np.diff(np.array(_ends(simulate(model, [shot] * count))), 2, axis=0)).max()
    return [MatchResult("roughness of end points over friction", tested.name, 1e6 * float(rough), "um")]


def more_shots(what: str, count: int = 200) -> list[MatchResult]:
    """Compare whole shots on the full table, with "effects" or with "jaws", between MuJoCo and the event engine.

    With jaws, shots go into the mouths of pockets: those with another outcome are counted, the others compared.
    """
    model, jaws = full_model(SNOOKER_TABLE if what == "jaws" else FULL_TABLE, SNOOKER_BALL), what == "jaws"
    for name in SOME_EFFECTS if what == "effects" else ():
        model = model.add(catalogue()[name]())
    shots = pocket_shots(count) if jaws else two_ball_shots(count)
    away, other = [], 0
    for one, two in zip(
        simulate(model, shots, jaws=jaws), simulate(in_mujoco(model), shots, jaws=jaws), strict=True
    ):  # fmt: skip
        events = [[(e.kind, e.rail) for e in track.events[:4]] for track in (one, two)]
        end = one.events[4].time - 0.02 if len(one.events) > 4 else np.inf
        if jaws and ("pocket" in str(events[0])) != ("pocket" in str(events[1])):
            other += 1
            continue
        away.append(1e3 * float(np.nanmax(np.abs(one.position - two.position)[one.times < end])))
    case = f"whole shots with {'jaws' if jaws else 'three effects'}, {count}, up to 4 impacts"
    found = [MatchResult(f"{case}: median", "effects", float(np.median(away)), "mm", 5.0 if jaws else 3.0)]
    if jaws:
        found.append(MatchResult(f"{case}: with another outcome", "effects", 100 * other / count, "%"))
    return found


def energy(count: int = 2000) -> list[MatchResult]:
    """Largest rise of energy in random shots between samples 20 ms apart, over the initial energy."""
    model, rises = in_mujoco(full_model(FULL_TABLE, SNOOKER_BALL)), np.zeros(count)
    shots = [dataclasses.replace(s, times=np.linspace(0, 3, 151)) for s in two_ball_shots(count)]
    for k, track in enumerate(simulate(model, shots)):
        spin = 0.4 * SNOOKER_BALL.radius**2 * np.sum(track.spin**2, axis=-1)
        kinetic = np.sum(np.sum(track.velocity**2, axis=-1) + spin, axis=-1)
        so_far = np.minimum.accumulate(np.maximum(kinetic[1:], kinetic[:-1]))  # a contact stores some for a moment
        rises[k] = np.max(kinetic[2:] - so_far[:-1]) / kinetic[0]
    return [
        MatchResult(f"energy, {count} shots: largest rise over the start's", "effects", float(rises.max()), "1", 1e-3)
    ]


def rebounds(tested: ModelUnderTest | None, pairs: Sequence[tuple[float, float]]) -> Array:
    """Rebound speeds of a ball rolling straight at a cushion: (n,) [m/s]; None means the analytic model."""
    after = SETTLING_TIME_S[tested.name if tested else "analytic"]
    shots = [impact_shot("cushion", v, 0.0, 1.0, 0.0, after) for v, _ in pairs]
    tracks = tested(MATHAVAN_TABLE, shots) if tested else play(ANALYTIC_MODEL, shots)
    return np.array([-t.velocity[-1, 0, 0] for t in tracks])


def obliques(tested: ModelUnderTest | None) -> Array:
    """Speeds of both rolling balls and deflection of the cue ball at the published cuts: (n, 3) [m/s, deg]."""
    after = SETTLING_TIME_S[tested.name if tested else "analytic"]
    shots = [impact_shot("ball", v, np.radians(cut), 1.0, 0.0, after) for v, cut, *_ in OBLIQUE_2009]
    tracks = tested(MATHAVAN_TABLE, shots) if tested else play(ANALYTIC_MODEL, shots)
    rolling = np.array([cloth.rolling_velocity(t.velocity[-1], t.spin[-1], SNOOKER_BALL.radius) for t in tracks])
    speed = np.linalg.norm(rolling, axis=-1)
    into = np.array([np.radians(cut) for _, cut, *_ in OBLIQUE_2009])
    deflection = np.degrees(np.arctan2(rolling[:, 0, 1], rolling[:, 0, 0]) - into)
    return np.column_stack([speed, deflection])


def published(tested: ModelUnderTest) -> list[MatchResult]:
    """Rms errors against measurements: rebound speeds, speeds after oblique collisions, and deflections."""
    found = []
    for title, pairs in (("2010, 19", CUSHION_2010), ("2009, 8", CUSHION_2009)):
        for part, top in (("all", 9.0), ("below 2.5 m/s", 2.5)):
            few = [p for p in pairs if p[0] < top]
            miss = [rebounds(who, few) - np.array(few)[:, 1] for who in (tested, None)]
            rms = [float(np.sqrt(np.mean(m**2))) for m in miss]
            found.append(MatchResult(f"rebounds of Mathavan {title}, {part}", tested.name, rms[0], "m/s", None, rms[1]))
    measured = np.array(OBLIQUE_2009)[:, 2:]
    miss = [obliques(who) - measured for who in (tested, None)]
    speeds = [100 * float(np.sqrt(np.mean((m[:, :2] / measured[:, :2]) ** 2))) for m in miss]
    angles = [float(np.sqrt(np.mean(m[:, 2] ** 2))) for m in miss]
    name = "oblique collisions of Mathavan 2009"
    return [
        *found,
        MatchResult(f"{name}, 10 speeds", tested.name, speeds[0], "%", None, speeds[1]),
        MatchResult(f"{name}, 5 deflections", tested.name, angles[0], "deg", None, angles[1]),
    ]


def cueing(few: bool = False) -> list[MatchResult]:
    """Rms errors of the launcher's strokes in MuJoCo against the cueing model, over a grid of speeds and offsets."""
    asked = stroke.SMALL_GRID if few else stroke.PAPER_GRID
    launcher = stroke.machine()
    wrong = stroke.errors(launcher, asked, stroke.played(launcher, asked))
    parts = (("ball speed", "%", 0.5), ("R omega over speed", "%", 4.0), ("squirt", "deg", 0.07))
    return [
        MatchResult(f"launcher's tip, {len(asked)} strokes: {what}, rms", "effects", float(rms), unit, tolerance)
        for (what, unit, tolerance), rms in zip(parts, np.sqrt(np.mean(wrong**2, axis=0)), strict=True)
    ]


def playable_effects() -> list[str]:
    """Effects of the catalogue that the event engine can play, without the base's; "" for none."""
    base = full_model(FULL_TABLE, SNOOKER_BALL)
    found = [n for n in catalogue() if n not in {e.name() for e in base.effects}]
    return ["", *(n for n in found if not lacking(base.add(catalogue()[n]())))]


def effect(name: str, count: int = 40) -> list[MatchResult]:
    """Distance between the tracks of MuJoCo and the engine with an effect at its usual size, "" for none."""
    model, shots = full_model(FULL_TABLE, SNOOKER_BALL), two_ball_shots(count)
    if name:
        model = model.add(catalogue()[name]())
    early, whole = np.zeros(count), np.zeros(count)
    for k, (a, b) in enumerate(zip(observed(in_mujoco(model), shots), observed(model, shots), strict=True)):
        away = np.linalg.norm(a.position - b.position, axis=-1).max(axis=1)
        second = min((t.events[1].time for t in (a, b) if len(t.events) > 1), default=np.inf)
        early[k], whole[k] = away[a.times < second].max(), away.max()
    case = f"effect {name or 'none'}, {count} shots of two balls"
    tolerance = None if name == "cushion_contact_time" else 2.0  # the event engine represents it by a delay
    return [
        MatchResult(
            f"{case}: before the second impact, median", "effects", 1e3 * float(np.median(early)), "mm", tolerance
        ),
        MatchResult(f"{case}: median", "effects", 1e3 * float(np.median(whole)), "mm"),
    ]


def rows(count: int = 500, shots: int = 200, few: bool = False) -> Iterator[MatchResult]:
    """Yield all results: `count` states and impacts, `shots` whole shots, `few` strokes of the launcher."""
    native, effects = models_under_test()
    parts: list[Callable[[], list[MatchResult]]] = []
    for p in (native, effects):
        parts.append(partial(motion, p, count))
        parts += [partial(impacts, p, kind, count) for kind in ("ball", "cushion")]
        parts += [partial(whole_shots, p, shots), partial(roughness, p, shots)]
        parts.append(partial(published, p))
    parts += [partial(more_shots, what, shots) for what in ("effects", "jaws")]
    parts += [partial(energy, 10 * shots), partial(cueing, few)]
    parts += [partial(effect, name, min(shots, 40)) for name in playable_effects()]
    for part in parts:
        yield from part()
