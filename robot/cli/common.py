"""What the verbs of the `robot` command share: the launcher's file, its line, and options that mean the same in all."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from models.errors import BadInput

if TYPE_CHECKING:
    from robot.camera.live import LiveCamera
    from robot.device.launcher import Launcher
    from robot.device.link import Link
    from robot.device.settings import Settings


def wired(one: argparse.ArgumentParser, required: bool) -> None:
    """Options of a verb that speaks to a launcher."""
    one.add_argument("--port", metavar="P", required=required, help="where the launcher is, such as /dev/ttyUSB0")
    one.add_argument("--settings", metavar="L.toml", help="launcher's file (default: the paper's launcher)")
    one.add_argument("--log", metavar="LOG.jsonl", help="every exchange, a line each, added to what it holds")


def seeded(one: argparse.ArgumentParser, default: int) -> None:
    """The seed's option."""
    one.add_argument("--seed", metavar="N", type=int, default=default, help=f"of all drawn (default: {default})")


def with_effects(one: argparse.ArgumentParser) -> None:
    """The option of a verb that reads models."""
    one.add_argument("--effects", metavar="DIR", action="append", default=[], help="folder of effects of your own")


def with_camera(one: argparse.ArgumentParser, required: bool) -> None:
    """Options of a verb that looks with a real camera."""
    text = "camera file, made with: sysid calibrate"
    one.add_argument("--camera", metavar="CAM.toml", required=required, help=text)
    text = "camera's number, address, or a film that stands in for it"
    one.add_argument("--video", metavar="SOURCE", required=required, help=text)
    one.add_argument("--fps", metavar="F", type=float, help="pictures a second (default: what the camera says)")
    one.add_argument("--palette", metavar="P.toml", help="names and colours of the balls (default: those of snooker)")
    one.add_argument("--mass", metavar="M", type=float, help="of a ball [kg] (default: of a snooker ball of its size)")


def filmed(args: argparse.Namespace) -> bool:
    """Whether a camera was named; BadInput for half of one."""
    if bool(args.camera) != bool(args.video):
        raise BadInput("--camera CAM.toml and --video SOURCE go together; give both, or neither")
    return bool(args.camera)


def emulated_only(args: argparse.Namespace) -> None:
    """BadInput for a camera without a launcher at a port."""
    for name in ("camera", "video"):
        if getattr(args, name):
            raise BadInput(f"--{name} belongs to a launcher at a --port; the emulated one has a camera of its own")


def camera_of(args: argparse.Namespace, films: Path | str) -> LiveCamera:
    """The camera named, its recordings into a folder."""
    from robot.camera.live import CameraOptions, LiveCamera

    options = CameraOptions(fps=args.fps, palette_path=args.palette, mass=args.mass)
    return LiveCamera.open(args.video, args.camera, films, options)


def seed_of(args: argparse.Namespace) -> int:
    """The seed; BadInput for one below 0."""
    if args.seed < 0:
        raise BadInput(f"--seed {args.seed}: give a number of 0 or more")
    return int(args.seed)


def settings_of(args: argparse.Namespace) -> Settings:
    """The launcher's file, or the defaults; --port goes before what it says."""
    from robot.device.settings import Settings, read_settings

    ours = read_settings(args.settings) if args.settings else Settings()
    device = getattr(args, "port", None)
    return replace(ours, port=replace(ours.port, device=device)) if device else ours


def line_of(args: argparse.Namespace, settings: Settings) -> Link:
    """The line to the launcher at the port, not yet opened."""
    from robot.device.link import Link
    from robot.device.port import serial_opener

    return Link(serial_opener(settings.port), settings.timing, baud=settings.port.baud, log=args.log)


def launcher_at(args: argparse.Namespace, settings: Settings) -> Launcher:
    """The launcher at the port, not yet connected."""
    from robot.device.launcher import Launcher

    return Launcher(settings, line_of(args, settings))


def confirmed(what: str, remedy: str) -> bool:
    """A yes from the terminal before a stroke; anything else, and nobody there, is a no."""
    print(f"about to strike: {what}")
    try:
        return input(f"{remedy}, keep clear, then type yes: ").strip().lower() == "yes"
    except EOFError:
        return False
