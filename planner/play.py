"""Strokes played on a fitted model: thousands a moment by the compiled analytic engine, or in MuJoCo with all effects.

Where a model holds nothing that the analytic engine lacks (decoupled cloth, impacts with constant coefficients, what
the cue delivers), both agree to rounding and the engine speaks for the model; otherwise it screens, and MuJoCo judges.
Pockets have jaws in both. What a camera sees is left out: it changes no shot.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from models.analytic import shot as analytic
from models.effect import Effect
from models.errors import BadInput
from models.model_file import Model
from models.shot import GRAVITY, Shot, Track
from models.simulate import simulate
from planner.outcome import Outcomes, joined, of_result, of_tracks
from planner.scene import Scene
from planner.stroke import SPEED, Launcher, launch

Array = NDArray[np.float64]
Values = Mapping[str, Array]  # constants of the model, by name: (n,)
CONSTANTS = {
    "decoupled_cloth.slide": "slide", "decoupled_cloth.roll": "roll", "decoupled_cloth.spin": "spin",
    "ball_impact.restitution": "ball_restitution", "ball_impact.friction": "ball_friction",
    "cushion_impact.restitution": "cushion_restitution", "cushion_impact.friction": "cushion_friction",
}  # fmt: skip
EVENTS = 48  # logged of a shot
MOST = 3000  # events after which a shot is given up, as no one plans for it
CHUNK = 20_000  # shots at a time: bounds the memory of their logs
SPARE = 2.0  # on how long a ball can roll from its first speed


class Player:
    """A scene on a model, ready to play."""

    def __init__(self, model: Model, scene: Scene, launcher: Launcher, threads: int = 0) -> None:
        """Check that they fit; BadInput where they do not."""
        if (model.table, model.ball) != (scene.table, scene.ball):
            raise BadInput(
                f"the scene's table and ball, {_size(scene)}, are not the model's, {_size(model)}; "
                "give a model that was fitted to this table"
            )
        doors = ("edit", "forces", "horizon", "impact", "strike")
        acting = tuple(e for e in model.stack()[1:] if e.opens(*doors) or e.slot)
        self.model = dataclasses.replace(model, effects=acting)
        names = {e.name() for e in acting}
        base = {name.split(".")[0] for name in CONSTANTS}
        if not base <= names:
            lacking = ", ".join(sorted(base - names))
            raise BadInput(f"the model lacks {lacking}; fit one that starts from the base (sysid fit CLIPS)")
        self.strikes: tuple[Effect, ...] = tuple(e for e in acting if e.name() not in base and e.opens("strike"))
        beyond = [e for e in acting if e.name() not in base and e.opens("edit", "forces", "horizon", "impact")]
        self.exact = not beyond
        self.beyond = tuple(e.name() for e in beyond)
        self.scene, self.launcher, self.threads = scene, launcher, threads

    def starts(self, q: Array, values: Values) -> tuple[Array, Array]:
        """Velocity and spin of the cue ball as its model says: (n, 2), (n, 3)."""
        velocity, spin = launch(q, self.launcher.elevation, self.scene.ball)
        for effect in self.strikes:
            own = {k.split(".")[1]: v for k, v in values.items() if k.split(".")[0] == effect.name()}
            velocity, spin = dataclasses.replace(effect, **own).strike(self.scene.ball, velocity, spin)
        return velocity, spin

    def screen(self, q: Array, values: Values | None = None) -> Outcomes:
        """Play strokes (n, 4) in the analytic engine, with the model's constants or (n,) of one's own each."""
        values = values or {}
        parts = [self._screen(q[k : k + CHUNK], {n: v[k : k + CHUNK] for n, v in values.items()})
                 for k in range(0, len(q), CHUNK)]  # fmt: skip
        return joined(parts)

    def _screen(self, q: Array, values: Values) -> Outcomes:
        scene, n = self.scene, len(q)
        balls = len(scene.names)
        v, w = np.zeros((n, balls, 2)), np.zeros((n, balls, 3))
        v[:, 0], w[:, 0] = self.starts(q, values)
        result = analytic.finish(
            scene.table, scene.ball, self.constants(values), np.broadcast_to(scene.position, (n, balls, 2)), v, w,
            events=EVENTS, threads=self.threads, jaws=True, most=MOST,
        )  # fmt: skip
        return of_result(scene, result)

    def constants(self, values: Values) -> analytic.Constants:
        """The analytic engine's constants."""
        known = self.model.parameters()
        return analytic.Constants(**{own: values.get(name, known[name]) for name, own in CONSTANTS.items()})

    def play(self, q: Array, values: Values | None = None) -> Outcomes:
        """The same in MuJoCo, with all effects."""
        return of_tracks(self.scene, self.tracks(q, values))

    def tracks(self, q: Array, values: Values | None = None, *, every: float = 0.0, jaws: bool = True) -> list[Track]:
        """Tracks in MuJoCo until everything rests, sampled `every` so many seconds, or at the ends only."""
        scene, n = self.scene, len(q)
        velocity, spin = launch(q, self.launcher.elevation, scene.ball)
        roll = float(np.min(self.model.parameters()["decoupled_cloth.roll"]))
        longest = SPARE * q[:, SPEED] / (roll * GRAVITY) + 1.0
        balls, shots = len(scene.names), []
        for k in range(n):
            v, w = np.zeros((balls, 2)), np.zeros((balls, 3))
            v[0], w[0] = velocity[k], spin[k]
            end = float(longest[k])
            times = np.arange(0.0, end, every) if every else np.array([0.0, end])
            shots.append(Shot(scene.names, scene.position, v, w, times))
        model = self.model.with_values(dict(values)) if values else self.model
        return simulate(model, shots, threads=self.threads, jaws=jaws)

    def outcomes(self, q: Array, values: Values | None = None) -> Outcomes:
        """By the engine where it speaks for the model, in MuJoCo otherwise."""
        return self.screen(q, values) if self.exact else self.play(q, values)


def _size(what: Scene | Model) -> str:
    t, b = what.table, what.ball
    pockets = "" if t.pockets else ", no pockets"
    return f"{t.length} x {t.width} m{pockets} and {1e3 * b.diameter:g} mm, {1e3 * b.mass:g} g"
