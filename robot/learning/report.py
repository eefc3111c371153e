"""The report of a series of shots: findings, and the misses of the cue ball, shot by shot.

One HTML file with embedded figures (robot/learning/pictures.py), for a browser without network or scripts; the main
figure alone as PNG; and one Rerun recording (models/recording/story.py). A block is the shots between two refits. The
floor is the launcher's repeatability, the median distance of repeats of a stroke from their middle; if no stroke was
repeated, it is the miss predicted by the plans, including the model's uncertainty. Values and sentences are made here,
templates/series.html.j2 holds headings and captions. Left out: the discoveries' own reports.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from models.files import write_whole
from models.messages import counted
from models.recording.film import Film
from models.recording.series import SeriesRecording, SeriesShot, Way
from models.recording.story import write_story
from models.report.figure import Draw, png, svg
from models.report.numbers import NO_VALUE, millimetres, number
from models.report.page import printable, write_page
from models.shot import Array
from planner.planning import read_plan
from planner.scene import pocket_name, scene_from
from robot.learning.blocks import Block, blocks, changes, ends, pot_count
from robot.learning.history import History, PlayedShot, Refit, plan_file, predicted_stop
from robot.learning.misses import misses
from robot.learning.pictures import above, constants, pots
from sysid.estimation.fitted import MISS_OVER_AXIS

REPORT_TEMPLATE = Path(__file__).with_name("templates") / "series.html.j2"


def write_report(path: Path | str, story: History, title: str) -> None:
    """Write one HTML file, completely or not at all; BadInput if it cannot be written."""
    figures = {"constants": constants(story), "above": above(story), "pots": pots(story)}
    figures |= {"misses": misses(story), "misses_narrow": misses(story, narrow=True)}
    write_page(
        path,
        REPORT_TEMPLATE,
        title=title,
        sentences=sentences(story),
        refits=_refit_rows(story),
        shots=_shot_rows(story),
        **{name: _drawn(name, figure) for name, figure in figures.items()},
    )


def write_picture(path: Path | str, story: History) -> None:
    """Write the main figure as PNG, completely or not at all; BadInput if it cannot be written."""
    write_whole(path, png(*misses(story), dpi=144))


def write_recording(
    path: Path | str, story: History, title: str = "A series of shots", films: Sequence[Film] = ()
) -> str:  # fmt: skip
    """Write the series as one Rerun recording, completely or not at all; returns a line on the films included.

    Raises BadInput if it cannot be written.
    """
    return write_story(path, recording_of(story), title=title, films=films)


def sentences(story: History) -> list[str]:
    """The outcome of a series in sentences."""
    count = len(story.shots)
    if not count:
        return ["No shot was played yet.", *_ended(story)]
    refits = counted(len(story.refits), "refit")
    out = [f"{counted(count, 'shot')} played, {refits} of the table's model and the cueing map."]
    shown = ends(story)
    misses_m = [story.median_miss(*block) for block in shown]
    first = f"In the first block ({_range(shown[0])}) the cue ball missed by {millimetres(misses_m[0])}"
    if not math.isfinite(misses_m[0]):
        first = f"In the first block ({_range(shown[0])}) the cue ball was not seen to stop"
    if len(shown) == 1:
        out.append(f"{first} (median); there is no later block to compare with.")
    else:
        change = ""
        if all(miss > 0 for miss in misses_m):
            ratio = misses_m[0] / misses_m[1]
            change = f": {ratio:.1f} times less" if ratio >= 1 else f": {1 / ratio:.1f} times more"
        out.append(f"{first} (median), in the last ({_range(shown[1])}) by {millimetres(misses_m[1])}{change}.")
    return [*out, *_floor(story, shown[-1]), *_effects(story), *_pots(story, shown[-1]), *_ended(story)]


def _floor(story: History, block: Block) -> list[str]:
    """Sentences on the last block's miss relative to the launcher's repeatability."""
    miss = story.median_miss(*block)
    floor, what = story.floor(*block), f"measured by repeated strokes in {_range(block)}"
    if not math.isfinite(floor):
        floor, what = story.floor(1, len(story.shots)), "measured by repeated strokes in the whole series"
    repeatability = f"The launcher's repeatability, {what}, is {millimetres(floor)}"
    if not math.isfinite(floor):
        floor = story.median_spread(*block)
        repeatability = f"No stroke was repeated; the plans of {_range(block)} predicted a miss of {millimetres(floor)}"
    if not math.isfinite(floor):
        return ["No stroke was repeated, and the plans predict no miss."]
    ratio = f": the cue ball misses by {number(miss / floor)} times that." if math.isfinite(miss) and floor > 0 else "."
    return [repeatability + ratio]


def _effects(story: History) -> list[str]:
    """Sentences on effects found and dropped, and on unexplained structure."""
    if not story.refits:
        return ["Nothing was refitted yet."]
    found = []
    for change in changes(story):
        parts = [", ".join(change.added)] * bool(change.added)
        parts += [f"{', '.join(change.dropped)} dropped"] * bool(change.dropped)
        if parts:
            found.append(f"after {counted(change.shots, 'shot')} {', '.join(parts)}")
    rest = story.refits[-1].unexplained
    return [
        f"Found: {'; '.join(found)}." if found else "No effect beyond the base was found.",
        f"Unexplained: {rest}." if rest else "The last refit leaves nothing unexplained.",
    ]


def _pots(story: History, block: Block) -> list[str]:
    predicted, potted, seen = pot_count(story, (1, len(story.shots)))
    if not seen:
        return ["No shot was seen to its end."]
    pots = f"Pots: {predicted:.1f} predicted and {potted} seen, of {counted(seen, 'shot')} whose end was seen"
    late = pot_count(story, block)
    more = f"; in {_range(block)}: {late[0]:.1f} predicted and {late[1]} seen, of {late[2]}"
    return [f"{pots}{more if len(ends(story)) > 1 else ''}."]


def _ended(story: History) -> list[str]:
    return [f"The series ended: {story.ended}." if story.ended else "The series has not ended."]


def _refit_rows(story: History) -> list[list[str]]:
    """Rows of the refits: shots, effects, unexplained structure, rms, held-out rms, chi-square and duration."""
    return [
        [str(r.shots), ", ".join(r.verdict) or "none", r.unexplained or NO_VALUE, _rms(r.rms), _rms(r.held_rms),
         number(r.chi2), number(r.seconds)]
        for r in story.refits
    ]  # fmt: skip


def _shot_rows(story: History) -> list[list[str]]:
    """Rows of the shots: number, pocket, predicted pot, pot, miss, predicted miss, distance from wanted, remarks."""
    return [
        [str(s.number), _pocket(s), _percent(s.pot_probability), _yes_no(s.potted), millimetres(s.miss),
         millimetres(s.spread), millimetres(s.from_wanted), "; ".join(_remarks(s)) or NO_VALUE]
        for s in story.shots
    ]  # fmt: skip


def _remarks(shot: PlayedShot) -> list[str]:
    """Remarks on anything unusual in a shot."""
    out = ["in-off"] * bool(shot.played.get("cue_fell"))
    if shot.played.get("struck", "yes") != "yes":
        out.append("unknown whether it was struck")
    out += ["no film"] * (shot.clip is None)
    out += ["resting place of the cue ball not seen"] * (shot.cue_end is None and not shot.played.get("cue_fell"))
    return out + [str(note) for note in shot.played.get("noted") or []]


def recording_of(story: History) -> SeriesRecording:
    """A series as plain values for drawing in Rerun."""
    median = {k: story.median_miss(*block) for block in blocks(story) for k in range(block[0], block[1] + 1)}
    shots = tuple(_shot(shot, median[shot.number]) for shot in story.shots)
    found = {change.shots: change for change in changes(story)}
    lessons = tuple((refit.shots, _lines(_lesson(refit, found[refit.shots].added))) for refit in story.refits)
    words = _lines("\n\n".join(sentences(story)))
    if not story.shots:
        return SeriesRecording(shots, lessons, words)
    return SeriesRecording(shots, lessons, words, story.shots[0].scene.table, story.shots[0].scene.ball)


def planned_recording(folder: Path, number: int) -> SeriesRecording:
    """A planned shot of a series as plain values for drawing in Rerun."""
    plan = read_plan(plan_file(folder, number))
    scene = scene_from(plan["scene"], str(plan_file(folder, number)))
    chance = _percent(float(plan["pot_probability"]["value"]))
    words = _lines(f"shot {number}: planned, {chance} pots predicted")
    start = dict(zip(scene.names, scene.position, strict=True))
    target, wanted = predicted_stop(plan)[0], scene.goal.rest
    shot = SeriesShot(number, start, _ways(plan), target=target, wanted=wanted, words=words)
    return SeriesRecording((shot,), (), f"Shot {number} is being played.", scene.table, scene.ball)


def _ways(plan: dict[str, Any]) -> dict[str, Way]:
    """The planned paths of the moving balls."""
    tracks = plan.get("tracks") or []
    return {one["ball"]: (_array(one["t"]).reshape(-1), _array(one["xy"]).reshape(-1, 2)) for one in tracks}


def _shot(shot: PlayedShot, median: float) -> SeriesShot:
    planned = _ways(shot.plan)
    played: dict[str, Way] = {}
    if shot.clip is not None:
        played = {name: (seen.time, seen.xy) for name, seen in shot.clip.balls.items()}
    pot = {True: "potted", False: "not potted", None: "not seen"}[shot.potted]
    miss = (
        f"missed by {millimetres(shot.miss)}" if math.isfinite(shot.miss) else "the cue ball did not stop on the table"
    )
    remarks = _remarks(shot)
    words = f"shot {shot.number}: {pot} ({_percent(shot.pot_probability)} predicted), {miss}"
    words += f"; {'; '.join(remarks)}" if remarks else ""
    rows = [("pocket", _pocket(shot)), ("pot predicted", _percent(shot.pot_probability)),
            ("potted", _yes_no(shot.potted)), ("miss", millimetres(shot.miss)),
            ("miss predicted", millimetres(shot.spread)),
            ("launcher's repeatability", millimetres(shot.floor)),
            ("from the wanted position", millimetres(shot.from_wanted)),
            ("model fitted to", counted(shot.learnt, "shot")), ("remarks", "; ".join(remarks) or NO_VALUE)]  # fmt: skip
    page = "\n".join(
        [f"# Shot {shot.number}", str(shot.plan.get("kind") or ""), "", "| | |", "|---|---|"]
        + [f"| {a} | {' '.join(b.replace('|', '/').split())} |" for a, b in rows]
    )
    curves = {"miss": shot.miss, "median": median, "spread": shot.spread, "floor": shot.floor}
    start = dict(zip(shot.scene.names, shot.scene.position, strict=True))
    return SeriesShot(
        shot.number, start, planned, played, shot.planned_end, shot.cue_end, shot.scene.goal.rest, curves,
        _lines(words), _lines(page), shot.clip.file if shot.clip is not None else "",
    )  # fmt: skip


def _lesson(refit: Refit, added: Sequence[str]) -> str:
    """The findings of a refit, in a line."""
    new = f"new: {', '.join(added)}" if added else "nothing new"
    left = f"; left: {refit.unexplained}" if refit.unexplained else ""
    after = counted(refit.shots, "shot")
    return f"refit after {after}: {new}; distance {_rms(refit.rms)}, chi2 {number(refit.chi2)}{left}"


def _array(values: object) -> Array:
    import numpy as np

    return np.array(values, float)


def _drawn(name: str, figure: tuple[float, Draw] | None) -> str | None:
    """A figure (height [inch], drawing function) as SVG."""
    return None if figure is None else svg(f"story {name}", *figure)


def _pocket(shot: PlayedShot) -> str:
    """The intended pocket."""
    pocket = shot.plan.get("pocket") or shot.scene.goal.pocket
    return pocket_name((int(pocket[0]), int(pocket[1]))) if pocket else NO_VALUE


def _yes_no(potted: bool | None) -> str:
    return NO_VALUE if potted is None else "yes" if potted else "no"


def _rms(metres: float | None) -> str:
    """An rms error per axis [m] as a distance on the table, in mm with two decimals."""
    return NO_VALUE if metres is None or not math.isfinite(metres) else f"{1e3 * MISS_OVER_AXIS * metres:.2f} mm"


def _percent(chance: float | None) -> str:
    return NO_VALUE if chance is None or not math.isfinite(chance) else f"{100 * chance:.0f} %"


def _range(block: Block) -> str:
    return f"shots {block[0]} to {block[1]}" if block[1] > block[0] else f"shot {block[0]}"


def _lines(text: str) -> str:
    """Text for the recording: printable, with its line breaks."""
    return "\n".join(printable(line) for line in text.split("\n"))
