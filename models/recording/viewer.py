"""The Rerun viewer as a program beside this one: opened on a recording, fed while work goes on, or asked for pictures.

It is the viewer of this installation, listens to this machine alone, and sends its makers no usage data. Pictures and
films are taken of a viewer without a window, which needs Vulkan, if only Mesa's software.
"""

from __future__ import annotations

import contextlib
import math
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

import cv2
import numpy as np

from models.errors import BadInput
from models.files import scratch_folder, write_whole
from models.recording.file import silent_stream

VIEWER_PROGRAM = "rerun"
THIS_MACHINE = "127.0.0.1"  # by default the viewer listens to every network
START_S, LOAD_S = 20.0, 60.0  # in which it answers, and has read a recording
WINDOW_S = 2.0  # after it answers, in which it ends if it can open no window
SETTLE_S = 7.0  # after which it has drawn all, and its notices are gone
POLL_S = 0.1
LIVE_MEMORY = "1GB"  # of a viewer that is fed, beyond which it drops what is oldest
LIVE_OPTIONS = ("--memory-limit", LIVE_MEMORY, "--server-memory-limit", LIVE_MEMORY, "--hide-welcome-screen")
PICTURE_SIZE_PX = (1600, 900)
FILM_SIZE_PX = (1280, 720)
FILM_HZ, FILM_S = 10.0, 12.0  # pictures in a second of a film, and its length at most
STEP_S = 1.0  # for which a film shows a step of a timeline that counts
LOG_LEVEL = "RUST_LOG"  # the variable
SETTINGS_HOME, SETTINGS_FILE = "XDG_CONFIG_HOME", "rerun/analytics.json"  # the variable, and a file below it
NO_DISPLAY = "there is no display (DISPLAY is not set)"


def display_missing() -> bool:
    """Whether no window can be opened here, for want of a display."""
    return sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def viewer_program() -> str:
    """The viewer of this installation, else that of the shell; BadInput where there is none."""
    beside = Path(sys.executable).with_name(VIEWER_PROGRAM)
    found = str(beside) if beside.is_file() else shutil.which(VIEWER_PROGRAM)
    if found is None:
        raise BadInput(f"{VIEWER_PROGRAM}: the viewer is not installed; pip install rerun-sdk")
    return found


def open_viewer(recording: Path, *, web: bool) -> bool:
    """Show a recording until the viewer is closed; whether that went well."""
    port = _free_port()
    words = [viewer_program(), str(recording), "--bind", THIS_MACHINE, "--port", str(port)]
    if web:
        page = _free_port()
        words += ["--web-viewer", "--web-viewer-port", str(page)]
        print(f"review: {_page_address(page, _feed_address(port))} until Ctrl-C", flush=True)
    return subprocess.run(words, check=False, env={LOG_LEVEL: "warn", **os.environ, **own_settings()}).returncode == 0


def own_settings() -> dict[str, str]:
    """Variables by which the viewer has settings of its own, in which usage data are switched off."""
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    own = {SETTINGS_HOME: str(Path(cache) / "cuelab" / "viewer")}
    if not (Path(own[SETTINGS_HOME]) / SETTINGS_FILE).is_file():
        words = [viewer_program(), "analytics", "disable"]
        subprocess.run(words, check=False, env={**os.environ, **own}, capture_output=True)
    return own


def _feed_address(port: int) -> str:
    """Where a viewer takes what it shows."""
    return f"rerun+http://{THIS_MACHINE}:{port}/proxy"


def _page_address(page: int, feed: str) -> str:
    """Where a browser shows it."""
    return f"http://{THIS_MACHINE}:{page}?url={quote(feed, safe='')}"


@dataclass(frozen=True)
class Feed:
    """A viewer that is fed while work goes on."""

    url: str
    streams: list[Any] = field(default_factory=list)

    def stream(self, application: str, title: str, blueprint: Any) -> Any:
        """A new recording in it, which it shows from its beginning on."""
        stream = silent_stream(application, None)
        self.streams.append(stream)
        stream.connect_grpc(self.url, default_blueprint=blueprint)
        stream.send_recording_name(title)
        return stream


@contextlib.contextmanager
def live_viewer(*, web: bool) -> Iterator[Feed]:
    """A viewer to be fed, its window open or its page in the browser; the window stays when the work has ended.

    Raises:
        BadInput: no window can be opened, or the viewer does not start.
    """
    if display_missing() and not web:
        raise BadInput(f"--live: {NO_DISPLAY}; add --web for a browser, or leave --live out")
    page = _free_port()
    options = ("--web-viewer", "--web-viewer-port", str(page)) if web else ()
    with _started((*LIVE_OPTIONS, *options), "--live", stays=not web) as url:
        if web:  # where the viewer knows of no browser, it opens none
            print(f"live: {_page_address(page, url)}", flush=True)
        os.environ.setdefault(LOG_LEVEL, "off")  # of the sender: it is no fault that a viewer is closed early
        feed = Feed(url)
        try:
            yield feed
        finally:  # all that was sent arrives before a page's server ends
            for stream in feed.streams:
                stream.disconnect()


@contextlib.contextmanager
def _started(options: Sequence[str], what: str, *, stays: bool = False) -> Iterator[str]:
    """A viewer that listens at the address it gives; BadInput names `what` where it does not start."""
    port = _free_port()
    words = [viewer_program(), "--bind", THIS_MACHINE, "--port", str(port), *options]
    with scratch_folder() as folder, (folder / "said").open("w+b") as said:
        running = subprocess.Popen(
            words, stdout=said, stderr=said, stdin=subprocess.DEVNULL, start_new_session=True,
            env={**os.environ, **own_settings()},
        )  # fmt: skip
        well = False
        try:
            _until(lambda: running.poll() is not None or _listens(port), START_S)
            if stays:  # it listens before it opens its window
                _until(lambda: running.poll() is not None, WINDOW_S)
            if running.poll() is not None or not _listens(port):
                said.seek(0)
                raise BadInput(f"{what}: the viewer does not start ({_last_line(said.read())})")
            yield _feed_address(port)
            well = True
        finally:
            if not (well and stays):  # the program is a wrapper: its whole group ends
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(running.pid, signal.SIGTERM)
                running.wait()
                _until(lambda: not _listens(port), START_S)


