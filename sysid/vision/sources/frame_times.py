"""From time stamps to times: frames are put on an even rate or used as they are, then scaled.

In: what a container or a file says of its frames, and the rate at which they were taken, where that is known. Out:
`FrameTimes`, with notes for the user.
"""

from __future__ import annotations

from dataclasses import dataclass

RATE_TOLERANCE = 0.003  # relative difference from the rate given by the user that needs no note
GAP_PERIODS = 1.75  # time between two frames from which on frames are missing


@dataclass(frozen=True)
class FrameTimes:
    """How time stamps become times: put on an even rate or used as they are, then scaled."""

    period: float  # between frames, by the stamps [s]
    even: bool  # whether frames keep to that period
    time_scale: float  # seconds of the scene per second of the stamps
    notes: tuple[str, ...]  # for the user

    def steps(self, before: float, now: float) -> int:
        """Periods between two stamps [s], at least one."""
        periods = (now - before) / self.period
        return max(1, round(periods)) if self.even or periods >= GAP_PERIODS else 1


def retimed(frame_times: FrameTimes, fps: float | None) -> FrameTimes:
    """The times of frames that were taken at another rate than their stamps give."""
    if fps is None:
        return frame_times
    scale = 1.0 / (fps * frame_times.period)
    effect = f"{1 / scale:.6g} times slower" if scale < 1 else f"{scale:.6g} times faster"
    notes = f"taken at {fps:.6g}/s as given: the container, with {1 / frame_times.period:.6g}/s, shows it {effect}"
    return FrameTimes(
        frame_times.period,
        frame_times.even,
        scale,
        (*frame_times.notes, notes) if abs(scale - 1) > RATE_TOLERANCE else frame_times.notes,
    )
