"""The settings of one launcher, in one TOML file, cuelab-launcher/1: port, time-outs, limits, stage, speed calibration.

In: the file, or defaults. Out: `Settings`, which checks strings, yaw and tip positions against the limits.

The paper gives two points of the law from string to cue speed, '001p' 2.75 m/s and '200p' 0.30 m/s (Robotic Billiards
2015, section V); the line through them is the default table. A launcher's measured table replaces it: strings rising,
cue speeds falling, straight lines between. Outside its first and last string nothing is known and nothing is played.

The contact point lies R / (R + r_tip) nearer to the ball's centre than the cue's axis, where R is the ball's radius and
r_tip that of the tip's dome; the stage moves in the vertical plane, so that the stage's y is y'0 / cos(tilt). Leaves
out a drift of the speed with temperature, and a dependence of the speed on the stage's position.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import tomli_w

from models.errors import BadInput
from models.files import read_toml, write_whole
from robot.device.protocol import FIRST_STRING, LAST_STRING

SETTINGS_FORMAT = "cuelab-launcher/1"


def bounded(default: float, low: float, high: float, unit: str) -> Any:
    """A number with its bounds and unit."""
    return field(default=default, metadata={"bounds": (low, high), "unit": unit})


def span(default: tuple[float, float], low: float, high: float, unit: str) -> Any:
    """A range [least, most] with the bounds and unit of its ends."""
    return field(default=default, metadata={"bounds": (low, high), "unit": unit})


@dataclass(frozen=True)
class PortSettings:
    """Where the launcher is."""

    device: str = "/dev/ttyUSB0"
    baud: int = bounded(19200, 1200, 921600, "bit/s")  # the paper names none


@dataclass(frozen=True)
class Timing:
    """Time-outs and numbers of retries."""

    reply_s: float = bounded(0.25, 0.01, 10, "s")  # of silence until a request is sent again
    retries: int = bounded(5, 0, 50, "1")  # of one request, and of one stroke line
    poll_s: float = bounded(0.02, 0.001, 1, "s")  # between questions while something moves
    motion_s: float = bounded(30, 0.1, 600, "s")  # after which a motion counts as hung
    reconnect_s: float = bounded(5, 0, 600, "s")  # for a disconnected cable to come back


class Clock(Protocol):
    """A clock that waits; tests use one that does not."""

    def now(self) -> float: ...  # [s], from any start
    def sleep(self, seconds: float) -> None: ...


class RealClock:
    """The machine's."""

    def now(self) -> float:
        """Seconds, never set back."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait."""
        time.sleep(seconds)


@dataclass(frozen=True)
class Limits:
    """Limits of what may be commanded."""

    x_mm: tuple[float, float] = span((-20.0, 20.0), -25, 25, "mm")  # of the stage, from home
    y_mm: tuple[float, float] = span((-20.0, 20.0), -25, 25, "mm")
    cue_speed: tuple[float, float] = span((0.30, 2.75), 0.05, 5, "m/s")
    offset: float = bounded(0.5, 0, 0.6, "1")  # of the contact point over the radius; beyond, the tip slips
    yaw_deg: tuple[float, float] = span((-180.0, 180.0), -180, 180, "deg")  # that the stand can be turned to, by hand


@dataclass(frozen=True)
class Stage:
    """How the tip is placed."""

    zero_x_mm: float = bounded(0.0, -25, 25, "mm")  # stage position at which the axis meets the ball's centre
    zero_y_mm: float = bounded(0.0, -25, 25, "mm")
    takeup_mm: float = bounded(0.4, 0, 5, "mm")  # passed below the target before going up to it: more than the backlash
    step_um: float = bounded(10, 0.1, 1000, "um")  # requested and reported positions agree within this
    tilt_deg: float = bounded(6.5, 0, 30, "deg")  # of the cue (Robotic Billiards 2015)
    ball_radius_mm: float = bounded(26.25, 10, 50, "mm")
    tip_radius_mm: float = bounded(10.0, 2, 30, "mm")  # of the dome (Robotic Billiards 2015)


