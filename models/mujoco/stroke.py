"""The launcher's strokes against the cueing model (models/analytic/cue_impulse.py), and the load on its drive.

The drive in closed form, for a raised-cosine run-up of length s to the speed v: peak acceleration a = (pi / 4) v^2 / s;
force between pinion and rack F = (m_rack + m_cue) (a - g sin(tilt)) + friction; motor torque
(F + J_pinion a / r^2) r / n + J_motor a n / r; power at most 0.65 v times the torque's peak referred to the rack, since
sin(x) (1 - cos(x)) / 2 <= 0.6495. After the hit the cue, slower by dv = V M / M_cue, pulls the rack, which the servo
holds, through the grip, while the servo brakes: at most dv sqrt(k m_cue) + (m_rack + m_cue) a_brake. The needed cue
speed is V (1 + M / M_cue) / (1 + e).
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from models.mjcf.gl import choose_backend
from models.mjcf.stroke import BRAKING_DECELERATION, CUE_TILT, RUN_UP_M

if __name__ == "__main__":
    choose_backend(render="--picture" in " ".join(sys.argv))  # before MuJoCo is imported

import click
import mujoco
import numpy as np

from models.analytic.cue_impulse import Constants, Geometry, launch
from models.commands.console import Status
from models.commands.options import FILE_PATH, OUTPUT_FILE
from models.commands.program import lone_command, run
from models.errors import BadInput
from models.files import write_whole
from models.mjcf.launcher import CUE_MASS, GEAR_RATIO, NAME_PREFIX, PINION_RADIUS_M, TIP_RESTITUTION
from models.mjcf.world import add_camera
from models.model_file import full_model
from models.mujoco.launcher import Launcher, SimulatedStroke
from models.mujoco.world import World
from models.shot import GRAVITY, Array
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE

Stroke = tuple[float, float, float]  # cue speed [m/s], side and height of its axis [m]
CUE_BALL_SPOT = np.array([-1.23, 0.0])  # place of the struck ball [m]
GRID_SPEEDS = (0.5, 1.0, 1.5, 2.0, 2.5)  # speeds of the cue (Robotic Billiards 2015) [m/s]
GRID_SIDES, GRID_HEIGHTS = np.arange(0, 13, 2) / 1000, np.arange(-12, 13, 2) / 1000  # x'0, y'0 (the same) [m]
PAPER_GRID = tuple((v, float(x), float(y)) for v, x, y in itertools.product(GRID_SPEEDS, GRID_SIDES, GRID_HEIGHTS))
SMALL_GRID = tuple(itertools.product(GRID_SPEEDS[::2] + GRID_SPEEDS[3:4], (0.0, 0.006, 0.012), (-0.008, 0.0, 0.008)))
MOTOR_RATING = {
    "torque": 0.64,
    "peak torque": 1.92,
    "power": 200.0,
    "speed": 3000.0,
    "top speed": 5000.0,
}  # SVL-202, N m, W, rpm
BEARING_FRICTION = 2.0  # friction of the rack's bearings [N]
RPM_PER_RAD_S = 30 / np.pi


@cache
def machine() -> Launcher:
    """The launcher at a snooker table with the constants of the literature."""
    return Launcher(World(full_model(SNOOKER_TABLE, SNOOKER_BALL), ("white",)))


def played(launcher: Launcher, strokes: Sequence[Stroke], *, threads: int = 2) -> list[SimulatedStroke]:
    """Strokes along x at the ball on its spot."""
    return launcher.strike_all({launcher.name: CUE_BALL_SPOT}, 0.0, strokes, threads=threads)


def errors(launcher: Launcher, asked: Sequence[Stroke], strokes: Sequence[SimulatedStroke]) -> Array:
    """Errors of strokes along x against the cueing model at the attained cue speed: (n, 3).

    Columns: horizontal ball speed [%]; spin, the length of the difference times R over the ball's speed [%] (100 is as
    much as natural roll); squirt [degrees]. The model is models/analytic/cue_impulse.py with the cloth's friction; the
    hop comes later, so there is none in either.
    """
    model, device = launcher.world.model, launcher.device
    constants = Constants(
        device.tip_restitution, device.cue_mass, device.end_mass, float(model.parameters()["decoupled_cloth.slide"])
    )
    _, side, height = np.array(asked, float).T
    attained = np.array([s.cue_speed for s in strokes])
    velocity, spin = launch(constants, Geometry(model.ball), attained, side, height)
    found, turned = np.array([s.velocity for s in strokes]), np.array([s.spin for s in strokes])
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    away = np.arctan2(found[:, 1], found[:, 0]) - np.arctan2(velocity[:, 1], velocity[:, 0])
    return np.column_stack(
        [
            100 * (np.hypot(found[:, 0], found[:, 1]) / speed - 1),
            100 * model.ball.radius * np.linalg.norm(turned - spin, axis=1) / speed,
            np.degrees(away),
        ]
    )


def compare(asked: Sequence[Stroke]) -> list[SimulatedStroke]:
    """Run strokes and print their errors by speed and by offset."""
    launcher = machine()
    strokes = played(launcher, asked)
    wrong, given = errors(launcher, asked, strokes), np.array(asked)
    offset = 1e3 * np.hypot(given[:, 1], given[:, 2])
    print(f"{len(asked)} strokes against the cueing model; each pair: root mean square, worst")
    print(f"{'':20}{'strokes':>8}{'ball speed [%]':>18}{'spin [% of roll]':>18}{'squirt [deg]':>18}")
    rows = [(f"cue {v:.1f} m/s", given[:, 0] == v) for v in np.unique(given[:, 0])]
    for low in range(0, 18, 3):
        rows.append((f"offset {low} to {low + 3} mm", (offset > low - 1e-6) & (offset < low + 3 - 1e-6)))
    rows.append(("all", np.ones(len(given), bool)))
    for name, chosen in rows:
        if np.any(chosen):
            part = wrong[chosen]
            rms, worst = np.sqrt(np.mean(part**2, axis=0)), part[np.argmax(np.abs(part), axis=0), range(3)]
            text = "".join(f"{a:9.2f}{b:+9.2f}" for a, b in zip(rms, worst, strict=True))
            print(f"{name:20}{len(part):8}{text}")
    slipped = 1e3 * max(s.slip for s in strokes)
    print(f"miscues: {sum(s.miscue for s in strokes)}; farthest the tip slipped: {slipped:.3f} mm")
    print(f"the cue slows as one of {effective_mass(launcher):.3f} kg would ({CUE_MASS} kg are in it)")
    return strokes


def effective_mass(launcher: Launcher) -> float:
    """Mass with which the cue hits: the ball's momentum over what the cue loses in speed, centre ball, 2 m/s [kg]."""
    [stroke] = played(launcher, [(2.0, 0.0, 0.0)])
    given = SNOOKER_BALL.mass * stroke.velocity[0] / np.cos(CUE_TILT)  # the slate turns the impulse level
    return float(given / (stroke.cue_speed - stroke.cue_left))


