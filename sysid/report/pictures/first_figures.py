"""The figures that a report opens with: what the model lacks, the largest cause first.

In: comparisons of the poorest model and the best. Out: `FirstFigure`s: always the table from above, and for motion
and impacts the curve that explains more than the table does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from models.report.chart import Chart, shortened
from sysid.report.pictures.cloth_picture import ClothPicture, cloth_pictures
from sysid.report.pictures.figures_where import lacking_curve_chart
from sysid.residuals.comparison import Comparison
from sysid.residuals.functions.lacking import lacking

MAX_LABEL_CHARS = 40  # of a model above a picture


@dataclass(frozen=True)
class FirstFigure:
    """The table from above, of every model, or a chart."""

    pictures: tuple[ClothPicture, ...] = ()
    charts: tuple[Chart, ...] = ()


def first_figures(comparisons: Sequence[tuple[str, Comparison]]) -> list[FirstFigure]:
    """What the first model and the last lack, side by side; none without comparisons."""
    if not comparisons:
        return []
    (name, comparison), (last, best) = comparisons[0], comparisons[-1]
    models = [(name, lacking(comparison, best))]
    if len(comparisons) > 1:
        models.append((last, lacking(best, best, models[0][1])))
    words = ("Before: ", "After: ") if len(models) > 1 else ("",)
    drawn = [
        (f"{word}{shortened(name, MAX_LABEL_CHARS)}", seen) for word, (name, seen) in zip(words, models, strict=True)
    ]
    first, pictures = models[0][1], cloth_pictures(drawn, comparison.clip_set.table)
    found: list[tuple[float, FirstFigure]] = []
    from_above = {"motion": first.cloth, "impacts": first.rails}
    least = {of: max(0.0, one.evidence) if one else 0.0 for of, one in from_above.items()}
    if pictures:
        found.append((max(least.values()), FirstFigure(pictures=tuple(pictures))))
    for of, needed in least.items():
        curve = max((one for one in first.curves if one.found.of == of), key=lambda one: one.evidence, default=None)
        if curve is not None and curve.evidence > needed:
            key = curve.found.key
            rows = [(name, one.found) for name, seen in drawn for one in seen.curves if one.found.key == key]
            found.append((curve.evidence, FirstFigure(charts=(lacking_curve_chart(rows),))))
    found.sort(key=lambda one: -one[0])
    return [figure for _, figure in found]
