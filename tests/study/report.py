"""The report of the study, Markdown: the same results give the same text."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from models.files import write_whole
from tests.study.judge import EFFECT_TRUTH, RIGHT, WITHIN, Row
from tests.study.plan import CLIPS, GROUPS, LONG_CLIPS, MIXES, VARIATIONS, mix_of
from tests.study.run import LIMIT
from tests.truth.effects import EFFECTS, STRUCTURES

REPORT: Final = Path(__file__).with_name("REPORT.md")
SINGLE: Final = ("natural", "quarter", "sixteenth")
LEAST_CHI2: Final = {"natural": -math.inf, "quarter": 1.05, "sixteenth": 1.03}
BOUND: Final = 1.05  # of the held-out error over noise
NONE, FAILED, TOLD = "nothing", "failed", "unexplained"


def rate(right: int, of: int) -> str:
    """A share with its 95 % interval (Wilson 1927)."""
    if of == 0:
        return "-"
    p, z = right / of, WITHIN
    middle, half = p + z * z / (2 * of), z * math.sqrt(p * (1 - p) / of + z * z / (4 * of * of))
    low, high = ((middle + s * half) / (1 + z * z / of) for s in (-1, 1))
    return f"{right}/{of} = {100 * p:.0f} % ({100 * max(low, 0):.0f} to {100 * min(high, 1):.0f})"


def share(rows: Sequence[Row], right: Callable[[Row], bool]) -> str:
    """The rate of rows that are right."""
    return rate(sum(map(right, rows)), len(rows))


def grid(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(r) + " |" for r in (head, ["---"] * len(head), *rows)]
    return "\n".join(lines)


def strong(rows: Sequence[Row], group: str) -> list[Row]:
    """Sets of a group whose base leaves enough to be seen; a failed one always counts."""
    of = [r for r in rows if r.group == group]
    return [r for r in of if r.error or group == "natural" or r.base_chi2 > LEAST_CHI2[group]]


def _spread(values: Sequence[float]) -> str:
    """Median and 90 % of errors of size."""
    if not values:
        return "-"
    return f"{100 * np.median(values):.1f} %, 90 % below {100 * np.quantile(values, 0.9):.1f} %"


def _seconds(values: Sequence[float]) -> str:
    return f"median {np.median(values):.0f} s, longest {max(values):.0f} s" if values else "-"


def figures(rows: Sequence[Row]) -> str:
    """The table that a user will judge the program by."""
    by = {g: [r for r in rows if r.group == g] for g in GROUPS}
    single = [r for g in SINGLE for r in by[g]]
    strongs = [r for g in SINGLE for r in strong(rows, g)]
    sure = [r for r in rows if r.sure]
    named = [r for r in sure if r.hidden]
    sizes = [e for r in named for e in r.size_errors().values()]
    constants, effects = [z for r in sure for z in r.constants_off()], [z for r in named for z in r.effects_off()]
    held = [h for h in (r.held_out() for r in sure) if math.isfinite(h)]
    outside, two, none = by["outside"], by["two"], by["none"]
    soiled = [[r for r in by["soiled"] if len(r.hidden) == count] for count in range(3)]

    def covered(values: Sequence[float]) -> str:
        return rate(sum(abs(z) <= WITHIN for z in values), len(values))

    table: list[tuple[str, str, str, int]] = [
        ("the hidden effect is the verdict, natural size", "95 %", share(by["natural"], lambda r: r.exact),
         len(by["natural"])),
        *(
            (f"the same at a {g} of the size, base chi-square above {LEAST_CHI2[g]:g}", reach,
             share(strong(rows, g), lambda r: r.exact), len(strong(rows, g)))
            for g, reach in (("quarter", "85 %"), ("sixteenth", "75 %"))
        ),
        ("an effect named that is not hidden, in sets with one effect of any size", "",
         share(single, lambda r: bool(r.wrong)), len(single)),
        ("structure told beside the right verdict, where there is none", "",
         share([r for r in strongs if r.exact], lambda r: bool(r.unexplained)), sum(r.exact for r in strongs)),
        ("false alarms on sets without a hidden effect", "at most 2 %", share(none, lambda r: r.alarm), len(none)),
        ("two hidden effects, both named", "90 %", share(two, lambda r: r.all_named), len(two)),
        ("two hidden effects, both named and nothing else", "", share(two, lambda r: r.exact), len(two)),
        ("outside the catalogue: reported as unexplained, with the right place", "90 %",
         share(outside, lambda r: r.right_place), len(outside)),
        ("outside the catalogue: reported as unexplained at all", "",
         share(outside, lambda r: bool(r.unexplained)), len(outside)),
        ("outside the catalogue: a wrong effect named, alone or besides", "",
         share(outside, lambda r: bool(r.wrong)), len(outside)),
        ("soiled clips, one effect hidden: the verdict", "90 %",
         share(soiled[1], lambda r: r.exact), len(soiled[1])),
        ("soiled clips, two hidden: the verdict", "80 %",
         share(soiled[2], lambda r: r.exact), len(soiled[2])),
        ("soiled clips, nothing hidden: an effect named", "1 of 12",
         share(soiled[0], lambda r: bool(r.error or r.wrong)), len(soiled[0])),
        ("shots of 6 to 14 impacts: the verdict", "90 %",
         share(by["long"], lambda r: r.exact), len(by["long"])),
        ("soiled clips: structure told where there is none", "",
         share(by["soiled"], lambda r: bool(r.unexplained)), len(by["soiled"])),
        ("size of the effect, error of its main parameter", "within 10 %", _spread(sizes), len(named)),
        ("coverage of the 95 % interval, effects' parameters", "90 to 98 %", covered(effects), len(named)),
        ("coverage of the 95 % interval, constants", "90 to 98 %", covered(constants), len(sure)),
        ("error on held-out clips over noise", f"at most {BOUND:g}",
         f"median {np.median(held):.3f}; {rate(sum(h <= BOUND for h in held), len(held))} are" if held else "-",
         len(held)),
    ]  # fmt: skip
    clips = sorted({CLIPS, *(int(r.data["clips"]) for r in rows)})
    for n in clips:
        took = [float(r.data["elapsed_s"]) for r in rows if int(r.data["clips"]) == n]
        table.append((f"time for {n} clips, one thread", "", _seconds(took), len(took)))
    if 30 not in clips:
        table.append(("time for 30 clips on two cores", "under 2 minutes", "not in this plan", 0))
    return grid(("figure", "reach", "measured", "sets"), [(a, b, c, str(n)) for a, b, c, n in table])


def _told(name: str) -> str:
    """What is hidden, and by which shots."""
    mix = mix_of((name,))
    return f"{name} ({mix.name})" if mix else name


def by_effect(rows: Sequence[Row]) -> str:
    """One line for each effect."""

    def line(effect: str) -> tuple[str, ...]:
        mine = [r for r in rows if r.hidden == (effect,)]
        cells = []
        for group in SINGLE:
            of = strong(mine, group)
            weak = sum(r.group == group for r in mine) - len(of)
            cells.append(f"{sum(r.exact for r in of)}/{len(of)}" + (f" ({weak} too weak)" if weak else ""))
        sizes = [v for r in mine if r.sure for v in r.size_errors().values()]
        off = [z for r in mine if r.sure for z in r.effects_off()]
        covered = f"{sum(abs(z) <= WITHIN for z in off)}/{len(off)}"
        name = _told(effect)
        return (name, *cells, f"{effect}.{EFFECT_TRUTH[effect][0].key}", _spread(sizes), covered)

    head = ("effect", *SINGLE, "main parameter", "its error, all sizes", "in the 95 % interval")
    return grid(head, [line(e) for e in EFFECTS])


def confusion(rows: Sequence[Row], truths: Sequence[str]) -> str:
    """What is hidden against what was named; a verdict of several counts for each of them."""
    numbers = {e: k for k, e in enumerate(EFFECTS, 1)}
    counts: dict[str, Counter[str]] = {t: Counter() for t in truths}
    for row in rows:
        key = row.hidden[0] if row.hidden else NONE
        if key not in counts:
            continue
        said = [FAILED] if row.error else [*row.verdict, *([TOLD] if row.unexplained else [])] or [NONE]
        counts[key].update(said)
    seen = {v for c in counts.values() for v in c}
    columns = [*(e for e in EFFECTS if e in seen), *sorted(seen - set(EFFECTS) - {NONE, FAILED, TOLD})]
    columns += [c for c in (TOLD, NONE, FAILED) if c in seen]
    head = ["hidden", *(str(numbers.get(c, c)) for c in columns)]
    lines = []
    for t in truths:
        if counts[t]:
            cells = [str(counts[t][c] or "·") for c in columns]
            lines.append([f"{numbers[t]} {t}" if t in numbers else t, *cells])
    legend = ", ".join(f"{numbers[c]} {c}" for c in columns if c in numbers)
    return grid(head, lines) + (f"\n\nColumns: {legend}." if legend else "")


def structures(rows: Sequence[Row]) -> str:
    """One line for each structure outside the catalogue."""
    lines = []
    for name in STRUCTURES:
        mine = [r for r in rows if r.hidden == (name,)]
        wrong = Counter(v for r in mine for v in r.wrong)
        told = ", ".join(f"{v} {n}x" if n > 1 else v for v, n in sorted(wrong.items())) or "none"
        shots = _told(name)
        seen, right = sum(bool(r.unexplained) for r in mine), sum(r.right_place for r in mine)
        lines.append((shots, RIGHT[name].says, f"{seen}/{len(mine)}", f"{right}/{len(mine)}", told))
    return grid(("structure", "what counts as right", "told", "rightly", "effects named"), lines)


def missed(row: Row) -> bool:
    """Whether a set counts as a miss in the report's list."""
    if row.group == "none":
        return row.alarm
    if row.group == "outside":
        return not row.right_place
    weak = row.group in SINGLE and not strong([row], row.group) and not row.wrong
    return not weak and (not row.exact or bool(row.unexplained))


