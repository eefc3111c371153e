"""Calibration of the strings' cue speeds, from strokes that the launcher measures itself.

In: a connected launcher and the strings. Out: mean speed and scatter of each string, and a new calibration table.

The launcher reports each stroke's cue speed just before the ball's position (`Done.cue_speed`), so no ball is needed:
take it away, or catch it. Strings are played in rounds, slowest first: a drift of the drive then adds to the scatter
and is not mistaken for the law. Each stroke is followed by a retract; any error stops the launcher and ends the
calibration, and nothing is written.

The table holds the mean speed of each string, with linear interpolation (robot/device/settings.py); speeds must fall
from string to string. Only strings of the current settings are played: start with a file without [calibration] for all
200. Left out: the speed lost to the ball (models/analytic/cue_impulse.py), and a dependence on the stage's position.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from models.commands.console import table
from models.errors import BadInput
from robot.device.launcher import Launcher
from robot.device.outcome import Done
from robot.device.protocol import string_number
from robot.device.settings import Settings, SpeedTable, read_settings, write_settings

CALIBRATION_STRINGS = (1, 25, 50, 75, 100, 125, 150, 175, 200)
DEFAULT_REPEATS = 5


@dataclass(frozen=True)
class StringSpeed:
    """Strokes of one string."""

    string: int
    mean: float  # of the cue's speed [m/s]
    sd: float  # of one stroke [m/s]; nan for a single one
    strokes: int

    @property
    def mean_sd(self) -> float:
        """Standard error of the mean, from the scatter [m/s]; nan for a single stroke."""
        return self.sd / math.sqrt(self.strokes)


def measure_strings(
    launcher: Launcher,
    strings: Sequence[int | str] = CALIBRATION_STRINGS,
    repeats: int = DEFAULT_REPEATS,
    progress: Callable[[str], None] | None = None,
) -> tuple[StringSpeed, ...]:
    """Home the launcher and strike each string `repeats` times; the cue ends retracted, tip at the ball's centre.

    Raises:
        BadInput: a dry run, forbidden strings, or fewer than two; nothing has moved.
        LauncherError: something went wrong; the launcher was stopped.
    """
    if launcher.dry_run:
        raise BadInput("a dry run measures no speed; connect the launcher")
    asked = sorted((string_number(n) for n in strings), reverse=True)
    if len(set(asked)) != len(asked) or len(asked) < 2:
        raise BadInput(f"strings are {list(strings)}; give two or more, each once")
    if repeats < 1:
        raise BadInput(f"repeats is {repeats}; give 1 or more")
    for n in asked:
        launcher.settings.check_speed(n)
    shots: list[Done] = []
    try:
        launcher.home()
        launcher.move_tip(0.0, 0.0)
        for _ in range(repeats):
            for n in asked:
                shots.append(launcher.strike(n))
                launcher.retract()
                if progress:
                    progress(f"stroke {len(shots)} of {repeats * len(asked)}: {n:03d}p {shots[-1].cue_speed:.3f} m/s")
    except BaseException:  # including an interrupt: after any error all motion must end
        launcher.stop()
        raise
    return summarise(shots)


def summarise(shots: Iterable[Done]) -> tuple[StringSpeed, ...]:
    """Mean speed and scatter of each string, in rising order; BadInput if a stroke has no speed."""
    found: dict[int, list[float]] = {}
    for shot in shots:
        if not (math.isfinite(shot.cue_speed) and shot.cue_speed > 0):
            raise BadInput(f"stroke {shot.number} ({shot.string}) has a cue speed of {shot.cue_speed}; omit it")
        found.setdefault(string_number(shot.string), []).append(shot.cue_speed)
    return tuple(
        StringSpeed(n, float(np.mean(v)), float(np.std(v, ddof=1)) if len(v) > 1 else math.nan, len(v))
        for n, v in sorted(found.items())
    )


def speed_table(measured: Sequence[StringSpeed]) -> SpeedTable:
    """The calibration from measured strings; BadInput if a faster string was not measured faster."""
    ordered = sorted(measured, key=lambda row: row.string)
    for fast, slow in pairwise(ordered):
        if not fast.mean > slow.mean:
            raise BadInput(
                f"{fast.string:03d}p was measured at {fast.mean:.4g} m/s and {slow.string:03d}p at {slow.mean:.4g}; "
                "speeds must fall from string to string: use strings farther apart, or more repeats"
            )
    strokes = sum(row.strokes for row in ordered)
    source = f"{strokes} strokes at {len(ordered)} strings, measured by the launcher"
    speeds = tuple(round(row.mean, 6) for row in ordered)  # the launcher reports whole micrometres a second
    return SpeedTable(tuple(row.string for row in ordered), speeds, source)


def write_calibration(settings_file: Path | str | None, measured: Sequence[StringSpeed], out: Path | str) -> Settings:
    """Write a launcher's file with a new [calibration] and its other values, completely or not at all.

    Args:
        settings_file: file with the other values, without its comments; None for the paper's launcher.
        measured: of at least two strings.
        out: file to write; may be the same.

    Raises:
        BadInput: a missing file, speeds that do not fall, or a file that cannot be written.
    """
    old = read_settings(settings_file) if settings_file is not None else Settings()
    new = replace(old, calibration=speed_table(measured))
    write_settings(new, out)
    return new


def rows(measured: Sequence[StringSpeed], before: SpeedTable) -> list[tuple[str, ...]]:
    """Rows of a table of the strings with the previous calibration, the head first."""
    head = ("string", "strokes", "cue m/s", "sd of one", "sd of mean", "before", "change %")
    lines = []
    for row in measured:
        old = before.cue_speed(row.string)
        sds = (f"{v:.4f}" if math.isfinite(v) else "-" for v in (row.sd, row.mean_sd))
        change = f"{100 * (row.mean / old - 1):+.1f}"
        lines.append((f"{row.string:03d}p", str(row.strokes), f"{row.mean:.4f}", *sds, f"{old:.4f}", change))
    return [head, *lines]


def text(measured: Sequence[StringSpeed], settings: Settings) -> str:
    """The text for the user; `settings` are those of the measurement."""
    low, high = settings.limits.cue_speed
    beyond = [f"{r.string:03d}p" for r in measured if not low - 1e-9 <= r.mean <= high + 1e-9]
    lines = [table(rows(measured, settings.calibration))]
    if beyond:
        lines.append(
            f"outside the limits of {low} to {high} m/s and will be refused: {', '.join(beyond)}; "
            "widen [limits] cue_speed in the launcher's file to play them"
        )
    return "\n".join(lines)


def result(measured: Sequence[StringSpeed]) -> dict[str, object]:
    """The figures for a JSON file."""
    return {"format": "cuelab-strings/1", "strings": [asdict(r) | {"mean_sd": r.mean_sd} for r in measured]}
