"""The files of a discovery: model.toml, result.json, report.html and review.rrd.

In: a `DiscoveryResult`. Out: files in its folder, each written by the module of this room that knows its format.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from models.commands.console import Progress, write_json
from models.messages import counted
from models.model_file import write_model
from models.shot import Track
from sysid.clips import ClipSet
from sysid.clips.trust import camera_doubts, doubt_line
from sysid.estimation.fitted import as_model
from sysid.report.findings import discovery_lines, label, labelled_models
from sysid.report.html import Rung, write_report
from sysid.report.recording import write_rrd
from sysid.report.result_json import result_of
from sysid.report.verdict import verdict_of
from sysid.residuals.compare import compare, played_clips
from sysid.residuals.comparison import Comparison
from sysid.selection.result import DiscoveryResult

log = logging.getLogger(__name__)


def compare_at(number: int, clip_set: ClipSet, found: DiscoveryResult, command: str) -> tuple[str, Comparison]:
    """The label of one step of the ladder, and the comparison of its model with all clips."""
    fitted = found.ladder[number]
    initial_states = found.parts.states_of(fitted, [c.file for c in clip_set.clips])
    name = label(found.verdicts[number])
    log.info("comparing %s", name)
    return name, compare(clip_set, found.model_of(fitted, command), initial_states)


def played_between(clip_set: ClipSet, found: DiscoveryResult, command: str) -> list[tuple[str, dict[str, Track]]]:
    """The models between the first and the last of the ladder: their labels, and their whole shots by clip."""
    played = []
    for number in range(1, len(found.ladder) - 1):
        fitted = found.ladder[number]
        initial_states = found.parts.states_of(fitted, [c.file for c in clip_set.clips])
        name = label(found.verdicts[number])
        log.info("playing %s", name)
        played.append((name, played_clips(clip_set, found.model_of(fitted, command), initial_states)))
    return played


def compared_ends(clip_set: ClipSet, found: DiscoveryResult, command: str) -> list[tuple[str, Comparison]]:
    """The first and the last model of the ladder, each compared with all clips; one where nothing was added."""
    ends = dict.fromkeys((0, len(found.ladder) - 1))
    return [compare_at(end, clip_set, found, command) for end in ends]


def compared_with_formula(clip_set: ClipSet, found: DiscoveryResult, command: str) -> list[tuple[str, Comparison]]:
    """The last model with the formula for what no effect explains, compared with all clips; none without a formula."""
    if found.explained is None:
        return []
    files = [c.file for c in found.parts.training.clips]
    initial_states = found.parts.states_of(found.explained, [c.file for c in clip_set.clips])
    name, fitted = labelled_models(found)[-1]
    log.info("comparing %s", name)
    return [(name, compare(clip_set, as_model(fitted, command, files), initial_states))]


def write_discovery(
    path: Path | str, clip_set: ClipSet, found: DiscoveryResult, compared: Sequence[tuple[str, Comparison]]
) -> None:
    """Write the report of a discovery; `compared` is what `compared_ends` and `compared_with_formula` give."""
    ladder = [Rung(name, fitted.miss, fitted.held_miss, fitted.chi2) for name, fitted in labelled_models(found)]
    title = f"What {counted(len(clip_set.clips), 'clip')} say{'s' * (len(clip_set.clips) == 1)} about the table"
    notes = discovery_lines(found)
    said = verdict_of(found)
    if doubt := doubt_line(clip_set.folder, camera_doubts(clip_set)):
        said = replace(said, certainty=f"{said.certainty}; {doubt}")
    write_report(
        path, title, compared, notes=notes, ladder=ladder, rounds=found.rounds, verdict=said,
        unexplained=found.unexplained, next_shots=found.next_shots,
    )  # fmt: skip


def write_outcome(
    out: Path, clip_set: ClipSet, found: DiscoveryResult, progress: Progress, elapsed: float, command: str
) -> Comparison:
    """Write all four files into a folder; the comparison of the model that was found."""
    compared = compared_ends(clip_set, found, command)
    with_formula = compared_with_formula(clip_set, found, command)
    between = played_between(clip_set, found, command)
    progress.close()
    last = compared[-1][1]
    write_model(last.model, out / "model.toml")
    result = result_of(found, elapsed, compared) | {"camera_doubts": list(camera_doubts(clip_set))}
    write_json(str(out / "result.json"), result)
    write_discovery(out / "report.html", clip_set, found, [*compared, *with_formula])
    write_rrd(out / "review.rrd", compared, between)
    return last