def variations(rows: Sequence[Row]) -> str:
    """Sets without an effect, by what else is different."""
    lines = []
    for name in ("", *VARIATIONS):
        mine = [r for r in rows if r.group == "none" and r.variation == name]
        held = [h for h in (r.held_out() for r in mine if not r.error) if math.isfinite(h)]
        noise = [r.data["noise_floor_m"] * 1e3 for r in mine if r.data.get("noise_floor_m")]
        lines.append((
            name or "as all other sets", str(len(mine)), share(mine, lambda r: r.alarm),
            f"{np.median(noise):.3f}" if noise else "-", f"{np.median(held):.3f}" if held else "-",
            _seconds([float(r.data["elapsed_s"]) for r in mine]),
        ))  # fmt: skip
    head = ("without an effect", "sets", "false alarms", "noise taken, mm", "held-out error over 0.5 mm", "time")
    return grid(head, lines)


def _seeds(rows: Sequence[Row]) -> str:
    lines = []
    for group in GROUPS:
        seeds = sorted(int(r.data["seed"]) for r in rows if r.group == group)
        if seeds:
            lines.append(f"* {group}: {', '.join(map(str, seeds))}")
    return "\n".join(lines)


def _versions(rows: Sequence[Row]) -> str:
    marks = Counter(str(r.data["fingerprint"]) for r in rows)
    programs = sorted({", ".join(f"{k} {v}" for k, v in r.data["versions"].items()) for r in rows})
    said = "; ".join(f"{mark} ({n} sets)" for mark, n in sorted(marks.items()))
    mixed = " **Results of several versions of the sources are mixed here.**" if len(marks) > 1 else ""
    return f"Sources (models, sysid, tests/truth): {said}.{mixed} Run with {' and '.join(programs)}."


