"""A series of shots on paper and as a recording: what was learnt, how far the cue ball missed, shot by shot.

One HTML file with its pictures inside (robot/learning/pictures.py), for a browser without network or scripts; the main
picture alone as PNG; and one Rerun recording (models/recording/story.py). A block is what is played between two refits.
The floor is the launcher's own scatter, median distance of repeats of a stroke from their middle; where no stroke was
repeated, what the plans foresaw stands in its place, which holds the model's uncertainty too. Left out: the
discoveries' own reports, which lie beside each refit.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from html import escape
from pathlib import Path

from models.files import write_whole
from models.recording.story import SeriesRecording, Way, write_story
from models.recording.story import SeriesShot as Film
from models.shot import Array
from planner.scene import pocket_name
from robot.learning.history import History, PlayedShot, Refit
from robot.learning.pictures import Block, Draw, above, blocks, changes, constants, ends, misses, pot_count, pots
from sysid.report.drawing import png, svg
from sysid.report.html import CSS
from sysid.report.plots import number

NONE = "–"
OWN_CSS = ".lead{font-size:16px;max-width:920px;margin:6px 0}.lead:first-of-type{margin-top:12px}"
MISSES = (
    "How far from where the plan had told it the cue ball stopped; the axis is logarithmic. Filled: potted. Thick: "
    "median of all shots between two refits, all planned in the same model. Orange: the miss that those plans foresaw. "
    "Dashed: what repeats of the same stroke scatter by, which no model can beat. Dotted: refits, with the effects "
    "that they added (+) or dropped (−). A good series falls from refit to refit until it lies on the dashed line."
)
CONSTANTS = (
    "Constants in their own units over the refits, with bars of two standard deviations; hollow dots have none. Blue: "
    "the table's, orange: the launcher's. In a good series bars shrink and later values lie within earlier bars; a "
    "constant that jumps when an effect is added had stood in for it."
)
ABOVE = (
    "Rings: where the cue ball was told to stop, with the shot's number. Arrows: to where it stopped. Arrows that "
    "agree over a region mean a cause that is tied to the place; at the end they are short and point anywhere."
)
POTS = (
    "Left: chance of the pots as promised beside what was seen, of the shots whose end was seen. Right: distance of "
    "the cue ball from where it was wanted, which holds the miss and what the planner gave up for a safer pot."
)


def write_report(path: Path | str, story: History, title: str) -> None:
    """Write one HTML file, whole or not at all; BadInput where it cannot be written."""
    body = [f"<h1>{_text(title)}</h1>", *(f'<p class="lead">{_text(line)}</p>' for line in sentences(story))]
    pictures = (
        ("How far the cue ball missed", "misses", misses(story), MISSES),
        ("What was learnt", "constants", constants(story), CONSTANTS),
        ("From above, first and last", "above", above(story), ABOVE),
        ("Pots, and the place that was wanted", "pots", pots(story), POTS),
    )
    for head, name, picture, caption in pictures:
        body += [f"<h2>{head}</h2>", _figure(name, head, picture, caption)]
    body += ["<h2>Refits</h2>", _refits(story), "<h2>Shots</h2>", _shots(story)]
    top = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{_text(title)}</title>'
    page = f'<!DOCTYPE html>\n<html lang="en">\n<head>{top}\n<style>{CSS}{OWN_CSS}</style></head>\n<body>\n'
    write_whole(path, (page + "\n".join(body) + "\n</body>\n</html>\n").encode())


def write_picture(path: Path | str, story: History) -> None:
    """Write the main picture as PNG, whole or not at all; BadInput where it cannot be written."""
    write_whole(path, png(*misses(story), dpi=144))


def write_recording(path: Path | str, story: History, title: str = "A series of shots") -> None:
    """Write the whole series as one Rerun recording, whole or not at all; BadInput where it cannot be written."""
    write_story(path, recording_of(story), title=title)


def sentences(story: History) -> list[str]:
    """What a series came to, in plain words."""
    count = len(story.shots)
    if not count:
        return ["No shot was played yet.", *_ended(story)]
    out = [
        f"{_many(count, 'shot')} played, {_many(len(story.refits), 'refit')} of the table's model and the cueing map."
    ]
    shown = ends(story)
    misses_m = [story.median_miss(*block) for block in shown]
    said = f"In the first block ({_range(shown[0])}) the cue ball stopped {_mm(misses_m[0])} from where it was told to"
    if not math.isfinite(misses_m[0]):
        said = f"In the first block ({_range(shown[0])}) nobody saw the cue ball stop"
    if len(shown) == 1:
        out.append(f"{said} (median); there is no later block to compare with.")
    elif not all(map(math.isfinite, misses_m)):
        out.append(f"{said} (median), in the last ({_range(shown[1])}) {_mm(misses_m[1])}.")
    else:
        first, last = misses_m
        less = f"{first / last:.1f} times less" if first >= last else f"{last / first:.1f} times more"
        out.append(f"{said} (median), in the last ({_range(shown[1])}) {_mm(last)}: {less}.")
    return [*out, *_floor(story, shown[-1]), *_effects(story), *_pots(story, shown[-1]), *_ended(story)]


def _floor(story: History, block: Block) -> list[str]:
    """The last block's miss against what the launcher's scatter alone does."""
    miss = story.median_miss(*block)
    floor, what = story.floor(*block), f"measured by repeated strokes in {_range(block)}"
    if not math.isfinite(floor):
        floor, what = story.floor(1, len(story.shots)), "measured by repeated strokes in the whole series"
    own = f"The launcher's own scatter, {what}, is {_mm(floor)}"
    if not math.isfinite(floor):
        floor = story.median_spread(*block)
        own = f"No stroke was repeated; the plans of {_range(block)} foresaw a miss of {_mm(floor)}"
    if not math.isfinite(floor):
        return ["No stroke was repeated, and the plans tell no miss to expect."]
    ratio = f": the cue ball misses by {number(miss / floor)} times that." if math.isfinite(miss) and floor > 0 else "."
    return [own + ratio]


def _effects(story: History) -> list[str]:
    """Which effects were found when, and what remains."""
    if not story.refits:
        return ["Nothing was refitted yet."]
    found = []
    for change in changes(story):
        parts = [", ".join(change.added)] * bool(change.added)
        parts += [f"{', '.join(change.dropped)} dropped"] * bool(change.dropped)
        if parts:
            found.append(f"after {_many(change.shots, 'shot')} {', '.join(parts)}")
    said = f"Found: {'; '.join(found)}." if found else "No effect beyond the base was found."
    left = story.refits[-1].unexplained
    return [said, f"Left unexplained: {left}." if left else "Nothing is left unexplained by the last refit."]


def _pots(story: History, block: Block) -> list[str]:
    promised, potted, seen = pot_count(story, (1, len(story.shots)))
    if not seen:
        return ["Nobody saw how the shots ended."]
    said = f"Pots: {promised:.1f} promised and {potted} seen, of {_many(seen, 'shot')} whose end was seen"
    late = pot_count(story, block)
    more = f"; in {_range(block)}: {late[0]:.1f} promised and {late[1]} seen, of {late[2]}"
    return [f"{said}{more if len(ends(story)) > 1 else ''}."]


def _ended(story: History) -> list[str]:
    return [f"It ended: {story.ended}." if story.ended else "It has not ended."]


def _refits(story: History) -> str:
    if not story.refits:
        return '<p class="sub">There was none yet.</p>'
    heads = ("shots", "effects", "what remains", "rms", "rms, held out", "reduced χ²", "seconds")
    rows = [
        [str(r.shots), ", ".join(r.verdict) or "none", r.unexplained or NONE, _small(r.rms), _small(r.held_rms),
         _number(r.chi2), _number(r.seconds)]
        for r in story.refits
    ]  # fmt: skip
    return _table(heads, rows, {0, 3, 4, 5, 6})


def _shots(story: History) -> str:
    if not story.shots:
        return '<p class="sub">There was none yet.</p>'
    heads = ("shot", "pocket", "promised", "potted", "miss", "foreseen", "from the wanted place", "noted")
    rows = [
        [str(s.number), _pocket(s), _percent(s.pot_probability), _seen(s.potted), _mm(s.miss), _mm(s.spread),
         _mm(s.from_wanted), "; ".join(_noted(s)) or NONE]
        for s in story.shots
    ]  # fmt: skip
    return _table(heads, rows, {0, 2, 4, 5, 6})


def _noted(shot: PlayedShot) -> list[str]:
    """What was out of the ordinary in a shot."""
    out = ["in-off"] * bool(shot.played.get("cue_fell"))
    if shot.played.get("struck", "yes") != "yes":
        out.append("nobody knows whether it was struck")
    out += ["no film"] * (shot.clip is None)
    out += ["not seen where the cue ball ended"] * (shot.cue_end is None and not shot.played.get("cue_fell"))
    return out + [str(note) for note in shot.played.get("noted") or []]


def recording_of(story: History) -> SeriesRecording:
    """A series as the plain values that are drawn in Rerun."""
    median = {k: story.median_miss(*block) for block in blocks(story) for k in range(block[0], block[1] + 1)}
    films = tuple(_film(shot, median[shot.number]) for shot in story.shots)
    found = {change.shots: change for change in changes(story)}
    lessons = tuple((refit.shots, _plain(_lesson(refit, found[refit.shots].added))) for refit in story.refits)
    words = _plain("\n\n".join(sentences(story)))
    if not story.shots:
        return SeriesRecording(films, lessons, words)
    return SeriesRecording(films, lessons, words, story.shots[0].scene.table, story.shots[0].scene.ball)


def _film(shot: PlayedShot, median: float) -> Film:
    planned: dict[str, Way] = {}
    for track in shot.plan.get("tracks") or []:
        planned[track["ball"]] = (_array(track["t"]).reshape(-1), _array(track["xy"]).reshape(-1, 2))
    played: dict[str, Way] = {}
    if shot.clip is not None:
        played = {name: (seen.time, seen.xy) for name, seen in shot.clip.balls.items()}
    pot = {True: "potted", False: "not potted", None: "not seen"}[shot.potted]
    miss = f"missed by {_mm(shot.miss)}" if math.isfinite(shot.miss) else "the cue ball did not stop on the table"
    noted = _noted(shot)
    words = f"shot {shot.number}: {pot} ({_percent(shot.pot_probability)} promised), {miss}"
    words += f"; {'; '.join(noted)}" if noted else ""
    rows = [("pocket", _pocket(shot)), ("promised", _percent(shot.pot_probability)), ("potted", _seen(shot.potted)),
            ("miss", _mm(shot.miss)), ("foreseen", _mm(shot.spread)), ("launcher's own scatter", _mm(shot.floor)),
            ("from the wanted place", _mm(shot.from_wanted)), ("model learnt from", _many(shot.learnt, "shot")),
            ("noted", "; ".join(noted) or NONE)]  # fmt: skip
    page = "\n".join(
        [f"# Shot {shot.number}", str(shot.plan.get("kind") or ""), "", "| | |", "|---|---|"]
        + [f"| {a} | {' '.join(b.replace('|', '/').split())} |" for a, b in rows]
    )
    curves = {"miss": shot.miss, "median": median, "spread": shot.spread, "floor": shot.floor}
    start = dict(zip(shot.scene.names, shot.scene.position, strict=True))
    return Film(
        shot.number,
        start,
        planned,
        played,
        shot.planned_end,
        shot.cue_end,
        shot.scene.goal.rest,
        curves,
        _plain(words),
        _plain(page),
    )


def _lesson(refit: Refit, added: Sequence[str]) -> str:
    """What a refit found, in a line."""
    new = f"new: {', '.join(added)}" if added else "nothing new"
    left = f"; left: {refit.unexplained}" if refit.unexplained else ""
    return f"refit after {_many(refit.shots, 'shot')}: {new}; rms {_small(refit.rms)}, chi2 {_number(refit.chi2)}{left}"


def _array(values: object) -> Array:
    import numpy as np

    return np.array(values, float)


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]], right: set[int]) -> str:
    kind = ['class="n"' if k in right else "" for k in range(len(heads))]
    top = "".join(f"<th {c}>{_text(h)}</th>" for c, h in zip(kind, heads, strict=True))
    body = "".join(
        "<tr>" + "".join(f"<td {c}>{_text(v)}</td>" for c, v in zip(kind, row, strict=True)) + "</tr>" for row in rows
    )
    return f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"


def _figure(name: str, what: str, picture: tuple[float, Draw] | None, caption: str) -> str:
    if picture is None:
        return '<p class="sub">Nothing to show yet.</p>'
    data = base64.b64encode(svg(f"story {name}", *picture).encode()).decode()
    image = f'<img alt="{escape(what)}" src="data:image/svg+xml;base64,{data}">'
    return f"<figure>{image}<figcaption>{caption}</figcaption></figure>"


def _pocket(shot: PlayedShot) -> str:
    """The pocket that was played for."""
    pocket = shot.plan.get("pocket") or shot.scene.goal.pocket
    return pocket_name((int(pocket[0]), int(pocket[1]))) if pocket else NONE


def _seen(potted: bool | None) -> str:
    return NONE if potted is None else "yes" if potted else "no"


def _number(value: float | None) -> str:
    return NONE if value is None else number(float(value))


def _mm(metres: float | None) -> str:
    return NONE if metres is None or not math.isfinite(metres) else f"{number(1e3 * metres)} mm"


def _small(metres: float | None) -> str:
    return NONE if metres is None or not math.isfinite(metres) else f"{1e3 * metres:.2f} mm"


def _percent(chance: float | None) -> str:
    return NONE if chance is None or not math.isfinite(chance) else f"{100 * chance:.0f} %"


def _many(count: int, what: str) -> str:
    return f"{count} {what}{'s' * (count != 1)}"


def _range(block: Block) -> str:
    return f"shots {block[0]} to {block[1]}" if block[1] > block[0] else f"shot {block[0]}"


def _plain(text: object) -> str:
    """Any text; characters that cannot be shown are spelt out."""
    return "".join(c if c.isprintable() or c == "\n" else " " if c.isspace() else ascii(c)[1:-1] for c in str(text))


def _text(text: object) -> str:
    """Any text, safe in HTML."""
    return escape(_plain(text))
