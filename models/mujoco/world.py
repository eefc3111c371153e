"""A table with its balls that `mj_step` moves: `World(model, names)`, and its `mj_model` for any program that steps.

    world = World(model, ("white", "red"))
    data = world.place({"white": (-1.0, 0.0), "red": (0.5, 0.02)})
    world.strike(data, velocity=(2.0, 0.1))
    mujoco.mj_step(world.mj_model, data)

Making a world installs the callback of models/mujoco/forces.py as MuJoCo's `mjcb_passive`; models that no World has
made are left alone by it. It writes `opt.timestep`: threads that step at once need a copy of the model each.
"""

from __future__ import annotations

import secrets
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, Final

import ctypes
import mujoco
import numba
import numpy as np
from numba import types
from numpy.typing import ArrayLike, NDArray

from models.analytic.pocket import JAW_RAILS
from models.analytic.spring import NOSE_RADIUS, damping_table
from models.engine.impacts import ask_rows, strike_rows
from models.engine.play import lacking, lay_out
from models import record as rec
from models.errors import BadInput
from models.mjcf.world import build_spec
from models.model_file import Model
from models.mujoco import forces as f
from models.mujoco import layout
from models.shot import NOSE_COSINE, NOSE_SINE, RAIL_NAMES, UNKNOWN_SESSION, Array, Session

STEP_S: Final = 1e-3  # unless said otherwise [s]
NET_DEPTH_M: Final = 0.2  # below the slate, at which a net holds a ball [m]
NUMERIC: Final = "cuelab"  # the field of a model that says which world it is
POST_HALF_HEIGHT: Final = 0.05  # of what stands for a jaw's arc [m]
LOW_IMPEDANCE, HIGH_IMPEDANCE = 1e-4, 0.9999
STATE_SPEC: Final = mujoco.mjtState.mjSTATE_INTEGRATION
TOKEN: Final = secrets.randbits(50) + 1.0  # of this process: addresses mean nothing to another
_kept: list[Any] = []  # what compiled code points to, and models may outlive their World


@cache
def _install() -> None:
    """Make the callback and hand it to MuJoCo, once."""
    offsets = layout.offsets()
    where, numeric, token, act = int(offsets.ctypes.data), int(offsets[layout.MODEL_NUMERIC]), TOKEN, f.act
    _kept.append(offsets)
    doubles, longs = f._pointer, f._long_pointer

    @numba.cfunc(types.void(types.int64, types.int64), nopython=True)  # type: ignore[untyped-decorator]
    def passive(model, data):  # type: ignore[no-untyped-def]
        found = numba.carray(longs(model + numeric), 1)[0]
        if found != 0 and numba.carray(doubles(found), 2)[0] == token:
            act(model, data, where, numba.carray(longs(found), 2)[1])

    _kept.append(passive)
    mujoco.set_mjcb_passive(ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(passive.address))


def _noses(spec: Any, model: Model, pockets: Any, mouths: Array) -> list[tuple[str, int, int]]:
    """Add what balls meet besides the slate and each other: name, kind, and number of rail or 4 + jaw."""
    table, radius = model.table, model.ball.radius
    lx, ly = table.length / 2, table.width / 2
    height = radius + (radius + NOSE_RADIUS) * NOSE_SINE
    corner, middle = (float(mouths[0]), float(mouths[1])) if table.pockets else (0.0, 0.0)
    found: list[tuple[str, int, int]] = []

    def nose(rail: int, start: Sequence[float], end: Sequence[float], outward: Sequence[float]) -> None:
        shift = NOSE_RADIUS * NOSE_COSINE * np.asarray(outward)
        ends = [np.append(np.asarray(p, float) + shift, height) for p in (start, end)]
        name = f"nose {len(found)}"
        spec.worldbody.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[NOSE_RADIUS, 0, 0],
                                fromto=np.concatenate(ends), group=4, contype=0, conaffinity=0)  # fmt: skip
        found.append((name, f.NOSE, rail))

    for k, sign in ((0, 1.0), (1, -1.0)):
        nose(k, (sign * lx, corner - ly), (sign * lx, ly - corner), (sign, 0.0))
    for k, sign in ((2, 1.0), (3, -1.0)):
        pieces = ((corner - lx, -middle), (middle, lx - corner)) if table.pockets else ((-lx, lx),)
        for a, b in pieces:
            nose(k, (a, sign * ly), (b, sign * ly), (0.0, sign))
    near = radius * NOSE_COSINE
    for number, jaw in enumerate(pockets.jaws):
        x, y, size, *normal = jaw
        rail = 4 + number
        if normal[0] or normal[1]:
            if size > 0.0:
                out, along = np.array(normal), np.array([-normal[1], normal[0]])
                middle_at = np.array([x, y]) + near * out
                nose(rail, middle_at - size * along, middle_at + size * along, normal)
            continue
        name = f"jaw {number}"
        if size > radius:
            spec.worldbody.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_CYLINDER,
                                    size=[size - radius, POST_HALF_HEIGHT, 0], pos=[x, y, radius], group=4,
                                    contype=0, conaffinity=0)  # fmt: skip
            found.append((name, f.POST, rail))
        else:
            rise = float(np.sqrt((radius + NOSE_RADIUS) ** 2 - size**2))
            spec.worldbody.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[NOSE_RADIUS, 0, 0],
                                    pos=[x, y, radius + rise], group=4, contype=0, conaffinity=0)  # fmt: skip
            found.append((name, f.NOSE, rail))
    return found


