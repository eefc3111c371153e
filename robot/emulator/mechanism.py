"""The launcher's mechanics as its microcontroller moves them: servo, rack and stage in time, stops, faults and power.

In: a clock, random numbers, and commands. Out: hits of the ball (`on_strike`), bodies of replies, and `actions`, the
record of what was actually done, by which tests judge. It has no thread: each query first advances it to the clock's
time, so that a virtual clock gives the same strokes as a real one, immediately.

Stroke: robot/emulator/stroke_motion.py, with a ripple along the rack, v (1 + A sin(2 pi (s + s_rest) / lambda + phi));
the tip meets the ball at BALL_DISTANCE_M. Stage: robot/emulator/stage.py. Grades of the sizes: A two sources, B one,
C estimate. Left out: the ball's reaction on the rack, lost steps without a stall, and vibration.

While armed or moving it stops on its own SILENCE_S after the last undamaged frame. That time is real time: if the
mechanics run faster, `pace` is the factor.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from models.mjcf.stroke import BRAKING_DECELERATION, CUE_TILT
from robot.device.protocol import (
    FIRST_STRING,
    GUARDED_STATES,
    LAST_STRING,
)
from robot.emulator import stage
from robot.emulator.stroke_motion import BALL_DISTANCE_M, LEVEL_END_M, StrokeMotion, paper_law

SPEED_RIPPLE, TOOTH_PITCH_M = 0.01, 0.002 * math.pi  # ripple over the speed [1]; pitch of a module 2 rack [m]; C
SPEED_SCATTER = 0.0125  # sd from stroke to stroke over the speed [1]; from +-50 mm by emulator/repeatability.py, B
REST_SD_M = 0.0005  # sd of the rack after a retract; C
ENCODER_SPEED_SD = 0.001  # sd of the measured speed over it [1]: 5.9 micrometre a count over 5 mm; C
RETRACT_SPEED = 0.25  # [m/s]; C
FORCE_PER_SPEED = 313.0  # peak force on the tip over the cue speed [N s/m]: 860 N at 2.75 m/s in launcher.md; B
MAX_SENSOR_FORCE, SENSOR_SD = 440.0, 0.03  # FlexiForce A201-100: 100 lb, 3 %, from memory of its sheet; C
ARMED_TIMEOUT_S = 5.0  # time until an unused arming lapses
BOOT_TIME_S = 0.3  # duration of a restart, without reading; C


@dataclass(frozen=True)
class ExecutedAction:
    """An action that the launcher actually executed."""

    time: float  # by its clock [s]
    what: str  # homed, moved, begun, struck, retracted, stopped, silenced, reset, booted, stuck, refused
    string: int = 0
    number: int = 0  # of the stroke
    speed: float = 0.0  # of the cue at the ball [m/s]
    x: float = 0.0  # of the tip [m]; for struck, the side offset from the ball's centre
    y: float = 0.0


@dataclass
class Memory:
    """Persistent memory: 22 bytes of the PIC18F458's EEPROM."""

    boots: int = 0
    stops: int = 0
    begun: int = 0
    done: int = 0
    string: int = 0
    speed: float = 0.0
    force: float = 0.0
    stopped: bool = False
    interrupted: str = ""  # state that the stop interrupted
    silent: bool = False  # whether it stopped because of silence


