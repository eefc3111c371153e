"""The shipped example, start to end: fit, compare, diagnose, add what is missing, watch the error fall to the noise."""

from __future__ import annotations

import json
import time
from pathlib import Path

from models.console import DONE, FOUND, Progress, table
from models.errors import BadInput
from models.model_file import Model, full_model
from sysid.clips import ClipSet, read_clip_set
from sysid.report.findings import label, print_ladder, round_rows, shot_lines, verdict_lines
from sysid.report.outcome import compare_at, write_outcome
from sysid.report.text import in_words
from sysid.selection.discover import DiscoveryResult, discover
from sysid.selection.judge import Diagnosis

COMMAND = "sysid demo"
EXAMPLE = Path(__file__).parents[1] / "example"
TRUTH = EXAMPLE.with_name("example.truth.json")
HIDDEN = {
    "decoupled_cloth.slide": "mus", "decoupled_cloth.roll": "mur", "decoupled_cloth.spin": "spin",
    "ball_impact.restitution": "ebb", "ball_impact.friction": "mubb",
    "cushion_impact.restitution": "ec", "cushion_impact.friction": "muc",
    "table_tilt.slope_x": "tilt_x", "table_tilt.slope_y": "tilt_y",
}  # fmt: skip
ALIKE = "(Look-alikes: part of the one passes for part of the other; the evidence says which of them explains it all.)"


def run(out: Path, progress: Progress) -> int:
    """Tell the story of the example, and write model, result, report and recording into `out`."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{out}: cannot be made ({error.strerror}); choose another folder") from error
    began = time.monotonic()
    clip_set = read_clip_set(EXAMPLE)
    print(
        f"{len(clip_set.clips)} shots on a snooker table, filmed at {clip_set.fps:g} frames a second. Something about"
        "\nthis table is not in the model: what? Every fifth shot is held out: it gives no constants, it judges them.",
        flush=True,
    )

    def tell(found: DiscoveryResult) -> None:
        progress.close()
        if not found.rounds:
            _failing(clip_set, found, progress)
            return
        _diagnosed(found)
        print(f"\n3. Added, and all constants fitted again: {label(found.verdict)}\n", flush=True)
        print_ladder(found)

    found = discover(clip_set, full_model(clip_set.table, clip_set.ball), tell)
    progress.close()
    rest = found.rounds[-1]
    print("\nWhat is still missing?\n  " + "\n  ".join(verdict_lines(Diagnosis(rest), None)))
    last = write_outcome(out, clip_set, found, progress, time.monotonic() - began, COMMAND)
    _indented(in_words(last))
    _indented(shot_lines(found.next_shot))
    _revealed(last.model, found)
    print(f"\nwritten to {out}: model.toml, result.json, report.html, review.rrd")
    print(f"open {out / 'report.html'} in a browser, and the shots with: .venv/bin/rerun {out / 'review.rrd'}")
    return DONE if found.last.converged else FOUND


def _failing(clip_set: ClipSet, found: DiscoveryResult, progress: Progress) -> None:
    """Where the base model, at its best constants, fails."""
    base, noise = found.last, found.parts.noise
    _, compared = compare_at(0, clip_set, found, COMMAND)
    progress.close()
    print("\n1. The base model (level table, cloth, balls, cushions), all its constants fitted, misses by")
    print(
        f"   {base.rms * 1e3:.2f} mm rms an axis, {base.held_rms * 1e3:.2f} mm on held-out shots; the camera's noise is"
        f" {noise * 1e3:.2f} mm. Where it fails:\n"
    )
    _indented(in_words(compared))


def _diagnosed(found: DiscoveryResult) -> None:
    """What could be missing, ranked, and the verdict."""
    seen = found.rounds[-1]
    print("\n2. What could be missing? The evidence for each effect of the catalogue (delta BIC; 10 is enough):\n")
    print(table(round_rows(seen)) + "\n")
    _indented(verdict_lines(Diagnosis(seen), None))
    if seen.confounded:
        _indented([ALIKE])


def _revealed(model: Model, found: DiscoveryResult) -> None:
    """What was hidden, read only now, beside what was found."""
    truth = json.loads(TRUTH.read_text(encoding="utf-8"))
    print(f"\n4. Only now {TRUTH.name} is opened. Hidden: {', '.join(truth['effects'])}. ", end="")
    print(f"Found: {', '.join(found.verdict) or 'nothing'}.\n")
    rows: list[tuple[str, ...]] = [("constant", "found", "sd", "hidden", "off by")]
    for name in found.last.names:
        value, sd = model.parameters()[name], model.estimates[name].sd
        if name in HIDDEN:
            hidden = truth["parameters"][HIDDEN[name]]
            rows.append((name, f"{value:.5f}", f"{sd:.5f}", f"{hidden:.5f}", f"{(value - hidden) / sd:+.1f} sd"))
    print(table(rows))


def _indented(lines: list[str]) -> None:
    for line in lines:
        print(f"  {line}")
