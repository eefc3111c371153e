"""A launcher at a virtual serial port."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from robot.device.launcher import Launcher
from robot.device.link import Link
from robot.device.port import serial_opener
from robot.device.settings import PortSettings, Settings
from robot.emulator.firmware import Firmware
from robot.emulator.launcher import Emulator, Pace
from robot.emulator.line import Line, VirtualClock, WirePort

BAUD = 19200


@dataclass
class Bench:
    """A driver with a launcher at its end; without `device` it is a real one."""

    launcher: Launcher
    link: Link
    log: Path
    device: Firmware | None = None
    emulator: Emulator | None = None
    hits: list[tuple[float, float, float]] | None = None


@contextlib.contextmanager
def virtual(log: Path) -> Iterator[Bench]:
    clock, hits = VirtualClock(), list[tuple[float, float, float]]()
    device = Firmware(clock.now, np.random.default_rng(0), on_strike=lambda *hit: hits.append(hit))
    line = clock.line = Line(device, baud=BAUD)
    ours = Settings()
    link = Link(lambda: WirePort(line, clock), ours.timing, baud=BAUD, clock=clock, log=log)
    with Launcher(ours, link) as launcher:
        yield Bench(launcher, link, log, device, None, hits)


@contextlib.contextmanager
def terminal(log: Path, pace: float = 10.0, reconnect_s: float = 5.0) -> Iterator[Bench]:
    hits = list[tuple[float, float, float]]()
    clock = Pace(pace)
    device = Firmware(clock.now, np.random.default_rng(0), pace=clock.factor, on_strike=lambda *hit: hits.append(hit))
    with Emulator(device, baud=BAUD) as emulator:
        ours = replace(Settings(), port=PortSettings(emulator.path, baud=BAUD))
        ours = replace(ours, timing=replace(ours.timing, reconnect_s=reconnect_s))
        link = Link(serial_opener(ours.port), ours.timing, baud=BAUD, log=log)
        with Launcher(ours, link) as launcher:
            yield Bench(launcher, link, log, device, emulator, hits)


def ready(bench: Bench) -> None:
    bench.launcher.reset()
    bench.launcher.home()
