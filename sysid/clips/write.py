"""Writing a clip set atomically: afterwards the folder holds all of it, or what it held before.

In: a `ClipSet`. Out: a folder in the format `billiard-clips/1`.

The files are written and checked in a scratch folder beside the wanted one, which then takes its place by renaming.
"""

from __future__ import annotations

import ctypes
import math
import os
import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from models.errors import BadInput, one_line
from models.files import read_document
from models.files.faults import Faults, shown
from models.files.writing import unwritable
from models.shot import Table
from models.table.pocket_shape import POCKET_SETS
from models.table.presets import TABLE_SETS
from sysid.clips.clip_set import Clip, ClipSet
from sysid.clips.header import CLIP_SET_FORMAT
from sysid.clips.names import CLIPS_TOML, name_fault, path_fault
from sysid.clips.read import faults_of_written
from sysid.clips.rows import COLUMN_NAMES
from sysid.clips.session import entries_of

AT_FDCWD, RENAME_EXCHANGE = -100, 2  # of renameat2: paths as they are, exchange them


def write_clip_set(clip_set: ClipSet, folder: Path | str) -> None:
    """Write a clip set so that `folder` holds all of it or what it held before.

    Times and positions keep 6 decimals. A clip set that is there is replaced; any other file is BadInput, and so is
    a clip set that `read_clip_set` would refuse.
    """
    replace_folder(Path(folder), texts_of(clip_set), lambda new: faults_of_written(new, Path(folder)))


def texts_of(clip_set: ClipSet) -> dict[str, str]:
    """The files of a clip set: relative path -> content."""
    texts = {CLIPS_TOML: _settings(clip_set)}
    for clip in clip_set.clips:
        if problem := path_fault(clip.file):
            raise BadInput(f"file = {shown(clip.file)} of a clip {problem}")
        path = os.path.normpath(clip.file)
        if path in texts:
            raise BadInput(f"file = {shown(clip.file)} is the file of two clips: name each clip's file once")
        texts[path] = _csv(clip)
    return texts


def _settings(clip_set: ClipSet) -> str:
    sections: dict[str, dict[str, Any]] = {
        "table": asdict(clip_set.table) | {"pockets": _pockets(clip_set.table)},
        "ball": asdict(clip_set.ball),
        "camera": {"fps": clip_set.fps} | ({} if clip_set.sigma is None else {"sigma": clip_set.sigma}),
    }
    top = {key: value for key, value in clip_set.extra.items() if key not in (*sections, "clip")}
    text = assignments({**top, "format": CLIP_SET_FORMAT})
    for name, section in sections.items():
        text += f"\n[{name}]\n" + assignments({**clip_set.extra.get(name, {}), **section})
    sessions = entries_of([clip.session for clip in clip_set.clips])
    for clip, session in zip(clip_set.clips, sessions, strict=True):
        entry: dict[str, Any] = {"file": clip.file, "struck": clip.struck}
        if clip.running:
            entry["running"] = True
        if clip.note:
            entry["note"] = clip.note
        if clip.cue is not None:
            entry["cue"] = {**asdict(clip.cue), **clip.extra.get("cue", {})}
        if session or "session" in clip.extra:
            entry["session"] = {**session, **clip.extra.get("session", {})}
        known = (*entry, "cue", "note", "running", "session")
        others = {key: value for key, value in clip.extra.items() if key not in known}
        text += "\n[[clip]]\n" + assignments({**entry, **others})
    return text


def _pockets(table: Table) -> Any:
    """The entry for a table's pockets: a name where one stands for them, that of the table's own size first."""
    names = [name for name, shapes in POCKET_SETS.items() if shapes == table.pockets]
    own = [name for name in names if TABLE_SETS[name].table.length == table.length]
    return (own or names)[0] if names else asdict(table)["pockets"]


def assignments(table: Mapping[str, Any]) -> str:
    """Lines of TOML, a key each."""
    return "".join(f"{_key(key)} = {_literal(value)}\n" for key, value in table.items())


def _key(key: str) -> str:
    return tomli_w.dumps({key: 0}).removesuffix(" = 0\n")


