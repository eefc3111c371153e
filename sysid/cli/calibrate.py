"""`sysid calibrate`: a camera's file from a picture or a video of the table."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from models.command_line import FILE_PATH, Number, at_most_one, gathered, given, json_option, out_option, output_option
from models.console import Progress, Status, table, write_json
from models.errors import BadInput
from sysid.cli.tables import TABLE_HELP, diameter_option, table_set

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from models.shot import Table

    Picture = NDArray[np.uint8]

PICTURE_SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".ppm"}
MEDIAN_FRAMES = 15  # of a video, of which the median is taken
MIN_MEDIAN_FRAMES = 5  # of each of several videos
MAX_ALL_FRAMES = 60  # of all of them
BOARD_FRAMES = 40  # that are searched for a board


def _metres(name: str, metavar: str, low: float, high: float, text: str, *, required: bool = True) -> Any:
    kind = Number(low, high, unit="metres")
    return click.option(f"--{name}", metavar=metavar, type=kind, required=required, help=text)


@dataclass(frozen=True)
class TableSize:
    """What must be known of the table and its balls [m]."""

    table_name: str | None = given("--table", "NAME|LxW", TABLE_HELP)
    length: float | None = given(_metres("length", "L", 0.3, 6.0, "Length, nose to nose [m].", required=False))
    width: float | None = given(_metres("width", "W", 0.2, 3.0, "Width, nose to nose [m].", required=False))
    diameter: float | None = given(diameter_option)
    no_pockets: bool = given("--no-pockets", "", "The table has no pockets.", bool)

    def known(self) -> tuple[Table, float]:
        """The table, and the diameter of its balls [m]; BadInput where something is missing or does not fit."""
        if self.table_name is not None:
            if self.length is not None or self.width is not None:
                raise BadInput("--table gives length and width: leave out --length and --width")
            found = table_set(self.table_name, self.diameter, None, self.no_pockets)
            return found.table, found.ball.diameter
        from models.shot import Table

        if self.length is None or self.width is None or self.diameter is None:
            missing = [f"--{name}" for name in ("length", "width", "diameter") if getattr(self, name) is None]
            raise BadInput(
                f'{", ".join(missing)} missing: give them in metres, or the table by name: --table "pool 8 ft"'
            )
        if self.length < self.width:
            raise BadInput(f"--length {self.length:g} is less than --width {self.width:g}: exchange them")
        return Table(self.length, self.width, not self.no_pockets), self.diameter


@dataclass(frozen=True)
class Board:
    """A chessboard from which the lens is taken: inner corners as text, side of a square [m], where it was filmed."""

    board: str | None = given("--board", "9x6", "Take the lens from a chessboard with so many inner corners.")
    square: float | None = given(_metres("square", "S", 0.002, 0.5, "Side of the board's squares [m].", required=False))
    lens: Path | None = given("--lens", "VIDEO", "Where the board was filmed; by default VIDEO.", FILE_PATH)

    def pattern(self) -> tuple[int, int] | None:
        """Inner corners along and across; None without a board."""
        if self.board is None:
            if self.square is not None or self.lens is not None:
                raise BadInput("--square and --lens belong to a board: give --board, such as 9x6")
            return None
        counts = self.board.lower().split("x")
        if len(counts) != 2 or not all(c.isdigit() and 3 <= int(c) <= 50 for c in counts):
            raise BadInput(f"--board {self.board}: give its inner corners along and across, such as 9x6")
        if self.square is None:
            raise BadInput("--board needs --square: give the side of its squares in metres, such as 0.03")
        return int(counts[0]), int(counts[1])


@dataclass(frozen=True)
class CameraView:
    """What is known of the picture: field of view, where the nose lines cross, which cushions are seen."""

    fov: float | None = given(
        "--fov", "DEG", "Field of view across the picture's longer side, if known.", Number(3, 150, unit="degrees")
    )
    corners: str | None = given(
        "--corners", '"u,v u,v u,v u,v"', "Where about the nose lines cross [pixels] if not found; with three sides "
        "in view, four points along them.",
    )  # fmt: skip
    hold: bool = given("--hold", "", "Keep the corners given to some pixels, and fit the rest.", bool)
    click: bool = given("--click", "", "Click these corners in a browser; prints them as --corners takes them.", bool)
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

    def crossings(self) -> NDArray[np.float64] | None:
        """Where the nose lines cross, (4, 2) [pixels]."""
        import numpy as np

        from models.shot import RAIL_NAMES

        at_most_one(click=self.click, corners=self.corners)
        if self.hold and (len(self.sides()) < len(RAIL_NAMES) or not (self.click or self.corners)):
            raise BadInput("--hold: goes with --corners or --click, all four sides in view")
        if self.corners is None:
            return None
        try:
            points = np.array([[float(v) for v in pair.split(",")] for pair in self.corners.split()])
        except ValueError:
            points = np.zeros(0)
        if points.shape != (4, 2) or not np.isfinite(points).all():
            raise BadInput(f'--corners "{self.corners}": give four points as "u,v u,v u,v u,v", in pixels')
        return points

    def clicked(self, picture: Picture) -> NDArray[np.float64]:
        """Where the nose lines cross as clicked in a browser, (4, 2) [pixels]; prints them for another time."""
        from sysid.vision.camera.clicks import as_option, clicked

        points = clicked(picture, len(self.sides()), lambda line: print(line, flush=True))
        print(f"clicked: {as_option(points)}", flush=True)
        return points


@dataclass(frozen=True)
class Files:
    """Where the camera goes, and the picture and figures where asked."""

    out: Path = given(out_option("CAM.toml", "Where the camera file goes."))
    report_file: Path | None = given(
        output_option("report", "CAM.png", "Draw the model of the table over the picture, its corners magnified.")
    )
    json_file: Path | None = given(json_option)


@click.command()
@click.argument("sources", metavar="VIDEO...", type=FILE_PATH, nargs=-1, required=True)
@gathered("size", TableSize)
@gathered("view", CameraView)
@gathered("board", Board)
@gathered("files", Files)
@click.pass_obj
def calibrate(
    progress: Progress, sources: tuple[Path, ...], size: TableSize, view: CameraView, board: Board, files: Files
) -> int:
    """Calibrate a camera from the table itself, or from a chessboard.

    VIDEO is a video, a picture, or a folder of pictures of the table; several of one camera are calibrated together.
    Writes the camera file: lens, position and direction. Status 1 if the result is not to be trusted.

    Example: sysid calibrate table.mp4 --table snooker --out cam.toml
    """
    import cv2
    import numpy as np

    from sysid.vision.camera.calibrate import CameraHints
    from sysid.vision.camera.calibrate import calibrate as calibrate_picture
    from sysid.vision.camera.calibration_picture import draw
    from sysid.vision.camera.calibration_report import place_sd, rows, to_json
    from sysid.vision.camera.camera_motion import side_profiles
    from sysid.vision.camera.footages import table_view
    from sysid.vision.camera.markers import MARKER_SIZE_M
    from sysid.vision.camera.projection import write_camera

    cv2.setNumThreads(1)  # pictures are small: threads only wait for each other
    (cushions, diameter), sides, crossings = size.known(), view.sides(), view.crossings()
    lens, notes, pattern = None, [], board.pattern()
    if pattern is not None and board.square is not None:
        from sysid.vision.camera.board import lens_of

        if view.fov is not None:
            raise BadInput("--fov and --board both give the focal length: give one of them")
        lens = lens_of(frames(board.lens or sources[0], BOARD_FRAMES), pattern, board.square, progress)
        views = f"{lens.views} views" if lens.views > 1 else "one view"
        notes.append(f"lens from {views} of the board in {board.lens or sources[0]}, corners to {lens.rms:.2f} pixels")
    progress("reading")
    each = max(MIN_MEDIAN_FRAMES, min(MEDIAN_FRAMES, MAX_ALL_FRAMES // len(sources)))
    table_seen = table_view({str(source): list(frames(source, each)) for source in sources})
    notes += table_seen.notes
    if view.click:
        progress.close()
        crossings = view.clicked(np.rint(table_seen.picture).astype(np.uint8))
    hints = CameraHints(view.fov, lens, crossings, view.hold, sides, view.marker_size or MARKER_SIZE_M)
    found = calibrate_picture(
        table_seen.picture, cushions, diameter, hints, stills=table_seen.stills, source=", ".join(table_seen.used),
        progress=progress,
    )  # fmt: skip
    progress.close()
    profiles = side_profiles([np.rint(table_seen.picture).astype(np.uint8)], found.camera)
    print(table(rows(found), right=2))
    for line in (*notes, *found.notes):
        print(line)
    for line in found.doubts:
        print(f"NOT to be trusted: {line}")
    if files.report_file:
        draw(files.report_file, np.rint(table_seen.picture).astype(np.uint8), found)
        print(f"report: {files.report_file}")
    if files.json_file:
        write_json(files.json_file, to_json(found))
    # The last: doctor takes a camera that is there for a calibration that came to its end.
    write_camera(files.out, replace(found.camera, place_sd_m=place_sd(found), sides=profiles))
    print(f"camera: {files.out}")
    return Status.FINDING if found.doubts else Status.DONE


def frames(path: Path, count: int) -> Iterator[Picture]:
    """Up to so many pictures, spread over a video or a folder, or the one that a file holds: (height, width, 3)."""
    import cv2
    import numpy as np

    from sysid.vision.frames import check_size, grabbed, quiet, read_picture, retrieved

    if not (path.is_file() or path.is_dir()):
        raise BadInput(f"{path}: does not exist; name a video, a picture, or a folder of pictures")
    if path.is_dir() or path.suffix.lower() in PICTURE_SUFFIXES:
        files = sorted(f for f in path.iterdir() if f.suffix.lower() in PICTURE_SUFFIXES) if path.is_dir() else [path]
        if not files:
            raise BadInput(
                f"{path}: holds no pictures ({', '.join(sorted(PICTURE_SUFFIXES))}); name a video or a picture"
            )
        shape: tuple[int, ...] | None = None
        for k in np.unique(np.linspace(0, len(files) - 1, min(count, len(files))).astype(int)):
            picture = read_picture(files[k])
            if picture is None:
                raise BadInput(f"{files[k]}: is not a picture that can be read; take it away or convert it to PNG")
            if shape not in (None, picture.shape):
                raise BadInput(f"{files[k]}: is of another size than those before it; take it away")
            shape = picture.shape
            yield picture
        return
    with quiet():
        video = cv2.VideoCapture(str(path))
    check_size(path, video.get(cv2.CAP_PROP_FRAME_WIDTH), video.get(cv2.CAP_PROP_FRAME_HEIGHT))
    try:
        total = int(video.get(cv2.CAP_PROP_FRAME_COUNT)) if video.isOpened() else 0
        yielded = False
        for k in np.unique(np.linspace(0, max(total - 1, 0), count).astype(int)):
            if k > 0:
                video.set(cv2.CAP_PROP_POS_FRAMES, int(k))
            picture = retrieved(video) if grabbed(video) else None
            if picture is not None:
                yielded = True
                yield picture
        if not yielded:
            raise BadInput(f"{path}: is not a video that can be read; convert it, to H.264 in mp4 for instance")
    finally:
        video.release()
