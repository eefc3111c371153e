"""Functions that make clip sets: `sysid.import_tracks` and `sysid.track`, like the commands of these names.

In: files of another program, or a film and its camera file. Out: a `ClipSet`, in memory.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from models.errors import BadInput
from models.messages import OptionError
from models.shot import Ball
from models.table.presets import TableSet, find_table, usual_mass
from sysid.clips import ClipSet
from sysid.clips.trust import tell_doubts, with_doubts
from sysid.foreign.convert import ShotFile, import_files
from sysid.foreign.pixels import Pixels
from sysid.foreign.stated import Stated

PathLike = Path | str
STATED_FIELDS = ("time", "fps", "struck", "running", "columns", "turned")  # of `Stated`, as further arguments


@contextmanager
def naming_arguments() -> Iterator[None]:
    """Let errors name arguments where those of a command name its options."""
    try:
        yield
    except OptionError as fault:
        raise BadInput(fault.message.for_python()) from None


def import_tracks(
    files: PathLike | Sequence[PathLike], table: str | None = None, diameter: float | None = None,
    camera: PathLike | None = None, *, mass: float | None = None, unit: str | None = None, origin: str | None = None,
    x_along: str | None = None, y: str | None = None, **stated: Any,
) -> ClipSet:  # fmt: skip
    """Import tracks of another program as a clip set; what is not stated is inferred from them, as by `sysid import`.

    Args:
        files: CSV, JSON or Parquet, one shot each or with a column for the shot.
        table: by name, such as "pool 9 ft", or by size, such as "1.881x0.943" [m]; a camera file includes it.
        diameter: of the balls [m]; a named table and a camera file imply it.
        camera: file of the camera, if coordinates are pixels.
        mass: of a ball [kg]; by default the usual mass at this size.
        unit: m, cm, mm, in or ft.
        origin: "centre" or "corner".
        x_along: side that x runs along, "length" or "width".
        y: "up", or "down" as in pictures.
        stated: other fields of `Stated`: time, fps, struck, running, columns, turned.

    What had to be assumed is printed on the standard error stream.

    Raises:
        BadInput: a faulty file, or an ambiguity, with the argument that resolves it.
    """
    if unknown := [name for name in stated if name not in STATED_FIELDS]:
        own = ("table", "diameter", "camera", "mass", "unit", "origin", "x_along", "y", *STATED_FIELDS)
        raise TypeError(f"import_tracks has no argument {unknown[0]!r}; it has {', '.join(own)}")
    paths = [Path(files)] if isinstance(files, str | Path) else [Path(file) for file in files]
    pixels, doubts = None, tuple[str, ...]()
    if camera is not None:
        from sysid.vision import ball_of, read_camera

        seen = read_camera(camera)
        doubts = seen.doubts
        tell_doubts(camera, doubts)
        pixels = Pixels(seen.centres, seen.size[1])
        known = TableSet(seen.table, ball_of(seen, mass or usual_mass(seen.diameter)[0]))
    else:
        known = _sizes(table, diameter, mass)
    for name, value, allowed in (
        ("origin", origin, ("centre", "corner")), ("x_along", x_along, ("length", "width")), ("y", y, ("up", "down")),
    ):  # fmt: skip
        if value is not None and value not in allowed:
            raise BadInput(f"{name} = {value!r}: give {' or '.join(map(repr, allowed))}")
    statements = Stated(
        unit, None if origin is None else origin == "corner", None if x_along is None else x_along == "width",
        None if y is None else y == "down", **stated,
    )  # fmt: skip
    shots = [ShotFile(f"clips/{path.stem}.csv") for path in paths]
    with naming_arguments():
        found = import_files(paths, shots, known.table, known.ball, statements, pixels)
    for line in found.assumed:
        print(f"assumed: {line.for_python()}", file=sys.stderr)
    return with_doubts(found.clip_set, doubts)


def _sizes(table: str | None, diameter: float | None, mass: float | None) -> TableSet:
    """Table and balls, by name or by size."""
    if table is None:
        raise BadInput('table is missing: give a name, such as "pool 8 ft", or a size, such as "3.569x1.778"')
    found = find_table(table)
    if isinstance(found, TableSet) and diameter is None and mass is None:
        return found
    if isinstance(found, TableSet):
        size = diameter or found.ball.diameter
        return TableSet(found.table, Ball(size, mass or usual_mass(size)[0]))
    if diameter is None:
        raise BadInput(f"table = {table!r}: a size does not determine the balls; give diameter, such as 0.0525")
    return TableSet(found, Ball(diameter, mass or usual_mass(diameter)[0]))


def track(video: PathLike, camera: PathLike, *, fps: float | None = None, mass: float | None = None) -> ClipSet:
    """Track the shots of a film as a clip set, like `sysid track`.

    Args:
        video: a film, a folder of pictures, or a pattern of their names.
        camera: its camera file, of `sysid calibrate`.
        fps: true frame rate, if the film does not state it [1/s].
        mass: of a ball [kg]; by default the usual mass at this size.

    What was found or assumed, and each doubt, is printed on the standard error stream.

    Raises:
        BadInput: for a faulty film, or one without a shot.
    """
    from sysid.vision import Taken, read_camera, track_film

    seen = read_camera(camera)
    tell_doubts(camera, seen.doubts)
    with naming_arguments():
        found = track_film(str(video), Taken.of(seen, camera, fps=fps, mass=mass))
    doubts = [f"not to be trusted: {doubt}" for doubt in found.doubts]
    print("\n".join([*(remark.for_python() for remark in found.remarks), *doubts]), file=sys.stderr)
    if found.clips is None:
        raise BadInput(f"{video}: no shot was found in it: film one from before the strike until the balls rest")
    return found.clips
