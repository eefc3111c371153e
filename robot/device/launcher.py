"""The driver of the launcher: its commands return what was actually done.

In: settings, an open link, and the requested strokes and moves. Out: `Did` and `Done`, or an error that states what
was not done (robot/device/outcome.py).

A stroke takes four steps: query the status, arm the string with the next stroke's number, send 'NNNp', and query until
the launcher is extended. After an 'NNNp' without effect the launcher is still armed and reports so, and 'NNNp' is sent
again: the number makes it act at most once. If the line fails after 'NNNp', the result cannot be known and
StrokeUnknown is raised; nothing is sent again then. Retract before the next stroke.

The stage has backlash, so it always approaches its target from below, via a point `takeup_mm` below it if necessary.
The yaw is set by hand; `Settings.check_yaw` checks the range of the stand. Left out: the motion of the ball.
"""

from __future__ import annotations

import dataclasses

from robot.device.outcome import Did, Done, NotStruck, StrokeUnknown
from robot.device.protocol import (
    PROTOCOL_VERSION,
    UNGUARDED_VERSION,
    LauncherError,
    LauncherStatus,
    LauncherStopped,
    LinkLost,
    string_number,
)
from robot.device.requests import PendingCommand, Requests

MAX_ARMINGS = 3  # attempts at a stroke whose arming lapses before the stroke line arrives
STOP_ARRIVAL_S = 1.0  # longest time for a stop to arrive


