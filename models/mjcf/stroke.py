"""What the launcher's strokes give against the analytic cueing model, and what they ask of its drive.

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
from pathlib import Path

import click
import mujoco
import numpy as np

from models.analytic import cueing
from models.command_line import FILE_PATH, OUTPUT_FILE, lone_command, run
from models.console import Status
from models.errors import BadInput
from models.files import write_whole
from models.mjcf import launcher
from models.mjcf.launcher import (
    CUE_TILT,
    GEAR_RATIO,
    NAME_PREFIX,
    PINION_RADIUS_M,
    RUN_UP,
    LauncherScene,
    SimulatedStroke,
    build_scene,
    strike,
    strike_all,
)
from models.mjcf.native import Native
from models.mjcf.snooker import SNOOKER_BALL, SNOOKER_TABLE
from models.shot import GRAVITY, Array

CUE_BALL_SPOT = np.array([-1.23, 0.0])  # where the struck ball lies [m]
ANALYTIC_CUE = cueing.CueStick(
    launcher.CUE_MASS,
    launcher.END_MASS,
    launcher.TIP_RADIUS,
    launcher.TIP_RESTITUTION,
    launcher.TIP_FRICTION,
    float(CUE_TILT),
)
GRID_SPEEDS = (0.5, 1.0, 1.5, 2.0, 2.5)  # of the cue (Robotic Billiards 2015) [m/s]
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
BEARING_FRICTION = 2.0  # of the rack's bearings [N]
RPM_PER_RAD_S = 30 / np.pi


def grid(
    scene: LauncherScene,
    speeds: Sequence[float] = GRID_SPEEDS,
    sides: Array = GRID_SIDES,
    heights: Array = GRID_HEIGHTS,
) -> dict[str, Array]:
    """Strokes over a grid: "speed" (relative to the cue's), "squirt" [rad], "spin" (..., 3) [rad/s], "miscue".

    Every array is (speeds, sides, heights) and, of spin, 3 more.
    """
    shots = [(float(v), float(x), float(y)) for v, x, y in itertools.product(speeds, sides, heights)]
    strokes = strike_all(scene, shots)
    shape = (len(speeds), len(sides), len(heights))
    return {
        "speed": np.array([np.hypot(*s.velocity[:2]) / s.cue_speed for s in strokes]).reshape(shape),
        "squirt": np.array([s.squirt for s in strokes]).reshape(shape),
        "spin": np.array([s.spin for s in strokes]).reshape(*shape, 3),
        "miscue": np.array([s.miscue for s in strokes]).reshape(shape),
    }


def errors(
    scene: LauncherScene,
    shots: Sequence[tuple[float, float, float]],
    strokes: Sequence[SimulatedStroke],
    *,
    rubbed: bool = False,
) -> Array:
    """How far strokes are from the analytic model at the cue speed that was attained: (n, 3).

    Columns: horizontal ball speed [%]; spin, the length of the difference times R over the ball's speed [%] (100 is as
    much as natural roll); squirt [degrees]. The analytic ball leaves along the cue and keeps the horizontal part; with
    `rubbed` the slate's friction acts on it afterwards. The bounce comes later, so there is none in either.
    """
    rub = Native().slide if rubbed else 0.0
    rows = []
    for (_, side, height), stroke in zip(shots, strokes, strict=True):
        model = cueing.strike(
            ANALYTIC_CUE, scene.ball, stroke.cue_speed, scene.azimuth, side, height, slate=0.0, slate_friction=rub
        )
        speed = np.hypot(*model.velocity)
        turn = np.arctan2(model.velocity[1], model.velocity[0]) - scene.azimuth
        rows.append(
            (
                100 * (np.hypot(*stroke.velocity[:2]) / speed - 1),
                100 * scene.ball.radius * np.linalg.norm(stroke.spin - model.spin) / speed,
                np.degrees(stroke.squirt - np.arctan2(np.sin(turn), np.cos(turn))),
            )
        )
    return np.array(rows)


def compare(
    shots: Sequence[tuple[float, float, float]], *, slate: bool
) -> tuple[Sequence[tuple[float, float, float]], list[SimulatedStroke]]:
    """Run strokes and print their errors by speed and by offset."""
    scene = build_scene(SNOOKER_TABLE, SNOOKER_BALL, ("white",), CUE_BALL_SPOT, 0.0, slate=slate)
    strokes = strike_all(scene, shots)
    wrong = errors(scene, shots, strokes)
    given = np.array(shots)
    offset = 1e3 * np.hypot(given[:, 1], given[:, 2])
    print(
        f"{len(shots)} strokes, {'ball on the slate' if slate else 'ball afloat'}, against the analytic cueing model;"
    )
    print("each pair: root mean square, worst")
    print(f"{'':20}{'strokes':>8}{'ball speed [%]':>18}{'spin [% of roll]':>18}{'squirt [deg]':>18}")
    every = np.ones(len(given), bool)
    rows = [(f"cue {v:.1f} m/s", given[:, 0] == v, wrong) for v in np.unique(given[:, 0])]
    for low in range(0, 18, 3):
        rows.append((f"offset {low} to {low + 3} mm", (offset > low - 1e-6) & (offset < low + 3 - 1e-6), wrong))
    rows.append(("all", every, wrong))
    if slate:
        rows.append(("all, slate rubs both", every, errors(scene, shots, strokes, rubbed=True)))
    for name, chosen, found in rows:
        if np.any(chosen):
            part = found[chosen]
            rms, worst = np.sqrt(np.mean(part**2, axis=0)), part[np.argmax(np.abs(part), axis=0), range(3)]
            text = "".join(f"{a:9.2f}{b:+9.2f}" for a, b in zip(rms, worst, strict=True))
            print(f"{name:20}{len(part):8}{text}")
    slipped = 1e3 * max(s.slip for s in strokes)
    print(f"miscues: {sum(s.miscue for s in strokes)}; farthest the tip slipped: {slipped:.3f} mm")
    print(f"the cue slows as one of {effective_mass(scene):.3f} kg would ({launcher.CUE_MASS} kg are in it)")
    return shots, strokes


def effective_mass(scene: LauncherScene, cue_speed: float = 2.0) -> float:
    """Mass with which the cue hits: momentum of the ball over what the cue loses in speed, centre ball [kg]."""
    stroke = strike(scene, cue_speed)
    along = stroke.velocity[0] * np.cos(scene.azimuth) + stroke.velocity[1] * np.sin(scene.azimuth)
    given = scene.ball.mass * along / np.cos(CUE_TILT)  # the slate turns the impulse along the cue into the horizontal
    return float(given / (stroke.cue_speed - stroke.cue_left))


def needed_cue_speed(ball_speed: float) -> float:
    """Cue speed for a ball hit in the centre, by the analytic model [m/s]."""
    return (1 + SNOOKER_BALL.mass / launcher.CUE_MASS) * ball_speed / (1 + launcher.TIP_RESTITUTION)


def closed_form(scene: LauncherScene, cue_speed: float) -> dict[str, float]:
    """The drive's peaks by the formulas above: run-up and pull after the hit; SI, turns in rpm."""
    model = scene.model
    rack = model.body(f"{NAME_PREFIX}rack").mass[0]
    cue = sum(model.body(f"{NAME_PREFIX}{name}").mass[0] for name in ("cue", "shaft end", "tip"))
    wheel, rotor = model.body(f"{NAME_PREFIX}pinion").inertia.max(), model.body(f"{NAME_PREFIX}motor").inertia.max()
    acceleration = np.pi / 4 * cue_speed**2 / RUN_UP
    force = (rack + cue) * (acceleration - GRAVITY * np.sin(CUE_TILT)) + BEARING_FRICTION
    torque = (
        force + wheel * acceleration / PINION_RADIUS_M**2
    ) * PINION_RADIUS_M / GEAR_RATIO + rotor * acceleration * GEAR_RATIO / PINION_RADIUS_M
    grip = model.jnt_stiffness[model.joint(f"{NAME_PREFIX}grip slide").id]
    lost = cue_speed * (1 + launcher.TIP_RESTITUTION) / (1 + SNOOKER_BALL.mass / cue) * SNOOKER_BALL.mass / cue
    return {
        "acceleration": acceleration,
        "force": force,
        "torque": torque,
        "power": 0.6495 * torque * GEAR_RATIO / PINION_RADIUS_M * cue_speed,
        "motor": cue_speed * GEAR_RATIO / PINION_RADIUS_M * RPM_PER_RAD_S,
        "pinion": cue_speed / PINION_RADIUS_M * RPM_PER_RAD_S,
        "pull": lost * np.sqrt(grip * cue) + (rack + cue) * launcher.BRAKING_DECELERATION,
    }


