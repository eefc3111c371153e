"""Families of hidden causes in the picture: a place (x, y) as filmed, with the order of the clip in the session."""

from __future__ import annotations

import math


def skewed_picture(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image is sheared: x + 0.004 y."""
    return seen[0] + 0.004 * seen[1], seen[1]


def sagging_camera(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image slides along x in the session, by 8 mm in all."""
    return seen[0] + 0.008 * order, seen[1]


def bent_picture(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image is bent: x + 0.008 y^2."""
    return seen[0] + 0.008 * seen[1] ** 2, seen[1]


def slow_zoom(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image grows along x in the session, by 0.4 % in all."""
    return seen[0] * (1.0 + 0.004 * order), seen[1]


def turning_camera(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image turns in the session, by 4 mrad in all."""
    return seen[0] - 0.004 * order * seen[1], seen[1] + 0.004 * order * seen[0]


def folded_picture(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image is stretched by 1 % along x beyond x = 0.5 m."""
    return seen[0] + 0.01 * max(0.0, seen[0] - 0.5), seen[1]


def bumped_camera(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image lies 3 mm farther along y in the last 45 % of the session."""
    return seen[0], seen[1] + (0.003 if order > 0.55 else 0.0)


def wavy_picture(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image is wavy: y + 0.003 sin(3 x)."""
    return seen[0], seen[1] + 0.003 * math.sin(3.0 * seen[0])


def fish_eye(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image is drawn outwards by 0.0015 times the cube of the distance from (0.3, -0.2) m."""
    x, y = seen[0] - 0.3, seen[1] + 0.2
    return seen[0] + 0.0015 * (x * x + y * y) * x, seen[1] + 0.0015 * (x * x + y * y) * y


def swaying_camera(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image sways along x in the session, by 4 mm times the sine of 5 times the order."""
    return seen[0] + 0.004 * math.sin(5.0 * order), seen[1]


def narrow_side(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image is 0.5 % narrower along x where y is above 0.3 m."""
    return seen[0] * (0.995 if seen[1] > 0.3 else 1.0), seen[1]


def breathing_lens(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image grows and shrinks in the session, by 0.25 % times the sine of 6 times the order."""
    grown = 1.0 + 0.0025 * math.sin(6.0 * order)
    return seen[0] * grown, seen[1] * grown


def twisted_picture(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image is twisted: y + 0.005 x y."""
    return seen[0], seen[1] + 0.005 * seen[0] * seen[1]


def warming_lens(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image is stretched along x by 0.4 % exp(-order / 0.3): the camera warms up."""
    return seen[0] * (1.0 + 0.004 * math.exp(-order / 0.3)), seen[1]


def knocked_tripod(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image is turned by 3 mrad in the last 30 % of the session."""
    turn = 0.003 if order > 0.7 else 0.0
    return seen[0] - turn * seen[1], seen[1] + turn * seen[0]


def refocused_lens(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image is 0.4 % longer along y after three fifths of the session."""
    return seen[0], seen[1] * (1.004 if order > 0.6 else 1.0)


def settling_camera(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image slides along y and comes to rest, by 6 mm times 1 - exp(-order / 0.25)."""
    return seen[0], seen[1] + 0.006 * (1.0 - math.exp(-order / 0.25))


def lens_in_the_sun(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image is 0.4 % longer along x in the middle third of the session."""
    return seen[0] * (1.004 if 1.0 / 3.0 < order < 2.0 / 3.0 else 1.0), seen[1]


def folded_mirror(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image is folded at the middle: y + 0.004 |x|."""
    return seen[0], seen[1] + 0.004 * abs(seen[0])


def creeping_zoom(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image grows along y by 0.5 % times the square of the order."""
    return seen[0], seen[1] * (1.0 + 0.005 * order**2)
