"""A stroke in MuJoCo's interactive viewer, or as a series of pictures.

In: a model, balls and a stroke. Out: a window, in which keys repeat the stroke, or PNG files. The loop here advances
the simulation in real time or slower and the viewer displays it. If the computer cannot keep up, the display runs
slower than real time; no simulation steps are skipped.
"""

from __future__ import annotations

import os
import queue
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from models.errors import BadInput
from models.files import result_folder
from models.model_file import Model
from models.mujoco.world import World
from models.recording.viewer import NO_DISPLAY, display_missing
from models.shot import Array
from planner.launcher.stroke import launch

STRIKE_KEY, RESET_KEY = 32, ord("R")  # key codes of GLFW; 32 is the space bar
FRAME_S = 1 / 60  # time between two frames
MAX_CATCH_UP_S = 0.1  # simulated time per frame; a longer delay is not made up for
KEYS_TEXT = (
    "space strikes again from the current positions, R resets them; double-click a ball and drag with ctrl to push it"
)
Show = Callable[..., AbstractContextManager[Any]]  # mujoco.viewer.launch_passive, or a stand-in


@dataclass(frozen=True)
class Setup:
    """Balls at their positions, and the stroke to play."""

    names: tuple[str, ...]  # the ball to be struck first
    position: Array  # (n, 2) [m]
    stroke: tuple[float, float, float, float]  # speed [m/s], azimuth [rad], side, height [m], as launcher/stroke.py
    swerve: float  # offset that stands for the spin about the aim [m]


class ViewedWorld:
    """A world, its MjData, and the stroke to play."""

    def __init__(self, model: Model, setup: Setup) -> None:
        """Compile the table with its furniture, and place the balls."""
        self.setup = setup
        self.world = World(model, setup.names, jaws=bool(model.table.pockets), furnished=True, marked=True)
        self.velocity, self.spin = launch(np.array([setup.stroke]), np.array([setup.swerve]), model.ball)
        self.data = mujoco.MjData(self.world.mj_model)
        self.reset()

    def reset(self) -> None:
        """Move the balls back to their initial positions."""
        self.world.place(dict(zip(self.setup.names, self.setup.position, strict=True)), self.data)

    def strike(self) -> None:
        """Play the stroke from the current positions; from the initial ones if the ball to be struck was potted."""
        if self.setup.names[0] not in self.world.in_play(self.data):
            self.reset()
        self.world.strike(self.data, self.velocity[0], self.spin[0])

    def press(self, key: int) -> None:
        """Execute the action of a key."""
        if key == STRIKE_KEY:
            self.strike()
        elif key == RESET_KEY:
            self.reset()


def watch(
    session: ViewedWorld, show: Show, *, pace: float = 1.0, clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> None:  # fmt: skip
    """Play in a viewer until it is closed; the first stroke starts immediately.

    Args:
        session: the session to play.
        show: opens a viewer, such as mujoco.viewer.launch_passive.
        pace: simulated seconds per second of the clock.
        clock: returns the time [s].
        sleep: waits [s].
    """
    pressed: queue.SimpleQueue[int] = queue.SimpleQueue()  # the viewer calls from its own thread
    panels = {"show_left_ui": False, "show_right_ui": False}  # Tab shows them
    with show(session.world.mj_model, session.data, key_callback=pressed.put, **panels) as viewer:
        size = float(np.hypot(session.world.model.table.length, session.world.model.table.width))
        with viewer.lock():
            viewer.cam.lookat[:] = 0.0
            viewer.cam.distance, viewer.cam.azimuth, viewer.cam.elevation = 0.85 * size, 45.0, -40.0
            session.strike()
        last, due = clock(), 0.0
        while viewer.is_running():
            now = clock()
            due, last = due + min(pace * (now - last), MAX_CATCH_UP_S), now
            with viewer.lock():
                while not pressed.empty():
                    session.press(pressed.get())
                until = session.data.time + due
                session.world.advance(session.data, until)
            due = until - session.data.time
            viewer.sync()
            sleep(FRAME_S)


def require_display() -> None:
    """Raise BadInput, in one line, if no window can be opened."""
    remedy = "run it on a desktop, or write pictures: --frames 50 --out DIR"
    if display_missing():
        raise BadInput(f"{NO_DISPLAY}; {remedy}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it warns in addition to returning the failure
        import glfw

        if not glfw.init():
            raise BadInput(f"no window can be opened on display {os.environ.get('DISPLAY', '')!r}; {remedy}")


def open_viewer(session: ViewedWorld, pace: float) -> None:
    """Play in MuJoCo's viewer until its window is closed.

    Raises:
        BadInput: if no window can be opened.
    """
    require_display()
    import mujoco.viewer

    try:
        watch(session, mujoco.viewer.launch_passive, pace=pace)
    except RuntimeError as error:
        if "mjpython" in str(error):
            raise BadInput("on macOS the viewer runs under mjpython: mjpython -m planner.cli view ...") from error
        raise


def write_frames(
    session: ViewedWorld, folder: Path, count: int, fps: float, camera: str, size: tuple[int, int]
) -> Sequence[Path]:  # fmt: skip
    """Pictures of the stroke, 0001.png and so on, the first as the ball is struck.

    Raises:
        BadInput: if nothing can be drawn, or the folder cannot be created.
    """
    from models.mjcf.painter import offscreen
    from models.mjcf.render import write_png

    renderer = offscreen(session.world.mj_model, size)
    result_folder(folder)
    world, data, written = session.world, session.data, []
    session.strike()
    begin = data.time
    with renderer:
        for number in range(count):
            world.advance(data, begin + number / fps)
            renderer.update_scene(data, camera)
            written.append(folder / f"{number + 1:04d}.png")
            write_png(np.array(renderer.render()), written[-1])
    return written
