"""Off-screen pictures of a table with its balls, drawn by MuJoCo from the MJCF.

`python -m models.mjcf.render OUT.png` draws a full-size snooker table with all balls on their spots.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from models.commands.console import Status
from models.commands.options import FILE_PATH
from models.commands.program import lone_command, run
from models.errors import BadInput
from models.files import write_whole
from models.mjcf.gl import choose_backend, require_rendering

choose_backend()  # before MuJoCo is imported

import cv2  # noqa: E402
import mujoco  # noqa: E402

from models.mjcf.world import CAMERA_NAMES, build_spec  # noqa: E402
from models.shot import Array, Ball, Table  # noqa: E402
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE, racked  # noqa: E402


def render(
    table: Table,
    ball: Ball,
    names: Sequence[str],
    positions: Array,
    *,
    camera: str = "corner",
    size: tuple[int, int] = (1280, 720),
) -> NDArray[np.uint8]:
    """A picture of the balls at these positions: (height, width, 3), red, green, blue.

    Args:
        names: of the balls; they choose the colours.
        positions: (nball, 2) [m], table frame; a ball that is NaN, potted, is not drawn.
        camera: "corner", "overhead" or "baulk".
        size: (width, height) [pixels].
    """
    xy = np.asarray(positions, float)
    if xy.shape != (len(names), 2):
        raise ValueError(f"positions has shape {xy.shape}; {len(names)} balls need ({len(names)}, 2)")
    if camera not in CAMERA_NAMES:
        raise ValueError(f"unknown camera {camera!r}; choose from {', '.join(CAMERA_NAMES)}")
    require_rendering()
    seen = np.isfinite(xy).all(axis=1)
    spec = build_spec(table, ball, [n for n, there in zip(names, seen, strict=True) if there], furnished=True)
    width, height = size
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos.reshape(-1, 7)[:, :2] = xy[seen]
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, height, width) as renderer:
        renderer.update_scene(data, camera)
        return np.array(renderer.render())


def write_png(picture: NDArray[np.uint8], path: Path) -> None:
    """Write a picture, completely or not at all."""
    done, data = cv2.imencode(".png", picture[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])
    if not done:
        raise BadInput(f"{path}: a picture of shape {picture.shape} cannot be encoded")
    write_whole(path, data.tobytes(), parents=True)


@lone_command("models.mjcf.render")
@click.argument("out", metavar="OUT.png", type=FILE_PATH)
@click.option("--camera", type=click.Choice(CAMERA_NAMES), default="corner", show_default=True, help="Viewpoint.")
@click.option("--width", type=int, default=1280, show_default=True, help="Width [pixels]; the height is 9/16 of it.")
def main(out: Path, camera: str, width: int) -> int:
    """Draw a full-size table with all balls of snooker on their spots."""
    places = racked(SNOOKER_TABLE, SNOOKER_BALL)
    xy = np.array(list(places.values()))
    write_png(render(SNOOKER_TABLE, SNOOKER_BALL, tuple(places), xy, camera=camera, size=(width, width * 9 // 16)), out)
    return Status.DONE


if __name__ == "__main__":
    sys.exit(run(main))
