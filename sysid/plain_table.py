"""A fitted table as plain MJCF: for anyone's MuJoCo, without code of ours.

In: a model. Out: the text of a file, which says what MJCF can say of the model, and in its head what it cannot, and
what that costs.

The file holds sizes, masses, noses and pockets, the slope as gravity, and MuJoCo's own contact terms, fitted to the
model; rolling friction is the model's own, because a rolling ball shows nothing else. What else the model has is left
out; its cost is the distance between where a ball is with and without it, in shots of 4 s.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import mujoco.batch
import numpy as np

from models.analytic.spring import NOSE_RADIUS
from models.effect import Effect
from models.engine.play import lacking, play
from models.errors import BadInput
from models.mjcf.export import spec_of
from models.mjcf.native import Native
from models.mjcf.world import rails
from models.model_file import Model
from models.shot import GRAVITY, NOSE_SINE, RAIL_NAMES, Array, Shot
from sysid.validation.native_fit import nearest_native
from sysid.validation.shots import two_ball_shots

SHOTS, SECONDS = 200, 4.0
OWN_ROLL = ("roll",)  # term that is the model's own
NOSES = {f"nose_height_{name}": rail for name, rail in zip(("px", "mx", "py", "my"), RAIL_NAMES, strict=True)}
SAID = ("table_tilt", "nose_height", *NOSES, "cue_ball_mass")  # effects that MJCF can say
REPLACED = ("decoupled_cloth", "ball_impact", "cushion_impact")  # for which MuJoCo's contacts stand


@dataclass(frozen=True)
class Cost:
    """By how much what the file leaves out moves the struck ball."""

    cause: str
    median_m: float


@dataclass(frozen=True)
class PlainTable:
    """A table as a file, and what that leaves out."""

    text: str
    native: Native
    costs: tuple[Cost, ...]  # all together first


def acts_on_balls(effect: Effect) -> bool:
    """Whether it changes the motion, and not only what is seen of it."""
    return effect.opens("forces", "horizon", "impact", "strike", "edit")


def plain_table(
    model: Model, places: Mapping[str, Array], *, launcher: bool = False, bare: bool = False, origin: str = "",
    report: Callable[[str], None] | None = None,
) -> PlainTable:  # fmt: skip
    """A model as MJCF, with the balls where they wait.

    Args:
        model: its parameters are numbers.
        places: of each ball (2,) [m]; the first is the one to be struck.
        launcher: with the cue launcher behind the first ball.
        bare: without what is only seen.
        origin: where the model comes from, in words.
        report: called with what is being done.

    Raises:
        BadInput: for a model whose cloth or impacts are MuJoCo's own already.
    """
    model = model.as_played()
    if why := lacking(model):
        raise BadInput(f"this model is plain MJCF already ({why}); export it with: python -m models.mjcf.export")
    moving = dataclasses.replace(model, effects=tuple(e for e in model.stack()[1:] if acts_on_balls(e)))
    level = _without(moving, SAID)
    native = nearest_native(level, report, OWN_ROLL)
    spec = spec_of(dataclasses.replace(model, native=native), places, launcher=launcher, bare=bare)
    say(spec, moving, next(iter(places)))
    if report:
        report(f"{SHOTS} shots")
    costs = _costs(moving, native)
    return PlainTable(_with_head(spec.to_xml(), model, costs, origin), native, costs)


def say(spec: mujoco.MjSpec, model: Model, struck: str) -> None:
    """Write into a world what MJCF can say of a model's effects; the first ball is `struck`."""
    by_name = {effect.name(): effect for effect in model.effects}
    tilt = by_name.get("table_tilt")
    if tilt is not None:
        x, y = (float(getattr(tilt, key)) for key in ("slope_x", "slope_y"))
        spec.option.gravity = [GRAVITY * x, GRAVITY * y, -GRAVITY]
    if "cue_ball_mass" in by_name:
        body, factor = spec.body(struck), float(by_name["cue_ball_mass"].factor)  # type: ignore[attr-defined]
        body.mass, body.inertia = body.mass * factor, np.asarray(body.inertia) * factor
    radius = model.ball.radius
    for number, rail in enumerate(rails(model.table)):
        names = ["nose_height", *(name for name, side in NOSES.items() if side == rail.side)]
        sine = NOSE_SINE + sum(float(by_name[name].change) for name in names if name in by_name)  # type: ignore[attr-defined]
        if sine == NOSE_SINE:
            continue
        geom = next(one for one in spec.geoms if one.name == f"cushion {number} {rail.side}")
        shift = NOSE_RADIUS * np.sqrt(1.0 - sine * sine) * rail.outward
        height = radius + (radius + NOSE_RADIUS) * sine
        geom.fromto = np.concatenate([np.append(np.array(end) + shift, height) for end in (rail.start, rail.end)])


