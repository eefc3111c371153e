"""A small series of shots made up for the reports: 12 shots, one refit after six, and all that may go wrong in one.

Shot 3 lost its film, in shot 4 the cue ball fell, shot 8 nobody saw. The cue ball stops STEP times the shot's own
factor away from where it was told, far in the first six shots and near in the others.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from models.shot import Array, Ball, Table
from planner.scene import Goal, Scene, scene_dict
from robot.learning.history import History, PlayedShot, Refit, predicted_stop
from sysid.clips import Clip, Observation

TABLE, BALL = Table(3.569, 1.778), Ball(0.0525, 0.1406)
FAR, NEAR = 0.2, 0.03  # typical miss before and after the refit [m]
NO_FILM, FELL, UNSEEN = 3, 4, 8
FOUND = ("table_tilt", "squirt")


def places(told: Array, spread: float) -> list[list[float]]:
    """Resting places about a middle, with that median distance from it [m]."""
    around = [spread * np.array([math.cos(a), math.sin(a)]) for a in np.arange(8) * math.pi / 4]
    return [(told + step).tolist() for step in around]


def way(start: Array, end: Array, duration: float, every: float) -> tuple[Array, Array]:
    """A ball that slows down along a line: time (n,) [s], places (n, 2) [m]."""
    time = np.arange(0.0, duration + every / 2, every)
    gone = 1 - (1 - time / duration) ** 2
    return time, start + gone[:, None] * (end - start)


def sample_shot(number: int) -> PlayedShot:
    """One shot of the sample."""
    rng = np.random.default_rng(number)
    names, start = ("white", "red"), np.array([[-1.0 + 0.05 * number, -0.3], [0.5, 0.1 + 0.02 * number]])
    wanted = rng.uniform([-1.4, -0.7], [1.4, 0.7])
    scene = Scene(TABLE, BALL, names, start, Goal("white", "red", (1, 1), wanted))
    told = wanted + 0.02 * rng.normal(size=2)
    size = (FAR if number <= 6 else NEAR) * (0.5 + 0.1 * number)
    turn = rng.uniform(0, 2 * math.pi)
    end: Array | None = told + size * np.array([math.cos(turn), math.sin(turn)])
    seen, potted = number != UNSEEN, number % 3 != 0
    tracks = []
    for name, at, stop in zip(names, start, (told, np.array([1.77, 0.88])), strict=True):
        time, xy = way(at, stop, 2.0, 0.1)
        tracks.append({"ball": name, "t": time.tolist(), "xy": xy.tolist()})
    plan: dict[str, Any] = {
        "format": "billiard-plan/1", "scene": scene_dict(scene), "pocket": [1, 1], "learnt": 6 * (number > 6),
        "kind": "cut into the corner pocket +x +y", "tracks": tracks, "places": {"cue": places(told, 0.05 / number)},
        "pot_probability": {"value": 0.5 + 0.03 * number, "low": None, "high": None},
    }  # fmt: skip
    if number == FELL:
        end = None
    played: dict[str, Any] = {
        "format": "billiard-played/1", "struck": "yes", "cue_fell": number == FELL, "potted": potted,
        "pocket": "corner +x +y" if potted else None, "noted": [],
        "cue_end": None if end is None else end.tolist(),
        "from_wanted": None if end is None else float(np.hypot(*(end - wanted))),
    }  # fmt: skip
    if number == NO_FILM:
        played["noted"] = ["the film is lost: the disk is <full>"]
    if not seen:
        end = None
        nothing = ("cue_fell", "potted", "pocket", "cue_end", "from_wanted")
        played = played | dict.fromkeys(nothing) | {"struck": "unknown", "noted": ["the line died"]}
    clip = None
    if number not in (NO_FILM, UNSEEN):
        balls = {}
        for name, at, stop in zip(names, start, (told if end is None else end, np.array([1.6, 0.8])), strict=True):
            time, xy = way(at, stop, 1.2 if number == FELL and name == "white" else 2.0, 1 / 60)
            balls[name] = Observation(time, xy, np.full(len(time), math.nan))
        clip = Clip(f"clips/{number:04d}.csv", "white", balls)
    middle, spread = predicted_stop(plan)
    floor = 0.02 + 0.001 * number if number > 9 else math.nan
    return PlayedShot(
        number, scene, plan["learnt"], middle, spread, plan["pot_probability"]["value"], played["potted"], end, floor,
        plan, played, clip,
    )  # fmt: skip


def sample_story() -> History:
    """The whole series."""
    values = {"decoupled_cloth.roll": (0.0151, 3e-6), "table_tilt.slope_x": (5e-4, 4e-6)}
    launcher = {"tip_restitution": (0.74, 0.01), "cue_mass": (0.5, math.nan)}
    refit = Refit(6, FOUND, "after the cushion +x", 5.2e-4, math.nan, 1.07, values, launcher, 64.2)
    course = {"format": "billiard-course/1", "every": 6, "seed": 3}
    return History(course, tuple(sample_shot(k) for k in range(1, 13)), (refit,), "all 12 shots are played")


def long_story(shots: int = 60, every: int = 10) -> History:
    """A series as it may come out at the emulator, to look at: python -m tests.support.story_samples FOLDER."""
    import dataclasses

    rng = np.random.default_rng(5)
    sizes = [0.24, 0.09, 0.055, 0.04, 0.036, 0.034]
    found = [
        ("table_tilt", "cloth_nap", "cushion_restitution_speed"),
        ("squirt",),
        (),
        ("ball_friction_speed",),
        (),
        (),
    ]
    made, verdict, refits = [], (), []
    for number in range(1, shots + 1):
        block = min((number - 1) // every, len(sizes) - 1)
        start = rng.uniform([-1.6, -0.8], [1.6, 0.8], (2, 2))
        told = rng.uniform([-1.5, -0.7], [1.5, 0.7])
        end = np.clip(told + sizes[block] * rng.lognormal(0, 0.6) * rng.normal(size=2), [-1.75, -0.86], [1.75, 0.86])
        base = sample_shot(2)
        floor = 0.03 * rng.lognormal(0, 0.3)
        spread = (0.04 + 0.02 * (block == 0)) * rng.lognormal(0, 0.3)
        fell = rng.random() < 0.05
        potted = bool(rng.random() < (0.2, 0.5, 0.7, 0.75, 0.8, 0.8)[block])
        scene = dataclasses.replace(base.scene, position=start)
        played = base.played | {"potted": potted, "cue_fell": fell, "from_wanted": None if fell else 0.1 + sizes[block]}
        made.append(
            dataclasses.replace(
                base, number=number, scene=scene, planned_end=told, cue_end=None if fell else end, spread=spread,
                floor=floor, potted=potted, pot_probability=0.8 - 0.1 * rng.random(), played=played,
            )
        )  # fmt: skip
        if number % every == 0:
            verdict = (*verdict, *found[block])
            scale = 1 / math.sqrt(number)
            names = ("ball_impact.restitution", "ball_impact.friction", "cushion_impact.restitution",
                     "cushion_impact.friction", "decoupled_cloth.slide", "decoupled_cloth.roll", "decoupled_cloth.spin",
                     *(f"{name}.size" for name in verdict))  # fmt: skip
            values = {n: (v := 0.3 + 0.1 * k, 0.01 * v * scale) for k, n in enumerate(names)}
            values = {n: (v + sd * rng.normal(), sd) for n, (v, sd) in values.items()}
            launcher = {n: (0.6 + 0.1 * scale * rng.normal(), 0.1 * scale) for n in ("tip_restitution", "cue_mass")}
            left = "" if block else "across the way of rolling balls at the cushion +x"
            refits.append(Refit(number, verdict, left, 5e-4 * (1 + scale), 6e-4, 1 + scale, values, launcher, 60.0))
    course = {"format": "billiard-course/1", "every": every, "seed": 3}
    return History(course, tuple(made), tuple(refits), "nothing is left to learn")


if __name__ == "__main__":
    import sys
    from pathlib import Path

    from robot.learning.report import write_picture, write_recording, write_report

    for name, story in (("sample", sample_story()), ("long", long_story())):
        write_report(Path(sys.argv[1]) / f"{name}.html", story, f"A series made up: {name}")
        write_picture(Path(sys.argv[1]) / f"{name}.png", story)
        write_recording(Path(sys.argv[1]) / f"{name}.rrd", story)
