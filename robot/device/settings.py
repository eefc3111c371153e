"""The settings of one launcher, in one TOML file, cuelab-launcher/1: port, time-outs, limits, stage, speed calibration.

In: the file, or defaults. Out: `Settings`, which checks strings, yaw and tip positions against the limits.

The paper gives two points of the law from string to cue speed, '001p' 2.75 m/s and '200p' 0.30 m/s (Robotic Billiards
2015, section V); the line through them is the default table. A launcher's measured table replaces it: strings rising,
cue speeds falling, linear interpolation. Strings outside the table are unknown and never played.

The contact point's offset from the ball's centre is R / (R + r_tip) times that of the cue's axis, where R is the ball's
radius and r_tip that of the tip's dome; the stage moves in the vertical plane, so that the stage's y is
y'0 / cos(tilt). Left out: a drift of the speed with temperature, and a dependence of the speed on the stage's position.
"""

from __future__ import annotations

import dataclasses
import math
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Protocol

import numpy as np
import tomli_w

from models.errors import BadInput
from models.files import read_toml, write_whole
from models.files.decode import Allowed
from models.files.faults import shown
from robot.device.protocol import CUELAB, FIRST_STRING, LAST_STRING, PROTOCOLS

SETTINGS_FORMAT = "cuelab-launcher/1"
PAPER_SOURCE = "the line through the two figures of Robotic Billiards (2015), section V"


@dataclass(frozen=True)
class PortSettings:
    """The launcher's port and protocol."""

    device: str = "/dev/ttyUSB0"
    protocol: str = CUELAB  # or "paper": the paper's 'NNNp' alone (robot/device/paper.py)
    baud: Annotated[int, Allowed(4800, 921600, "bit/s")] = 19200  # the paper states none; beats need this rate

    def __post_init__(self) -> None:
        """Raise BadInput for an invalid name."""
        if not self.device or "\0" in self.device:
            raise BadInput(f"device = {shown(self.device)} is not a port: write the name of one")
        if self.protocol not in PROTOCOLS:
            raise BadInput(f"protocol = {shown(self.protocol)} is unknown: write {' or '.join(map(repr, PROTOCOLS))}")


@dataclass(frozen=True)
class Timing:
    """Time-outs and numbers of retries."""

    reply_s: Annotated[float, Allowed(0.01, 10, "s")] = 0.25  # silence after which a request is sent again
    retries: Annotated[int, Allowed(0, 50, "1")] = 5  # for a request, and for a stroke line
    poll_s: Annotated[float, Allowed(0.001, 0.1, "s")] = 0.02  # between queries of a motion; well within SILENCE_S
    motion_s: Annotated[float, Allowed(0.1, 600, "s")] = 30  # time after which a motion counts as hung
    reconnect_s: Annotated[float, Allowed(0, 600, "s")] = 5  # wait for a disconnected cable


class Clock(Protocol):
    """A clock that can wait; tests use a virtual one."""

    def now(self) -> float: ...  # [s], from any start
    def sleep(self, seconds: float) -> None: ...


class RealClock:
    """The machine's."""

    def now(self) -> float:
        """Monotonic time in seconds."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait."""
        time.sleep(seconds)


@dataclass(frozen=True)
class Limits:
    """Limits of commands."""

    x_mm: Annotated[tuple[float, float], Allowed(-25, 25, "mm", shape=(2,))] = (-20.0, 20.0)  # of the stage from home
    y_mm: Annotated[tuple[float, float], Allowed(-25, 25, "mm", shape=(2,))] = (-20.0, 20.0)
    cue_speed: Annotated[tuple[float, float], Allowed(0.05, 5, "m/s", shape=(2,))] = (0.30, 2.75)
    offset: Annotated[float, Allowed(0, 0.6, "1")] = 0.5  # of the contact over the radius; beyond it the tip slips
    yaw_deg: Annotated[tuple[float, float], Allowed(-180, 180, "deg", shape=(2,))] = (-180.0, 180.0)  # turned by hand

    def __post_init__(self) -> None:
        """Raise BadInput for a range that ends before it begins."""
        for key in ("x_mm", "y_mm", "cue_speed", "yaw_deg"):
            low, high = getattr(self, key)
            if low > high:
                raise BadInput(f"{key} = [{low}, {high}] is not a range: give the smaller number first")


@dataclass(frozen=True)
class Stage:
    """Geometry of the tip and the stage."""

    zero_x_mm: Annotated[float, Allowed(-25, 25, "mm")] = (
        0.0  # stage position at which the axis meets the ball's centre
    )
    zero_y_mm: Annotated[float, Allowed(-25, 25, "mm")] = 0.0
    takeup_mm: Annotated[float, Allowed(0, 5, "mm")] = 0.4  # overshoot below the target: more than the backlash
    step_um: Annotated[float, Allowed(0.1, 1000, "um")] = 10  # requested and reported positions agree within this
    tilt_deg: Annotated[float, Allowed(0, 30, "deg")] = 6.5  # of the cue (Robotic Billiards 2015)
    ball_radius_mm: Annotated[float, Allowed(10, 50, "mm")] = 26.25
    tip_radius_mm: Annotated[float, Allowed(2, 30, "mm")] = 10.0  # of the dome (Robotic Billiards 2015)