class World:
    """One table with its balls, compiled; the struck ball is the first."""

    def __init__(
        self, model: Model, names: Sequence[str], *, timestep: float = STEP_S, jaws: bool = True,
        furnished: bool = False, rows: int = 1,
    ) -> None:  # fmt: skip
        """Compile the table, a free joint for each ball, and install the callback.

        Args:
            model: table, ball and effects; its parameters are numbers, or arrays (rows,).
            names: of the balls, which choose their colours; the one to be struck comes first.
            timestep: the longest step [s].
            jaws: whether pockets have jaws and an edge, as in models/simulation/simulate.py.
            furnished: with what is only seen.
            rows: how many sets of parameters there are, see `set_row`.

        Raises:
            BadInput: for a model whose cloth or impacts are left to MuJoCo's own terms.
        """
        if why := lacking(model):
            raise BadInput(f"this model cannot be stepped: {why}; add decoupled_cloth, ball_impact, cushion_impact")
        self.model = model = model.as_played()
        self.names = tuple(names)
        self._game = game = lay_out(model, rows, jaws)
        n, ball, pockets = len(self.names), model.ball, game.pockets
        spec = build_spec(model.table, ball, self.names, (), furnished=furnished)
        noses = self._edit(spec, pockets)
        rails = 4 + len(pockets.jaws)
        spec.option.timestep = timestep
        spec.nuserdata = f.memory_size(n, rails)
        masses = self._masses()
        for name, mass in zip(self.names, masses, strict=True):
            body = spec.body(name)
            body.mass, body.inertia = mass, [0.4 * mass * ball.radius**2] * 3
        numbers = np.array([ball.radius, timestep, *game.half[0], NET_DEPTH_M])
        table = np.zeros(f.TABLE_SIZE, np.int64)
        spec.add_numeric(name=NUMERIC, data=[0.0, 0.0])  # nothing yet: compiling steps, too
        self.mj_model: mujoco.MjModel = spec.compile()
        at = np.array([table.ctypes.data], np.int64)
        self.mj_model.numeric_data[:2] = TOKEN, at.view(np.float64)[0]
        joints = np.array([(self.mj_model.joint(x).qposadr[0], self.mj_model.joint(x).dofadr[0]) for x in self.names])
        joints = np.ascontiguousarray(joints, np.int64)
        geoms = np.full((self.mj_model.ngeom, 2), -1 - f.TOOL, np.int64)
        for number, name in enumerate(self.names):
            geoms[self.mj_model.geom(f"ball {name}").id] = number, 0
        geoms[self.mj_model.geom("slate").id] = -1 - f.SLATE, 0
        for name, kind, rail in noses:
            geoms[self.mj_model.geom(name).id] = -1 - kind, rail
        hooks = game.hooks
        own = np.ascontiguousarray(hooks.own) if hooks.own.shape[1] else np.zeros((rows, 1))
        damping, holes = damping_table(), self._holes(pockets)
        forces, horizon, impact = (np.ascontiguousarray(x, np.int64) for x in (hooks.forces, hooks.horizon, hooks.impact))
        cloth = np.ascontiguousarray(game.cloth)
        for key, value in (
            (f.BALLS, n), (f.OWN, own.ctypes.data), (f.OWN_BYTES, own.strides[0]), (f.CLOTH, cloth.ctypes.data),
            (f.FORCES, forces.ctypes.data), (f.FORCE_COUNT, len(forces)), (f.SUPPORT, hooks.support),
            (f.HORIZON, horizon.ctypes.data), (f.HORIZON_COUNT, len(horizon)), (f.IMPACT, impact.ctypes.data),
            (f.IMPACT_COUNT, len(impact)), (f.DAMPING, damping.ctypes.data), (f.DAMPING_COUNT, damping.shape[1]),
            (f.GEOMS, geoms.ctypes.data), (f.GEOM_COUNT, len(geoms)), (f.HOLES, holes.ctypes.data),
            (f.HOLE_COUNT, int(np.isfinite(holes[:, 2]).sum())), (f.JOINTS, joints.ctypes.data),
            (f.MASSES, masses.ctypes.data), (f.NUMBERS, numbers.ctypes.data), (f.RAILS, rails),
        ):  # fmt: skip
            table[key] = value
        _kept.append((table, own, cloth, forces, horizon, impact, damping, geoms, holes, joints, masses, numbers))
        self._joints, self.masses = joints, masses
        _install()

    def _masses(self) -> Array:
        """Of the balls, as the effects of impacts have them: (n,) [kg]."""
        n, radius = len(self.names), self.model.ball.radius
        out, game = np.ones(n), self._game
        if n > 1:
            first, second = np.arange(n), np.roll(np.arange(n), -1)
            p = np.zeros((n, n, 3))
            p[:, :, 0] = 2 * radius * np.arange(n)
            hit = np.zeros((n, rec.IMPACT_FIELDS))
            ask_rows(
                False, p, np.zeros((n, n, 3)), np.zeros((n, n, 3)), first, second, game.pockets.jaws, radius,
                np.zeros((n, 6)), np.zeros(n), game.hooks.own, np.zeros(n, np.int64), game.hooks.impact, hit,
            )  # fmt: skip
            out = hit[:, rec.MASS_FIRST].copy()
        return np.ascontiguousarray(out * self.model.ball.mass)

    def _holes(self, pockets: Any) -> Array:
        """Where the slate ends: circles (k, 3); a radius below 0 says all beyond the nose lines, inf none."""
        if len(pockets.falls):
            return np.ascontiguousarray(pockets.falls)
        return np.array([[0.0, 0.0, -1.0 if self.model.table.pockets else np.inf]])

    def _edit(self, spec: Any, pockets: Any) -> list[tuple[str, int, int]]:
        """Replace what balls touch by a slate and noses of the low impedance that leaves forces to the callback."""
        for pair in list(spec.pairs):
            spec.delete(pair)
        for geom in list(spec.geoms):
            if geom.name.startswith("cushion "):
                spec.delete(geom)
        spec.worldbody.add_geom(name="slate", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], group=4, contype=0,
                                conaffinity=0)  # fmt: skip
        noses = _noses(spec, self.model, pockets, pockets.ends)
        soft, hard = ([x, x, 0.001, 0.5, 2.0] for x in (LOW_IMPEDANCE, HIGH_IMPEDANCE))
        for number, name in enumerate(self.names):
            ball = f"ball {name}"
            spec.add_pair(geomname1=ball, geomname2="slate", condim=1, solref=[0.004, 1.0], solimp=hard)
            others = [f"ball {x}" for x in self.names[number + 1 :]] + [x for x, _, _ in noses]
            for other in others:
                spec.add_pair(geomname1=ball, geomname2=other, condim=1, solimp=soft, margin=0.0, gap=f.NEAR_M)
        spec.option.iterations, spec.option.tolerance = 50, 1e-12
        return noses

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
        for number, (name, (at, _)) in enumerate(zip(self.names, self._joints, strict=True)):
            stand = [0.0, 0.0, -NET_DEPTH_M - 4.0 * number * self.model.ball.radius]
            here = [*np.asarray(places[name], float), self.model.ball.radius] if name in places else stand
            data.qpos[at : at + 3] = here
        mujoco.mj_forward(self.mj_model, data)
        return data

    def strike(
        self, data: Any, velocity: ArrayLike, spin: ArrayLike = (0.0, 0.0, 0.0), *, session: Session = UNKNOWN_SESSION,
        row: int = 0,
    ) -> None:  # fmt: skip
        """Strike the first ball now: velocity (2,) [m/s] and spin (3,) [rad/s], on which the effects of strokes act.

        `session` is when and under what the shot is played. All balls begin to count their turns anew.
        """
        data = getattr(data, "ptr", data)
        v, w = np.zeros((1, 1, 2)), np.zeros((1, 1, 3))
        v[0, 0], w[0, 0] = velocity, spin
        if not (np.isfinite(v).all() and np.isfinite(w).all()):
            raise ValueError(f"velocity {v[0, 0]}, spin {w[0, 0]}: give finite numbers")
        game, (at, to) = self._game, self._joints[0]
        own = np.ascontiguousarray(game.hooks.own[row : row + 1])
        strike_rows(own, game.hooks.strike, game.radius[0], game.mass, np.ones(1, np.bool_), v, w)
        local = np.zeros(3)
        mujoco.mju_rotVecQuat(local, w[0, 0], data.qpos[at + 3 : at + 7] * [1.0, -1.0, -1.0, -1.0])
        data.qvel[to : to + 6] = [*v[0, 0], 0.0, *local]
        kept = data.userdata
        kept[:] = 0.0
        kept[f.ROW], kept[f.STRUCK_AT], kept[f.LAUNCH] = row, data.time, float(np.hypot(*v[0, 0]))
        kept[f.SESSION : f.HEAD] = session.row
        kept[f.STATE_TIME] = np.nan
        mujoco.mj_forward(self.mj_model, data)

    def rests(self, data: Any) -> bool:
        """Whether no ball in play moves or spins."""
        data = getattr(data, "ptr", data)
        there = set(self.in_play(data))
        return not any(
            np.any(np.abs(data.qvel[to : to + 6]) > 1e-4) for name, (_, to) in zip(self.names, self._joints, strict=True)
            if name in there
        )

    def in_play(self, data: Any) -> tuple[str, ...]:
        """Names of the balls that are on the table."""
        data = getattr(data, "ptr", data)
        return tuple(name for name, (at, _) in zip(self.names, self._joints, strict=True) if data.qpos[at + 2] > 0.0)
