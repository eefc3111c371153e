"""What a plan says: its balls, paths, draws and resting places as values, and its strokes and chances in words.

A plan is read here as the parsed file `billiard-plan/1`, a dict: what makes plans lies further down the house, and a
recording or a report needs none of it. Outlines of the resting places are ellipses of the draws' own covariance, made
just large enough to hold the stated share of the draws: no normal distribution is supposed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.shot import NOSE_COSINE, Array, Ball, Table
from models.table.pocket_shape import read_pockets

PLAN_FORMAT = "billiard-plan/1"
MIN_DRAWS = 5  # draws that an outline needs
FALL_SLACK_M = 5e-4  # by which a ball that fell may seem to have stopped short [m]
MIN_OUTLINE_SD_M = 1e-4  # least standard deviation of an outline [m]


def scene_of(plan: Mapping[str, Any]) -> tuple[Table, Ball, dict[str, Array]]:
    """Table, ball and places (2,) [m] of all balls of a plan; BadInput where it is no plan."""
    if plan.get("format") != PLAN_FORMAT:
        raise BadInput(f"format = {plan.get('format')!r} is no plan; give what `planner plan` writes ({PLAN_FORMAT!r})")
    try:
        scene = plan["scene"]
        given = scene["table"]
        table = Table(given["length"], given["width"], read_pockets(given.get("pockets", True)))
        ball = Ball(float(scene["ball"]["diameter"]), float(scene["ball"]["mass"]))
        return table, ball, {name: np.array(xy, float).reshape(2) for name, xy in scene["balls"].items()}
    except (KeyError, TypeError, ValueError) as error:
        text = f"scene of the plan is incomplete ({type(error).__name__}: {error}); plan the shot again"
        raise BadInput(" ".join(text.split())) from None


def path_of(track: Mapping[str, Any]) -> Array:
    """The way of one ball: (n, 2) [m]."""
    return np.array(track["xy"], float).reshape(-1, 2)


def dropped(table: Table, ball: Ball, xy: Array) -> bool:
    """Whether a way that ends at `xy` (2,) [m] ended in a pocket."""
    if not table.pockets:
        return False
    over = np.array([table.length, table.width]) / 2 - np.abs(xy)
    corner, middle = table.shapes.corner.mouth, table.shapes.middle.mouth
    mouth = corner if abs(xy[0]) > table.length / 4 else middle
    beyond = bool(np.any(over < ball.radius * NOSE_COSINE - FALL_SLACK_M) and table.to_pocket(xy) < mouth)
    return beyond or float(np.hypot(*over)) < corner / 2 + FALL_SLACK_M


def fate(draw: Mapping[str, Any]) -> str:
    """A key of OUTCOME_COLOURS; a foul outweighs the pot."""
    return "foul" if draw.get("foul") else "potted" if draw.get("potted") else "missed"


def resting(plan: Mapping[str, Any]) -> tuple[Array, NDArray[np.bool_]]:
    """Where the cue ball comes to rest in the draws (n, 2) [m], and whether the object ball was potted (n,)."""
    places = plan.get("places") or {}
    cue = np.array(places.get("cue") or [], float).reshape(-1, 2)
    return cue, np.array(places.get("potted") or [True] * len(cue), bool)


def outline(cloud: Array, share: float) -> Array:
    """The ellipse of a cloud (n, 2) [m] that holds a share of it: (73, 2) [m], closed; (0, 2) of too few points."""
    if len(cloud) < MIN_DRAWS:
        return np.empty((0, 2))
    mean = cloud.mean(axis=0)
    variance, axes = np.linalg.eigh(np.cov(cloud.T))
    size = np.sqrt(np.maximum(variance, MIN_OUTLINE_SD_M**2))
    scale = np.quantile(np.hypot(*((cloud - mean) @ axes / size).T), share)
    turn = np.linspace(0.0, 2 * math.pi, 73)
    return np.asarray(mean + scale * (np.column_stack([np.cos(turn), np.sin(turn)]) * size) @ axes.T)


def percent(chance: Mapping[str, Any] | None) -> str:
    """A probability with its interval; – where it is not known."""
    values = [(chance or {}).get(key) for key in ("value", "low", "high")]
    shown = [f"{100 * v:.0f}" if v is not None and math.isfinite(v) else "–" for v in values]
    return f"{shown[0]} % ({shown[1]} to {shown[2]})" if shown[0] != "–" else "–"


def given(value: Any, form: str, unit: str = "") -> str:
    """A number in a format with its unit; – where there is none."""
    return f"{value:{form}}{unit}" if isinstance(value, int | float) and math.isfinite(value) else "–"


def strike_words(plan: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What to set and what it should give, as (what, value), in the order in which it is set."""
    stroke, launcher = plan.get("stroke") or {}, plan.get("launcher") or {}
    low, high = launcher.get("theta_tolerance_deg") or (None, None)
    theta, elevation = launcher.get("theta"), stroke.get("elevation")
    degrees = launcher.get("theta_deg", math.degrees(theta) if theta is not None else None)
    return [
        ("string", str(launcher.get("string", "–"))),
        ("x′0, + is right", given(launcher.get("x0_mm"), "+.1f", " mm")),
        ("y′0, + is up", given(launcher.get("y0_mm"), "+.1f", " mm")),
        ("θ, counter-clockwise from +x", given(degrees, ".2f", "°")),
        ("θ [rad]", given(theta, ".4f")),
        ("yaw may be off by", "–" if low is None else f"{given(low, '+.2f', '°')} to {given(high, '+.2f', '°')}"),
        ("cue speed", given(launcher.get("cue_speed"), ".2f", " m/s")),
        ("ball speed", given(stroke.get("speed"), ".2f", " m/s")),
        ("cue raised by", given(None if elevation is None else math.degrees(elevation), ".1f", "°")),
    ]


