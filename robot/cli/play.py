"""`robot play`: a plan played on the real or the emulated launcher."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from models.commands.console import Status
from models.commands.options import ABOVE_ZERO, FILE_PATH, NON_NEGATIVE, effects_option, gathered, given, input_option
from models.errors import BadInput
from robot.cli.align import in_degrees, shown_aligned
from robot.cli.common import Filming, Wire, confirmed, yes_option

if TYPE_CHECKING:
    from models.shot import Array, Ball, Table
    from planner.scene import Scene
    from robot.device.launcher import Launcher
    from robot.device.settings import Settings
    from robot.emulator.table import EmulatedTable
    from robot.play import Played
    from sysid.clips import Observation

FIRMWARE_STREAM = 1  # stream of random numbers, separate from that of the table


@dataclass(frozen=True)
class Request:
    """Options of playing a plan."""

    plan: Path = given(click.argument("plan", metavar="PLAN.json", type=FILE_PATH))
    scene_file: Path | None = given(
        input_option("scene", "SCENE.toml", "Current positions of the balls, made with: planner scene PICTURE.")
    )
    tolerance: float = given("--tolerance", "MM", "Tolerance of each ball's position [mm].", ABOVE_ZERO, 5.0)
    films: Path = given("--films", "DIR", "Folder of the recordings.", FILE_PATH, "films")
    clips: Path | None = given("--clips", "DIR", "Clip set to which the filmed shot is added.", FILE_PATH)
    dry_run: bool = given("--dry-run", "", "Only check the plan, and print what would be sent.", bool, False)
    yes: bool = given(yes_option, default=False)

    @property
    def tolerance_m(self) -> float:
        """Tolerance of each ball's position [m]."""
        return 1e-3 * self.tolerance

    @property
    def balls(self) -> str:
        """The required positions of the balls, for a list of needs."""
        return f"the balls at the positions in {self.plan}, within {self.tolerance:g} mm, and no others"


@dataclass(frozen=True)
class Emulation:
    """Options of the emulated table and launcher."""

    model_file: Path | None = given(
        input_option("model", "HIDDEN.toml", "Model of the emulated table; by default the base.")
    )
    fault_rate: float = given("--fault-rate", "R", "Share of lines with an emulated fault, 0 to 1.", float, 0.0)
    seed: int = given("--seed", "N", "Seed of the random numbers.", NON_NEGATIVE, 0)

    def refuse(self) -> None:
        """Raise BadInput if a real launcher is used."""
        for name, value in (("model", self.model_file), ("fault-rate", self.fault_rate)):
            if value:
                raise BadInput(f"--{name} applies to the emulated launcher; omit it, or omit --port")

    def table(self, scene: Scene, azimuth: float) -> EmulatedTable:
        """The balls of a scene on the emulated table, with the launcher along `azimuth` [rad]."""
        from models.model_file import full_model, read_model
        from robot.emulator.table import EmulatedTable

        model = read_model(self.model_file) if self.model_file else full_model(scene.table, scene.ball)
        if not self.model_file:
            print("no --model: the table is the base model with its usual constants")
        if (model.table, model.ball) != (scene.table, scene.ball):
            raise BadInput(f"{self.model_file}: its table or ball differs from the scene's; name another model")
        places = {n: (float(x), float(y)) for n, (x, y) in zip(scene.names, scene.position, strict=True)}
        return EmulatedTable(model, places, azimuth, self.seed)

    def launcher(self, settings: Settings, emulated: EmulatedTable, log: Path | None) -> Launcher:
        """The emulated launcher at that table."""
        import numpy as np

        from robot.emulator.faults import FaultInjection
        from robot.emulator.table import emulated_launcher

        rng, chance = np.random.default_rng((self.seed, FIRMWARE_STREAM)).spawn(2)
        faults = FaultInjection(self.fault_rate, chance) if self.fault_rate else None
        return emulated_launcher(settings, emulated.hit, rng, faults=faults, log=log)[0]


@dataclass(frozen=True)
class SeenScene:
    """A stand-in for a camera: the balls of a recent scene file, without films."""

    scene: Scene
    fps: float = 1.0
    sigma: float = 0.0
    filmed: None = None

    @property
    def doubts(self) -> tuple[str, ...]:
        """Doubts of the camera that took the scene."""
        return self.scene.camera_doubts

    @property
    def table(self) -> Table:
        """Of the scene."""
        return self.scene.table

    @property
    def ball(self) -> Ball:
        """Of the scene."""
        return self.scene.ball

    def look(self) -> Mapping[str, Array]:
        """Positions of the balls by name: (2,) [m]."""
        return dict(zip(self.scene.names, self.scene.position, strict=True))

    def arm(self) -> None:
        """Nobody films."""

    def film(self) -> Mapping[str, Observation]:
        """Nothing."""
        return {}


