"""One world a simulation: the MJCF of table and balls, edited by the effects, compiled for a batch.

Parameters of effects that edit the MJCF may differ from simulation to simulation: their fields are then copied in.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import NDArray

from models.effect import Effect
from models.mjcf.world import build_spec
from models.shot import Ball, Table

if TYPE_CHECKING:
    from models.model_file import Model

BATCH_FIELDS = (
    "pair_friction",
    "pair_solref",
    "pair_solreffriction",
    "opt.gravity",
    "body_mass",
    "body_inertia",
)  # that an edit may change


def _world(
    table: Table, ball: Ball, names: tuple[str, ...], editors: tuple[Effect, ...], exact: bool, resolved: bool
) -> mujoco.MjModel:
    spec = build_spec(table, ball, list(names), editors)
    if exact:
        # The cloth carries the weight and holds the height: steps of any size, no support to sink into.
        for pair in spec.pairs:
            if resolved or pair.classname.name == "ball_bed":
                spec.delete(pair)
        for body in spec.bodies[1:]:
            body.gravcomp = 1
    return spec.compile()


_known = lru_cache(maxsize=64)(_world)  # a fit asks for the same world a thousand times


def batch(
    model: Model, names: Sequence[str], effects: Sequence[Effect], exact: bool, resolved: NDArray[np.bool_], nsim: int,
    threads: int,
) -> Any:  # fmt: skip
    """A mujoco.batch.Batch of `nsim` worlds with these balls.

    `exact`: the cloth is an effect; `resolved` (2,): so are impacts of balls, of cushions.
    """

    def world(active: Sequence[Effect]) -> mujoco.MjModel:
        key = tuple(type(e)() if e.plain else e for e in active if e.opens("edit"))
        carried = exact, bool(resolved.all())
        if any(np.ndim(getattr(e, k)) for e in key for k in e.parameters()):
            return _world(model.table, model.ball, tuple(names), key, *carried)
        return _known(model.table, model.ball, tuple(names), key, *carried)

    editors = [e.opens("edit") and any(np.ndim(getattr(e, k)) for k in e.parameters()) for e in effects]
    first = world([e.select(0) if any(editors) else e for e in effects] if any(editors) else effects)
    made = mujoco.batch.Batch(first, nsim, nthread=threads)
    if any(editors) and first.npair:
        fields = {name: made.expand(name) for name in BATCH_FIELDS}
        for s in range(nsim):
            variant = world([e.select(s) for e in effects])
            for name, values in fields.items():
                source = variant.opt.gravity if name == "opt.gravity" else getattr(variant, name)
                values[s] = np.reshape(source, values[s].shape)
    return made
