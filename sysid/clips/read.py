"""Reading a clip set: the folder of tracked shots that every command reads.

In: a folder in the format `billiard-clips/1`. Out: a `ClipSet`, or the list of its faults.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from models.commands.console import as_called
from models.errors import BadInput, one_line
from models.files.faults import Faults, TooManyFaults
from models.files.limits import MAX_SET_BYTES, excess
from models.files.texts import picked
from models.shot import Session
from sysid.clips.clip_set import Clip, ClipSet, CueCommand, Observation
from sysid.clips.consistency.contradiction import ALL_CLIPS, Contradiction, is_sound
from sysid.clips.consistency.contradictions import contradictions
from sysid.clips.consistency.strike import STAMP_DECIMALS, from_strike
from sysid.clips.consistency.units import clip_fault, coordinates_fault, times_fault
from sysid.clips.header import Entry, read_header
from sysid.clips.names import CLIPS_TOML
from sysid.clips.plausibility import PLACES, TIMES, check_rows, check_struck
from sysid.clips.rows import Rows, read_rows
from sysid.clips.running import MIN_RUNNING_SAMPLES, begun_running
from sysid.clips.session import session_of
from sysid.clips.trust import camera_doubts, doubt_line

NO_MOTION = (
    f"running = true, but no ball moves for {MIN_RUNNING_SAMPLES} samples: remove the clip, or running where it begins "
    "with the strike"
)
SHOWN_PER_FILE = 10  # faults that `check_clip_set` lists of one file


@dataclass(frozen=True)
class Inspection:
    """The outcome of reading a clip set: the set, its faults and warnings."""

    folder: Path
    clip_set: ClipSet | None  # None if there are faults
    faults: Faults
    warnings: tuple[str, ...] = ()  # doubts of the camera and contradictions, one line each; empty if there are faults
    resting: int = 0  # clips that began before the strike; their earlier samples are left out

    def fault_lines(self) -> list[str]:
        """Every fault, one line each; of a file with very many the first ones and their number."""
        return self.faults.lines(SHOWN_PER_FILE)

    def sound(self) -> ClipSet:
        """The clip set that was read; BadInput names its first fault and how many more there are."""
        if self.clip_set is None:
            first, others = self.faults.lines()[0], len(self.faults) - 1
            raise BadInput(
                first + (one_line(f" ({others} more: {as_called(f'sysid check {self.folder}')})") if others else "")
            )
        return self.clip_set


def inspect_clip_set(folder: Path | str, named: Path | None = None, *, written: bool = False) -> Inspection:
    """Read a clip set with its faults or contradictions; messages name the folder as it was passed."""
    faults = Faults()
    try:
        clip_set, found, resting = _read(Path(folder), faults, named or Path(folder), written)
    except TooManyFaults:
        return Inspection(Path(folder), None, faults)
    if faults or clip_set is None:
        return Inspection(Path(folder), None, faults)
    doubts = tuple(one_line(f"{one.where}: {one.text}") for one in found if not one.certain)
    if doubted := doubt_line(CLIPS_TOML, camera_doubts(clip_set)):
        doubts = (doubted, *doubts)
    return Inspection(Path(folder), clip_set, faults, doubts, resting)


def read_clip_set(folder: Path | str) -> ClipSet:
    """Read a clip set; BadInput names its first fault and how many more there are."""
    return inspect_clip_set(folder).sound()


def check_clip_set(folder: Path | str, named: Path | None = None) -> list[str]:
    """Every fault of a clip set, one line each; of a file with very many the first ones and their number."""
    return inspect_clip_set(folder, named).fault_lines()


def faults_of_written(folder: Path, named: Path) -> list[str]:
    """Faults of a clip set that is being written, without those that its author may confirm to be right."""
    return inspect_clip_set(folder, named, written=True).fault_lines()


def _read(
    folder: Path, faults: Faults, named: Path, written: bool
) -> tuple[ClipSet | None, Sequence[Contradiction], int]:
    """The clip set (None if faults leave none), its contradictions, and how many clips began too early."""
    try:
        root = Path(os.path.realpath(folder, strict=True))
    except (OSError, ValueError):
        faults.add(str(folder), "no such folder: name the folder that holds clips.toml and its clips")
        return None, (), 0
    if not root.is_dir():
        faults.add(str(folder), "is not a folder: name the folder that holds clips.toml and its clips")
        return None, (), 0
    header = read_header(root, faults)
    if header is None:
        return None, (), 0
    size = sum(entry.path.stat().st_size for entry in header.entries)
    if problem := excess(size, MAX_SET_BYTES, "MB of clips", "split it into several clip sets", 1 << 20):
        faults.add(CLIPS_TOML, problem)
        return None, (), 0
    parsed = []
    last = max(len(header.entries) - 1, 1)
    for number, entry in enumerate(header.entries):
        with contextlib.suppress(TooManyFaults):
            rows = read_rows(entry.path, entry.file, faults)
            if rows is not None:
                clip = _clip(entry, rows, session_of(number / last, entry.session))
                parsed.append((entry, dataclasses.replace(rows, extra={}), clip))  # each clip has its own cells
    table, ball, camera = header.table, header.ball, header.camera
    clip_set = None
    still: list[str] = []
    if table is not None and ball is not None and "fps" in camera:
        clips = tuple(clip for _, _, clip in parsed)
        clip_set = ClipSet(table, ball, camera["fps"], clips, camera.get("sigma"), named, header.extra)
        clip_set, still = begun_running(clip_set)
    doubted, found = ((), ()) if clip_set is None else _doubted(clip_set, faults, written)
    for entry, rows, clip in parsed:
        fault = (
            None if clip_set is None or PLACES in doubted else clip_fault(dataclasses.replace(clip_set, clips=(clip,)))
        )
        with contextlib.suppress(TooManyFaults):
            if fault is not None:
                faults.add(entry.file, fault)
            check_rows(rows, entry.file, header, faults, (*doubted, PLACES) if fault else doubted)
        check_struck(rows, entry, faults)
        if entry.file in still:
            entry.place.fault(NO_MOTION, "running")
    resting = sum(len(rows.time) > 0 and clip.origin > rows.time[0] for _, rows, clip in parsed if not clip.running)
    return clip_set, found, resting


def _doubted(clip_set: ClipSet, faults: Faults, written: bool) -> tuple[tuple[str, ...], Sequence[Contradiction]]:
    """The kinds of rows that a fault of the whole set makes wrong, and all contradictions."""
    wrong = {PLACES: coordinates_fault(clip_set), TIMES: times_fault(clip_set)}
    doubted = []
    for what, fault in wrong.items():
        if fault is not None:
            faults.add(ALL_CLIPS, fault)
            doubted.append(what)
    if doubted:
        return tuple(doubted), ()
    found = contradictions(dataclasses.replace(clip_set, clips=tuple(c for c in clip_set.clips if is_sound(c))))
    for one in found:
        if one.certain and not (written and one.unless):
            faults.add(one.where, one.text)
    return (PLACES,) if any(one.places for one in found if one.certain) else (), found


def _clip(entry: Entry, rows: Rows, session: Session) -> Clip:
    """A clip whose time 0 is the strike or the first sample, wherever the camera's clock began."""
    balls = {}
    origin = float(rows.time[0]) if len(rows.time) else 0.0
    time = np.round(rows.time - origin, STAMP_DECIMALS)
    for k, name in enumerate(rows.names):
        of_ball = np.flatnonzero(rows.ball == k)
        extra = {key: picked(cells, of_ball) for key, cells in rows.extra.items()}
        balls[name] = Observation(time[of_ball], rows.xy[of_ball], rows.theta[of_ball], extra)
    cue = None if entry.cue is None else CueCommand(**entry.cue)
    if not entry.running:
        return from_strike(Clip(entry.file, entry.struck, balls, cue, entry.note, entry.extra, session, origin=origin))
    first = entry.struck or next(iter(balls), "")
    return Clip(
        entry.file, first, balls, note=entry.note, extra=entry.extra, session=session, running=(first,), origin=origin
    )  # fmt: skip