@click.command()
@gathered("request", Request)
@gathered("wire", Wire)
@gathered("filming", Filming)
@gathered("emulation", Emulation)
@effects_option()
def play(request: Request, wire: Wire, filming: Filming, emulation: Emulation) -> int:
    """Play a plan once, on the launcher or on the emulated one.

    Reads PLAN.json, and writes PLAN.played.json next to it. With --port it asks before it strikes; without, no hardware
    moves. Status 1 if something needs attention.

    Example: robot play plan.json --port /dev/ttyUSB0 --camera cam.toml --video 0 --clips CLIPS
    """
    from planner.scene import read_scene
    from robot.order import read_order
    from robot.play import play_plan
    from sysid.clips.trust import heed_doubts

    settings = wire.settings()
    order = read_order(request.plan, settings)
    scene = read_scene(request.scene_file) if request.scene_file else None
    azimuth = math.radians(order.yaw_deg)
    for file, held in ((request.plan, order.scene), (request.scene_file, scene)):
        if file is not None and held is not None:
            nothing_moves = request.dry_run or not wire.port
            heed_doubts(file, held.camera_doubts, filming.accept_camera or nothing_moves)
    if wire.port:
        emulation.refuse()
        if filming.is_given():
            played = _play_filmed(request, wire, settings, filming, azimuth, order.scene.position[0])
        else:
            played = _play_unfilmed(request, wire, settings, scene, azimuth)
        return _print_played(played, request, None)
    filming.refuse()
    print("no --port: using the emulated launcher and table")
    emulated = emulation.table(scene or order.scene, azimuth)
    tolerance = request.tolerance_m
    if request.dry_run:
        played = play_plan(request.plan, _dry(settings), emulated, clips=request.clips, tolerance=tolerance)
        return _print_played(played, request, None)
    with emulation.launcher(settings, emulated, wire.log) as launcher:
        played = play_plan(request.plan, launcher, emulated, clips=request.clips, tolerance=tolerance)
    return _print_played(played, request, emulated)


def _play_filmed(
    request: Request, wire: Wire, settings: Settings, filming: Filming, azimuth: float, ball: Array
) -> Played:  # fmt: skip
    """Play the stroke on the launcher at its port, and film it."""
    from robot.play import play_plan

    if request.scene_file:
        raise BadInput(f"--scene {request.scene_file}: the camera sees the balls; omit it")
    with filming.open(request.films) as camera:
        if request.dry_run:
            return play_plan(request.plan, _dry(settings), camera, tolerance=request.tolerance_m)
        needs = (filming.need, request.balls, f"the stand behind the cue ball, to be turned to {in_degrees(azimuth)}")
        wire.print_needs(*needs, yes=request.yes)
        if not shown_aligned(camera, azimuth, ball):
            raise BadInput(f"--video {filming.video}: no more pictures came, and the stand is not aligned; try again")
        with wire.striker(settings, yes=request.yes) as launcher:
            confirm = None if request.yes else _confirmed
            return play_plan(
                request.plan, launcher, camera, confirm, clips=request.clips, tolerance=request.tolerance_m
            )


def _play_unfilmed(
    request: Request, wire: Wire, settings: Settings, scene: Scene | None, azimuth: float
) -> Played:  # fmt: skip
    """Play the stroke on the launcher at its port, without a camera."""
    from robot.play import play_plan

    if request.clips:
        raise BadInput("--clips: the shot is not filmed; give --camera and --video, or track a film of it: sysid track")
    seen = SeenScene(scene) if scene else None
    if seen is None:
        print("no --scene: the positions of the balls are not checked; make one with: planner scene PICTURE")
    if request.dry_run:
        return play_plan(request.plan, _dry(settings), seen, tolerance=request.tolerance_m)
    needs = (request.balls, f"the stand behind the cue ball, turned to {in_degrees(azimuth)}: robot align shows it")
    wire.print_needs(*needs, yes=request.yes)
    with wire.striker(settings, yes=request.yes) as launcher:
        confirm = None if request.yes else _confirmed
        return play_plan(request.plan, launcher, seen, confirm, tolerance=request.tolerance_m)


def _dry(settings: Settings) -> Launcher:
    from robot.device.launcher import Launcher

    return Launcher(settings, None, dry_run=True)


def _confirmed(action: str) -> bool:
    return confirmed(action, "turn the stand")


def _print_played(played: Played, request: Request, emulated: EmulatedTable | None) -> int:
    """Print the outcome of a plan; returns the exit status."""
    from robot.play import played_file

    if played.struck == "dry":
        print("dry run: nothing has moved, nothing was written")
        return Status.DONE
    done = played.done
    if done is not None:
        measured = f"{done.cue_speed:.3f} m/s ({done.asked_speed:.3f} asked), peak {done.peak_force:.0f} N"
        reported = measured if math.isfinite(done.cue_speed) else f"{done.asked_speed:.3f} m/s asked"
        print(f"struck {done.string}: cue {reported}, tip at {done.x0_mm:+.2f}, {done.y0_mm:+.2f} mm")
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
        print(f"clip: {request.clips}/{played.clip}")
    elif request.clips:
        print("clip: none, no shot was seen")
    lost = any("the record is lost" in line for line in played.noted)
    if not lost:
        print(f"played: {played_file(request.plan)}")
    if emulated is not None and emulated.strokes != 1:
        print(f"the emulated cue ball was struck {emulated.strokes} times")
    troubled = lost or any("the cue is not back" in line or "the film is lost" in line for line in played.noted)
    return Status.FINDING if troubled or (request.clips and not played.clip) else Status.DONE