def needed_cue_speed(ball_speed: float) -> float:
    """Cue speed for a ball hit in the centre, by the analytic model [m/s]."""
    return (1 + SNOOKER_BALL.mass / CUE_MASS) * ball_speed / (1 + TIP_RESTITUTION)


def closed_form(launcher: Launcher, cue_speed: float) -> dict[str, float]:
    """The drive's peaks by the formulas above: run-up and pull after the hit; SI, turns in rpm."""
    model = launcher.model
    rack = model.body(f"{NAME_PREFIX}rack").mass[0]
    cue = sum(model.body(f"{NAME_PREFIX}{name}").mass[0] for name in ("cue", "shaft end", "tip"))
    wheel, rotor = model.body(f"{NAME_PREFIX}pinion").inertia.max(), model.body(f"{NAME_PREFIX}motor").inertia.max()
    acceleration = np.pi / 4 * cue_speed**2 / RUN_UP_M
    force = (rack + cue) * (acceleration - GRAVITY * np.sin(CUE_TILT)) + BEARING_FRICTION
    torque = (
        force + wheel * acceleration / PINION_RADIUS_M**2
    ) * PINION_RADIUS_M / GEAR_RATIO + rotor * acceleration * GEAR_RATIO / PINION_RADIUS_M
    grip = model.jnt_stiffness[model.joint(f"{NAME_PREFIX}grip slide").id]
    lost = cue_speed * (1 + TIP_RESTITUTION) / (1 + SNOOKER_BALL.mass / cue) * SNOOKER_BALL.mass / cue
    return {
        "acceleration": acceleration,
        "force": force,
        "torque": torque,
        "power": 0.6495 * torque * GEAR_RATIO / PINION_RADIUS_M * cue_speed,
        "motor": cue_speed * GEAR_RATIO / PINION_RADIUS_M * RPM_PER_RAD_S,
        "pinion": cue_speed / PINION_RADIUS_M * RPM_PER_RAD_S,
        "pull": lost * np.sqrt(grip * cue) + (rack + cue) * BRAKING_DECELERATION,
    }


