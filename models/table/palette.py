"""Colours on the screen, on paper and in MuJoCo: the table, the balls by their names, the model.

Pool balls are known by their numbers; a striped ball has the colour of its stripe.
"""

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
POOL_COLOURS = ("yellow", "blue", "red", "purple", "orange", "green", "maroon", "black")  # of balls 1 to 8, and 9 to 15
POOL_NUMBER = re.compile(r"(?:ball|solid|stripe|stripes|solids)?[ _-]*0*(\d{1,2})(?:[ _-]*ball)?")
NUMBER_WORDS = ("one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
INK_BRIGHTNESS = (90.0, 165.0)  # range of lines that are visible on black and on white
OTHER_COLOURS = ((255, 127, 14), (148, 103, 189), (188, 189, 34), (120, 60, 120), (140, 160, 255), (160, 200, 160))


def ball_colour(name: str) -> Colour:
    """The colour at the beginning of a ball's name (`red_07` is red), that of its pool number, or a default."""
    if (number := pool_number(name)) is not None:
        return SCREEN_COLOURS[POOL_COLOURS[(number - 1) % len(POOL_COLOURS)]]
    other = OTHER_COLOURS[hashlib.sha256(name.encode()).digest()[0] % len(OTHER_COLOURS)]
    return SCREEN_COLOURS.get(re.split(r"[^a-z]", name.lower(), maxsplit=1)[0], other)


def pool_number(name: str) -> int | None:
    """The number of a pool ball with a name such as 8, ball 8, 8 ball or eight; None for other names."""
    plain = name.strip().lower()
    word = plain.removeprefix("ball").removesuffix("ball").strip(" _-")
    if word in NUMBER_WORDS:
        return NUMBER_WORDS.index(word) + 1
    found = POOL_NUMBER.fullmatch(plain)
    return int(found[1]) if found is not None and 1 <= int(found[1]) <= 15 else None


def ink(colour: Colour) -> Colour:
    """The colour of a ball's curves: its own, darkened or lightened until it is visible on black and on white."""
    brightness = 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2]
    least, most = INK_BRIGHTNESS
    factor, more = min(1.0, most / max(brightness, 1.0)), max(0.0, least - brightness)
    red, green, blue = (min(255, round(factor * channel + more)) for channel in colour)
    return red, green, blue
