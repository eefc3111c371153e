"""Shots of the analytic models as a clip set, so that the workbench can fit what it likes to them.

With the native MJCF beside them: `sysid compare` and `fit` then show what MuJoCo's own contact leaves out, and which
effects mend it, as they would on a real table.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from models.engine.play import play
from models.model_file import Model, write_model
from models.shot import Shot
from sysid.clips import Clip, ClipSet, Observation, write_clip_set
from sysid.validation.match import ANALYTIC, BALL, TABLE

SIGMA, SIGMA_THETA = 2e-4, 0.02  # of the camera [m], and of the white's mark [rad]
FPS = 120.0
KINDS = ("open", "ball", "cushion")
SEED = 11


def _shot(kind: str, rng: np.random.Generator) -> Shot:
    """A shot of a second and a half, one thing to touch at most for the struck ball."""
    heading, speed = rng.uniform(-np.pi, np.pi), rng.uniform(0.6, 2.0)
    way = np.array([np.cos(heading), np.sin(heading)])
    across = np.array([-way[1], way[0]])
    top, side = rng.uniform(-1, 1), rng.choice([-1.0, 0.0, 1.0]) * rng.uniform(0.3, 1.0)
    names: tuple[str, ...] = ("white",)
    places = (-0.35 * speed * way)[None]
    if kind == "ball":
        names = ("white", "red")
        places = np.array([-0.35 * way, rng.uniform(-0.8, 0.8) * BALL.diameter * across])
    if kind == "cushion":
        sign = rng.choice([-1.0, 1.0])
        start = np.array([rng.uniform(-0.4, 0.4), sign * (float(TABLE.centre_limits(BALL)[1]) - 0.3)])
        angle = rng.uniform(np.radians(25), np.radians(155))
        way = np.array([np.cos(angle), sign * np.sin(angle)])
        places = start[None]
    n = len(names)
    velocity, spin = np.zeros((n, 2)), np.zeros((n, 3))
    velocity[0] = speed * way
    spin[0] = np.array([-top * way[1], top * way[0], side]) * speed / BALL.radius
    return Shot(names, places, velocity, spin, np.arange(0, 1.5, 1 / FPS))


def write_clips(folder: Path | str, count: int = 30) -> None:
    """Write `count` clips with noise, and `native.toml`, the MJCF's own contacts, to start a fit from."""
    rng = np.random.default_rng(SEED)
    shots = [_shot(KINDS[k % len(KINDS)], rng) for k in range(count)]
    clips = []
    for k, track in enumerate(play(ANALYTIC, shots)):
        balls = {}
        for i, name in enumerate(track.names):
            theta = track.theta[:, i] + rng.normal(0, SIGMA_THETA, len(track.times))
            theta = theta if name == "white" else np.full(len(track.times), np.nan)
            xy = track.position[:, i] + rng.normal(0, SIGMA, (len(track.times), 2))
            balls[name] = Observation(track.times, xy, theta)
        clips.append(Clip(f"clips/{KINDS[k % len(KINDS)]}-{k:03d}.csv", "white", balls))
    write_clip_set(ClipSet(TABLE, BALL, FPS, tuple(clips), SIGMA), folder)
    write_model(Model(TABLE, BALL), Path(folder) / "native.toml")
