"""Requests to a launcher, one at a time: a command is sent, its end awaited, and what the launcher says noted.

In: a link, or none in a dry run, which says what would be sent. Out: the launcher's status after a request; an error
where it refuses one, is stopped, has a fault, or takes too long. What the commands do: launcher.py.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from models.errors import BadInput
from robot.device.link import Link
from robot.device.outcome import LauncherFault, Refused, Stopped
from robot.device.protocol import (
    BUSY_STATES,
    FAULT_BITS,
    SILENCE_BIT,
    LauncherError,
    LauncherStatus,
    LauncherStopped,
    parse_status,
)
from robot.device.settings import Settings

SETTLE_STATES = ("IDLE", "EXTENDED")  # states in which motions end successfully
REFUSAL_REMEDIES = {
    "NO UNHOMED": "home it first",
    "NO EXTENDED": "retract first",
    "NO FAULT": "reset and home it first",
    "NO STOPS": "it was stopped again meanwhile; check the launcher first",
}


@dataclass
class PendingCommand:
    """A command in progress: when it began, what was noted before it, how often a line was sent again."""

    began: float
    incidents: int
    retries: int = 0


class Requests:
    """What one asks of a launcher; with `dry_run` nothing is sent."""

    def __init__(
        self, settings: Settings, link: Link | None, *, dry_run: bool = False, say: Callable[[str], None] = print
    ) -> None:
        """Create a driver; with `dry_run` commands report what they would send, send nothing, and need no link."""
        if link is None and not dry_run:
            raise BadInput("link is None; give an open line to the launcher, or dry_run=True")
        self.settings, self.dry_run = settings, dry_run
        self._link, self._say = link, say
        self._known: LauncherStatus | None = None
        self._taken_up = False  # whether the stage came from below
        self._dry = LauncherStatus(state="IDLE")

    @property
    def _line(self) -> Link:
        if self._link is None:
            raise BadInput("this launcher has no link; only a dry run is possible")
        return self._link

    def stop(self) -> Stopped:
        """Stop everything immediately; may be called from any thread."""
        if self.dry_run:
            self._say("would send !")
            return Stopped(True, 0, 0.0)
        return self._line.stop()

    def _ask(self, job: PendingCommand, through_stop: bool = False) -> LauncherStatus:
        """Query the status, and note reported restarts and noise."""
        if self.dry_run:
            return self._dry
        got = self._line.exchange("STATUS", through_stop=through_stop)
        job.retries += got.retries
        status, before = parse_status(got.body), self._known
        if status is None:
            raise LauncherError(f"the launcher reports {got.body!r} for its status; check its firmware version")
        self._known = status
        if before is not None and status.boots != before.boots:
            self._taken_up = False
            self._line.note("restart", f"the launcher has restarted {status.boots - before.boots} times")
        elif before is not None:
            for name in ("dropped", "refused", "stops"):
                more = getattr(status, name) - getattr(before, name)
                if more:
                    self._line.note(name, f"the launcher counted {more} further {name}")
        return status

    def _command(self, job: PendingCommand, body: str, through_stop: bool = False) -> None:
        """Send a command; raises Refused, LauncherStopped or LauncherFault if the launcher refuses it."""
        if self.dry_run:
            self._say(f"would send {body}")
            return
        got = self._line.exchange(body, through_stop=through_stop)
        job.retries += got.retries
        if got.body == "OK":
            return
        if got.body == "NO STOPPED":
            raise LauncherStopped(f"{self._stopped(self._ask(job, through_stop=True))}; reset and home it first")
        kind = LauncherFault if got.body == "NO FAULT" else Refused
        raise kind(
            f"the launcher refused {body!r} ({got.body}); {REFUSAL_REMEDIES.get(got.body, 'ask for its status')}"
        )

    def _settle(self, job: PendingCommand, what: str) -> LauncherStatus:
        """Wait until a motion has ended; raises LauncherStopped or LauncherFault if it failed."""
        status = self._wait(job, BUSY_STATES, what)
        if status.state == "STOPPED":
            raise LauncherStopped(f"{self._stopped(status)} during {what}; reset and home")
        if status.state == "FAULT":
            raise LauncherFault(f"{what} failed: {'; '.join(status.troubles()) or 'no reason given'}; reset and home")
        if status.state not in SETTLE_STATES:
            raise LauncherError(f"{what} was interrupted: the launcher is {status.state}; home it")
        return status

    def _wait(self, job: PendingCommand, states: tuple[str, ...], what: str) -> LauncherStatus:
        """Query until the launcher has left these states."""
        timing = self.settings.timing
        until = 0.0 if self.dry_run else self._line.clock.now() + timing.motion_s
        while (status := self._ask(job)).state in states:
            if self._line.clock.now() > until:
                self.stop()
                raise LauncherStopped(f"{what} took more than {timing.motion_s} s and was stopped; look, reset, home")
            self._line.clock.sleep(timing.poll_s)
        return status

    def _stopped(self, status: LauncherStatus) -> str:
        """The cause of a stop, in words."""
        if status.faults & SILENCE_BIT:
            return f"the launcher {FAULT_BITS[SILENCE_BIT]}"
        by = self._line.elsewhere.stopped_by()
        return f"the launcher was stopped by {by}" if by else "the launcher was stopped"

    def _doing(self, what: str) -> None:
        """Set the command in progress, for questions of other programs."""
        if not self.dry_run:
            self._line.elsewhere.doing = what

    def _job(self) -> PendingCommand:
        return (
            PendingCommand(0.0, 0)
            if self.dry_run
            else PendingCommand(self._line.clock.now(), len(self._line.incidents))
        )

    def _noted(self, job: PendingCommand) -> tuple[float, tuple[str, ...]]:
        if self.dry_run:
            return 0.0, ()
        notes = tuple(f"{i.kind}: {i.detail}" for i in self._line.incidents[job.incidents :])
        return self._line.clock.now() - job.began, notes
