"""A fitted table in anyone's loop: one call advances a plain MjData by a timestep, with every effect of its model.

    world = World(model, ("white", "red"))
    data = world.place({"white": (-0.8, 0.0), "red": (0.2, 0.1)})
    world.strike(data, (2.0, 0.1))
    while not world.rests(data):
        world.step(data)  # instead of mujoco.mj_step(world.mj_model, data)

`mujoco.viewer.launch_passive(world.mj_model, data)`, mujoco.Renderer and dm_control's Physics
(`Physics.from_model(wrapper.MjModel(world.mj_model))`, and `world.step(physics.data)`) show what is played.

MuJoCo holds the state and what follows from it, but it does not integrate: mj_step is not called. A step reads qpos,
qvel, xfrc_applied and time, carries the balls on by the motions and impulses of the event engine (models/engine), so
that it is as exact at 2 ms as at 0.1 ms, writes qpos, qvel and time, and calls mj_step1, after which frames, contacts
and sensors of position and velocity are those of the new state. Orientations turn by the mean spin between events.
Accelerations, contact forces and their sensors are not computed: MuJoCo's own contacts have not acted.

What qpos and qvel cannot say lies in `data.userdata`, so that mj_copyData, and mj_getState of the full integration
state, take it along: when the strike was, its launch speed, the shot's place in its session, the angle that each ball
has rolled, and, where a step ended while several balls touched, the state in which that began: the next step plays on
from there, as long as nobody has changed the state meanwhile.

What is changed by hand is taken as it is, but for what a table does not have: a ball is put back on the cloth straight
below (or above) its place, without a fall, and keeps no vertical speed. One that is beyond the nose lines, or whose
centre is below the slate, is out of play and stays where it is; potted balls go there, under the table, and are in play
again once they are put back. Balls put into each other come apart by their next impact, not by a push. Forces in
`xfrc_applied`, such as the mouse's in the viewer, act on balls in play as an impulse at the beginning of a step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from models.analytic.spring import damping_table
from models.engine import columns as col
from models.engine.impacts import strike_rows
from models.engine.play import lacking, lay_out
from models.engine.step import (
    HEAD,
    KEPT,
    LAUNCH,
    LEANING,
    MAX_STEP_EVENTS,
    PARKED_DEPTH,
    SESSION,
    STRUCK_AT,
    WRITTEN,
    play_step,
    row_length,
    take_over,
)
from models.errors import BadInput
from models.mjcf.world import build_spec
from models.model_file import Model
from models.shot import UNKNOWN_SESSION, Array, Session

DEFAULT_TIMESTEP_S = 2e-3  # unless said otherwise [s]
BAND_COLOUR, BAND_WIDTH = (0.93, 0.9, 0.82), 0.18  # of marked balls: colour, half its width over the radius


class World:
    """One table with its balls, compiled, which `step` advances; the struck ball is the first."""

    def __init__(
        self, model: Model, names: Sequence[str], *, timestep: float = DEFAULT_TIMESTEP_S, jaws: bool = False,
        furnished: bool = False, marked: bool = False,
    ) -> None:  # fmt: skip
        """Compile the table, a free joint for each ball.

        Args:
            model: table, ball and effects; its parameters are numbers.
            names: of the balls, which choose their colours; the one to be struck comes first.
            timestep: `mj_model.opt.timestep` [s], which may be changed at any time.
            jaws: whether pockets have jaws and an edge, as in models/simulation/simulate.py.
            furnished: with what is only seen.
            marked: with a band about each ball, which shows it rolling.

        Raises:
            BadInput: for a model that the event engine does not play, with the reason.
        """
        if why := lacking(model):
            remedy = "add decoupled_cloth, ball_impact, cushion_impact, or play it with models.simulation.simulate"
            raise BadInput(f"this model cannot be stepped: {why}; {remedy}")
        model = model.as_played()
        self.model, self.names = model, tuple(names)
        spec = build_spec(model.table, model.ball, self.names, model.stack(), furnished=furnished)
        spec.option.timestep = timestep
        spec.nuserdata = row_length(len(self.names))
        if marked:
            _mark(spec, self.names, model.ball.radius)
        self.mj_model: mujoco.MjModel = spec.compile()
        joints = [self.mj_model.joint(name) for name in self.names]
        self._qpos = np.array([j.qposadr[0] for j in joints], np.int64)
        self._qvel = np.array([j.dofadr[0] for j in joints], np.int64)
        self._bodies = np.array([self.mj_model.body(name).id for name in self.names], np.int64)
        self._game = game = lay_out(model, 1, jaws)
        hooks, pockets = game.hooks, game.pockets
        self._own = hooks.own[0]
        self._rest = (
            hooks.forces, hooks.support, hooks.horizon, hooks.impact, game.cloth[0], game.mass, game.radius[0],
            game.limits[0], game.half[0], pockets.ends, pockets.jaws, pockets.falls, damping_table(),
        )  # fmt: skip

    def place(self, places: Mapping[str, ArrayLike], data: mujoco.MjData | None = None) -> mujoco.MjData:
        """Balls at rest at these places (2,) [m], at time 0; those without a place are out of play.

        A new MjData, or the one given, reset.
        """
        unknown = [name for name in places if name not in self.names]
        if unknown:
            raise BadInput(f"{unknown[0]!r} is no ball of this world; choose from {', '.join(self.names)}")
        if data is None:
            data = mujoco.MjData(self.mj_model)
        mujoco.mj_resetData(self.mj_model, data)
        for number, (name, at) in enumerate(zip(self.names, self._qpos, strict=True)):
            stand = [0.0, 0.0, -PARKED_DEPTH - 2.0 * number * self.model.ball.diameter]
            data.qpos[at : at + 3] = (
                [*np.asarray(places[name], float), self.model.ball.radius] if name in places else stand
            )
        mujoco.mj_step1(self.mj_model, data)
        return data

    def strike(
        self, data: Any, velocity: ArrayLike, spin: ArrayLike = (0.0, 0.0, 0.0), *, session: Session = UNKNOWN_SESSION,
    ) -> None:  # fmt: skip
        """Strike the first ball now: velocity (2,) [m/s] and spin (3,) [rad/s], on which the effects of strokes act.

        `session` is when and under what the shot is played. All balls begin to count their turns anew.
        """
        data = getattr(data, "ptr", data)
        v, w = np.zeros((1, 1, 2)), np.zeros((1, 1, 3))
        v[0, 0], w[0, 0] = velocity, spin
        if not (np.isfinite(v).all() and np.isfinite(w).all()):
            raise ValueError(f"velocity {v[0, 0]}, spin {w[0, 0]}: give finite numbers")
        game, at, to = self._game, self._qpos[0], self._qvel[0]
        strike_rows(game.hooks.own, game.hooks.strike, game.radius[0], game.mass, np.ones(1, np.bool_), v, w)
        local = np.zeros(3)
        turn = data.qpos[at + 3 : at + 7] * [1.0, -1.0, -1.0, -1.0]
        mujoco.mju_rotVecQuat(local, w[0, 0], turn)
        data.qvel[to : to + 6] = [*v[0, 0], 0.0, *local]
        kept = data.userdata
        kept[STRUCK_AT], kept[LAUNCH], kept[SESSION:HEAD] = data.time, float(np.hypot(*v[0, 0])), session.row
        kept[WRITTEN] = 0.0
        balls = kept[HEAD : HEAD + KEPT * len(self.names)].reshape(-1, KEPT)
        balls[:, [col.ROLLED, LEANING]] = 0.0
        mujoco.mj_step1(self.mj_model, data)

    def step(self, data: Any, steps: int = 1) -> None:
        """Advance an MjData, or dm_control's, by so many timesteps.

        Raises:
            RuntimeError: for a state from which a step does not come to its end.
        """
        data = getattr(data, "ptr", data)
        for _ in range(steps):
            begin, end = data.time, data.time + self.mj_model.opt.timestep
            qpos, qvel, kept = data.qpos, data.qvel, data.userdata
            take_over(qpos, qvel, data.xfrc_applied, begin, end - begin, self._qpos, self._qvel, self._bodies, kept,
                  self._game.mass, self._game.radius[0], self._game.half[0])  # fmt: skip
            if not play_step(kept, end, self._qpos, self._qvel, qpos, qvel, self._own.ctypes.data, *self._rest):
                raise RuntimeError(
                    f"the step from {begin:.6f} s has not come to its end after {MAX_STEP_EVENTS} events"
                )
            data.time = end
        mujoco.mj_step1(self.mj_model, data)

    def rests(self, data: Any) -> bool:
        """Whether no ball in play moves or spins."""
        data = getattr(data, "ptr", data)
        return not any(np.any(data.qvel[k : k + 6]) for k in self._qvel)

    def in_play(self, data: Any) -> tuple[str, ...]:
        """Names of the balls that are on the table."""
        places = self._places(getattr(data, "ptr", data))
        inside = (np.abs(places[:, :2]) <= self._game.half[0]).all(axis=1) & (places[:, 2] > 0.0)
        return tuple(name for name, there in zip(self.names, inside, strict=True) if there)

    def _places(self, data: mujoco.MjData) -> Array:
        return np.array([data.qpos[k : k + 3] for k in self._qpos]).reshape(-1, 3)


def _mark(spec: mujoco.MjSpec, names: Sequence[str], radius: float) -> None:
    """A band about each ball: a disc that stands out of it by a hair."""
    for name in names:
        spec.body(name).add_geom(
            name=f"band {name}", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[1.004 * radius, BAND_WIDTH * radius, 0],
            rgba=[*BAND_COLOUR, 1], contype=0, conaffinity=0,
        )  # fmt: skip
