"""`sysid diagnose`, `sysid discover` and `sysid demo`: what a model leaves out."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from models.commands.console import Progress, Status, as_called, print_constants, table, write_json
from models.commands.options import effects_option, gathered, json_option, out_folder_option, scheduler_option
from models.files import alone_in, result_folder
from models.messages import counted
from sysid.cli.common import Start, report_option, spread_over_cluster

if TYPE_CHECKING:
    from models.model_file import Model
    from sysid.clips import ClipSet
    from sysid.selection.result import DiscoveryResult

error_rate_option = click.option(
    "--error-rate", type=click.FloatRange(0.0, 0.5, min_open=True, max_open=True), default=0.05, show_default=True,
    metavar="SHARE", help="Accepted probability that an added cause is due to chance.",
)  # fmt: skip
JOURNAL_FILE, RESULT_FILE = "unfinished.jsonl", "result.json"
DISCOVERY_FILES = ("model.toml", RESULT_FILE, "report.html", "review.rrd")


@click.command()
@out_folder_option("Folder of results.", *DISCOVERY_FILES, required=False, default="out/demo", show_default=True)
@click.pass_obj
def demo(progress: Progress, out: Path) -> int:
    """Run the shipped example: find the effect that it hides.

    Fits, diagnoses and extends the model of twelve shots, and compares what it found with the truth. Writes model,
    result, report and recording into DIR.

    Example: sysid demo
    """
    from sysid.cli.identification.demo import run

    click.get_current_context().with_resource(alone_in(result_folder(out)))
    return run(out, progress)


@click.command()
@gathered("start", Start)
@error_rate_option
@effects_option()
@json_option
@report_option
@click.pass_obj
def diagnose(
    progress: Progress, start: Start, error_rate: float, json_file: Path | None, report_file: Path | None
) -> int:
    """Diagnose which effect a model lacks, if any.

    Reads the clip set CLIPS and the model to start from. Prints the evidence for each effect of the catalogue, the
    verdict, and the most informative next shot. Status 1 if the fit did not converge.

    Example: sysid diagnose CLIPS --model fitted.toml
    """
    from sysid.interface import diagnose as diagnose_clips
    from sysid.report.findings import miss_line, noise_line, round_rows, shot_lines, verdict_lines
    from sysid.report.result_json import judgement_json

    clip_set, model = start.load()
    found = diagnose_clips(clip_set, model, error_rate)
    parts, judged = found.parts, found.diagnosis
    progress.close()
    seen = judged.screening
    held_out = len(parts.held_out.clips) if parts.held_out else 0
    print(f"{counted(len(clip_set.clips), 'clip')}, {held_out} of them held out; {noise_line(parts.noise)}")
    if seen.windows:
        print(f"shots of many impacts: candidates are scored on {seen.windows} windows of one impact each")
    print(f"{miss_line('base', seen.base)}\n")
    print(table(round_rows(seen)))
    notes = [*parts.excluded, *verdict_lines(judged, found.unexplained)]
    notes += shot_lines(found.next_shots)
    print("\n" + "\n".join(notes))
    if json_file:
        write_json(json_file, judgement_json(parts, judged, found.unexplained, found.next_shots))
    if report_file:
        found.report(report_file, notes)
        progress.close()
        print(f"report: {report_file}")
    elif found.next_shots:
        print("--report FILE draws what to film next")
    return Status.DONE if seen.base.converged else Status.FINDING


@click.command()
@gathered("start", Start)
@out_folder_option("Folder of results.", JOURNAL_FILE, *DISCOVERY_FILES)
@error_rate_option
@effects_option(exposed=True)
@json_option
@scheduler_option
@click.pass_obj
def discover(
    progress: Progress, start: Start, out: Path, error_rate: float, json_file: Path | None, scheduler: str | None,
    effect_folders: tuple[str, ...],
) -> int:  # fmt: skip
    """Discover all that a model lacks: fit, diagnose and add effects.

    Reads the clip set CLIPS and the model to start from, and repeats until nothing likely remains. Writes
    model.toml, result.json, report.html and review.rrd into DIR. After an interrupt the same command continues there.
    With --scheduler, workers share the fits of 32 clips or more; smaller sets are fitted on this machine.

    Example: sysid discover CLIPS --out out/mine
    """
    from sysid.estimation.clip_fit import band_rate
    from sysid.estimation.solver.journal import Journal, recorded_in
    from sysid.interface import discover as discover_effects
    from sysid.report.findings import discovery_lines, ladder_table
    from sysid.report.health import print_health
    from sysid.report.outcome import write_outcome
    from sysid.report.text import engines_line, held_out_line

    clip_set, model = start.load()
    click.get_current_context().with_resource(alone_in(result_folder(out)))
    journal = Journal(out / JOURNAL_FILE, _fingerprint(clip_set, model))
    if journal.found:
        print(f"continuing from {journal.path}: {journal.found} fits are done already", flush=True)

    printed = _Printed(progress)
    try:
        with recorded_in(journal), spread_over_cluster(scheduler, effect_folders):
            found = discover_effects(clip_set, model, printed.step, error_rate)
    except KeyboardInterrupt as end:
        if journal.path.exists():
            end.add_note(f"{journal.path} is kept: the same command continues from there")
        raise
    printed.rounds(found)
    print(ladder_table(found))
    print("\n" + _to_paste("\n".join(discovery_lines(found)), out) + "\n")
    outcome = write_outcome(out, clip_set, found, progress, journal.elapsed, f"sysid discover {start.clips}")
    print_constants(outcome.model)
    print("\n" + engines_line(outcome))
    if found.parts.held_out and not found.parts.follows(found.last):
        print(held_out_line(outcome, band_rate(found.last)))
    print_health(outcome.model)
    print(f"\n{_to_paste(str(found), out)}")
    print(f"\nwritten to {out}: model.toml, result.json, report.html, review.rrd")
    if found.next_shots:
        print(f"{out / 'report.html'} draws what to film next")
    journal.path.unlink(missing_ok=True)
    if json_file:
        write_json(json_file, json.loads((out / RESULT_FILE).read_text(encoding="utf-8")))
    return Status.DONE if found.converged else Status.FINDING


class _Printed:
    """The progress of a discovery: prints each round once."""

    def __init__(self, progress: Progress) -> None:
        self._progress, self._rounds, self._exchanged = progress, 0, 0

    def rounds(self, found: DiscoveryResult) -> None:
        """Print the rounds that have not been printed yet."""
        from sysid.report.findings import round_rows

        self._progress.close()
        for one in found.rounds[self._rounds :]:
            acting = ", ".join(effect.name() for effect in one.base.model.effects)
            print(f"candidates for a model of {acting}:\n{table(round_rows(one))}\n")
        self._rounds = len(found.rounds)

    def step(self, found: DiscoveryResult) -> None:
        """Print the rounds that have not been printed yet, and the miss with the last effect."""
        from sysid.report.findings import exchange_lines, miss_line

        for line in exchange_lines(found)[self._exchanged :]:
            self._progress.close()
            print(f"{line}\n")
            self._exchanged, self._rounds = self._exchanged + 1, 0
        self.rounds(found)
        print(f"{miss_line(', '.join(found.verdict) or 'base', found.last)}\n", flush=True)


def _to_paste(text: str, out: Path) -> str:
    """The text with the new-effect command in a form that can be pasted into this shell."""
    from sysid.report.findings import NEW_EFFECT_COMMAND

    return text.replace(NEW_EFFECT_COMMAND, as_called(f"sysid new-effect NAME --from {out / RESULT_FILE}"))


def _fingerprint(clip_set: ClipSet, model: Model) -> str:
    """Digest of everything that the fits depend on: clips, start model, catalogue, sources."""
    from models.effect_catalogue import catalogue, own_texts

    digest = hashlib.sha256()
    root = Path(__file__).resolve().parents[3]
    for path in sorted([*root.glob("models/**/*.py"), *root.glob("sysid/**/*.py")]):
        digest.update(path.read_bytes())
    digest.update(repr((clip_set.table, clip_set.ball, clip_set.fps, clip_set.sigma, sorted(catalogue()))).encode())
    digest.update(repr([(e.name(), sorted(vars(e).items())) for e in model.effects]).encode())
    digest.update(repr((vars(model.native), model.sizes, model.engine)).encode())
    for text in own_texts():
        digest.update(text)
    for clip in clip_set.clips:
        digest.update(repr((clip.file, clip.struck, clip.cue, clip.running)).encode())
        for name, seen in clip.balls.items():
            digest.update(name.encode() + seen.time.tobytes() + seen.xy.tobytes() + seen.theta.tobytes())
    return digest.hexdigest()
