"""The result of tracking a film: as text, as JSON and as a recording.

In: the result of tracking, remarks, cues and marks. Out: lines, `billiard-track/1`, and a file for Rerun.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from models.commands.console import table
from models.messages import counted
from sysid.vision.camera.projection import Camera
from sysid.vision.details import Details
from sysid.vision.frames import Footage
from sysid.vision.tracks.clips import note
from sysid.vision.tracks.noise import residuals
from sysid.vision.tracks.track import Tracked, lost_frames

JSON_FORMAT = "billiard-track/1"
TABLE_HEAD = ("clip", "time [s]", "struck", "balls", "samples", "lost", "speed [m/s]", "noise [mm]", "remark")


def rows(result: Tracked) -> list[dict[str, Any]]:
    """The figures of each clip, for the table and the JSON file."""
    found = []
    for number, (shot, seen) in enumerate(zip(result.shots, result.found, strict=True), 1):
        lost = {name: lost_frames(result.scene, shot, path, which) for name, (path, which) in seen.items()}
        found.append({
            "clip": number, "time": shot.time, "struck": None if shot.running else shot.struck,
            "running": list(shot.running), "balls": list(seen),
            "samples": {name: int(which.size) for name, (_, which) in seen.items()}, "lost": lost,
            "speed": shot.speed, "remarks": list(shot.remarks), "frames": [shot.first, shot.last],
        })  # fmt: skip
    return found


def to_json(video: str, result: Tracked, remarks: Sequence[str], seen: Sequence[Details]) -> dict[str, Any]:
    """All figures."""
    clips = [{**row, **_detail(one)} for row, one in zip(rows(result), seen, strict=True)]
    return {
        "format": JSON_FORMAT, "video": video, "frames": len(result.scene.frames), "rate": result.rate,
        "noise": {"moving": result.noise.moving, "resting": result.noise.resting, "sigma": result.noise.sigma,
                  "balls": dict(result.noise.balls)},
        "places": {"rms": result.places.rms, **asdict(result.places)},
        "clips": clips, "left_out": list(result.left_out), "remarks": list(remarks), "doubts": list(result.doubts),
    }  # fmt: skip


def _detail(one: Details) -> dict[str, Any]:
    """Cue and marks of a clip."""
    c = one.cue
    cue = None if c is None else {
        "speed": c.speed, "speed_sd": c.speed_sd, "azimuth": c.azimuth, "azimuth_sd": c.azimuth_sd, "side": c.side,
        "side_sd": c.side_sd, "contact": c.contact, "remarks": list(c.notes),
    }  # fmt: skip
    marks = {}
    for name, t in one.turned.items():
        marks[name] = {"angles": _count(t.theta), "kept": _count(t.steady), "remarks": list(t.notes), "sidespin": None}
        if (first := t.sidespin) is not None:
            marks[name]["sidespin"] = {
                "from": first.start, "to": first.end, "value": first.spin, "sd": first.spin_sd,
            }  # fmt: skip
    return {"cue": cue, "marks": marks}


def _count(values: Iterable[float]) -> int:
    """The number of known values."""
    return sum(math.isfinite(value) for value in values)


def detail_lines(seen: Sequence[Details]) -> list[str]:
    """Lines on the cues and the marked balls."""
    lines = []
    for number, one in enumerate(seen, 1):
        if one.tip:
            lines.append(f"clip {number}: {one.tip}")
        lines += [f"clip {number}: cue: {text}" for text in (one.cue.notes if one.cue else ())]
        for name, turned in one.turned.items():
            count, used = _count(turned.theta), _count(turned.steady)
            first = turned.sidespin
            rate = f"; initial sidespin {first.spin:+.2f} +- {first.spin_sd:.2f} rad/s" if first is not None else ""
            lines.append(f"clip {number}: {name}: rotation angle known in {count} of {len(turned.theta)} frames{rate}")
            if used < count:
                drift = max(d for d in turned.drift if d == d)
                lines.append(
                    f"clip {number}: {name}: {used or 'none'} of these angles are written into the clip: the others "
                    f"may have drifted as the ball rolled, by {drift:.2f} rad at the end"
                )
            lines += [f"clip {number}: {name}: {text}" for text in turned.notes]
    return lines


def lines(result: Tracked, remarks: Sequence[str], seen: Sequence[Details]) -> list[str]:
    """The remarks, the noise, a table of the clips, what was left out, cues and marks."""
    noise = result.noise
    found, balls = len(result.scene.frames), counted(len(result.scene.tracks), "ball")
    frames = f"{counted(found, 'frame')}, {counted(round(result.rate), 'frame')} processed a second"
    text = [*remarks, f"{balls} tracked over {frames}", noise.text()]
    each = ", ".join(f"{name} {1e3 * sd:.3f} mm" for name, sd in noise.balls.items())
    if each:
        text.append(f"of each moving ball: {each}")
    text.append(f"{result.places.text()}\n" if result.shots else "")
    cells = [TABLE_HEAD]
    for row in rows(result):
        cells.append((
            str(row["clip"]), f"{row['time']:.2f}", row["struck"] or "-", " ".join(row["balls"]),
            str(sum(row["samples"].values())), str(sum(row["lost"].values())), f"{row['speed']:.3f}",
            f"{1e3 * noise.sigma:.3f}" if math.isfinite(noise.sigma) else "-", "; ".join(row["remarks"]),
        ))  # fmt: skip
    if len(cells) > 1:
        text.append(table(cells))
    return [*text, *result.left_out, *detail_lines(seen)]


def write_recording(path: Path, video: str, result: Tracked, footage: Footage, camera: Camera) -> None:
    """The recording for Rerun."""
    from models.recording.video import Sightings, write_track

    scene = result.scene
    balls = {
        p.name: Sightings(p.frame, p.time, p.pixels, p.radius, p.xy, residuals(p.time, p.xy)) for p in scene.tracks
    }
    shots = [(scene.time_of(s.first), scene.time_of(s.last), note(k, s)) for k, s in enumerate(result.shots, 1)]
    write_track(
        path, video, (scene.frames, scene.times), lambda: (frame.picture for frame in footage), balls,
        shots, camera.table, camera.diameter,
    )  # fmt: skip
