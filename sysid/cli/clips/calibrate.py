"""`sysid calibrate`: a camera's file from a picture or a video of the table."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from models.commands.console import Progress, Status, table, write_json
from models.commands.options import (
    FILE_PATH,
    Number,
    at_most_one,
    gathered,
    given,
    json_option,
    out_option,
    output_option,
)
from models.commands.program import typed_again
from models.errors import BadInput
from sysid.cli.clips.tables import TABLE_HELP, diameter_option, table_set

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from models.shot import Table
    from sysid.vision import Board, CameraHints, FoundCamera, NoCamera


def _metres(name: str, metavar: str, low: float, high: float, text: str, *, required: bool = True) -> Any:
    kind = Number(low, high, unit="metres")
    return click.option(f"--{name}", metavar=metavar, type=kind, required=required, help=text)


@dataclass(frozen=True)
class TableSize:
    """Options of the table and its balls [m]."""

    table_name: str | None = given("--table", "NAME|LxW", TABLE_HELP)
    length: float | None = given(_metres("length", "L", 0.3, 6.0, "Length, nose to nose [m].", required=False))
    width: float | None = given(_metres("width", "W", 0.2, 3.0, "Width, nose to nose [m].", required=False))
    diameter: float | None = given(diameter_option)
    no_pockets: bool = given("--no-pockets", "", "The table has no pockets.", bool)

    def known(self) -> tuple[Table, float]:
        """The table, and the diameter of its balls [m]; BadInput if a size is missing or contradicts another."""
        if self.table_name is not None:
            if self.length is not None or self.width is not None:
                raise BadInput("--table includes length and width: omit --length and --width")
            found = table_set(self.table_name, self.diameter, None, self.no_pockets)
            return found.table, found.ball.diameter
        from models.shot import Table

        if self.length is None or self.width is None or self.diameter is None:
            missing = [f"--{name}" for name in ("length", "width", "diameter") if getattr(self, name) is None]
            raise BadInput(
                f'{", ".join(missing)} missing: give them in metres, or the table by name: --table "pool 8 ft"'
            )
        if self.length < self.width:
            raise BadInput(f"--length {self.length:g} is less than --width {self.width:g}: exchange the two")
        return Table(self.length, self.width, not self.no_pockets), self.diameter


@dataclass(frozen=True)
class BoardOptions:
    """Options of a calibration board: counts as text, sizes [m], its film."""

    board: str | None = given(
        "--board", "9x6|charuco:8x11", "Calibrate the lens with a chessboard, counted by inner corners, or a ChArUco "
        "board, counted by squares.",
    )  # fmt: skip
    square: float | None = given(_metres("square", "S", 0.002, 0.5, "Side of the board's squares [m].", required=False))
    board_marker: float | None = given(
        _metres("board-marker", "M", 0.001, 0.5, "Side of a ChArUco board's markers [m].", required=False)
    )
    lens: Path | None = given("--lens", "VIDEO", "Film of the board; by default VIDEO.", FILE_PATH)

    def words(self) -> list[object]:
        """The given options as words of a command line."""
        given = {"board": self.board, "square": self.square, "board-marker": self.board_marker, "lens": self.lens}
        return [word for name, value in given.items() if value is not None for word in (f"--{name}", value)]

    def value(self) -> Board | None:
        """The board, or None."""
        from sysid.vision import Board

        if self.board is None:
            if self.square is not None or self.lens is not None or self.board_marker is not None:
                raise BadInput("--square, --board-marker and --lens require a board: give --board, such as 9x6")
            return None
        kind, _, size = self.board.lower().rpartition(":")
        counts = size.split("x")
        counted = len(counts) == 2 and all(c.isdigit() and 3 <= int(c) <= 50 for c in counts)
        if kind not in ("", "charuco") or not counted:
            raise BadInput(
                f"--board {self.board}: give a chessboard's inner corners along and across, such as 9x6, or a ChArUco "
                "board's squares, such as charuco:8x11"
            )
        if self.square is None:
            raise BadInput("--board requires --square: give the side of its squares in metres, such as 0.03")
        if (self.board_marker is None) == (kind == "charuco"):
            raise BadInput(
                "--board charuco requires --board-marker: give the side of its markers in metres, such as 0.022"
                if kind
                else f"--board-marker requires a ChArUco board: write --board charuco:{size}"
            )
        return Board(int(counts[0]), int(counts[1]), self.square, self.board_marker)


@dataclass(frozen=True)
class CameraView:
    """Options of the picture: field of view, crossings of the nose lines, cushions in view."""

    fov: float | None = given(
        "--fov", "DEG", "Field of view across the picture's longer side, if known.", Number(3, 150, unit="degrees")
    )
    corners: str | None = given(
        "--corners", '"u,v u,v u,v u,v"', "Approximate crossings of the nose lines [pixels], if they are not found; "
        "with three sides in view, four points along them.",
    )  # fmt: skip
    hold: bool = given("--hold", "", "Keep the given corners within some pixels, and fit the rest.", bool)
    click: bool = given("--click", "", "Click these corners in a browser; prints them in the form of --corners.", bool)
    sees: str = given("--sees", "SIDES", "Cushions in view.", str, "+x,-x,+y,-y")

    marker_size: float | None = given(
        _metres("marker-size", "S", 0.03, 0.5, "Side of the printed markers [m], if not 0.1.", required=False)
    )

    def sides(self) -> list[str]:
        """The cushions in view."""
        from models.shot import RAIL_NAMES

        sides = [side.strip() for side in self.sees.split(",")]
        if len(sides) < 3 or len(set(sides)) < len(sides) or not set(sides) <= set(RAIL_NAMES):
            raise BadInput(f"--sees {self.sees}: name three or four of {', '.join(RAIL_NAMES)}, joined by commas")
        return sides

    def hints(self) -> CameraHints:
        """The options as hints for the calibration."""
        from sysid.vision import CameraHints

        hints = CameraHints(self.fov, corners=self.crossings(), hold=self.hold, sees=self.sides())
        return hints if self.marker_size is None else replace(hints, marker_size=self.marker_size)

    def crossings(self) -> NDArray[np.float64] | None:
        """The given crossings of the nose lines, (4, 2) [pixels]."""
        import numpy as np

        from models.shot import RAIL_NAMES

        at_most_one(click=self.click, corners=self.corners)
        if self.hold and (len(self.sides()) < len(RAIL_NAMES) or not (self.click or self.corners)):
            raise BadInput("--hold: requires --corners or --click, and all four sides in view")
        if self.corners is None:
            return None
        try:
            points = np.array([[float(v) for v in pair.split(",")] for pair in self.corners.split()])
        except ValueError:
            points = np.zeros(0)
        if points.shape != (4, 2) or not np.isfinite(points).all():
            raise BadInput(f'--corners "{self.corners}": give four points as "u,v u,v u,v u,v", in pixels')
        return points

    def next_command(self, refused: NoCamera | FoundCamera, out: Path) -> str:
        """The command to type next if no camera was found, or one that is not to be trusted.

        Asks for corners first; keeps them with --hold if they were given and edges were found; else asks for others.
        """
        from sysid.vision import NoCamera

        found = None if isinstance(refused, NoCamera) else refused
        of_doctor = click.get_current_context().find_root().invoked_subcommand == "doctor"  # which takes it away itself
        again = ["--overwrite"] if (out.exists() or found) and not of_doctor else []
        without = {"--overwrite": 0} if again else {}
        if found is not None and found.lacks_focal_length:
            words = "--board", "9x6", "--square", "0.03", "--lens", "BOARD.mp4"
            filmed = "film a chessboard, tilted to all sides (here of 9x6 inner corners and squares of 30 mm), then"
            return f"{filmed} {typed_again(*words, *again, without=without)}"
        sees = ",".join(refused.seen.sides_in_view()) if isinstance(refused, NoCamera) else self.sees
        if sees != self.sees and len(self.sides()) == 4 and len(sees.split(",")) == 3:
            return typed_again(f"--sees={sees}", *again, without=without | {"--sees": 1})
        corners = found.corners if found is not None and found.by_edges else None
        hold = len(self.sides()) == 4 and (self.hold or corners is not None)
        without |= {"--corners": 1, "--click": 0, "--hold": 0}
        if corners is not None and hold and not self.hold:
            text = " ".join(f"{u:.1f},{v:.1f}" for u, v in corners)
            return typed_again("--corners", text, "--hold", *again, without=without)
        return typed_again("--click", *["--hold"] * hold, *again, without=without)


@dataclass(frozen=True)
class Files:
    """Options of the output files."""

    out: Path = given(out_option("CAM.toml", "File for the camera."))
    report_file: Path | None = given(
        output_option("report", "CAM.png", "Draw the calibrated table over the picture, with its corners magnified.")
    )
    json_file: Path | None = given(json_option)


@click.command()
@click.argument("sources", metavar="VIDEO...", type=FILE_PATH, nargs=-1, required=True)
@gathered("size", TableSize)
@gathered("view", CameraView)
@gathered("board", BoardOptions)
@gathered("files", Files)
@click.pass_obj
def calibrate(
    progress: Progress, sources: tuple[Path, ...], size: TableSize, view: CameraView, board: BoardOptions, files: Files
) -> int:
    """Calibrate a camera from the table itself, or from a board.

    VIDEO is a video, a picture, or a folder of pictures of the table; several of one camera are calibrated together.
    Writes the camera file: lens, position and direction. Status 1 if the result is not to be trusted. In that case, and
    if no camera is found, a picture beside CAM.toml shows what was seen, and the command to type next is printed.

    Example: sysid calibrate table.mp4 --table snooker --out cam.toml
    """
    from sysid.vision import NoCamera, write_camera
    from sysid.vision import calibrate as calibrate_camera

    (table_known, diameter), hints, pattern = size.known(), view.hints(), board.value()
    if pattern is not None and view.fov is not None:
        raise BadInput("--fov and --board both determine the focal length: give one of them")
    progress("reading")

    def click_at(line: str) -> None:
        progress.close()
        print(line, flush=True)

    picture = files.report_file or files.out.with_name(f"{files.out.stem}.seen.png")
    try:
        found = calibrate_camera(
            sources, table_known, diameter, hints, board=pattern, board_film=board.lens,
            click=click_at if view.click else None, progress=progress,
        )  # fmt: skip
    except NoCamera as refusal:
        progress.close()
        refusal.draw(picture)
        print("\n".join(refusal.seen.lines()))
        print(f"what was seen: {picture}\nnext: {view.next_command(refusal, files.out)}", flush=True)
        raise
    progress.close()
    print(table(found.rows(), right=2))
    for line in found.notes:
        print(line)
    for line in found.doubts:
        print(f"NOT to be trusted: {line}")
    if files.report_file or found.doubts:
        found.draw(picture)
        print(f"report: {picture}")
    if files.json_file:
        write_json(files.json_file, found.to_json())
    # Last, because doctor takes an existing camera file for a complete calibration.
    if found.doubts:
        print(f"next: {view.next_command(found, files.out)}")
    write_camera(files.out, found.camera)
    print(f"camera: {files.out}")
    return Status.FINDING if found.doubts else Status.DONE
