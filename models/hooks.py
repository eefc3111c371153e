"""The hooks of effects, compiled: scalar functions of one ball's, one impact's, one stroke's or one image's state.

A hook is an ordinary method of an effect, `forces(self, ball)`. It is compiled for two records: its effect's parameters
as `self`, and the state below. Whoever plays a table, the event engine or the MuJoCo world, calls it by its address,
so that a formula stands once and any effect, shipped or a user's, runs at the same speed in both.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import from_dtype, types
from numba.core.errors import NumbaError
from numba.extending import intrinsic
from numpy.typing import NDArray

from models.compiled import callback, compiled
from models.errors import BadInput
from models.shot import NOSE_SINE

Array = NDArray[np.float64]
Table = NDArray[np.int64]


@dataclass
class BallState:
    """One ball, as the hooks `forces` and `horizon` see it, and what acts on it: the fields from `weight` on."""

    x: float = 0.0  # [m]
    y: float = 0.0
    vx: float = 0.0  # [m/s]
    vy: float = 0.0
    wx: float = 0.0  # spin, table frame [rad/s]
    wy: float = 0.0
    wz: float = 0.0
    slip_x: float = 0.0  # velocity of the lowest point over the cloth [m/s]
    slip_y: float = 0.0
    time: float = 0.0  # since t = 0 [s]
    launch: float = 0.0  # speed of the struck ball at t = 0; 0 if it was not struck then [m/s]
    order: float = 0.0  # place of the shot in its session, 0 to 1; this and what follows as in models/shot.py, Session
    hour: float = 0.0  # of the day [h]
    warmth: float = 0.0  # of the room, over 20 degrees Celsius [K]
    cloth_age: float = 0.0  # play since the cloth was laid [h]
    table: float = 0.0  # number of the table
    player: float = 0.0  # number of the player
    rolled: float = 0.0  # turned about the horizontal while rolling, since t = 0 [rad]
    number: float = 0.0  # 0 is the struck ball
    radius: float = 0.0  # [m]
    mass: float = 0.0  # [kg]
    rolling: float = 0.0  # 1 while it rolls and moves, otherwise 0
    weight: float = 1.0  # part of its weight that the cloth carries; 0 in flight
    ax: float = 0.0  # what pushes it, beside the cloth [m/s^2]
    ay: float = 0.0
    bx: float = 0.0  # what turns it, beside the cloth [rad/s^2]
    by: float = 0.0
    bz: float = 0.0
    slide_factor: float = 1.0  # on the friction of a sliding ball
    roll_factor: float = 1.0  # on the deceleration of a rolling ball
    spin_factor: float = 1.0  # on the deceleration of sidespin
    drag: float = 0.0  # beside the rolling resistance, which is never less than none with it [m/s^2]
    across: float = 0.0  # of the cloth on a sliding ball, to the left of its way, never above its friction [m/s^2]


@dataclass
class ImpactState:
    """A contact about to happen, as the hook `impact` sees it; from `restitution` on it says how it goes."""

    cushion: float = 0.0  # 1 at a cushion, 0 where two balls meet
    approach: float = 0.0  # normal approach speed; for a cushion the horizontal one [m/s]
    slip: float = 0.0  # tangential slip speed at the contact [m/s]
    x: float = 0.0  # of the ball, or of the first of two [m]
    y: float = 0.0
    vx: float = 0.0  # of the same ball [m/s]
    vy: float = 0.0
    wz: float = 0.0  # its sidespin [rad/s]
    first: float = 0.0  # number of that ball; 0 is the struck one
    second: float = 0.0  # number of the other ball, or of the rail: 0 +x, 1 -x, 2 +y, 3 -y
    order: float = 0.0  # place of the shot in its session, 0 to 1; this and what follows as in models/shot.py, Session
    hour: float = 0.0  # of the day [h]
    warmth: float = 0.0  # of the room, over 20 degrees Celsius [K]
    cloth_age: float = 0.0  # play since the cloth was laid [h]
    table: float = 0.0  # number of the table
    player: float = 0.0  # number of the player
    time: float = 0.0  # since t = 0 [s]
    restitution: float = 0.0  # energetic: square root of the work given back over the work done
    friction: float = 0.0  # Coulomb, at a slip that is fast
    gain: float = 0.0  # what a slip that ends adds to that: gain exp(-decay slip), two balls only
    decay: float = 0.0  # [s/m], at the slip of every moment of the impact
    mass_first: float = 1.0  # of the two bodies over the table's ball, the inertia with it
    mass_second: float = 1.0  # not used of a rail
    nose: float = NOSE_SINE  # sine of the elevation at which a rail meets the ball: its height over the radius, less 1
    compliance: float = 0.0  # of a rail along its face over that along its normal, 0 where it is rigid
    sink: float = 0.0  # share of a rail's push on the slate that the slate does not return: 0 rigid, 1 not there
    contact_time: float = 0.0  # for which a ball stays in a rail [s]
    cloth_share: float = 0.0  # share of changes of the cloth's sliding friction that act within impacts


@dataclass
class StrokeState:
    """The motion of the struck ball after the stroke, which the hook `strike` reads and changes."""

    vx: float = 0.0  # [m/s]
    vy: float = 0.0
    wx: float = 0.0  # [rad/s]
    wy: float = 0.0
    wz: float = 0.0
    radius: float = 0.0  # [m]
    mass: float = 0.0  # [kg]


@dataclass
class ImageState:
    """Where a ball is at the moment that the camera looks, as the hook `observe` sees it; it moves x and y."""

    x: float = 0.0  # [m]
    y: float = 0.0
    vx: float = 0.0  # true velocity [m/s]
    vy: float = 0.0
    time: float = 0.0  # [s]
    order: float = 0.0  # place of the shot in its session, 0 to 1; this and what follows as in models/shot.py, Session
    hour: float = 0.0  # of the day [h]
    warmth: float = 0.0  # of the room, over 20 degrees Celsius [K]
    cloth_age: float = 0.0  # play since the cloth was laid [h]
    table: float = 0.0  # number of the table
    player: float = 0.0  # number of the player
    number: float = 0.0  # 0 is the struck ball


Layout = tuple[str | tuple[str, int], ...]  # of a row of parameters: names of numbers, or of arrays of so many
COLOUR_CODE = re.compile(r"\x1b\[[0-9;]*m")
HOOK_STATES: dict[str, type] = {
    "forces": BallState, "horizon": BallState, "impact": ImpactState, "strike": StrokeState, "observe": ImageState,
}  # fmt: skip
COMPILED_HOOKS = (*HOOK_STATES, "exposures")


def fields_of(kind: type) -> tuple[str, ...]:
    """Names of a state's fields, in order: a record is a row of so many floats."""
    return tuple(f.name for f in dataclasses.fields(kind))


