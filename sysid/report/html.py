"""The report of a comparison: one HTML file with its pictures inside, for a browser without network or scripts.

Tables, captions and style are here, the pictures in sysid/report/plots.py. The same input gives the same bytes.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

import numpy as np

from models.files import write_whole
from models.model_file import Estimate, Model
from sysid.report.plots import Rung, dependence_svg, ladder_svg, map_svg, number, spread_svg, tracks_svg
from sysid.report.plots_where import missing_map_svg, missing_svg, white_svg
from sysid.residuals.comparison import Comparison, Group

__all__ = ["Rung", "write_report"]

LONGEST_TABLE = 10  # groups of one kind that are listed
GROUPS = {
    "phase": "What the ball does",
    "event": "After which event",
    "speed": "At which speed",
    "rail": "At which cushion",
    "ball": "Which ball",
    "segment": "Which stretch between events",
    "clip": "Which clip",
}
FAINTEST = 0.5  # ratio at which an inline bar starts
LADDER = (
    "Each bar is one model's rms distance over moving balls, in the clips used for its constants (in all clips where "
    "none is held out); shorter is better, and the axis is logarithmic. The dashed line is what the camera's noise "
    "alone leaves (√2 times the noise per axis). A good model ends at that line, and its held-out clips, which had no "
    "part in choosing its constants, end there too; a held-out mark far to the right of its bar says that the model "
    "learnt its clips by heart."
)
TRACKS = (
    "The table from above. Dots are measured, in the balls' own colours; filled discs are where the balls were last "
    "seen. Cyan lines and rings are the model. With a good model every line runs through its dots and every ring "
    "sits on its disc; a line that leaves its dots at a cushion or a ball says that this impact is modelled wrongly, "
    "one that bends away slowly blames the cloth."
)
MAP = (
    "Moving balls only. Colour: rms miss of the samples in each cell; arrows: mean miss, from the measured to the "
    "modelled place, drawn as many times longer as stated. With a good model the map is evenly pale, at the mark in "
    "the colour bar, and the arrows are short and point anywhere. Arrows that agree over a region mean a cause that "
    "is tied to the place: a tilted table, nap, a worn patch, the camera's lens."
)
DEPENDENCE = (
    "Miss over noise, on a logarithmic axis: the median line and the band that holds 80 % of the samples. With a good "
    "model the blue line lies on the grey dashed one and the blue band covers the grey, in every panel, without a "
    "trend. A rise with one quantity says what the missing physics depends on. Speed, heading and the last panel leave "
    "out balls at rest. Last panel: the miss in mm, split into along and across the ball's way; a good model stays at "
    "zero in both."
)
SPREAD = (
    "Left: how well each stretch between two events fits by itself, its own start free. A good model piles up at 1; a "
    "tail to the right is motion on the cloth that the model cannot follow, or an event that was not seen. Right: the "
    "error over whole shots, which adds up cloth, cushions and balls; a good model is low and flat, and held-out clips "
    "lie no higher than the others. A few tall bars at the right end are clips to look at one by one."
)
WHERE = (
    "Every group of samples, by rms residual per axis over the noise, the worst first. Bars are logarithmic; the tick "
    "is noise alone (1). With a good model every bar ends near the tick; the group that stands out says where to look."
)
MISSING_MAP = (
    "Rolling balls, each stretch between events begun anew. Arrows: acceleration that measured balls have and the "
    "model lacks, in the direction in which they are pulled, by cell; colour: how sure that is, in standard deviations "
    "(clips as witnesses). A cell also reads its neighbours, through the stretches that cross both; cells of too few "
    "clips are empty. With a good model everything is pale and arrows point "
    "anywhere."
)
MISSING = (
    "The same accelerations along the ball's way (+ is faster than modelled) and across it (+ is to the left), group "
    "by group, with bars of two standard deviations. With a good model every bar covers zero. Groups of few clips "
    "are left out."
)
WHITE = (
    "Correlation of residuals of whole shots with those some samples later, within one ball's stretch; the grey band "
    "holds 95 % of white noise. Bars that stay above it mean that the model's error lasts, and how long."
)
CSS = """
:root{--ink:#1f2933;--soft:#5b6772;--line:#e0e4e8;--blue:#2563a8}
*{box-sizing:border-box}
body{margin:0 auto;max-width:1100px;padding:28px 24px 48px;color:var(--ink);background:#fff;
 font:15px/1.5 system-ui,"Segoe UI","Helvetica Neue",Arial,"DejaVu Sans",sans-serif}
h1{font-size:27px;line-height:1.25;margin:0 0 4px;overflow-wrap:anywhere}
h2{font-size:19px;margin:38px 0 8px;padding-top:14px;border-top:1px solid var(--line)}
h3{font-size:14px;margin:0 0 4px}
.sub,figcaption,.more{color:var(--soft);font-size:13.5px}
.sub{margin:0 0 18px;overflow-wrap:anywhere}
.notes{margin:18px 0;padding:10px 16px 10px 34px;background:#fdf6ea;border-left:4px solid #d9730d}
.notes li{margin:3px 0;overflow-wrap:anywhere}
.cards{display:grid;grid-template-columns:repeat(7,1fr);gap:10px;margin:18px 0}
.card{border:1px solid var(--line);border-radius:6px;padding:9px 11px}
.card b{display:block;font-size:20px;line-height:1.3;font-variant-numeric:tabular-nums;white-space:nowrap}
.card span{font-size:12px;line-height:1.3;display:block;color:var(--soft)}
figure{margin:10px 0 0;break-inside:avoid}
figure img{display:block;width:100%;height:auto}
figcaption{margin:6px 0 0;max-width:920px}
table{border-collapse:collapse;width:100%;font-size:13.5px}
th{text-align:left;font-size:12px;color:var(--soft);border-bottom:1.5px solid #c3cad1;padding:4px 8px 4px 0;
 vertical-align:bottom}
td{border-bottom:1px solid var(--line);padding:4px 8px 4px 0;overflow-wrap:anywhere;vertical-align:top}
tr{break-inside:avoid}
.n+:not(.n){padding-left:10px}
.n{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}
th.n{white-space:normal}
.drawn td{font-weight:600}
.groups{display:grid;grid-template-columns:1fr 1fr;gap:22px 34px;margin-top:14px}
.groups section{break-inside:avoid;min-width:0}
.bar{position:relative;width:120px;height:11px;margin-top:5px;background:#f1f3f5}
.bar i{position:absolute;left:0;top:0;bottom:0;background:var(--blue)}
.bar u{position:absolute;top:-2px;bottom:-2px;width:1.5px;background:var(--ink)}
@media(max-width:760px){.cards{grid-template-columns:repeat(2,1fr)}.groups{grid-template-columns:1fr}}
@media print{body{padding:0;font-size:11pt}@page{margin:14mm}h2{break-after:avoid}
 .bar,.bar i,.bar u,.notes{print-color-adjust:exact;-webkit-print-color-adjust:exact}}
"""


def write_report(
    path: Path | str,
    title: str,
    comparisons: Sequence[tuple[str, Comparison]],
    *,
    ladder: Sequence[Rung] = (),
    notes: Sequence[str] = (),
    model: Model | None = None,
    sections: Sequence[str] = (),
) -> None:
    """Write one HTML file, whole or not at all; the last comparison is drawn in full.

    `comparisons` are (label, comparison), from the poorest model to the best. Rungs of `ladder` come between them; a
    rung with a comparison's label stands in its place. Without `model` the last comparison's constants are listed.
    `sections` are HTML, shown after the ladder.
    """
    write_whole(path, _page(title, comparisons, ladder, notes, model, sections).encode())


def _page(
    title: str,
    comparisons: Sequence[tuple[str, Comparison]],
    ladder: Sequence[Rung],
    notes: Sequence[str],
    model: Model | None,
    sections: Sequence[str],
) -> str:
    label, last = comparisons[-1] if comparisons else ("", None)
    body = [f"<h1>{_text(title)}</h1>"]
    if last is not None:
        table, ball = last.clip_set.table, last.clip_set.ball
        body.append(
            f'<p class="sub">Model: {_text(label)}. Table {table.length:g} m × {table.width:g} m, '
            f"{'with' if table.pockets else 'without'} pockets; balls {1e3 * ball.diameter:g} mm, {ball.mass:g} kg.</p>"
        )
    if notes:
        body.append('<ul class="notes">' + "".join(f"<li>{_text(note)}</li>" for note in notes) + "</ul>")
    body.append('<p class="sub">Nothing was compared.</p>' if last is None else _cards(last))
    body += [*_ladder(comparisons, ladder), *sections]
    if last is not None:
        body += ["<h2>Shots from above</h2>", _figure(tracks_svg(last), "Shots from above", TRACKS)]
        body += ["<h2>Where on the table</h2>", _figure(map_svg(last), "Map of the misses", MAP)]
        what = "Miss against time, speed, heading, sidespin and events"
        body += ["<h2>What the error depends on</h2>", _figure(dependence_svg(last), what, DEPENDENCE)]
        body += ["<h2>What departs</h2>", _named(last)]
        body += [_figure(missing_map_svg(last), "Map of the accelerations that the model lacks", MISSING_MAP)]
        body += [_figure(missing_svg(last), "Accelerations that the model lacks, by variable", MISSING)]
        body += ["<h2>Is the rest noise?</h2>", _figure(white_svg(last), "Autocorrelation of the residuals", WHITE)]
        body += ["<h2>Stretches and whole shots</h2>", _figure(spread_svg(last), "Spread of the errors", SPREAD)]
        body += ["<h2>Where the model departs</h2>", _where(last.where)]
    shown = model if model is not None else (last.model if last is not None else None)
    if shown is not None:
        body += ["<h2>Constants of the model</h2>", _constants(shown)]
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{_text(title)}</title>'
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>{head}\n<style>{CSS}</style></head>\n<body>\n'
        + "\n".join(body)
        + "\n</body>\n</html>\n"
    )


def _cards(comparison: Comparison) -> str:
    """The figures that a person asks for first."""
    said = comparison.summary()
    held = sum(c.held_out for c in comparison.clips)
    cards = (
        (str(len(comparison.clips)), f"clips, {held} of them held out"),
        (number(len(comparison.samples.time)), "samples compared"),
        (_mm(comparison.noise_m), "noise, one standard deviation per axis"),
        (_mm(said["struck_rms_median_m"]), "struck ball, rms over a shot, median"),
        (_mm(said["struck_rms_median_held_out_m"]), "the same, held-out clips only"),
        (_mm(said["mujoco_struck_rms_median_m"]), "struck ball, the same constants in MuJoCo"),
        (number(said["segment_ratio_median"]), "residual / noise of segments, median"),
    )
    return (
        '<div class="cards">'
        + "".join(f'<div class="card"><b>{b}</b><span>{s}</span></div>' for b, s in cards)
        + "</div>"
    )


def _ladder(comparisons: Sequence[tuple[str, Comparison]], ladder: Sequence[Rung]) -> list[str]:
    """Table and picture of all models, the comparisons' and the rungs given."""
    known = {rung.label for rung in ladder}
    own = [_rung(label, comparison) for label, comparison in comparisons]
    before = [rung for rung in own[:-1] if rung.label not in known]
    rungs = [*before, *ladder, *(rung for rung in own[-1:] if rung.label not in known)]
    if not rungs:
        return []
    said = {label: comparison.summary() for label, comparison in comparisons}
    rows = []
    for rung in rungs:
        medians = said.get(rung.label, {})
        struck, held, ratio = (
            medians.get(key, math.nan)
            for key in ("struck_rms_median_m", "struck_rms_median_held_out_m", "segment_ratio_median")
        )
        cells = [_mm(rung.rms_m), _mm(rung.held_out_rms_m), number(rung.chi2_reduced)]
        cells += [_mm(struck), _mm(held), number(ratio)]
        numbers = "".join(f'<td class="n">{cell}</td>' for cell in cells)
        drawn = ' class="drawn"' if comparisons and rung.label == comparisons[-1][0] else ""
        rows.append(f"<tr{drawn}><td>{_text(rung.label)}</td>{numbers}<td>{_text(rung.note)}</td></tr>")
    heads = ["rms", "rms, held out", "reduced χ²"]
    heads += ["struck ball, median", "struck, held out, median", "segments, residual / noise"]
    head = "<th>model</th>" + "".join(f'<th class="n">{h}</th>' for h in heads) + "<th>note</th>"
    noise = comparisons[-1][1].noise_m if comparisons else math.nan
    return [
        "<h2>Error ladder</h2>",
        f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>",
        _figure(ladder_svg(rungs, noise), "Error ladder", LADDER),
    ]


def _rung(label: str, comparison: Comparison) -> Rung:
    """A comparison's place on the ladder: clips weigh the same, χ² is the clips' median."""

    def rms(values: Iterable[float]) -> float:
        good = [v for v in values if math.isfinite(v)]
        return math.sqrt(float(np.mean(np.square(good)))) if good else math.nan

    clips = comparison.clips
    used = [c.rms_m for c in clips if not c.held_out] or [c.rms_m for c in clips]
    chi2 = [c.chi2_reduced for c in clips if math.isfinite(c.chi2_reduced)]
    return Rung(
        label,
        rms(used),
        rms(c.rms_m for c in clips if c.held_out),
        float(np.median(chi2)) if chi2 else math.nan,
    )


def _where(where: Sequence[Group]) -> str:
    """Departures, one table per kind of group."""
    if not where:
        return '<p class="sub">Nothing to show.</p>'
    top = max([2.0, *(d.ratio for d in where if math.isfinite(d.ratio))])

    def reach(ratio: float) -> float:
        return 100 * min(1.0, max(0.0, math.log(max(ratio, FAINTEST) / FAINTEST) / math.log(top / FAINTEST)))

    sections = []
    for by in [
        *(b for b in GROUPS if any(d.by == b for d in where)),
        *dict.fromkeys(d.by for d in where if d.by not in GROUPS),
    ]:
        own = sorted((d for d in where if d.by == by), key=lambda d: -d.ratio if math.isfinite(d.ratio) else math.inf)
        rows = []
        for d in own[:LONGEST_TABLE]:
            bar = f'<i style="width:{reach(d.ratio):.1f}%"></i>' if math.isfinite(d.ratio) else ""
            rows.append(
                f'<tr><td>{_text(d.where)}</td><td class="n">{number(d.ratio)}</td><td><div class="bar">{bar}'
                f'<u style="left:{reach(1.0):.1f}%"></u></div></td><td class="n">{_mm(d.rms_m)}</td>'
                f'<td class="n">{number(d.samples)}</td></tr>'
            )
        name = _text(GROUPS.get(by, by))
        numbers = "".join(f'<th class="n">{h}</th>' for h in ("residual / noise", "", "rms", "count"))
        head = f"<th>{_text(by)}</th>{numbers}"
        rest = len(own) - LONGEST_TABLE
        more = f'<p class="more">and {rest} more, all below these</p>' if rest > 0 else ""
        table = f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
        sections.append(f"<section><h3>{name}</h3>{table}{more}</section>")
    return f'<p class="sub">{WHERE}</p><div class="groups">{"".join(sections)}</div>'


def _named(comparison: Comparison) -> str:
    """The departures worth naming, and what the error depends on."""
    rows = [
        f"<tr><td>{_text(d.where)}</td><td>{_text(d.variable)}</td><td>{_text(d.quantity)} [{_text(d.unit)}]</td>"
        f'<td class="n">{_with_sd(d.value, d.sd)}</td><td class="n">{d.z:.0f}</td>'
        f'<td class="n">{number(d.samples)}</td></tr>'
        for d in comparison.local.named
    ]
    if not rows:
        return '<p class="sub">Nothing stands out: no group departs from the model beyond chance.</p>'
    heads = "<th>departure</th><th>variable</th><th>quantity</th>" + "".join(
        f'<th class="n">{h}</th>' for h in ("measured less modelled", "z", "count")
    )
    return f"<table><thead><tr>{heads}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _constants(model: Model) -> str:
    """Value, uncertainty, unit and source of every constant that acts."""
    known = {f"{e.name()}.{key}": meta for e in model.stack() for key, meta in e.parameters().items()}
    rows = []
    for name, value in model.parameters().items():
        estimate = model.estimates.get(name, Estimate())
        number = "one per simulation" if np.ndim(value) else _with_sd(float(value), estimate.sd)
        source = estimate.source or str(known[name]["source"])
        unit = _text(str(known[name]["unit"]))
        rows.append(
            f'<tr><td>{_text(name)}</td><td class="n">{number}</td><td>{unit}</td><td>{_text(source)}</td></tr>'
        )
    head = '<th>constant</th><th class="n">value ± standard deviation</th><th>unit</th><th>source</th>'
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _figure(svg: str | None, what: str, caption: str) -> str:
    if svg is None:
        return '<p class="sub">Nothing to show.</p>'
    data = base64.b64encode(svg.encode()).decode()
    picture = f'<img alt="{escape(what)}" src="data:image/svg+xml;base64,{data}">'
    return f"<figure>{picture}<figcaption>{caption}</figcaption></figure>"


def _text(text: str) -> str:
    """Any text, safe in HTML; characters that cannot be shown are spelt out."""
    return escape("".join(c if c.isprintable() else " " if c.isspace() else ascii(c)[1:-1] for c in str(text)))


def _mm(metres: float) -> str:
    return f"{number(1e3 * metres)} mm" if math.isfinite(metres) else "–"


def _with_sd(value: float, sd: float) -> str:
    """Value ± sd, to two digits of the sd; – for one that was not computed."""
    if not math.isfinite(value):
        return "–"
    if not math.isfinite(sd) or sd <= 0:
        return f"{value:.5g} ± –"
    digits = max(0, 1 - math.floor(math.log10(sd)))
    return f"{value:.{digits}f} ± {sd:.{digits}f}" if digits <= 9 else f"{value:.6g} ± {sd:.2g}"
