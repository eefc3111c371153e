"""The shipped example from start to end: fit, compare, diagnose, and add what is missing."""

from __future__ import annotations

import json
import shlex
import time
from pathlib import Path

from models.commands.console import Progress, Status, as_called, table
from models.model_file import Model, full_model
from sysid.clips import ClipSet, read_clip_set
from sysid.estimation.fitted import MISS_OVER_AXIS
from sysid.report.findings import label, ladder_table, round_rows, shot_lines, verdict_lines
from sysid.report.health import print_health
from sysid.report.outcome import compare_at, write_outcome
from sysid.report.text import in_words
from sysid.report.verdict import verdict_of
from sysid.selection.discover import discover
from sysid.selection.result import DiscoveryResult
from sysid.selection.screening import Diagnosis

COMMAND_NAME = "sysid demo"
EXAMPLE_FOLDER = Path(__file__).parents[2] / "example"
TRUTH_FILE = EXAMPLE_FOLDER.with_name("example.truth.json")
TRUE_NAMES = {  # names of constants in the truth file
    "decoupled_cloth.slide": "mus", "decoupled_cloth.roll": "mur", "decoupled_cloth.spin": "spin",
    "ball_impact.restitution": "ebb", "ball_impact.friction": "mubb",
    "cushion_impact.restitution": "ec", "cushion_impact.friction": "muc",
    "table_tilt.slope_x": "tilt_x", "table_tilt.slope_y": "tilt_y",
}  # fmt: skip
CONFOUNDED_NOTE = (
    "(Confounded effects explain part of the same residuals; the evidence decides which of them explains all.)"
)


def run(out: Path, progress: Progress) -> int:
    """Fit, diagnose and extend the example's model; write model, result, report and recording into the folder `out`."""
    began = time.monotonic()
    clip_set = read_clip_set(EXAMPLE_FOLDER)
    print(
        f"{len(clip_set.clips)} shots on a snooker table, filmed at {clip_set.fps:g} frames a second. Something about"
        "\nthis table is not in the model: what? Every fifth shot is held out of the fits, to validate them.",
        flush=True,
    )

    def show(found: DiscoveryResult) -> None:
        progress.close()
        if not found.rounds:
            _base_errors(clip_set, found, progress)
        if not found.verdict:
            return
        _print_diagnosis(found)
        print(f"\n3. Added, and all constants fitted again: {label(found.verdict)}\n", flush=True)
        print(ladder_table(found))

    found = discover(clip_set, full_model(clip_set.table, clip_set.ball), show)
    progress.close()
    rest = found.rounds[-1]
    print("\nWhat is still missing?\n  " + "\n  ".join(verdict_lines(Diagnosis(rest), None)))
    last = write_outcome(out, clip_set, found, progress, time.monotonic() - began, COMMAND_NAME)
    _print_indented(in_words(last))
    _print_indented(shot_lines(found.next_shots))
    _compare_with_truth(last.model, found)
    print_health(last.model)
    print("\nIn short\n  " + "\n  ".join(verdict_of(found).lines()))
    print(f"\nwritten to {out}: model.toml, result.json, report.html, review.rrd")
    viewer = as_called(f"sysid review {shlex.quote(str(out))}")
    print(f"open {out / 'report.html'} in a browser, which draws what to film next, and the shots with: {viewer}")
    return Status.DONE if found.converged else Status.FINDING


def _base_errors(clip_set: ClipSet, found: DiscoveryResult, progress: Progress) -> None:
    """Print where the base model, all its constants fitted, fails."""
    base, noise = found.last, found.parts.noise
    _, compared = compare_at(0, clip_set, found, COMMAND_NAME)
    progress.close()
    print("\n1. The base model (level table, cloth, balls, cushions), all its constants fitted, leaves")
    print(
        f"   an rms miss of {base.miss * 1e3:.2f} mm, {base.held_miss * 1e3:.2f} mm on held-out shots; the camera's"
        f" noise alone leaves {MISS_OVER_AXIS * noise * 1e3:.2f} mm. Where it fails:\n"
    )
    _print_indented(in_words(compared))


def _print_diagnosis(found: DiscoveryResult) -> None:
    """Print the ranked candidates and the verdict."""
    seen = next(one for one in found.rounds if one.best is not None and one.best.name in found.verdict)
    print("\n2. What could be missing? The evidence for each effect of the catalogue (delta BIC):\n")
    print(table(round_rows(seen)) + "\n")
    _print_indented(verdict_lines(Diagnosis(seen), None))
    if seen.confounded:
        _print_indented([CONFOUNDED_NOTE])


def _compare_with_truth(model: Model, found: DiscoveryResult) -> None:
    """Read the hidden constants, and print them next to those found."""
    truth = json.loads(TRUTH_FILE.read_text(encoding="utf-8"))
    print(f"\n4. Only now {TRUTH_FILE.name} is read. Hidden: {', '.join(truth['effects'])}. ", end="")
    print(f"Found: {', '.join(found.verdict) or 'nothing'}.\n")
    rows: list[tuple[str, ...]] = [("constant", "found", "sd", "hidden", "off by")]
    for name in found.last.names:
        value, sd = model.parameters()[name], model.estimates[name].sd
        if name in TRUE_NAMES:
            hidden = truth["parameters"][TRUE_NAMES[name]]
            rows.append((name, f"{value:.5f}", f"{sd:.5f}", f"{hidden:.5f}", f"{(value - hidden) / sd:+.1f} sd"))
    print(table(rows))


def _print_indented(lines: list[str]) -> None:
    for line in lines:
        print(f"  {line}")
