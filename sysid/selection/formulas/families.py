"""Families of shapes that an unknown function may be: groups of terms over the range of a variable.

In: a quantity, a variable and its range. Out: families of shapes, each with the places or scales that it may have.
"""

from __future__ import annotations

import dataclasses

from sysid.selection.formulas.terms import (
    DRIFT_VARIABLES,
    PLACE_DIGITS,
    SECOND_STEP,
    SHORT_OR_LONG,
    SIZE_VARIABLES,
    WITHOUT_CONSTANT,
    Shape,
    Term,
    bend,
    decay,
    hat,
    multiplied,
    only_as,
    only_at,
    only_beyond,
    size,
    square,
    step,
    straight,
)

PARTS_OF_RANGE = 20  # first grid of steps and decays over a variable's range
COARSE = 3  # of the places of two steps together one in three: they are refined with the fit
CURVE_INTERVALS = (4, 8, 16)  # numbers of intervals between the hats of a curve
LOCAL_PARTS, LOCAL_INTERVALS = (2, 4, 8), 8  # of a range over which a curve of so many intervals changes
DECAY_VARIABLES = ("speed", "slip", "approach", "time", "order", "cloth_age")  # over which a quantity may decay


def curve(
    quantity: str, variable: str, low: float, high: float, intervals: int, name: str = "", at_one: bool = False
) -> Shape:
    """A curve of hats over a range, constant beyond it.

    It is 0 in its middle if the model has a constant of the quantity, which that of one rail or ball is not (`at_one`).
    Its hats are named by the number of intervals, unless a name is given.
    """
    half, middle = max(round((high - low) / intervals, PLACE_DIGITS), 10.0**-PLACE_DIGITS), (low + high) / 2
    hats = []
    for k in range(intervals + 1):
        at = round(round(middle, PLACE_DIGITS) + (k - intervals // 2) * half, PLACE_DIGITS) + 0.0
        side = 1.0 if k == 0 else -1.0 if k == intervals else 0.0
        if 2 * k != intervals or at_one or quantity in WITHOUT_CONSTANT:
            hats.append(hat(quantity, variable, f"{name or intervals}_{k}", at, half, side))
    return tuple(hats)


def local_curves(quantity: str, variable: str, low: float, high: float) -> list[list[Shape]]:
    """Families of curves over a part of a range: what is so small lies between the nodes of a curve over all of it."""
    found = []
    for parts in LOCAL_PARTS:
        half, name = (high - low) / parts / 2, f"{parts * LOCAL_INTERVALS}"
        found.append([
            curve(quantity, variable, low + k * half, low + (k + 2) * half, LOCAL_INTERVALS, f"{name}_{k}")
            for k in range(2 * parts - 1)
        ])  # fmt: skip
    return found


def places_in(low: float, high: float) -> tuple[float, ...]:
    """The edges between PARTS_OF_RANGE parts of a range."""
    return tuple(low + (high - low) * k / PARTS_OF_RANGE for k in range(1, PARTS_OF_RANGE))


def shapes(
    quantity: str, variable: str, low: float, high: float, places: tuple[float, ...] | None = None,
    at_one: bool = False,
) -> list[list[Shape]]:  # fmt: skip
    """Families of shapes of a variable over a range, each with its possible places or scales.

    `places` are those of steps and bends; by default `places_in` the range.
    """
    plain = straight(quantity, variable, 0)
    families: list[list[Shape]] = [[(one,)] for one in plain]
    if variable == "heading":
        return [*families, [tuple(plain[:2])], [tuple(plain[2:])], [tuple(plain)]]
    parts = places_in(0.0, high - low)
    places = places_in(low, high) if places is None else places
    steps = [step(quantity, variable, place) for place in places]
    steps = [dataclasses.replace(one, limits=(low, high)) for one in steps]
    second = [dataclasses.replace(one, name=f"{quantity}_{variable}_{SECOND_STEP}") for one in steps]
    parabola = (*plain, square(quantity, variable))
    families += [[parabola[1:]], [parabola], [(one,) for one in steps]]
    if at_one or quantity in WITHOUT_CONSTANT:  # without a constant they are no steps above it
        below = [step(quantity, variable, place, -1.0) for place in places]
        families.append([(dataclasses.replace(one, limits=(low, high)),) for one in below])
    for side in (1.0, -1.0):
        bends = [bend(quantity, variable, place, side) for place in places]
        families.append([(dataclasses.replace(one, limits=(low, high)),) for one in bends])
    apart = 2 if variable in DRIFT_VARIABLES else 1  # places between which two clips lie at least: one may just depart
    families.append([(one, two) for k, one in enumerate(steps) for two in second[k + apart :]])
    if variable in DECAY_VARIABLES:
        decays, least = [decay(quantity, variable, part) for part in parts], parts[0] / PARTS_OF_RANGE
        families.append([(dataclasses.replace(one, limits=(least, high - low)),) for one in decays])
    if variable in SIZE_VARIABLES:
        families.append([(size(quantity, variable),)])
    curves = [curve(quantity, variable, low, high, intervals, at_one=at_one) for intervals in CURVE_INTERVALS]
    return [*families, curves]


def shapes_at_one(
    quantity: str,
    counted: str,
    count: int,
    variable: str,
    low: float,
    high: float,
    places: tuple[float, ...] | None = None,
) -> list[list[Shape]]:
    """The shapes restricted to each single rail or ball, or to the short rails or the long ones."""
    every = shapes(quantity, variable, low, high, places, at_one=True)
    found = [
        [tuple(only_at(one, counted, k) for one in shape) for shape in family] for k in range(count) for family in every
    ]
    if counted == "rail":
        found += [
            [tuple(only_beyond(one, counted, SHORT_OR_LONG, side) for one in shape) for shape in family]
            for side in (-1.0, 1.0) for family in every
        ]  # fmt: skip
    return found


def shapes_beyond(
    shape: Shape, variable: str, low: float, high: float, places: tuple[float, ...] | None = None
) -> list[list[Shape]]:
    """A shape restricted to either side of places in a range of another variable.

    Where it acts is a parameter of a single term; the terms of a curve keep the place that they are given.
    """
    places = places_in(low, high) if places is None else places
    moves = len(shape) == 1
    return [
        [
            tuple(
                dataclasses.replace(only_beyond(one, variable, at, side), only_limits=(low, high), only_moves=moves)
                for one in shape
            )
            for at in places
        ]
        for side in (1.0, -1.0)
    ]


def shapes_times(
    quantity: str, variable: str, over: str, low: float, high: float, beside: bool = False
) -> list[list[Shape]]:
    """The curves and decays of a variable over a range, each in proportion to another one.

    They are 0 in the middle of the range beside a line of the other variable.
    """
    whole = [curve(quantity, variable, low, high, count, at_one=True) for count in CURVE_INTERVALS]
    curves = [tuple(one for k, one in enumerate(shape) if not beside or 2 * k + 1 != len(shape)) for shape in whole]
    found = [[tuple(multiplied(one, over) for one in shape) for shape in curves]]
    if variable in DECAY_VARIABLES:
        decays = [multiplied(decay(quantity, variable, part), over) for part in places_in(0.0, high - low)]
        least = (high - low) / PARTS_OF_RANGE**2
        found.append([(dataclasses.replace(one, limits=(least, high - low)),) for one in decays])
    return found


def shapes_of_drift(
    quantity: str, line: str, over: str, span: tuple[float, float], low: float, high: float,
    places: tuple[float, ...] | None = None,
) -> list[list[Shape]]:  # fmt: skip
    """What is in proportion to one variable, and any shape over the range of another.

    A step in the range `span` of the first one, on one side of a place in the other, may look like that as well.
    """
    every = places_in(low, high) if places is None else places
    families = [
        [tuple(multiplied(one, line) for one in shape) for shape in family]
        for family in shapes(quantity, over, low, high, places, at_one=True)
    ]
    for side in (1.0, -1.0):
        steps = [step(quantity, line, at, side) for at in places_in(*span)[::COARSE]]
        beyond = [
            shapes_beyond((dataclasses.replace(one, limits=span),), over, low, high, every[::COARSE]) for one in steps
        ]
        families += [[shape for both in beyond for shape in both[k]] for k in (0, 1)]
    return families


def shapes_as(like: Term, low: float, high: float, places: tuple[float, ...] | None = None) -> list[list[Shape]]:
    """The shapes of the variable of a term's factor under the same condition."""
    return [
        [
            tuple(dataclasses.replace(only_as(one, like), only_moves=len(shape) == 1) for one in shape)
            for shape in family
        ]
        for family in shapes(like.quantity, like.variable or "", low, high, places, at_one=True)
    ]


def counted_shapes(quantity: str, variable: str, count: int) -> list[list[Shape]]:
    """Shapes of rails or balls: a single one, each relative to the first, or the long rails to the short ones."""
    each = straight(quantity, variable, count)
    found: list[list[Shape]] = [[(one,) for one in each]]
    if variable == "rail":
        found.append([(step(quantity, variable, SHORT_OR_LONG),)])
    return [*found, [tuple(each[1:])]] if count > 2 else found
