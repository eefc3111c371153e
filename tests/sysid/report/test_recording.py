"""The recording of comparisons: the shot that shows most goes first, and every model of the ladder is in it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from sysid.report.recording import write_rrd
from sysid.residuals.comparison import Comparison
from tests.support.comparison_samples import comparison
from tests.support.reviewed_clips import column, read


def with_misses(one: Comparison, misses: dict[int, float]) -> Comparison:
    """The same comparison with other misses [m] of some clips, by their place."""
    rows = [dataclasses.replace(row, rms_m=misses.get(k, 0.001)) for k, row in enumerate(one.clips)]
    return dataclasses.replace(one, clips=tuple(rows))


def names(path: Path) -> list[str]:
    """The clips in their order."""
    pages = column(read(path)["/text/clip"], "TextDocument:text")
    return [page[0].splitlines()[0].removeprefix("# ") for page in pages]


def test_the_shot_that_shows_most_goes_first_and_the_others_keep_their_order(tmp_path: Path) -> None:
    one = comparison(4)
    files = [clip.file for clip in one.shots]
    found = with_misses(one, {1: 0.009})
    write_rrd(tmp_path / "one.rrd", [("model", found)])
    assert names(tmp_path / "one.rrd") == [files[1], files[0], *files[2:]], "of one model, the largest miss"
    base = with_misses(one, {1: 0.009, 2: 0.005})
    write_rrd(tmp_path / "two.rrd", [("base", base), ("better", found)])
    assert names(tmp_path / "two.rrd") == [files[2], *files[:2], *files[3:]], "of two, where they differ most"


def test_models_between_the_ends_are_recorded(tmp_path: Path) -> None:
    one = comparison(3)
    tracks = {clip.file: track for clip, track in zip(one.shots, one.tracks, strict=True)}
    write_rrd(tmp_path / "r.rrd", [("base", one), ("last", one)], [("second", tracks)])
    page = column(read(tmp_path / "r.rrd")["/text/clip"], "TextDocument:text")[0][0]
    assert page.index("| base |") < page.index("| second |") < page.index("| last |")
