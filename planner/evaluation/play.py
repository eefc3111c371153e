"""Strokes played on a fitted model: thousands a moment by the event engine, or in MuJoCo.

Both play all of the model's effects, with jaws at the pockets. The engine (models/engine) is what a search looks with;
MuJoCo is the second opinion on the finalists. A model that edits the MJCF is played in MuJoCo alone, which
takes a search ten times as long. What a camera sees is left out: it changes no shot.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from models.engine.impacts import strike_rows
from models.engine.play import finish, lacking
from models.errors import BadInput
from models.hooks import hooks_of
from models.model_file import Model
from models.shot import GRAVITY, Shot, Track
from models.simulation.simulate import simulate
from planner.evaluation.outcome import Outcomes, joined, of_result, of_tracks
from planner.launcher.stroke import AZIMUTH, SPEED, Launcher, launch
from planner.scene import Scene

Array = NDArray[np.float64]
Values = Mapping[str, Array]  # constants of the model, by name: (n,)
EVENTS = 48  # logged of a shot
MOST = 3000  # events after which a shot is given up, as no one plans for it
CHUNK = 20_000  # shots at a time: bounds the memory of their logs
SPARE = 2.0  # on how long a ball can roll from its first speed
PLAYS = ("edit", "forces", "horizon", "impact", "strike")  # hooks through which an effect changes a shot


class Player:
    """A scene on a model, ready to play."""

    def __init__(self, model: Model, scene: Scene, launcher: Launcher, threads: int = 0) -> None:
        """Check that they fit; BadInput where they do not."""
        if (model.table, model.ball) != (scene.table, scene.ball):
            raise BadInput(
                f"the scene's table and ball, {_size(scene)}, are not the model's, {_size(model)}; "
                "give a model that was fitted to this table"
            )
        acting = tuple(e for e in model.stack()[1:] if e.opens(*PLAYS) or e.slot)
        self.model = dataclasses.replace(model, effects=acting)
        plain = tuple(e for e in acting if e.slot == "cloth" or not e.opens("edit"))
        if why := lacking(dataclasses.replace(model, effects=plain)):
            raise BadInput(
                f"the model cannot be planned on: {why}; fit one that starts from the base (sysid fit CLIPS)"
            )
        self.in_mujoco_alone = len(plain) < len(acting)
        self.scene, self.launcher, self.threads = scene, launcher, threads

    def deflection(self, q: Array) -> Array:
        """How far to the left of its azimuth the ball leaves, as the model's cue delivers it: (n,) [rad]."""
        velocity, spin = launch(q, self.launcher.elevation, self.scene.ball)
        v, w = velocity[:, None].copy(), spin[:, None].copy()
        hooks = hooks_of(self.model.stack()[1:], len(q))
        ball = self.scene.ball
        struck = np.ones(len(q), np.bool_)
        strike_rows(hooks.own, hooks.strike, ball.radius, ball.mass, struck, v, w)
        turned = np.arctan2(v[:, 0, 1], v[:, 0, 0]) - q[:, AZIMUTH]
        return np.asarray((turned + np.pi) % (2 * np.pi) - np.pi)

    def screen(self, q: Array, values: Values | None = None) -> Outcomes:
        """Play strokes (n, 4) in the event engine, with the model's constants or (n,) of one's own each."""
        if self.in_mujoco_alone:
            return self.play(q, values)
        values = values or {}
        parts = [self._screen(q[k : k + CHUNK], {n: v[k : k + CHUNK] for n, v in values.items()})
                 for k in range(0, len(q), CHUNK)]  # fmt: skip
        return joined(parts)

    def _screen(self, q: Array, values: Values) -> Outcomes:
        scene, n = self.scene, len(q)
        balls = len(scene.names)
        v, w = np.zeros((n, balls, 2)), np.zeros((n, balls, 3))
        v[:, 0], w[:, 0] = launch(q, self.launcher.elevation, scene.ball)
        result = finish(
            self.model.with_values(values), np.broadcast_to(scene.position, (n, balls, 2)), v, w, events=EVENTS,
            threads=self.threads, jaws=True, most=MOST,
        )  # fmt: skip
        return of_result(scene, result)

    def play(self, q: Array, values: Values | None = None) -> Outcomes:
        """The same in MuJoCo."""
        return of_tracks(self.scene, self.tracks(q, values))

    def tracks(self, q: Array, values: Values | None = None, *, every: float = 0.0, jaws: bool = True) -> list[Track]:
        """Tracks in MuJoCo until everything rests, sampled `every` so many seconds, or at the ends only."""
        scene, n = self.scene, len(q)
        velocity, spin = launch(q, self.launcher.elevation, scene.ball)
        cloth = next(e for e in self.model.effects if e.slot == "cloth")
        roll = float(np.min(getattr(cloth, "roll")))  # noqa: B009 (no field of every effect)
        longest = SPARE * q[:, SPEED] / (roll * GRAVITY) + 1.0
        balls, shots = len(scene.names), []
        for k in range(n):
            v, w = np.zeros((balls, 2)), np.zeros((balls, 3))
            v[0], w[0] = velocity[k], spin[k]
            end = float(longest[k])
            times = np.arange(0.0, end, every) if every else np.array([0.0, end])
            shots.append(Shot(scene.names, scene.position, v, w, times))
        model = dataclasses.replace(self.model, engine="mujoco").with_values(values or {})
        return simulate(model, shots, threads=self.threads, jaws=jaws)


def _size(what: Scene | Model) -> str:
    t, b = what.table, what.ball
    pockets = "" if t.pockets else ", no pockets"
    return f"{t.length} x {t.width} m{pockets} and {1e3 * b.diameter:g} mm, {1e3 * b.mass:g} g"