def print_drive() -> None:
    """Print the load on the drive for a ball of 4 m/s, simulated and in closed form, and its rating."""
    ball_speed = 4.0
    launcher, places = machine(), {"white": CUE_BALL_SPOT}
    [trial] = played(launcher, [(needed_cue_speed(ball_speed), 0.0, 0.0)])
    cue_speed = needed_cue_speed(ball_speed) * ball_speed / float(np.hypot(*trial.velocity[:2]))
    [upto] = played(launcher, [(cue_speed, 0.0, 0.0)])
    whole = launcher.strike(launcher.world.place(places), cue_speed, follow_through=True)
    ideal = closed_form(launcher, needed_cue_speed(ball_speed))
    motor = upto.motor_speed * RPM_PER_RAD_S
    print(f"\ndrive for a ball of {ball_speed} m/s")
    print(f"{'':34}{'simulated':>12}{'closed form':>13}{'200 W servo':>14}")
    rows = (
        ("cue speed [m/s]", upto.cue_speed, needed_cue_speed(ball_speed), ""),
        ("peak acceleration [m/s^2]", np.nan, ideal["acceleration"], ""),
        ("force on the rack, run-up [N]", upto.rack_force, ideal["force"], ""),
        ("force on the rack, after hit [N]", whole.rack_force, ideal["pull"], ""),
        ("motor torque, run-up [N m]", upto.torque, ideal["torque"], f"{MOTOR_RATING['torque']} rated"),
        ("motor torque, whole stroke [N m]", whole.torque, np.nan, f"{MOTOR_RATING['peak torque']} peak"),
        ("power, run-up [W]", upto.power, ideal["power"], f"{MOTOR_RATING['power']:.0f} rated"),
        ("pinion speed [rpm]", motor / GEAR_RATIO, ideal["pinion"], ""),
        (
            "motor speed, rated/max [rpm]",
            motor,
            ideal["motor"],
            f"{MOTOR_RATING['speed']:.0f}/{MOTOR_RATING['top speed']:.0f}",
        ),
        ("travel of the rack [mm]", 1e3 * whole.travel, np.nan, ""),
    )
    for name, simulated, formula, rating in rows:
        cells = "".join(f"{value:{width}.2f}" if np.isfinite(value) else f"{'':{width}}"
                        for value, width in ((simulated, 12), (formula, 13)))  # fmt: skip
        print(f"{name:34}{cells}{rating:>14}")
    able = whole.torque < MOTOR_RATING["peak torque"] and motor < MOTOR_RATING["top speed"]
    often = (
        upto.torque < MOTOR_RATING["torque"] and upto.power < MOTOR_RATING["power"] and motor < MOTOR_RATING["speed"]
    )
    print("it can: within peak torque and top speed" if able else "it cannot")
    print("within its continuous rating too" if able and often else "above its continuous rating, for the run-up only")


def write_csv(path: Path, asked: Sequence[Stroke], strokes: Sequence[SimulatedStroke]) -> None:
    """Write a CSV file with a row for every stroke, in SI units."""
    head = "speed_asked,side,height,cue_speed,vx,vy,vz,wx,wy,wz,squirt,contact_time,tip_force,slip,miscue\n"
    rows = []
    for one, s in zip(asked, strokes, strict=True):
        values = (*one, s.cue_speed, *s.velocity, *s.spin, s.squirt, s.contact_time, s.tip_force, s.slip)
        rows.append(",".join(f"{value:.6g}" for value in values) + f",{int(s.miscue)}\n")
    write_whole(path, (head + "".join(rows)).encode(), parents=True)


def picture(path: Path, width: int = 1280) -> None:
    """Draw the launcher at the table, just before the hit."""
    from models.mjcf.gl import require_rendering
    from models.mjcf.render import write_png  # it chooses the library that draws

    if not 160 <= width <= 4096:
        raise BadInput(f"width is {width}; give 160 to 4096 pixels")
    require_rendering()
    others = {"yellow": (-0.2, 0.35), "red 1": (0.9, 0.0), "blue": (0.45, -0.3)}
    world = World(full_model(SNOOKER_TABLE, SNOOKER_BALL), ("white", *others), furnished=True)
    launcher = Launcher(world)
    eye, target = np.array([-1.42, 1.16, 0.52]), np.array([-2.0, 0.0, 0.04])
    add_camera(world.spec, "launcher", eye, target, 45.0)
    world.spec.worldbody.add_light(
        name="work lamp", pos=[-2.0, 1.3, 1.5], dir=[-0.25, -0.65, -0.7], diffuse=[0.42, 0.42, 0.4], castshadow=False
    )
    size = (width, width * 9 // 16)
    world.spec.visual.global_.offwidth, world.spec.visual.global_.offheight = size
    world.recompile()
    data = world.place({"white": CUE_BALL_SPOT, **others})
    launcher.aim(data, 0.0)
    data.joint(f"{NAME_PREFIX}rack").qpos = 0.06
    data.joint(f"{NAME_PREFIX}pinion").qpos = 0.06 / PINION_RADIUS_M
    mujoco.mj_forward(world.mj_model, data)
    with mujoco.Renderer(world.mj_model, size[1], size[0]) as renderer:
        renderer.update_scene(data, "launcher")
        write_png(np.array(renderer.render()), path)


@lone_command("models.mujoco.stroke")
@click.option("--grid", is_flag=True, help="All 455 strokes; without it a coarse grid of 36.")
@click.option("--out", metavar="CSV", type=OUTPUT_FILE, help="Write every stroke.")
@click.option("--picture", "picture_file", type=FILE_PATH, metavar="OUT.png", help="Only draw the launcher.")
@click.option("--width", type=int, default=1280, show_default=True, help="Width of the picture [pixels].")
def main(grid: bool, out: Path | None, picture_file: Path | None, width: int) -> int:
    """Compare the launcher's strokes with the cueing model, and print the load on its drive for a 4 m/s ball."""
    if picture_file:
        picture(picture_file, width)
        return Status.DONE
    asked = PAPER_GRID if grid else SMALL_GRID
    strokes = compare(asked)
    print_drive()
    if out:
        write_csv(out, asked, strokes)
    return Status.DONE


if __name__ == "__main__":
    sys.exit(run(main))