def _record(layout: Layout) -> Any:
    fields = [(one, np.float64) if isinstance(one, str) else (one[0], np.float64, (one[1],)) for one in layout]
    return from_dtype(np.dtype(fields or [("none", np.float64)]))


STROKE_FIELDS, IMAGE_FIELDS = len(fields_of(StrokeState)), len(fields_of(ImageState))
IMAGE_SESSION, IMAGE_NUMBER = (fields_of(ImageState).index(name) for name in ("order", "number"))


class HookError(BadInput):
    """Raised for a hook that does not compile; the message names it and the reason."""


@cache
def address(function: Callable[..., Any], hook: str, layout: Layout) -> int:
    """Where the compiled hook is, for parameters of this layout.

    Raises:
        HookError: names the hook and what in it cannot be compiled.
    """
    own = _record(layout)
    if hook == "exposures":
        signature = types.float64(own, types.float64)
    elif hook == "horizon":
        signature = types.float64(own, _record(fields_of(BallState)))
    else:
        signature = types.void(own, _record(fields_of(HOOK_STATES[hook])))
    try:
        return int(callback(function, signature).address)
    except KeyError as error:
        fault = f"{function.__qualname__} uses {error}, which is neither a parameter nor a field of its state"
        raise HookError(f"{fault}; correct the name (fields: models/hooks.py)") from error
    except TypeError as error:
        fault = f"{function.__qualname__} does not compile: {' '.join(str(error).split())}"
        raise HookError(f"{fault}; declare it as models/effect.py does") from error
    except NumbaError as error:
        plain = COLOUR_CODE.sub("", str(error))  # numba colours its messages where colorama is installed
        said = [line.strip() for line in plain.splitlines() if line.strip()]
        lines = [line for line in said if line.startswith("File ")]
        what = next((x for x in said if "Failed in" not in x), said[0])
        where = f" ({lines[-1].rstrip(':')})" if lines else ""
        raise HookError(
            f"{function.__qualname__} does not compile{where}: {what}; write plain arithmetic on numbers, with math"
        ) from error


