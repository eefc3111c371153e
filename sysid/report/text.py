"""A comparison in plain words, for the terminal and the report.

In: a `Comparison`. Out: lines of text, which nothing is read back from.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from models.commands.console import table
from models.messages import counted
from sysid.residuals.compare import coverage
from sysid.residuals.comparison import Comparison
from sysid.residuals.significance import Dependence

RESIDUAL_KINDS = {"motion": "Between impacts", "turning": "Of the balls' rotation", "impacts": "At impacts"}
MAX_WORST_CLIPS = 5  # listed
NEARLY_AS_MUCH = 0.9  # of the largest share of chi-square: then the simpler variable is named
MAX_NOISE_RATIO = 1.1  # rms over noise above which whole shots are not followed to the noise


def in_words(comparison: Comparison) -> list[str]:
    """Departures, the most significant first; what the error depends on; whether the residuals are white."""
    found, white = comparison.local, comparison.white
    lines = [d.where[0].upper() + d.where[1:] + "." for d in found.named]
    for of, words in RESIDUAL_KINDS.items():
        named = [d for d in found.named if d.of == of]
        rows = [d for d in found.dependence if d.of == of and math.isfinite(d.share)]
        if named and rows:
            best = simplest(rows)
            lines.append(
                f"{words} the error depends most on {best.variable}, which explains {100 * best.share:.0f} % of it."
            )
    if not found.named:
        lines = [
            f"Nothing stands out: none of {found.tests} groups departs by more than chance explains among so many, "
            f"with noise of {comparison.noise_m * 1e3:.2f} mm."
        ]
        if white.samples and white.ratio > MAX_NOISE_RATIO:
            lines.append(
                f"Yet whole shots miss by {white.ratio:.1f} times the noise; these clips cannot locate the cause."
            )
    return [*lines, white.in_words()]


def simplest(rows: Sequence[Dependence]) -> Dependence:
    """Of the variables that explain nearly as much as any, the one with the fewest groups."""
    most = max(d.share for d in rows)
    return min((d for d in rows if d.share >= NEARLY_AS_MUCH * most), key=lambda d: (d.groups, -d.share))


def engines_line(comparison: Comparison) -> str:
    """The error of the engine that the model was fitted in, and that of MuJoCo with the same constants."""
    s = comparison.summary()
    here, there = (f"{1e3 * s[k]:.3f} mm" for k in ("rms_median_m", "mujoco_rms_median_m"))
    if not comparison.mujoco:
        return f"rms miss of all balls over a clip, played in MuJoCo, median: {there}"
    both = f"{here} in the event engine, {there} with the same constants in MuJoCo"
    return f"rms miss of all balls over a clip, median: {both}"


def held_out_line(comparison: Comparison, rate: float) -> str:
    """How whole held-out shots are followed, and how many residuals the band of a discrepancy rate holds."""
    rms, share = comparison.summary()["struck_rms_median_held_out_m"], coverage(comparison, rate)
    return (
        f"whole shots held out, only their initial states fitted: struck ball's rms miss, median {rms * 1e3:.1f} mm; "
        f"{100 * share:.0f} % of residuals inside the predicted 95 % band"
    )


def summary_lines(comparison: Comparison) -> list[str]:
    """Medians of the main figures, in words."""
    s, mm = comparison.summary(), 1e3
    names = ", ".join(e.name() for e in comparison.model.stack()[1:]) or "native MuJoCo contact"
    lines = [
        f"{counted(len(comparison.clips), 'clip')}, noise {comparison.noise_m * mm:.2f} mm an axis, model: {names}"
    ]
    if comparison.slow_noise.sd:
        lines.append(f"in it, {comparison.slow_noise.in_words()}")
    count = len(comparison.segments)
    lines.append(
        f"{counted(count, 'segment')} between impacts: median rms {s['segment_ratio_median']:.2f} times the noise"
    )
    lines.append(f"rms miss of the struck ball over a clip, median: {s['struck_rms_median_m'] * mm:.1f} mm")
    held = sum(c.held_out for c in comparison.clips)
    if held:
        lines.append(f"the same on {counted(held, 'clip')} held out: {s['struck_rms_median_held_out_m'] * mm:.1f} mm")
    return [*lines, engines_line(comparison)]


def worst_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """The clips with the largest miss as a table, heads first."""
    rows: list[tuple[str, ...]] = [("Worst clips", "miss of the struck ball, mm", "of all balls, mm", "chi2")]
    for c in sorted(comparison.clips, key=lambda c: -c.rms_m)[:MAX_WORST_CLIPS]:
        where = f"  {c.file}" + (" (held out)" if c.held_out else "")
        rows.append((where, f"{c.struck_rms_m * 1e3:.2f}", f"{c.rms_m * 1e3:.2f}", f"{c.chi2_reduced:.2f}"))
    return rows


def beside_rows(compared: Sequence[tuple[str, Comparison]]) -> list[tuple[str, ...]]:
    """Several models of the same clips as a table of medians, heads first."""
    rows: list[tuple[str, ...]] = [
        ("model", "miss of the struck ball, mm", "held out, mm", "of all balls, mm", "segments, over noise")
    ]
    for label, one in compared:
        medians = one.summary()
        names = ("struck_rms_median_m", "struck_rms_median_held_out_m", "rms_median_m")
        cells = [f"{1e3 * medians[name]:.2f}" if math.isfinite(medians[name]) else "-" for name in names]
        rows.append((label, *cells, f"{medians['segment_ratio_median']:.2f}"))
    return rows


def print_comparison(comparison: Comparison) -> None:
    """What `compare` prints."""
    print("\n".join(summary_lines(comparison)))
    print("\n" + table(worst_rows(comparison)))
    print("\nWhere the model misses")
    print("\n".join(f"  {line}" for line in in_words(comparison)))