def print_drive(ball_speed: float = 4.0) -> None:
    """Print what a ball of this speed asks of the drive, simulated and in closed form, beside its rating."""
    scene = build_scene(SNOOKER_TABLE, SNOOKER_BALL, ("white",), CUE_BALL_SPOT, 0.0)
    trial = strike(scene, needed_cue_speed(ball_speed))
    cue_speed = needed_cue_speed(ball_speed) * ball_speed / float(np.hypot(*trial.velocity[:2]))
    upto, whole = strike(scene, cue_speed), strike(scene, cue_speed, follow_through=True)
    ideal = closed_form(scene, needed_cue_speed(ball_speed))
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


def write_csv(path: Path, shots: Sequence[tuple[float, float, float]], strokes: Sequence[SimulatedStroke]) -> None:
    """Write every stroke, SI."""
    head = "speed_asked,side,height,cue_speed,vx,vy,vz,wx,wy,wz,squirt,contact_time,tip_force,slip,miscue\n"
    rows = []
    for shot, s in zip(shots, strokes, strict=True):
        values = (*shot, s.cue_speed, *s.velocity, *s.spin, s.squirt, s.contact_time, s.tip_force, s.slip)
        rows.append(",".join(f"{value:.6g}" for value in values) + f",{int(s.miscue)}\n")
    write_whole(path, (head + "".join(rows)).encode(), parents=True)


