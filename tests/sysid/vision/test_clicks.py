"""Corners clicked in a browser: what the page's server takes, what it refuses, and when it ends."""

from __future__ import annotations

import http.client
import json
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import SimpleQueue
from typing import Any
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest

from models.errors import BadInput
from sysid.cli import main
from sysid.vision.camera.pictures import clicks
from sysid.vision.camera.pictures.clicks import as_option, clicked, opened
from tests.support.browser import chromium
from tests.support.table_views import over_table, taken

PICTURE = np.full((40, 60, 3), 90, np.uint8)
CORNERS = [[5, 5.04], [50, 4], [52, 33], [3, 39]]
Answer = tuple[int, bytes]


def ask(address: str, method: str, name: str = "", body: bytes | None = None, **headers: str) -> Answer:
    """Status and body of what the server answers to a real client."""
    where = urlsplit(address)
    line = http.client.HTTPConnection(where.hostname or "", where.port, timeout=5)
    try:
        line.request(method, where.path + name, body, headers)
        answer = line.getresponse()
        return answer.status, answer.read()
    finally:
        line.close()


def session(visit: Callable[[str], None], sides: int = 4) -> tuple[list[Any], list[str]]:
    """What `clicked` returns or raises while a visitor looks at the page, and what it says."""
    came: list[Any] = []
    said: list[str] = []

    def look(address: str) -> bool:
        def run() -> None:
            try:
                visit(address)
            except BaseException as error:  # told by the test's own thread
                came.append(error)
                raise

        threading.Thread(target=run, daemon=True).start()
        return True

    try:
        came.append(clicked(PICTURE, sides, said.append, look))
    except BadInput as error:
        came.append(error)
    return came, said


def test_the_page_holds_the_picture_and_takes_four_points() -> None:
    pages: list[bytes] = []

    def visit(address: str) -> None:
        pages.append(ask(address, "GET")[1])
        assert ask(address, "POST", "corners", json.dumps(CORNERS).encode())[0] == 204

    came, said = session(visit)
    assert came[0] == pytest.approx(np.round(CORNERS, 1))
    assert b"data:image/png;base64," in pages[0] and b"in any order" in pages[0]
    assert as_option(came[0]) == '--corners "5.0,5.0 50.0,4.0 52.0,33.0 3.0,39.0"'
    address = said[0].rpartition(" ")[2]
    assert urlsplit(address).hostname == "127.0.0.1"
    with pytest.raises(OSError):
        ask(address, "GET")


def test_three_sides_are_clicked_in_order() -> None:
    def visit(address: str) -> None:
        assert b"three cushions" in ask(address, "GET")[1]
        ask(address, "POST", "corners", json.dumps(CORNERS).encode())

    assert len(session(visit, 3)[0][0]) == 4


@pytest.mark.parametrize(
    "answer",
    [
        CORNERS[:3], [*CORNERS, [1, 1]], [[1, 2, 3]] * 4, [["1", 2]] * 4, [[True, 2]] * 4, {"corners": CORNERS}, 7,
        [[float("nan"), 2], *CORNERS[1:]], [[float("inf"), 2], *CORNERS[1:]], [[10**400, 2], *CORNERS[1:]],
        [[-1, 2], *CORNERS[1:]], [[5, 40], *CORNERS[1:]], [[60, 5], *CORNERS[1:]],
    ],
)  # fmt: skip
def test_anything_but_four_points_in_the_picture_is_refused(answer: Any) -> None:
    def visit(address: str) -> None:
        status, text = ask(address, "POST", "corners", json.dumps(answer).encode())
        assert status == 400 and text
        ask(address, "POST", "corners", json.dumps(CORNERS).encode())

    came, _ = session(visit)
    assert came[0].shape == (4, 2), "it waits on for points that are right"


def test_only_the_token_is_answered_and_nothing_long_is_read() -> None:
    def visit(address: str) -> None:
        root = "{0.scheme}://{0.netloc}/".format(urlsplit(address))
        body = json.dumps(CORNERS).encode()
        for other in (root, address + "x", address[:-2] + "/", root + "x/"):
            assert ask(other, "GET")[0] == 404
            assert ask(other, "POST", "corners", body)[0] == 404
            assert ask(other, "POST", "closed")[0] == 404
        assert ask(address, "POST", "other", body)[0] == 404
        assert ask(address, "PUT", "corners", body)[0] == 501
        assert ask(address, "POST", "corners", b"not JSON")[0] == 400
        assert ask(address, "POST", "corners", b" " * 2000 + body)[0] == 413
        ask(address, "POST", "corners", body)

    assert session(visit)[0][0].shape == (4, 2)