class Launcher(Requests):
    """A launcher at the end of a link; `with` opens the link, and stops the launcher after an exception."""

    def __enter__(self) -> Launcher:
        """Open the link and connect."""
        if not self.dry_run:
            self._line.__enter__()
            try:
                self.connect()
            except BaseException as error:
                self._line.__exit__(type(error), error, error.__traceback__)
                raise
        return self

    def __exit__(self, *why: object) -> None:
        """Close the link; after an exception, stop first."""
        if not self.dry_run:
            self._line.__exit__(*why)  # type: ignore[arg-type]

    def connect(self) -> Did:
        """Open the link if it is closed, greet, and query the status."""
        job = self._job()
        if not self.dry_run:
            self._line.open()
            got = self._line.greet()
            job.retries += got.retries
            if got.body == f"OK {UNGUARDED_VERSION}":
                raise LauncherError(
                    f"the launcher speaks {UNGUARDED_VERSION} and does not stop if its controller becomes silent; "
                    f"load firmware that speaks {PROTOCOL_VERSION}"
                )
            if got.body != f"OK {PROTOCOL_VERSION}":
                raise LauncherError(f"the other end reports {got.body!r}; this driver speaks {PROTOCOL_VERSION}")
        return self._did(job, "connected", self._ask(job, through_stop=True))

    def status(self) -> Did:
        """Query the launcher's status; also while it is stopped."""
        job = self._job()
        return self._did(job, "asked", self._ask(job, through_stop=True))

    def force(self) -> tuple[float, float]:
        """Force on the tip now, and its peak in the last stroke [N]."""
        if self.dry_run:
            self._command(self._job(), "FORCE")
            return float("nan"), float("nan")
        words = self._line.exchange("FORCE", through_stop=True).body.split(" ")
        if len(words) != 3 or words[0] != "OK" or not (words[1] + words[2]).lstrip("-").isdigit():
            raise LauncherError(f"the launcher reports {' '.join(words)!r} for its force; check its firmware version")
        return 1e-3 * int(words[1]), 1e-3 * int(words[2])

    def home(self) -> Did:
        """Move rack and stage to their switches, which makes their positions known."""
        job = self._job()
        self._taken_up = False
        self._doing("homing")
        self._command(job, "HOME")
        status = self._settle(job, "homing")
        if status.state != "IDLE" or status.x_um or status.y_um:
            raise LauncherError(f"homing ended {status.state} at {status.x_um}, {status.y_um} um; home it again")
        self._taken_up = True
        return self._did(job, "homed", status)

    def move_tip(self, x0_mm: float, y0_mm: float) -> Did:
        """Move the cue's axis to (x'0, y'0) relative to the ball's centre, to the right and up [mm].

        Raises:
            BadInput: the tip would slip off, or the stage would leave its range; nothing was sent.
            LauncherError: the position was not reached.
        """
        target = self.settings.stage_um(x0_mm, y0_mm)
        self._doing("a move of the tip")
        job = self._job()
        here = self._ask(job)
        below = round(1e3 * self.settings.stage.takeup_mm)
        via = [t - below * (t < h or not self._taken_up) for t, h in zip(target, (here.x_um, here.y_um), strict=True)]
        self._taken_up = False
        status = here
        for x, y in ([(via[0], via[1])] if tuple(via) != target else []) + [target]:
            self._command(job, f"MOVE {x} {y}")
            if self.dry_run:
                self._dry = dataclasses.replace(self._dry, x_um=x, y_um=y)
            status = self._settle(job, "the move")
            if status.state != "IDLE":
                raise LauncherError(f"the move ended {status.state}; home the launcher again")
            if max(abs(status.x_um - x), abs(status.y_um - y)) > self.settings.stage.step_um:
                raise LauncherError(
                    f"the stage is at {status.x_um}, {status.y_um} um instead of {x}, {y}; home it again"
                )
        self._taken_up = True
        return self._did(job, "moved", status)

    def strike(self, string: str | int) -> Done:
        """Make one stroke with a speed string, '001p' to '200p'.

        Raises:
            BadInput: no such string, or its speed is out of the limits; nothing was sent.
            NotStruck, LauncherStopped, Refused: certainly no stroke was made.
            StrokeUnknown: it may have been made.
        """
        n = string_number(string)
        self.settings.check_speed(n)
        job = self._job()
        number = self._ask(job).begun + 1
        self._doing(f"stroke {number} ({n:03d}p)")
        for _ in range(1 if self.dry_run else MAX_ARMINGS):
            self._command(job, f"ARM {n} {number}")
            if self.dry_run:
                self._say(f"would send {n:03d}p")
                self._dry = dataclasses.replace(self._dry, begun=number, done=number, string=n, state="EXTENDED")
                return self._done(job, n, number, self._dry)
            status = self._release(job, n, number)
            if status is not None:
                return self._done(job, n, number, status)
        raise NotStruck(
            f"stroke {number} ({n:03d}p) was not made: its arming lapsed {MAX_ARMINGS} times; check the line"
        )

    def retract(self) -> Did:
        """Retract the cue after a stroke."""
        job = self._job()
        self._doing("the retract")
        self._command(job, "RETRACT")
        if self.dry_run:
            self._dry = dataclasses.replace(self._dry, state="IDLE")
        status = self._settle(job, "the retract")
        if status.state != "IDLE":
            raise LauncherError(f"the retract ended {status.state}; home the launcher again")
        return self._did(job, "retracted", status)

    def reset(self) -> Did:
        """Leave the stopped state, or a fault; homing is required afterwards. Refused if it was stopped again."""
        job = self._job()
        seen = self._ask(job, through_stop=True)
        self._command(job, f"RESET {seen.stops}", through_stop=True)
        if not self.dry_run:
            self._line.release()
        self._taken_up = False
        return self._did(job, "reset", self._ask(job))

    def _release(self, job: PendingCommand, n: int, number: int) -> LauncherStatus | None:
        """Send 'NNNp' until it takes effect; returns the status, or None if the arming lapsed before."""
        name = f"stroke {number} ({n:03d}p)"
        try:
            for _ in range(self.settings.timing.retries + 1):
                self._line.send_stroke(n)
                status = self._wait(job, ("STRIKING",), name)
                if status.begun >= number:
                    return self._made(name, n, number, status)
                if status.state == "STOPPED":
                    raise LauncherStopped(f"{self._stopped(status)} before {name} began; reset and home")
                if status.state == "IDLE":
                    return None
                if status.state != "ARMED" or status.armed != n:
                    raise NotStruck(f"{name} was not made: the launcher is {status.state}; home it")
                self._line.note("resent", f"{n:03d}p had no effect and is sent again")
                job.retries += 1
            self._command(job, "DISARM")
        except (NotStruck, StrokeUnknown):
            raise
        except LauncherStopped:
            return self._after_stop(job, name, n, number)
        except LauncherError as error:
            raise StrokeUnknown(f"{name} may have been made: {error}; look at the table") from error
        raise NotStruck(f"{name} was not made: no line had an effect; check the cable")

    def _made(self, name: str, n: int, number: int, status: LauncherStatus) -> LauncherStatus:
        """The status if it reports this stroke as complete; StrokeUnknown otherwise."""
        if status.done == number and status.begun == number and status.string == n:
            return status
        why = "; ".join(status.troubles()) or f"the launcher is {status.state} and reports stroke {status.done}"
        if status.state == "STOPPED":
            why = self._stopped(status)
        raise StrokeUnknown(f"{name} was begun, but not ended: {why}; look at the table")

    def _after_stop(self, job: PendingCommand, name: str, n: int, number: int) -> LauncherStatus:
        """The outcome of a stroke that was stopped."""
        until = self._line.clock.now() + STOP_ARRIVAL_S
        try:
            while (status := self._ask(job, through_stop=True)).begun < number and status.state != "STOPPED":
                if self._line.clock.now() > until:
                    raise StrokeUnknown(f"{name}: the stop does not arrive, it may still be made; cut the power")
                self._line.clock.sleep(self.settings.timing.poll_s)
            while status.state == "STRIKING" and self._line.clock.now() < until:
                self._line.clock.sleep(self.settings.timing.poll_s)
                status = self._ask(job, through_stop=True)
        except LinkLost as error:
            raise StrokeUnknown(f"{name} was stopped, and the launcher does not answer; look at the table") from error
        if status.begun < number:
            raise LauncherStopped(f"{self._stopped(status)} before {name} began; reset and home")
        return self._made(name, n, number, status)

    def _did(self, job: PendingCommand, what: str, status: LauncherStatus) -> Did:
        x, y = self.settings.tip_mm(status.x_um, status.y_um)
        seconds, noted = self._noted(job)
        return Did(what, status, x, y, seconds, job.retries, noted, self.dry_run)

    def _done(self, job: PendingCommand, n: int, number: int, status: LauncherStatus) -> Done:
        x, y = self.settings.tip_mm(status.x_um, status.y_um)
        seconds, noted = self._noted(job)
        speed, force = (float("nan"),) * 2 if self.dry_run else (status.cue_speed, status.peak_force)
        asked, string = self.settings.check_speed(n), f"{n:03d}p"
        return Done(
            string, number, asked, speed, force, x, y, job.began, seconds, job.retries, noted, self.dry_run
        )  # fmt: skip