@dataclass(frozen=True)
class SpeedTable:
    """Cue speeds of strings: rising strings, falling speeds [m/s]."""

    strings: Annotated[tuple[int, ...], Allowed(shape=(None,))] = (FIRST_STRING, LAST_STRING)
    speeds: Annotated[tuple[float, ...], Allowed(unit="m/s", shape=(None,))] = (2.75, 0.30)
    source: str = ""

    def __post_init__(self) -> None:
        """Raise BadInput for a table that does not fall."""
        n, v = np.array(self.strings, float), np.array(self.speeds, float)
        if n.ndim != 1 or len(n) < 2 or n.shape != v.shape:
            raise BadInput(f"calibration has {n.size} strings and {v.size} speeds; give as many, two or more")
        if not (np.all(np.diff(n) > 0) and n[0] >= FIRST_STRING and n[-1] <= LAST_STRING and np.all(n == np.round(n))):
            raise BadInput(
                f"calibration strings are {list(self.strings)}; "
                f"give rising whole numbers, {FIRST_STRING} to {LAST_STRING}"
            )
        if not (np.all(np.isfinite(v)) and np.all(np.diff(v) < 0) and v[-1] > 0 and v[0] <= 10):
            raise BadInput(
                f"calibration speeds are {list(self.speeds)}; give m/s that fall from string to string, 0 to 10"
            )

    def cue_speed(self, string: int) -> float:
        """Cue speed of a string [m/s]; BadInput outside the table."""
        if not self.strings[0] <= string <= self.strings[-1]:
            raise BadInput(
                f"string {string:03d}p is not calibrated; choose {self.strings[0]:03d}p to {self.strings[-1]:03d}p"
            )
        return float(np.interp(string, self.strings, self.speeds))

    def string(self, cue_speed: float) -> int:
        """The string nearest to a cue speed [m/s]; BadInput outside the table."""
        slack = 1e-9
        if not self.speeds[-1] - slack <= cue_speed <= self.speeds[0] + slack:
            raise BadInput(f"cue speed is {cue_speed} m/s; calibrated are {self.speeds[-1]} to {self.speeds[0]}")
        place = float(np.interp(cue_speed, self.speeds[::-1], self.strings[::-1]))
        around = {max(math.floor(place), self.strings[0]), min(math.ceil(place), self.strings[-1])}
        return min(sorted(around), key=lambda n: abs(self.cue_speed(n) - cue_speed))


@dataclass(frozen=True)
class Settings:
    """Everything about one launcher."""

    port: PortSettings = field(default_factory=PortSettings)
    timing: Timing = field(default_factory=Timing)
    limits: Limits = field(default_factory=Limits)
    stage: Stage = field(default_factory=Stage)
    calibration: Annotated[SpeedTable, Allowed(needs=("strings", "speeds"))] = SpeedTable(source=PAPER_SOURCE)

    def check_speed(self, string: int) -> float:
        """Cue speed of a string [m/s]; BadInput if it is not calibrated, or beyond the limits."""
        speed, (low, high) = self.calibration.cue_speed(string), self.limits.cue_speed
        if not low - 1e-9 <= speed <= high + 1e-9:
            raise BadInput(f"string {string:03d}p gives a cue speed of {speed:.4g} m/s; the limits are {low} to {high}")
        return speed

    def check_yaw(self, theta_deg: float) -> float:
        """The azimuth within -180 to 180 [deg], if the stand can be turned to it by hand; BadInput otherwise."""
        low, high = self.limits.yaw_deg
        turned = math.remainder(theta_deg, 360.0) if math.isfinite(theta_deg) else math.nan
        if not low <= turned <= high:
            raise BadInput(f"yaw is {theta_deg} degrees; the stand's range is {low} to {high}")
        return turned

    def stage_um(self, x0_mm: float, y0_mm: float) -> tuple[int, int]:
        """Stage position (x, y) [micrometre] for the cue's axis at (x'0, y'0) [mm] from the ball's centre.

        Raises:
            BadInput: the tip would slip off the ball, or the stage would leave its range.
        """
        stage, limits = self.stage, self.limits
        contact = math.hypot(x0_mm, y0_mm) / (stage.ball_radius_mm + stage.tip_radius_mm)
        if not contact <= limits.offset + 1e-9:
            raise BadInput(
                f"tip at x0 {x0_mm} mm, y0 {y0_mm} mm meets the ball at {contact:.3f} of its radius; "
                f"stay within {limits.offset}"
            )
        x = stage.zero_x_mm + x0_mm
        y = stage.zero_y_mm + y0_mm / math.cos(math.radians(stage.tilt_deg))
        for name, value, (low, high) in (("x", x, limits.x_mm), ("y", y, limits.y_mm)):
            if not low <= value <= high:
                raise BadInput(f"tip at x0 {x0_mm} mm, y0 {y0_mm} mm needs the stage at {name} {value:.3f} mm; "
                               f"its limits are {low} to {high}")  # fmt: skip
        steps = (round(1e3 * v / stage.step_um) * stage.step_um for v in (x, y))
        x_um, y_um = (round(v) for v in steps)
        return x_um, y_um

    def tip_mm(self, x_um: int, y_um: int) -> tuple[float, float]:
        """(x'0, y'0) [mm] of the cue's axis at a stage position [micrometre]."""
        tilt = math.cos(math.radians(self.stage.tilt_deg))
        return 1e-3 * x_um - self.stage.zero_x_mm, (1e-3 * y_um - self.stage.zero_y_mm) * tilt


def read_settings(path: Path | str) -> Settings:
    """Read a launcher's file; BadInput names its faults."""
    return read_toml(path, Settings, SETTINGS_FORMAT, "name a launcher's TOML file")


def write_settings(settings: Settings, path: Path | str) -> None:
    """Write a launcher's file, completely or not at all."""
    write_whole(path, tomli_w.dumps({"format": SETTINGS_FORMAT, **dataclasses.asdict(settings)}).encode())
