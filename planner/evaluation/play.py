"""Strokes played on a fitted model: thousands per second in the event engine, or in MuJoCo.

In: a scene, a model and strokes q (n, 4), optionally with constants of the model for each. Out: outcomes, or tracks.
Both engines play all of the model's effects, with jaws at the pockets. The search uses the event engine
(models/engine); MuJoCo checks the finalists, struck by the launcher's tip. A model that edits the MJCF can be played in
MuJoCo only, and then a search takes ten times as long. Camera effects are left out, since they change no shot.
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
from models.mjcf.launcher import CUE_SPEED_RANGE, STAGE_TRAVEL_M
from models.model_file import Model
from models.mujoco.launcher import SimulatedStroke
from models.mujoco.struck import TipStroke, play_struck, without_squirt
from models.shot import GRAVITY, Shot, Track
from models.simulation.simulate import simulate
from models.table.pocket_shape import POCKET_SETS, read_pockets
from planner.evaluation.outcome import Outcomes, concatenate, of_result, of_tracks
from planner.launcher.mapped import MappedLauncher
from planner.launcher.stroke import AZIMUTH, HEIGHT, SIDE, SPEED, LauncherModel
from planner.scene import Scene

Array = NDArray[np.float64]
Values = Mapping[str, Array]  # constants of the model, by name: (n,)
LOGGED_EVENTS = 48  # events logged for each shot, to count fouls and cushions
MAX_EVENTS = 3000  # after this number of events a shot is abandoned and counts as no pot
SHOTS_PER_CHUNK = 20_000  # shots played at a time, to bound the memory of event logs
DURATION_FACTOR = 2.0  # MuJoCo simulates this multiple of the time to roll out from the first speed
SHOT_HOOKS = ("edit", "forces", "horizon", "impact", "strike")  # hooks through which an effect changes a shot


class Player:
    """A scene with the model and the launcher that play it."""

    def __init__(self, model: Model, scene: Scene, launcher: LauncherModel, threads: int = 0) -> None:
        """Create a player; BadInput if model and scene disagree. `threads` is the largest number, 0 for all."""
        if (model.table, model.ball) != (scene.table, scene.ball):
            raise BadInput(
                f"the scene and the model differ in {_apart(scene, model)}: correct the scene, where a table's name, "
                'such as table = "pool 9 ft", also implies its pockets and balls, or give another model'
            )
        acting = tuple(e for e in model.stack()[1:] if e.opens(*SHOT_HOOKS) or e.slot)
        self.model = dataclasses.replace(model, effects=acting)
        in_engine = tuple(e for e in acting if e.slot == "cloth" or not e.opens("edit"))
        if why := lacking(dataclasses.replace(model, effects=in_engine)):
            raise BadInput(
                f"the model cannot be planned on: {why}; fit one that starts from the base (sysid fit CLIPS)"
            )
        self.mujoco_only = len(in_engine) < len(acting)
        self.scene, self.launcher, self.threads = scene, launcher, threads

    def deflection(self, q: Array) -> Array:
        """Angle to the left of the aim at which the ball leaves, by the model's cue effects: (n,) [rad]."""
        velocity, spin = self.launcher.launch(q, self.scene.ball)
        v, w = velocity[:, None].copy(), spin[:, None].copy()
        hooks = hooks_of(self.model.stack()[1:], len(q))
        ball = self.scene.ball
        struck = np.ones(len(q), np.bool_)
        strike_rows(hooks.own, hooks.strike, ball.radius, ball.mass, struck, v, w)
        angle = np.arctan2(v[:, 0, 1], v[:, 0, 0]) - q[:, AZIMUTH]
        return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)

    def screen(self, q: Array, values: Values | None = None) -> Outcomes:
        """Outcomes of strokes (n, 4) in the event engine, with the model's constants or (n,) values of some."""
        if self.mujoco_only:
            return self.play(q, values)
        values = values or {}
        chunks = [slice(k, k + SHOTS_PER_CHUNK) for k in range(0, len(q), SHOTS_PER_CHUNK)]
        return concatenate([self._screen_chunk(q[c], {n: v[c] for n, v in values.items()}) for c in chunks])

    def _screen_chunk(self, q: Array, values: Values) -> Outcomes:
        scene, n = self.scene, len(q)
        balls = len(scene.names)
        v, w = np.zeros((n, balls, 2)), np.zeros((n, balls, 3))
        v[:, 0], w[:, 0] = self.launcher.launch(q, scene.ball)
        result = finish(
            self.model.with_values(values), np.broadcast_to(scene.position, (n, balls, 2)), v, w,
            events=LOGGED_EVENTS, threads=self.threads, jaws=True, most=MAX_EVENTS,
        )  # fmt: skip
        return of_result(scene, result)

    def play(self, q: Array, values: Values | None = None) -> Outcomes:
        """As `screen`, in MuJoCo."""
        return of_tracks(self.scene, self.tracks(q, values, mujoco=True))

    def strike(self, tips: Array, values: Values | None = None) -> tuple[Outcomes, list[SimulatedStroke]]:
        """Outcomes of strokes by the launcher's tip in MuJoCo, and the ball's motion after them.

        Args:
            tips: cue speed [m/s], azimuth [rad], side and height of the cue's axis [m]: (n, 4); values beyond the
                launcher's range are clipped.
            values: constants of the model by name, (n,) each.
        """
        launcher = self.mapped()
        model = without_squirt(self.model) if launcher.squirt_in_model else self.model
        low, high = CUE_SPEED_RANGE
        speed = np.clip(tips[:, SPEED], low, high)
        side, height = (np.clip(tips[:, k], -STAGE_TRAVEL_M, STAGE_TRAVEL_M) for k in (SIDE, HEIGHT))
        strokes = [TipStroke(*map(float, one)) for one in zip(speed, tips[:, AZIMUTH], side, height, strict=True)]
        times = [np.array([0.0, t]) for t in self._durations(2.0 * speed)]  # no ball is faster than twice the cue
        scene = self.scene
        tracks, made = play_struck(
            model.with_values(values or {}), dict(zip(scene.names, scene.position, strict=True)), strokes, times,
            device=launcher.device, jaws=True, threads=self.threads,
        )  # fmt: skip
        return of_tracks(scene, tracks), made

    def mapped(self) -> MappedLauncher:
        """The launcher with its map, which describes the tip; TypeError without a map."""
        if not isinstance(self.launcher, MappedLauncher):
            raise TypeError(f"{type(self.launcher).__name__} has no map; make it with usual_launcher or with_map")
        return self.launcher

    def _durations(self, speed: Array) -> Array:
        """Durations of shots with initial ball speeds (n,) [m/s], to be simulated [s]."""
        cloth = next(e for e in self.model.effects if e.slot == "cloth")
        roll = float(np.min(getattr(cloth, "roll")))  # noqa: B009 (no field of every effect)
        return np.asarray(DURATION_FACTOR * speed / (roll * GRAVITY) + 1.0)

    def tracks(
        self, q: Array, values: Values | None = None, *, every: float = 0.0, jaws: bool = True, mujoco: bool = False
    ) -> list[Track]:
        """Tracks of strokes (n, 4) until all balls rest, sampled `every` [s]; 0 for start and end only.

        They are played in the event engine, or in MuJoCo on request or if only that can play the model.
        """
        scene, n = self.scene, len(q)
        velocity, spin = self.launcher.launch(q, scene.ball)
        duration = self._durations(q[:, SPEED])
        balls, shots = len(scene.names), []
        for k in range(n):
            v, w = np.zeros((balls, 2)), np.zeros((balls, 3))
            v[0], w[0] = velocity[k], spin[k]
            times = np.arange(0.0, float(duration[k]), every) if every else np.array([0.0, float(duration[k])])
            shots.append(Shot(scene.names, scene.position, v, w, times))
        engine = "mujoco" if mujoco or self.mujoco_only else "events"
        model = dataclasses.replace(self.model, engine=engine).with_values(values or {})
        return simulate(model, shots, threads=self.threads, jaws=jaws)


def _apart(scene: Scene, model: Model) -> str:
    """The differences of table and ball between scene and model, in words."""
    found = []
    for what, one, other in (("table", scene.table, model.table), ("ball", scene.ball, model.ball)):
        for key in (field.name for field in dataclasses.fields(one)):
            here, there = getattr(one, key), getattr(other, key)
            if here != there:
                found.append(f"{what}.{key} ({_value(here)} and {_value(there)})")
    return " and ".join(found)


def _value(value: object) -> str:
    """A size, or pockets by name, as text."""
    if isinstance(value, float | int) and not isinstance(value, bool):
        return repr(float(value))
    names = [name for name, pockets in POCKET_SETS.items() if read_pockets(name) == value]
    return "none" if value is False else f'"{names[0]}"' if names else "of another shape"
