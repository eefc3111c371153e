"""`sysid check`, `sysid compare` and `sysid fit`: a clip set, a model compared with it, its constants fitted."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from models.commands.console import Progress, Status, print_constants, table, write_json
from models.commands.options import effects_option, gathered, json_option, out_option, scheduler_option
from models.errors import BadInput
from models.messages import counted
from sysid.cli.common import Outputs, Start, clips_argument, spread_over_cluster

if TYPE_CHECKING:
    from sysid.estimation.clip_fit import ClipFit
    from sysid.residuals.comparison import Comparison


@click.command()
@clips_argument
@json_option
def check(clips: Path, json_file: Path | None) -> int:
    """Check a clip set: report every fault, and every entry that its tracks contradict.

    Reads CLIPS/clips.toml and the clips that it lists. Status 2 if there are faults.

    Example: sysid check CLIPS
    """
    from sysid.clips import inspect_clip_set
    from sysid.clips.consistency.contradictions import pocket_note, size_notes
    from sysid.clips.running import running_line

    found = inspect_clip_set(clips)
    faults = found.fault_lines()
    for line in [*faults, *(f"warning: {warning}" for warning in found.warnings)]:
        print(line)
    notes = size_notes(found.clip_set) if found.clip_set else []
    if found.clip_set and (pockets := pocket_note(found.clip_set)):
        notes.append(pockets)
    if found.clip_set and found.resting:
        notes.append(f"{found.resting} clips begin before the strike; time 0 is the strike, samples before are ignored")
    if found.clip_set and (running := running_line(found.clip_set.clips)):
        notes.append(running)
    for line in notes:
        print(f"note: {line}")
    if json_file:
        lines = {"faults": faults, "warnings": list(found.warnings), "notes": notes}
        write_json(json_file, {"clips": str(clips), **lines})
    if found.clip_set is None:
        print(counted(len(faults), "fault"))
        return Status.BAD_INPUT
    clip_set = found.clip_set
    samples = sum(len(o.time) for c in clip_set.clips for o in c.balls.values())
    print(f"{clips}: {counted(len(clip_set.clips), 'clip')}, {counted(samples, 'sample')}, no faults")
    return Status.DONE


@click.command()
@gathered("start", Start)
@effects_option()
@gathered("outputs", Outputs)
@click.pass_obj
def compare(progress: Progress, start: Start, outputs: Outputs) -> int:
    """Compare models with the measurement: where they fail.

    Reads the clip set CLIPS and a model file. Fits each clip's initial state, holds the model's constants, and prints
    the residuals by clip, kind of motion and place. With --model given more than once, each is compared; the report
    shows the first beside the last, so give the better one last.

    Example: sysid compare CLIPS --model before.toml --model after.toml --report compare.html
    """
    from sysid.interface import compare as compare_clips
    from sysid.report.text import beside_rows, in_words, print_comparison

    clip_set, models = start.load_several()
    labels = labels_of(start.model_files)
    compared = [(label, compare_clips(clip_set, model)) for label, model in zip(labels, models, strict=True)]
    progress.close()
    if len(compared) > 1:
        print(table(beside_rows(compared)) + f"\n\n{labels[-1]}")
    last = compared[-1][1]
    print_comparison(last)
    if outputs.json_file:
        others = [{"model": label, "summary": one.summary()} for label, one in compared[:-1]]
        write_json(outputs.json_file, last.to_json() | ({"beside": others} if others else {}))
    outputs.write(compared, in_words(last))
    return Status.DONE


def labels_of(files: Sequence[Path]) -> list[str]:
    """Labels of the models in a comparison: file names, with folders where the names are the same."""
    if len(files) < 2:
        return ["this model"]
    names = [file.stem for file in files]
    labels = names if len(set(names)) == len(names) else [str(file) for file in files]
    if len(set(labels)) < len(labels):
        raise BadInput(f"--model {files[0]}: is given twice; name another model, or omit it")
    return labels


@click.command()
@gathered("start", Start)
@out_option("M2.toml", "File for the fitted model.")
@effects_option(exposed=True)
@gathered("outputs", Outputs)
@scheduler_option
@click.pass_obj
def fit(
    progress: Progress, start: Start, out: Path, outputs: Outputs, scheduler: str | None,
    effect_folders: tuple[str, ...],
) -> int:  # fmt: skip
    """Fit a model's constants, each with its standard deviation.

    Reads the clip set CLIPS and the model to start from. Writes the fitted model, and prints its constants and its
    error on clips held out. Status 1 if the fit did not converge. With --scheduler, workers share the fit of 32
    clips or more; smaller sets are fitted on this machine.

    Example: sysid fit CLIPS --out fitted.toml --report fit.html
    """
    from sysid.interface import fit as fit_clips
    from sysid.report.health import print_health
    from sysid.report.text import in_words, print_comparison
    from sysid.residuals.compare import compare as compare_clips
    from sysid.residuals.compare import coverage

    clip_set, model = start.load()
    with spread_over_cluster(scheduler, effect_folders):
        found = fit_clips(clip_set, model)
    found.save(out)
    progress.close()
    print_constants(found.model)
    for line in found.parts.excluded:
        print(line)
    if not found.converged:
        print("\nNOT converged: the constants are those where the fit stopped; no standard deviations are reported.")
    if not found.parts.follows(found.fitted):
        rate = f"{found.fitted.discrepancy_rate * 1e3:.0f} mm per metre"
        print(f"\nAfter the first impact the model's own error grows by {rate} of path.")
    print(f"\nmodel: {out}\n", flush=True)
    states = found.parts.states_of(found.fitted, [c.file for c in clip_set.clips])
    found = found.without_clips()
    comparison = compare_clips(clip_set, found.model, states)
    progress.close()
    print_comparison(comparison)
    share = coverage(comparison, found.band_rate)
    if share == share:
        print(f"Held-out residuals inside the predicted 95 % band: {100 * share:.0f} %.")
    print_health(found.model)
    if outputs.json_file:
        write_json(outputs.json_file, _fit_json(found, comparison, share))
    outputs.write([("fitted", comparison)], in_words(comparison))
    return Status.DONE if found.converged else Status.FINDING


def _fit_json(found: ClipFit, comparison: Comparison, share: float) -> dict[str, Any]:
    """Format billiard-fit/1."""
    from sysid.report.health import health_lines

    constants = {
        n: {"value": value, "sd": sd, "unit": found.model.meta(n)["unit"]} for n, (value, sd) in found.constants.items()
    }
    return {
        "format": "billiard-fit/1", "converged": found.converged, "error_rate": found.fitted.discrepancy_rate,
        "band_rate": found.band_rate, "segment_ratio": found.segment_ratio, "held_out_coverage": share,
        "parameters": constants, "comparison": comparison.to_json(),
        "health": health_lines(found.model),
    }  # fmt: skip
