"""Printed markers: the sheet, what a picture shows of them, and cameras that they mend, check and never spoil."""

from __future__ import annotations

import dataclasses
import re
import zlib
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from models.errors import BadInput
from models.shot import NOSE_HEIGHT
from sysid.cli import main
from sysid.vision.camera.calibrate import BY_MARKERS, Calibration, calibrate
from sysid.vision.camera.printed.marker_camera import marker_errors, marker_notes, marker_view, misplaced, print_ratio
from sysid.vision.camera.printed.markers import MARGIN_SIZES, MARKER_LENGTHS, MARKER_RAILS, Markers, find_markers
from sysid.vision.camera.projection import Camera
from sysid.vision.camera.table.first_view import initial_camera
from sysid.vision.camera.table.reading import CameraHints
from tests.footage.cards import Card, all_cards
from tests.footage.film import Look, Picture
from tests.support.table_views import errors, over_table, rms, taken

cv2.setNumThreads(1)

CAMERA = over_table((0.01, -0.02), size=(640, 400), span=2.6, height=1.8, k1=0.01)
GREY = Look(
    noise=3.0, uneven=0.3, cushion_shadow=0.018, cloth=(0.45, 0.45, 0.45), cloth_tops=True, lamps=1.0
)  # a cloth that is not found by its colour
CARDS = all_cards()
PLACE_M = 3e-3  # by which a camera that is right places balls wrongly, rms


def laid(*changed: Card) -> tuple[Card, ...]:
    """All six cards, some of them otherwise."""
    named = {card.number: card for card in changed}
    return tuple(named.get(card.number, card) for card in CARDS)


@cache
def filmed(cards: Sequence[Card]) -> Picture:
    return taken(CAMERA, dataclasses.replace(GREY, cards=cards))


@cache
def found_in(cards: Sequence[Card]) -> Calibration:
    return calibrate(filmed(cards), CAMERA.table, CAMERA.diameter)


def seen(cards: Sequence[Card]) -> Markers:
    return find_markers(filmed(cards), CAMERA.table)


def projected(cards: Sequence[Card], seed: int = 0) -> Markers:
    """What a camera sees of cards, without a picture: their corners to a fifth of a pixel."""
    pixels = []
    for card in cards:
        at = card.number if card.place is None else card.place
        axis, sign = MARKER_RAILS[at] // 2, 1.0 - 2.0 * (MARKER_RAILS[at] % 2)
        out = np.eye(2)[axis] * sign
        right, side = np.array([out[1], -out[0]]), card.size * card.scale
        middle = out * ((CAMERA.table.length, CAMERA.table.width)[axis] / 2 + card.out)
        middle = middle + np.eye(2)[1 - axis] * (MARKER_LENGTHS[at] * CAMERA.table.length + card.along)
        own = side * np.array([[-0.5, 1.0], [0.5, 1.0], [0.5, 0.0], [-0.5, 0.0]]) + [0, MARGIN_SIZES * side]
        c, s = np.cos(card.turn), np.sin(card.turn)
        xy = middle + own @ np.array([[c, s], [-s, c]]) @ np.array([right, out])
        height = NOSE_HEIGHT * CAMERA.radius + 0.05 * np.maximum((xy - middle) @ out, 0)
        pixels.append(CAMERA.project(np.column_stack([xy, height])))
    noise = 0.2 * np.random.default_rng(seed).standard_normal((len(cards), 4, 2))
    return Markers(np.array([card.number for card in cards]), np.array(pixels) + noise, CAMERA.table)


def view_of(markers: Markers) -> tuple[Camera, list[int]] | None:
    """The camera of the markers that agree, and the numbers of those that do not."""
    start = initial_camera(CAMERA.size, CAMERA.table, CAMERA.diameter, None, None)
    found = marker_view(start, markers, ("k1", "focal"))
    return None if found is None else (found.camera, markers.numbers[~found.used].tolist())


def place_error(camera: Camera) -> float:
    """Rms over the table [m]."""
    half = np.array([CAMERA.table.length, CAMERA.table.width]) / 2 - CAMERA.radius
    xy = np.stack(np.meshgrid(np.linspace(-1, 1, 11), np.linspace(-1, 1, 7)), axis=-1).reshape(-1, 2) * half
    return float(np.sqrt(np.mean(np.sum((camera.centres(CAMERA.outline(xy)) - xy) ** 2, axis=1))))


