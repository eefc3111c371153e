"""Table, balls and effects -> MjSpec -> MjModel.

The bed is a box that ends at the nose lines, so that a ball leaving through a pocket falls. A cushion is a capsule
whose surface a ball meets at 7R/5, its centre R cos(theta) from the nose line, sin(theta) = 2/5. Everything touches
through explicit pairs of the classes ball_bed, ball_ball and ball_cushion. Purely visual parts are added on demand
(models/mjcf/furniture.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from models.analytic.spring import NOSE_RADIUS
from models.effect import Effect
from models.mjcf.furniture import furnish
from models.shot import NOSE_COSINE, NOSE_SINE, Array, Ball, Table
from models.table.palette import ball_colour

BASE_FILE = Path(__file__).with_name("base.xml")
BED_DEPTH = 0.05  # [m]
CAMERA_NAMES = ("overhead", "corner", "baulk")
BAND_COLOUR, BAND_WIDTH = (0.93, 0.9, 0.82), 0.18  # band of marked balls: colour, half its width over the radius


def colour(name: str) -> tuple[float, float, float]:
    """The colour of a ball by its name, for MJCF: red, green, blue in 0..1."""
    red, green, blue = (round(channel / 255, 3) for channel in ball_colour(name))
    return red, green, blue


@dataclass(frozen=True)
class Rail:
    """A straight piece of cushion."""

    side: str  # "+x", "-x", "+y", "-y"
    start: tuple[float, float]  # on the nose line [m]
    end: tuple[float, float]

    @property
    def outward(self) -> Array:
        """Unit vector from the table into the cushion: (2,)."""
        return np.array([self.side[1] == "x", self.side[1] == "y"]) * (1.0 if self.side[0] == "+" else -1.0)


def rails(table: Table) -> tuple[Rail, ...]:
    """The cushions of a table: four, or six between the pockets."""
    lx, ly = table.length / 2, table.width / 2
    corner = table.shapes.corner.mouth / np.sqrt(2) if table.pockets else 0.0
    middle = table.shapes.middle.mouth / 2
    found = []
    for s, sign in (("+", 1.0), ("-", -1.0)):
        found.append(Rail(f"{s}x", (sign * lx, corner - ly), (sign * lx, ly - corner)))
        if table.pockets:
            found.append(Rail(f"{s}y", (corner - lx, sign * ly), (-middle, sign * ly)))
            found.append(Rail(f"{s}y", (middle, sign * ly), (lx - corner, sign * ly)))
        else:
            found.append(Rail(f"{s}y", (-lx, sign * ly), (lx, sign * ly)))
    return tuple(found)


def pockets(table: Table) -> Array:
    """Centres of the pockets: (6, 2) [m], or (0, 2)."""
    if not table.pockets:
        return np.zeros((0, 2))
    x, y = table.length / 2, table.width / 2
    return np.array([(sx * x, sy * y) for sy in (-1, 1) for sx in (-1, 0, 1)])


def _add_table(spec: mujoco.MjSpec, table: Table, radius: float) -> None:
    """Add the contact geometry of balls: the bed, and a capsule for each nose."""
    lx, ly = table.length / 2, table.width / 2
    depth = BED_DEPTH / 2
    spec.worldbody.add_geom(spec.find_default("bed"), name="bed", size=[lx, ly, depth], pos=[0, 0, -depth])
    height = radius + (radius + NOSE_RADIUS) * NOSE_SINE
    for number, rail in enumerate(rails(table)):
        shift = NOSE_RADIUS * NOSE_COSINE * rail.outward
        ends = [np.append(np.array(p) + shift, height) for p in (rail.start, rail.end)]
        spec.worldbody.add_geom(
            spec.find_default("cushion"),
            name=f"cushion {number} {rail.side}",
            size=[NOSE_RADIUS, 0, 0],
            fromto=np.concatenate(ends),
        )


def add_camera(spec: mujoco.MjSpec, name: str, eye: Array, target: Array, fovy: float) -> None:
    """Add a camera at a place, looking at another, upright: (3,) [m]; fovy [degrees]."""
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross([0.0, 0.0, 1.0], back)
    right = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-6 else np.array([1.0, 0.0, 0.0])
    camera = spec.worldbody.add_camera(name=name, pos=eye, fovy=fovy)
    camera.alt.type = mujoco.mjtOrientation.mjORIENTATION_XYAXES
    camera.alt.xyaxes = np.concatenate([right, np.cross(back, right)])


def build_spec(
    table: Table, ball: Ball, names: Sequence[str], effects: Sequence[Effect] = (), *, furnished: bool = False
) -> mujoco.MjSpec:
    """The world of a table with its balls, edited by the effects in their order; `furnished` for pictures."""
    spec = mujoco.MjSpec.from_file(str(BASE_FILE))
    _add_table(spec, table, ball.radius)
    if furnished:
        noses = [(np.array([rail.start, rail.end]), rail.outward) for rail in rails(table)]
        furnish(spec, table, ball.radius, noses, pockets(table))
    size = np.hypot(table.length, table.width)
    add_camera(spec, "overhead", np.array([0.0, 0.0, 1.05 * table.length]), np.zeros(3), 45.0)
    add_camera(spec, "baulk", np.array([-0.95, 0.0, 0.42]) * size, np.array([-0.06, 0.0, 0.0]) * size, 34.0)
    add_camera(spec, "corner", np.array([-0.62, -0.68, 0.48]) * size, np.array([-0.035, -0.03, -0.07]) * size, 37.0)
    cushions = [g.name for g in spec.geoms if g.name.startswith("cushion")]
    for name in names:
        body = spec.worldbody.add_body(name=name, pos=[0, 0, ball.radius])
        body.add_freejoint(name=name)
        inertia = ball.inertia
        body.explicitinertial = True
        body.mass, body.inertia, body.ipos = ball.mass, [inertia] * 3, [0, 0, 0]
        body.add_geom(spec.find_default("ball"), name=f"ball {name}", size=[ball.radius, 0, 0], rgba=[*colour(name), 1])
    for i, name in enumerate(names):
        spec.add_pair(spec.find_default("ball_bed"), geomname1=f"ball {name}", geomname2="bed")
        for other in names[i + 1 :]:
            spec.add_pair(spec.find_default("ball_ball"), geomname1=f"ball {name}", geomname2=f"ball {other}")
        for cushion in cushions:
            spec.add_pair(spec.find_default("ball_cushion"), geomname1=f"ball {name}", geomname2=cushion)
    for effect in effects:
        effect.edit(spec)
    return spec


def add_bands(spec: mujoco.MjSpec, names: Sequence[str], radius: float) -> None:
    """Add a band about each ball: a disc that stands out of it by a hair."""
    for name in names:
        spec.body(name).add_geom(
            name=f"band {name}", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[1.004 * radius, BAND_WIDTH * radius, 0],
            rgba=[*BAND_COLOUR, 1], contype=0, conaffinity=0,
        )  # fmt: skip