def _free_port() -> int:
    with socket.socket() as free:
        free.bind((THIS_MACHINE, 0))
        return int(free.getsockname()[1])


def _listens(port: int) -> bool:
    try:
        socket.create_connection((THIS_MACHINE, port), POLL_S).close()
    except OSError:
        return False
    return True


def _until(done: Callable[[], bool], limit: float) -> bool:
    """Wait until something is done, for a time at most [s]; whether it is."""
    end = time.monotonic() + limit
    while not done():
        if time.monotonic() > end:
            return False
        time.sleep(POLL_S)
    return True


def _last_line(text: bytes) -> str:
    """What a program said last that is a message; viewers without Vulkan end with a backtrace."""
    lines = [line.strip() for line in text.decode(errors="replace").splitlines() if line.strip()]
    telling = [line for line in lines if "adapter" in line.lower() or "error" in line.lower()]
    return (telling or lines or ["it says nothing"])[-1][:200]


def draw_recording(path: Path, recording: Path, progress: Callable[[str], None]) -> None:
    """Write how the viewer shows a recording: its beginning as PNG, or FILM_S at most of it as MP4.

    Raises:
        BadInput: the file's name ends otherwise, it cannot be written, or there is nothing to draw with.
    """
    film = is_film(path)
    width, height = FILM_SIZE_PX if film else PICTURE_SIZE_PX
    remedy = "; on Debian: apt install mesa-vulkan-drivers"
    progress("starting the viewer")
    try:
        with _started(["--headless", "--window-size", f"{width}x{height}"], str(path)) as url:
            client = _loaded(url, recording, path)
            client.set_time(play_state="paused")
            settled = time.monotonic() + SETTLE_S
            while time.monotonic() < settled:
                client.take_screenshot()  # without a window it draws only when it is asked to
            if film:
                _write_film(path, client, progress)
            else:
                write_whole(path, client.take_screenshot())
    except BadInput as error:
        raise BadInput(f"{error}{remedy * ('does not start' in str(error))}") from error
    except (ConnectionError, OSError, RuntimeError) as error:
        raise BadInput(" ".join(f"{path}: the viewer could not draw it ({error}){remedy}".split())[:300]) from error


def is_film(path: Path) -> bool:
    """Whether a picture to be drawn is a film; BadInput where its name says neither."""
    if path.suffix.lower() not in (".png", ".mp4"):
        raise BadInput(f"{path}: name a picture (.png) or a film (.mp4)")
    return path.suffix.lower() == ".mp4"


def _loaded(url: str, recording: Path, path: Path) -> Any:
    """A client of a viewer that has read a recording."""
    from rerun.experimental import ViewerClient

    client = ViewerClient.connect(url)
    client.open(str(recording.resolve()))

    def read() -> bool:
        state = client.get_state()
        known = [one for one in state.recordings if one.store_id == state.active_recording]
        return not state.loading and bool(known) and known[0].current_timeline is not None

    if not _until(read, LOAD_S):
        raise BadInput(f"{path}: the viewer cannot read {recording}; write it again")
    return client


def _moments(client: Any) -> tuple[str, list[dict[str, float | int]], float]:
    """The timeline that is shown, moments on it to draw, and how many there are in a second."""
    state = client.get_state()
    shown = next(one for one in state.recordings if one.store_id == state.active_recording)
    line = next(one for one in shown.timelines if one.name == shown.current_timeline)
    first, last = line.start or 0, line.end or 0
    if line.time_type == "sequence":
        return (
            line.name,
            [{"sequence": k} for k in range(first, min(last, first + int(FILM_S / STEP_S)) + 1)],
            1 / STEP_S,
        )
    count = math.floor(min(1e-9 * (last - first), FILM_S) * FILM_HZ) + 1
    return line.name, [{"duration": 1e-9 * first + k / FILM_HZ} for k in range(count)], FILM_HZ


def _write_film(path: Path, client: Any, progress: Callable[[str], None]) -> None:
    """A film of the recording that the viewer shows, whole or not at all."""
    timeline, moments, rate = _moments(client)
    with scratch_folder() as folder:
        part = folder / "film.mp4"
        writer = cv2.VideoWriter(str(part), cv2.VideoWriter.fourcc(*"vp09"), rate, FILM_SIZE_PX)
        if not writer.isOpened():
            raise BadInput(f"{path}: this OpenCV writes no VP9; write a picture (.png) instead")
        for number, moment in enumerate(moments, 1):
            progress(f"picture {number} of {len(moments)}")
            client.set_time(timeline, **moment, play_state="paused")
            picture = cv2.imdecode(np.frombuffer(client.take_screenshot(), np.uint8), cv2.IMREAD_COLOR)
            writer.write(cv2.resize(picture, FILM_SIZE_PX, interpolation=cv2.INTER_AREA))
        writer.release()
        if cv2.VideoCapture(str(part)).get(cv2.CAP_PROP_FRAME_COUNT) != len(moments):  # the writer raises no error
            raise BadInput(f"{path}: cannot be written (no room in {folder.parent}); make room there, or set TMPDIR")
        write_whole(path, part.read_bytes())
