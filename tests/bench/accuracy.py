"""How far a model is from what is known: the closed form of the cloth, and the hidden constants of a clip set."""

from __future__ import annotations

import dataclasses
import json
import time
from pathlib import Path

import numpy as np

from models.model_file import Model, full_model
from models.shot import GRAVITY, Array, Ball, Shot, Table
from models.simulation.simulate import simulate
from sysid.clips import read_clip_set
from sysid.estimation import fit_clips

BALL = Ball(0.0525, 0.1406)
OPEN = Table(40.0, 40.0, pockets=False)  # no cushion within reach
TIMES = np.linspace(0, 3, 61)
LAW = {"slide": 0.2, "roll": 0.0127, "spin": 22.0}
SHOTS = {  # velocity [m/s], spin [rad/s]
    "stun": ((2.0, 0.0), (0.0, 0.0, 0.0)),
    "side": ((2.0, 0.0), (0.0, 0.0, 60.0)),
    "rolling": ((1.0, 0.0), (0.0, 1.0 / BALL.radius, 0.0)),
    "swerve": ((2.0, 0.0), (30.0, 0.0, 60.0)),
}
CONSTANTS = {
    "decoupled_cloth.slide": "mus",
    "decoupled_cloth.roll": "mur",
    "decoupled_cloth.spin": "spin",
    "ball_impact.restitution": "ebb",
    "ball_impact.friction": "mubb",
    "cushion_impact.restitution": "ec",
    "cushion_impact.friction": "muc",
}


def closed_form(shot: Shot) -> Array:
    """Places of one ball that slides, then rolls, then rests: (n, 2) [m] (Robotic Billiards 2015, section IV.B)."""
    v0, w0 = shot.velocity[0], shot.spin[0]
    slip = v0 + BALL.radius * np.array([-w0[1], w0[0]])
    size = float(np.hypot(*slip))
    brake = LAW["slide"] * GRAVITY * (slip / size if size else slip)
    until = 2 * size / (7 * LAW["slide"] * GRAVITY)
    t = np.minimum(shot.times, until)[:, None]
    place = shot.position[0] + v0 * t - 0.5 * brake * t**2
    v = v0 - brake * until
    speed = float(np.hypot(*v))
    t = np.clip(shot.times - until, 0, speed / (LAW["roll"] * GRAVITY))[:, None]
    return np.asarray(place + v * t - 0.5 * LAW["roll"] * GRAVITY * v / speed * t**2)


def cloth_rows() -> list[tuple[str, ...]]:
    """Largest distance from the closed form within 3 s: shot, native, effects, how many times nearer."""
    native = Model(OPEN, BALL).with_values({f"native.{k}": v for k, v in LAW.items()})
    effects = full_model(OPEN, BALL).with_values({f"decoupled_cloth.{k}": v for k, v in LAW.items()})
    effects = dataclasses.replace(effects, engine="mujoco")
    rows = [("cloth, error within 3 s", "native mm", "effects mm", "ratio")]
    for name, (velocity, spin) in SHOTS.items():
        shot = Shot(("cue",), np.zeros((1, 2)), np.array([velocity]), np.array([spin]), TIMES)
        truth = closed_form(shot)
        far = [
            float(np.hypot(*(simulate(m, [shot])[0].position[:, 0] - truth).T).max()) * 1e3 for m in (native, effects)
        ]
        rows.append((f"  {name}", f"{far[0]:.2f}", f"{far[1]:.1e}", f"{far[0] / max(far[1], 1e-12):.0e}"))
    return rows


def hidden_rows(folder: Path) -> list[tuple[str, ...]]:
    """Constants of a clip set of known truth: fitted, true, and their distance in standard deviations."""
    clip_set = read_clip_set(folder)
    truth = json.loads(folder.with_name(f"{folder.name}.truth.json").read_text(encoding="utf-8"))["parameters"]
    began = time.perf_counter()
    found = fit_clips(clip_set, full_model(clip_set.table, clip_set.ball))
    took = time.perf_counter() - began
    rows = [(f"{folder.name}, {len(clip_set.clips)} clips, {took:.0f} s", "fitted", "true", "off by sd")]
    if not found.fitted.converged:
        return [*rows, ("  did not converge", "-", "-", "-")]
    values = found.model.parameters()
    for name, short in CONSTANTS.items():
        sd = found.model.estimates[name].sd
        off = (values[name] - truth[short]) / sd
        rows.append((f"  {name}", f"{values[name]:.6g}", f"{truth[short]:.6g}", f"{off:+.2f}"))
    return rows
