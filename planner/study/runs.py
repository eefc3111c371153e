"""How plans fare over many random scenes, judged by a truth that the planner does not know.

A scene: balls within a 5 x 6 ft area at one end of the table and a pocket at its edge, as in Robotic Billiards (2015);
the wanted place is where the cue ball stops after a random stroke that pots. The truth: the model's constants moved by
their uncertainty, and one small effect that the model lacks. Strokes are played on it in MuJoCo, with fresh errors of
the launcher. The ceiling is the best that the same search finds when it knows the truth and no place is wanted: chosen
on one set of plays and told on another, the planners' own, so that it is no maximum of luck. Everything drawn for a
scene comes from the study's seed and the scene's number, whoever works it out and when. Leaves out errors that hang
together from shot to shot, and truths that lie farther from the model than its uncertainty says.
"""

from __future__ import annotations

import dataclasses
import math
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.mjcf.snooker import SNOOKER_BALL, SNOOKER_TABLE
from models.model_file import Estimate, Model, effect_class, full_model
from planner.evaluation.outcome import FOULS
from planner.evaluation.play import Player
from planner.evaluation.risk import Hands, deal, judge
from planner.evaluation.value import Wish, distance
from planner.launcher.execution import Execution
from planner.launcher.stroke import AZIMUTH, HEIGHT, SIDE, SPEED, Launcher, stroke_terms
from planner.plan import moving
from planner.scene import POCKETS, Goal, Scene, scene_dict
from planner.search import baseline
from planner.search.candidates import CURVE, THROW, Way, every_way
from planner.search.search import Effort, playable, search

Array = NDArray[np.float64]
FORMAT = "billiard-study-scene/1"
METHODS = ("risk", "ga")
NAMES = ("white", "red", "blue", "pink", "black", "brown", "green", "yellow")
AREA = (1.829, 1.524)  # along and across the table, at its -x end (Robotic Billiards 2015) [m]
AT_AREA = ((-1, 1), (0, 1), (-1, -1), (0, -1))  # pockets at the area's edge
APART = 3.0  # centres of two balls, over the radius
FREE = 0.01  # of the object ball from a cushion [m]
CUT = math.radians(65)  # beyond which no one would call the pocket
TRIES = 2000  # scenes drawn for one that can be played
FANNED = 512  # strokes drawn for one that pots
CHOSEN = 64  # plays that the ceiling's strokes are put in order by, before they are judged anew
EVERY, FINEST = 0.04, 4  # between the points of a track [s]; decimals that are kept of places [m]
# How well constants are known that a model tells no uncertainty of: estimates.
PRIORS = {
    "decoupled_cloth.slide": 0.005, "decoupled_cloth.roll": 0.0002, "decoupled_cloth.spin": 0.5,
    "ball_impact.restitution": 0.01, "ball_impact.friction": 0.005,
    "cushion_impact.restitution": 0.02, "cushion_impact.friction": 0.01,
}  # fmt: skip
USUAL = {"ball_impact.restitution": 0.89, "cushion_impact.restitution": 0.98}  # Mathavan 2010, 2014
# What a truth may hold that no model knows, and how much of its natural size; of squirt, what its correction leaves.
UNMODELLED = {
    "table_tilt": 0.4, "cloth_nap": 0.25, "speed_drag": 0.25, "air_drag": 0.25, "side_curve": 0.25,
    "slide_friction_speed": 0.25, "spin_decay_speed": 0.25, "spin_slide_coupling": 0.25, "off_centre_ball": 0.25,
    "cushion_restitution_speed": 0.25, "cushion_friction_speed": 0.25, "ball_friction_speed": 0.25,
    "ball_restitution_speed": 0.25, "cue_ball_mass": 0.25, "squirt": 0.1,
}  # fmt: skip
SCENE, TRUTH, PLAN, SEEN, CHOICE = range(5)  # what is drawn, each from a stream of its own


