"""Compile all engine code once: `python -m sysid.prepare`, or automatically by the first command that needs it.

Compiled code is kept beside its sources (models/compiled.py), so that later starts only load it.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from models.compiled import is_ready, note_compiling, set_ready
from models.effect_catalogue import catalogue, effect_class
from models.engine.play import finish
from models.hooks import COMPILED_HOOKS, address
from models.model_file import full_model
from models.shot import Shot
from models.simulation.observe import observed
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE
from sysid.clips import Clip, ClipSet, Observation
from sysid.clips.segments import Segment
from sysid.estimation.segment_problem import segment_problem
from sysid.estimation.shot_problem import shot_problem
from sysid.estimation.solver.least_squares import fit_each

NOISE_SD_M = 5e-4  # noise of the clip that is fitted


def prepare() -> None:
    """Compile whatever is not yet compiled, and announce it in a line."""
    if is_ready():
        return
    note_compiling()
    for kind in catalogue().values():
        for hook in COMPILED_HOOKS:
            if kind.opens(hook):
                address(getattr(kind, hook), hook, kind.layout())
    _play()
    _fit()
    set_ready()


def _play() -> None:
    """Play shots in both engines, of the base and with effects of forces and camera."""
    base = full_model(SNOOKER_TABLE, SNOOKER_BALL)
    rich = base.add(effect_class("table_tilt")()).add(effect_class("lens_distortion")())
    place, velocity = np.array([[-0.2, 0.0], [0.2, 0.01], [0.2526, 0.0]]), np.zeros((3, 2))
    velocity[0, 0] = 1.0
    shot = Shot(("cue", "red", "blue"), place, velocity, np.zeros((3, 3)), np.linspace(0, 1.5, 16))
    for model in (base, rich):
        finish(model, place[None], velocity[None], np.zeros((1, 3, 3)), jaws=True, events=4)
        for engine in ("events", "mujoco"):
            observed(dataclasses.replace(model, engine=engine), [shot])


def _fit() -> None:
    """Fit a shot of two balls and a segment."""
    time = np.linspace(0, 0.5, 12)
    path = np.column_stack([0.8 * time, np.zeros(12)])
    cue = Observation(time, path, np.full(12, np.nan))
    red = Observation(time, np.tile([0.9, 0.2], (12, 1)), np.full(12, np.nan))
    clip = Clip("none", "cue", {"cue": cue, "red": red})
    model = full_model(SNOOKER_TABLE, SNOOKER_BALL)
    clips = ClipSet(SNOOKER_TABLE, SNOOKER_BALL, 24.0, (clip,), NOISE_SD_M)
    shots = shot_problem(model, tuple(model.parameters()), clips, NOISE_SD_M)
    fit_each(shots.objective(), shots.start, np.array(list(model.parameters().values())), 1)
    part = Segment(0, "cue", time, path, "strike", "end")
    segments = segment_problem(model, (), [part], NOISE_SD_M)
    segments.evaluate(segments.start, np.zeros((1, 0)), np.zeros(1, np.int64))


if __name__ == "__main__":
    prepare()