@pytest.mark.slow
def test_markers_are_seen_where_they_lie() -> None:
    markers = seen(CARDS)
    assert markers.numbers.tolist() == list(range(len(MARKER_RAILS)))
    out, along = marker_errors(CAMERA, markers)
    assert np.abs(out).max() < 2e-3, "4 mm are a pixel; the card rises by a millimetre before the marker begins"
    assert np.abs(along).max() < 2e-3
    assert print_ratio(CAMERA, markers)[0] == pytest.approx(1.0, abs=0.01)
    assert misplaced(CAMERA, markers) == []
    assert len(find_markers(filmed(()), CAMERA.table)) == 0


def test_one_number_seen_twice_counts_for_nothing() -> None:
    twice = seen((*CARDS[:5], Card(0, place=5)))
    assert twice.numbers.tolist() == [1, 2, 3, 4]


def test_markers_alone_give_a_camera() -> None:
    camera, left_out = view_of(seen(CARDS)) or (CAMERA, [9])
    assert left_out == []
    assert place_error(camera) < 5e-3


OFF = ({"along": 0.03}, {"along": -0.03}, {"out": 0.03}, {"out": -0.03}, {"turn": np.pi})


@pytest.mark.parametrize("card", [Card(k % 6, **OFF[(k + k // 6) % 5]) for k in range(12)], ids=str)
def test_a_marker_laid_wrongly_is_the_one_left_out(card: Card) -> None:
    check_left_out(card)


@pytest.mark.parametrize(("one", "other"), [(0, 1), (1, 2), (0, 4), (1, 5), (2, 4), (3, 5)])
def test_two_that_were_exchanged_are_left_out(one: int, other: int) -> None:
    check_left_out(Card(one, place=other), Card(other, place=one))


def check_left_out(*wrong: Card) -> None:
    """Check that these are left out and named, and that the others give the camera."""
    markers = projected(laid(*wrong))
    view = view_of(markers)
    assert view is not None
    assert view[1] == [card.number for card in wrong]
    assert place_error(view[0]) < PLACE_M
    lines = misplaced(view[0], markers)
    assert [int(re.findall(r"marker (\d)", line)[0]) for line in lines] == view[1]


def test_the_ends_exchanged_are_refused() -> None:
    """Nothing but the noses tells them from two wrong rows on the long cushions."""
    assert view_of(projected(laid(Card(0, place=3), Card(3, place=0)))) is None


def test_markers_laid_with_a_tape_agree() -> None:
    for seed in range(8):
        rng = np.random.default_rng(seed)
        cards = tuple(Card(k, along=rng.normal(0, 3e-3), out=rng.normal(0, 1e-3)) for k in range(6))
        camera, left_out = view_of(projected(cards, seed)) or (CAMERA, [9])
        assert left_out == []
        assert place_error(camera) < 2 * PLACE_M


@pytest.mark.slow
def test_strewn_cards_agree_by_chance_at_most_and_are_refused_then() -> None:
    agreed = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        markers = projected(tuple(Card(k, along=rng.normal(0, 0.04), out=rng.normal(0, 0.03)) for k in range(6)))
        start = initial_camera(CAMERA.size, CAMERA.table, CAMERA.diameter, None, None)
        view = marker_view(start, markers, ("k1", "focal"))
        agreed += view is not None
        _, doubts = marker_notes(view.camera if view else CAMERA, markers, view, 4)
        assert any("contradict" in doubt for doubt in doubts)
    assert agreed < 3


def test_too_few_markers_are_said_and_not_used() -> None:
    assert view_of(projected(CARDS[:3])) is None
    notes, doubts = marker_notes(CAMERA, projected(CARDS[:3]), None, 4)
    assert "3 markers seen, too few" in notes[0] and doubts == []
    assert marker_notes(CAMERA, projected(CARDS[:1]), None, 4) == ([], [])


@pytest.mark.slow
def test_a_camera_refused_without_markers_is_right_with_them() -> None:
    with pytest.raises(BadInput, match="no table found"):
        found_in(())
    found = found_in(CARDS)
    assert found.doubts == ()
    assert rms(errors(CAMERA, found)) < 1e3 * PLACE_M
    assert any("6 markers" in note for note in found.notes)


@pytest.mark.slow
def test_cards_over_diamonds_are_not_taken_for_diamonds() -> None:
    look = dataclasses.replace(GREY, cards=CARDS, diamonds=0.012)
    found = calibrate(taken(CAMERA, look), CAMERA.table, CAMERA.diameter)
    assert found.doubts == ()
    assert len(found.diamonds.pixels) == 0
    assert rms(errors(CAMERA, found)) < 1e3 * PLACE_M


@pytest.mark.slow
def test_the_numbers_say_which_end_is_which() -> None:
    turned = dataclasses.replace(CAMERA, rotation=cv2.Rodrigues(CAMERA.axes @ np.diag([-1.0, -1, 1]))[0].ravel())
    found = calibrate(taken(turned, dataclasses.replace(GREY, cards=CARDS)), turned.table, turned.diameter)
    assert found.doubts == ()
    assert rms(errors(turned, found)) < 1e3 * PLACE_M


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [
    pytest.param((Card(2, along=0.03),), marks=pytest.mark.thorough), (Card(0, out=0.03),),
    pytest.param((Card(0, place=1), Card(1, place=0)), marks=pytest.mark.thorough),
])  # fmt: skip
def test_a_wrongly_laid_marker_is_named_and_passes_no_wrong_camera(wrong: tuple[Card, ...]) -> None:
    found = found_in(laid(*wrong))
    assert rms(errors(CAMERA, found)) < 1e3 * PLACE_M or found.doubts
    for card in wrong:
        assert any(f"marker {card.number} lies" in line for line in (*found.notes, *found.doubts))


@pytest.mark.slow
def test_cards_that_all_lie_behind_the_noses_are_told_by_the_noses() -> None:
    found = found_in(all_cards(out=0.018))
    assert rms(errors(CAMERA, found)) < 1e3 * PLACE_M or found.doubts
    assert any("out of the nose" in doubt or "standard deviations" in doubt for doubt in found.doubts)


@pytest.mark.parametrize("scale", [0.96, 1.04])
def test_prints_of_another_size_are_noticed(scale: float) -> None:
    markers = projected(all_cards(scale=scale))
    view = marker_view(initial_camera(CAMERA.size, CAMERA.table, CAMERA.diameter, None, None), markers, ("k1", "focal"))
    assert view is not None
    _, doubts = marker_notes(CAMERA, markers, view, 4)
    assert f"the markers measure {100 * scale:.0f} mm, not 100" in doubts[0] and "--marker-size" in doubts[0]
    right = dataclasses.replace(markers, size=0.1 * scale)
    assert marker_notes(CAMERA, right, view, 4)[1] == []


@pytest.mark.slow
def test_markers_without_any_nose_are_not_trusted() -> None:
    picture = np.full_like(filmed(CARDS), 90)
    for number in seen(CARDS).numbers:  # nothing but the cards is left of the picture
        corners = seen(CARDS).pixels[number]
        middle = corners.mean(axis=0)
        mask = np.zeros(picture.shape[:2], np.uint8)
        cv2.fillConvexPoly(mask, np.rint(middle + 1.2 * (corners - middle)).astype(np.int32), 255)
        picture[mask > 0] = filmed(CARDS)[mask > 0]
    found = calibrate(picture, CAMERA.table, CAMERA.diameter, CameraHints())
    assert found.edge == BY_MARKERS
    assert any("only as accurate as" in doubt for doubt in found.doubts)
    assert place_error(found.camera) < 6e-3


def test_the_sheet_is_at_true_scale_and_can_be_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "markers.pdf"
    assert main(["markers", "--table", "snooker", "--out", str(path)]) == 0
    assert "100 %" in capsys.readouterr().out
    first = path.read_bytes()
    assert main(["markers", "--table", "snooker", "--out", str(path)]) == 0
    assert path.read_bytes() == first
    assert len(re.findall(rb"/MediaBox \[ 0 0 595.27\d* 841.88\d* \]", first)) == 4
    pages = [zlib.decompress(part) for part in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", first, re.DOTALL)
             if part[:1] == b"x"]  # fmt: skip
    cell = 72 / 25.4 * 100 / 6
    drawn = [page for page in pages if page.count(b" l\n") > 40]
    for page in drawn[-3:]:
        steps = [float(v) for v in re.findall(rb"^([\d.]+) [\d.]+ l$", page, re.MULTILINE)]
        assert np.isclose(np.abs(np.diff(steps)), cell, atol=0.01).any(), "a cell is a sixth of 100 mm"


@pytest.mark.parametrize(("words", "part"), [
    (("--table", "snooker", "--out", "a.png"), "end its name in .pdf"),
    (("--table", "snoker", "--out", "a.pdf"), 'did you mean "snooker"'),
    (("--out", "a.pdf"), "--table"),
    (("--table", "snooker", "--out", "nowhere/a.pdf"), "its folder does not exist"),
])  # fmt: skip
def test_a_sheet_that_cannot_be_made_is_refused(
    words: Sequence[str], part: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["markers", *words]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert part in line
    assert list(tmp_path.iterdir()) == []
