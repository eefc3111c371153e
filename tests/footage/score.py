"""What tracking made of footage, held against the truth: `python -m tests.footage.score SET TRACK.json CLIPS CAM`.

SET is the clip set that was filmed, TRACK.json and CLIPS are what `sysid track --json TRACK.json --out CLIPS` wrote,
CAM the camera file.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from models.commands.console import table
from models.shot import NOSE_COSINE, Array
from sysid.clips import Clip, read_clip_set
from sysid.vision.camera.projection import Camera, read_camera
from tests.footage.scenes import Scene, scenes

SAME = 0.1  # between the strike of a clip and that of the shot it shows [s]
NEAR = 2.0  # radii between surfaces within which a ball is near another, or a cushion
SPUN = 10.0  # least sidespin that is counted [rad/s]
PLACE = 0.3  # speed below which a ball spins in place [m/s]


@dataclass
class Score:
    """Errors of all clips that were found, and what was not."""

    shots: int = 0
    clips: int = 0
    lost: int = 0  # samples that should be there
    swapped: int = 0  # samples that lie a radius or more from the ball
    free: list[Array] = field(default_factory=list)  # errors along both axes [pixels]
    near: list[Array] = field(default_factory=list)
    in_place: list[float] = field(default_factory=list)  # of the rate of turning, in parts of it
    rolling: list[float] = field(default_factory=list)
    speed: list[float] = field(default_factory=list)  # of the cue, in parts of it
    azimuth: list[float] = field(default_factory=list)  # of the cue [rad]

    def rows(self) -> list[tuple[str, ...]]:
        """The figures as a table."""
        near, free = (np.concatenate(e) if e else np.zeros(0) for e in (self.near, self.free))

        def rms(values: Array, unit: str, scale: float = 1.0) -> str:
            return f"{scale * float(np.sqrt(np.mean(values**2))):.3f} {unit}" if values.size else "-"

        def worst(values: Sequence[float], unit: str, scale: float) -> str:
            size = np.abs(values)
            return f"{scale * float(np.median(size)):.3f} {unit}, worst {scale * size.max():.3f}" if size.size else "-"

        return [
            ("figure", "measured", "of"),
            ("shots found", str(self.clips), str(self.shots)),
            ("samples lost; swapped", f"{self.lost}; {self.swapped}", str((near.size + free.size) // 2)),
            ("centre, free, rms per axis", rms(free, "px"), str(free.size // 2)),
            ("centre, within 2 radii of a ball or cushion", rms(near, "px"), str(near.size // 2)),
            ("rate of turning, in place, median", worst(self.in_place, "%", 100), str(len(self.in_place))),
            ("rate of turning, rolling, median", worst(self.rolling, "%", 100), str(len(self.rolling))),
            ("cue speed, median", worst(self.speed, "%", 100), str(len(self.speed))),
            ("cue direction, median", worst(self.azimuth, "deg", float(np.degrees(1))), str(len(self.azimuth))),
        ]


def score(set_: Path, told: Path, clips: Path, cam: Path) -> Score:
    """The errors of tracked clips."""
    camera = read_camera(cam)
    _, _, fps, shots = scenes(set_)
    rows = json.loads(told.read_text(encoding="utf-8"))["clips"]
    found = Score(shots=len(shots))
    for clip, row in zip(read_clip_set(clips).clips, rows, strict=True):
        shot = min(shots, key=lambda s: abs(s.struck - row["time"]))
        if abs(shot.struck - row["time"]) > SAME:
            found.swapped += sum(row["samples"].values())
            continue
        found.clips += 1
        _places(found, shot, clip, row["frames"], fps, camera)
        for name, marks in row["marks"].items():
            if (told := marks["sidespin"]) is not None and name in shot.track.names:
                ends = shot.turned(name, np.array([told["from"], told["to"]]))
                if abs(true := float(np.diff(ends)[0] / (told["to"] - told["from"]))) > SPUN:
                    into = found.in_place if np.hypot(*shot.velocity) < PLACE else found.rolling
                    into.append(told["value"] / true - 1)
        cue = row["cue"]
        if cue and shot.motion.cue and np.isfinite(cue["speed"]):
            found.speed.append(cue["speed"] / shot.motion.cue.speed - 1)
            found.azimuth.append(
                float(np.remainder(cue["azimuth"] - shot.motion.cue.azimuth + np.pi, 2 * np.pi) - np.pi)
            )
    return found


def _places(found: Score, shot: Scene, clip: Clip, frames: Sequence[int], fps: float, camera: Camera) -> None:
    """Errors of the places and turns of one clip."""
    scale = float(camera.radius_px(np.zeros((1, 2)))[0]) / camera.radius
    half = np.array([camera.table.length, camera.table.width]) / 2 - camera.radius * NOSE_COSINE
    begin = frames[0] / fps
    for name, seen in clip.balls.items():
        if name not in shot.track.names:
            found.swapped += len(seen.time)
            continue
        at = begin + clip.origin + seen.time
        true = shot.places(name, at)
        off = seen.xy - true
        wrong = ~(np.hypot(*off.T) < camera.radius)
        found.swapped += int(wrong.sum())
        every = np.arange(frames[0], min(frames[1], int(shot.ends * fps - 1e-6)) + 1) / fps
        found.lost += max(int(np.isfinite(shot.places(name, every)[:, 0]).sum()) - len(at), 0)
        gap = (half - np.abs(true)).min(axis=1)
        for other in shot.track.names:
            if other != name:
                gap = np.fmin(gap, np.linalg.norm(shot.places(other, at) - true, axis=1) - 2 * camera.radius)
        near = gap < NEAR * camera.radius
        found.near.append((scale * off[near & ~wrong]).ravel())
        found.free.append((scale * off[~near & ~wrong]).ravel())


def main(argv: Sequence[str] | None = None) -> int:
    """Print the figures."""
    p = argparse.ArgumentParser(prog="python -m tests.footage.score", description="Tracked clips against the truth.")
    p.add_argument("set", type=Path, metavar="SET", help="the clip set that was filmed")
    p.add_argument("told", type=Path, metavar="TRACK.json")
    p.add_argument("clips", type=Path, metavar="CLIPS")
    p.add_argument("camera", type=Path, metavar="CAM.toml")
    args = p.parse_args(argv)
    print(table(score(args.set, args.told, args.clips, args.camera).rows()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
