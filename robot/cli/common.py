"""Shared by the `robot` verbs: the launcher at its port, the camera, the confirmation before a stroke."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from models.commands.options import FILE_PATH, given, input_option
from models.errors import BadInput
from sysid.cli.common import accept_camera_option, camera_option, mass_option, palette_option

if TYPE_CHECKING:
    from robot.camera.live import LiveCamera
    from robot.device.launcher import Launcher
    from robot.device.link import Link
    from robot.device.settings import Settings

settings_option = input_option("settings", "L.toml", "Launcher's file; by default the published launcher's values.")
yes_option = click.option("--yes", is_flag=True, help="Strike without asking; check first that the table is clear.")
ARMED_S = 5.0  # duration of an arming (robot/emulator/mechanism.py, and the protocol)
VIDEO_HELP = "Camera by its number or address, or a film in its place."


@dataclass(frozen=True)
class Wire:
    """Options of the connection to a launcher."""

    port: str | None = given("--port", "P", "Port of the launcher, such as /dev/ttyUSB0; without it an emulated one.")
    settings_file: Path | None = given(settings_option)
    log: Path | None = given("--log", "LOG.jsonl", "Append every exchange with the launcher, a line each.", FILE_PATH)

    def settings(self) -> Settings:
        """The launcher's settings, from a file or defaults; --port overrides the port."""
        from robot.device.settings import Settings, read_settings

        settings = read_settings(self.settings_file) if self.settings_file else Settings()
        return replace(settings, port=replace(settings.port, device=self.port)) if self.port else settings

    def link(self, settings: Settings) -> Link:
        """The link, not yet opened."""
        from robot.device.link import Link
        from robot.device.port import serial_opener

        return Link(serial_opener(settings.port), settings.timing, baud=settings.port.baud, log=self.log)

    def launcher(self, settings: Settings) -> Launcher:
        """The launcher at the port, not yet connected; BadInput for one that sends no reports."""
        from robot.device.launcher import Launcher
        from robot.device.protocol import PAPER

        if settings.port.protocol == PAPER:
            raise BadInput(
                f"{self.settings_file}: protocol = \"{PAPER}\": this launcher accepts only 'NNNp' and reports nothing; "
                "only robot play works with it"
            )
        return Launcher(settings, self.link(settings))

    def striker(self, settings: Settings, *, yes: bool) -> Launcher:
        """The launcher at the port, even one that only strikes: then a person places its tip, and must be asked."""
        from robot.device.paper import PaperLauncher
        from robot.device.port import serial_opener
        from robot.device.protocol import PAPER

        if settings.port.protocol != PAPER:
            return self.launcher(settings)
        if yes:
            raise BadInput("--yes: the tip of this launcher is placed by hand before each stroke; omit --yes")
        return PaperLauncher(settings, serial_opener(settings.port), log=self.log)

    def refuse(self, *names: str) -> None:
        """Raise BadInput for connection options that the emulator does not use."""
        for name in names:
            if getattr(self, name):
                option = name.removesuffix("_file")
                raise BadInput(f"--{option} requires a launcher at a --port; omit it, or name the port")

    def print_needs(self, *needs: str, asks: str = "before every stroke", yes: bool = False) -> None:
        """Print the verb's needs at the port before any question or motion; `asks` says when a yes is required."""
        answer = "none, as --yes was given" if yes else "a yes in full"
        lines = [f"the launcher at {self.port}, powered on, cue and stage free to move: it homes if necessary"]
        lines += [*needs, *[f"{asks} {answer}; each stroke then arms the launcher for {ARMED_S:g} s"] * bool(asks)]
        print("\n".join(["needed:", *(f"  - {line}" for line in lines), "an interrupt (Ctrl-C) stops the launcher"]))


@dataclass(frozen=True)
class RequiredWire(Wire):
    """Connection options of a verb that needs a launcher."""

    port: str = given("--port", "P", "Port of the launcher, such as /dev/ttyUSB0.", required=True)


@dataclass(frozen=True)
class Filming:
    """Options of a real camera over the table, if any."""

    camera_file: Path | None = given(camera_option())
    video: str | None = given("--video", "SOURCE", VIDEO_HELP)
    fps: float | None = given("--fps", "F", "Frame rate [1/s]; by default as the camera reports.", float)
    palette_file: Path | None = given(palette_option)
    mass: float | None = given(mass_option)
    accept_camera: bool = given(accept_camera_option, default=False)

    def is_given(self) -> bool:
        """Whether a camera was named; BadInput if only one of its options was given."""
        if bool(self.camera_file) != bool(self.video):
            raise BadInput("--camera CAM.toml and --video SOURCE go together; give both, or neither")
        return bool(self.camera_file)

    def require(self, what: str) -> None:
        """Raise BadInput if a launcher at a port has no camera."""
        if not self.is_given():
            raise BadInput(f"--port: {what} needs a camera; give --camera CAM.toml and --video SOURCE")

    @property
    def need(self) -> str:
        """The camera's entry in a list of needs."""
        return f"camera {self.video} in the position of {self.camera_file}, with the whole table and the cue in view"

    def refuse(self) -> None:
        """Raise BadInput for a camera without a launcher at a port."""
        for name, value in (("camera", self.camera_file), ("video", self.video)):
            if value:
                raise BadInput(f"--{name} requires a launcher at a --port; the emulated one has its own camera")

    def open(self, folder: Path) -> LiveCamera:
        """The camera, which records into a folder."""
        from robot.camera.live import CameraOptions, LiveCamera

        if self.camera_file is None or self.video is None:
            raise BadInput("give --camera CAM.toml and --video SOURCE")
        options = CameraOptions(self.fps, self.palette_file, self.mass, accept_doubts=self.accept_camera)
        return LiveCamera.open(self.video, self.camera_file, folder, options)


@dataclass(frozen=True)
class RequiredFilming(Filming):
    """Options of the camera of a verb that needs one."""

    camera_file: Path = given(camera_option(required=True))
    video: str = given("--video", "SOURCE", VIDEO_HELP, required=True)


def set_up(request: str) -> bool:
    """Ask at the terminal for a preparation; False for q, or without a terminal."""
    print(request, flush=True)
    try:
        return input("then press return (q ends here): ").strip().lower() != "q"
    except EOFError:
        return False


def confirmed(action: str, remedy: str) -> bool:
    """Ask at the terminal before a stroke; True only for the answer yes."""
    print(f"about to strike: {action}")
    try:
        return input(f"{remedy}, keep clear, then type yes: ").strip().lower() == "yes"
    except EOFError:
        return False
