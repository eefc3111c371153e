"""How far apart the launcher's strokes of one string end: the cue ball alone on the table, struck again and again.

In: the launcher's settings, strings, a seed. Out: path length and scatter of the ball for each string.

Robotic Billiards (2015), section V.C: a repeatability of some +-50 mm on average for cue speeds of up to 2.8 m/s. Read
here as the mean over strings, spread evenly over 0.3 to 2.75 m/s of the cue, of one standard deviation of the distance
from the mean place, sqrt(sum |xy - mean|^2 / (n - 1)), on a table with cushions, which fast balls always meet. A path
length D goes with the square of the speed, dD = 2 D dV / V, and a cushion leaves some 0.3 of the ball's energy, and of
the scatter: on a full-size table 50 mm are 1.3 % of the speed. The same strokes on an endless cloth (`OPEN_CLOTH`) run
up to 30 m and scatter six times as far; they separate the launcher from the cushions. The emulated launcher repeats its
speed within 1.25 % (robot/emulator/firmware.py), which makes 47 mm over 1800 strokes; 300, as `robot repeat` plays them
without options, give that within 3 mm.

The ball lies on the brown spot and is struck straight up the table, tip at its centre, the stand turned once; it is put
back by hand, within BALL_PLACING_SD_M. Places are those that the emulated camera sees, path lengths are true. Leaves
out a stand that shakes, a stage that moves between strokes, and the paper's path, repeats and table (10 x 5 ft), of
which it states the last alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from models.console import table
from models.errors import BadInput
from models.mjcf.snooker import SNOOKER_BALL, SNOOKER_TABLE, spots
from models.model_file import full_model
from models.shot import Array, Table
from robot.device.settings import Settings
from robot.emulator.table import PLACE_SIGMA_M, EmulatedOptions, EmulatedTable, emulated_launcher

REPEATABILITY_M = 0.050  # of the mean place: the paper's repeatability [m]
BALL_PLACING_SD_M = 1e-4  # of the place a ball is put back to, each axis [m]; as robot/cueing/striker.py has it
CUE_SPEEDS = tuple(float(v) for v in np.linspace(0.30, 2.75, 15))  # of the cue [m/s]
DEFAULT_REPEATS = 20
OPEN_CLOTH = Table(250.0, 250.0, pockets=False)  # a cloth on which no ball of 7 m/s comes to a cushion [m]
BALL_NAME = "white"


@dataclass(frozen=True)
class Repeated:
    """Strokes of one string."""

    string: int
    asked_speed: float  # of the cue, by the calibration [m/s]
    cue_speed: float  # mean, as the launcher measured it [m/s]
    cue_speed_sd: float  # fraction of the mean [1]
    run: float  # mean path length of the ball [m]
    along_sd: float  # of the end, along the aim [m]
    across_sd: float  # to its left [m]
    within: float  # share of the strokes that end within REPEATABILITY_M of their mean place, 0 to 1
    ended: int  # strokes that these figures describe
    fell: int  # strokes whose ball fell into a pocket, counted here only

    @property
    def scatter(self) -> float:
        """One standard deviation of the distance from the mean place [m]."""
        return math.hypot(self.along_sd, self.across_sd)


@dataclass(frozen=True)
class Conditions:
    """Where the ball runs, and how well it is put back and seen."""

    cloth: Table = SNOOKER_TABLE  # or OPEN_CLOTH
    ball_sd: float = BALL_PLACING_SD_M  # of the place that the ball is put back to, each axis [m]
    sigma: float = PLACE_SIGMA_M  # of the camera, each axis [m]


def spread_strings(settings: Settings, speeds: Sequence[float] = CUE_SPEEDS) -> tuple[int, ...]:
    """Strings for cue speeds [m/s], those left out that calibration or limits do not hold."""
    held, (low, high) = settings.calibration, settings.limits.cue_speed
    low, high = max(low, held.speeds[-1]), min(high, held.speeds[0])
    return tuple(sorted({held.string(v) for v in speeds if low - 1e-9 <= v <= high + 1e-9}))


def measure(
    settings: Settings,
    strings: Sequence[int],
    repeats: int = DEFAULT_REPEATS,
    seed: int = 0,
    conditions: Conditions | None = None,
    progress: Callable[[str], None] | None = None,
) -> tuple[Repeated, ...]:
    """Strike each string again and again on an emulated launcher and table; the same seed gives the same strokes.

    Args:
        settings: of the launcher; its strings run as its calibration says, but for what does not repeat.
        strings: to be measured.
        repeats: of each, 2 or more.
        seed: of the launcher, of the ball's places, and of the camera; the same for every cloth.
        conditions: cloth and errors of hand and camera, where they differ from the defaults.
        progress: called with what is being done.

    Raises:
        BadInput: a string outside calibration or limits, or too few repeats, before anything is struck.
    """
    if not strings:
        raise BadInput("strings is empty; give 1 to 200, as far as the launcher is calibrated")
    if repeats < 2:
        raise BadInput(f"repeats is {repeats}; give 2 or more")
    asked = [settings.check_speed(n) for n in strings]
    conditions = conditions or Conditions()
    cloth, options = conditions.cloth, EmulatedOptions(sigma=conditions.sigma, yaw_sd=0.0)
    model = full_model(cloth, SNOOKER_BALL)
    spot = spots(cloth)["brown"] if cloth.pockets else np.array([-0.45 * cloth.length, 0.0])
    of_launcher, of_hand, of_camera = np.random.default_rng(seed).spawn(3)
    hits: list[tuple[float, float, float]] = []
    launcher, _ = emulated_launcher(settings, lambda *hit: hits.append(hit), of_launcher)
    found = []
    with launcher:
        launcher.home()
        launcher.move_tip(0.0, 0.0)
        for n, speed in zip(strings, asked, strict=True):
            speeds, ends, lengths = np.empty(repeats), np.empty((repeats, 2)), np.empty(repeats)
            for k in range(repeats):
                speeds[k] = launcher.strike(n).cue_speed
                launcher.retract()
                off = conditions.ball_sd * of_hand.standard_normal(2)
                camera_seed = int(of_camera.integers(2**32))
                ground = EmulatedTable(model, {BALL_NAME: tuple(spot + off)}, 0.0, camera_seed, options)
                cue_speed, side, height = hits.pop()
                ground.hit(cue_speed, side + off[1], height)  # a ball to the left is struck on its right
                ends[k] = ground.look().get(BALL_NAME, np.full(2, np.nan))
                lengths[k] = _path_length(ground.track.position[:, 0]) if ground.track is not None else math.nan
            found.append(_repeated(n, speed, speeds, ends, lengths))
            if progress:
                progress(f"string {n:03d}p: {repeats} strokes scatter by {1e3 * found[-1].scatter:.0f} mm")
    return tuple(found)


def mean_scatter(measured: Sequence[Repeated]) -> float:
    """The paper's figure: one standard deviation of the distance from the mean place, mean over strings [m]."""
    return float(np.mean([r.scatter for r in measured]))


