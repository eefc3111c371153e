"""The driver of a launcher that accepts only the paper's 'NNNp'.

In: settings with `protocol = "paper"`. Out: a `Launcher` whose strokes are written to the port, while all other
commands are left to the person at the table. `PAPER_LIMITS` states what cannot be guaranteed: such a launcher is not
armed, does not react to a stop or to a silent controller, and reports nothing.

A stroke is written once, and the driver waits for its duration by the calibration. Only the camera shows whether it was
made. Assumed: the cue retracts by itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from models.errors import BadInput
from robot.device.exchange_log import ExchangeLog
from robot.device.launcher import Launcher
from robot.device.outcome import Did, Done, Stopped, StrokeUnknown
from robot.device.port import PORT_ERRORS, Port, PortHeld
from robot.device.protocol import LauncherStatus, string_number, stroke_line
from robot.device.settings import Clock, RealClock, Settings

PAPER_LIMITS = (
    "this launcher accepts only 'NNNp': no arming guards its strokes, neither robot stop nor a silent controller stops "
    "it, and it reports nothing; keep a hand on the switch of its supply"
)
STROKE_PATH_M, STROKE_EXTRA_S = 0.5, 1.0  # path of a stroke and back at its speed, and its run-up: a generous estimate


class PaperLauncher(Launcher):
    """A launcher at a port that accepts strokes only."""

    def __init__(
        self,
        settings: Settings,
        open_port: Callable[[], Port],
        *,
        clock: Clock | None = None,
        log: Path | str | None = None,
        say: Callable[[str], None] = print,
    ) -> None:
        """Not connected yet."""
        super().__init__(settings, None, dry_run=True, say=say)
        self.dry_run = False
        self._open_port, self._clock = open_port, clock or RealClock()
        self._port: Port | None = None
        self._log = ExchangeLog(log, self._clock, lambda kind, detail: say(f"{kind}: {detail}"))
        self._tip_um, self._strokes = (0, 0), 0

    def __enter__(self) -> PaperLauncher:
        """Open the port, and warn about what cannot be guaranteed."""
        self.connect()
        return self

    def __exit__(self, *why: object) -> None:
        """Close the port; this launcher cannot be stopped."""
        if self._port is not None:
            self._port.close()
            self._port = None
        self._log.close()
        if isinstance(why[1], BaseException) and self._strokes:
            why[1].add_note("this launcher does not react to a stop: cut its supply if it moves")

    def connect(self) -> Did:
        """Open the port if it is closed, and warn about what cannot be guaranteed."""
        if self._port is None:
            try:
                self._port = self._open_port()
            except PortHeld as error:
                raise BadInput(f"the port cannot be opened: {error}") from None
            except (*PORT_ERRORS, ValueError) as error:
                raise BadInput(f"the port cannot be opened ({error}); plug the cable in, or correct [port]") from None
            self._log.open()
            self._say(PAPER_LIMITS)
        return self._made_by_hand("connected")

    def status(self) -> Did:
        """The last known status."""
        return self._made_by_hand("asked")

    def force(self) -> tuple[float, float]:
        """Not reported."""
        return math.nan, math.nan

    def home(self) -> Did:
        """Raise BadInput: homing is left to the person."""
        raise BadInput("this launcher accepts only 'NNNp' and cannot be homed from here; home it at the launcher")

    def reset(self) -> Did:
        """Raise BadInput: this launcher has no stopped state."""
        raise BadInput("this launcher accepts only 'NNNp' and has no reset; switch it off and on")

    def move_tip(self, x0_mm: float, y0_mm: float) -> Did:
        """Ask the person to place the tip."""
        self._tip_um = self.settings.stage_um(x0_mm, y0_mm)
        placed = self._made_by_hand("moved")
        self._say(
            f"set the tip to {placed.x0_mm:+.2f}, {placed.y0_mm:+.2f} mm by hand: this launcher accepts only 'NNNp'"
        )
        return placed

    def strike(self, string: str | int) -> Done:
        """Write 'NNNp', once, and wait for the duration of a stroke; it is unknown whether it was made."""
        n = string_number(string)
        speed = self.settings.check_speed(n)
        if self._port is None:
            raise BadInput("the launcher is not connected; connect it first")
        began, self._strokes = self._clock.now(), self._strokes + 1
        try:
            self._port.write(stroke_line(n))
        except PORT_ERRORS as error:
            raise StrokeUnknown(f"{n:03d}p may have been sent: {error}; look at the table") from error
        self._log.write("stroke", began, sent=f"{n:03d}p", error="")
        self._clock.sleep(STROKE_PATH_M / speed + STROKE_EXTRA_S)
        by_hand = self._made_by_hand("struck")
        return Done(
            f"{n:03d}p", self._strokes, speed, math.nan, math.nan, by_hand.x0_mm, by_hand.y0_mm, began,
            self._clock.now() - began, 0, ("not confirmed: this launcher accepts only 'NNNp' and reports nothing",),
        )  # fmt: skip

    def retract(self) -> Did:
        """Do nothing: the cue retracts by itself."""
        return self._made_by_hand("retracted")

    def stop(self) -> Stopped:
        """Do nothing: no command stops this launcher."""
        return Stopped(False, 0, 0.0)

    def _made_by_hand(self, what: str) -> Did:
        x, y = self._tip_um
        status = replace(LauncherStatus(state="IDLE"), x_um=x, y_um=y)
        return Did(what, status, *self.settings.tip_mm(x, y), 0.0, 0, ())
