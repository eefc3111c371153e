"""The report: whole, self-contained, escaped, the same bytes again, and its numbers those of the comparison."""

from __future__ import annotations

import base64
import dataclasses
import math
import re
from collections.abc import Sequence
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from models.errors import BadInput
from models.model_file import Estimate, Model, full_model
from models.shot import Ball, Table, Track
from sysid.clips import Clip, ClipSet, Observation
from sysid.report.html import Rung, write_report
from sysid.report.plots import dependence_svg, ladder_svg, spread_svg, tracks_svg
from sysid.report.plots_where import map_svg
from sysid.residuals.comparison import ClipRow, Comparison, Group, SegmentRow
from sysid.residuals.impacts import no_impacts
from sysid.residuals.localise import find
from sysid.residuals.samples import Samples
from sysid.residuals.whiteness import whiteness

TABLE, BALL = Table(3.569, 1.778), Ball(0.0525, 0.1406)
NOISE = 0.0005
VOID = {"meta", "img"}
STRANGE = "<script>alert('$x$')</script> & \"é\"\u2028\x07\ud800"


class Page(HTMLParser):
    """Tags that are opened and closed, attributes, and the text of the page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    def pictures(self) -> list[str]:
        head = "data:image/svg+xml;base64,"
        sources = [str(attrs["src"]) for tag, attrs in self.seen if tag == "img"]
        assert all(source.startswith(head) for source in sources)
        return [base64.b64decode(source.removeprefix(head), validate=True).decode() for source in sources]


def comparison(count: int = 3, size: float = 0.002, file: str = "clips/{}.csv") -> Comparison:
    """Straight shots that slow down; the model misses by `size` times the time, towards +y."""
    rng = np.random.default_rng(7)
    model = full_model(TABLE, BALL)
    shots, tracks, rows, segments, parts = [], [], [], [], []
    for k in range(count):
        time = np.arange(0.0, 2.0, 0.02)
        heading, way = 0.4 * k, 1.0 * time - 0.2 * time**2
        cue = np.column_stack([way * math.cos(heading) - 1.0, way * math.sin(heading) - 0.5])
        red = np.broadcast_to([0.5, 0.3], cue.shape)
        balls = {name: Observation(time, xy, np.full(len(time), np.nan)) for name, xy in (("cue", cue), ("red", red))}
        shots.append(Clip(file.format(k), "cue", balls))
        miss = np.column_stack([0 * time, size * time]) + rng.normal(0, NOISE, (len(time), 2))
        position = np.stack([cue + miss, red], axis=1)
        position[-5:, 1] = np.nan
        still = np.zeros((*position.shape[:2], 3))
        tracks.append(Track(("cue", "red"), time, position, still[..., :2], still, still[..., 0]))
        rms = float(np.sqrt((miss**2).sum(axis=1).mean()))
        rows.append(ClipRow(shots[-1].file, rms, 0.9 * rms, 40.0 + k, k % 2 == 1))
        segments.append(SegmentRow(shots[-1].file, "cue", "strike", 0.0, 1.0, 1.0, 1.1 + k))
        parts.append((np.full(len(time), k), time, cue, miss, 1.0 - 0.4 * time, np.full(len(time), heading)))
    clip, time, xy, miss, speed, heading_ = (
        [np.concatenate(p) for p in zip(*parts, strict=True)]
        if parts
        else [np.empty(0, dtype=np.int64), np.empty(0), np.empty((0, 2)), np.empty((0, 2)), np.empty(0), np.empty(0)]
    )
    n = len(time)
    motion = tuple("slide" if t < 0.5 else "roll" if t < 1.8 else "rest" for t in time)
    samples = Samples(
        clip, ("cue",) * n, np.ones(n, dtype=bool), time, xy, miss, speed, heading_, 20 * speed, motion,
        ("strike",) * n, (time > 1).astype(np.int64), np.full(n, np.nan), 0.1 * speed, ("",) * n, time, clip,
    )  # fmt: skip
    where = (
        Group("phase", "while rolling", 0.00123, 1.74, 210),
        Group("phase", "while sliding", 0.00777, 10.99, 90),
        Group("own kind", "behind the <sofa>", math.nan, math.nan, 3),
    )
    clip_set = ClipSet(TABLE, BALL, 50.0, tuple(shots), NOISE)
    return Comparison(
        clip_set=clip_set, model=model, noise_m=NOISE, clips=tuple(rows), segments=tuple(segments),
        where=where if n else (), samples=samples, tracks=tuple(tracks), shots=tuple(shots),
        initial_states=np.zeros((count, 7)), segment_samples=samples, impacts=no_impacts(),
        local=find(samples, samples, no_impacts(), TABLE, count, NOISE, 1.0), white=whiteness(samples, NOISE),
    )  # fmt: skip


def page(tmp_path: Path, comparisons: Sequence[tuple[str, Comparison]], **more: object) -> tuple[str, Page]:
    path = tmp_path / "report.html"
    write_report(path, "A title", comparisons, **more)  # type: ignore[arg-type]
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
    text = path.read_text(encoding="utf-8")
    return text, Page(text)


def words(text: str) -> str:
    """Text of an SVG's labels."""
    return " ".join("".join(e.itertext()) for e in ElementTree.fromstring(text).iter() if e.tag.endswith("}text"))


