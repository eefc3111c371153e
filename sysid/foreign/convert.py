"""Tracks of other programs as a clip set: unit, origin and axes, the struck ball and its strike.

In: files and what is stated about them. Out: `Imported`: the clip set, and the assumptions in words.

What is not stated is inferred from the tracks (sysid/clips/consistency/readings.py). If two readings are equally
likely, neither is chosen, and the error names the options that decide.
"""

from __future__ import annotations

import dataclasses
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from models.errors import BadInput
from models.messages import MessageParts, Option, OptionError, counted, option
from models.shot import Ball, Table
from sysid.clips.clip_set import Clip, ClipSet, CueCommand, Observation
from sysid.clips.consistency.readings import (
    METRES_BY_UNIT,
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
from sysid.clips.consistency.strike import STAMP_DECIMALS, first_moving, from_strike
from sysid.clips.running import (
    MIN_RUNNING_SAMPLES,
    begun,
    running_line,
    starts_moving,
    usual_noise,
)
from sysid.foreign.columns import RawClip, RawTrack, read_clip, shots_of
from sysid.foreign.pixels import Pixels, seen_through
from sysid.foreign.records import read_columns
from sysid.foreign.times import StampClock, read_clock

CAMERA_FILE = " (made with: sysid calibrate)"
PIXELS_REMEDY = ("; if they are pixels, give ", option("camera", "CAM.toml"), CAMERA_FILE)
RIVAL_COVERAGE = 0.5  # least coverage of a competing reading, over that of the likeliest one


@dataclass(frozen=True)
class Stated:
    """Stated properties of the files; None if they are to be inferred from the tracks."""

    unit: str | None = None
    corner: bool | None = None
    exchanged: bool | None = None
    y_down: bool | None = None
    turned: bool | None = None
    time: str | None = None
    fps: float | None = None
    nominal_fps: float | None = None  # frame rate as stated, which stamps may contradict
    struck: str | None = None
    running: bool = False  # whether tracks that begin with a ball in motion show no strike
    columns: Mapping[str, str] = field(default_factory=dict)

    def for_pixels(self) -> bool | None:
        """Whether y points down in pictures; BadInput if something is stated that the camera's file determines."""
        apart = {"unit": self.unit, "origin": self.corner, "x_along": self.exchanged, "turned": self.turned}
        for stated in (name for name, value in apart.items() if value is not None):
            raise OptionError(option(stated), ": the camera's file determines this; omit one of the two")
        return self.y_down

    def readings(self, unit: str | None) -> list[Reading]:
        """The readings that are consistent with the statements and the unit in the columns' names."""
        units = [self.unit or unit] if self.unit or unit else list(METRES_BY_UNIT)
        corners = [False, True] if self.corner is None else [self.corner]
        exchanged = [False, True] if self.exchanged is None else [self.exchanged]
        return [
            Reading(one, corner, swap, bool(self.y_down), bool(self.turned))
            for one, corner, swap in product([u for u in units if u], corners, exchanged)
        ]


@dataclass(frozen=True)
class ShotFile:
    """Known properties of one file besides its tracks, from a clip set."""

    file: str  # of the clip to be written
    struck: str | None = None
    note: str = ""
    cue: CueCommand | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)  # other keys of its entry
    running: bool = False  # it begins in mid-motion


@dataclass(frozen=True)
class Imported:
    """The clip set, how the files were read, and assumptions that the tracks do not determine."""

    clip_set: ClipSet
    says: tuple[str, ...]
    assumed: tuple[MessageParts, ...]


def import_files(
    files: Sequence[Path],
    shots: Sequence[ShotFile],
    table: Table,
    ball: Ball,
    stated: Stated,
    pixels: Pixels | None = None,
) -> Imported:
    """Convert the files of a tracker, each of one shot or of several.

    Args:
        files: of the tracker.
        shots: known properties of each.
        table: from nose to nose.
        ball: of the table.
        stated: properties that the user stated.
        pixels: conversion of pixels to positions, if coordinates are pixels.

    Raises:
        BadInput: a faulty file, or an ambiguity, with the option that resolves it.
    """
    raw, shots = _read(files, shots, stated.columns)
    clock = read_clock(raw, stated.time, stated.fps, stated.nominal_fps)
    clips = [_clip(one, shot, clock, stated.struck) for one, shot in zip(raw, shots, strict=True)]
    clip_set = ClipSet(table, ball, clock.fps, tuple(clips))
    units = {one.length_unit for one in raw if one.length_unit}
    if len(units) > 1:
        raise BadInput(f"files are in {' and '.join(sorted(units))}: import them one unit at a time")
    if pixels is not None:
        clip_set, says, assumed = seen_through(pixels, clip_set, stated.for_pixels())
    else:
        clip_set, says, assumed = _placed(clip_set, stated, units.pop() if units else None)
    clips = [dataclasses.replace(clip, struck=clip.struck or _struck(clip)) for clip in clip_set.clips]
    sigma = usual_noise(clip_set)
    unstruck = [_is_running(clip, shot, stated, sigma) for clip, shot in zip(clips, shots, strict=True)]
    clips_begun = [
        _begun(clip, clip_set, sigma) if runs else from_strike(clip) for clip, runs in zip(clips, unstruck, strict=True)
    ]
    clip_set = dataclasses.replace(clip_set, clips=tuple(clips_begun))
    return Imported(clip_set, (says, clock.says, *_about(clip_set, clips, raw)), tuple(assumed))