def text(results: Sequence[Mapping[str, Any]], planned: int) -> str:
    """The whole report."""
    rows = [Row(r) for r in sorted(results, key=lambda r: str(r["name"]))]
    misses = [r for r in rows if missed(r)]
    mixes = "; ".join(f"{m.name} for {', '.join(m.effects)} ({', '.join(m.kinds)})" for m in MIXES)
    parts = [
        "# How reliably hidden effects are found",
        "Written by `make study` (`python -m tests.study`); change nothing by hand.",
        f"{len(rows)} of {planned} planned sets. " + _versions(rows),
        f"Every set: {CLIPS} clips of at most 4 s made by the independent generator (`tests/truth`), 0.5 mm noise, 1 %"
        f" of the frames missing, constants moved by the seed; sets of long shots have {LONG_CLIPS}, of carom from the"
        " stroke to rest. Every fifth clip is held out. Other shots are of all kinds in"
        f" turn, but for effects that those hardly show: {mixes}. A set that failed or took over {LIMIT / 60:g}"
        " minutes is a miss. Intervals behind rates are Wilson's, 95 %.",
        "## Figures",
        figures(rows),
        "Sizes, intervals and held-out errors are of sets whose verdict is exactly right, with nothing unexplained and"
        " a converged fit, without variations.",
        "## By effect",
        "Verdicts that are exactly right, of sets whose base chi-square is above that of the table.",
        by_effect(rows),
        "## Verdict against truth",
        "A verdict of several effects counts in each of their columns.",
    ]
    for group in SINGLE:
        mine = [r for r in rows if r.group == group]
        if mine:
            parts += [f"### {group.capitalize()} size", confusion(mine, tuple(EFFECTS))]
    rest = [r for r in rows if r.group in ("none", "outside")]
    if rest:
        parts += ["### Nothing hidden, and outside the catalogue", confusion(rest, (NONE, *STRUCTURES))]
    parts += ["## Outside the catalogue", structures(rows)]
    two = [
        (" + ".join(r.hidden), ", ".join(r.verdict) or NONE, "yes" if r.all_named else "no")
        for r in rows
        if r.group == "two"
    ]
    parts += ["## Two effects", grid(("hidden", "verdict", "both named"), two) if two else "No set yet."]
    parts += ["## Variations", variations(rows)]
    listed = "\n".join(f"* {r.name}{f' ({r.variation})' if r.variation else ''}: {r.said()}" for r in misses)
    parts += [
        f"## Misses ({len(misses)})",
        "Verdicts that are not exactly what is hidden, structure told where there is none or at the wrong place; of"
        " sets whose base chi-square is too low, only those that named a wrong effect.",
        listed or "None.",
    ]
    failures = [r for r in rows if r.error]
    parts += [f"{len(failures)} sets failed.", "## Seeds", _seeds(rows)]
    return "\n\n".join(parts) + "\n"


def write_report(path: Path, results: Sequence[Mapping[str, Any]], planned: int) -> None:
    """Write the report, whole or not at all."""
    write_whole(path, text(results, planned).encode())