class Mechanism:
    """The mechanics of an emulated launcher, and its memory."""

    def __init__(
        self,
        now: Callable[[], float],
        rng: np.random.Generator,
        *,
        on_strike: Callable[[float, float, float], None] | None = None,
        law: Callable[[int], float] = paper_law,
        ripple: float = SPEED_RIPPLE,
        backlash: tuple[float, float] = stage.BACKLASH_UM,
        pace: Callable[[], float] = lambda: 1.0,
    ) -> None:
        """Switch it on.

        Args:
            now: its clock [s].
            rng: for all random numbers.
            on_strike: called with cue speed [m/s], side and height [m] of the axis when the tip meets the ball.
            law: true cue speed of a string [m/s], which a calibration has to find.
            ripple: relative ripple of the speed along the rack.
            backlash: of the stage in x and y [micrometre].
            pace: seconds of its clock per second of real time.
        """
        self._now, self._rng, self._on_strike, self._law = now, rng, on_strike, law
        self._ripple, self._pace = ripple, pace
        self._phase = rng.uniform(0, 2 * math.pi)
        self.memory = Memory()
        self.actions: list[ExecutedAction] = []
        self._events: list[tuple[float, Callable[[], None], bool]] = []  # time, action, whether it survives a stop
        self._time = now()  # time of the current event
        self._stage = stage.EmulatedStage(backlash)
        self._stuck = False
        self._armed = self._refused = self._faults = 0
        self._heard = self._deaf_until = self._silent_at = self._time
        self.state = "UNHOMED"
        self._rack, self._rest = 0.0, 0.0  # [m]
        self._boot()

    def update(self) -> None:
        """Advance to the clock's time."""
        now = self._now()
        while (self._events and self._events[0][0] <= now) or self._silent_by(now):
            if self._silent_by(self._events[0][0] if self._events else now):
                self._time = self._silent_at
                self._fall_silent()
            else:
                self._time, event, _ = self._events.pop(0)
                event()
        self._time = now

    def _silent_by(self, then: float) -> bool:
        """Whether its controller counts as absent at a time."""
        return self.state in GUARDED_STATES and self._silent_at <= then

    def tip(self) -> tuple[float, float]:
        """True position of the cue's axis, side and height [m] relative to home, across the cue."""
        return self._stage.tip[0] * 1e-6, self._stage.tip[1] * 1e-6 * math.cos(CUE_TILT)

    def restart(self, after: float = 0.0) -> None:
        """Interrupt the power briefly, `after` seconds from now."""
        self._at(self._now() + after, self._lose_power, lasting=True)

    def stick(self) -> None:
        """Make the next motion of the stage stall; a reset frees it."""
        self._stuck = True

    def _home(self) -> str:
        self.state = "MOVING"
        back = self._time + self._rack / RETRACT_SPEED
        self._travel((0.0, 0.0), back, "homed", extra=0.5)
        return "OK"

    def _move(self, x: int, y: int) -> str:
        if self.state != "IDLE":
            return f"NO {self.state}"
        if max(abs(x), abs(y)) > stage.RANGE_UM:
            return "NO RANGE"
        self.state = "MOVING"
        steps = round(x / stage.STEP_UM), round(y / stage.STEP_UM)
        self._travel((steps[0] * stage.STEP_UM, steps[1] * stage.STEP_UM), self._time, "moved")
        return "OK"

    def _arm(self, string: int, number: int) -> str:
        if self.state != "IDLE":
            return f"NO {self.state}"
        if not FIRST_STRING <= string <= LAST_STRING:
            return "NO RANGE"
        if number != self.memory.begun + 1:
            return "NO NUMBER"
        self.state, self._armed = "ARMED", string
        self._at(self._time + ARMED_TIMEOUT_S, self._lapse(number))
        return "OK"

    def _lapse(self, number: int) -> Callable[[], None]:
        def lapse() -> None:
            if self.state == "ARMED" and self.memory.begun + 1 == number:
                self.state, self._armed = "IDLE", 0

        return lapse

    def _stroke(self, string: int) -> None:
        if self.state != "ARMED" or self._armed != string:
            self._refused += 1
            self._note("refused", string=string)
            return
        self._cancel()
        self._armed, self.state = 0, "STRIKING"
        self.memory.begun += 1  # before the first pulse: the number is used even if power fails now
        self._note("begun", string=string, number=self.memory.begun)
        scattered = self._law(string) * (1 + SPEED_SCATTER * self._rng.standard_normal())
        self._motion = StrokeMotion(self._time, scattered, string)
        self._at(self._motion.at(BALL_DISTANCE_M), lambda: self._hit(scattered))
        end = self._motion.at(LEVEL_END_M) + scattered / BRAKING_DECELERATION
        self._at(end, self._finish)

    def _hit(self, speed: float) -> None:
        """The tip meets the ball at this speed, apart from the ripple [m/s]."""
        run, along = self._motion, (BALL_DISTANCE_M + self._rest) / TOOTH_PITCH_M
        true = speed * (1 + self._ripple * math.sin(2 * math.pi * along + self._phase))
        side, height = self.tip()
        self._measured = true * (1 + ENCODER_SPEED_SD * self._rng.standard_normal())
        self._peak = min(FORCE_PER_SPEED * true * (1 + SENSOR_SD * self._rng.standard_normal()), MAX_SENSOR_FORCE)
        self._note("struck", string=run.string, number=self.memory.begun, speed=true, x=side, y=height)
        if self._on_strike is not None:
            self._on_strike(true, side, height)

    def _finish(self) -> None:
        run, m = self._motion, self.memory
        self.state = "EXTENDED"
        self._rack = LEVEL_END_M + 0.5 * run.speed**2 / BRAKING_DECELERATION
        m.done, m.string, m.speed, m.force = m.begun, run.string, self._measured, self._peak

    def _retract(self) -> str:
        if self.state == "EXTENDED":
            self.state = "RETRACTING"
            self._at(self._time + self._rack / RETRACT_SPEED, self._retracted)
        return "NO UNHOMED" if self.state == "UNHOMED" else "OK"

    def _retracted(self) -> None:
        self.state, self._rack, self._rest = "IDLE", 0.0, REST_SD_M * self._rng.standard_normal()
        self._note("retracted")

    def _travel(self, target: tuple[float, float], start: float, what: str, extra: float = 0.0) -> None:
        """Move the stage to a target [micrometre], both axes at once."""
        needs = self._stage.travel(target, start)
        self._at(start + needs + extra, lambda: self._arrived(what))

    def _arrived(self, what: str) -> None:
        if self._stuck:
            self._stall()
            return
        self._stage.arrive(home=what == "homed")
        if what == "homed":
            self._rack = self._rest = 0.0
            self._faults = 0
        self.state = "IDLE"
        x, y = self._stage.tip
        self._note(what, x=x * 1e-6, y=y * 1e-6)

    def _stall(self) -> None:
        """The drive reports a stall during a motion (an assumption: a simple stepper would notice only at home)."""
        self._stage.stall(self._rng.uniform(0, 1))
        self.state, self._faults = "FAULT", self._faults | 1
        self._note("stuck")

    def _stop(self, what: str) -> None:
        self._cease()
        self.memory.stops += 1
        self.memory.interrupted = self.memory.interrupted or self.state
        self.memory.stopped, self.state, self._armed = True, "STOPPED", 0
        self._note(what)

    def _fall_silent(self) -> None:
        """Stop after too long a silence."""
        self.memory.silent = True
        self._stop("silenced")

    def _cease(self) -> None:
        """End all pulses: the stage stops, the rack brakes and may still touch the ball."""
        self._cancel()
        now = self._time
        if self.state == "STRIKING":
            travelled, speed = self._motion.state(now)
            at_ball = speed**2 - 2 * BRAKING_DECELERATION * (BALL_DISTANCE_M - travelled)  # speed squared at the ball
            self._rack = travelled + 0.5 * speed**2 / BRAKING_DECELERATION
            if travelled < BALL_DISTANCE_M and at_ball > 0:
                slower = math.sqrt(at_ball)
                self._at(now + (speed - slower) / BRAKING_DECELERATION, lambda: self._hit(slower), lasting=True)
        elif self.state == "MOVING":
            self._stage.halt(now)

    def _lose_power(self) -> None:
        interrupted = self.state == "STRIKING"
        self._cease()
        self._boot()
        self._faults |= 4 * interrupted

    def _boot(self) -> None:
        self.memory.boots += 1
        self._armed = self._refused = self._faults = 0
        self._heard = self._time
        self._deaf_until = self._heard + BOOT_TIME_S if self.memory.boots > 1 else self._heard
        self.state = "STOPPED" if self.memory.stopped else "UNHOMED"
        self._note("booted")

    def _at(self, time: float, event: Callable[[], None], *, lasting: bool = False) -> None:
        self._events.append((time, event, lasting))
        self._events.sort(key=lambda e: e[0])

    def _cancel(self) -> None:
        """Cancel pending events, except those that no command can prevent."""
        self._events = [e for e in self._events if e[2]]

    def _note(self, what: str, **facts: float) -> None:
        self.actions.append(dataclasses.replace(ExecutedAction(self._time, what), **facts))  # type: ignore[arg-type]