def _literal(value: Any) -> str:
    """A TOML value on one line: tomli_w spreads arrays and tables over several."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {_literal(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_literal, value)) + "]"
    if isinstance(value, np.generic):
        value = value.item()
    try:
        return tomli_w.dumps({"v": value}).removeprefix("v = ").removesuffix("\n")
    except (TypeError, ValueError) as error:
        raise BadInput(
            one_line(f"{CLIPS_TOML}: {shown(value)} cannot be written as TOML ({error}): change it")
        ) from error


def _csv(clip: Clip) -> str:
    more = list(dict.fromkeys(key for seen in clip.balls.values() for key in seen.extra))
    for name, seen in clip.balls.items():
        if problem := name_fault(name):
            raise BadInput(f"{clip.file}: ball = {shown(name)} {problem}")
        count = len(seen.time)
        shapes = {"time": (count,), "xy": (count, 2), "theta": (count,)}
        for key, shape in shapes.items():
            if (found := np.shape(getattr(seen, key))) != shape:
                problem = f"{key} of ball {shown(name)} has shape {found}, not {shape}: give one value for each time"
                raise BadInput(f"{clip.file}: {problem}")
        if not count or any(len(cells) != count for cells in seen.extra.values()):
            problem = "has columns of different lengths: give" if count else "has no samples: leave it out or give"
            raise BadInput(f"{clip.file}: ball {shown(name)} {problem} one value for each time")
    for key in more:
        if key in COLUMN_NAMES or key != key.strip():
            raise BadInput(f"{clip.file}: {shown(key)} cannot name an extra column: choose another name")
    rows: list[tuple[float, str]] = []
    for name, seen in clip.balls.items():
        blank = ("",) * len(seen.time)
        others = zip(*(seen.extra.get(key, blank) for key in more), strict=True) if more else ((),) * len(blank)
        # Adding 0 turns -0 into 0.
        xy = (np.round(seen.xy, 6) + 0.0).tolist()
        quoted = _cell(name)
        stamps = (seen.time + clip.origin).tolist()
        for t, (x, y), theta, cells in zip(stamps, xy, seen.theta.tolist(), others, strict=True):
            angle = "" if math.isnan(theta) else f"{theta:.6f}"
            tail = "".join("," + _cell(cell) for cell in cells)
            rows.append((t, f"{t:.6f},{quoted},{x:.6f},{y:.6f},{angle}{tail}\n"))
    rows.sort(key=lambda row: row[0])
    return ",".join([*COLUMN_NAMES, *map(_cell, more)]) + "\n" + "".join(text for _, text in rows)


def _cell(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if any(c in text for c in ',"\r\n') else text


def replace_folder(folder: Path, texts: Mapping[str, str], check: Callable[[Path], Iterable[str]]) -> None:
    """Make `folder` hold exactly `texts`, relative path -> content, once `check` finds no fault in it."""
    if not str(folder).isprintable():
        raise BadInput(f"{folder}: holds unprintable characters: choose another name for the folder")
    made: list[Path] = []
    try:
        target = Path(os.path.realpath(folder))
        _refuse_foreign(folder, target)
        _make_parents(target, made)
        prefix = f".{target.name[:40]}-"
        with tempfile.TemporaryDirectory(dir=target.parent, prefix=prefix, ignore_cleanup_errors=True) as scratch:
            new, old = Path(scratch, "new"), Path(scratch, "old")
            for file, text in texts.items():
                (new / file).parent.mkdir(parents=True, exist_ok=True)
                (new / file).write_bytes(text.encode())
            for fault in check(new):
                raise BadInput(f"{fault} (no clip was written)")
            _exchange(new, target, old)
            made.clear()
    except OSError as error:
        raise unwritable(folder, error) from error
    except UnicodeError as error:
        text = f"{folder}: cannot be written (text that is not Unicode): choose another folder"
        raise BadInput(text) from error
    finally:
        for parent in made:
            parent.rmdir()


def _make_parents(target: Path, made: list[Path]) -> None:
    """Make the folders above `target`; those that were not there join `made`, innermost first."""
    for parent in reversed([parent for parent in target.parents if not parent.exists()]):
        parent.mkdir()
        made.insert(0, parent)


def _exchange(new: Path, target: Path, old: Path) -> None:
    """Put `new` in the place of `target`, which moves to `old`, or to `new` where that can be done in one step."""
    if not target.exists():
        new.rename(target)
        return
    if _swapped(new, target):
        return
    target.rename(old)
    try:
        new.rename(target)
    except BaseException:  # an interrupt as well must not leave the place empty
        old.rename(target)
        raise


def _swapped(one: Path, other: Path) -> bool:
    """Exchange two folders atomically; False if the system cannot (renameat2)."""
    swap = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    return swap is not None and swap(AT_FDCWD, bytes(one), AT_FDCWD, bytes(other), RENAME_EXCHANGE) == 0


def _refuse_foreign(folder: Path, target: Path) -> None:
    """Raise BadInput if the folder holds anything but a clip set, since only clip sets may be replaced."""
    if not target.exists():
        return
    if not target.is_dir():
        raise BadInput(f"{folder}: is a file: name a folder for the clip set")
    found = {os.path.relpath(os.path.join(at, file), target) for at, _, files in os.walk(target) for file in files}
    foreign = sorted(found - _own_files(target))
    if foreign:
        what = "is not a clip set" if CLIPS_TOML in foreign or CLIPS_TOML not in found else "is not part of it"
        raise BadInput(f"{folder}: holds {shown(foreign[0])} and {what}: choose another folder")


def _own_files(target: Path) -> set[str]:
    """The files of the clip set in `target`; none if it is not one."""
    document = read_document(target / CLIPS_TOML, CLIPS_TOML, Faults(), "")
    if document is None or not str(document.get("format")).startswith("billiard-clips/"):
        return set()
    clips = document.get("clip")
    files = [clip.get("file") for clip in clips if isinstance(clip, dict)] if isinstance(clips, list) else []
    return {CLIPS_TOML, *(os.path.normpath(file) for file in files if isinstance(file, str))}
