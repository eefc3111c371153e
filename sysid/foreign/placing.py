"""Coordinates of another program as metres from the table's centre: the likeliest reading, its evidence in words.

In: a clip set with unchanged coordinates, and what is stated of them. Out: the clip set in the frame of the table, how
it was read, and what had to be assumed. Where two readings are equally likely, the error names the options that decide.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from models.messages import MessageParts, Option, OptionError, option
from models.shot import Table
from sysid.clips.clip_set import ClipSet
from sysid.clips.consistency.readings import (
    UNIT_NAMES,
    Reading,
    ReadingEvidence,
    directed,
    likely_readings,
    may_be_pixels,
    places,
    possible_readings,
    read_so,
)
from sysid.foreign.stated import Stated

CAMERA_FILE = " (made with: sysid calibrate)"
PIXELS_REMEDY = ("; if they are pixels, give ", option("camera", "CAM.toml"), CAMERA_FILE)
RIVAL_COVERAGE = 0.5  # least coverage of a competing reading, over that of the likeliest one


def placed(clip_set: ClipSet, stated: Stated, unit: str | None) -> tuple[ClipSet, str, list[MessageParts]]:
    """The clip set in metres from the table's centre, a description of the conversion, and assumptions."""
    if "px" in (stated.unit, unit):
        raise OptionError("coordinates are in pixels: give the camera's file with ", option("camera"), CAMERA_FILE)
    among = stated.readings(unit)
    fits = likely_readings(clip_set, among)
    if not fits and len(among) > 1:
        fits = [_only_possible(clip_set, among, stated.unit or unit)]
    best = fits[0].reading if fits else among[0]
    rivals = [one.reading for one in fits[1:] if _rivals(one, fits[0])]
    if rivals:
        either = f"{best.looks()}, or {rivals[0].looks()}"
        raise OptionError(f"{_extents(clip_set)}: {either}? ", *_ask([best, *rivals]))
    settled = stated.unit or unit or (bool(fits) and fits[0].shows_scale)
    if not settled and may_be_pixels(clip_set):
        raise OptionError(
            f"{_extents(clip_set)}: {best.looks()}, or pixels? neither cushions nor ball sizes decide; "
            "if they are lengths, give ", option("unit", best.unit), *PIXELS_REMEDY,
        )  # fmt: skip
    reading = best
    if stated.y_down is None or stated.turned is None:
        found = directed(clip_set, best)
        agrees = found is not None and stated.y_down in (None, found.y_down) and stated.turned in (None, found.turned)
        agrees = agrees and found is not None and stated.exchanged in (None, found.exchanged)
        reading = found if found is not None and agrees else best
    assumed = []
    if reading == best and stated.y_down is None and not _has_commands(clip_set):
        assumed.append(MessageParts((
            "y is taken to point up, so that x, y and up are right-handed; the tracks do not show it. If y is "
            "counted downwards, as in pictures, give ", option("y", "down"), ", or sidespin changes its sign",
        )))  # fmt: skip
    return read_so(clip_set, reading), _how(reading) + _because(fits), assumed


def _only_possible(clip_set: ClipSet, among: Sequence[Reading], stated_unit: str | None) -> ReadingEvidence:
    """The reading that puts short tracks on the table; BadInput if none does."""
    possible, extents = possible_readings(clip_set, among), _extents(clip_set)
    if not possible:
        raise OptionError(
            f"{extents}, which fits no table {_size(clip_set.table)} in any unit: correct ", option("table"), ", ",
            option("unit"), ", ", option("origin"), " or ", option("x_along"), "; pixels need ", option("camera"),
            CAMERA_FILE,
        )  # fmt: skip
    if len(possible) > 1:
        ask = _ask([one.reading for one in possible])
        pixels = () if stated_unit or not may_be_pixels(clip_set) else PIXELS_REMEDY
        raise OptionError(f"{extents}: too small a part of the table to infer the units; ", *ask, *pixels)
    return possible[0]


def _how(reading: Reading) -> str:
    """A description of how coordinates are read."""
    words = [f"lengths in {UNIT_NAMES.get(reading.unit, reading.unit)}"]
    words.append(f"origin in {'a corner' if reading.corner else 'the centre'}")
    words.append(f"x along the {'width' if reading.exchanged else 'length'}")
    words.append(f"y {'down' if reading.y_down else 'up'}wards")
    return ", ".join([*words, *["seen from the other end"] * reading.turned])


def _because(fits: Sequence[ReadingEvidence]) -> str:
    """The evidence for the likeliest reading, in words."""
    if not fits:
        return " (as stated)"
    first = fits[0]
    reasons = [f"{first.at_cushions} of {first.at_cushions + first.off_cushions} rebounds lie at the cushions"]
    reasons = reasons if first.at_cushions else []
    reasons += ["balls meet a diameter apart"] * (first.diameter > 0)
    return f" ({' and '.join(reasons) or f'they cover {100 * first.coverage:.0f} % of the table'})"


def _rivals(one: ReadingEvidence, best: ReadingEvidence) -> bool:
    """Whether another reading may also be right."""
    return one.support >= best.support and one.coverage >= RIVAL_COVERAGE * best.coverage


def _ask(readings: Sequence[Reading]) -> list[str | Option]:
    """A request for the options that decide which reading is right, in parts."""
    options = []
    if len({one.unit for one in readings}) > 1:
        options.append(option("unit", *dict.fromkeys(one.unit for one in readings)))
    if len({one.corner for one in readings}) > 1:
        options.append(option("origin", "centre", "corner"))
    if len({one.exchanged for one in readings}) > 1:
        options.append(option("x_along", "length", "width"))
    parts: list[str | Option] = []
    for one in options:
        parts += [", " if parts else "state it with ", one]
    return parts


def _extents(clip_set: ClipSet) -> str:
    (x0, y0), (x1, y1) = np.percentile(np.concatenate(places(clip_set.clips)), (0, 100), axis=0)
    return f"x runs from {x0:.4g} to {x1:.4g} and y from {y0:.4g} to {y1:.4g}"


def _size(table: Table) -> str:
    return f"of {table.length:g} x {table.width:g} m"


def _has_commands(clip_set: ClipSet) -> bool:
    return any(clip.cue is not None for clip in clip_set.clips)
