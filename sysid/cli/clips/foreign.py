"""`sysid import`: tracks of other programs, or a clip set with wrong entries, as a clip set."""

from __future__ import annotations

import dataclasses
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from models.commands.console import Progress, Status, as_called
from models.commands.options import ABOVE_ZERO, FILE_PATH, gathered, given, output_option
from models.errors import BadInput
from models.messages import counted
from sysid.cli.clips.tables import TableOptions
from sysid.cli.common import camera_option

if TYPE_CHECKING:
    from models.table.presets import TableSet
    from sysid.clips.clip_set import ClipSet
    from sysid.clips.header import Header
    from sysid.foreign.convert import Imported, ShotFile
    from sysid.foreign.pixels import Pixels
    from sysid.foreign.stated import Stated
    from sysid.vision import Camera

Y_HELP = "up: right-handed, seen from above (pixels: counted from the last row); down: as in pictures."
TIME_UNITS = ("seconds", "frames", "milliseconds", "microseconds")


@dataclass(frozen=True)
class ReadingOptions:
    """What is known of the files; anything not given is inferred from the tracks."""

    unit: str | None = given("--unit", "U", "m, cm, mm, in or ft.", click.Choice(["m", "cm", "mm", "in", "ft"]))
    origin: str | None = given(
        "--origin", "AT", "Where x and y are 0: centre or corner of the table.", click.Choice(["centre", "corner"])
    )
    x_along: str | None = given(
        "--x-along", "SIDE", "Side that x runs along: length or width.", click.Choice(["length", "width"])
    )
    y: str | None = given("--y", "WAY", Y_HELP, click.Choice(["up", "down"]))
    turned: bool = given("--turned", "", "x and y count from the table's other end: half a turn.", bool)
    time: str | None = given(
        "--time", "UNIT", "Unit of times: seconds, frames, milliseconds or microseconds.", click.Choice(TIME_UNITS)
    )
    fps: float | None = given("--fps", "F", "Frame rate of the film [1/s].", ABOVE_ZERO)
    struck: str | None = given("--struck", "BALL", "Ball that the cue strikes; by default the one that moves first.")
    running: bool = given("--running", "", "A track that begins with a ball in motion does not show the strike.", bool)
    columns: str | None = given(
        "--columns", "t=NAME,...", "Names of columns: t, frame, shot, ball, x, y, theta, cue.speed."
    )

    def stated(self, nominal_fps: float | None) -> Stated:
        """These options for the conversion, with the frame rate that a clip set states."""
        from sysid.foreign.stated import Stated

        return Stated(
            self.unit, None if self.origin is None else self.origin == "corner",
            None if self.x_along is None else self.x_along == "width", None if self.y is None else self.y == "down",
            True if self.turned else None, self.time, self.fps, nominal_fps, self.struck,
            self.running, self.named_columns(),
        )  # fmt: skip

    def named_columns(self) -> dict[str, str]:
        """The names of columns, by their meaning."""
        parts = [part.partition("=") for part in self.columns.split(",")] if self.columns else []
        if not all(what.strip() and name.strip() for what, _, name in parts):
            raise BadInput(f"--columns {self.columns}: write pairs such as t=Time,ball=Id,x=PosX,y=PosY")
        return {what.strip(): name.strip() for what, _, name in parts}


@click.command("import")
@click.argument("files", metavar="FILE...", type=FILE_PATH, nargs=-1, required=True)
@gathered("sizes", TableOptions)
@camera_option()
@gathered("reading", ReadingOptions)
@click.option("--out", metavar="CLIPS", type=FILE_PATH, required=True, help="Folder for the clip set.")
@output_option("picture", "FILE.png", "Picture of the tracks over the table; by default CLIPS.png.")
@click.pass_obj
def import_(
    progress: Progress, files: tuple[Path, ...], sizes: TableOptions, camera_file: Path | None,
    reading: ReadingOptions, out: Path, picture_file: Path | None,
) -> int:  # fmt: skip
    """Import tracks of other programs as a clip set.

    FILE... are CSV, JSON or Parquet, one shot each or with a column for the shot, and with a row for each ball or each
    frame; or a clip set whose entries use another unit, origin or axes; or simulated systems of pooltool (JSON or
    MessagePack), which include their table. Whatever no option states is inferred from the tracks, and printed. Draws
    the tracks over the table first, and writes nothing that the tracks contradict.

    Example: sysid import shots/*.csv --table "pool 8 ft" --out CLIPS
    """
    from models.files import write_whole
    from sysid.clips.trust import camera_doubts, tell_doubts, with_doubts
    from sysid.clips.write import write_clip_set
    from sysid.foreign.convert import import_files
    from sysid.report.pictures.plot import tracks_png

    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise BadInput(f"{out}: already exists; choose another folder")
    systems = _of_pooltool(files)
    paths, shots, header = ([], [], None) if systems else _shots(files)
    camera = None
    if camera_file is not None:
        from sysid.vision import read_camera

        camera = read_camera(camera_file)
    if systems:
        found = _systems(files, sizes, camera, reading)
    else:
        known, pixels = _table(sizes, camera, header)
        fps = header.camera.get("fps") if header else None
        found = import_files(paths, shots, known.table, known.ball, reading.stated(fps), pixels)
    clip_set = found.clip_set
    if header is not None:
        sigma = header.camera.get("sigma")
        clip_set = dataclasses.replace(clip_set, sigma=sigma, extra=header.extra)
    clip_set = with_doubts(clip_set, camera.doubts if camera else ())
    progress.close()
    for line in found.says:
        print(line)
    for message in found.assumed:
        print(f"assumed: {message.for_command()}")
    if camera is not None and math.isfinite(camera.place_sd_m):
        print(f"positions are known to {1e3 * camera.place_sd_m:.2g} mm rms, by the camera's calibration")
    picture = picture_file or out.with_name(out.name + ".png")
    write_whole(picture, tracks_png(clip_set, found.says[0]), parents=True)
    print(f"picture: {picture}", flush=True)
    tell_doubts(camera_file or files[0], camera_doubts(clip_set))
    _tell_contradictions(clip_set, files[0] if header is not None else Path("FILES"), picture)
    write_clip_set(clip_set, out)
    print(f"clips: {out}, {counted(len(clip_set.clips), 'shot')} (continue with: {as_called(f'sysid check {out}')})")
    return Status.DONE


