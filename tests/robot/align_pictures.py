"""Pictures of a cue behind a ball with known direction, and how well robot/camera/align.py tells it.

`python -m tests.robot.align_pictures` prints the errors of azimuth. The cue is a cone cut ray by ray: every ray's
nearest approach to the axis says whether it hits, and where around the shaft, so that one side is lit and the other is
not; its shadow is soft and lies beside it. Nothing is shared with what is measured but the camera's numbers: OpenCV's
own functions turn them into rays.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.shot import Table
from sysid.vision.camera.projection import Array, Camera
from tests.footage.cameras import overhead
from tests.footage.film import Look, _picture, table_picture
from tests.footage.motion import Motion

Picture = NDArray[np.uint8]
Light = NDArray[np.float32]
RAISED = math.radians(6.5)
TABLE = Table(3.05, 1.525)
DIAMETER = 0.0525
SIZE = (1280, 960)
WOODEN, DARK, PALE = (0.80, 0.62, 0.38), (0.10, 0.05, 0.04), (0.85, 0.85, 0.82)  # red, green, blue
LEATHER = (0.16, 0.38, 0.55)
LAMP = np.array([0.25, -0.35, 0.9]) / np.linalg.norm([0.25, -0.35, 0.9])
RAYS = 3  # along the side of a pixel
BLUR = 0.6  # of the lens [pixels]
LOOK = Look(noise=0, blur=0)
COLOURS = (("wooden", WOODEN), ("dark", DARK), ("pale", PALE))


@dataclass(frozen=True)
class Stick:
    """A cue at rest."""

    ball: tuple[float, float]  # [m]
    azimuth: float  # in which it would push the ball [rad]
    left: float = 0.0  # of the ball's centre, of its axis [m]
    back: float = 0.05  # of its tip behind the ball's centre, level [m]
    elevation: float = RAISED  # [rad]
    colour: tuple[float, float, float] = WOODEN
    tip: float = 0.0095  # diameter at the tip [m]
    butt: float = 0.029  # and at the butt [m]
    length: float = 1.45  # [m]

    @property
    def axis(self) -> tuple[Array, Array]:
        """Where its tip is (3,) [m], and the way from there to its butt, a unit vector (3,)."""
        c, s = math.cos(self.azimuth), math.sin(self.azimuth)
        foot = np.array([*self.ball, DIAMETER / 2]) + self.left * np.array([-s, c, 0.0])
        level, up = math.cos(self.elevation), math.sin(self.elevation)
        way = np.array([-level * c, -level * s, up])
        return foot + self.back / level * way, way


def camera_over(tilt: tuple[float, float] = (0.01, -0.015), lens: float = -0.08) -> Camera:
    """A camera that sees all of the table."""
    span = 1.15 * TABLE.length + 0.1
    made = overhead(TABLE, DIAMETER, SIZE, 1.1 * span, span, tilt)
    return dataclasses.replace(made, distortion=np.array([lens, -lens / 4, 0.0, 0.0, 0.0]))


def empty(camera: Camera) -> Light:
    """The table alone, (height, width, 3), red, green, blue, 0 to 1: drawn a quarter as large, to save time."""
    scale = np.diag([0.25, 0.25, 1.0])
    small = dataclasses.replace(camera, size=(SIZE[0] // 4, SIZE[1] // 4), matrix=scale @ camera.matrix)
    return np.asarray(cv2.resize(table_picture(small, LOOK), SIZE, interpolation=cv2.INTER_LINEAR), np.float32)


def bare(
    camera: Camera, ground: Light, balls: dict[str, tuple[float, float]], line: float | None = None
) -> Light:  # fmt: skip
    """The table with balls at rest, and with a chalk line across it at x [m]: (height, width, 3), 0 to 255."""
    times = np.array([0.0, 1.0])
    place = np.repeat(np.array(list(balls.values()))[None], 2, axis=0)
    motion = Motion(tuple(balls), times, place, np.tile([0, 0, 0, 1.0], (2, len(balls), 1)))
    seen = 255 * _picture(camera, motion, 0.0, LOOK, ground)[..., ::-1]
    if line is not None:
        corners = [[x, y, 0.0] for x, y in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
        ends = np.array(corners) * [0.0015, TABLE.width / 2, 0] + [line, 0, 0]
        fine = np.zeros((SIZE[1] * 4, SIZE[0] * 4), np.uint8)
        cv2.fillPoly(fine, [np.rint(((_pixels(camera, ends) + 0.5) * 4 - 0.5) * 256).astype(np.int32)], 255, 8, 8)
        part = cv2.resize(fine.astype(np.float32) / 255, SIZE, interpolation=cv2.INTER_AREA)[..., None]
        for x, y in balls.values():  # they lie on it
            middle = _pixels(camera, np.array([[x, y, DIAMETER / 2]]))[0]
            cv2.circle(part, tuple(int(v) for v in np.rint(middle)), 10, 0.0, -1)
        seen = seen * (1 - 0.7 * part) + 0.7 * 230 * part
    return np.asarray(seen, np.float32)


def picture(
    camera: Camera, stick: Stick | None, table: Light, noise: float, rng: np.random.Generator,
    shadow: float = 0.3, hides: float = math.inf,
) -> Picture:  # fmt: skip
    """The cue over the table; `noise` [grey levels], `hides`: from so far behind the tip a machine covers it [m]."""
    seen = table.copy()
    if stick is not None:
        rows, columns = _near(camera, stick)
        sub = (np.arange(RAYS) + 0.5) / RAYS - 0.5
        light = np.zeros((len(rows), 3))
        for dx in sub:
            for dy in sub:
                light += _lit(camera, stick, np.column_stack([columns + dx, rows + dy]), seen[rows, columns], shadow)
        seen[rows, columns] = light / RAYS**2
        if hides < stick.length:
            _machine(camera, stick, hides, seen)
    seen = cv2.GaussianBlur(seen, (0, 0), BLUR)
    seen = seen + noise * rng.standard_normal(seen.shape, dtype=np.float32)
    return np.clip(np.rint(seen), 0, 255).astype(np.uint8)


def _pixels(camera: Camera, points: Array) -> Array:
    found, _ = cv2.projectPoints(points, camera.rotation, camera.translation, camera.matrix, camera.distortion)
    return np.asarray(found).reshape(-1, 2)


def _near(camera: Camera, stick: Stick) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the pixels that cue or shadow may touch."""
    tip, way = stick.axis
    points = tip + np.linspace(-0.02, stick.length + 0.02, 60)[:, None] * way
    shade = points - points[:, 2:] / LAMP[2] * LAMP
    mask = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    for line in (points, shade):
        cv2.polylines(mask, [np.rint(_pixels(camera, line)).astype(np.int32)], False, 255, 16)
    rows, columns = np.nonzero(mask)
    return rows, columns


