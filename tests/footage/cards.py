"""Printed markers on the cushions, as `sysid markers` prints them: cards that lie on nose and rail, well or badly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from models.shot import NOSE_HEIGHT, Table
from sysid.vision.camera.printed.markers import MARGIN_SIZES, MARKER_LENGTHS, MARKER_RAILS, MARKER_SIZE_M, dictionary
from sysid.vision.camera.projection import Array, Camera, meet_plane

PAPER, INK = 0.88, 0.06  # light of white and black
CELLS = 6  # along a marker with its black border


@dataclass(frozen=True)
class Card:
    """A card on a cushion."""

    number: int
    place: int | None = None  # that of another number, where it was laid by mistake
    along: float = 0.0  # off its place [m]
    out: float = 0.0  # of its front edge behind the nose [m]
    turn: float = 0.0  # about the vertical [rad]
    scale: float = 1.0  # of the print
    size: float = MARKER_SIZE_M  # of the marker as it should be printed [m]


def all_cards(**laid: float) -> tuple[Card, ...]:
    """All six, laid alike."""
    return tuple(Card(number, **laid) for number in range(len(MARKER_RAILS)))


@cache
def _pattern(number: int) -> NDArray[np.bool_]:
    """Black cells, the row next to the rail first."""
    return np.asarray(cv2.aruco.generateImageMarker(dictionary(), number, CELLS, borderBits=1) < 128)


def lay(cards: Sequence[Card], camera: Camera, rays: Array, colours: Array, rise: float) -> None:
    """Draw cards over the colours (n, 3) of rays (n, 3); their rear lies on a rail that rises over the noses [m]."""
    if not cards:
        return
    nose = NOSE_HEIGHT * camera.radius
    low, high = (np.nan_to_num(meet_plane(camera.eye, rays, z), nan=9.0) for z in (nose, nose + rise))
    for card in cards:
        u, v, side = _own(card, camera.table, low, high)
        margin = MARGIN_SIZES * side
        on = (np.abs(u) < side / 2 + margin) & (v > 0) & (v < side + 2 * margin)
        colours[on] = PAPER
        cell = np.floor(np.stack([(u[on] + side / 2), side + margin - v[on]]) / side * CELLS).astype(int)
        inside = ((cell >= 0) & (cell < CELLS)).all(axis=0)
        black = np.zeros(int(on.sum()), bool)
        black[inside] = _pattern(card.number)[cell[1, inside], cell[0, inside]]
        colours[np.flatnonzero(on)[black]] = INK


def _own(card: Card, table: Table, low: Array, high: Array) -> tuple[Array, Array, float]:
    """Places on a card, to the right and from its front edge [m], seen from the bed; side of the marker.

    Args:
        card: the card.
        table: on which it lies.
        low: places (n, 2) of the pixels at the height of the noses [m].
        high: and at that of the rail's top [m].
    """
    at = card.number if card.place is None else card.place
    rail, side = MARKER_RAILS[at], card.size * card.scale
    axis, sign = rail // 2, 1.0 - 2.0 * (rail % 2)
    out = np.zeros(2)
    out[axis] = sign
    right = np.array([out[1], -out[0]])
    middle = out * ((table.length, table.width)[axis] / 2 + card.out)
    middle[1 - axis] = MARKER_LENGTHS[at] * table.length + card.along
    long = side * (1 + 2 * MARGIN_SIZES)
    c, s = np.cos(card.turn), np.sin(card.turn)
    depth = np.zeros(len(low))
    for _ in range(3):  # towards where the line of sight meets the card
        xy = low + (high - low) * np.clip(depth / long, 0, 1)[:, None] - middle
        u, v = xy @ right, xy @ out
        u, v = c * u + s * v, c * v - s * u
        depth = v
    return u, v, side