def _call(builder: Any, where: Any, returns: Any, own: Any, other: Any) -> Any:
    """Emit a call of the function at an address with the address `own` and one thing more, an address or a number."""
    pointer = ir.IntType(8).as_pointer()
    other = other if other.type == ir.DoubleType() else builder.inttoptr(other, pointer)
    function = ir.FunctionType(returns, [pointer, other.type]).as_pointer()
    return builder.call(builder.inttoptr(where, function), [builder.inttoptr(own, pointer), other])


@intrinsic
def call_hook(context, where, own, state):  # type: ignore[no-untyped-def]
    """Call the hook at an address with the addresses of its parameters and of a state."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        _call(builder, args[0], ir.VoidType(), *args[1:])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), codegen


@intrinsic
def call_horizon(context, where, own, state):  # type: ignore[no-untyped-def]
    """The same for a hook that returns a number."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return _call(builder, args[0], ir.DoubleType(), *args[1:])

    return types.float64(types.int64, types.int64, types.int64), codegen


@intrinsic
def call_exposures(context, where, own, stamp):  # type: ignore[no-untyped-def]
    """The hook that takes a time stamp and returns a time."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return _call(builder, args[0], ir.DoubleType(), *args[1:])

    return types.float64(types.int64, types.int64, types.float64), codegen


@compiled
def push_rolling(ball: BallState, ax: float, ay: float) -> None:
    """Add a force that changes a ball's velocity by (ax, ay) [m/s^2], and the torque that keeps it rolling."""
    ball.ax += ax
    ball.ay += ay
    ball.bx -= ay / ball.radius
    ball.by += ax / ball.radius


@compiled
def push_along(ball: BallState, along: float, left: float) -> None:
    """The same along the motion and to the left of it [m/s^2]; nothing for a ball that does not move."""
    speed = math.sqrt(ball.vx * ball.vx + ball.vy * ball.vy)
    if speed > 0.0:
        cx, cy = ball.vx / speed, ball.vy / speed
        push_rolling(ball, along * cx - left * cy, along * cy + left * cx)


class Hooks(NamedTuple):
    """Effects ready to be called: of each hook a table (k, 2), its address and where its parameters begin in a row."""

    own: Array  # (nsim, p) parameters of all effects in every simulation
    forces: Table
    support: int  # how many of the first `forces` say what the cloth carries, before the others push
    horizon: Table
    impact: Table
    strike: Table
    observe: Table
    exposures: Table


def hooks_of(effects: Sequence[Any], count: int, begins: Sequence[int] | None = None) -> Hooks:
    """Lay out effects (models.effect.Effect) for `count` simulations; the forces of those that are `first` come first.

    `begins`: where in a row the parameters of each effect stand, if the row is made elsewhere.
    """
    columns: list[Array] = []
    tables: dict[str, list[tuple[int, int]]] = {name: [] for name in COMPILED_HOOKS}
    support = end = 0
    for number in sorted(range(len(effects)), key=lambda k: not effects[k].first):
        effect = effects[number]
        kind, layout = type(effect), effect.layout()
        values = effect.row(count)
        at = end if begins is None else begins[number]
        for name in COMPILED_HOOKS:
            if kind.opens(name):
                tables[name].append((address(getattr(kind, name), name, layout), at))
                support += name == "forces" and kind.first
        columns.append(values)
        end += values.shape[1]
    own = np.concatenate(columns, axis=1) if columns else np.zeros((count, 0))
    made = {k: np.array(v, np.int64).reshape(-1, 2) for k, v in tables.items()}
    return Hooks(np.ascontiguousarray(own), support=support, **made)
