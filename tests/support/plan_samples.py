"""A plan made up, as its file has it."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np

from models.shot import Array, Ball, Table

TABLE, BALL = Table(3.569, 1.778), Ball(0.0525, 0.1406)
HALF = np.array([TABLE.length, TABLE.width]) / 2
BALLS = {
    "white": [-0.62, -0.38], "red": [0.86, 0.31], "red 2": [1.21, -0.42], "blue": [0.0, 0.0], "pink": [0.8922, 0.02],
    "black": [1.4605, 0.0], "yellow": [-1.0475, -0.292], "green": [-1.0475, 0.292], "brown": [-1.0475, 0.0],
}  # fmt: skip
REST = np.array([0.75, -0.25])
AIM = REST + np.array([0.02, 0.03])  # where the sample's white stops without noise


def way(points: list[Array], speed: float, start: float = 0.0) -> dict[str, Any]:
    """A ball that waits, then slows down along straight lines and stops at the last point."""
    corners = np.array(points)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    last = 2 * along[-1] / speed
    t = np.arange(0.0, last, 0.02)
    gone = along[-1] * (1 - (1 - t / last) ** 2)
    xy = np.stack([np.interp(gone, along, axis) for axis in corners.T], axis=1)
    t = np.concatenate([[0.0], start + t]) if start else t
    xy = np.vstack([corners[:1], xy]) if start else xy
    return {"t": np.round(t, 4).tolist(), "xy": np.round(xy, 5).tolist()}


def shot(miss: float, pace: float, rest: Array) -> tuple[list[dict[str, Any]], bool]:
    """The white cuts the red into the corner +x +y and runs over the cushion +y to where it rests; or the red misses.

    `miss` turns the red's way [rad], `pace` is the factor on all speeds.
    """
    white, red, pocket = np.array(BALLS["white"]), np.array(BALLS["red"]), HALF
    to = (pocket - red) / np.hypot(*(pocket - red))
    touch = red - 2 * BALL.radius * to
    to = np.array([[math.cos(miss), -math.sin(miss)], [math.sin(miss), math.cos(miss)]]) @ to
    potted = abs(math.hypot(*(pocket - red)) * miss) < 0.03
    reach = HALF - BALL.radius
    if potted:
        reds = [red, pocket - 0.02]
    else:
        length = min((reach - red) / np.maximum(to, 1e-9))
        cushion = red + length * to
        back = to * (np.array([1, -1]) if cushion[1] > reach[1] - 1e-6 else np.array([-1, 1]))
        reds = [red, cushion, np.clip(cushion + 0.35 * pace * back, -reach, reach)]
    over = np.array([touch[0] - 0.12 + 2 * miss, reach[1]])
    tracks = [
        {"ball": "white", **way([white, touch, over, rest], 2.1 * pace)},
        {"ball": "red", **way(reds, 1.4 * pace, start=0.95 / pace)},
    ]
    return tracks, potted


def sample(draws: int = 40, places: int = 500) -> dict[str, Any]:
    """A plan as the planner writes it, with the scatter of a careful launcher."""
    rng = np.random.default_rng(3)
    tracks, _ = shot(0.002, 1.0, AIM)

    def draw() -> tuple[float, float, Array]:
        """Turn of the red's way [rad], pace, and where the white rests."""
        miss, pace = rng.normal(0.004, 0.015), 1 + rng.normal(0, 0.03)
        rest = AIM + np.array([0.9 * (pace - 1) + 2.2 * miss, -2.6 * (pace - 1)]) + rng.normal(0, 0.012, 2)
        return float(miss), float(pace), rest

    fan = []
    for k in range(draws):
        run, potted = shot(*draw())
        fan.append({"potted": potted, "foul": "touches pink" if k in (7, 23) else "", "tracks": run})
    ends = [draw() for _ in range(places)]
    cloud = np.array([end[2] for end in ends]).reshape(-1, 2)
    potted = [abs(end[0]) * float(np.hypot(*(HALF - BALLS["red"]))) < 0.03 for end in ends]
    far = np.hypot(*(cloud - REST).T)
    stroke = {"speed": 2.31, "azimuth": 0.395, "side": -0.003, "height": 0.005, "elevation": math.radians(6.5)}
    launcher = {"string": "073p", "x0_mm": -3.0, "y0_mm": 5.0, "theta": 0.3962, "theta_deg": 22.7006,
                "theta_tolerance_deg": [-0.12, 0.1], "cue_speed": 1.86}  # fmt: skip
    plan = {
        "format": "billiard-plan/1", "method": "risk", "seed": 11,
        "why": "The cut is thin enough to hold the white, and 6 mm of yaw at the pocket still pots it.",
        "scene": {
            "format": "billiard-scene/1", "table": {"length": TABLE.length, "width": TABLE.width, "pockets": True},
            "ball": {"diameter": BALL.diameter, "mass": BALL.mass}, "balls": copy.deepcopy(BALLS),
            "goal": {"cue": "white", "object": "red", "pocket": [1, 1], "rest": REST.tolist(), "avoid": ["pink"]},
        },
        "model": {"file": "fitted.toml", "effects": ["decoupled_cloth", "ball_impact", "cushion_impact"]},
        "execution": {"speed_sd": 0.012, "azimuth_sd": 0.0013, "side_sd": 0.0005, "height_sd": 0.0008},
        "stroke": stroke, "launcher": launcher, "pocket": [1, 1],
        "kind": "cut into the corner pocket +x +y; cue ball over the +y cushion",
        "pot_probability": {"value": 0.873, "low": 0.841, "high": 0.899},
        "foul_probability": {"value": 0.046, "low": 0.031, "high": 0.068},
        "fouls": {"in-off": 0.01, "touches pink": 0.036, "touches blue": 0.0},
        "rest": {"mean": cloud.mean(axis=0).tolist(), "sd": cloud.std(axis=0).tolist(),
                 "distance_median": float(np.median(far)), "distance_90": float(np.quantile(far, 0.9))},
        "value": 0.83, "tracks": tracks, "fan": fan, "places": {"cue": cloud.tolist(), "potted": potted},
    }  # fmt: skip
    others = []
    for number, (kind, end) in enumerate(
        (
            ("straight into the corner pocket +x +y; cue ball stays", [0.9, 0.3]),
            ("cut into the corner pocket +x +y; cue ball over +y and +x", [1.2, 0.5]),
            ("double into the middle pocket +y; cue ball free", [0.3, -0.6]),
        )
    ):
        keys = ("pocket", "foul_probability", "fouls", "rest", "value")
        other = {key: copy.deepcopy(plan[key]) for key in keys}
        other |= {"kind": kind, "why": f"Safer by {number} parts in ten, but it leaves the white nowhere."}
        other |= {"stroke": {**stroke, "speed": 1.5 + number}, "launcher": {**launcher, "string": f"1{number}0p"}}
        other |= {"pot_probability": {"value": 0.61 - 0.1 * number, "low": 0.5, "high": 0.7}}
        others.append(other | {"tracks": shot(0.001, 0.8 + 0.2 * number, np.array(end))[0]})
    return plan | {"alternatives": others}


TEXT = """format = "billiard-scene/1"

[table]
length = 3.569
width = 1.778

[ball]
diameter = 0.0525
mass = 0.1406

[balls]
blue = [0.0, 0.0]
white = [-0.5, 0.2]
red = [1.0, 0.4]
"red 2" = [1.2, -0.5]

[goal]
cue = "white"
object = "red"
pocket = [1, 1]
rest_for = "blue"
avoid = ["red 2"]
"""
