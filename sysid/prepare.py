"""Compile, once, all that commands play and fit with: `python -m sysid.prepare`, or the first command that needs it.

Compiled code is kept beside its sources (models/compiled.py), so that later starts only load it.
"""

from __future__ import annotations

import dataclasses
import sys

import numpy as np

from models.compiled import is_ready, set_ready
from models.engine.play import finish
from models.hooks import COMPILED, address
from models.model_file import catalogue, effect_class, full_model
from models.shot import Ball, Shot, Table
from models.simulation.observe import observed
from sysid.clips import Clip, ClipSet, Observation
from sysid.clips.segments import Segment
from sysid.estimation.least_squares import fit_each
from sysid.estimation.segment_problem import segment_problem
from sysid.estimation.shot_problem import shot_problem

COMPILING = "compiling the engine, once on this machine: about a minute"
TABLE, BALL = Table(3.569, 1.778), Ball(0.0525, 0.1406)
NOISE = 5e-4  # [m]


def prepare() -> None:
    """Compile what is not compiled yet, after a line that says so."""
    if is_ready():
        return
    print(COMPILING, file=sys.stderr, flush=True)
    for kind in catalogue().values():
        for hook in COMPILED:
            if kind.opens(hook):
                address(getattr(kind, hook), hook, kind.layout())
    _play()
    _fit()
    set_ready()


def _play() -> None:
    """Shots in both engines, of the base and where effects push and see."""
    base = full_model(TABLE, BALL)
    rich = base.add(effect_class("table_tilt")()).add(effect_class("lens_distortion")())
    place, velocity = np.array([[-0.2, 0.0], [0.2, 0.01], [0.2526, 0.0]]), np.zeros((3, 2))
    velocity[0, 0] = 1.0
    shot = Shot(("cue", "red", "blue"), place, velocity, np.zeros((3, 3)), np.linspace(0, 1.5, 16))
    for model in (base, rich):
        finish(model, place[None], velocity[None], np.zeros((1, 3, 3)), jaws=True, events=4)
        for engine in ("events", "mujoco"):
            observed(dataclasses.replace(model, engine=engine), [shot])


def _fit() -> None:
    """A fit of two balls and of a segment."""
    time = np.linspace(0, 0.5, 12)
    path = np.column_stack([0.8 * time, np.zeros(12)])
    cue = Observation(time, path, np.full(12, np.nan))
    red = Observation(time, np.tile([0.9, 0.2], (12, 1)), np.full(12, np.nan))
    clip = Clip("none", "cue", {"cue": cue, "red": red})
    model = full_model(TABLE, BALL)
    clips = ClipSet(TABLE, BALL, 24.0, (clip,), NOISE)
    shots = shot_problem(model, tuple(model.parameters()), clips, NOISE)
    fit_each(shots.objective(), shots.start, np.array(list(model.parameters().values())), 1)
    part = Segment(0, "cue", time, path, "strike", "end")
    segments = segment_problem(model, (), [part], NOISE)
    segments.evaluate(segments.start, np.zeros((1, 0)), np.zeros(1, np.int64))


if __name__ == "__main__":
    prepare()
