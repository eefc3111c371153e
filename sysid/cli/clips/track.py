"""`sysid track`: from a video to a clip set."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from models.commands.console import Progress, Status, write_json
from models.commands.options import (
    ABOVE_ZERO,
    FILE_PATH,
    ZERO_OR_MORE,
    gathered,
    given,
    json_option,
    output_option,
    scheduler_option,
)
from models.errors import BadInput
from models.files import alone_in
from sysid.cli.common import camera_option, mass_option, palette_option, print_recording
from sysid.cli.viewing import Live

if TYPE_CHECKING:
    from sysid.vision import TrackedFilm


@dataclass(frozen=True)
class Filmed:
    """Options of the videos of one camera."""

    videos: tuple[str, ...] = given(click.argument("videos", metavar="VIDEO...", nargs=-1, required=True))
    camera_file: Path = given(camera_option(required=True))
    fps: float | None = given("--fps", "F", "Frame rate [1/s], if the video does not state it.", ABOVE_ZERO)
    exposure: float | None = given(
        "--exposure",
        "S",
        "Exposure of a frame [s]; by default estimated from the blur of moving balls.",
        ABOVE_ZERO,
    )
    readout: float | None = given(
        "--readout",
        "S",
        "Time from a frame's first row to its last [s], 0 for a global shutter; by default as in the camera file.",
        ZERO_OR_MORE,
    )
    palette_file: Path | None = given(palette_option)
    mass: float | None = given(mass_option)
    scheduler: str | None = given(scheduler_option)


@dataclass(frozen=True)
class TrackOutputs:
    """Options of the output files."""

    out: Path = given("--out", "CLIPS", "Folder for the clip set; clips join those of finished videos.", FILE_PATH,
                      required=True)  # fmt: skip
    force: bool = given("--force", "", "Replace an existing clip set.", bool)
    json_file: Path | None = given(json_option)
    rrd_file: Path | None = given(output_option("rrd", "FILE.rrd", "Write film and tracks for Rerun."))
    preview: Path | None = given("--preview", "DIR", "Folder for a picture of each clip.", FILE_PATH)
    sheet_file: Path | None = given(output_option("sheet", "SHEET.png", "Draw a contact sheet, a row for each shot."))

    def check(self) -> None:
        """Raise BadInput before the work for what could not be written after it."""
        if self.preview and self.preview.exists() and not self.preview.is_dir():
            raise BadInput(f"{self.preview}: is a file; name a folder for the pictures")

    def draw(self, film: TrackedFilm, progress: Progress) -> None:
        """Write pictures and recording of a film on request."""
        if self.preview:
            written = film.write_pictures(self.preview, progress)
            progress.close()
            print(f"pictures: {len(written)} in {self.preview}")
        if self.rrd_file:
            progress("writing the recording")
            film.write_recording(self.rrd_file)
            progress.close()
            print_recording(self.rrd_file)


@click.command()
@gathered("filmed", Filmed)
@gathered("outputs", TrackOutputs)
@gathered("live", Live)
@click.pass_obj
def track(progress: Progress, filmed: Filmed, outputs: TrackOutputs, live: Live) -> int:
    """Track the balls of videos of one camera, and write their shots as a clip set.

    VIDEO is a video, a folder of pictures, or a pattern of their names (%04d or *). Writes a clip for each shot, named
    by video and time. Videos whose clips are in the clip set already are not read again. With --live each frame is
    shown with the balls found in it. Status 1 if the tracks are not to be trusted.

    Example: sysid track match.mp4 --camera cam.toml --out CLIPS
    """
    from sysid.clips.trust import tell_doubts
    from sysid.vision import FilmSet, Taken, read_camera

    films = FilmSet(filmed.videos, outputs.out, anew=outputs.force)
    outputs.check()
    context, several = click.get_current_context(), len(films.named) > 1
    context.with_resource(alone_in(outputs.out))
    if outputs.rrd_file and several:
        raise BadInput("--rrd: records a single video; give one, or omit --rrd")
    if live.live and filmed.scheduler is not None:
        raise BadInput("--live shows tracking on this machine only; omit it, or omit --scheduler")
    camera = read_camera(filmed.camera_file)
    tell_doubts(filmed.camera_file, camera.doubts)
    taken = Taken.of(
        camera, filmed.camera_file, palette_path=filmed.palette_file, fps=filmed.fps, exposure=filmed.exposure,
        readout=filmed.readout, mass=filmed.mass,
    )  # fmt: skip
    reports, refused, doubtful = [], list[BadInput](), False
    outcomes = films.tracked(taken, progress, filmed.scheduler, context.with_resource(live.feed()))
    context.call_on_close(outcomes.close)
    for one in outcomes:
        progress.close()
        if several:
            print(f"\n{one.video}")
        if one.refused is not None:
            refused.append(one.refused)
            print(f"left out: {one.refused}\n" * several, end="")
        elif one.film is None:
            print(f"{one.name}: its clips in {outputs.out} are kept; use --force to track it again")
        else:
            print("\n".join(one.film.lines()))
            outputs.draw(one.film, progress)
            reports.append(one.film.to_json())
            doubtful |= bool(one.film.doubts)
            if one.film.clips is not None:
                print(f"\nclips: {outputs.out}")
            for doubt in one.film.doubts:
                print(f"not to be trusted: {doubt}")
    if outputs.json_file and reports:
        write_json(outputs.json_file, {"format": reports[0]["format"], "videos": reports} if several else reports[0])
    if outputs.sheet_file and films.clip_set is not None:
        progress("drawing the contact sheet")
        films.write_sheet(outputs.sheet_file, taken)
        progress.close()
        print(f"contact sheet: {outputs.sheet_file}")
    if refused:
        raise refused[0]
    return Status.DONE if not doubtful else Status.FINDING
