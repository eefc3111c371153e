"""A camera from films or pictures of a table: what `sysid calibrate` does, as one function.

In: videos or pictures of one camera, the sizes of table and balls, and what is known of the camera. Out:
`FoundCamera`, to be written, drawn and put into words; or `NoCamera`, which draws what was seen all the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from models.errors import BadInput
from models.shot import Array, Table
from sysid.vision.camera.board import Board, lens_of
from sysid.vision.camera.calibrate import Calibration
from sysid.vision.camera.calibrate import calibrate as calibrate_picture
from sysid.vision.camera.camera_motion import side_profiles
from sysid.vision.camera.footages import table_view
from sysid.vision.camera.pictures import calibration_picture, calibration_report
from sysid.vision.camera.pictures.clicks import as_option, clicked
from sysid.vision.camera.pictures.seen_picture import SeenTable, seen_table
from sysid.vision.camera.projection import Camera
from sysid.vision.camera.table.reading import CameraHints
from sysid.vision.camera.trust import is_of_focal_length
from sysid.vision.samples import spread_pictures
from sysid.vision.sources.pictures import Picture

MEDIAN_FRAMES = 15  # of a video, of which the median is taken
MIN_MEDIAN_FRAMES = 5  # of each of several videos
MAX_ALL_FRAMES = 60  # of all of them
BOARD_FRAMES = 40  # that are searched for a board


class NoCamera(BadInput):
    """No camera over the table was found; `draw` shows what was seen."""

    def __init__(self, why: str, seen: SeenTable) -> None:
        """Why none was found, and what the picture shows."""
        super().__init__(why)
        self.seen = seen

    def draw(self, path: Path) -> None:
        """Write the picture with what was seen, and why that was not enough."""
        self.seen.draw(path, str(self))


@dataclass(frozen=True)
class FoundCamera:
    """A camera that was found, with all that is said of it."""

    camera: Camera
    calibration: Calibration
    picture: Picture  # (height, width, 3) in which it was found
    notes: tuple[str, ...]
    corners: Array | None  # (4, 2) given or clicked [pixels]

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons not to trust it."""
        return self.camera.doubts

    @property
    def by_edges(self) -> bool:
        """Whether edges were found, and not all is from corners or markers alone."""
        return self.calibration.edges

    @property
    def lacks_focal_length(self) -> bool:
        """Whether the focal length, which corners do not determine, is all that is in doubt."""
        return bool(self.doubts) and all(map(is_of_focal_length, self.doubts))

    def rows(self) -> list[tuple[str, str]]:
        """Name and text of every figure."""
        return calibration_report.rows(self.calibration)

    def to_json(self) -> dict[str, Any]:
        """The figures, `billiard-calibration/1`."""
        return calibration_report.to_json(self.calibration)

    def draw(self, path: Path) -> None:
        """Write the picture with the model of the table over it, its corners magnified."""
        calibration_picture.draw(path, self.picture, self.calibration, self.corners)


def calibrate(
    sources: Sequence[Path], table: Table, diameter: float, hints: CameraHints | None = None, *,
    board: Board | None = None, board_film: Path | None = None, click: Callable[[str], None] | None = None,
    progress: Callable[[str], None] = lambda line: None,
) -> FoundCamera:  # fmt: skip
    """Calibrate a camera from the table itself.

    Args:
        sources: videos, pictures or folders of pictures of the table, of one camera.
        table: nose to nose.
        diameter: of the balls [m].
        hints: what is known of the camera.
        board: from which the lens is taken.
        board_film: where it is filmed; by default the first source.
        click: has the corners clicked in a browser, and receives the lines that say where.
        progress: receives a line on what is being done.

    Raises:
        NoCamera: none was found.
        BadInput: what is wrong with a file, or with a board.
    """
    cv2.setNumThreads(1)  # pictures are small: threads only wait for each other
    hints, notes = hints or CameraHints(), list[str]()
    if board is not None:
        film = board_film or sources[0]
        lens = lens_of(spread_pictures(film, BOARD_FRAMES), board, progress)
        views = f"{lens.views} views" if lens.views > 1 else "one view"
        notes.append(f"lens from {views} of the {board.name} in {film}, corners to {lens.rms:.2f} pixels")
        hints = replace(hints, lens=lens)
    progress("reading")
    each = max(MIN_MEDIAN_FRAMES, min(MEDIAN_FRAMES, MAX_ALL_FRAMES // len(sources)))
    view = table_view({str(source): list(spread_pictures(source, each)) for source in sources})
    picture = np.rint(view.picture).astype(np.uint8)
    if hints.lens is not None and hints.lens.size != picture.shape[1::-1]:
        size = picture.shape[1::-1]
        w, h = hints.lens.size
        raise BadInput(f"the board was filmed at {w}x{h} pixels, the table at {size[0]}x{size[1]}: use one size")
    if click is not None:
        hints = replace(hints, corners=clicked(picture, len(hints.sees), click))
        click(f"clicked: {as_option(np.asarray(hints.corners))}")
    try:
        found = calibrate_picture(
            view.picture, table, diameter, hints, stills=view.stills, source=", ".join(view.used), progress=progress
        )
    except BadInput as error:
        progress("examining the picture for what it shows of a table")
        raise NoCamera(str(error), seen_table(picture, table, diameter, hints.corners, hints.marker_size)) from error
    camera = replace(
        found.camera, place_sd_m=calibration_report.place_sd(found)[0], sides=side_profiles([picture], found.camera)
    )
    return FoundCamera(camera, found, picture, (*notes, *view.notes, *found.notes), hints.corners)
