"""The cueing campaign: the launcher strikes a grid of strokes, a camera measures ball speed and squirt.

In: a `Striker` that strikes and measures, the grid and a seed. Out: a CSV file, one row a shot.

Robotic Billiards (2015), section V.C: cue speeds of some 0.5 to 2.5 m/s, heights y'0 of -12 to 12 mm and sides x'0 of
0 to 12 mm in steps of 2 mm, each five times: 2275 shots. Only the right side is played; the left is its mirror image.
Unlike in the paper, the order is shuffled: a drift of the machine then adds to the scatter and is not mistaken for an
effect of the offset. Rows are written one by one, so that an interrupted campaign continues where it stopped.
"""

from __future__ import annotations

import csv
import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from models.errors import BadInput
from models.files import append_whole, read_text, write_whole
from models.files.faults import Faults, shown
from models.files.limits import excess
from planner.launcher.stroke import LauncherModel

CUE_SPEEDS = (0.5, 1.0, 1.5, 2.0, 2.5)  # [m/s]
SIDES_MM = tuple(float(v) for v in range(0, 13, 2))
HEIGHTS_MM = tuple(float(v) for v in range(-12, 13, 2))
DEFAULT_REPEATS = 5
MAX_SHOTS = 100_000  # most shots of a campaign
MAX_CUE_SPEED = 2.75  # cue speed of '001p' [m/s]: the paper's campaign exceeded the 2.2 m/s of its planned shots


@dataclass(frozen=True)
class CueShot:
    """One commanded stroke and its measured result."""

    string: int  # 1 to 200
    cue_speed: float  # of the string [m/s]
    x0_mm: float  # of the cue's axis from the ball's centre, to the right
    y0_mm: float  # likewise, upwards
    ball_speed: float  # horizontal, as the ball leaves the tip [m/s]
    ball_speed_sd: float  # of the measurement error that differs between repeats [m/s]
    ball_speed_unsure: float  # sd of the measurement error that repeats share, 0 for none [m/s]
    squirt_rad: float  # direction of the ball against the aim, > 0 to the left
    squirt_sd: float  # of the measurement error that differs between repeats [rad]
    squirt_unsure: float  # sd of the measurement error that repeats share [rad]
    miscue: bool
    order: int = 0  # position in the order of play


COLUMN_BOUNDS = {
    "string": (1, 200), "cue_speed": (1e-3, 50.0), "x0_mm": (-100.0, 100.0), "y0_mm": (-100.0, 100.0),
    "ball_speed": (1e-3, 50.0), "ball_speed_sd": (1e-9, 50.0), "ball_speed_unsure": (0.0, 50.0),
    "squirt_rad": (-math.pi, math.pi), "squirt_sd": (1e-9, math.pi), "squirt_unsure": (0.0, math.pi),
    "miscue": (0, 1), "order": (0, 1_000_000),
}  # fmt: skip
CAMPAIGN_COLUMNS = tuple(f.name for f in dataclasses.fields(CueShot))


class Striker(Protocol):
    """The interface of anything that strikes a ball and measures its motion."""

    def __call__(self, string: int, x0_mm: float, y0_mm: float) -> CueShot:
        """Strike once; `order` of the returned shot is ignored."""
        ...


def make_grid(
    speeds: Sequence[float] = CUE_SPEEDS,
    sides_mm: Sequence[float] = SIDES_MM,
    heights_mm: Sequence[float] = HEIGHTS_MM,
    repeats: int = DEFAULT_REPEATS,
) -> list[tuple[int, float, float]]:
    """Strokes (string, x0_mm, y0_mm) to be played, ordered by position and speed."""
    launcher = LauncherModel(fastest=MAX_CUE_SPEED)
    strings = [launcher.string(v) for v in speeds]
    return [g for g in itertools.product(strings, sides_mm, heights_mm) for _ in range(repeats)]