def rest_words(rest: Mapping[str, Any] | None) -> str:
    """Where the cue ball ends: how near to the place that is wanted, else where, with its standard deviation."""
    rest = rest or {}
    if rest.get("distance_median") is not None:
        far = rest.get("distance_90")
        middle = given(1e3 * rest["distance_median"], ".0f")
        most = "" if far is None else f", within {1e3 * far:.0f} mm in 90 %"
        return f"within {middle} mm of the wanted place half of the time{most}"
    if not rest.get("mean"):
        return "–"
    (x, y), (dx, dy) = rest["mean"], rest.get("sd") or (None, None)
    sd = " ± ".join(["", " / ".join(given(None if d is None else 1e3 * d, ".0f") for d in (dx, dy))])
    return f"at {1e3 * x:.0f}, {1e3 * y:.0f}{sd} mm"


def sentence(plan: Mapping[str, Any]) -> str:
    """The shot in one sentence, as one operator would say it to another."""
    goal, stroke, launcher = plan["scene"].get("goal") or {}, plan.get("stroke"), plan.get("launcher") or {}
    if not stroke:
        return f"No shot on the {goal.get('object', 'object ball')} is reasonable here."
    side, height = launcher.get("x0_mm") or 0.0, launcher.get("y0_mm") or 0.0
    words = [f"{abs(side):g} mm {'right' if side > 0 else 'left'}"] * (side != 0)
    words += [f"{abs(height):g} mm {'above' if height > 0 else 'below'}"] * (height != 0)
    where = f"{' and '.join(words)}{' of' * (height == 0)} centre" if words else "in the centre"
    chance = (plan.get("pot_probability") or {}).get("value")
    often = "" if chance is None else f", in about {100 * chance:.0f} of 100 plays"
    return (
        f"Aim the cue at {dict(strike_words(plan))['θ, counter-clockwise from +x']}, strike the {goal.get('cue')} "
        f"{where} with string {launcher.get('string', '–')}: the {goal.get('object')} goes "
        f"{_clause(plan.get('kind') or 'down')}{often}; the cue ball stops {rest_words(plan.get('rest'))}."
    )


def wanted(plan: Mapping[str, Any]) -> tuple[Array | None, float]:
    """Where the cue ball is wanted (2,) [m], None for anywhere, and how far from there it may be [m]."""
    goal = plan["scene"].get("goal") or {}
    place = goal.get("rest") or goal.get("rest_region")
    return (None, 0.0) if not place else (np.array(place[:2], float), float(place[2]) if len(place) > 2 else 0.0)


def _clause(kind: str) -> str:
    """The first clause of a kind of shot, to stand inside a sentence."""
    clause = kind.split(";")[0]
    return clause[clause.index("into ") :] if "into " in clause else f"down ({clause})"