def _without(model: Model, names: Sequence[str]) -> Model:
    return dataclasses.replace(model, effects=tuple(e for e in model.effects if e.name() not in names))


def _costs(model: Model, native: Native) -> tuple[Cost, ...]:
    """What the file leaves out of a model's motion, all together and by cause, the dearest first."""
    model = dataclasses.replace(model, table=dataclasses.replace(model.table, pockets=False))
    shots = [
        dataclasses.replace(shot, times=np.array([0.0, SECONDS]))
        for shot in two_ball_shots(SHOTS, model.table, model.ball)
    ]
    ends = _ends(model, shots)
    plain = dataclasses.replace(model, native=native)
    said = dataclasses.replace(model, effects=tuple(e for e in model.effects if e.name() in (*SAID, *REPLACED)))
    in_file = _ends_in_mujoco(plain, shots)
    found = [Cost("MuJoCo's contacts in place of the fitted cloth and impacts", _apart(_ends(said, shots), in_file))]
    for effect in model.effects:
        if effect.name() not in (*SAID, *REPLACED):
            found.append(Cost(effect.name(), _apart(_ends(_without(model, (effect.name(),)), shots), ends)))
    found.sort(key=lambda cost: -cost.median_m)
    return Cost("all together", _apart(in_file, ends)), *found


def _ends(model: Model, shots: Sequence[Shot]) -> Array:
    return np.array([track.position[-1, 0] for track in play(model, shots)])


def _apart(one: Array, two: Array) -> float:
    return float(np.nanmedian(np.hypot(*(one - two).T)))


def _ends_in_mujoco(model: Model, shots: Sequence[Shot]) -> Array:
    """Where the struck balls of shots are at their last times, moved by mj_step alone: (n, 2)."""
    names = shots[0].names
    spec = spec_of(model, {name: np.array([0.1 * k, 0.0]) for k, name in enumerate(names)}, bare=True)
    say(spec, model, names[0])
    compiled = spec.compile()
    batch = mujoco.batch.Batch(compiled, len(shots))
    qpos = batch.bind("qpos").reshape(len(shots), len(names), 7)
    qvel = batch.bind("qvel").reshape(len(shots), len(names), 6)
    qpos[..., :2] = [shot.position for shot in shots]
    qvel[..., :2], qvel[..., 3:] = [shot.velocity for shot in shots], [shot.spin for shot in shots]
    batch.step(nstep=round(SECONDS / compiled.opt.timestep))
    return np.asarray(qpos[:, 0, :2]).copy()


def _with_head(xml: str, model: Model, costs: Sequence[Cost], origin: str) -> str:
    """The file with what it leaves out as a comment at its head."""
    said = [e.name() for e in model.stack()[1:] if e.name() in SAID]
    unseen = [e.name() for e in model.stack()[1:] if not acts_on_balls(e)]
    lines = [
        f"A billiard table for MuJoCo 3.3 and later{f', from {origin}' if origin else ''}.",
        f"It holds sizes, masses, noses, pockets{', ' + ', '.join(said) if said else ''}, and contact terms fitted to",
        "the model; balls that roll slow down as fitted. Gravity has the slope of the table, if there is one.",
        "",
        f"What MJCF cannot say, and how far that moves the struck ball in {SECONDS:g} s (median of {SHOTS} shots):",
        *(f"  {cost.median_m * 1000:7.1f} mm  {cost.cause}" for cost in costs),
    ]
    if unseen:
        lines.append(f"Left out, as they move no ball: {', '.join(unseen)}.")
    body = "\n".join(f"  {line}".rstrip() for line in lines).replace("--", "- -")
    return f"<!--\n{body}\n-->\n{xml}"
