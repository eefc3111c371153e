"""Scatter of the end points of repeated strokes with one string, the cue ball alone on the table.

In: cue speeds, ends and path lengths of repeated strokes. Out: `Repeated`, path length and scatter for each string.

Robotic Billiards (2015), section V.C: a repeatability of some +-50 mm on average for cue speeds of up to 2.8 m/s. This
is interpreted as the mean over strings, spread evenly over 0.3 to 2.75 m/s of the cue, of one standard deviation of the
distance from the mean end point, sqrt(sum |xy - mean|^2 / (n - 1)), on a table with cushions, which fast balls always
meet. A path length D is proportional to the square of the speed, dD = 2 D dV / V, and a cushion leaves some 0.3 of the
ball's energy, and of the scatter: on a full-size table 50 mm are 1.3 % of the speed. Left out: the paper's paths,
repeats and table (10 x 5 ft), of which it states only the table.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from models.commands.console import table
from models.shot import Array
from robot.device.settings import Settings

REPEATABILITY_M = 0.050  # distance from the mean end point: the paper's repeatability
CUE_SPEEDS = tuple(float(v) for v in np.linspace(0.30, 2.75, 15))  # of the cue [m/s]
DEFAULT_REPEATS = 20


@dataclass(frozen=True)
class Repeated:
    """Strokes of one string."""

    string: int
    asked_speed: float  # of the cue, by the calibration [m/s]
    cue_speed: float  # mean, as the launcher measured it [m/s]
    cue_speed_sd: float  # fraction of the mean [1]
    run: float  # mean path length of the ball [m]
    along_sd: float  # of the end point, along the aim [m]
    across_sd: float  # of the end point, to the left of the aim [m]
    within: float  # share of the strokes within REPEATABILITY_M of their mean end point, 0 to 1
    ended: int  # strokes in these figures
    fell: int  # strokes whose ball fell into a pocket, not in the other figures

    @property
    def scatter(self) -> float:
        """One standard deviation of the distance from the mean end point [m]."""
        return math.hypot(self.along_sd, self.across_sd)


def spread_strings(settings: Settings) -> tuple[int, ...]:
    """Strings for the cue speeds of `CUE_SPEEDS`, without those outside calibration or limits."""
    held, (low, high) = settings.calibration, settings.limits.cue_speed
    low, high = max(low, held.speeds[-1]), min(high, held.speeds[0])
    return tuple(sorted({held.string(v) for v in CUE_SPEEDS if low - 1e-9 <= v <= high + 1e-9}))


def mean_scatter(measured: Sequence[Repeated]) -> float:
    """The paper's figure: standard deviation of the distance from the mean end point, averaged over strings [m]."""
    return float(np.mean([r.scatter for r in measured]))


def summarised(string: int, asked: float, speeds: Array, ends: Array, lengths: Array) -> Repeated:
    """Figures of one string; nan if fewer than two balls stayed on the table.

    Args:
        string: that was struck.
        asked: its cue speed by the calibration [m/s].
        speeds: of the cue, as measured by the launcher (n,) [m/s].
        ends: end points of the ball, x along the aim (n, 2) [m]; nan if it fell.
        lengths: of its path (n,) [m].
    """
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
    """Rows of a table of the strings, the head first."""
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
    """The text on one cloth for the user."""
    fell = sum(r.fell for r in measured)
    lines = [table(rows(measured)), f"on average +-{1e3 * mean_scatter(measured):.0f} mm"]
    return "\n".join(lines + [f"in pockets, and left out: {fell}"] * (fell > 0))


def result(by_name: Mapping[str, Sequence[Repeated]], seed: int | None = None) -> dict[str, object]:
    """The figures for a JSON file, by name of the cloth; `seed` is that of an emulated launcher."""
    by_cloth = {
        name: {"mean_scatter_m": mean_scatter(got), "strings": [asdict(r) | {"scatter": r.scatter} for r in got]}
        for name, got in by_name.items()
    }
    return {"format": "cuelab-repeatability/1", "seed": seed, **by_cloth}