def picture(path: Path, width: int = 1280) -> None:
    """Draw the launcher at the table, just before the hit."""
    from models.mjcf.gl import require_rendering
    from models.mjcf.render import write_png  # it chooses the library that draws

    if not 160 <= width <= 4096:
        raise BadInput(f"width is {width}; give 160 to 4096 pixels")
    require_rendering()
    others = np.array([[-0.2, 0.35], [0.9, 0.0], [0.45, -0.3]])
    scene = build_scene(
        SNOOKER_TABLE,
        SNOOKER_BALL,
        ("white", "yellow", "red 1", "blue"),
        CUE_BALL_SPOT,
        0.0,
        others=others,
        furnished=True,
    )
    eye, target = np.array([-1.42, 1.16, 0.52]), np.array([-2.0, 0.0, 0.04])
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    camera = scene.spec.worldbody.add_camera(name="launcher", pos=eye, fovy=45)
    camera.alt.type = mujoco.mjtOrientation.mjORIENTATION_XYAXES
    camera.alt.xyaxes = np.concatenate([right, np.cross(back, right)])
    scene.spec.worldbody.add_light(
        name="work lamp", pos=[-2.0, 1.3, 1.5], dir=[-0.25, -0.65, -0.7], diffuse=[0.42, 0.42, 0.4], castshadow=False
    )
    size = (width, width * 9 // 16)
    scene.spec.visual.global_.offwidth, scene.spec.visual.global_.offheight = size
    model = scene.spec.compile()
    data = mujoco.MjData(model)
    data.joint(f"{NAME_PREFIX}rack").qpos = 0.06
    data.joint(f"{NAME_PREFIX}pinion").qpos = 0.06 / PINION_RADIUS_M
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, size[1], size[0]) as renderer:
        renderer.update_scene(data, "launcher")
        write_png(np.array(renderer.render()), path)


@lone_command("models.mjcf.stroke")
@click.option("--grid", is_flag=True, help="All 455 strokes; without it a coarse grid of 36.")
@click.option("--float", "afloat", is_flag=True, help="Leave out the slate under the ball.")
@click.option("--out", metavar="CSV", type=OUTPUT_FILE, help="Write every stroke.")
@click.option("--picture", "picture_file", type=FILE_PATH, metavar="OUT.png", help="Only draw the launcher.")
@click.option("--width", type=int, default=1280, show_default=True, help="Width of the picture [pixels].")
def main(grid: bool, afloat: bool, out: Path | None, picture_file: Path | None, width: int) -> int:
    """Compare the launcher's strokes with the cueing model, and print what a 4 m/s ball asks of its drive."""
    if picture_file:
        picture(picture_file, width)
        return Status.DONE
    shots, strokes = compare(PAPER_GRID if grid else SMALL_GRID, slate=not afloat)
    print_drive()
    if out:
        write_csv(out, shots, strokes)
    return Status.DONE


if __name__ == "__main__":
    sys.exit(run(main))
