"""`sysid doctor`: runs calibrate, track, check and discover on films of a table."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from models.commands.console import Progress, Status, as_called
from models.commands.options import ABOVE_ZERO, Number, gathered, given, out_folder_option
from models.commands.program import typed_again
from models.files import made_folder, result_folder
from sysid.cli.clips.calibrate import BoardOptions, calibrate
from sysid.cli.clips.tables import TABLE_HELP, diameter_option, table_set
from sysid.cli.clips.track import track
from sysid.cli.common import accept_camera_option, mass_option, palette_option
from sysid.cli.identification.compare import check
from sysid.cli.identification.discovery import discover

CAMERA_FILE, CAMERA_PICTURE, SHEET_FILE = "camera.toml", "camera.png", "shots.png"
JOINED_VERBS = (
    "videos",
    "corners",
    "click",
    "hold",
    "fov",
    "board",
    "square",
    "board_marker",
    "lens",
)  # may differ: see `camera`
CLIPS_FOLDER, FOUND_FOLDER = "clips", "found"


@dataclass(frozen=True)
class FilmedTable:
    """A table, its balls, and how it was filmed."""

    table_name: str = given("--table", "NAME|LxW", TABLE_HELP, required=True)
    diameter: float | None = given(diameter_option)
    no_pockets: bool = given("--no-pockets", "", "The table has no pockets.", bool)
    corners: str | None = given("--corners", '"u,v u,v u,v u,v"', "Approximate crossings of the nose lines [pixels].")
    click: bool = given("--click", "", "Click these corners in a browser.", bool)
    hold: bool = given("--hold", "", "Keep the given corners within some pixels, and fit the rest.", bool)
    fov: float | None = given(
        "--fov", "DEG", "Field of view across the picture's longer side, if known.", Number(3, 150, unit="degrees")
    )
    fps: float | None = given("--fps", "F", "Frame rate [1/s], if the video does not state it.", ABOVE_ZERO)
    palette_file: Path | None = given(palette_option)
    mass: float | None = given(mass_option)

    def words(self) -> list[object]:
        """Table and balls as words for `sysid calibrate`; BadInput if they are not known."""
        table_set(self.table_name, self.diameter, self.mass, self.no_pockets)
        words: list[object] = ["--table", self.table_name]
        words += ["--diameter", self.diameter] if self.diameter is not None else []
        return words + ["--no-pockets"] * self.no_pockets

    def of_camera(self) -> list[object]:
        """The options of the camera, as words for `sysid calibrate`."""
        words: list[object] = []
        for option, value in (("--corners", self.corners), ("--fov", self.fov)):
            words += [option, value] if value is not None else []
        return words + ["--click"] * self.click + ["--hold"] * self.hold

    def known_mass(self) -> float | None:
        """Mass of a ball [kg], if it was given or follows from the table's name."""
        from models.table.presets import TABLE_SETS

        known = table_set(self.table_name, self.diameter, self.mass, self.no_pockets).ball
        return known.mass if self.mass is not None or known in [one.ball for one in TABLE_SETS.values()] else None


@click.command()
@click.argument("videos", metavar="VIDEO...", nargs=-1, required=True)
@gathered("filmed", FilmedTable)
@out_folder_option("Folder of all results.", CLIPS_FOLDER, FOUND_FOLDER, joined=JOINED_VERBS)
@gathered("board", BoardOptions)
@accept_camera_option
@click.pass_context
def doctor(
    context: click.Context, videos: tuple[str, ...], filmed: FilmedTable, out: Path, board: BoardOptions,
    accept_camera: bool,
) -> int:  # fmt: skip
    """Examine a table from films of it: calibrate, track, check and discover.

    VIDEO... are films of shots by one camera that stays where it is. Writes the camera, its picture, the clips, a sheet
    of the shots, and the findings with their report into DIR, and prints each verb as a command of its own. Stops
    with status 1 if a step is doubtful; once that is remedied, the same command continues from there.

    Example: sysid doctor *.mp4 --table "pool 8 ft" --out out/mine
    """
    sizes, mass = filmed.words(), filmed.known_mass()
    folder = made_folder(out)
    camera, clips = folder / CAMERA_FILE, folder / CLIPS_FOLDER
    progress: Progress = context.obj
    if camera.is_file():
        from sysid.clips.trust import doubt_line
        from sysid.vision import read_camera

        if (doubt := doubt_line(camera, read_camera(camera).doubts)) and not accept_camera:
            print(f"stopped: {doubt}; delete it to calibrate again, or continue with --accept-camera")
            return Status.FINDING
        print(f"camera: using the existing {camera}; delete it to calibrate again")
    else:
        words = [*videos, *sizes, "--out", camera, "--report", folder / CAMERA_PICTURE]
        words += [*filmed.of_camera(), *board.words()]
        if _step(context, calibrate, words) and not accept_camera:
            camera.unlink(missing_ok=True)
            print(f"stopped: the camera is not to be trusted; look at {folder / CAMERA_PICTURE}")
            print(f"to continue nevertheless: {typed_again('--accept-camera', without={})}")
            return Status.FINDING
    result_folder(folder)
    words = [*videos, "--camera", camera, "--out", clips, "--sheet", folder / SHEET_FILE]
    for option, value in (("--fps", filmed.fps), ("--palette", filmed.palette_file), ("--mass", mass)):
        words += [option, value] if value is not None else []
    doubtful = _step(context, track, words)
    if not (clips / "clips.toml").is_file():
        print("stopped: no usable shot was found; the lines above give the reasons")
        return Status.FINDING
    if doubtful:
        again = as_called(f"sysid discover {shlex.quote(str(clips))} --out {shlex.quote(str(folder / FOUND_FOLDER))}")
        print(f"stopped: the tracks are doubtful; see {folder / SHEET_FILE}; to continue with them: {again}")
        return Status.FINDING
    if status := _step(context, check, [clips]):
        return status
    status = _step(context, discover, [clips, "--out", folder / FOUND_FOLDER, "--overwrite"])  # of fewer films
    progress.close()
    print(f"\ndone: open {folder / FOUND_FOLDER / 'report.html'} in a browser")
    return status


def _step(context: click.Context, verb: click.Command, words: Sequence[object]) -> int:
    """Run a verb as the command line would, and print it as a command; returns its status."""
    texts = [f"{word:.9g}" if isinstance(word, float) else str(word) for word in words]
    print(f"\n$ sysid {verb.name} {shlex.join(texts)}", flush=True)
    with verb.make_context(str(verb.name), texts, parent=context, obj=context.obj) as inner:
        run: Callable[[click.Context], Any] = verb.invoke
        return int(run(inner))
