"""Corners of a table clicked in a browser: a page with the picture, served to this machine alone.

In: a picture. Out: four points in it. The page's address holds a random port and a random token; whatever does not
name the token is answered with 404. The server ends when the points have come, when the page was closed, or when it is
interrupted.
"""

from __future__ import annotations

import base64
import json
import math
import os
import secrets
import sys
import threading
import webbrowser
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from queue import Empty, SimpleQueue

import cv2
import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.report.page import render
from sysid.vision.camera.projection import Array

THIS_MACHINE = "127.0.0.1"
PAGE_TEMPLATE = Path(__file__).with_name("templates") / "clicks.html.j2"
CORNER_COUNT = 4
MAX_ANSWER_BYTES = 1000
CLOSED_S = 3.0  # after which a page that was closed is not being loaded again
ANSWER_S = 10.0  # in which a request must be complete
IN_ALL = "Click the four corners where the nose lines of the cushions cross, in any order."
ALONG_THREE = (
    "Click four points along the three cushions' noses, in order: one on the first, the two corners, one on the last."
)
USE_CORNERS = 'or give the corners in pixels: --corners "u,v u,v u,v u,v"'


class _Server(ThreadingHTTPServer):
    """Serves one page, and puts into a queue what it sends back: the points, or None when the page was closed."""

    daemon_threads = True

    def __init__(self, page: bytes, size: tuple[int, int]) -> None:
        super().__init__((THIS_MACHINE, 0), _Handler)
        self.page, self.size = page, size
        self.root = f"/{secrets.token_urlsafe(24)}/"
        self.events: SimpleQueue[Array | str] = SimpleQueue()

    @property
    def address(self) -> str:
        """Of the page."""
        return f"http://{THIS_MACHINE}:{self.server_address[1]}{self.root}"

    def handle_error(self, request: object, client_address: object) -> None:
        """A browser that leaves in the middle of a request is no fault."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = ANSWER_S

    def do_GET(self) -> None:
        """The page."""
        if not secrets.compare_digest(self.path.encode(), self.server.root.encode()):
            return self._answer(HTTPStatus.NOT_FOUND)
        self.server.events.put("opened")
        return self._answer(HTTPStatus.OK, self.server.page, "text/html; charset=utf-8")

    def do_POST(self) -> None:
        """The points, or that the page was closed."""
        root, _, name = self.path.rpartition("/")
        if not secrets.compare_digest(f"{root}/".encode(), self.server.root.encode()):
            return self._answer(HTTPStatus.NOT_FOUND)
        if name == "closed":
            self.server.events.put("closed")
            return self._answer(HTTPStatus.NO_CONTENT)
        if name != "corners":
            return self._answer(HTTPStatus.NOT_FOUND)
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdigit() and int(length) <= MAX_ANSWER_BYTES):
            return self._answer(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        try:
            points = read_points(self.rfile.read(int(length)), self.server.size)
        except BadInput as error:
            return self._answer(HTTPStatus.BAD_REQUEST, str(error).encode())
        self._answer(HTTPStatus.NO_CONTENT)
        return self.server.events.put(points)

    def _answer(self, status: HTTPStatus, body: bytes = b"", kind: str = "text/plain; charset=utf-8") -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """Nothing: the terminal is the command's."""


def clicked(
    picture: NDArray[np.uint8], sides: int, say: Callable[[str], None], show: Callable[[str], bool] | None = None
) -> Array:
    """Four points that a person clicks in a picture, shown in a browser.

    Args:
        picture: (height, width, 3), blue, green, red.
        sides: of the table in view, three or four.
        say: receives the lines that say where the page is.
        show: opens an address in a browser, and returns whether it could; by default the browser of this machine.

    Returns:
        (4, 2) [pixels], to a tenth.

    Raises:
        BadInput: the page was closed before they were all clicked.
    """
    height, width = picture.shape[:2]
    png = base64.b64encode(cv2.imencode(".png", picture)[1].tobytes()).decode()
    page = render(
        PAGE_TEMPLATE, title="Corners of the table", picture=f"data:image/png;base64,{png}",
        asked=IN_ALL if sides == CORNER_COUNT else ALONG_THREE, ring=sides == CORNER_COUNT,
    )  # fmt: skip
    with _Server(page.encode(), (width, height)) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True)
        thread.start()
        try:
            say(f"click the corners in the browser: {server.address}")
            if not (show or opened)(server.address):
                port = server.server_address[1]
                say(
                    "no browser could be opened here; on the machine you sit at forward the port and open that address:"
                )
                say(f"  ssh -N -L {port}:{THIS_MACHINE}:{port} USER@HOST")
                say(USE_CORNERS)
            return _points_from(server)
        finally:
            server.shutdown()


def _points_from(server: _Server) -> Array:
    """Wait for the points; BadInput when the page stays closed."""
    wait: float | None = None
    while True:
        try:
            event = server.events.get(timeout=wait)
        except Empty:
            raise BadInput(f"the page was closed before four corners were sent; start again, {USE_CORNERS}") from None
        if not isinstance(event, str):
            return event
        wait = CLOSED_S if event == "closed" else None


def opened(address: str) -> bool:
    """Open an address in this machine's browser; False where there is no display for one."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return False  # what webbrowser would open then is one for the terminal, without pictures
    return webbrowser.open(address)


def read_points(answer: bytes, size: tuple[int, int]) -> Array:
    """The points of an answer: (4, 2) [pixels], to a tenth; BadInput unless they are four pairs in the picture."""
    try:
        pairs = json.loads(answer)
    except (ValueError, RecursionError):
        pairs = None
    good = isinstance(pairs, list) and len(pairs) == CORNER_COUNT
    if not good or not all(isinstance(p, list) and len(p) == 2 and all(map(_finite, p)) for p in pairs):
        raise BadInput("send four pairs of numbers")
    points = np.round(np.array(pairs, float), 1)
    if not ((points >= 0) & (points <= np.array(size) - 1)).all():
        raise BadInput(f"a point is outside the picture of {size[0]}x{size[1]} pixels")
    return points


def _finite(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e9 and math.isfinite(value)


def as_option(points: Array) -> str:
    """Points (4, 2) as --corners takes them."""
    return '--corners "' + " ".join(f"{u:.1f},{v:.1f}" for u, v in points) + '"'
