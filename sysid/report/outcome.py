"""What a discovery leaves in its folder: model, result, report and recording."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

from models.console import Progress, write_json
from models.model_file import write_model
from sysid.clips import ClipSet
from sysid.report.findings import discovery_lines, failures, label, model_of, result_of, sections
from sysid.report.html import Rung, write_report
from sysid.report.recording import write_rrd
from sysid.residuals.compare import compare
from sysid.residuals.comparison import Comparison
from sysid.selection.discover import DiscoveryResult

log = logging.getLogger(__name__)


def compare_at(number: int, clip_set: ClipSet, found: DiscoveryResult, command: str) -> tuple[str, Comparison]:
    """The label of a stage of the ladder, and what comparing its model with all clips says."""
    seen = found.ladder[number]
    own = found.parts.states_of(seen, [c.file for c in clip_set.clips])
    log.info("comparing %s", label(found.verdicts[number]))
    compared = compare(clip_set, model_of(found, seen, command), start=own)
    return label(found.verdicts[number]), compared


def write_outcome(
    out: Path, clip_set: ClipSet, found: DiscoveryResult, progress: Progress, elapsed: float, command: str
) -> Comparison:
    """model.toml, result.json, report.html and review.rrd; the comparison of the model that was found."""
    ends = list(dict.fromkeys((0, len(found.ladder) - 1)))

    compared = [compare_at(end, clip_set, found, command) for end in ends]
    progress.close()
    last = compared[-1][1]
    write_model(last.model, out / "model.toml")
    write_json(str(out / "result.json"), result_of(found, elapsed, compared))
    first = failures(*compared[0]) if len(compared) > 1 else []
    write_report(
        out / "report.html", f"What {len(clip_set.clips)} clips say", compared, notes=discovery_lines(found),
        sections=[*first, *sections(found.rounds)], ladder=_rungs(found),
    )  # fmt: skip
    write_rrd(out / "review.rrd", last)
    return last


def _rungs(found: DiscoveryResult) -> list[Any]:
    """The ladder for the report: rms distance, which is sqrt(2) times the rms per axis."""
    both = 2**0.5
    rungs = [
        Rung(label(names), both * s.rms, both * s.held_rms, s.chi2)
        for s, names in zip(found.ladder, found.verdicts, strict=True)
    ]
    if found.explained is not None:
        s = found.explained
        rungs.append(Rung(label(found.verdict) + " + the formula", both * s.rms, both * s.held_rms, s.chi2))
    return rungs