@dataclass(frozen=True)
class Study:
    """What every scene of a study shares."""

    model: Model
    execution: Execution = field(default_factory=Execution)
    balls: int = 2
    seed: int = 0
    method: str = "both"
    plays: int = 200  # that a stroke is judged by
    effort: Effort = field(default_factory=Effort)
    wish: Wish = field(default_factory=Wish)

    def __post_init__(self) -> None:
        """BadInput for what no scene could be drawn from."""
        if self.method not in ("both", *METHODS):
            raise BadInput(f"method is {self.method!r}; choose from both, {', '.join(METHODS)}")
        if not 2 <= self.balls <= len(NAMES):
            raise BadInput(f"{self.balls} balls; give 2 to {len(NAMES)}")
        if self.seed < 0:
            raise BadInput(f"seed {self.seed}; give 0 or more")
        if not self.model.table.pockets:
            raise BadInput("the model's table has no pockets; give a model of one that has")

    @property
    def methods(self) -> tuple[str, ...]:
        """Those that plan."""
        return METHODS if self.method == "both" else (self.method,)

    def number(self, scene: int, part: int) -> int:
        """A seed for one part of a scene."""
        return int(np.random.SeedSequence([self.seed, scene, part]).generate_state(1)[0])


def usual_model() -> Model:
    """The base on a full-size table with Mathavan's constants, known as well as the priors say."""
    model = full_model(SNOOKER_TABLE, SNOOKER_BALL).with_values(USUAL)
    return dataclasses.replace(model, estimates={k: Estimate(sd, "prior of the study") for k, sd in PRIORS.items()})


def draw_scene(study: Study, number: int) -> tuple[Scene, int]:
    """The scene of that number, and how many were drawn for it."""
    model, rng = study.model, np.random.default_rng(study.number(number, SCENE))
    names = NAMES[: study.balls]
    for tries in range(1, TRIES + 1):
        position = _places(model, study.balls, rng)
        if position is None:
            continue
        goal = Goal(names[0], names[1], None, avoid=names[2:])
        scene = Scene(model.table, model.ball, names, position, goal)
        direct = [w for w in every_way(scene) if w.bank < 0 and w.kick < 0 and not w.lies and w.cut < CUT]
        called = [w for w in direct if POCKETS[w.pocket] in AT_AREA]
        if not called:
            continue
        way = called[int(rng.integers(len(called)))]
        scene = dataclasses.replace(scene, goal=dataclasses.replace(goal, pocket=POCKETS[way.pocket]))
        rest = _reachable(Player(model, scene, Launcher(), threads=1), way, rng)
        if rest is not None:
            return dataclasses.replace(scene, goal=dataclasses.replace(scene.goal, rest=rest)), tries
    raise BadInput(f"no playable scene of {study.balls} balls in {TRIES} drawn; give fewer --balls, or another --model")


def _places(model: Model, count: int, rng: np.random.Generator) -> Array | None:
    """Places of balls (count, 2) [m] in the area; None where they lie too near to each other."""
    reach, end = model.table.centre_limits(model.ball), model.table.length / 2
    low = np.array([-reach[0], -min(AREA[1] / 2, reach[1])])
    high = np.array([min(AREA[0] - end, reach[0]), -low[1]])
    # The object ball is drawn from what is free of cushions.
    edge = np.zeros((count, 2))
    edge[1] = FREE
    low, high = np.maximum(low, -reach + edge), np.minimum(high, reach - edge)
    xy = np.round(low + (high - low) * rng.random((count, 2)), FINEST)
    one, other = np.triu_indices(count, 1)
    near = np.hypot(*(xy[one] - xy[other]).T) < APART * model.ball.radius
    return None if near.any() else np.clip(xy, low, high)