def _lit(camera: Camera, stick: Stick, pixels: Array, below: Light, shadow: float) -> Array:
    """Colours (n, 3), blue, green, red, at pixels (n, 2) with the table `below` (n, 3)."""
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 15, 1e-9)
    flat = cv2.undistortPoints(pixels[:, None], camera.matrix, camera.distortion, criteria=stop).reshape(-1, 2)
    turn = cv2.Rodrigues(np.asarray(camera.rotation, float))[0]
    ray = np.column_stack([flat, np.ones(len(flat))]) @ turn
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    eye = -turn.T @ camera.translation
    _, way = stick.axis
    along, off, wide = _approach(eye, ray, stick)
    hit = (along > 0) & (along < stick.length) & (np.abs(off) < wide)
    side = np.cross(ray, way)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    part = np.clip(off / np.maximum(wide, 1e-6), -1, 1)[:, None]
    normal = part * side + np.sqrt(1 - part**2) * _facing(side, way, ray)
    shade = 0.35 + 0.65 * np.maximum(normal @ LAMP, 0)
    skin = np.where((along < 0.012)[:, None], LEATHER, stick.colour)[:, ::-1]
    cloth = eye - ray * (eye[2] / ray[:, 2])[:, None]
    far, beside, thick = _approach(cloth, np.tile(LAMP, (len(ray), 1)), stick)
    dark = np.clip((1.6 * thick - np.abs(beside)) / (1.2 * thick), 0, 1) * ((far > 0) & (far < stick.length))
    ground = below * (1 - shadow * dark)[:, None]
    return np.where(hit[:, None], 255 * skin * shade[:, None], ground)


def _facing(side: Array, way: Array, ray: Array) -> Array:
    """Unit vectors (n, 3) square to the axis and to `side`, toward the camera."""
    up = np.cross(side, way)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    return np.asarray(up * np.where(np.sum(up * ray, axis=1, keepdims=True) > 0, -1.0, 1.0))


def _approach(start: Array, ray: Array, stick: Stick) -> tuple[Array, Array, Array]:
    """Where rays (n, 3) pass a cue's axis: how far from its tip, how far beside it, and its radius there [m]."""
    tip, way = stick.axis
    side = np.cross(ray, way)
    sine = np.linalg.norm(side, axis=1)
    away = np.broadcast_to(start - tip, ray.shape)
    off = np.sum(away * side, axis=1) / sine
    cosine = ray @ way
    along = (away @ way - np.sum(away * ray, axis=1) * cosine) / (1 - cosine**2)
    wide = 0.5 * (stick.tip + (stick.butt - stick.tip) * np.clip(along / stick.length, 0, 1))
    return along, off, wide