def _path_length(xy: Array) -> float:
    """Length of a path (n, 2) [m]."""
    return float(np.hypot(*np.diff(xy, axis=0).T).sum())


def _repeated(string: int, asked: float, speeds: Array, ends: Array, lengths: Array) -> Repeated:
    """Figures of one string; nan where fewer than two balls stayed on the table."""
    stayed = np.isfinite(ends[:, 0])
    count, ends, lengths = int(stayed.sum()), ends[stayed], lengths[stayed]
    run = along = across = within = math.nan
    if count > 1:
        run = float(lengths.mean())
        along, across = (float(v) for v in ends.std(axis=0, ddof=1))
        within = float(np.mean(np.hypot(*(ends - ends.mean(axis=0)).T) <= REPEATABILITY_M))
    speed = float(speeds.mean())
    sd = float(speeds.std(ddof=1)) / speed
    return Repeated(string, asked, speed, sd, run, along, across, within, count, len(stayed) - count)


def rows(measured: Sequence[Repeated]) -> list[tuple[str, ...]]:
    """A table of them, its head first."""
    head = (
        "string",
        "cue m/s",
        "sd %",
        "run m",
        "along mm",
        "across mm",
        "scatter mm",
        f"within {1e3 * REPEATABILITY_M:g} mm",
    )
    lines = [
        (f"{r.string:03d}p", f"{r.cue_speed:.3f}", f"{100 * r.cue_speed_sd:.2f}", f"{r.run:.2f}",
         f"{1e3 * r.along_sd:.1f}", f"{1e3 * r.across_sd:.1f}", f"{1e3 * r.scatter:.1f}", f"{100 * r.within:.0f} %")
        for r in measured
    ]  # fmt: skip
    return [head, *lines]


def text(measured: Sequence[Repeated]) -> str:
    """What a person reads of one cloth."""
    fell = sum(r.fell for r in measured)
    lines = [table(rows(measured)), f"on average +-{1e3 * mean_scatter(measured):.0f} mm"]
    return "\n".join(lines + [f"in pockets, and left out: {fell}"] * (fell > 0))


def result(on_table: Sequence[Repeated], on_open: Sequence[Repeated], seed: int) -> dict[str, object]:
    """The same for a JSON file."""
    cloths = {"table": on_table, "open": on_open}
    by_cloth = {
        name: {"mean_scatter_m": mean_scatter(got), "strings": [asdict(r) | {"scatter": r.scatter} for r in got]}
        for name, got in cloths.items()
    }
    return {"format": "cuelab-repeatability/1", "seed": seed, **by_cloth}
