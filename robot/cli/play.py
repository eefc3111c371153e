"""The verbs that bring a plan to the table: `robot play`, on the launcher or the emulated one, and `robot align`."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from models.console import DONE, FOUND, Progress, Verb
from models.errors import BadInput
from robot.cli.common import (
    camera_of,
    confirmed,
    emulated_only,
    filmed,
    launcher_at,
    seed_of,
    seeded,
    settings_of,
    wired,
    with_camera,
    with_effects,
)

if TYPE_CHECKING:
    from models.shot import Array, Ball, Table
    from planner.scene import Scene
    from robot.camera.live import LiveCamera
    from robot.device.launcher import Launcher
    from robot.device.settings import Settings
    from robot.emulator.table import EmulatedTable
    from robot.play import Order, Played
    from sysid.clips import Observation

FIRMWARE = 1  # beside the seed: its draws are not the table's


def add(verb: Verb) -> None:
    """The verbs with their options."""
    one = verb("play", play, "a plan played once; without --port on the emulated launcher and table")
    one.add_argument("plan", metavar="PLAN.json", help="plan file; PLAN.played.json is written beside it")
    wired(one, required=False)
    one.add_argument("--scene", metavar="SCENE.toml", help="where the balls are now (made with: planner scene PICTURE)")
    one.add_argument("--tolerance", metavar="MM", type=float, default=5.0, help="of each ball's place (default: 5)")
    with_camera(one, required=False)
    one.add_argument("--films", metavar="DIR", default="films", help="folder of the recordings (default: films)")
    one.add_argument("--clips", metavar="DIR", help="clip set that the film is added to")
    one.add_argument("--model", metavar="HIDDEN.toml", help="what the emulated table really is (default: the base)")
    with_effects(one)
    one.add_argument("--fault-rate", metavar="R", type=float, default=0.0, help="share of lines with a fault, emulated")
    seeded(one, 0)
    one.add_argument("--dry-run", action="store_true", help="check, and say what would be sent")
    one.add_argument("--yes", action="store_true", help="strike without asking; look at the table first")
    one = verb("align", align_stand, "how far to turn the stand, live from the camera, to a tenth of a degree")
    with_camera(one, required=True)
    one.add_argument("--plan", metavar="PLAN.json", help="plan whose direction is wanted")
    one.add_argument("--azimuth", metavar="DEG", type=float, help="direction that is wanted, table frame")


@dataclass(frozen=True)
class SeenScene:
    """Balls as a scene file has them, made from a picture a moment ago; it films nothing."""

    scene: Scene
    fps: float = 1.0
    sigma: float = 0.0

    @property
    def table(self) -> Table:
        """Of the scene."""
        return self.scene.table

    @property
    def ball(self) -> Ball:
        """Of the scene."""
        return self.scene.ball

    def look(self) -> Mapping[str, Array]:
        """Where the balls are, by name: (2,) [m]."""
        return dict(zip(self.scene.names, self.scene.position, strict=True))

    def arm(self) -> None:
        """Nobody films."""

    def film(self) -> Mapping[str, Observation]:
        """Nothing."""
        return {}


def play(args: argparse.Namespace, progress: Progress) -> int:
    """Play a plan once, on the launcher at a port or on the emulated one."""
    from planner.scene import read_scene
    from robot.play import play_plan, read_order

    settings = settings_of(args)
    order = read_order(args.plan, settings)
    scene = read_scene(args.scene) if args.scene else None
    if args.tolerance <= 0:
        raise BadInput(f"--tolerance {args.tolerance:g}: give millimetres above 0")
    most = 1e-3 * args.tolerance
    if args.port:
        return _at_the_table(args, settings, order, scene, most)
    emulated_only(args)
    print("no --port: on the emulated launcher and table")
    emulated = _emulated_table(args, scene or order.scene, np.radians(order.yaw_deg))
    if args.dry_run:
        return _tell(play_plan(args.plan, _dry(settings), emulated, clips=args.clips, tolerance=most), args, None)
    with _emulated_launcher(args, settings, emulated) as launcher:
        played = play_plan(args.plan, launcher, emulated, clips=args.clips, tolerance=most)
    return _tell(played, args, emulated)


def _at_the_table(
    args: argparse.Namespace, settings: Settings, order: Order, scene: Scene | None, most: float
) -> int:  # fmt: skip
    """The stroke on the launcher itself, filmed where there is a camera."""
    from robot.play import play_plan

    for name in ("model", "fault_rate"):
        if getattr(args, name):
            raise BadInput(
                f"--{name.replace('_', '-')} belongs to the emulated launcher; leave it out, or leave --port out"
            )
    confirm = None if args.yes else _confirmed
    if filmed(args):
        if scene is not None:
            raise BadInput(f"--scene {args.scene}: the camera sees where the balls are; leave it out")
        with camera_of(args, args.films) as camera:
            if args.dry_run:
                return _tell(play_plan(args.plan, _dry(settings), camera, tolerance=most), args, None)
            if not _aligned(camera, np.radians(order.yaw_deg), order.scene.position[0]):
                raise BadInput(f"--video {args.video}: no more pictures came, and the stand is not aligned; try again")
            with launcher_at(args, settings) as launcher:
                played = play_plan(args.plan, launcher, camera, confirm, clips=args.clips, tolerance=most)
        return _tell(played, args, None)
    if args.clips:
        raise BadInput("--clips: nobody films; give --camera and --video, or track a film of the stroke: sysid track")
    seen = SeenScene(scene) if scene else None
    if seen is None:
        print("no --scene: nobody has looked where the balls are; make one with: planner scene PICTURE")
    if args.dry_run:
        return _tell(play_plan(args.plan, _dry(settings), seen, tolerance=most), args, None)
    with launcher_at(args, settings) as launcher:
        played = play_plan(args.plan, launcher, seen, confirm, tolerance=most)
    return _tell(played, args, None)


def _aligned(camera: LiveCamera, azimuth: float, ball: Array | None) -> bool:
    """Tell how the stand must be turned, live; whether it is aligned in the end."""
    from robot.camera.align import align, turn_for

    line = align(camera.pictures(), camera.seen_with, azimuth, ball)
    for note in line.noted:
        print(f"noted: {note}")
    turn = turn_for(line, azimuth)
    print(f"cue: {np.degrees(line.azimuth):.2f} +- {np.degrees(line.azimuth_sd):.2f} degrees, {turn}")
    return not turn.side


def align_stand(args: argparse.Namespace, progress: Progress) -> int:
    """Say how far to turn the stand until the cue points where a plan wants it."""
    from planner.plan import read_plan
    from planner.scene import scene_from

    if (args.plan is None) == (args.azimuth is None):
        raise BadInput("give the direction: --plan PLAN.json, or --azimuth DEGREES")
    ball = None
    if args.plan:
        plan = read_plan(args.plan)
        if plan.get("stroke") is None:
            raise BadInput(f"{args.plan}: holds no stroke ({plan.get('why', 'no reason told')}); plan another shot")
        launcher = plan.get("launcher")
        wanted = launcher.get("theta_deg") if isinstance(launcher, dict) else None
        if not isinstance(wanted, int | float):
            raise BadInput(f"{args.plan}: theta_deg of its launcher is {wanted!r}; make the plan again")
        ball = scene_from(plan.get("scene"), f"{args.plan} scene").position[0]
    else:
        wanted = args.azimuth
    if not abs(wanted) <= 360:
        raise BadInput(f"{args.plan or '--azimuth'}: the direction is {wanted:g}; give degrees, -360 to 360")
    with camera_of(args, "films") as camera:
        return DONE if _aligned(camera, np.radians(wanted), ball) else FOUND


def _emulated_table(args: argparse.Namespace, scene: Scene, azimuth: float) -> EmulatedTable:
    """The balls of a scene on a table that only the emulator knows."""
    from models.model_file import full_model, read_model
    from robot.emulator.table import EmulatedTable

    model = read_model(args.model) if args.model else full_model(scene.table, scene.ball)
    if not args.model:
        print("no --model: the table is the base with its usual constants")
    if (model.table, model.ball) != (scene.table, scene.ball):
        raise BadInput(f"{args.model}: is of another table or ball than the scene; name a model of the scene's")
    places = {n: (float(x), float(y)) for n, (x, y) in zip(scene.names, scene.position, strict=True)}
    return EmulatedTable(model, places, azimuth, seed_of(args))


def _emulated_launcher(args: argparse.Namespace, settings: Settings, emulated: EmulatedTable) -> Launcher:
    from robot.emulator.faults import FaultInjection
    from robot.emulator.table import emulated_launcher

    rng, chance = np.random.default_rng((seed_of(args), FIRMWARE)).spawn(2)
    faults = FaultInjection(args.fault_rate, chance) if args.fault_rate else None
    return emulated_launcher(settings, emulated.hit, rng, faults=faults, log=args.log)[0]


def _dry(settings: Settings) -> Launcher:
    from robot.device.launcher import Launcher

    return Launcher(settings, None, dry_run=True)


def _confirmed(what: str) -> bool:
    return confirmed(what, "turn the stand")


def _tell(played: Played, args: argparse.Namespace, emulated: EmulatedTable | None) -> int:
    """What became of the plan, in words and figures."""
    from robot.play import played_file

    if played.struck == "dry":
        print("dry run: nothing has moved, nothing was written")
        return DONE
    done = played.done
    if done is not None:
        print(
            f"struck {done.string}: cue {done.cue_speed:.3f} m/s ({done.asked_speed:.3f} asked), "
            f"peak {done.peak_force:.0f} N, tip at {done.x0_mm:+.2f}, {done.y0_mm:+.2f} mm"
        )
    if played.potted is not None:
        print(f"object ball: {f'potted, {played.pocket}' if played.potted else played.pocket or 'not potted'}")
    if played.cue_fell:
        print("cue ball: in-off")
    elif played.cue_end is not None:
        away = "" if played.from_wanted is None else f", {1e3 * played.from_wanted:.0f} mm from the wanted place"
        print(f"cue ball: {played.cue_end[0]:.4f}, {played.cue_end[1]:.4f} m{away}")
    for line in played.noted:
        print(f"noted: {line}")
    if played.clip:
        print(f"clip: {Path(args.clips) / played.clip}")
    elif args.clips:
        print("clip: none, no shot was seen")
    print(f"played: {played_file(args.plan)}")
    if emulated is not None and emulated.strokes != 1:
        print(f"the emulated cue ball was struck {emulated.strokes} times")
    troubled = any("the cue is not back" in line or "the film is lost" in line for line in played.noted)
    return FOUND if troubled or (args.clips and not played.clip) else DONE
