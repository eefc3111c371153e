"""Film a clip set of the independent generator: `python -m tests.footage SET OUT.mkv`.

The shots are played again by the program that made them and drawn as a camera over the table would see them, the cue
with them, one after another in a lossless video. OUT.camera.toml is the camera, SET.truth.json the truth.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from models.shot import Table
from sysid.output import Progress
from sysid.vision.camera import Camera, overhead, write_camera
from sysid.vision.film import Look, Picture, Spot, film
from tests.footage.scenes import LEAD, Scene, scenes

# Around a ball so that some are always in sight, and no two directions look alike.
MARKS = (
    (0.0, 0.5, 1.0), (1.0, 0.0, 0.2), (-0.4, -0.8, 0.3), (-0.5, 0.4, -1.0), (0.3, -0.5, -0.8), (-1.0, 0.1, 0.3),
    (0.2, 0.9, -0.2), (0.6, -0.6, 0.6),
)  # fmt: skip
MARK = 0.3  # half the width of a mark, seen from the ball's centre [rad]
HEIGHT, MARGIN = 1.4, 0.15  # of the camera, in widths of its view; of the view beyond the table, in its length


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser(prog="python -m tests.footage", description="Film clips with known truth.")
    p.add_argument("set", type=Path, metavar="SET", help="clip set made with: python -m tests.truth SET")
    p.add_argument("out", type=Path, metavar="OUT.mkv", help="lossless video")
    p.add_argument("--size", default="640x400", metavar="WxH", help="of the pictures [pixels] (640x400)")
    p.add_argument("--noise", type=float, default=5.0, metavar="G", help="of the pictures [grey levels] (5)")
    p.add_argument("--blur", type=float, default=0.6, metavar="B", help="of the lens [pixels] (0.6)")
    p.add_argument("--exposure", type=float, default=0.0, metavar="S", help="of a picture [s] (0)")
    p.add_argument("--tilt", type=float, default=0.01, metavar="A", help="of the camera [rad] (0.01)")
    p.add_argument("--lens", type=float, default=-0.08, metavar="K", help="its first radial distortion (-0.08)")
    p.add_argument("--marks", type=int, default=len(MARKS), metavar="N", help="on the struck ball (all)")
    p.add_argument("--seed", type=int, default=0)
    return p


def camera_over(table: Table, diameter: float, size: tuple[int, int], tilt: float, lens: float) -> Camera:
    """A camera over the table that sees all of it."""
    length, width = table.length, table.width
    span = max(length, width * size[0] / size[1]) * (1 + MARGIN) + 0.1
    made = overhead(table, diameter, size, HEIGHT * span, span, (tilt, -1.5 * tilt))
    return replace(made, distortion=np.array([lens, -lens / 4, 0.0, 0.0, 0.0]))


def pictures(camera: Camera, shots: Sequence[Scene], fps: float, look: Look, seed: int) -> Iterator[Picture]:
    """All frames of the recording, the first at 0 s."""
    number = 0
    for k, shot in enumerate(shots):
        last = int(np.ceil(shot.ends * fps - 1e-9))
        times = np.arange(number, last) / fps - shot.struck
        number = last
        yield from film(camera, shot.motion, times, look, seed + k)


def main(argv: Sequence[str] | None = None) -> int:
    """Film."""
    args = parser().parse_args(argv)
    size = tuple(int(v) for v in args.size.split("x"))
    table, diameter, fps, shots = scenes(args.set)
    camera = camera_over(table, diameter, (size[0], size[1]), args.tilt, args.lens)
    marks = {"white": [Spot(place, MARK) for place in MARKS[: args.marks]]}
    look = Look(exposure=args.exposure, noise=args.noise, blur=args.blur, spots=marks)
    where = args.out.with_suffix(".camera.toml")
    write_camera(where, camera)
    writer = cv2.VideoWriter(str(args.out), cv2.VideoWriter_fourcc(*"FFV1"), fps, camera.size)
    progress, count = Progress(), 0
    for count, picture in enumerate(pictures(camera, shots, fps, look, args.seed), 1):
        writer.write(picture)
        progress(f"{count} frames of {shots[-1].ends * fps:.0f}")
    writer.release()
    progress.close()
    radius = float(camera.radius_px(np.zeros((1, 2)))[0])
    print(
        f"{args.out}: {count} frames, {len(shots)} shots, strikes {LEAD} s into each; balls {radius:.1f} px in radius"
    )
    print(f"camera: {where}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
