"""Colours on the screen and on paper: the table, the balls by their names, the model."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping

Colour = tuple[int, int, int]  # red, green, blue in 0..255

MODEL_COLOUR: Colour = (0, 229, 255)
CLOTH_COLOUR, CUSHION_COLOUR, RAIL_COLOUR = (18, 92, 58), (11, 62, 40), (70, 42, 24)
POCKET_COLOUR, FLOOR_COLOUR, WHITE_COLOUR = (8, 8, 8), (28, 30, 34), (250, 248, 235)
SCREEN_COLOURS: Mapping[str, Colour] = {
    "cue": WHITE_COLOUR,
    "white": WHITE_COLOUR,
    "red": (215, 25, 35),
    "yellow": (255, 215, 0),
    "green": (0, 185, 85),
    "brown": (150, 85, 35),
    "blue": (45, 100, 255),
    "pink": (255, 140, 175),
    "black": (22, 22, 22),
    "orange": (255, 110, 20),
    "purple": (110, 60, 170),
    "maroon": (130, 40, 30),
}
INK_BRIGHTNESS = (90.0, 165.0)  # of lines that show on black and on white
OTHER_COLOURS = ((255, 127, 14), (148, 103, 189), (188, 189, 34), (120, 60, 120), (140, 160, 255), (160, 200, 160))


def ball_colour(name: str) -> Colour:
    """The snooker colour that a ball's name starts with (`red_07` is red), else one of PALETTE, always the same."""
    other = OTHER_COLOURS[hashlib.sha256(name.encode()).digest()[0] % len(OTHER_COLOURS)]
    return SCREEN_COLOURS.get(re.split(r"[^a-z]", name.lower(), maxsplit=1)[0], other)


def ink(colour: Colour) -> Colour:
    """The colour of a ball's curves: its own, darkened or lightened until it shows on black and on white."""
    brightness = 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2]
    least, most = INK_BRIGHTNESS
    factor, more = min(1.0, most / max(brightness, 1.0)), max(0.0, least - brightness)
    red, green, blue = (min(255, round(factor * channel + more)) for channel in colour)
    return red, green, blue
