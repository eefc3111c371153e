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
from pathlib import Path
from typing import Any

import numpy as np

from models.errors import BadInput
from models.messages import MessageParts, counted
from models.shot import Ball, Table
from sysid.clips.clip_set import Clip, ClipSet, CueCommand, Observation
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
from sysid.foreign.placing import placed
from sysid.foreign.records import read_columns
from sysid.foreign.stated import Stated
from sysid.foreign.times import StampClock, read_clock


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
        clip_set, says, assumed = placed(clip_set, stated, units.pop() if units else None)
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
