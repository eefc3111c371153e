"""A launcher on a bad line, its clock virtual, and a tally of what became of its commands."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np

from models.errors import BadInput
from robot.device.launcher import Launcher
from robot.device.link import Link
from robot.device.outcome import Did, Done, StrokeUnknown
from robot.device.protocol import LauncherError
from robot.device.settings import Settings
from robot.emulator.faults import FAULT_KINDS, Fault, FaultInjection
from robot.emulator.firmware import Firmware
from robot.emulator.line import Line, VirtualClock, WirePort
from robot.emulator.mechanism import ExecutedAction

BAUD = 19200


@dataclass
class Tally:
    """What became of the commands of a run."""

    exchanges: int = 0
    strokes: int = 0
    commands: int = 0
    given_up: int = 0  # reported as not done
    unknown: int = 0  # strokes reported as not known
    lost: list[str] = field(default_factory=list)  # reported as done, but not done
    doubled: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)  # done otherwise than reported
    denied: list[str] = field(default_factory=list)  # done, but reported as not done
    silent: list[Fault] = field(default_factory=list)  # faults that nobody told of
    faults: Counter[str] = field(default_factory=Counter)

    def failures(self) -> list[object]:
        return [*self.lost, *self.doubled, *self.wrong, *self.denied, *self.silent]


class Bench:
    """A launcher on a virtual line, and what it truly did."""

    def __init__(self, rate: float, seed: int, kinds: tuple[str, ...] = FAULT_KINDS) -> None:
        rng = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3)]
        self.clock, self.rng = VirtualClock(), rng[2]
        self.device = Firmware(self.clock.now, rng[0])
        self.faults = FaultInjection(rate, rng[1], kinds)
        self.line = self.clock.line = Line(self.device, baud=BAUD, faults=self.faults)
        timing = replace(Settings().timing, poll_s=0.1)  # more strokes an exchange
        self.settings = replace(Settings(), timing=timing)
        self.link = Link(lambda: WirePort(self.line, self.clock), self.settings.timing, baud=BAUD, clock=self.clock)
        self.launcher = Launcher(self.settings, self.link)
        self.tally = Tally()
        self.told: list[float] = []  # times of errors that were raised

    def recover(self) -> None:
        """What an operator does after an error: look, reset, home, until it stands ready."""
        for _ in range(30):
            try:
                self.launcher.connect()
                self.launcher.reset()
                self.launcher.home()
            except (LauncherError, BadInput):  # the latter while the cable is out
                self.told.append(self.clock.now())
                self.clock.sleep(1.0)
            else:
                return
        raise RuntimeError("the launcher does not come back")

    def actions(self, since: int, *what: str) -> list[ExecutedAction]:
        self.device.update()
        return [d for d in self.device.actions[since:] if d.what in what]

    def command(self, verb: str, *values: object) -> None:
        """One command, judged by what the launcher truly did."""
        self.device.update()
        since, name, tally = len(self.device.actions), f"{verb} {values} at {self.clock.now():.2f} s", self.tally
        tally.commands += 1
        result: Done | Did | None = None
        error: LauncherError | None = None
        try:
            result = getattr(self.launcher, verb)(*values)
        except LauncherError as raised:
            error = raised
            self.told.append(self.clock.now())
            self.clock.sleep(10.0)  # whatever may still come, comes
        struck = self.actions(since, "struck")
        if len(struck) > (verb == "strike"):
            tally.doubled.append(name)
        if isinstance(result, Done):
            self._judge(result, struck, name)
        elif verb == "move_tip" and result is not None and isinstance(result, Did):
            x, y = self.device.tip()
            if max(abs(1e3 * x - float(str(values[0]))), abs(1e3 * y - float(str(values[1])))) > 0.011:
                tally.wrong.append(name)
        elif verb == "retract" and result is not None and not self.actions(since, "retracted"):
            tally.lost.append(name)
        if isinstance(error, StrokeUnknown):
            tally.unknown += 1
            if any(d.string != int(str(values[0])) for d in struck):
                tally.wrong.append(name)
        elif error is not None:
            tally.given_up += 1
            if struck:
                tally.denied.append(name)
        if error is not None:
            self.recover()

    def _judge(self, done: Done, struck: list[ExecutedAction], name: str) -> None:
        self.tally.strokes += 1
        if not struck:
            self.tally.lost.append(name)
            return
        action = struck[0]
        same = (f"{action.string:03d}p", action.number) == (done.string, done.number) and name.startswith("strike")
        near = abs(done.cue_speed / action.speed - 1) < 0.006 and abs(done.x0_mm - 1e3 * action.x) < 0.011
        if not (same and near and abs(done.y0_mm - 1e3 * action.y) < 0.011):
            self.tally.wrong.append(name)

    def cycle(self) -> None:
        """A shot: place the tip, strike, retract; what fails is not repeated."""
        r, angle = 13 * np.sqrt(self.rng.random()), 2 * np.pi * self.rng.random()
        self.command("move_tip", round(float(r * np.cos(angle)), 2), round(float(r * np.sin(angle)), 2))
        strokes = self.tally.strokes
        if self.device.status().state == "IDLE":
            self.command("strike", int(self.rng.integers(1, 201)))
        if self.tally.strokes > strokes:
            self.command("retract")

    def last_look(self) -> None:
        """What comes after the last command is seen on a line that is good again."""
        self.line.faults = None
        self.clock.sleep(1.0)
        self.recover()

    def account(self) -> Tally:
        """The tally, with the faults of which nobody told within the next 3 s that the line was in use."""
        times = np.sort([*(i.time for i in self.link.incidents), *self.told])
        for fault in self.faults.done:
            self.tally.faults[fault.kind] += 1
            later = times[np.searchsorted(times, fault.time - 1e-9) :]
            if fault.kind != "stuck" and not (len(later) and later[0] - fault.time < 3):
                self.tally.silent.append(fault)
        stalls = self.actions(0, "stuck")
        noticed = [any(0 <= t - d.time < 3 for t in self.told) for d in stalls]
        if not all(noticed):
            self.tally.silent.append(Fault(0.0, "stuck", b""))
        self.tally.exchanges = self.link.exchanges
        return self.tally


def campaign(exchanges: int, rate: float, seed: int) -> Tally:
    """Shot after shot on a bad line."""
    bench = Bench(rate, seed)
    bench.recover()
    while bench.link.exchanges < exchanges:
        bench.cycle()
    bench.last_look()
    return bench.account()
