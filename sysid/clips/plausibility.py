"""Plausibility of the rows of one clip: times increase, balls are on the table and do not overlap.

In: the `Rows` of a clip with its table, ball and camera. Out: faults, collected in `Faults`.

A ball's centre stays a radius from the cushion noses, so the limit at the nose line tolerates errors of the camera
(scale, tilt, lens). Beyond it a ball may only be where a pocket is; a rare single sample somewhat beyond is an outlier
of the tracker (sysid/clips/tracker/outliers.py), no fault.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from models.files.faults import Faults, closest, listed, shown
from models.shot import Array, Ball, Table
from sysid.clips.header import Entry, Header
from sysid.clips.rows import Rows

PLACES, TIMES = "places", "times"  # kinds of entries that may be wrong in all clips alike
MIN_STRUCK_SAMPLES = 3  # fewest samples of the struck ball
MIN_GAP_S = 1e-6  # shortest interval between two frames
MAX_CLIP_S = 600.0  # no shot lasts so long, but one with times in milliseconds would
MAX_BEYOND_NOSE_M = 0.005  # largest distance of a centre beyond the nose: cushions yield, trackers err
MAX_WILD_M = 0.1  # largest distance beyond a nose of a single misplaced sample
MAX_WILD_SHARE = 0.02  # largest share of misplaced samples of a ball
POCKET_REACH = 2.0  # distance from the corner of the noses to a ball that drops, in ball diameters
MAX_OVERLAP_M = 0.003  # largest apparent overlap of touching balls at the start
RECORD_AGAIN = "record the shot again or remove the clip"
DEFAULT_FPS = 50.0  # used if the frame rate of the set is missing or wrong
START_FRAMES = 3.5  # a ball first seen in so many frames was there at the start


def check_rows(rows: Rows, file: str, header: Header, faults: Faults, doubted: Collection[str] = ()) -> None:
    """Collect the faults of times and places of one clip.

    Places are not checked if table or ball is missing. `doubted` may hold PLACES and TIMES, which are then known to be
    wrong in all clips.
    """
    table, ball, camera = header.table, header.ball, header.camera
    fps, noise = camera.get("fps", DEFAULT_FPS), 6 * camera.get("sigma", 0.0)
    _check_times(rows, file, math.inf if TIMES in doubted else MAX_CLIP_S, faults)
    if PLACES in doubted:
        return
    if table is not None and ball is not None and _check_places(rows, file, table, ball, noise, faults):
        _check_overlap(rows, file, ball, fps, noise, faults)


def _check_times(rows: Rows, file: str, longest: float, faults: Faults) -> None:
    time, line = rows.time, rows.line
    back = time[1:] < time[:-1]
    for i in np.flatnonzero(back).tolist():
        problem = f"t = {time[i + 1]:.9g} is before t = {time[i]:.9g} of row {line[i]}: sort the rows by t"
        faults.add(file, problem, line[i + 1])
    for k, name in enumerate(rows.names):
        of_ball = np.flatnonzero(rows.ball == k)
        gaps = time[of_ball[1:]] - time[of_ball[:-1]]
        for i in np.flatnonzero((gaps >= 0) & (gaps < MIN_GAP_S)).tolist():
            one, other = int(of_ball[i]), int(of_ball[i + 1])
            problem = f"t = {time[one]:.9g} of ball {shown(name)} is also in row {line[one]}"
            faults.add(file, f"{problem}: keep one row of a ball at one time", line[other])
    if not back.any() and len(time) and float(time[-1]) - float(time[0]) > longest:
        problem = (
            f"t = {time[-1]:.9g} is more than {longest:g} s after the first row: write seconds, not milliseconds, "
            "or cut the recording into clips of one strike each"
        )
        faults.add(file, problem, line[-1])


def check_struck(rows: Rows, entry: Entry, faults: Faults) -> None:
    """Note a struck ball that the clip does not hold, or holds too few samples of; a running clip need not name one."""
    if not entry.struck and (rows.names or not entry.running):
        return  # the fault is already reported for clips.toml
    if entry.struck not in rows.names:
        if rows.names:
            meant = closest(entry.struck, rows.names)
            remedy = f"did you mean {meant!r}?" if meant else "name one of them"
            problem = (
                f"struck = {shown(entry.struck)} is not in {entry.file}, which holds {listed(rows.names)}: {remedy}"
            )
            entry.place.fault(problem, "struck")
        else:
            faults.add(
                entry.file,
                f"holds no samples, at least {MIN_STRUCK_SAMPLES} of the struck ball are needed: {RECORD_AGAIN}",
            )
        return
    count = int(np.count_nonzero(rows.ball == rows.names.index(entry.struck)))
    if count < MIN_STRUCK_SAMPLES and not entry.running:
        few = f"holds {count} samples of the struck ball {shown(entry.struck)}"
        faults.add(entry.file, f"{few}, at least {MIN_STRUCK_SAMPLES} are needed: {RECORD_AGAIN}")


def _check_places(rows: Rows, file: str, table: Table, ball: Ball, noise: float, faults: Faults) -> bool:
    """Whether all balls are on the table or in its pockets."""
    half = np.array([table.length, table.width]) / 2
    limit = half + MAX_BEYOND_NOSE_M + noise
    outside = np.flatnonzero((np.abs(rows.xy) > limit).any(axis=1))
    margin = POCKET_REACH * ball.diameter + noise
    outside = np.array([i for i in outside.tolist() if not table.to_pocket(rows.xy[i]) <= margin], np.int64)
    good, wild = True, _wild(rows, outside, half + MAX_WILD_M)
    for i in outside.tolist():
        x, y = (float(v) for v in rows.xy[i])
        if i in wild:
            continue
        good = False
        axis = 0 if abs(x) > limit[0] else 1
        problem = f"{'xy'[axis]} = {(x, y)[axis]:.9g} of ball {shown(rows.names[rows.ball[i]])} lies outside the table"
        remedy = "correct it, in metres from the table's centre"
        faults.add(file, f"{problem} (nose at {half[axis]:g} m): {remedy}", rows.line[i])
    return good


def _wild(rows: Rows, outside: NDArray[np.int64], limit: Array) -> set[int]:
    """Which of the rows outside the table are single samples that the tracker misplaced."""
    found: set[int] = set()
    beyond = np.zeros(len(rows.ball), bool)
    beyond[outside] = True
    for k in range(len(rows.names)):
        of_ball = np.flatnonzero(rows.ball == k)
        away = np.concatenate([[True], beyond[of_ball], [True]])
        single = of_ball[away[1:-1] & ~away[:-2] & ~away[2:]]
        if single.size == away[1:-1].sum() <= MAX_WILD_SHARE * len(of_ball):
            found |= {i for i in single.tolist() if (np.abs(rows.xy[i]) <= limit).all()}
    return found


def _check_overlap(rows: Rows, file: str, ball: Ball, fps: float, noise: float, faults: Faults) -> None:
    starts: list[tuple[int, float, float, float, float]] = []  # row, time, x, y, speed
    for k in range(len(rows.names)):
        of_ball = np.flatnonzero(rows.ball == k)[:2]
        time, xy = rows.time[of_ball].tolist(), rows.xy[of_ball].tolist()
        late = time[0] - float(rows.time[0]) > START_FRAMES / fps
        if late or not all(map(math.isfinite, (*time, *xy[0], *xy[-1]))):
            continue
        speed = math.dist(xy[0], xy[1]) / (time[1] - time[0]) if len(of_ball) > 1 and time[1] > time[0] else 0.0
        starts.append((int(of_ball[0]), time[0], xy[0][0], xy[0][1], speed))
    for a, b in combinations(starts, 2):
        # A ball whose first frame is missing may have rolled into a place that the other has left since.
        rolled = 2 * abs(a[1] - b[1]) * max(a[4], b[4])
        distance = math.hypot(a[2] - b[2], a[3] - b[3])
        if distance < ball.diameter - MAX_OVERLAP_M - noise - rolled:
            names = f"{shown(rows.names[rows.ball[a[0]]])} and {shown(rows.names[rows.ball[b[0]]])}"
            problem = (
                f"balls {names} overlap at the start: centres {distance:.4g} m apart, diameter {ball.diameter:g} m"
            )
            faults.add(file, f"{problem}: correct their places or the diameter", rows.line[max(a[0], b[0])])
