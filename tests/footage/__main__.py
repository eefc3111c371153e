"""Film a clip set of the independent generator: `python -m tests.footage SET OUT.mkv`.

The shots are played again by the program that made them and drawn as a camera over the table would see them, the cue
with them, one after another in a video: lossless in an .mkv, compressed in an .mp4. OUT.camera.toml is the camera,
SET.truth.json the truth.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from models.commands.console import Progress
from models.shot import Array, Table
from sysid.vision.camera.projection import Camera, write_camera
from tests.footage.cameras import aimed, in_view, overhead
from tests.footage.film import Look, Picture, Spot, film
from tests.footage.scenes import LEAD, Scene, scenes

# Around a ball so that some are always in sight, and no two directions look alike.
MARKS = (
    (0.0, 0.5, 1.0), (1.0, 0.0, 0.2), (-0.4, -0.8, 0.3), (-0.5, 0.4, -1.0), (0.3, -0.5, -0.8), (-1.0, 0.1, 0.3),
    (0.2, 0.9, -0.2), (0.6, -0.6, 0.6),
)  # fmt: skip
MARK = 0.3  # half the width of a mark, seen from the ball's centre [rad]
CODES = {".mkv": "FFV1", ".mp4": "mp4v"}
BESIDE = 0.08  # of the table outside its noses, which is always in view [m]
HEIGHT, MARGIN = 1.4, 0.15  # of the camera, in widths of its view; of the view beyond the table, in its length


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser(prog="python -m tests.footage", description="Film clips with known truth.")
    p.add_argument("set", type=Path, metavar="SET", help="clip set made with: python -m tests.truth SET")
    p.add_argument("out", type=Path, metavar="OUT.mkv", help="lossless video (.mkv) or compressed (.mp4)")
    p.add_argument("--size", default="640x400", metavar="WxH", help="of the pictures [pixels] (640x400)")
    p.add_argument("--noise", type=float, default=5.0, metavar="G", help="of the pictures [grey levels] (5)")
    p.add_argument("--blur", type=float, default=0.6, metavar="B", help="of the lens [pixels] (0.6)")
    p.add_argument("--exposure", type=float, default=0.0, metavar="S", help="of a picture [s] (0)")
    p.add_argument("--tilt", type=float, default=0.01, metavar="A", help="of the camera [rad] (0.01)")
    p.add_argument("--lens", type=float, default=-0.08, metavar="K", help="its first radial distortion (-0.08)")
    p.add_argument("--oblique", action="store_true", help="a low lamp: long shadows, dark sides")
    p.add_argument("--guides", action="store_true", help="lines and a ring are projected on the table for every shot")
    p.add_argument("--picks", action="store_true", help="frames are picked from twice as many, at uneven times")
    p.add_argument("--marks", type=int, default=len(MARKS), metavar="N", help="on the struck ball (all)")
    p.add_argument("--seed", type=int, default=0)
    return p


def camera_over(table: Table, diameter: float, size: tuple[int, int], tilt: float, lens: float) -> Camera:
    """A camera over the table that sees all of it unless it is much tilted."""
    length, width = table.length, table.width
    span = max(length, width * size[0] / size[1]) * (1 + MARGIN) + 0.1
    made = overhead(table, diameter, size, HEIGHT * span, span, (tilt, -1.5 * tilt))
    return replace(made, distortion=np.array([lens, -lens / 4, 0.0, 0.0, 0.0]))


def pictures(
    camera: Camera, shots: Sequence[Scene], fps: float, look: Look, seed: int, guides: bool = False,
    picks: bool = False,
) -> Iterator[Picture]:  # fmt: skip
    """All frames of the recording, the first at 0 s; with `picks` every one may be half a period late."""
    for k, (shot, times) in enumerate(zip(shots, moments(shots, fps, seed, picks), strict=True)):
        light = guide_light(camera, shot) if guides else None
        for picture in film(camera, shot.motion, times - shot.struck, look, seed + k):
            yield picture if light is None else cv2.add(picture, light)


def moments(shots: Sequence[Scene], fps: float, seed: int, picks: bool = False) -> list[Array]:
    """When the frames of each shot are taken, in the recording: (n,) [s]."""
    number, rng, found = 0, np.random.default_rng(seed), []
    for shot in shots:
        last = int(np.ceil(shot.ends * fps - 1e-9))
        times = np.arange(number, last) / fps
        found.append(times + (rng.integers(0, 2, len(times)) / (2 * fps) if picks else 0.0))
        number = last
    return found


def guide_light(camera: Camera, shot: Scene) -> Picture:
    """What a projector adds to a picture: the way of the struck ball, a line across it, and a ring where it ends."""
    light = np.zeros((camera.size[1], camera.size[0], 3), np.uint8)
    start = shot.track.position[0, 0]
    way = shot.velocity / max(float(np.hypot(*shot.velocity)), 1e-9)
    ends = [start + 0.05 * way, start + 0.6 * way, start + np.array([0.3, -0.3]), start - np.array([0.3, -0.2])]
    pixels = camera.outline(np.array(ends)).round().astype(int).tolist()
    cv2.line(light, pixels[0], pixels[1], (150, 150, 150), 2, cv2.LINE_AA)
    cv2.line(light, pixels[2], pixels[3], (90, 140, 40), 2, cv2.LINE_AA)
    cv2.circle(
        light, pixels[1], round(float(camera.radius_px(np.array([ends[1]]))[0])), (120, 120, 120), 2, cv2.LINE_AA
    )
    return light


def main(argv: Sequence[str] | None = None) -> int:
    """Film."""
    args = parser().parse_args(argv)
    if args.out.suffix not in CODES:
        parser().error(f"{args.out}: end it in {' or '.join(CODES)}")
    size = tuple(int(v) for v in args.size.split("x"))
    table, diameter, fps, shots = scenes(args.set)
    camera = camera_over(table, diameter, (size[0], size[1]), args.tilt, args.lens)
    camera = camera if in_view(camera, BESIDE) else aimed(camera, (0.0, 0.0), BESIDE)
    marks = {"white": [Spot(place, MARK) for place in MARKS[: args.marks]]}
    look = Look(exposure=args.exposure, noise=args.noise, blur=args.blur, spots=marks)
    if args.oblique:
        look = replace(look, light=(0.9, 0.5, 0.6), shadow=0.5, uneven=0.4)
    where = args.out.with_suffix(".camera.toml")
    write_camera(where, camera)
    writer = cv2.VideoWriter(str(args.out), cv2.VideoWriter_fourcc(*CODES[args.out.suffix]), fps, camera.size)
    progress, count = Progress(), 0
    for count, picture in enumerate(pictures(camera, shots, fps, look, args.seed, args.guides, args.picks), 1):
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
