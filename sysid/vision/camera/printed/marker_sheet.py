"""The sheet of printed markers: a PDF at true scale; a page says where they lie, the others hold two cards each.

Drawn with Matplotlib, the patterns by OpenCV, in millimetres of A4; what is printed keeps clear of the borders of US
letter paper, too.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from models.files import write_whole
from models.shot import Table
from sysid.vision.camera.printed.markers import (
    MARGIN_SIZES,
    MARKER_LENGTHS,
    MARKER_RAILS,
    MARKER_SIZE_M,
    dictionary,
)

PAGE_MM = (210.0, 297.0)  # A4
LEFT_MM, BOTTOM_MM = 15.0, 22.0  # of the cards on a page
GAP_MM = 4.0  # between two cards
CELLS_ALONG = 6  # along a marker with its black border
RULE_MM = 100.0
HOW_TO_LAY = (
    "Cut the cards out, and lay each on its cushion with the arrowed edge flush with the nose, the arrow opposite to "
    "its place: a ball pushed along the cushion must just touch the card."
)
HOW_TO_PRINT = (
    "Print at 100 % (actual size, not fitted to the page) and check the rule below with a tape. Glue the cards on "
    "stiff cardboard, so that they lie straight on cushion and rail. Film them once for sysid calibrate; they may be "
    "taken away afterwards, as long as the camera stays where it is."
)


def write_markers(path: Path | str, table: Table, name: str) -> None:
    """Write the sheet of a table, whole or not at all.

    Args:
        path: the PDF.
        table: on which the markers are laid.
        name: of the table, as it is printed.
    """
    from matplotlib.backends.backend_pdf import PdfPages

    pages = io.BytesIO()
    # No date: the same table gives the same bytes.
    with PdfPages(pages, metadata={"CreationDate": None, "Title": f"Markers for a table: {name}"}) as pdf:
        for draw in (lambda page: _first_page(page, table, name), *map(_cards, ((0, 1), (2, 3), (4, 5)))):
            figure, page = _page()
            draw(page)
            pdf.savefig(figure)
    write_whole(path, pages.getvalue())


def _page() -> tuple[Any, Any]:
    """A page and its axes, in millimetres from its lower left corner."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PAGE_MM[0] / 25.4, PAGE_MM[1] / 25.4))
    page = figure.add_axes((0, 0, 1, 1))
    page.set(xlim=(0, PAGE_MM[0]), ylim=(0, PAGE_MM[1]))
    page.axis("off")
    return figure, page


def _first_page(page: Any, table: Table, name: str) -> None:
    """What to do, a plan of the table, and a rule."""
    from textwrap import fill

    page.text(15, 270, f"Markers for a table of {table.length:g} x {table.width:g} m ({name})", size=15, weight="bold")
    page.text(15, 262, fill(HOW_TO_LAY, 92), size=10.5, va="top", linespacing=1.4)
    page.text(15, 240, fill(HOW_TO_PRINT, 92), size=10.5, va="top", linespacing=1.4)
    scale = 140 / table.length
    middle, half = np.array([105.0, 150.0]), scale * np.array([table.length, table.width]) / 2
    _box(page, middle - half - 6, 2 * half + 12, fill=False)
    _box(page, middle - half, 2 * half, fill=False)
    for number in range(len(MARKER_RAILS)):
        at, out = _place(number, table)
        _box(page, middle + scale * at + 3 * out - 3, np.array([6.0, 6.0]))
        page.text(*(middle + scale * at + 12 * out), str(number), size=13, weight="bold", ha="center", va="center")
    quarter = 1e3 * table.length * MARKER_LENGTHS[1]
    page.text(
        15, 94, "0 and 3: in the middle of the short cushions. 1, 2, 4 and 5: on the long ones, "
        f"{quarter:.0f} mm from their middle", size=10.5,
    )  # fmt: skip
    page.text(15, 88, "(where there are diamonds, the second from the middle of the table).", size=10.5)
    page.text(15, 82, "The plan is seen from above; number 0 may lie at either end.", size=10.5)
    page.plot([15, 15 + RULE_MM], [60, 60], color="black", lw=1)
    for k in range(11):
        page.plot([15 + 10 * k] * 2, [60, 64 if k % 5 else 67], color="black", lw=0.8)
    page.text(15 + RULE_MM + 4, 60, f"{RULE_MM:.0f} mm", size=10.5)


def _place(number: int, table: Table) -> tuple[np.ndarray, np.ndarray]:
    """Where a marker's arrow belongs (2,) [m], and the direction out of the table there (2,)."""
    axis, sign = MARKER_RAILS[number] // 2, 1.0 - 2.0 * (MARKER_RAILS[number] % 2)
    out = np.eye(2)[axis] * sign
    half = np.array([table.length, table.width]) / 2
    return out * half + np.eye(2)[1 - axis] * MARKER_LENGTHS[number] * table.length, out


def _cards(numbers: Sequence[int]) -> Any:
    """What draws a page of cards, the upper one first."""

    def draw(page: Any) -> None:
        side = 1e3 * MARKER_SIZE_M
        long = side * (1 + 2 * MARGIN_SIZES)
        for k, number in enumerate(reversed(numbers)):
            _card(page, number, np.array([LEFT_MM, BOTTOM_MM + k * (long + GAP_MM)]), side, long)

    return draw


def _card(page: Any, number: int, corner: np.ndarray, side: float, long: float) -> None:
    """A card, its arrowed edge below, and beside it what it is."""
    margin, middle = (long - side) / 2, corner[0] + long / 2
    cells = cv2.aruco.generateImageMarker(dictionary(), number, CELLS_ALONG, borderBits=1) < 128
    cell = side / CELLS_ALONG
    for row, column in zip(*np.nonzero(cells), strict=True):
        low = corner + margin + cell * np.array([column, CELLS_ALONG - 1 - row])
        _box(page, low, np.array([cell, cell]))
    outline = corner + long * np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])
    page.plot(*outline.T, color="0.4", lw=0.4)
    page.fill(middle + np.array([-2.0, 2.0, 0.0]), corner[1] + np.array([4.0, 4.0, 0.0]), color="black", lw=0)
    page.text(corner[0] + 2, corner[1] + long - 6, str(number), size=14, weight="bold")
    beside = corner[0] + long + 5
    page.text(beside, corner[1] + long - 6, f"marker {number}", size=14, weight="bold")
    page.text(beside, corner[1] + long - 14, f"black square: {side:.0f} mm", size=9)
    page.text(beside, corner[1] + 1, "< this edge flush with the nose", size=9)


def _box(page: Any, low: np.ndarray, size: np.ndarray, *, fill: bool = True) -> None:
    """A rectangle, black or in outline."""
    from matplotlib.patches import Rectangle

    shown = {"facecolor": "black", "linewidth": 0.0} if fill else {"fill": False, "linewidth": 0.8}
    page.add_patch(
        Rectangle((float(low[0]), float(low[1])), float(size[0]), float(size[1]), antialiased=False, **shown)
    )
