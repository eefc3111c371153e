"""Repeated pictures of one table, for a policy or a film: compiled once, with one OpenGL context.

models/mjcf/render.py draws one picture, and is simpler to call. A ball that is off the table is below its floor.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco.rendering.classic import gl_context
from numpy.typing import NDArray

from models.errors import BadInput
from models.mjcf.gl import GL_LIBRARIES, require_rendering
from models.mjcf.world import CAMERA_NAMES, build_spec
from models.shot import Array, Ball, Table

HIDDEN_DEPTH_M = 1.0  # depth below the slate of hidden balls


def offscreen(model: mujoco.MjModel, size: tuple[int, int]) -> mujoco.Renderer:
    """A renderer for pictures of (width, height) [pixels], even if MuJoCo was imported before a library was chosen.

    Raises:
        BadInput: if nothing can be drawn, with the packages to install or the variable to set.
    """
    require_rendering()
    if os.environ.get("MUJOCO_GL", "").lower() in GL_LIBRARIES and "glfw" in gl_context.GLContext.__module__:
        importlib.reload(gl_context)  # it reads MUJOCO_GL
    try:
        return mujoco.Renderer(model, size[1], size[0])
    except mujoco.FatalError as error:
        raise BadInput(f"no picture can be drawn ({error}); set MUJOCO_GL=egl, or osmesa") from error


class Painter:
    """A table, its balls, and their renderer."""

    def __init__(self, table: Table, ball: Ball, names: Sequence[str]) -> None:
        """Compile the furnished table; the names choose the balls' colours."""
        self.names, self.radius = tuple(names), ball.radius
        self.model: mujoco.MjModel = build_spec(table, ball, self.names, furnished=True).compile()
        self.data = mujoco.MjData(self.model)
        self._renderer: mujoco.Renderer | None = None

    def draw(
        self, positions: Array, *, camera: str | int = "overhead", size: tuple[int, int] = (320, 240)
    ) -> NDArray[np.uint8]:
        """The balls at positions (nball, 2) [m], nan for none: (height, width, 3), red, green, blue.

        Args:
            positions: table frame.
            camera: "overhead", "corner" or "baulk", or its number, 0 to 2.
            size: (width, height) [pixels].

        Raises:
            BadInput: if nothing can be drawn, for an unknown camera, and for a size beyond 2560 x 1440.
        """
        if camera in range(len(CAMERA_NAMES)):
            camera = CAMERA_NAMES[int(camera)]
        if camera not in CAMERA_NAMES:
            raise BadInput(
                f"unknown camera {camera!r}; choose from {', '.join(CAMERA_NAMES)}, or 0 to {len(CAMERA_NAMES) - 1}"
            )
        (width, height), limit = size, self.model.vis.global_
        if not (0 < width <= limit.offwidth and 0 < height <= limit.offheight):
            raise BadInput(f"a picture of {width} x {height} pixels; give up to {limit.offwidth} x {limit.offheight}")
        xy = np.asarray(positions, float)
        if xy.shape != (len(self.names), 2):
            raise ValueError(f"positions has shape {xy.shape}; {len(self.names)} balls need ({len(self.names)}, 2)")
        seen = np.isfinite(xy).all(axis=1)
        places = self.data.qpos.reshape(-1, 7)
        places[:, :2], places[:, 2] = np.where(seen[:, None], xy, 0.0), np.where(seen, self.radius, -HIDDEN_DEPTH_M)
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        renderer = self._context(width, height)
        renderer.update_scene(self.data, camera)
        return np.array(renderer.render())

    def close(self) -> None:
        """Release the OpenGL context."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _context(self, width: int, height: int) -> mujoco.Renderer:
        if self._renderer is None or (self._renderer.width, self._renderer.height) != (width, height):
            self.close()
            self._renderer = offscreen(self.model, (width, height))
        return self._renderer