def test_page_is_whole_and_self_contained(tmp_path: Path) -> None:
    text, seen = page(tmp_path, [("plain", comparison(size=0.01)), ("better", comparison())])
    assert text.startswith("<!DOCTYPE html>") and text.endswith("</html>\n")
    assert seen.open == []
    assert "http" not in re.sub(r"base64,[A-Za-z0-9+/=]+", "", text)
    assert {tag for tag, _ in seen.seen} & {"script", "link", "iframe", "object"} == set()
    pictures = seen.pictures()
    assert len(pictures) == 7
    assert all(attrs["alt"] for tag, attrs in seen.seen if tag == "img")
    for picture in pictures:
        assert re.findall(r'(?:href|src)="(?!#|data:)[^"]*"|@import|url\((?!#)', picture) == []
        assert "<dc:date>" not in picture
    labels = [words(p) for p in pictures]
    marks = ("[mm]", "x [m]", "rms miss in the cell [mm]", "speed [m/s]", "missing [mm/s²]", "lag [samples]", "[count]")
    for label, units in zip(labels, marks, strict=True):
        assert units in label


def test_same_input_gives_same_bytes(tmp_path: Path) -> None:
    import matplotlib

    first, _ = page(tmp_path, [("a", comparison())])
    with matplotlib.rc_context({"font.size": 20, "axes.facecolor": "black", "svg.fonttype": "path"}):
        second, _ = page(tmp_path, [("a", comparison())])
    assert first == second


def test_text_of_users_is_escaped(tmp_path: Path) -> None:
    found = comparison(file=f"clips/{STRANGE.replace('/', '')}{{}}.csv")
    rungs = [Rung(f"r {STRANGE}", 0.002, note=STRANGE)]
    model = dataclasses.replace(found.model, estimates={"ball_impact.friction": Estimate(math.nan, STRANGE)})
    path = tmp_path / "report.html"
    write_report(path, STRANGE, [(STRANGE, found)], ladder=rungs, notes=[STRANGE], model=model)
    text = path.read_text(encoding="utf-8")
    seen = Page(text)
    assert "script" not in {tag for tag, _ in seen.seen}
    assert text.count("&lt;script&gt;alert(&#39;$x$&#39;)") >= 5
    assert "behind the &lt;sofa&gt;" in text
    assert "$x$" in words(seen.pictures()[0])
    assert "$x$" in words(seen.pictures()[1])


def test_numbers_are_those_of_the_comparison(tmp_path: Path) -> None:
    found = comparison()
    rung = Rung("base", 0.01234, 0.02345, 310.4, "three constants")
    model = dataclasses.replace(found.model, estimates={"decoupled_cloth.slide": Estimate(0.00123, "our fit")})
    text, seen = page(tmp_path, [("the <b>", found)], ladder=[rung], notes=["Misses most in draw shots."], model=model)
    rows = [re.sub(r"<[^>]+>", "|", row) for row in re.findall(r"<tr.*?</tr>", text)]

    def row(start: str) -> list[str]:
        return next([cell for cell in r.split("|") if cell.strip()] for r in rows if start in r)

    assert row("base") == ["base", "12.3 mm", "23.4 mm", "310", "–", "–", "–", "three constants"]
    pooled = 1e3 * math.sqrt(np.mean([c.rms_m**2 for c in found.clips if not c.held_out]))
    said = found.summary()
    assert row("the &lt;b&gt;")[1:4] == [f"{pooled:.2f} mm", f"{1e3 * found.clips[1].rms_m:.2f} mm", "41.0"]
    assert row("the &lt;b&gt;")[4] == f"{1e3 * said['struck_rms_median_m']:.2f} mm"
    assert row("the &lt;b&gt;")[6] == "2.10"
    assert row("sliding") == ["while sliding", "11.0", "7.77 mm", "90"]
    assert text.index("while sliding") < text.index("while rolling")
    assert row("sofa") == ["behind the &lt;sofa&gt;", "–", "–", "3"]
    assert row("decoupled_cloth.slide") == ["decoupled_cloth.slide", "0.2000 ± 0.0012", "1", "our fit"]
    assert row("decoupled_cloth.roll")[1:3] == ["0.0127 ± –", "1"]
    assert row("decoupled_cloth.spin")[2] == "rad/s^2"
    assert "Misses most in draw shots." in text
    assert "3 clips" not in text and "clips, 1 of them held out" in text
    assert "nan" not in "".join(seen.words).lower()
    assert "12.3 mm" in words(seen.pictures()[0])
    assert "median 2.10" in words(seen.pictures()[-1])


