"""`sysid check`, `sysid compare` and `sysid fit`: a clip set, a model held against it, its constants fitted."""

from __future__ import annotations

import argparse

from models.console import BAD, DONE, FOUND, Progress, Verb, check_outputs, print_constants, write_json
from sysid.cli.common import load, outputs, with_clips, with_drawings, with_effects, with_engine


def register(verb: Verb) -> None:
    """These verbs with their options."""
    one = verb("check", check, "read a clip set; name every fault")
    with_clips(one)
    one.add_argument("--json", metavar="FILE", help="the faults as JSON")
    one = verb("compare", compare, "model against measurement: where it fails")
    with_clips(one)
    one.add_argument("--model", metavar="M.toml", help="model file (default: decoupled cloth, frictional impacts)")
    with_engine(one)
    with_effects(one)
    with_drawings(one)
    one = verb("fit", fit, "constants of the model with their uncertainty, error on clips held out")
    with_clips(one)
    one.add_argument("--model", metavar="M.toml", help="model file to start from")
    with_engine(one)
    one.add_argument("--out", metavar="M2.toml", required=True, help="where the fitted model goes")
    with_effects(one)
    with_drawings(one)


def check(args: argparse.Namespace, progress: Progress) -> int:
    """Name every fault of a clip set."""
    from sysid.clips import check_clip_set, read_clip_set

    check_outputs(args.json)
    faults = check_clip_set(args.clips)
    for fault in faults:
        print(fault)
    if args.json:
        write_json(args.json, {"clips": args.clips, "faults": faults})
    if faults:
        print(f"{len(faults)} fault{'s' if len(faults) > 1 else ''}")
        return BAD
    clip_set = read_clip_set(args.clips)
    samples = sum(len(o.time) for c in clip_set.clips for o in c.balls.values())
    print(f"{args.clips}: {len(clip_set.clips)} clips, {samples} samples, no faults")
    return DONE


def compare(args: argparse.Namespace, progress: Progress) -> int:
    """Model against measurement."""
    from sysid.report.text import in_words, print_comparison
    from sysid.residuals import compare as room

    check_outputs(args.json, args.report, args.rrd)
    clip_set, model = load(args)
    comparison = room.compare(clip_set, model)
    progress.close()
    print_comparison(comparison)
    if args.json:
        write_json(args.json, comparison.to_json())
    outputs(args, [("this model", comparison)], in_words(comparison))
    return DONE


def fit(args: argparse.Namespace, progress: Progress) -> int:
    """Fit a model's constants."""
    from models.model_file import write_model
    from sysid.estimation.clip_fit import fit_clips
    from sysid.estimation.fitting import CHAOS_RATE
    from sysid.report.text import in_words, print_comparison
    from sysid.residuals import compare as room

    check_outputs(args.out, args.json, args.report, args.rrd)
    clip_set, model = load(args)
    found = fit_clips(clip_set, model)
    write_model(found.model, args.out)
    progress.close()
    print_constants(found.model)
    fitted = found.fitted
    if not fitted.converged:
        print("\nNOT converged: these constants are where the fit stopped, and no uncertainty is given.")
    if fitted.discrepancy_rate > CHAOS_RATE:
        rate = f"{fitted.discrepancy_rate * 1e3:.0f} mm a metre"
        print(f"\nThe model's own error grows by {rate} travelled after the first event.")
    print(f"\nmodel: {args.out}\n", flush=True)
    files = [c.file for c in clip_set.clips]
    comparison = room.compare(clip_set, found.model, found.parts.states_of(fitted, files))
    progress.close()
    print_comparison(comparison)
    share = room.coverage(comparison, found.band_rate)
    if share == share:
        print(f"Held-out residuals inside the predicted 95 % band: {100 * share:.0f} %.")
    if args.json:
        values = found.model.parameters()
        constants = {
            n: {"value": values[n], "sd": sd if fitted.converged else float("nan"), "unit": found.model.meta(n)["unit"]}
            for n, sd in fitted.sds.items()
        }
        result = {
            "format": "billiard-fit/1", "converged": fitted.converged, "error_rate": fitted.discrepancy_rate,
            "band_rate": found.band_rate,
            "segment_ratio": found.segment_ratio, "held_out_coverage": share, "parameters": constants,
            "comparison": comparison.to_json(),
        }  # fmt: skip
        write_json(args.json, result)
    outputs(args, [("fitted", comparison)], in_words(comparison))
    return DONE if fitted.converged else FOUND
