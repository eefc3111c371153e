"""Times of other programs in seconds, and the frame rate.

In: `RawClip`s, and what is stated of them. Out: a `StampClock`. Small whole numbers count frames; others are in
seconds, or in the parts of one that make some 5 to 10,000 frames a second. A frame rate that is given beside stamps in
seconds is the one at which the film was taken: a film that plays slower than that has its stamps too long.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.errors import BadInput
from models.shot import Array
from sysid.clips.tempo import SOUND_INTERVAL
from sysid.clips.units import SECONDS_BY_UNIT, are_whole
from sysid.foreign.columns import RawClip

TIME_UNITS = ("seconds", "frames", *SECONDS_BY_UNIT)
MAX_FRAMES_APART = 5.0  # usual interval of rows that are counted in frames
MAX_INTERVAL_S = 0.2  # usual interval of rows
ROUND_RATE = 1e-3  # relative departure of a rate from a whole number, within which it is that
SAME_RATE = 0.02  # relative departure of stamps from a rate that is given


@dataclass(frozen=True)
class StampClock:
    """How stamps become seconds."""

    unit: str
    seconds: float  # of one unit
    fps: float
    says: str


def read_clock(clips: Sequence[RawClip], unit: str | None, fps: float | None, nominal: float | None) -> StampClock:
    """The clock of all clips; BadInput where frames are counted and no rate is known.

    Args:
        clips: with their stamps.
        unit: of stamps; None: looked for in them.
        fps: frames taken in a second.
        nominal: the camera's rate as it was stated before, which stamps may contradict.
    """
    stamps = [np.unique(np.concatenate([one.time for one in clip.balls.values()])) for clip in clips]
    steps: Array = np.concatenate([np.diff(t) for t in stamps])
    if not len(steps):
        raise BadInput(f"{clips[0].file}: holds one moment only: name the file of a whole shot")
    step = float(np.median(steps))
    named = {clip.time_unit for clip in clips if clip.time_unit}
    unit = unit or (named.pop() if len(named) == 1 else None) or _likely(steps, step)
    if unit == "frames":
        fps = fps or nominal
        if fps is None:
            raise BadInput(f"{clips[0].file}: times count frames: give the frames taken in a second, --fps F")
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
        return StampClock(unit, seconds * scale, fps, f"{says} as they are played, taken as {fps:g}: times {scale:.4g}")
    return StampClock(unit, seconds, fps or rate, says)


def _likely(steps: Array, step: float) -> str:
    """The unit that intervals speak for."""
    if are_whole(steps) and step < MAX_FRAMES_APART:
        return "frames"
    if step < MAX_INTERVAL_S:
        return "seconds"
    return "milliseconds" if step < MAX_INTERVAL_S * 1e3 else "microseconds"
