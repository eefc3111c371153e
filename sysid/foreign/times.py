"""Conversion of other programs' times to seconds, and the frame rate.

In: `RawClip`s, and what is stated about them. Out: a `StampClock`. Small whole numbers count frames; others are in
seconds, or in fractions of one that give some 5 to 10,000 frames a second. A frame rate given together with stamps in
seconds is the rate at which the film was taken: if the film plays slower than that, its stamps are too long.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.errors import BadInput
from models.messages import Option, OptionError
from models.shot import Array
from sysid.clips.consistency.tempo import SOUND_INTERVAL
from sysid.clips.consistency.units import SECONDS_BY_UNIT, are_whole
from sysid.foreign.columns import RawClip

FRAME_RATE = Option("--fps F", "fps=F")
MAX_FRAMES_APART = 5.0  # largest usual interval of rows counted in frames
MAX_INTERVAL_S = 0.2  # largest usual interval of rows
ROUND_RATE = 1e-3  # relative difference within which a rate is rounded to a whole number
SAME_RATE = 0.02  # relative difference within which stamps agree with a given rate


@dataclass(frozen=True)
class StampClock:
    """The conversion of stamps to seconds."""

    unit: str
    seconds: float  # of one unit
    fps: float
    says: str


def read_clock(clips: Sequence[RawClip], unit: str | None, fps: float | None, nominal: float | None) -> StampClock:
    """The clock of all clips; BadInput if frames are counted and no rate is known.

    Args:
        clips: with their stamps.
        unit: of stamps; None to infer it from them.
        fps: true frame rate [1/s].
        nominal: the camera's rate as stated earlier, which stamps may contradict.
    """
    stamps = [np.unique(np.concatenate([one.time for one in clip.balls.values()])) for clip in clips]
    steps: Array = np.concatenate([np.diff(t) for t in stamps])
    if not len(steps):
        raise BadInput(f"{clips[0].file}: holds a single time only: name the file of a whole shot")
    step = float(np.median(steps))
    named = {clip.time_unit for clip in clips if clip.time_unit}
    unit = unit or (named.pop() if len(named) == 1 else None) or _likely(steps, step)
    if unit == "frames":
        fps = fps or nominal
        if fps is None:
            raise OptionError(f"{clips[0].file}: times count frames: give the frame rate with ", FRAME_RATE)
        return StampClock(unit, 1 / fps, fps, f"times count frames, {fps:g} a second")
    seconds = SECONDS_BY_UNIT.get(unit, 1.0)
    rate = 1 / (step * seconds)
    whole = round(rate)
    rate = float(whole) if whole and abs(rate / whole - 1) < ROUND_RATE else float(f"{rate:.6g}")
    if nominal is not None and abs(rate / nominal - 1) < SOUND_INTERVAL:
        rate = nominal
    says = f"times in {unit}, {rate:g} frames/s"
    if fps is not None and abs(rate / fps - 1) > SAME_RATE:
        scale = rate / fps
        return StampClock(unit, seconds * scale, fps, f"{says} as played, filmed at {fps:g}: times {scale:.4g}")
    return StampClock(unit, seconds, fps or rate, says)


def _likely(steps: Array, step: float) -> str:
    """The unit that fits the intervals."""
    if are_whole(steps) and step < MAX_FRAMES_APART:
        return "frames"
    if step < MAX_INTERVAL_S:
        return "seconds"
    return "milliseconds" if step < MAX_INTERVAL_S * 1e3 else "microseconds"
