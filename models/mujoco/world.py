"""A table with its balls that `mj_step` moves: `World(model, names)`, and its `mj_model` for any program that steps.

    world = World(model, ("white", "red"))
    data = world.place({"white": (-1.0, 0.0), "red": (0.5, 0.02)})
    world.strike(data, velocity=(2.0, 0.1))
    mujoco.mj_step(world.mj_model, data)

Making a world installs the callback of models/mujoco/passive.py as MuJoCo's `mjcb_passive`, which leaves models alone
that no world has made. Where a model has no effect for cloth, balls or cushions, MuJoCo's own contacts with the native
terms of the MJCF act there. The callback writes `opt.timestep`: threads that step at once need a copy of the model
each, as `mujoco.batch` makes them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from models import record as rec
from models.effect import STILL
from models.engine.impacts import ask_neighbours, strike_rows
from models.engine.play import lay_out
from models.errors import BadInput
from models.mjcf.world import add_bands, build_spec
from models.mujoco import memory as mem
from models.mujoco.forces import SUPPORT_MARGIN_M
from models.mujoco.noses import add_noses
from models.mujoco.passive import PROCESS_NUMBER, install, kept_alive
from models.shot import (
    MAX_SPEED_M_S,
    SESSION_FIELDS,
    UNKNOWN_SESSION,
    Array,
    Session,
)

if TYPE_CHECKING:
    from models.analytic.pocket import Pockets
    from models.hooks import Hooks
    from models.model_file import Model

STEP_S: Final = 1e-3  # longest step unless stated otherwise [s]
NET_DEPTH_M: Final = 1.0  # depth below the slate of balls out of play: under the floor of a furnished table [m]
SLEEP_SPEED: Final = 1e-8  # speed below which MuJoCo lets a ball sleep [m/s]
WORLD_FIELD: Final = "cuelab"  # numeric field of a model that leads to its world
SLATE_GEOM: Final = "support"  # geom that carries balls, where there is slate
LOAD, NOT_REDUCED = "load ", 0  # beginning of a sensor's name; "not reduced" for MuJoCo's contact sensors
LOW_IMPEDANCE, HIGH_IMPEDANCE = 1e-4, 0.9999  # impedance of contacts whose force the callback computes, of the slate
SLATE_TIME_S: Final = 0.004  # time in which the slate lifts a body that has sunk into it [s]


class World:
    """One table with its balls, compiled; the struck ball is the first."""

    def __init__(
        self, model: Model, names: Sequence[str], *, timestep: float = STEP_S, jaws: bool = False,
        furnished: bool = False, marked: bool = False, rows: int = 1,
    ) -> None:  # fmt: skip
        """Compile the table, a free joint for each ball, and install the callback.

        Args:
            model: table, ball and effects; its parameters are numbers, or arrays (rows,).
            names: of the balls, which choose their colours; the one to be struck comes first.
            timestep: the longest step [s].
            jaws: whether pockets have jaws and an edge, as in models/simulation/simulate.py.
            furnished: with what is only seen.
            marked: with a band about each ball, which shows it rolling.
            rows: how many sets of parameters there are; `strike` chooses one.
        """
        self.model = model = model.as_played()
        self.names, self.rows = tuple(names), rows
        self._game = game = lay_out(model, rows, jaws, native=True)
        effects = model.stack()
        cloth = any(e.slot == "cloth" for e in effects)
        resolved = {e.resolves for e in effects}
        native = mem.NATIVE_CLOTH, mem.NATIVE_BALLS, mem.NATIVE_CUSHIONS
        self._native = dict(zip(native, (not cloth, "ball" not in resolved, "cushion" not in resolved), strict=True))
        self.spec = self._spec(effects, timestep, furnished, marked, game.pockets)
        self.masses = self._masses()
        for name, mass in zip(self.names, self.masses[0], strict=True):
            body = self.spec.body(name)
            body.mass, body.inertia = mass, [0.4 * mass * model.ball.radius**2] * 3
        self._timestep = timestep
        self.recompile()

    def _spec(
        self, effects: Sequence[Any], timestep: float, furnished: bool, marked: bool, pockets: Pockets
    ) -> mujoco.MjSpec:
        """The MJCF: slate and noses in place of what the plain table has, unless their terms are native."""
        table, ball = self.model.table, self.model.ball
        spec = build_spec(table, ball, self.names, (), furnished=furnished)
        spec.option.timestep = timestep
        editors = [e for e in effects if e.opens("edit")]
        for geom in list(spec.geoms):
            if geom.name.startswith("cushion "):
                spec.delete(geom)
        for pair in list(spec.pairs):
            spec.delete(pair)
        spec.worldbody.add_geom(name=SLATE_GEOM, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], group=4)
        self._noses = noses = add_noses(spec, table.length / 2, table.width / 2, ball.radius, pockets)
        soft = [LOW_IMPEDANCE, LOW_IMPEDANCE, 0.001, 0.5, 2.0]
        for number, name in enumerate(self.names):
            one = f"ball {name}"
            geom = spec.geom(one)
            geom.contype = geom.conaffinity = 2  # for what a user adds with these bits
            geom.gap = MAX_SPEED_M_S * timestep  # MuJoCo reports contacts possible within a step
            self._pair(spec, "ball_bed", one, SLATE_GEOM, [HIGH_IMPEDANCE, HIGH_IMPEDANCE, 0.001, 0.5, 2.0])
            for other in self.names[number + 1 :]:
                self._pair(spec, "ball_ball", one, f"ball {other}", soft)
            for nose, _, _ in noses:
                self._pair(spec, "ball_cushion", one, nose, soft)
        for effect in editors:
            effect.select(0).edit(spec)
        if marked:
            add_bands(spec, self.names, ball.radius)
        spec.option.sleep_tolerance = SLEEP_SPEED  # for those who let MuJoCo sleep
        spec.nuserdata = mem.memory_size(len(self.names))
        spec.add_numeric(name=WORLD_FIELD, data=[0.0, 0.0])  # nothing yet: compiling steps, too
        return spec

    def _pair(self, spec: mujoco.MjSpec, kind: str, one: str, other: str, impedance: list[float]) -> None:
        pair = spec.add_pair(spec.find_default(kind), geomname1=one, geomname2=other)
        key = {"ball_bed": mem.NATIVE_CLOTH, "ball_ball": mem.NATIVE_BALLS, "ball_cushion": mem.NATIVE_CUSHIONS}[kind]
        if not self._native[key]:
            pair.condim, pair.solimp, pair.solref = 1, impedance, [SLATE_TIME_S, 1.0]
        if kind == "ball_bed":
            pair.margin = SUPPORT_MARGIN_M
        else:
            pair.gap = MAX_SPEED_M_S * spec.option.timestep

    def _masses(self) -> Array:
        """Masses of the balls with the effects of impacts: (rows, n) [kg]."""
        n, radius, game = len(self.names), self.model.ball.radius, self._game
        factor = np.ones((self.rows, n))
        if n > 1 and not self._native[mem.NATIVE_BALLS]:
            beside, session = np.zeros((n, 7)), np.zeros(SESSION_FIELDS)
            beside[:, 0] = 2 * radius * np.arange(n)
            for row in range(self.rows):
                hit = np.zeros((n, rec.IMPACT_FIELDS))
                ask_neighbours(beside, radius, session, game.hooks.own[row], game.hooks.impact, hit)
                factor[row] = hit[:, rec.MASS_FIRST]
        return np.asarray(factor * self.model.ball.mass)

    def recompile(self, timestep: float | None = None) -> None:
        """Compile `spec` into `mj_model` once more, after something has been added to it.

        `timestep` is another longest step [s].
        What is to touch balls takes part in collisions by bit 2: contype and conaffinity of 2.
        """
        self._timestep = self.spec.option.timestep = timestep or self._timestep
        self.mj_model: mujoco.MjModel = self.spec.compile()
        self._connect(self._timestep)

    def _connect(self, timestep: float) -> None:
        """Lay out the callback's data, and store their address in the model."""
        game, compiled_model, ball = self._game, self.mj_model, self.model.ball
        hooks, pockets, table_sizes = game.hooks, game.pockets, self.model.table
        joints = [compiled_model.joint(name) for name in self.names]
        self._joints = np.array([(j.qposadr[0], j.dofadr[0]) for j in joints], np.int64)
        geoms = np.full((compiled_model.ngeom, 2), -1 - mem.TOOL, np.int64)
        for number, name in enumerate(self.names):
            geoms[compiled_model.geom(f"ball {name}").id] = number, 0
        geoms[compiled_model.geom(SLATE_GEOM).id] = -1 - mem.SLATE, 0
        for name, kind, rail in self._noses:
            geoms[compiled_model.geom(name).id] = -1 - kind, rail
        jaws = bool(len(pockets.jaws))
        mouths = (pockets.ends if jaws else table_sizes.mouths())[:2]
        holes = pockets.falls if jaws else np.insert(table_sizes.corners(), 2, table_sizes.mouths()[2], axis=1)
        arrays: dict[int, Any] = {
            mem.OWN: game.hooks.own if hooks.own.size else np.zeros((self.rows, 1)), mem.CLOTH: game.cloth,
            mem.FORCES: hooks.forces, mem.HORIZON: hooks.horizon, mem.IMPACT: hooks.impact, mem.GEOMS: geoms,
            mem.HOLES: holes, mem.JAWS: pockets.jaws if jaws else np.zeros((1, 5)), mem.JOINTS: self._joints,
            mem.MASSES: self.masses, mem.FELT: self._felt(),
            mem.NUMBERS: np.array([ball.radius, timestep, *game.half[0], *mouths, NET_DEPTH_M]),
        }  # fmt: skip
        arrays = {key: np.ascontiguousarray(value) for key, value in arrays.items()}
        table = np.zeros(mem.TABLE_SIZE, np.int64)
        for key, value in arrays.items():
            table[key] = value.ctypes.data
        for key, count in (
            (mem.BALLS, len(self.names)), (mem.JAW_COUNT, len(pockets.jaws)),
            (mem.OWN_BYTES, arrays[mem.OWN].strides[0]),
            (mem.FORCE_COUNT, len(hooks.forces)), (mem.SUPPORT, hooks.support), (mem.IMPACT_COUNT, len(hooks.impact)),
            (mem.HORIZON_COUNT, len(hooks.horizon)),
            (mem.HOLE_COUNT, len(holes) if table_sizes.pockets else 0),
            *((key, int(value)) for key, value in self._native.items()),
        ):  # fmt: skip
            table[key] = count
        kept_alive[table.ctypes.data] = arrays, table
        install()
        compiled_model.numeric_data[:2] = PROCESS_NUMBER, np.array([table.ctypes.data], np.int64).view(np.float64)[0]

    def _felt(self) -> Any:
        """Indices in `sensordata` of the sensors of the slate's load, -1 for balls without: (n,)."""
        model = self.mj_model
        found = {model.sensor(k).name: int(model.sensor_adr[k]) for k in range(model.nsensor)}
        return np.array([found.get(LOAD + name, -1) for name in self.names], np.int64)

    def weigh(self, name: str) -> None:
        """Add a sensor of the force [N] with which the slate bears a ball, "load NAME", to `spec`.

        The cloth then rubs a ball the more that a tool presses down; compile the world anew after it.
        """
        self.spec.add_sensor(
            name=LOAD + name, type=mujoco.mjtSensor.mjSENS_CONTACT, objtype=mujoco.mjtObj.mjOBJ_GEOM,
            objname=f"ball {name}", reftype=mujoco.mjtObj.mjOBJ_GEOM, refname=SLATE_GEOM,
            intprm=[1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), NOT_REDUCED, 1],
        )  # fmt: skip

    def forget(self) -> None:
        """Free the callback's data, once neither this world nor a copy of its model is stepped any more."""
        address = int(self.mj_model.numeric_data[1:2].view(np.int64)[0])
        self.mj_model.numeric_data[:2] = 0.0
        kept_alive.pop(address, None)

    @property
    def hooks(self) -> Hooks:
        """The effects, ready to be called."""
        return self._game.hooks

    def place(self, places: Mapping[str, ArrayLike], data: Any = None) -> mujoco.MjData:
        """Balls at rest at these places (2,) [m], at time 0; those without a place are out of play.

        A new MjData, or the one given, reset.
        """
        unknown = [name for name in places if name not in self.names]
        if unknown:
            raise BadInput(f"{unknown[0]!r} is no ball of this world; choose from {', '.join(self.names)}")
        if data is None:
            data = mujoco.MjData(self.mj_model)
        mujoco.mj_resetData(self.mj_model, data)
        radius = self.model.ball.radius
        for number, (name, (at, _)) in enumerate(zip(self.names, self._joints, strict=True)):
            hangs = [0.0, 0.0, -NET_DEPTH_M - 4.0 * radius * number]
            data.qpos[at : at + 3] = [*np.asarray(places[name], float), radius] if name in places else hangs
        mujoco.mj_forward(self.mj_model, data)
        return data

    def strike(
        self, data: Any, velocity: ArrayLike, spin: ArrayLike = (0.0, 0.0, 0.0), *, session: Session = UNKNOWN_SESSION,
        row: int = 0,
    ) -> None:  # fmt: skip
        """Strike the first ball now: velocity (2,) [m/s] and spin (3,) [rad/s], on which the effects of strokes act.

        `session` is when and under what the shot is played, `row` the set of parameters. All balls begin to count their
        turns anew.
        """
        data = getattr(data, "ptr", data)
        v, w = np.zeros((1, 1, 2)), np.zeros((1, 1, 3))
        v[0, 0], w[0, 0] = velocity, spin
        if not (np.isfinite(v).all() and np.isfinite(w).all()):
            raise ValueError(f"velocity {v[0, 0]}, spin {w[0, 0]}: give finite numbers")
        hooks, (at, to) = self._game.hooks, self._joints[0]
        own = np.ascontiguousarray(hooks.own[row : row + 1])
        strike_rows(own, hooks.strike, self.model.ball.radius, self.model.ball.mass, np.ones(1, np.bool_), v, w)
        local = np.zeros(3)
        mujoco.mju_rotVecQuat(local, w[0, 0], data.qpos[at + 3 : at + 7] * [1.0, -1.0, -1.0, -1.0])
        data.qvel[to : to + 6] = [*v[0, 0], 0.0, *local]
        data.userdata[:] = mem.at_strike(row, data.time, float(np.hypot(*v[0, 0])), session, len(data.userdata))
        mujoco.mj_forward(self.mj_model, data)

    def advance(self, data: Any, until: float) -> None:
        """Let MuJoCo step an MjData, or dm_control's, to a time, or up to one step beyond it."""
        data = getattr(data, "ptr", data)
        while data.time < until:
            mujoco.mj_step(self.mj_model, data)

    def states(self, data: Any) -> tuple[Array, Array, Array]:
        """Places (n, 2) [m], velocities (n, 2) [m/s] and spins (n, 3) [rad/s] of the balls, table frame."""
        data = getattr(data, "ptr", data)
        n = len(self.names)
        position, velocity, spin = np.zeros((n, 2)), np.zeros((n, 2)), np.zeros((n, 3))
        for k, (at, to) in enumerate(self._joints):
            position[k], velocity[k] = data.qpos[at : at + 2], data.qvel[to : to + 2]
            mujoco.mju_rotVecQuat(spin[k], data.qvel[to + 3 : to + 6], data.qpos[at + 3 : at + 7])
        return position, velocity, spin

    def rests(self, data: Any) -> bool:
        """Whether no ball in play moves or spins."""
        data = getattr(data, "ptr", data)
        there = self.in_play(data)
        speeds = {n: data.qvel[to : to + 6] for n, (_, to) in zip(self.names, self._joints, strict=True)}
        return all(np.abs(speeds[name]).max() < STILL for name in there)

    def in_play(self, data: Any) -> tuple[str, ...]:
        """Names of the balls that are on the table."""
        data = getattr(data, "ptr", data)
        low = 0.5 * self.model.ball.radius
        return tuple(n for n, (at, _) in zip(self.names, self._joints, strict=True) if data.qpos[at + 2] > low)
