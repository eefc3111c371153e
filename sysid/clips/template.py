"""A clip set to fill in: `clips.toml` with every entry explained, and one clip as an example.

In: a table and its balls. Out: the files of a folder. The example is a ball that rolls along the table's middle,
x = x0 + v t - a t^2 / 2 with the deceleration of snooker cloth (Mathavan, Jackson, Parkin 2009).
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from models.shot import Ball, Table
from models.table.pocket_shape import POCKET_SETS, PocketShapes
from models.table.presets import TableSet
from sysid.clips.names import CLIPS_TOML
from sysid.clips.read import check_clip_set
from sysid.clips.write import assignments, replace_folder

EXAMPLE_FILE = "clips/example.csv"
DEFAULT_FPS = 120.0  # frames per second of the example
SPEED_M_S, DECELERATION_M_S2 = 0.4, 0.125
EXAMPLE_SAMPLES = 240

TEMPLATE_TEXT = """\
# A clip set: tracked shots of one table with one camera. Lengths are in metres, times in seconds, angles in radians.
# x runs along the table, y across, from the table's centre; angles count from +x towards +y, seen from above.
# Check what you have written with: sysid check {folder}
format = "billiard-clips/1"

[table]
length = {length!r}      # from nose to nose of the cushions: measure yours
width = {width!r}
{pockets}
[ball]
diameter = {diameter!r}
mass = {mass!r}          # in kg

[camera]
fps = {fps!r}            # frames taken in a second
# sigma = 0.0005      # noise of a position, one standard deviation, if you know it; else it is estimated

# One block for each shot; this one is an example: replace it by yours.
[[clip]]
file = "{file}"
struck = "cue"            # the ball that the cue strikes, as it is called in the file
# running = true          # where the recording begins in mid-motion: no strike is seen, and there is no cue below
note = "an example"       # optional, whatever you like
# What was commanded, where a robot or a launcher strikes; leave it out for a player. Speed of the ball, direction of
# the aim, contact point right of and above the ball's centre, inclination of the cue:
cue = {{ speed = {speed!r}, azimuth = 0.0, side = 0.0, height = 0.0, elevation = 0.0 }}

# When and under what it was filmed; leave out what you do not know. Hour of the day, degrees Celsius in the room, hours
# of play since the cloth was laid, the number that you give to the table and to the player:
# session = {{ hour = 14.5, temperature = 21.5, cloth_age = 120.0, table = 1, player = 1 }}

# A clip is a CSV: a row for each ball and moment, in order of time, from the strike on. theta, the turned angle of a
# mark on the ball about the vertical, is empty where none is seen. Files of other programs, in other units, or from
# another origin become clips with:
#     sysid import FILES --table ... --out CLIPS
"""


def write_template(folder: Path, known: TableSet, named: str | None) -> None:
    """Write a clip set to fill in; BadInput where another file is in the way.

    Args:
        folder: that it goes to.
        known: table and balls.
        named: the table's name, where its pockets have one.
    """
    replace_folder(folder, template_texts(folder, known, named), lambda new: check_clip_set(new, folder))


def template_texts(folder: Path, known: TableSet, named: str | None) -> dict[str, str]:
    """The files: relative path -> content."""
    table, ball = known.table, known.ball
    text = TEMPLATE_TEXT.format(
        folder=folder, length=round(table.length, 6), width=round(table.width, 6), pockets=_pockets(table, named),
        diameter=round(ball.diameter, 6), mass=round(ball.mass, 6), fps=DEFAULT_FPS, file=EXAMPLE_FILE, speed=SPEED_M_S,
    )  # fmt: skip
    return {CLIPS_TOML: text, EXAMPLE_FILE: _rows(table, ball)}


def _pockets(table: Table, named: str | None) -> str:
    same = [name for name, shapes in POCKET_SETS.items() if shapes == table.pockets]
    if same:
        name = named if named in same else same[0]
        return f'pockets = "{name}"   # or false; [table.pockets] holds the measures of others\n'
    if isinstance(table.pockets, PocketShapes):
        return assignments({"pockets": asdict(table.pockets)})
    return f"pockets = {str(bool(table.pockets)).lower()}          # true: those of snooker, or one of " + (
        ", ".join(f'"{name}"' for name in POCKET_SETS) + "\n"
    )


def _rows(table: Table, ball: Ball) -> str:
    """The example clip: it rolls until it has covered half the table at most."""
    start, lines = -table.length / 4, ["t,ball,x,y,theta"]
    for k in range(EXAMPLE_SAMPLES):
        t = k / DEFAULT_FPS
        way = SPEED_M_S * t - DECELERATION_M_S2 * t**2 / 2
        if way > table.length / 2 - ball.diameter:
            break
        lines.append(f"{t:.6f},cue,{start + way:.6f},0.000000,")
    return "\n".join(lines) + "\n"