def _machine(camera: Camera, stick: Stick, hides: float, seen: Light) -> None:
    """A launcher's parts: its guide across the cue, an arm beside it, a beam under and over its butt."""
    tip, way = stick.axis
    right = np.array([math.sin(stick.azimuth), -math.cos(stick.azimuth), 0.0])
    front = hides - 0.35
    for begin, end, low, high, grey in (
        (front, front + 0.018, -0.03, 0.06, 40.0), (front, hides, 0.042, 0.062, 150.0),
        (hides, hides + 0.6, -0.03, 0.03, 150.0),
    ):  # fmt: skip
        corners = [tip + s * way + x * right for s, x in ((begin, low), (begin, high), (end, high), (end, low))]
        cv2.fillPoly(seen, [np.rint(_pixels(camera, np.array(corners))).astype(np.int32)], (grey, grey, grey))


@dataclass(frozen=True)
class Case:
    """A picture and what is true of it."""

    name: str
    stick: Stick
    picture: Picture


def cases(count: int, noises: tuple[float, ...] = (1.0, 3.0, 6.0), seed: int = 0) -> Iterator[Case]:
    """Cues of all colours at all azimuths, anywhere on the table where they are in view."""
    rng = np.random.default_rng(seed)
    camera = camera_over()
    ground = empty(camera)
    for k in range(count):
        colour, skin = COLOURS[k % len(COLOURS)]
        noise = noises[k // len(COLOURS) % len(noises)]
        azimuth = 2 * math.pi * (k + float(rng.uniform(0, 1))) / count
        way = np.array([math.cos(azimuth), math.sin(azimuth)])
        ball = np.round(rng.uniform(-0.85, 0.85, 2) * [TABLE.length / 2, TABLE.width / 2], 4)
        while (np.abs(ball - 0.45 * way) > [1.7, 1.25]).any():
            ball = np.round(rng.uniform(-0.85, 0.85, 2) * [TABLE.length / 2, TABLE.width / 2], 4)
        stick = Stick(
            (float(ball[0]), float(ball[1])), azimuth, float(rng.uniform(-0.012, 0.012)),
            float(rng.uniform(0.035, 0.2)), colour=skin,
        )  # fmt: skip
        others: dict[str, tuple[float, float]] = {}
        for name in ("red", "blue", "black"):
            there = rng.uniform(-0.9, 0.9, 2) * [TABLE.length / 2, TABLE.width / 2]
            if abs(float(way[0] * (there - ball)[1] - way[1] * (there - ball)[0])) > 0.08:
                others[name] = (float(there[0]), float(there[1]))
        machine = k % 4 == 3
        table = bare(camera, ground, {"white": stick.ball, **others}, line=stick.ball[0] if k % 5 == 2 else None)
        seen = picture(camera, stick, table, noise, rng, hides=0.55 if machine else math.inf)
        label = f"{colour}, noise {noise:g}{', launcher' if machine else ''}{', chalk line' if k % 5 == 2 else ''}"
        yield Case(label, stick, seen)


def main() -> int:
    """Print the errors."""
    from models.mjcf.stroke import CUE_TILT
    from sysid.vision import cue_direction

    camera, off, pulls = camera_over(), [], []
    for case in cases(int(sys.argv[1]) if len(sys.argv) > 1 else 36):
        head = f"{case.name:36} {math.degrees(case.stick.azimuth):6.1f}"
        try:
            line = cue_direction(case.picture, camera, np.array(case.stick.ball), CUE_TILT)
        except BadInput as error:
            print(f"{head}  {error}")
            continue
        error = math.remainder(line.azimuth - case.stick.azimuth, 2 * math.pi)
        off.append(math.degrees(error))
        pulls.append(error / line.azimuth_sd)
        beside = 1e3 * (line.offset - case.stick.left)
        print(
            f"{head} {off[-1]:+8.4f} deg, sd {math.degrees(line.azimuth_sd):.4f}, offset {beside:+.2f} mm, "
            f"seen {line.length:.2f} m"
        )
    size = np.abs(off)
    print(f"{len(off)} cues: rms {np.sqrt(np.mean(size**2)):.4f}, median {np.median(size):.4f}, worst {size.max():.4f}")
    print(f"error over sd: rms {np.sqrt(np.mean(np.square(pulls))):.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