def test_a_closed_page_ends_it_and_one_that_is_loaded_again_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clicks, "CLOSED_S", 0.3)

    def reloaded(address: str) -> None:
        ask(address, "POST", "closed")
        ask(address, "GET")
        threading.Event().wait(0.6)
        ask(address, "POST", "corners", json.dumps(CORNERS).encode())

    assert session(reloaded)[0][0].shape == (4, 2)
    came, said = session(lambda address: ask(address, "POST", "closed") and None)
    assert isinstance(came[0], BadInput) and "--corners" in str(came[0])
    with pytest.raises(OSError):
        ask(said[0].rpartition(" ")[2], "GET")


def test_without_a_display_the_way_there_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    assert not opened("http://127.0.0.1:1/x/")
    said: list[str] = []

    def say(line: str) -> None:
        said.append(line)
        if "--corners" in line:
            address = said[0].rpartition(" ")[2]
            threading.Thread(target=ask, args=(address, "POST", "corners", json.dumps(CORNERS).encode())).start()

    clicked(PICTURE, 4, say)
    port = urlsplit(said[0].rpartition(" ")[2]).port
    assert f"ssh -N -L {port}:127.0.0.1:{port}" in said[2]


def test_an_interruption_ends_the_server(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(address: str) -> bool:
        monkeypatch.setattr(clicks, "_points_from", lambda server: (_ for _ in ()).throw(KeyboardInterrupt))
        addresses.append(address)
        return True

    addresses: list[str] = []
    with pytest.raises(KeyboardInterrupt):
        clicked(PICTURE, 4, lambda line: None, interrupt)
    with pytest.raises(OSError):
        ask(addresses[0], "GET")


@pytest.mark.slow
def test_the_command_prints_the_corners_as_the_option_takes_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    camera = over_table()
    corners = camera.project(np.array([[x, y, 0.0365] for x, y in ((1, 0.5), (-1, 0.5), (1, -0.5), (-1, -0.5))]))
    cv2.imwrite(str(tmp_path / "p.png"), taken(camera))

    def show(address: str) -> bool:
        body = json.dumps((corners + 3).tolist()).encode()
        threading.Thread(target=ask, args=(address, "POST", "corners", body)).start()
        return True

    monkeypatch.setattr(clicks, "opened", show)
    words = ["calibrate", str(tmp_path / "p.png"), "--table", "2x1", "--diameter", "0.0525", "--out"]
    assert main([*words, str(tmp_path / "a.toml"), "--click"]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("clicked: "))
    option, points = line.removeprefix("clicked: ").split(" ", 1)
    assert main([*words, str(tmp_path / "b.toml"), option, points.strip('"')]) == 0
    one, two = ((tmp_path / name).read_text().partition("# made by")[0] for name in ("a.toml", "b.toml"))
    assert one == two, "but for the options that it was made with"
    assert main([*words, str(tmp_path / "c.toml"), "--click", option, points.strip('"')]) == 2
    assert "--click and --corners exclude each other" in capsys.readouterr().err


@pytest.fixture
def page() -> Iterator[Any]:
    """A page of the machine's Chromium."""
    with chromium() as running:
        yield running.new_context(viewport={"width": 900, "height": 700}).new_page()


@pytest.mark.slow
def test_corners_are_clicked_undone_and_sent_in_a_browser(page: Any) -> None:
    camera = over_table()
    true = camera.project(np.array([[x, y, 0.0365] for x, y in ((1, 0.5), (-1, 0.5), (1, -0.5), (-1, -0.5))]))
    picture, complaints, came = taken(camera), list[str](), list[Any]()
    page.on("pageerror", lambda error: complaints.append(str(error)))
    addresses: SimpleQueue[str] = SimpleQueue()

    def show(address: str) -> bool:
        addresses.put(address)
        return True

    thread = threading.Thread(target=lambda: came.append(clicked(picture, 4, lambda line: None, show)), daemon=True)
    thread.start()
    page.goto(addresses.get(timeout=60))
    page.wait_for_function("document.getElementById('picture').width > 300")
    box = page.locator("#picture").bounding_box()
    scale = box["width"] / 640

    def click(point: Any) -> None:
        page.mouse.click(box["x"] + (point[0] + 0.5) * scale, box["y"] + (point[1] + 0.5) * scale)

    assert page.locator("#done").is_disabled()
    click(true[0] + 40)
    assert page.locator("#magnifier").is_visible()
    page.click("#undo")
    for point in true:
        click(point)
    page.click("#done")
    thread.join(60)
    assert complaints == []
    assert came[0] == pytest.approx(true, abs=1.0)
