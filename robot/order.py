"""What a plan orders of the launcher, checked against its settings, its limits and the scene that the camera sees.

In: a plan file, the launcher's settings, positions of the balls. Out: an `Order`, or BadInput with the remedy.
The planned string is used if the launcher's calibration gives it the planned cue speed within half a step, and
otherwise the nearest calibrated string.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from models.errors import BadInput
from models.shot import Array, Ball
from planner.planning import read_plan
from planner.scene import Scene, scene_from
from robot.device.protocol import string_number
from robot.device.settings import Settings
from sysid.clips import CueCommand

PLACE_TOLERANCE_M = 5e-3  # default tolerance of a ball's position relative to the plan
HALF_STRING_STEP = 0.5 * 2.45 / 199  # half the step of cue speed between the paper's strings [m/s]
RADIUS_TOLERANCE_M = 1e-4  # tolerance of the settings' ball radius relative to the scene's
CUE_FIELDS = ("speed", "azimuth", "side", "height", "elevation")


@dataclass(frozen=True)
class Order:
    """A plan's stroke in the terms of one launcher, within its limits."""

    scene: Scene
    string: str
    x0_mm: float
    y0_mm: float
    yaw_deg: float
    cue: CueCommand  # as commanded, for the clip
    notes: tuple[str, ...] = ()


def read_order(plan: Path | str, settings: Settings) -> Order:
    """Read a plan for a launcher.

    Raises:
        BadInput: not a plan, a plan without a stroke, or one beyond the launcher's limits.
    """
    data = read_plan(plan)
    if data.get("stroke") is None:
        raise BadInput(f"{plan}: holds no stroke ({data.get('why', 'no reason given')}); plan another shot")
    scene = scene_from(data.get("scene"), f"{plan} scene")
    cue = CueCommand(**{name: _number(data, "stroke", name, plan) for name in CUE_FIELDS})
    x0_mm, y0_mm, yaw = (_number(data, "launcher", name, plan) for name in ("x0_mm", "y0_mm", "theta_deg"))
    wanted = _number(data, "launcher", "cue_speed", plan)
    check_radius(settings, scene.ball, f"{plan}: its balls", "plan for these balls")
    try:
        string, notes = _string(data["launcher"].get("string"), wanted, settings)
        settings.stage_um(x0_mm, y0_mm)
        yaw = settings.check_yaw(yaw)
    except BadInput as error:
        raise BadInput(f"{plan}: {error}") from None
    return Order(scene, string, x0_mm, y0_mm, yaw, cue, notes)


def check_radius(settings: Settings, ball: Ball, which: str, remedy: str) -> None:
    """Raise BadInput if the launcher is set for other balls than `which`."""
    radius = 1e3 * ball.radius
    if abs(settings.stage.ball_radius_mm - radius) > 1e3 * RADIUS_TOLERANCE_M:
        raise BadInput(
            f"{which} have a radius of {radius:g} mm, the launcher is set for "
            f"{settings.stage.ball_radius_mm:g} mm; correct [stage] ball_radius_mm, or {remedy}"
        )


def _string(planned: Any, wanted: float, settings: Settings) -> tuple[str, tuple[str, ...]]:
    """The string to use, within the limits, and notes on it."""
    number = string_number(planned)
    table = settings.calibration
    low, high = table.strings[0], table.strings[-1]
    speed = table.cue_speed(number) if low <= number <= high else math.nan
    if abs(speed - wanted) <= HALF_STRING_STEP + 1e-6:
        settings.check_speed(number)
        return f"{number:03d}p", ()
    other = table.string(wanted)
    settings.check_speed(other)
    if other == number:
        return f"{number:03d}p", ()
    gives = f"gives {speed:.3f} m/s" if math.isfinite(speed) else "is not calibrated"
    return f"{other:03d}p", (f"{number:03d}p {gives} here, {wanted:.3f} m/s is planned: {other:03d}p instead",)


def _number(data: Mapping[str, Any], section: str, name: str, plan: Path | str) -> float:
    part = data.get(section)
    value = part.get(name) if isinstance(part, Mapping) else None
    if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
        raise BadInput(f"{plan}: {name} of its {section} is {value!r}; give a number, or make the plan again")
    return float(value)


def check_scene(
    scene: Scene, seen: Mapping[str, Array], plan: Path | str, tolerance: float = PLACE_TOLERANCE_M
) -> None:
    """Raise BadInput for a missing or additional ball, or for the one farthest from its position in the plan."""
    remedy = "correct it, or plan again from a new picture"
    for name in scene.names:
        if name not in seen:
            raise BadInput(f"{plan}: ball {name} is not seen on the table; {remedy}")
    for name, xy in seen.items():
        if name not in scene.names:
            raise BadInput(f"{plan}: ball {name} is at {_place(xy)}, but not in the plan; {remedy}")
    off = [float(np.hypot(*(seen[name] - xy))) for name, xy in zip(scene.names, scene.position, strict=True)]
    k = int(np.argmax(off))
    if not off[k] <= tolerance:
        raise BadInput(
            f"{plan}: ball {scene.names[k]} is {1e3 * off[k]:.1f} mm from its place in the plan, "
            f"at {_place(seen[scene.names[k]])}; {remedy} (within {1e3 * tolerance:g} mm)"
        )


def _place(xy: Array) -> str:
    return f"{xy[0]:.4f}, {xy[1]:.4f}"
