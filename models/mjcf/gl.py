"""Choice of the OpenGL library for pictures, before MuJoCo is first imported.

MuJoCo and dm_control read MUJOCO_GL on import: if it is unset, dm_control tries a window and warns without a screen; if
it names a missing library, the import itself fails. So every program calls `choose_backend` first. This module
therefore imports neither; it tries each library in a separate process, where a crash does no harm.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import subprocess
import sys

from models.errors import BadInput

RENDERING_NEEDS = "rendering needs the Debian packages libegl1 libgl1, or libosmesa6 (apt install libegl1 libgl1)"

GL_OFF = ("disable", "disabled", "off", "false", "0")  # values that MuJoCo and dm_control both take as no rendering
GL_LIBRARIES = {"egl": ("EGL", "GL"), "osmesa": ("OSMesa",)}  # in order of preference
GL_PACKAGES = {"egl": "libegl1 libgl1", "osmesa": "libosmesa6"}
TRIAL_PROGRAM = """
import mujoco
context = mujoco.GLContext(8, 8)
context.make_current()
mujoco.MjrContext(mujoco.MjModel.from_xml_string("<mujoco/>"), mujoco.mjtFontScale.mjFONTSCALE_50)
context.free()
"""


def choose_backend(render: bool = True) -> str:
    """Set MUJOCO_GL, and return it: "egl", "osmesa" or "disable"; the user's own value is kept.

    `render=False` is for a program that draws nothing: it saves the half second of a trial.
    """
    chosen = os.environ.get("MUJOCO_GL", "").strip().lower()
    if chosen:
        _require_libraries(chosen)
        return chosen
    if not sys.platform.startswith("linux"):
        return ""  # MuJoCo's default there draws off screen
    found = next((name for name in GL_LIBRARIES if render and _draws(name)), "disable")
    os.environ["MUJOCO_GL"] = found
    return found


def can_render() -> bool:
    """True when pictures can be drawn in this process."""
    return choose_backend() not in GL_OFF


def require_rendering() -> None:
    """Raise BadInput, with the packages to install, unless pictures can be drawn."""
    if not can_render():
        raise BadInput(f"MUJOCO_GL is {os.environ['MUJOCO_GL']!r}, so nothing can be drawn: {RENDERING_NEEDS}")


def _draws(backend: str) -> bool:
    """True if MuJoCo gets a context from this back end (0.5 s; immediate if its libraries are missing)."""
    if not all(_loads(library) for library in GL_LIBRARIES[backend]):
        return False
    environment = os.environ | {"MUJOCO_GL": backend, "PYOPENGL_PLATFORM": backend}
    try:
        trial = subprocess.run([sys.executable, "-c", TRIAL_PROGRAM], env=environment, capture_output=True, timeout=60)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return trial.returncode == 0


def _loads(library: str) -> bool:
    """True when the shared library can be loaded."""
    name = ctypes.util.find_library(library)
    try:
        return name is not None and ctypes.CDLL(name) is not None
    except OSError:
        return False


def _require_libraries(backend: str) -> None:
    """Raise BadInput if the libraries of the user's back end are missing."""
    for library in GL_LIBRARIES.get(backend, ()):
        if not _loads(library):
            raise BadInput(
                f"MUJOCO_GL={backend}, but lib{library} cannot be loaded: apt install {GL_PACKAGES[backend]}, "
                "or unset MUJOCO_GL"
            )