def _tell_contradictions(clip_set: ClipSet, source: Path, picture: Path) -> None:
    """Warn of what tracks and entries contradict; BadInput where they do so for certain."""
    from sysid.clips.consistency.contradiction import is_sound
    from sysid.clips.consistency.contradictions import contradictions

    clips = tuple(clip for clip in clip_set.clips if is_sound(clip))
    for one in contradictions(dataclasses.replace(clip_set, clips=clips, folder=source)):
        if one.certain and not one.unless:  # with `unless`, the author of the clip set may state that it is right
            raise BadInput(f"{one.text} (nothing was written; look at {picture})")
        print(f"warning: {one.text}", file=sys.stderr, flush=True)


def _of_pooltool(files: tuple[Path, ...]) -> bool:
    """Whether the files are pooltool's; BadInput if only some are."""
    from sysid.pooltool.document import is_pooltool

    kinds = {file: is_pooltool(file) for file in files}
    if any(kinds.values()) and not all(kinds.values()):
        other = next(file for file, theirs in kinds.items() if not theirs)
        raise BadInput(f"{other}: is not a pooltool file, but others are: import them separately")
    return all(kinds.values())


def _systems(files: tuple[Path, ...], sizes: TableOptions, camera: Camera | None, reading: ReadingOptions) -> Imported:
    """Import pooltool's systems; BadInput for an option that states what these files contain."""
    from sysid.pooltool.clips import import_pooltool

    stated = {
        "--unit": reading.unit, "--origin": reading.origin, "--x-along": reading.x_along, "--y": reading.y,
        "--turned": reading.turned, "--time": reading.time, "--struck": reading.struck, "--running": reading.running,
        "--columns": reading.columns, "--camera": camera,
    }  # fmt: skip
    for option in (name for name, value in stated.items() if value):
        raise BadInput(f"{option}: pooltool's files state this themselves: omit it")
    known = sizes.table_set() if sizes.table_name is not None else None
    return import_pooltool(
        files, table=known.table if known else None, ball=known.ball if known else None, fps=reading.fps
    )


def _shots(files: tuple[Path, ...]) -> tuple[list[Path], list[ShotFile], Header | None]:
    """The files of all shots, what is known of them, and the entries of a clip set where one is named."""
    from models.files.faults import Faults
    from sysid.clips.clip_set import CueCommand
    from sysid.clips.header import read_header
    from sysid.foreign.convert import ShotFile

    if len(files) == 1 and files[0].is_dir():
        faults = Faults()
        header = faults.settle(read_header(files[0].resolve(), faults))
        shots = [
            ShotFile(one.file, one.struck, one.note, CueCommand(**one.cue) if one.cue else None, one.extra, one.running)
            for one in header.entries
        ]
        return [one.path for one in header.entries], shots, header
    names: dict[str, Path] = {}
    for file in files:
        if file.is_dir():
            raise BadInput(f"{file}: is a folder; name its files, or one clip set alone")
        if file.stem in names:
            raise BadInput(f"{file}: its clip would be named as that of {names[file.stem]}; rename one of them")
        names[file.stem] = file
    return list(files), [ShotFile(f"clips/{name}.csv") for name in names], None


def _table(sizes: TableOptions, camera: Camera | None, header: Header | None) -> tuple[TableSet, Pixels | None]:
    """Table and balls from the options, the camera or the clip set; and the map from pixels to positions."""
    from models.shot import Ball
    from models.table.presets import TableSet
    from sysid.foreign.pixels import Pixels

    if sizes.table_name is None and camera is None and header is not None and header.table and header.ball:
        ball = header.ball
        if sizes.diameter is not None or sizes.mass is not None:
            ball = Ball(sizes.diameter or ball.diameter, sizes.mass or ball.mass)
        return TableSet(header.table, ball), None
    if camera is not None:
        from sysid.cli.clips.tables import table_set

        size = f"{camera.table.length!r}x{camera.table.width!r}"
        ball = table_set(size, camera.diameter, sizes.mass, no_pockets=False).ball
        return TableSet(camera.table, ball), Pixels(camera.centres, camera.size[1])
    return sizes.table_set(), None