@dataclass(frozen=True)
class SpeedTable:
    """Cue speeds of strings: rising strings, falling speeds [m/s]."""

    strings: tuple[int, ...] = (FIRST_STRING, LAST_STRING)
    speeds: tuple[float, ...] = (2.75, 0.30)
    source: str = "the line through the two figures of Robotic Billiards (2015), section V"

    def __post_init__(self) -> None:
        """BadInput where it is no falling table."""
        n, v = np.array(self.strings, float), np.array(self.speeds, float)
        if n.ndim != 1 or len(n) < 2 or n.shape != v.shape:
            raise BadInput(f"calibration has {n.size} strings and {v.size} speeds; give as many, two or more")
        if not (np.all(np.diff(n) > 0) and n[0] >= FIRST_STRING and n[-1] <= LAST_STRING and np.all(n == np.round(n))):
            raise BadInput(
                f"calibration strings are {list(self.strings)}; "
                f"give whole numbers, rising, {FIRST_STRING} to {LAST_STRING}"
            )
        if not (np.all(np.isfinite(v)) and np.all(np.diff(v) < 0) and v[-1] > 0 and v[0] <= 10):
            raise BadInput(
                f"calibration speeds are {list(self.speeds)}; give m/s that fall from string to string, 0 to 10"
            )

    def cue_speed(self, string: int) -> float:
        """Of a string [m/s]; BadInput outside the table."""
        if not self.strings[0] <= string <= self.strings[-1]:
            raise BadInput(
                f"string {string:03d}p is not calibrated; choose {self.strings[0]:03d}p to {self.strings[-1]:03d}p"
            )
        return float(np.interp(string, self.strings, self.speeds))

    def string(self, cue_speed: float) -> int:
        """The string nearest to a cue speed [m/s]; BadInput outside the table."""
        slack = 1e-9
        if not self.speeds[-1] - slack <= cue_speed <= self.speeds[0] + slack:
            raise BadInput(f"cue speed is {cue_speed} m/s; the calibration holds {self.speeds[-1]} to {self.speeds[0]}")
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
    calibration: SpeedTable = field(default_factory=SpeedTable)

    def with_table(self, strings: Sequence[int], speeds: Sequence[float], source: str) -> Settings:
        """The settings with a calibrated table; speeds [m/s]."""
        table = SpeedTable(tuple(int(n) for n in strings), tuple(float(v) for v in speeds), source)
        return dataclasses.replace(self, calibration=table)

    def check_speed(self, string: int) -> float:
        """Cue speed of a string [m/s]; BadInput where it is not calibrated or out of the limits."""
        speed, (low, high) = self.calibration.cue_speed(string), self.limits.cue_speed
        if not low - 1e-9 <= speed <= high + 1e-9:
            raise BadInput(f"string {string:03d}p gives {speed:.4g} m/s of the cue; the limits are {low} to {high}")
        return speed

    def check_yaw(self, theta_deg: float) -> float:
        """An azimuth that the stand can be turned to by hand [deg], within -180 to 180; BadInput otherwise."""
        low, high = self.limits.yaw_deg
        turned = math.remainder(theta_deg, 360.0) if math.isfinite(theta_deg) else math.nan
        if not low <= turned <= high:
            raise BadInput(f"yaw is {theta_deg} degrees; the stand turns {low} to {high}")
        return turned

    def stage_um(self, x0_mm: float, y0_mm: float) -> tuple[int, int]:
        """Stage position (x, y) [micrometre] that puts the cue's axis at (x'0, y'0) [mm] of the ball's centre.

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


SETTINGS_SECTIONS = {"port": PortSettings, "timing": Timing, "limits": Limits, "stage": Stage}


def _near(key: str, names: Sequence[str]) -> str:
    close = get_close_matches(key, names, 1)
    return f"did you mean {close[0]}?" if close else f"choose from {', '.join(names)}"


def _number(value: Any, where: str, meta: Mapping[str, Any], whole: bool) -> Any:
    low, high = meta["bounds"]
    right = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
    if not right or not low <= value <= high:
        raise BadInput(f"{where} is {value!r}; give a {'whole ' * whole}number from {low} to {high} [{meta['unit']}]")
    return int(value) if whole else float(value)


def _section(kind: type[Any], data: Any, where: str) -> Any:
    """One section of the file as its dataclass."""
    known = {f.name: f for f in dataclasses.fields(kind)}
    if not isinstance(data, dict):
        raise BadInput(f"{where} is {data!r}; write it as a table")
    values: dict[str, Any] = {}
    for key, value in data.items():
        if key not in known:
            raise BadInput(f"{where}: unknown key {key!r}; {_near(key, list(known))}")
        declared, place = known[key], f"{where}: {key}"
        if isinstance(declared.default, str):
            if not isinstance(value, str) or not value or "\0" in value:
                raise BadInput(f"{place} is {value!r}; give a text")
            values[key] = value
        elif isinstance(declared.default, tuple):
            if not isinstance(value, list) or len(value) != 2:
                raise BadInput(f"{place} is {value!r}; give [least, most]")
            low, high = (_number(v, place, declared.metadata, whole=False) for v in value)
            if not low <= high:
                raise BadInput(f"{place} is {value!r}; give the smaller one first")
            values[key] = (low, high)
        else:
            values[key] = _number(
                value, place, declared.metadata, whole=isinstance(declared.default, int) and declared.type == "int"
            )
    return kind(**values)


def _table(data: Any, where: str) -> SpeedTable:
    """The calibration of the file."""
    names = ("strings", "speeds", "source")
    if not isinstance(data, dict):
        raise BadInput(f"{where} is {data!r}; write it as a table")
    for key in data:
        if key not in names:
            raise BadInput(f"{where}: unknown key {key!r}; {_near(key, names)}")
    strings, speeds, source = (data.get(name) for name in names)
    for key, value, kind in (("strings", strings, int), ("speeds", speeds, int | float)):
        if not isinstance(value, list) or not all(isinstance(v, kind) and not isinstance(v, bool) for v in value):
            raise BadInput(f"{where}: {key} is {value!r}; give a list of numbers")
    if source is not None and not isinstance(source, str):
        raise BadInput(f"{where}: source is {source!r}; give a text")
    try:
        return SpeedTable(tuple(strings or ()), tuple(float(v) for v in speeds or ()), source or "")
    except BadInput as error:
        raise BadInput(f"{where}: {error}") from None


def settings_from(data: Mapping[str, Any], where: str) -> Settings:
    """Settings from what a TOML file holds; BadInput names what is wrong in it."""
    if data.get("format") != SETTINGS_FORMAT:
        raise BadInput(f'{where}: format is {data.get("format")!r}; write format = "{SETTINGS_FORMAT}"')
    names = ("format", *SETTINGS_SECTIONS, "calibration")
    for key in data:
        if key not in names:
            raise BadInput(f"{where}: unknown section {key!r}; {_near(key, names)}")
    values = {
        name: _section(kind, data[name], f"{where} [{name}]")
        for name, kind in SETTINGS_SECTIONS.items()
        if name in data
    }
    if "calibration" in data:
        values["calibration"] = _table(data["calibration"], f"{where} [calibration]")
    return Settings(**values)


def read_settings(path: Path | str) -> Settings:
    """Read a launcher's file; BadInput names what is wrong in it."""
    data = read_toml(path, "name a launcher's TOML file", "correct that line")
    return settings_from(data, str(path))


def write_settings(settings: Settings, path: Path | str) -> None:
    """Write a launcher's file, whole or not at all."""
    write_whole(path, tomli_w.dumps({"format": SETTINGS_FORMAT, **dataclasses.asdict(settings)}).encode())