def _reachable(player: Player, way: Way, rng: np.random.Generator) -> Array | None:
    """Where the cue ball stops after a random stroke along a way that pots without a foul; None where none does."""
    scene, launcher = player.scene, player.launcher
    limit = launcher.offset * scene.ball.radius
    off, angle = limit * np.sqrt(rng.random(FANNED)), 2 * np.pi * rng.random(FANNED)
    q = np.empty((FANNED, 4))
    q[:, SIDE], q[:, HEIGHT], q[:, AZIMUTH] = off * np.cos(angle), off * np.sin(angle), way.aim
    q[:, SPEED] = rng.uniform(launcher.slowest, launcher.fastest, FANNED) * launcher.gain(q, scene.ball)
    q[:, AZIMUTH] -= player.deflection(q)  # the model's own squirt
    width = scene.ball.diameter / max(way.run, scene.ball.diameter)
    half = THROW * width + CURVE * np.abs(q[:, SIDE]) / limit * min(1.0, way.run) + 0.002
    q[:, AZIMUTH] += half * rng.uniform(-1, 1, FANNED)
    out = player.screen(q)
    good = np.flatnonzero(out.made & np.isfinite(out.cue[:, 0]))
    if good.size == 0:
        return None
    reach = scene.table.centre_limits(scene.ball)
    return np.clip(np.round(out.cue[good[int(rng.integers(good.size))]], 3), -reach, reach)


def draw_truth(study: Study, number: int) -> tuple[Model, dict[str, Any]]:
    """What the scene of that number is judged on, without uncertainty, and what was drawn for it."""
    model = study.model
    known = {n: e for n, e in model.estimates.items() if 0 < e.sd < math.inf}
    known = {n: Estimate(PRIORS[n]) for n in model.parameters() if n in PRIORS} | known
    seed = study.number(number, TRUTH)
    moved = deal(dataclasses.replace(model, estimates=known), Execution(), 1, seed).values
    constants = {name: float(v[0]) for name, v in moved.items()}
    rng = np.random.default_rng([seed, 1])
    held = {e.name() for e in model.effects if not e.is_off()}
    names = [name for name in UNMODELLED if name not in held]
    name = names[int(rng.integers(len(names)))]
    values = _sizes(name, rng)
    truth = dataclasses.replace(model.with_values(constants), estimates={}, fitted={})
    return truth.add(effect_class(name)(**values)), {"effect": name, "values": values, "constants": constants}


def _sizes(name: str, rng: np.random.Generator) -> dict[str, float]:
    """A part of an effect's natural size, to either side where it may go there; a slope to any."""
    turn = rng.uniform(0, 2 * np.pi)
    out = {}
    for k, (key, meta) in enumerate(effect_class(name).parameters().items()):
        if meta["off"] is None:
            continue
        size = UNMODELLED[name] * (meta["default"] - meta["off"])
        low = meta["bounds"][0]
        way = 1.0 if name != "table_tilt" and meta["off"] - abs(size) < low else math.cos(turn - k * np.pi / 2)
        if name != "table_tilt":
            way = math.copysign(1.0, way)
        out[key] = float(meta["off"] + way * size)
    return out


def study_scene(study: Study, number: int) -> dict[str, Any]:
    """One scene: drawn, planned, judged; what goes wrong in it is told as its "error", and it counts as no scene."""
    began = time.perf_counter()
    head: dict[str, Any] = {"format": FORMAT, "number": number}
    try:
        scene, tries = draw_scene(study, number)
        told = head | {"scene": scene_dict(scene), "tries": tries} | _studied(study, number, scene)
    except BadInput:
        raise
    except Exception as error:  # noqa: BLE001 (a fault in one scene must not end the others)
        last = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__} in {Path(last.filename).name} line {last.lineno}: {error}"
        told = head | {"error": " ".join(text.split()), "seconds": {}}
    told["seconds"]["all"] = time.perf_counter() - began
    return told


def _studied(study: Study, number: int, scene: Scene) -> dict[str, Any]:
    launcher = Launcher()
    player = Player(study.model, scene, launcher, threads=1)
    model, drawn = draw_truth(study, number)
    truth = Player(model, scene, launcher, threads=1)
    hands = deal(model, study.execution, study.plays, study.number(number, SEEN))
    seconds, methods, strokes = {}, {}, []
    for method in study.methods:
        began = time.perf_counter()
        q = PLANNERS[method](study, player, study.number(number, PLAN))
        seconds[method] = time.perf_counter() - began
        methods[method] = _told(study, number, player, truth, hands, q)
        if q is not None:
            strokes.append((method, q))
    ceiling = _ceiling(study, number, truth, hands, strokes)
    return {"truth": drawn, "methods": methods, "ceiling": ceiling, "seconds": seconds}


