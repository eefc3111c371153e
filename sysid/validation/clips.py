"""Shots of the analytic models as a clip set, with the native MJCF as a model to fit to them.

In: a folder. Out: a clip set in it, and native.toml. `sysid compare` and `fit` then show where MuJoCo's native contact
differs from the analytic models, and which effects compensate for it, as they would on a real table.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from models.engine.play import play
from models.model_file import Model, write_model
from models.shot import Shot
from models.table.snooker import SNOOKER_BALL
from sysid.clips import Clip, ClipSet, Observation, write_clip_set
from sysid.validation.shots import ANALYTIC_MODEL, MATHAVAN_TABLE

POSITION_NOISE_M, ANGLE_NOISE_RAD = 2e-4, 0.02  # noise of positions, and of the white ball's mark
CAMERA_FPS = 120.0
SHOT_KINDS = ("open", "ball", "cushion")
CLIP_COUNT = 30
RANDOM_SEED = 11


def _shot(kind: str, rng: np.random.Generator) -> Shot:
    """A shot of 1.5 s in which the struck ball has one impact at most."""
    heading, speed = rng.uniform(-np.pi, np.pi), rng.uniform(0.6, 2.0)
    direction = np.array([np.cos(heading), np.sin(heading)])
    across = np.array([-direction[1], direction[0]])
    top, side = rng.uniform(-1, 1), rng.choice([-1.0, 0.0, 1.0]) * rng.uniform(0.3, 1.0)
    names: tuple[str, ...] = ("white",)
    places = (-0.35 * speed * direction)[None]
    if kind == "ball":
        names = ("white", "red")
        places = np.array([-0.35 * direction, rng.uniform(-0.8, 0.8) * SNOOKER_BALL.diameter * across])
    if kind == "cushion":
        sign = rng.choice([-1.0, 1.0])
        start = np.array([rng.uniform(-0.4, 0.4), sign * (float(MATHAVAN_TABLE.centre_limits(SNOOKER_BALL)[1]) - 0.3)])
        angle = rng.uniform(np.radians(25), np.radians(155))
        direction = np.array([np.cos(angle), sign * np.sin(angle)])
        places = start[None]
    n = len(names)
    velocity, spin = np.zeros((n, 2)), np.zeros((n, 3))
    velocity[0] = speed * direction
    spin[0] = np.array([-top * direction[1], top * direction[0], side]) * speed / SNOOKER_BALL.radius
    return Shot(names, places, velocity, spin, np.arange(0, 1.5, 1 / CAMERA_FPS))


def write_clips(folder: Path | str) -> None:
    """Write clips with noise, and `native.toml`, the MJCF's own contacts, to start a fit from."""
    rng = np.random.default_rng(RANDOM_SEED)
    shots = [_shot(SHOT_KINDS[k % len(SHOT_KINDS)], rng) for k in range(CLIP_COUNT)]
    clips = []
    for k, track in enumerate(play(ANALYTIC_MODEL, shots)):
        balls = {}
        for i, name in enumerate(track.names):
            theta = track.theta[:, i] + rng.normal(0, ANGLE_NOISE_RAD, len(track.times))
            theta = theta if name == "white" else np.full(len(track.times), np.nan)
            xy = track.position[:, i] + rng.normal(0, POSITION_NOISE_M, (len(track.times), 2))
            balls[name] = Observation(track.times, xy, theta)
        clips.append(Clip(f"clips/{SHOT_KINDS[k % len(SHOT_KINDS)]}-{k:03d}.csv", "white", balls))
    write_clip_set(ClipSet(MATHAVAN_TABLE, SNOOKER_BALL, CAMERA_FPS, tuple(clips), POSITION_NOISE_M), folder)
    try:
        write_model(Model(MATHAVAN_TABLE, SNOOKER_BALL), Path(folder) / "native.toml")
    except BaseException:  # all or nothing, so that the same command works once there is room
        shutil.rmtree(folder)
        raise
