"""The same shots here and in pooltool, side by side in one run: milliseconds a shot, and their ratio."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from models.engine.play import finish
from models.model_file import Model, full_model
from models.shot import Shot, Table
from models.simulation.simulate import simulate
from models.table.snooker import SNOOKER_BALL
from sysid.validation.tested_models import in_mujoco
from tests.truth import physics
from tests.truth.cloth import Constants as Truth

LONG = 120.0  # after which every ball rests [s]
SLIDE, ROLL, SPIN = 0.2, 0.01, 22.0
BALL_E, BALL_MU, CUSHION_E, CUSHION_MU = 0.95, 0.05, 0.85, 0.14
CONSTANTS = {
    "decoupled_cloth.slide": SLIDE, "decoupled_cloth.roll": ROLL, "decoupled_cloth.spin": SPIN,
    "ball_impact.restitution": BALL_E, "ball_impact.friction": BALL_MU,
    "cushion_impact.restitution": CUSHION_E, "cushion_impact.friction": CUSHION_MU,
}  # fmt: skip
TABLE = Table(3.545, 1.746)  # pooltool's snooker table; where it differs, that one is used


def _shot(position: list[tuple[float, float]], velocity: np.ndarray, spin: np.ndarray) -> Shot:
    n = len(position)
    v, w = np.zeros((n, 2)), np.zeros((n, 3))
    v[0], w[0] = velocity, spin
    return Shot(tuple(f"ball {i}" for i in range(n)), np.array(position), v, w, np.array([0.0, LONG]))


def _world(table: Table) -> Model:
    return full_model(table, SNOOKER_BALL).with_values(CONSTANTS)


def single(rng: np.random.Generator, table: Table) -> Shot:
    """One ball at 2 m/s, with side, to a long cushion."""
    heading = rng.uniform(0.5, 1.2)
    start = (rng.uniform(-0.9, 0.3), rng.uniform(-0.3, 0.1))
    way = np.array([np.cos(heading), np.sin(heading)])
    return _shot([start], 2.0 * way, np.array([-way[1], way[0], rng.choice([-1.0, 1.0])]) * 30.0)


def double(rng: np.random.Generator, table: Table) -> Shot:
    """2 m/s at a ball half a metre ahead, a little off the line."""
    start, heading = rng.uniform((-1.2, -0.4), (0.6, 0.4)), rng.uniform(-0.6, 0.6)
    way = np.array([np.cos(heading), np.sin(heading)])
    red = start + 0.5 * way + rng.uniform(-0.03, 0.03) * np.array([-way[1], way[0]])
    return _shot([tuple(start), tuple(red)], 2.0 * way, rng.normal(0, 15, 3))


def rack(rng: np.random.Generator, table: Table) -> Shot:
    """A full-power break of 22 balls on their spots, the reds some tenths of a millimetre apart."""
    d = SNOOKER_BALL.diameter * (1 + 1e-3)
    x0 = table.length / 4 + SNOOKER_BALL.diameter * 1.01
    half, baulk = table.length / 2, 0.737 - table.length / 2
    reds = [(x0 + row * d * np.sqrt(3) / 2, (k - row / 2) * d) for row in range(5) for k in range(row + 1)]
    reds = [tuple(np.array(xy) + rng.uniform(-1, 1, 2) * 1e-5) for xy in reds]
    colours = [(baulk, 0.292), (baulk, 0.0), (baulk, -0.292), (0.0, 0.0), (table.length / 4, 0.0), (half - 0.324, 0.0)]
    cue = np.array([baulk + 0.05, rng.uniform(0.18, 0.24)])
    to = np.array([x0 + rng.uniform(0, 0.02), rng.uniform(0.03, 0.05)]) - cue
    return _shot([tuple(cue), *reds, *colours], 8.0 * to / np.hypot(*to), np.zeros(3))


def _pooltool(shot: Shot, table: Any) -> Any:
    """The shot as a pooltool system, in its coordinates: x across, y along, from a corner."""
    import pooltool as pt

    extra = {
        "m": SNOOKER_BALL.mass, "R": SNOOKER_BALL.radius, "u_s": SLIDE, "u_r": ROLL, "u_b": BALL_MU, "e_b": BALL_E,
        "e_c": CUSHION_E, "f_c": CUSHION_MU,
        "u_sp_proportionality": 0.4 * SNOOKER_BALL.radius * SPIN / 9.81 / SNOOKER_BALL.radius,
    }  # fmt: skip
    balls = {}
    for i, name in enumerate(shot.names):
        x, y = shot.position[i]
        ball = pt.Ball.create(name, xy=(table.w / 2 - y, table.l / 2 + x), **extra)
        if np.any(shot.velocity[i]):
            (vx, vy), (wx, wy, wz) = shot.velocity[i], shot.spin[i]
            ball.state.rvw[1] = (-vy, vx, 0.0)
            ball.state.rvw[2] = (-wy, wx, wz)
            ball.state.s = 2
        balls[name] = ball
    return pt.System(cue=pt.Cue(cue_ball_id=shot.names[0]), table=table, balls=balls)


def _median_ms(play: Callable[[Any], object], shots: list[Any]) -> float:
    took = []
    for shot in shots:
        began = time.perf_counter()
        play(shot)
        took.append(time.perf_counter() - began)
    return 1e3 * float(np.median(took))


def _batch_ms(play: Callable[[], object], count: int) -> float:
    play()
    began = time.perf_counter()
    play()
    return 1e3 * (time.perf_counter() - began) / count


def from_fine_steps(table: Table, shots: list[Shot]) -> np.ndarray:
    """How far balls end from where an independent program takes them, in steps of 50 us, 40000 an impact: (n,) [m]."""
    c = Truth(
        radius=SNOOKER_BALL.radius, mass=SNOOKER_BALL.mass, mus=SLIDE, mur=ROLL, spin=SPIN, ebb=BALL_E, mubb=BALL_MU,
        ec=CUSHION_E, muc=CUSHION_MU,
    )  # fmt: skip
    found = []
    for shot, track in zip(shots, simulate(in_mujoco(_world(table)), shots), strict=True):
        starts = {
            name: physics.Start(tuple(p), tuple(v), tuple(w))
            for name, p, v, w in zip(shot.names, shot.position, shot.velocity, shot.spin, strict=True)
        }
        cloth = physics.Table(table.length, table.width, table.pockets)
        end = physics.simulate(cloth, c, starts, shot.times, increments=40_000).xy[-1]
        gone, potted = np.isnan(track.position[-1]), np.isnan(end)
        away = np.where(gone & potted, 0.0, np.abs(end - track.position[-1]))  # a ball that both have potted
        found.append(np.where(gone != potted, np.inf, away).max())
    return np.array(found)


def rows() -> list[tuple[str, ...]]:
    """Milliseconds a shot: pooltool one at a time, MuJoCo with effects and the event engine in batches."""
    theirs_found = importlib.util.find_spec("pooltool") is not None
    table, pooltable = TABLE, None
    if theirs_found:
        import pooltool as pt

        pooltable = pt.Table.from_game_type(pt.GameType.SNOOKER)
        table = Table(pooltable.l, pooltable.w)
    found: list[tuple[str, ...]] = [
        ("the same shots, ms a shot", "pooltool", "effects", "ratio", "engine", "ratio", "off mm", "worst")
    ]
    for name, make, few, count in (
        ("  one ball, side, cushion", single, 40, 1000),
        ("  two balls", double, 40, 1000),
        ("  22-ball break", rack, 20, 20),
    ):
        rng = np.random.default_rng(5)
        shots = [make(rng, table) for _ in range(count)]
        p, v, w = (np.array([getattr(s, k) for s in shots]) for k in ("position", "velocity", "spin"))
        ours = _batch_ms(lambda s=shots: simulate(in_mujoco(_world(table)), s), count)
        quick = _batch_ms(lambda p=p, v=v, w=w: finish(_world(table), p, v, w), count)
        off = from_fine_steps(table, shots[:few]) if count > few else np.array([])
        theirs = np.nan
        if theirs_found:
            import pooltool as pt

            play = lambda system: pt.simulate(system, inplace=True)  # noqa: E731
            play(_pooltool(shots[0], pooltable.copy()))
            theirs = _median_ms(play, [_pooltool(s, pooltable.copy()) for s in shots[:few]])
        found.append(
            (name, f"{theirs:.2f}", f"{ours:.4f}", f"{theirs / ours:.1f}", f"{quick:.5f}", f"{theirs / quick:.0f}",
             f"{1e3 * np.median(off):.3f}" if off.size else "", f"{1e3 * off.max():.3f}" if off.size else "")
        )  # fmt: skip
    return found


def note() -> str:
    """How the figures are to be read."""
    if importlib.util.find_spec("pooltool") is None:
        return "pooltool is not installed here, so not compared: see docs/results.md"
    return (
        "pooltool one at a time on one core, median; effects and engine in a batch (1000; 20 racks), on all cores;\n"
        "off: effects in MuJoCo, from where an independent program takes the same shots in fine steps"
    )