def _risk(study: Study, player: Player, seed: int) -> Array | None:
    found = search(player, study.execution, study.wish, seed=seed, effort=study.effort)
    return found[0].judged.q if found else None


def _ga(study: Study, player: Player, seed: int) -> Array | None:
    _, q, cost = baseline.search(player, seed=seed)
    if cost > baseline.ABOVE:
        return None
    rows, _ = playable(player, q[None], np.zeros(1, np.int64))
    return rows[0] if len(rows) else None


PLANNERS: dict[str, Callable[[Study, Player, int], Array | None]] = {"risk": _risk, "ga": _ga}


def _told(study: Study, number: int, player: Player, truth: Player, hands: Hands, q: Array | None) -> dict[str, Any]:
    """What was promised of a stroke and what became of it; no stroke pots nothing."""
    if q is None:
        none = {"potted": 0.0, "made": 0.0, "foul": 0.0, "fouls": dict.fromkeys(FOULS, 0.0), "away": []}
        return {"stroke": None, "predicted": None, "seen": none | {"median": None, "median_all": None}}
    # The plays by which the search chose among its last few: what a plan file promises.
    fresh = deal(player.model, study.execution, study.effort.fresh, study.number(number, PLAN) + 1)
    judged = judge(player, fresh, q[None], study.wish, mujoco=True)[0]
    tracks = moving(player.tracks(q[None], every=EVERY)[0])
    return {
        "stroke": stroke_terms(player.launcher, q), "predicted": judged.figures(player.scene),
        "seen": _seen(truth, hands, q),
        "tracks": [{"ball": t["ball"], "xy": np.round(t["xy"], FINEST).tolist()} for t in tracks],
    }  # fmt: skip


def _seen(truth: Player, hands: Hands, q: Array) -> dict[str, Any]:
    """A stroke played on the truth."""
    out = hands.play(truth, q[None], mujoco=True)
    away = distance(truth.scene, out)
    rests = np.isfinite(away)
    mine = np.sort(away[out.potted & rests])
    return {
        "potted": float(out.potted.mean()), "made": float(out.made.mean()), "foul": float(out.foul.mean()),
        "fouls": {name: float(out.fouls[:, k].mean()) for k, name in enumerate(FOULS)},
        "away": np.round(mine, FINEST).tolist(), "median": float(np.median(mine)) if mine.size else None,
        "median_all": float(np.median(away[rests])) if rests.any() else None,
    }  # fmt: skip


def _ceiling(
    study: Study, number: int, truth: Player, hands: Hands, strokes: list[tuple[str, Array]]
) -> dict[str, Any]:
    """The best pot that the truth allows: chosen on plays of its own, told on the planners'."""
    effort = dataclasses.replace(study.effort, fresh=min(study.effort.fresh, CHOSEN))
    asked = Wish(rest=0.0, foul=0.0)
    found = search(truth, study.execution, asked, seed=study.number(number, CHOICE), effort=effort)
    offered = [("search", f.judged.q) for f in found] + strokes
    if not offered:
        return {"potted": 0.0, "made": 0.0, "by": None, "stroke": None}
    others = deal(truth.model, study.execution, study.plays, study.number(number, CHOICE) + 2)
    rows = np.array([q for _, q in offered])
    best = int(np.argmax([j.made for j in judge(truth, others, rows, asked, mujoco=True)]))
    by, q = offered[best]
    out = hands.play(truth, q[None], mujoco=True)
    told = stroke_terms(truth.launcher, q)
    return {"potted": float(out.potted.mean()), "made": float(out.made.mean()), "by": by, "stroke": told}
