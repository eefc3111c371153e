"""`python -m tests.figures.real_shot out/match`: README's picture of a real shot, from the report of a discovery.

It takes the held-out shot with the median miss in the model that was found. The base model is at the left, the model
that was found at the right; measured paths are grey, modelled ones coloured, both to scale. Short lines join measured
and modelled places of the same moment.
"""

from __future__ import annotations

import json
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.report.pictures.player import NO_BALL, UNITS_PER_M, UNITS_PER_S
from tests.figures.pages import ROOT

PICTURE = ROOT / "docs" / "pictures" / "real_shot.svg"
WIDTH_PX, GAP_PX, HEAD_PX, FOOT_PX, RAIL_M = 1000, 16, 24, 26, 0.06
JOINED_EVERY_S = 0.5  # moments at which measured and modelled places are joined
RESTS_M = 0.01  # a ball whose places range over less was not moved
STYLE = """
text{font:14px sans-serif;fill:#1f2933}.title{font-weight:bold}.rail{fill:#b9a084}.bed{fill:#eef3ee}
.seen{stroke:#59646e}.before{stroke:#d9480f}.after{stroke:#1c5fc4}
.seen,.before,.after{fill:none;stroke-linejoin:round}.seen{stroke-width:3.4;stroke-opacity:.55}
.before,.after{stroke-width:1.7}.join{stroke:#1f2933;stroke-width:1}.ball{stroke:#1f2933}
@media(prefers-color-scheme:dark){text{fill:#e6eaee}.rail{fill:#5a4a3a}.bed{fill:#1d2a24}.seen{stroke:#c3cad1}
.before{stroke:#ff922b}.after{stroke:#4dabf7}.join,.ball{stroke:#e6eaee}}
"""
Array = NDArray[np.float64]


@dataclass(frozen=True)
class RealShot:
    """One shot of a report's player."""

    table: tuple[float, float]  # [m]
    radius: float  # of a ball [m]
    name: str
    misses_mm: tuple[float, float]  # rms of its moving balls in the base model and in the model that was found
    held_out: int  # shots, of which it is the median
    balls: tuple[dict[str, Any], ...]


def real_shot(report: Path) -> RealShot:
    """The shot held out whose miss is the median one in the model that was found."""
    found = re.search(r'id="figures">(.*?)</script>', report.read_text(encoding="utf-8"), re.DOTALL)
    if found is None:
        raise ValueError(f"{report}: is no report with shots to play back")
    player = json.loads(found[1])["player"]
    held = sorted((s for s in player["shots"] if s["held"]), key=lambda shot: _millimetres(shot["misses"][-1]))
    shot = held[len(held) // 2]
    before, after = map(_millimetres, shot["misses"])
    return RealShot(
        tuple(player["table"]), player["radius"], shot["name"], (before, after), len(held), tuple(shot["balls"])
    )


def _millimetres(text: str) -> float:
    value, unit = text.split()
    return float(value) * {"mm": 1.0, "m": 1e3, "um": 1e-3}[unit]


def picture(shot: RealShot) -> str:
    """The SVG: the shot beside the base model and beside the model that was found."""
    length, width = shot.table
    half = (WIDTH_PX - GAP_PX) / 2
    scale = half / (length + 2 * RAIL_M)
    rail, high = scale * RAIL_M, scale * (width + 2 * RAIL_M)
    parts = []
    for k, (kind, title) in enumerate((("before", "Base model"), ("after", "Model that was found"))):
        left = k * (half + GAP_PX)

        def at(x: Array, y: Array, left: float = left) -> Array:
            return np.column_stack([left + rail + scale * (length / 2 + x), HEAD_PX + rail + scale * (width / 2 - y)])

        parts.append(f'<text x="{left:.0f}" y="16" class="title">{title}: rms miss {shot.misses_mm[k]:.0f} mm</text>')
        parts.append(f'<rect class="rail" x="{left:.1f}" y="{HEAD_PX}" width="{half:.1f}" height="{high:.1f}" rx="6"/>')
        parts.append(
            f'<rect class="bed" x="{left + rail:.1f}" y="{HEAD_PX + rail:.1f}" width="{scale * length:.1f}" '
            f'height="{scale * width:.1f}"/>'
        )
        parts += [_ball(ball, k, kind, at, scale * shot.radius) for ball in shot.balls]
    foot = HEAD_PX + high + 19
    legend = (("seen", "as filmed", 0), ("before", "base model", 125), ("after", "model that was found", 260))
    for kind, words, x in legend:
        parts.append(
            f'<path class="{kind}" d="M{x} {foot - 5:.0f}h28"/><text x="{x + 34}" y="{foot:.0f}">{words}</text>'
        )
    note = f"short lines: the same moment, every {JOINED_EVERY_S:g} s"
    parts.append(f'<text x="{WIDTH_PX}" y="{foot:.0f}" text-anchor="end">{note}</text>')
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH_PX} {HEAD_PX + high + FOOT_PX:.0f}">'
    return f"{head}<style>{STYLE}</style>{''.join(parts)}</svg>\n"


def _ball(ball: dict[str, Any], model: int, kind: str, at: Any, radius: float) -> str:
    """One ball's measured and modelled path in a panel, and where it began."""
    time = np.cumsum(ball["t"]) / UNITS_PER_S
    x, y = (np.cumsum(ball[axis]) / UNITS_PER_M for axis in "xy")
    colour, (u, v) = ball["colour"], at(x[:1], y[:1])[0]
    disc = f'<circle class="ball" cx="{u:.1f}" cy="{v:.1f}" r="{radius:.1f}" fill="{colour}"/>'
    if max(np.ptp(x), np.ptp(y)) < RESTS_M:
        return disc
    miss = np.array(ball["miss"][model], float)
    known = (miss != NO_BALL).all(axis=0)
    places = at(x, y), at(x[known] + miss[0, known] / UNITS_PER_M, y[known] + miss[1, known] / UNITS_PER_M)
    lines = [f'<path class="{c}" d="M{_points(p)}"/>' for c, p in zip(("seen", kind), places, strict=True)]
    joins = [
        "M{:.1f} {:.1f}L{:.1f} {:.1f}".format(*(np.interp(t, s, p[:, i]) for s, p in pairs for i in (0, 1)))
        for t in np.arange(JOINED_EVERY_S, time[-1], JOINED_EVERY_S)
        for pairs in [((time, places[0]), (time[known], places[1]))]
    ]
    return "".join([*lines, f'<path class="join" d="{"".join(joins)}"/>', disc])


def _points(pixels: Array) -> str:
    return "L".join(f"{u:.1f} {v:.1f}" for u, v in pixels)


if __name__ == "__main__":
    SHOT = real_shot(Path(sys.argv[1]) / "report.html")
    PICTURE.write_text(picture(SHOT), encoding="utf-8")
    print(f"{PICTURE.name}: shot {SHOT.name}, {SHOT.misses_mm} mm, the median of {SHOT.held_out} held out")