def test_a_rung_stands_in_for_the_comparison_of_its_label(tmp_path: Path) -> None:
    rungs = [Rung("base", 0.0111), Rung("last", 0.0044)]
    text, _ = page(tmp_path, [("first", comparison(0)), ("last", comparison(0))], ladder=rungs)
    table = text[text.index("<h2>How far each model") :]
    labels = re.findall(r"<tr[^>]*><td>(.*?)</td>", table[: table.index("</table>")])
    assert labels == ["first", "base", "last"]
    assert "4.40 mm" in table


def test_nothing_to_show_is_said(tmp_path: Path) -> None:
    text, seen = page(tmp_path, [])
    assert "Nothing was compared." in text
    assert seen.open == []
    text, _ = page(tmp_path, [], ladder=[Rung("base", math.nan)], model=Model(TABLE, BALL))
    assert "native.slide" in text
    text, seen = page(tmp_path, [("none", comparison(0))])
    assert "Nothing to show." in text
    assert seen.pictures() == []


def test_a_picture_without_its_values_is_none(tmp_path: Path) -> None:
    found = comparison()
    s = found.samples
    unknown = dataclasses.replace(found, noise_m=math.nan)
    assert dependence_svg(unknown) is None
    assert "rms miss" in words(map_svg(unknown) or "")
    assert dependence_svg(dataclasses.replace(found, noise_m=0.0)) is None
    assert tracks_svg(dataclasses.replace(found, tracks=(), shots=())) is None
    assert spread_svg(dataclasses.replace(found, segments=(), clips=())) is None
    assert "0 segments" in words(spread_svg(dataclasses.replace(found, segments=())) or "")
    assert ladder_svg([Rung("a", math.nan)], NOISE) is None
    gone = dataclasses.replace(
        s, residual=np.where(s.time[:, None] < 1, np.nan, s.residual), heading=s.heading * np.nan
    )
    assert dependence_svg(dataclasses.replace(found, samples=gone))
    assert map_svg(dataclasses.replace(found, samples=dataclasses.replace(s, residual=0 * s.residual)))
    rows = tuple(dataclasses.replace(r, struck_rms_m=math.nan, chi2_reduced=math.inf) for r in found.clips)
    broken = dataclasses.replace(found, clips=rows, samples=comparison(0).samples, segments=())
    _, seen = page(tmp_path, [("a", broken)])
    assert "nan" not in "".join(seen.words).lower()
    assert "inf" not in "".join(seen.words).lower()


def test_worst_and_typical_shots_are_drawn() -> None:
    found = comparison(9)
    rows = tuple(dataclasses.replace(r, struck_rms_m=0.001 * (k + 1)) for k, r in enumerate(found.clips))
    label = words(tracks_svg(dataclasses.replace(found, clips=rows)) or "")
    shown = re.findall(r"(Worst|Typical) · (\d): struck ball (\d)\.00 mm rms( · held out)?", label)
    assert [(kind, int(name), int(mm)) for kind, name, mm, _ in shown] == [
        ("Worst", 8, 9), ("Worst", 7, 8), ("Worst", 6, 7), ("Typical", 5, 6), ("Typical", 4, 5), ("Typical", 3, 4),
    ]  # fmt: skip
    assert [bool(held) for *_, held in shown] == [False, True, False, True, False, True]


def test_failure_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for path in (tmp_path / "absent" / "report.html", tmp_path, tmp_path / ("x" * 300)):
        with pytest.raises(BadInput) as caught:
            write_report(path, "A title", [])
        assert str(caught.value).isprintable()
        assert list(tmp_path.iterdir()) == []
    (tmp_path / "report.html").write_text("before")

    def refuse(self: Path, target: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(BadInput, match="No space left"):
        write_report(tmp_path / "report.html", "A title", [])
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
    assert (tmp_path / "report.html").read_text() == "before"


def test_many_samples_stay_small(tmp_path: Path) -> None:
    found = comparison(8)
    s, times = found.samples, 65
    many = Samples(*(np.concatenate([v] * times) if isinstance(v, np.ndarray) else v * times for v in vars(s).values()))
    assert len(many.time) > 50_000
    text, _ = page(tmp_path, [("a", dataclasses.replace(found, samples=many))])
    assert len(text) < 3_000_000
