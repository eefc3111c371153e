"""A model as a pooltool system: table, balls and constants in one file, the matching laws in another.

In: a model, or a model and a shot. Out: plain values for `System.load`; the two files, and lines on the losses and
their cost.

    import pooltool as pt
    from pooltool.physics.engine import PhysicsEngine
    from pooltool.physics.resolve.resolver import Resolver
    system = pt.System.load("system.json")
    engine = PhysicsEngine(resolver=Resolver.load("system.laws.json"))
    pt.simulate(system, engine=engine, inplace=True)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from models.errors import BadInput
from models.model_file import Model
from models.shot import Array, Shot
from sysid.pooltool.document import write_document
from sysid.pooltool.frame import PHI_AHEAD_RAD, nose_shift, turned_there
from sysid.pooltool.laws import CUSHION_LAW_EFFECTS, Laws, laws_of
from sysid.pooltool.losses import losses, off_at_rest
from sysid.pooltool.table import frame_of, table_there

CURVE_LOSS = (  # measured by `apart` of tests/bench/pooltool_judge.py on 200 shots; no effect here has that law
    "lost: friction of balls is that of the slip before an impact there, not of every moment: with Alciatore's curve "
    "1.2 mm at the second impact (95 %: 7.6), 7.5 mm where balls stop (95 %: 73)"
)
RESTING, SLIDING = 0, 2  # pooltool's motion states
CUE_SPEED, CUE_MASS, CUE_LENGTH, TIP_RADIUS = 2.0, 0.567, 1.4732, 0.0106045  # of pooltool's own cue; SI
TIP_SHAFT_RADIUS, BUTT_RADIUS = 0.0065, 0.02  # of its shaft, which is only drawn [m]


def export_pooltool(model: Model, out: Path | str, places: Mapping[str, ArrayLike] | None = None) -> list[str]:
    """Write a model as a pooltool system, and its laws next to it.

    Args:
        model: as read from a model file.
        out: the system's file, .json or .msgpack; that of the laws has its name and ends in .laws.json.
        places: initial place of each ball, (2,) [m], the struck one first; by default one on either half of the table.

    Returns:
        Lines on the files and the losses.

    Raises:
        BadInput: for a model without laws in pooltool, invalid places, and a file that cannot be written.
    """
    path, model = Path(out), model.as_played()
    quarter = model.table.length / 4
    places = places or {"cue": (-quarter, 0.0), "object": (quarter, 0.0)}
    xy = np.array([places[name] for name in places], float).reshape(-1, 2)
    limit = model.table.centre_limits(model.ball)
    for name, at in zip(places, xy, strict=True):
        if not (np.isfinite(at).all() and (np.abs(at) <= limit + 1e-9).all()):
            raise BadInput(
                f"ball {name} at {at.tolist()} lies outside the playing surface: write it in m from its centre"
            )
    laws = nearest_laws(model)
    velocity, spin = np.zeros((len(xy), 2)), np.zeros((len(xy), 3))
    system = system_of(model, laws, Shot(tuple(places), xy, velocity, spin, np.zeros(1)))
    laws_file = path.with_name(f"{path.stem}.laws.json")
    write_document(system, path)
    write_document(laws.resolver, laws_file)
    shift = 1e3 * nose_shift(model.ball.radius)
    lines = [
        f"system: {path} (pt.System.load), {len(xy)} balls",
        f"laws: {laws_file} (Resolver.load); balls frictional_mathavan, cushions {laws.cushion}",
        f"noses {shift:.2f} mm further out on all sides, since balls meet them at a radius in pooltool",
    ]
    lines += [f"lost: {one.text}" for one in losses(model, laws)]
    if laws.resolver["ball_ball"]["friction"]["model"] == "alciatore":
        lines.append(CURVE_LOSS)
    elif not laws.lost and laws.played.effects == model.effects:
        lines.insert(3, "lost: nothing, with the laws file")
    return lines


def nearest_laws(model: Model) -> Laws:
    """The laws with the closest end points of balls, among pooltool's laws of cushions."""
    choices = [laws_of(model)]
    if any(e.name() in CUSHION_LAW_EFFECTS for e in model.stack()):
        choices.append(laws_of(model, compliant=True))
        return min(choices, key=lambda one: off_at_rest(model, one.played))
    return choices[0]


def system_of(model: Model, laws: Laws, shot: Shot) -> dict[str, Any]:
    """A shot as pooltool's `System` in plain values; moving balls begin in motion, and its cue strikes none.

    Args:
        model: with the sizes used in play.
        laws: of the model.
        shot: the struck ball first.
    """
    frame = frame_of(model.table, model.ball)
    places, velocities, spins = frame.place(shot.position), turned_there(shot.velocity), turned_there(shot.spin)
    balls = {
        name: _ball(name, laws.others if k else laws.struck, places[k], velocities[k], spins[k])
        for k, name in enumerate(shot.names)
    }
    specs = {
        "brand": "", "M": CUE_MASS, "length": CUE_LENGTH, "tip_radius": TIP_RADIUS,
        "shaft_radius_at_tip": TIP_SHAFT_RADIUS, "shaft_radius_at_butt": BUTT_RADIUS, "end_mass": laws.end_mass,
    }  # fmt: skip
    cue = {
        "id": "cue_stick", "V0": CUE_SPEED, "phi": math.degrees(PHI_AHEAD_RAD), "theta": 0.0, "a": 0.0, "b": 0.0,
        "cue_ball_id": shot.names[0], "specs": specs,
    }  # fmt: skip
    return {
        "cue": cue,
        "table": table_there(model.table, model.ball, laws.heights),
        "balls": balls,
        "t": 0.0,
        "events": [],
    }


def _ball(name: str, params: Mapping[str, float], place: Array, velocity: Array, spin: Array) -> dict[str, Any]:
    moving = bool(np.any(velocity) or np.any(spin))
    rvw = [[*map(float, place), params["R"]], [*map(float, velocity), 0.0], [*map(float, spin)]]
    return {
        "id": name, "state": {"rvw": rvw, "s": SLIDING if moving else RESTING, "t": 0.0}, "params": dict(params),
        "ballset": None, "initial_orientation": {"pos": [1.0, 1.0, 1.0, 1.0], "sphere": [1.0, 0.0, 0.0, 0.0]},
        "history": {"states": []}, "history_cts": {"states": []},
    }  # fmt: skip
