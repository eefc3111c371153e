"""Results of exchanges and of the launcher's commands, and errors that state what was not done.

In: nothing. Out: return values of robot/device/link.py and launcher.py, and exceptions of the latter.
"""

from __future__ import annotations

from dataclasses import dataclass

from robot.device.protocol import LauncherError, LauncherStatus


class Refused(LauncherError):
    """The launcher refused and did nothing."""


class LauncherFault(LauncherError):
    """The launcher reports a fault; reset it and home it."""


class NotStruck(LauncherError):
    """The stroke was certainly not made: the launcher reports it, and is disarmed."""


class StrokeUnknown(LauncherError):
    """It is unknown whether, or how, the ball was struck. Inspect the table before any further stroke."""


@dataclass(frozen=True)
class Incident:
    """An unusual event on the line."""

    time: float  # by the link's clock [s]
    kind: str  # silence, lost, junk, stale, slow, cable, stop, stopped, log, or one of launcher.py and requests.py
    detail: str


@dataclass(frozen=True)
class Reply:
    """The reply to a request."""

    body: str
    retries: int
    seconds: float


@dataclass(frozen=True)
class Stopped:
    """The result of a stop."""

    confirmed: bool  # the launcher has answered that it stopped
    bytes_sent: int
    seconds: float  # until that answer, or the last attempt
    interrupted: str = ""  # state that was interrupted, if the launcher reported it


@dataclass(frozen=True)
class Did:
    """The result of a motion or a query."""

    what: str
    status: LauncherStatus
    x0_mm: float  # of the cue's axis from the ball's centre, by the stage's steps
    y0_mm: float
    seconds: float
    retries: int  # lines sent again
    noted: tuple[str, ...]  # unusual events
    dry: bool = False


@dataclass(frozen=True)
class Done:
    """The result of a stroke."""

    string: str
    number: int  # of the stroke, as the launcher counts
    asked_speed: float  # of the cue, by the calibration [m/s]
    cue_speed: float  # measured by the launcher [m/s]; nan in a dry run
    peak_force: float  # measured [N]; nan in a dry run
    x0_mm: float  # of the cue's axis from the ball's centre, by the stage's steps
    y0_mm: float
    began: float  # of the link's clock [s]
    seconds: float
    retries: int  # lines sent again
    noted: tuple[str, ...]  # unusual events
    dry: bool = False
