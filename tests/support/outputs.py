"""What every page, picture and recording keeps to: whole, in need of nothing else, the same again, or absent."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import pytest

from models.errors import BadInput
from tests.support.html_pages import Page
from tests.support.reviewed_clips import column

MAX_PAGE_CHARS = 1_000_000  # a plan's or a series'; Plotly is not in it


def check_page(text: str, pictures: int) -> Page:
    """Check that a page without scripts closes its tags, links nowhere, and holds so many SVGs; the page."""
    page = Page(text)
    assert page.open == []
    assert not {tag for tag, _ in page.seen} & {"script", "link", "iframe"}
    assert "http" not in re.sub(r"base64,[^\"]+", "", text) and len(text) < MAX_PAGE_CHARS
    assert len(page.pictures()) == pictures
    for picture in page.pictures():
        assert ElementTree.fromstring(picture).tag.endswith("svg") and not re.search(r"href=\"http", picture)
    return page


def check_bad_places(folder: Path, *writers: Callable[[Path], None]) -> None:
    """Check that each names a place where it cannot write in a line, and leaves nothing there."""
    for place in (folder / "nowhere" / "x", folder):
        for write in writers:
            with pytest.raises(BadInput, match=re.escape(str(place))) as error:
                write(place)
            assert "\n" not in str(error.value)
    assert list(folder.iterdir()) == []


def check_recording(folder: Path, write: Callable[[Path, str], None], views: set[str], timelines: set[str]) -> None:
    """Check that only the same title gives the same recording, with one layout of these views, on these timelines."""
    from rerun.chunk import RrdReader

    for name, title in (("a", "one"), ("b", "one"), ("c", "other")):
        write(folder / name, title)
    readers = [RrdReader(folder / name) for name in "abc"]
    ids = [reader.recordings()[0].recording_id for reader in readers]
    assert ids[0] == ids[1] != ids[2] and len(readers[0].recordings()) == 1
    (blueprint,) = readers[0].blueprints()
    batches = [chunk.to_record_batch() for chunk in readers[0].stream(store=blueprint).to_chunks()]
    assert views <= {row[0] for row in column(batches, "ViewBlueprint:display_name")}
    assert timelines == {name for chunk in readers[0].stream().to_chunks() for name in chunk.timeline_names}
