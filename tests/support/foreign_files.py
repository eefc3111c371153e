"""Files as other trackers write them, made from a clip set of known truth."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Sequence
from pathlib import Path

Row = tuple[float, str, float, float]  # t, ball, x, y
LENGTH, WIDTH, FPS = 3.569, 1.778, 120.0


def rows_of(file: Path) -> list[Row]:
    """The rows of a clip."""
    with file.open(newline="") as text:
        return [(float(r["t"]), r["ball"], float(r["x"]), float(r["y"])) for r in csv.DictReader(text)]


def write_foreign(source: Path, folder: Path, suffix: str, text: Callable[[Sequence[Row]], str]) -> list[Path]:
    """All clips of a set in the form that `text` gives them."""
    folder.mkdir(parents=True)
    files = []
    for file in sorted((source / "clips").glob("*.csv")):
        files.append(folder / f"shot_{file.stem}{suffix}")
        files[-1].write_text(text(rows_of(file)), encoding="utf-8")
    return files


def long_mm(rows: Sequence[Row]) -> str:
    """A row a ball, millimetres from a corner, y downwards, times in frames, after half a second of rest."""
    first = {ball: (x, y) for _, ball, x, y in reversed(rows)}
    frames = [(k, ball, *first[ball]) for k in range(60) for ball in first]
    frames += [(60 + round(t * FPS), ball, x, y) for t, ball, x, y in rows]
    lines = [f"{k},{ball},{1e3 * (x + LENGTH / 2):.2f},{1e3 * (WIDTH / 2 - y):.2f},0.9" for k, ball, x, y in frames]
    return "\n".join(["frame,id,x_mm,y_mm,score", *lines]) + "\n"


def wide_inches(rows: Sequence[Row]) -> str:
    """A row a frame, inches from the centre, x along the width, semicolons and decimal commas, empty where unseen."""
    balls = sorted({ball for _, ball, _, _ in rows})
    places = {(t, ball): (-y / 0.0254, x / 0.0254) for t, ball, x, y in rows}
    lines = ["# tracker 3.1", ";".join(["Time (s)", *(f"{ball}_{axis}" for ball in balls for axis in "xy")])]
    for t in sorted({t for t, _, _, _ in rows}):
        cells = [f"{v:.4f}" for ball in balls for v in places.get((t, ball), ())] if len(balls) == 1 else []
        for ball in balls if len(balls) > 1 else []:
            cells += [f"{v:.4f}" for v in places[t, ball]] if (t, ball) in places else ["", ""]
        lines.append(";".join([f"{t:.6f}", *cells]).replace(".", ","))
    return "\n".join(lines) + "\n"


def nested_json(rows: Sequence[Row]) -> str:
    """Frames with a list of balls each, milliseconds and metres from a corner."""
    frames: dict[float, list[dict[str, object]]] = {}
    for t, ball, x, y in rows:
        place = [round(x + LENGTH / 2, 6), round(y + WIDTH / 2, 6)]
        frames.setdefault(round(1e3 * t, 3), []).append({"id": ball, "position": place})
    return json.dumps({"video": "a.mp4", "frames": [{"timestamp": t, "balls": balls} for t, balls in frames.items()]})


def arrays_json(rows: Sequence[Row]) -> str:
    """An object for each ball with its columns, centimetres from the centre."""
    balls: dict[str, dict[str, list[float]]] = {}
    for t, ball, x, y in rows:
        own = balls.setdefault(ball, {"t": [], "x": [], "y": []})
        for key, value in zip("txy", (t, 100 * x, 100 * y), strict=True):
            own[key].append(round(value, 5))
    return json.dumps({"balls": balls})
