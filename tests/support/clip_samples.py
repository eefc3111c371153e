"""A small clip set on disk for tests, and what they do with it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from models.errors import BadInput

SETTINGS = """format = "billiard-clips/1"

[table]
length = 3.569
width = 1.778

[ball]
diameter = 0.0525
mass = 0.1406

[camera]
fps = 120.0
sigma = 0.0005

[[clip]]
file = "clips/1.csv"
struck = "cue"
note = "draw"
cue = { speed = 1.9, azimuth = 0.5, side = 0.004 }

[[clip]]
file = "clips/2.csv"
struck = "cue"
"""
ROWS = """t,ball,x,y,theta
0.000,cue,0.1,0.2,0.0
0.000,red,0.5,0.2,
0.010,cue,0.11,0.2,0.1
0.010,red,0.5,0.2,
0.020,cue,0.12,0.2,
0.030,cue,0.13,0.2,0.3
"""
FILES = ("clips.toml", "clips/1.csv", "clips/2.csv")


def make(folder: Path) -> Path:
    (folder / "clips").mkdir(parents=True, exist_ok=True)
    for file, text in zip(FILES, (SETTINGS, ROWS, ROWS), strict=True):
        (folder / file).write_text(text)
    return folder


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def refusal(action: Callable[[], object]) -> str:
    """The message of the BadInput that an action ends in: one printable line."""
    with pytest.raises(BadInput) as caught:
        action()
    message = str(caught.value)
    assert message.isprintable()
    assert len(message) < 900
    return message


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}