def run_campaign(
    striker: Striker,
    out: Path | str,
    seed: int,
    progress: Callable[[str], None] | None = None,
    *,
    grid: Sequence[tuple[int, float, float]] | None = None,
    most: int | None = None,
) -> list[CueShot]:
    """Play a grid in shuffled order into a CSV file, or continue an existing one.

    Args:
        striker: strikes and measures.
        out: the CSV file.
        seed: of the order.
        progress: called with a description of the current step.
        grid: the strokes; by default the paper's 2275.
        most: stop after this number of further shots.

    Raises:
        BadInput: the file is another campaign's, or cannot be written.
    """
    path = Path(out)
    todo = list(make_grid() if grid is None else grid)
    todo = [todo[k] for k in np.random.default_rng(seed).permutation(len(todo))]
    done = _begun(path, todo)
    append_whole(path, b"" if path.exists() and path.stat().st_size else f"{','.join(CAMPAIGN_COLUMNS)}\n".encode())
    for k in range(len(done), len(todo) if most is None else min(len(todo), len(done) + most)):
        shot = dataclasses.replace(striker(*todo[k]), order=k)
        append_whole(path, f"{_row(shot)}\n".encode())
        done.append(shot)
        if progress:
            progress(f"shot {k + 1} of {len(todo)}: {shot.ball_speed:.3f} m/s for {shot.cue_speed:.3f} m/s")
    return done


def count_played(out: Path | str) -> int:
    """Number of complete rows in a campaign's file; 0 if there is no file."""
    path = Path(out)
    return max(_text(path).count("\n") - 1, 0) if path.exists() else 0


def _begun(path: Path, todo: Sequence[tuple[int, float, float]]) -> list[CueShot]:
    """Shots of an existing file; removes an incomplete last line of this campaign, and changes no other file."""
    if not path.exists():
        return []
    text = _text(path)
    head = ",".join(CAMPAIGN_COLUMNS)
    whole = text[: text.rfind("\n") + 1]
    done = _shots(whole, path) if whole or not head.startswith(text) else []
    for k, shot in enumerate(done):
        stroke = (shot.string, shot.x0_mm, shot.y0_mm)
        if k >= len(todo) or stroke != tuple(todo[k]) or shot.order != k:
            raise BadInput(f"{path}: row {k + 1} is stroke {stroke}, not one of this grid and seed; name another file")
    if len(whole) < len(text):
        write_whole(path, whole.encode())
    return done


def _row(shot: CueShot) -> str:
    values = dataclasses.asdict(shot).values()
    return ",".join(str(int(v)) if isinstance(v, int) else f"{v:.9g}" for v in values)


def read_campaign(path: Path | str) -> list[CueShot]:
    """Shots of a campaign's CSV file; BadInput names a wrong row and column."""
    return _shots(_text(Path(path)), Path(path))


def _text(path: Path) -> str:
    faults = Faults()
    return faults.settle(read_text(path, str(path), faults, "name the CSV file of a campaign"))


def _shots(text: str, path: Path) -> list[CueShot]:
    if problem := excess(text.count("\n"), MAX_SHOTS, "shots", "split it"):
        raise BadInput(f"{path}: {problem}")
    try:
        rows = list(csv.reader(text.splitlines()))
    except csv.Error as error:
        raise BadInput(f"{path}: is not CSV text ({error}); name the CSV file of a campaign") from None
    if not rows or tuple(rows[0]) != CAMPAIGN_COLUMNS:
        head = ",".join(rows[0])[:80] if rows else ""
        raise BadInput(
            f"{path}: begins with {shown(head)}; the first line of a campaign must be {','.join(CAMPAIGN_COLUMNS)}"
        )
    return [_shot(f"{path} row {k}", row) for k, row in enumerate(rows[1:], 1)]


def _shot(where: str, row: Sequence[str]) -> CueShot:
    if len(row) != len(CAMPAIGN_COLUMNS):
        raise BadInput(f"{where}: has {len(row)} columns instead of {len(CAMPAIGN_COLUMNS)}; delete that row")
    values: dict[str, float] = {}
    for name, text in zip(CAMPAIGN_COLUMNS, row, strict=True):
        try:
            values[name] = float(text)
        except ValueError:
            raise BadInput(f"{where}: {name} is {shown(text)}; give a number") from None
        whole = name in ("string", "miscue", "order")
        if not math.isfinite(values[name]) or (whole and values[name] != int(values[name])):
            raise BadInput(f"{where}: {name} is {shown(text)}; give a {'whole' if whole else 'finite'} number")
        low, high = COLUMN_BOUNDS[name]
        if not low <= values[name] <= high:
            raise BadInput(f"{where}: {name} is {shown(text)}; give a number from {low:g} to {high:g}")
    return CueShot(
        **{name: values[name] for name in CAMPAIGN_COLUMNS if name not in ("string", "miscue", "order")},
        string=int(values["string"]), miscue=bool(values["miscue"]), order=int(values["order"]),
    )  # fmt: skip