def _read(
    files: Sequence[Path], shots: Sequence[ShotFile], columns: Mapping[str, str]
) -> tuple[list[RawClip], list[ShotFile]]:
    """The shots of all files; shots of one table get a file name each."""
    raw, named = list[RawClip](), dict[str, ShotFile]()
    for file, shot in zip(files, shots, strict=True):
        own = shot.struck is not None or shot.running  # from a clip set, whose files hold one shot each
        found = read_columns(file)
        parts = [("", found)] if own else shots_of(found, columns)
        width = max(len(name) for name, _ in parts)
        for number, (name, part) in enumerate(parts, 1):
            one = shot
            if len(parts) > 1:
                label = name.zfill(width) if name.isdecimal() else re.sub(r"[^A-Za-z0-9-]+", "_", name)
                stem = shot.file.removesuffix(".csv")
                one = dataclasses.replace(shot, file=f"{stem}_{label or number}.csv", note=f"shot {name}")
            if one.file in named:
                one = dataclasses.replace(one, file=f"{one.file.removesuffix('.csv')}_{number}.csv")
            named[one.file] = one
            raw.append(read_clip(part, columns))
    return raw, list(named.values())


def _clip(raw: RawClip, shot: ShotFile, clock: StampClock, struck: str | None) -> Clip:
    """A clip with times in seconds and unchanged coordinates."""
    start = min(float(one.time[0]) for one in raw.balls.values())

    def seen(one: RawTrack) -> Observation:
        return Observation(np.round((one.time - start) * clock.seconds, STAMP_DECIMALS), one.xy, one.theta)

    balls = {name: seen(one) for name, one in raw.balls.items()}
    struck = struck or shot.struck or ""
    if struck and struck not in balls:
        raise BadInput(f"{raw.file}: has no ball {struck!r} that could be struck; it has {', '.join(balls)}")
    cue = shot.cue or (CueCommand(**raw.cue) if raw.cue else None)
    return Clip(shot.file, struck, balls, cue, shot.note, shot.extra)


def _placed(clip_set: ClipSet, stated: Stated, unit: str | None) -> tuple[ClipSet, str, list[MessageParts]]:
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


def _struck(clip: Clip) -> str:
    """The ball that moves first."""

    def began(name: str) -> float:
        seen, first = clip.balls[name], first_moving(clip.balls[name])
        return float(seen.time[first]) if first < len(seen.time) else np.inf

    return min(clip.balls, key=began)


def _is_running(clip: Clip, shot: ShotFile, stated: Stated, sigma: float) -> bool:
    """Whether a clip shows no strike: as stated, or because several balls move from its first sample on."""
    if shot.running or clip.cue is not None:
        return shot.running
    moving = starts_moving(clip, sigma)
    return bool(moving) if stated.running else stated.struck is None and len(moving) > 1


def _begun(clip: Clip, clip_set: ClipSet, sigma: float) -> Clip:
    """The clip as a running one, see sysid/clips/running.py."""
    found = begun(clip, clip_set, sigma)
    if found is None:
        raise BadInput(f"{clip.file}: no ball moves for {MIN_RUNNING_SAMPLES} samples: omit its file")
    return found


def _about(clip_set: ClipSet, before: Sequence[Clip], raw: Sequence[RawClip]) -> list[str]:
    """Lines on struck balls, samples left out, and unused columns."""
    struck = Counter(clip.struck for clip in clip_set.clips if not clip.running)
    says = ["struck: " + ", ".join(f"{name} in {count}" for name, count in struck.most_common())] if struck else []
    line = running_line(clip_set.clips)
    says += [line] if line else []
    pairs = zip(clip_set.clips, before, strict=True)
    late = sum(clip.origin > one.origin for clip, one in pairs if not clip.running)
    says += [f"{counted(late, 'clip')} began before the strike: samples before it are left out"] if late else []
    unused = list(dict.fromkeys(name for one in raw for name in one.left_out))
    says += [f"columns not used: {', '.join(unused)}"] if unused else []
    commanded = sum(clip.cue is not None for clip in clip_set.clips)
    return says + ([f"commands of the cue: in {counted(commanded, 'clip')}"] if commanded else [])
