"""The report: whole, self-contained, escaped, the same bytes again, and its numbers those of the comparison."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from models.errors import BadInput
from models.model_file import Estimate
from sysid.clips import CueCommand
from sysid.report.html import write_report
from sysid.report.pictures.cloth_picture import cloth_pictures
from sysid.report.pictures.figures import Rung, dependence_charts, ladder_chart, segments_chart, shots_chart
from sysid.report.pictures.figures_where import misses_map
from sysid.report.pictures.player import MAX_POINTS, NO_BALL, playback
from sysid.report.verdict import Verdict
from sysid.residuals.comparison import Comparison
from sysid.residuals.functions.cloth_field import ClothField
from sysid.residuals.functions.curves import Rails
from sysid.residuals.functions.lacking import Lacking
from sysid.residuals.functions.smooth import Explanation
from sysid.residuals.samples import Samples
from sysid.selection.next_shot import NextShot
from tests.support.comparison_samples import NOISE, TABLE, comparison, rolled
from tests.support.html_pages import STRANGE, Page

UNIT = re.compile(r"\[[^]]+\]")


def page(tmp_path: Path, comparisons: Sequence[tuple[str, Comparison]], **more: object) -> tuple[str, Page]:
    path = tmp_path / "report.html"
    write_report(path, "A title", comparisons, **more)  # type: ignore[arg-type]
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
    text = path.read_text(encoding="utf-8")
    return text, Page(text)


def without_scripts(text: str) -> str:
    """The page without the library that draws."""
    return re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)


def test_page_is_whole_and_self_contained(tmp_path: Path) -> None:
    text, seen = page(tmp_path, [("plain", comparison(9, size=0.01)), ("better", comparison(9))])
    assert text.startswith("<!DOCTYPE html>") and text.endswith("</html>\n")
    assert seen.open == []
    assert "http" not in without_scripts(text)
    assert {tag for tag, _ in seen.seen} & {"link", "iframe", "object", "img"} == set()
    assert all("src" not in attrs for _, attrs in seen.seen)
    assert text.count("plotly.js (cartesian") == 1
    assert len(text.encode()) < 3_000_000
    charts = seen.figures()["charts"]
    names = [chart["name"] for chart in charts]
    assert len(names) == len(set(names)) > 8
    assert {"ladder", "shots", "misses", "signed", "white", "segments"} <= set(names)
    assert text.count('<svg class="cloth"') == 2, "before and after"
    ids = [attrs["id"] for _, attrs in seen.seen if "id" in attrs]
    assert len(ids) == len(set(ids))
    assert {f"chart-{name}" for name in names} <= {attrs.get("id") for _, attrs in seen.seen}
    for chart in charts:
        assert chart["title"]
        for axis in ("xaxis", "yaxis"):
            title = chart["layout"][axis]["title"]["text"]
            assert UNIT.search(title) or title == "model", title


def test_same_input_gives_same_bytes(tmp_path: Path) -> None:
    first, _ = page(tmp_path, [("a", comparison())])
    second, _ = page(tmp_path, [("a", comparison())])
    assert first == second


def test_text_of_users_is_escaped(tmp_path: Path) -> None:
    found = comparison(file=f"clips/{STRANGE.replace('/', '')}{{}}.csv")
    rungs = [Rung(f"r {STRANGE}", 0.002, note=STRANGE)]
    model = dataclasses.replace(found.model, estimates={"ball_impact.friction": Estimate(math.nan, STRANGE)})
    found = dataclasses.replace(found, model=model)
    path = tmp_path / "report.html"
    said = Verdict(STRANGE, STRANGE, STRANGE, STRANGE, STRANGE)
    write_report(path, STRANGE, [(STRANGE, found)], ladder=rungs, notes=[STRANGE], verdict=said)
    text = path.read_text(encoding="utf-8")
    seen = Page(text)
    assert [attrs for tag, attrs in seen.seen if tag == "script"] == [
        {"type": "application/json", "id": "figures"},
        {},
        {},
    ]
    assert "<script>alert" not in text
    assert text.count("&lt;script&gt;alert(&#39;$x$&#39;)") >= 9
    assert "behind the &lt;sofa&gt;" in text
    figures = seen.figures()
    ladder = next(chart for chart in figures["charts"] if chart["name"] == "ladder")
    assert "&lt;script&gt;alert" in ladder["layout"]["annotations"][0]["text"], "Plotly reads tags in labels"
    assert "$x$" in figures["player"]["shots"][0]["name"], "set as text, never as markup"


def test_numbers_are_those_of_the_comparison(tmp_path: Path) -> None:
    found = comparison()
    rung = Rung("base", 0.01234, 0.02345, 310.4, "three constants")
    model = dataclasses.replace(found.model, estimates={"decoupled_cloth.slide": Estimate(0.00123, "our fit")})
    found = dataclasses.replace(found, model=model)
    text, seen = page(tmp_path, [("the <b>", found)], ladder=[rung], notes=["Misses most in draw shots."])
    text = without_scripts(text).replace("<wbr>", "")
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
    assert row("decoupled_cloth.slide") == ["decoupled_cloth.slide", "0.2000 ± 0.0012"], "without a unit, no 1"
    assert "<dt>decoupled_cloth.slide</dt><dd>our fit</dd>" in text
    assert row("decoupled_cloth.roll") == ["decoupled_cloth.roll", "0.0127"]
    assert row("decoupled_cloth.spin")[2] == "rad/s²"
    assert "Misses most in draw shots." in text
    assert "3 clips" not in text and "clips, 1 of them held out" in text
    assert "nan" not in text.lower().replace("nano", "")
    by_name = {chart["name"]: chart for chart in seen.figures()["charts"]}
    assert "12.3 mm, held out 23.4 mm: base" in by_name["ladder"]["layout"]["annotations"][0]["text"]
    assert "median 2.10" in by_name["segments"]["data"][0]["name"]
    used, held = (
        next(t for t in by_name["shots"]["data"] if t["name"] == n) for n in ("this model", "this model, held out")
    )
    assert sorted(used["y"]) == pytest.approx(sorted(1e3 * c.rms_m for c in found.clips if not c.held_out), rel=1e-3)
    assert held["y"] == pytest.approx([1e3 * found.clips[1].rms_m], rel=1e-3)


def test_a_rung_stands_in_for_the_comparison_of_its_label(tmp_path: Path) -> None:
    rungs = [Rung("base", 0.0111), Rung("last", 0.0044)]
    text, _ = page(tmp_path, [("first", comparison(0)), ("last", comparison(0))], ladder=rungs)
    table = text[text.index("<summary>The same as a table") :]
    labels = re.findall(r"<tr[^>]*><td>(.*?)</td>", table[: table.index("</table>")])
    assert labels == ["first", "base", "last"]
    assert "4.40 mm" in table


def test_a_verdict_comes_first_and_its_lines_are_folded(tmp_path: Path) -> None:
    said = Verdict("It slopes", "table_tilt", "the miss falls", "sure", "film a shot")
    text, _ = page(
        tmp_path,
        [
            (
                "a",
                comparison(),
            )
        ],
        notes=["a line"],
        verdict=said,
    )
    order = [
        text.index(part) for part in ("It slopes.", "table_tilt.", "the miss falls.", "film a shot.", "a line", "cards")
    ]
    assert order[:-1] == sorted(order[:-1])
    assert "<details><summary>All messages" in text


def test_nothing_to_show_is_said(tmp_path: Path) -> None:
    text, seen = page(tmp_path, [])
    assert "Nothing was compared." in text and "<script" not in text
    assert seen.open == []
    text, _ = page(tmp_path, [], ladder=[Rung("base", math.nan)])
    assert "Nothing to show." in text
    text, seen = page(tmp_path, [("none", comparison(0))])
    assert "Nothing to show." in text
    assert seen.figures()["charts"] == []


def test_a_figure_without_its_values_is_none(tmp_path: Path) -> None:
    found = comparison()
    s = found.samples
    unknown = dataclasses.replace(found, noise_m=math.nan)
    assert dependence_charts(unknown) == dependence_charts(dataclasses.replace(found, noise_m=0.0)) == []
    assert misses_map(unknown) is not None
    assert playback([("a", dataclasses.replace(found, tracks=(), shots=()))]) is None
    assert segments_chart(dataclasses.replace(found, segments=())) is None
    assert shots_chart([("a", dataclasses.replace(found, clips=()))]) is None
    assert ladder_chart([Rung("a", math.nan)], NOISE) is None
    gone = dataclasses.replace(
        s, residual=np.where(s.time[:, None] < 1, np.nan, s.residual), heading=s.heading * np.nan
    )
    assert dependence_charts(dataclasses.replace(found, samples=gone))
    assert misses_map(dataclasses.replace(found, samples=dataclasses.replace(s, residual=0 * s.residual)))
    rows = tuple(dataclasses.replace(r, struck_rms_m=math.nan, chi2_reduced=math.inf) for r in found.clips)
    broken = dataclasses.replace(found, clips=rows, samples=comparison(0).samples, segments=())
    text, _ = page(tmp_path, [("a", broken)])
    assert not re.search(r"\b(nan|inf)\b", without_scripts(text).lower())


def test_shots_are_played_back_as_they_were_seen() -> None:
    before, after = comparison(size=0.01), comparison()
    data = playback([("one", before), ("two", after)])
    assert data is not None
    assert data["models"] == ["before: one", "after: two"]
    was = {c.file: c.rms_m for c in before.clips}
    most = max(after.clips, key=lambda c: abs(was[c.file] - c.rms_m))
    shot = data["shots"][0]
    assert f"clips/{shot['name']}.csv" == most.file and shot["held"] is most.held_out, "its miss changes most"
    k = [c.file for c in after.shots].index(most.file)
    cue, red = shot["balls"]
    seen = after.shots[k].balls["cue"]
    assert np.cumsum(cue["t"]) / 1e3 == pytest.approx(seen.time, abs=5e-4)
    assert np.cumsum(cue["x"]) / 1e4 == pytest.approx(seen.xy[:, 0], abs=5e-5)
    for number, one in enumerate((before, after)):
        miss = one.tracks[k].position[:, 0] - seen.xy
        assert pytest.approx(miss, abs=5e-5) == np.array(cue["miss"][number]).T / 1e4
    assert len(red["t"]) == 2, "a ball that rests is told by its first and last sample"
    assert red["miss"][0][0][-1] == NO_BALL, "a model's ball that is gone"
    worst = max(after.clips, key=lambda c: c.rms_m)
    alone = playback([("two", after)])
    assert alone is not None and f"clips/{alone['shots'][0]['name']}.csv" == worst.file


def test_many_samples_are_thinned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sysid.report.pictures.player.MAX_POINTS", 60)
    data = playback([("a", comparison())])
    assert data is not None
    points = [len(ball["t"]) for shot in data["shots"] for ball in shot["balls"]]
    assert sum(points) <= 60 + 2 * len(points) < MAX_POINTS
    assert all(sum(ball["t"]) == pytest.approx(1980) for shot in data["shots"] for ball in shot["balls"]), "to the end"


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


def field(push: Sequence[float], change: float = 0.0, sd: float = 0.0005) -> Explanation[ClothField]:
    """A cloth that pushes alike everywhere, and slows in one cell."""
    slower = np.zeros((16, 8))
    slower[11, 5] = change
    spread = np.full((16, 8), sd)
    seen = np.ones((16, 8), dtype=bool)
    seen[:2] = False
    x, y = np.linspace(-1.7, 1.7, 16), np.linspace(-0.8, 0.8, 8)
    found = ClothField(x, y, np.tile(push, (16, 8, 1)), spread, (0.0, sd), slower, spread, seen)
    return Explanation(found, 50.0, np.zeros(0))


def test_a_tilt_is_drawn_as_one_before_and_not_after() -> None:
    before, after = Lacking(field([0.005, -0.011]), None, ()), Lacking(field([1e-5, 0.0]), None, ())
    pictures = cloth_pictures([("before", before), ("after", after)], TABLE)
    arrows = pictures[0].arrows
    assert len(arrows) == 32 and not pictures[1].arrows
    ways = {(round(a["x2"] - a["x1"], 6), round(a["y2"] - a["y1"], 6)) for a in arrows}
    assert len(ways) == 1 and next(iter(ways))[0] > 0 and next(iter(ways))[1] > 0, "alike; to +x and -y, down the page"
    assert {a["opacity"] for a in arrows} == {1.0, 0.35}, "pale where no ball rolled"
    assert pictures[0].legend == pictures[1].legend
    assert pictures[0].legend[0] == ("arrows", "10 mm/s², as on a slope of 1.4 mm in a metre")
    assert not pictures[0].colours and len(pictures[0].hatched) == 16


def test_a_patch_is_coloured_and_small_pushes_stay_small() -> None:
    seen = Lacking(field([0.002, 0.0], change=-0.1), None, ())
    picture = cloth_pictures([("base", seen)], TABLE)[0]
    assert [one["slower"] for one in picture.colours] == [True]
    assert not picture.arrows, "shorter than can be seen on the scale of the patch"
    assert picture.legend[:2] == (
        ("arrows", "100 mm/s², as on a slope of 14 mm in a metre"), ("colours", "100 mm/s²"),
    )  # fmt: skip


def test_nothing_is_drawn_on_the_scale_of_a_good_table() -> None:
    rails = Explanation(Rails(("+x", "-y"), np.array([0.001, -0.002]), np.array([0.002, 0.002])), -1.0, np.zeros(0))
    picture = cloth_pictures([("base", Lacking(field([0.0, 0.0]), rails, ()))], TABLE)[0]
    assert not picture.arrows and not picture.colours
    assert [bar["kind"] for bar in picture.bars] == ["same", "same"]
    assert max(abs(bar["length"]) for bar in picture.bars) < 2, "bars of cushions that are as modelled are short"
    assert dict(picture.legend)["arrows"].startswith("2 mm/s²")


def test_a_rail_that_differs_has_a_bar_with_a_whisker() -> None:
    rails = Explanation(Rails(("+x", "-y"), np.array([0.001, -0.13]), np.array([0.002, 0.004])), 9.0, np.zeros(0))
    picture = cloth_pictures([("base", Lacking(field([0.0, 0.0]), rails, ()))], TABLE)[0]
    same, slower = picture.bars
    assert same["kind"] == "same" and slower["kind"] == "slower"
    assert slower["words"] == "\N{MINUS SIGN}13.00 ± 0.40 %"
    assert slower["low"] < slower["length"] < slower["high"] < 0


def test_what_explains_most_comes_first(tmp_path: Path) -> None:
    before, after = (
        rolled(lambda xy, way, speed, size=size: size * (speed - 0.6)[:, None] * way) for size in (-0.04, 0.0)
    )
    text, seen = page(tmp_path, [("plain", before), ("with drag", after)])
    curve, cloth = text.index('id="chart-lacking-most-motion"'), text.index('<svg class="cloth"')
    assert curve < cloth < text.index('class="cards"')
    chart = next(one for one in seen.figures()["charts"] if one["name"] == "lacking-most-motion")
    assert "by speed" in chart["title"]
    named = [trace["name"] for trace in chart["data"] if trace.get("showlegend")]
    assert named == ["Before: plain", "After: with drag"]


def test_the_next_shots_are_drawn_with_both_balls(tmp_path: Path) -> None:
    why = "to separate table_tilt from cloth_nap"
    shot = NextShot(CueCommand(1.5, 0.1, 0.003), (-1.0, 0.2), (0.0, 0.3), 9.0, why, 0.2)
    alone = NextShot(CueCommand(1.5, -1.0), (-1.0, 0.2), None, 5.0, why, 0.01)
    text, _ = page(tmp_path, [("base", comparison())], next_shots=[shot, alone])
    pictures = re.findall(r'<svg class="cloth shot".*?</svg>', text, re.DOTALL)
    assert [picture.count("<polyline") for picture in pictures] == [2, 1]
    assert ">cue ball<" in pictures[0] and ">red<" in pictures[0] and ">red<" not in pictures[1]
    assert f"Shot 1 of 2: {why}" in text
    assert (
        "Lay the cue ball at x = -1.000, y = 0.200 m, a red at x = 0.000, y = 0.300 m; strike the cue ball 3 mm right"
        in text
    )


def test_bars_of_evidence_are_as_long_as_the_evidence(tmp_path: Path) -> None:
    """82 is no half of 13,948."""
    fits = [
        SimpleNamespace(
            name=name, evidence=SimpleNamespace(delta_bic=value), fitted=SimpleNamespace(miss=1e-3, held_miss=1e-3),
            converged=True,
        )
        for name, value in (("table_tilt", 13948.0), ("worn_patch", 82.0), ("air_drag", -3.0))
    ]  # fmt: skip
    base = SimpleNamespace(model=comparison(0).model)
    scores, none = SimpleNamespace(rows=()), ()
    seen: Any = SimpleNamespace(
        fits=fits, scores=scores, windows=0, base=base, best=fits[0], confounded=none, tied=none, count=100
    )  # fmt: skip
    text, _ = page(tmp_path, [("base", comparison(0))], rounds=[seen])
    lengths = [float(v) for v in re.findall(r'class="bar"><i style="width:([\d.]+)%', text)]
    assert lengths == pytest.approx([100.0, 100 * 82 / 13948, 0.0], abs=0.05)
