"""The `sysid` command: every verb reads a clip set, prints a table, and writes the same figures where asked."""

from __future__ import annotations

import argparse
import dataclasses
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from models.errors import BadInput
from sysid.output import Progress, print_constants, progress_of, write_json

if TYPE_CHECKING:
    from models.model_file import Model
    from sysid.clips import ClipSet
    from sysid.comparison import Comparison

DONE, FOUND, BAD = 0, 1, 2
INTERRUPTED = 130


def check_outputs(*paths: str | None) -> None:
    """Refuse before the work what could not be written after it."""
    for path in paths:
        if path and not Path(path).resolve().parent.is_dir():
            raise BadInput(f"{path}: its folder does not exist; make it or choose another place")
        if path and Path(path).is_dir():
            raise BadInput(f"{path}: is a folder; name a file")


def own_effects(folders: Sequence[str]) -> list[str]:
    """Let a user's folders of effects join the catalogue; returns their names."""
    if not folders:
        return []
    from models.model_file import add_folder

    return [name for folder in folders for name in add_folder(folder)]


def load(args: argparse.Namespace) -> tuple[ClipSet, Model]:
    """The clip set, and the model named or the base: decoupled cloth with frictional impacts."""
    from models.model_file import full_model, read_model
    from sysid.clips import read_clip_set
    from sysid.prepare import prepare

    clip_set = read_clip_set(args.clips)
    if getattr(args, "jaws", False):
        from sysid.clips.jaws import before_jaws

        clip_set = before_jaws(clip_set)
    prepare()
    player = getattr(args, "engine", "events")
    if not args.model:
        return clip_set, dataclasses.replace(full_model(clip_set.table, clip_set.ball), engine=player)
    model = dataclasses.replace(read_model(args.model), engine=player)
    if (model.table, model.ball) != (clip_set.table, clip_set.ball):
        raise BadInput(f"{args.model}: its table and ball are not those of {args.clips}; fit a model to this clip set")
    return clip_set, model


def outputs(args: argparse.Namespace, comparisons: Sequence[tuple[str, Comparison]], notes: Sequence[str]) -> None:
    """The report and the recording, where asked."""
    last = comparisons[-1][1]
    if args.report:
        from sysid.report import write_report

        write_report(args.report, f"Model against {len(last.clips)} clips", comparisons, notes=notes, model=last.model)
        print(f"report: {args.report}")
    if args.rrd:
        from sysid.review import write_rrd

        write_rrd(args.rrd, last)
        print(f"recording: {args.rrd} (open it with: rerun {args.rrd})")


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
    from sysid import compare as room
    from sysid.tell import print_comparison

    check_outputs(args.json, args.report, args.rrd)
    clip_set, model = load(args)
    comparison = room.compare(clip_set, model, progress)
    progress.close()
    print_comparison(comparison)
    if args.json:
        write_json(args.json, comparison.to_json())
    outputs(args, [("this model", comparison)], room.in_words(comparison))
    return DONE


def fit(args: argparse.Namespace, progress: Progress) -> int:
    """Fit a model's constants."""
    from models.model_file import write_model
    from sysid import compare as room
    from sysid.estimation.clip_fit import fit_clips
    from sysid.estimation.fitting import CHAOS_RATE
    from sysid.tell import print_comparison

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
    comparison = room.compare(clip_set, found.model, progress, found.parts.states_of(fitted, files))
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
    outputs(args, [("fitted", comparison)], room.in_words(comparison))
    return DONE if fitted.converged else FOUND


def add(args: argparse.Namespace, progress: Progress) -> int:
    """Put an effect on a model's stack."""
    from models.model_file import effect_class, read_model, write_model

    check_outputs(args.out)
    effect = effect_class(args.effect)()
    before = read_model(args.model)
    model = before.add(effect)
    write_model(model, args.out)
    gone = [e.name() for e in before.effects if e.name() not in {k.name() for k in model.effects}]
    instead = f" (instead of {', '.join(gone)})" if gone else ""
    print(f"{args.out}: {', '.join(e.name() for e in model.effects)}{instead}")
    return DONE


def effects(args: argparse.Namespace, progress: Progress) -> int:
    """List the catalogue, or check effects against what every effect owes the workbench."""
    from models.contract import described, faults
    from models.model_file import catalogue, effect_class

    check_outputs(args.json)
    names = args.names or (list(args.own) if args.check and args.own else list(catalogue()))
    entries: list[dict[str, Any]] = []
    for name in dict.fromkeys(names):
        entry = described(effect_class(name))
        entries.append(entry)
        if args.check:
            progress(f"checking {name}")
            entry["faults"] = faults(effect_class(name))
            progress.close()
            print("\n".join([f"{name}: {fault}" for fault in entry["faults"]] or [f"{name}: no faults"]), flush=True)
            continue
        print(f"{name}  ({', '.join(entry['doors'])}{'; slot ' + entry['slot'] if entry['slot'] else ''})")
        print("\n".join(f"  {text}" for text in (entry["says"], entry["formula"]) if text))
        for key, meta in entry["parameters"].items():
            low, high = meta["bounds"]
            off = "only shapes it" if meta["off"] is None else f"off at {meta['off']:g}"
            print(f"    {key} = {meta['default']:g} [{meta['unit']}], {low:g} to {high:g}, {off}: {meta['source']}")
    if args.json:
        write_json(args.json, {"effects": entries})
    return FOUND if any(entry.get("faults") for entry in entries) else DONE


def new_effect(args: argparse.Namespace, progress: Progress) -> int:
    """Write an effect's file to fill in, and its test."""
    from sysid import new_effect as room

    room.checked_name(args.name)
    effect, test = room.write(args.name, args.dir, room.source_of(args.result, args.name) if args.result else None)
    print(f"{effect}: the effect, which runs as it is; fill in what it says")
    print(f"{test}: its test; run it with: python -m pytest {test}")
    print(f"check it with: sysid effects --check --effects {args.dir}")
    return DONE


def diagnose(args: argparse.Namespace, progress: Progress) -> int:
    """Which effect is missing."""
    from sysid import loop_cli

    check_outputs(args.json, args.report)
    return loop_cli.diagnose(args, *load(args), progress)


def discover(args: argparse.Namespace, progress: Progress) -> int:
    """The whole loop."""
    from sysid import loop_cli

    return loop_cli.discover(args, *load(args), progress)


def match(args: argparse.Namespace, progress: Progress) -> int:
    """MuJoCo against the analytic models and published measurements."""
    check_outputs(args.json, args.tune)
    if args.tune is not None:
        from models.model_file import write_model
        from sysid.validation.native_fit import tuned

        model = tuned(progress)
        progress.close()
        print_constants(model)
        write_model(model, args.tune)
        print(f"\nmodel: {args.tune}")
        return DONE
    if args.clips is not None:
        from sysid.validation.clips import write_clips

        write_clips(args.clips)
        print(f"{args.clips}: clips of the analytic models, and native.toml to start a fit of MuJoCo's contacts from")
        return DONE
    from sysid.validation import match as room

    found = []
    for row in room.rows():
        progress.close()
        found.append(row)
        print(room.line(row), flush=True)
        progress("the next rows")
    progress.close()
    missed = [row for row in found if not row.ok]
    print(f"\n{len(found)} rows, {sum(row.reach is not None for row in found)} with a reach, {len(missed)} missed")
    if args.json:
        write_json(args.json, {"rows": [room.to_json(row) for row in found]})
    return FOUND if missed else DONE


def demo(args: argparse.Namespace, progress: Progress) -> int:
    """The shipped example, start to end."""
    from sysid.demo import run

    return run(Path(args.out), progress)


def jaws(one: argparse.ArgumentParser) -> None:
    """The option of a verb that looks at shots."""
    text = "the table's pockets have jaws: look at every shot up to where a ball touches one"
    one.add_argument("--jaws", action="store_true", help=text)


def engine(one: argparse.ArgumentParser) -> None:
    """The option of a verb that plays shots."""
    text = "what plays the shots: the compiled event engine (default), or MuJoCo, in which the result is checked anyway"
    one.add_argument("--engine", choices=("events", "mujoco"), default="events", help=text)


def parser() -> argparse.ArgumentParser:
    """Every verb with its options."""
    top = argparse.ArgumentParser(prog="sysid", description="From tracked shots to a fitted MuJoCo table.")
    verbs = top.add_subparsers(dest="verb", required=True, metavar="VERB")

    def verb(name: str, run: Callable[[argparse.Namespace, Progress], int], text: str) -> argparse.ArgumentParser:
        one = verbs.add_parser(name, help=text, description=text)
        one.set_defaults(run=run)
        return one

    def drawing(one: argparse.ArgumentParser) -> None:
        one.add_argument("--json", metavar="FILE", help="the same figures as JSON")
        one.add_argument("--report", metavar="FILE.html", help="the same with pictures")
        one.add_argument("--rrd", metavar="FILE.rrd", help="measured and modelled shots for Rerun")

    def playing(one: argparse.ArgumentParser) -> None:
        jaws(one)
        engine(one)

    def own(one: argparse.ArgumentParser) -> None:
        text = "folder, or file, with effects of your own (may be given again)"
        one.add_argument("--effects", metavar="DIR", action="append", default=[], help=text)

    one = verb("check", check, "read a clip set; name every fault")
    one.add_argument("clips", metavar="CLIPS", help="folder with clips.toml")
    one.add_argument("--json", metavar="FILE", help="the faults as JSON")
    one = verb("compare", compare, "model against measurement: where it fails")
    one.add_argument("clips", metavar="CLIPS", help="folder with clips.toml")
    one.add_argument("--model", metavar="M.toml", help="model file (default: decoupled cloth, frictional impacts)")
    playing(one)
    own(one)
    drawing(one)
    one = verb("fit", fit, "constants of the model with their uncertainty, error on clips held out")
    one.add_argument("clips", metavar="CLIPS", help="folder with clips.toml")
    one.add_argument("--model", metavar="M.toml", help="model file to start from")
    playing(one)
    one.add_argument("--out", metavar="M2.toml", required=True, help="where the fitted model goes")
    own(one)
    drawing(one)
    one = verb("add", add, "put an effect on a model's stack")
    one.add_argument("effect", metavar="EFFECT")
    one.add_argument("--model", metavar="M.toml", required=True)
    one.add_argument("--out", metavar="M2.toml", required=True)
    own(one)
    one = verb("effects", effects, "the catalogue of effects; with --check, whether they keep their contract")
    one.add_argument("names", metavar="NAME", nargs="*", help="only these")
    one.add_argument("--check", action="store_true", help="name every fault of these, of the folders', or of all")
    one.add_argument("--json", metavar="FILE", help="the same as JSON")
    own(one)
    one = verb("new-effect", new_effect, "an effect's file to fill in, with its test")
    one.add_argument("name", metavar="NAME", help="in small letters joined by _")
    one.add_argument("--dir", metavar="DIR", default="effects", help="where they go (default: effects)")
    one.add_argument(
        "--from", dest="result", metavar="result.json", help="begin with what a discovery left unexplained"
    )
    own(one)
    one = verb("diagnose", diagnose, "which effect is missing: ranked, or none, or something else")
    one.add_argument("clips", metavar="CLIPS", help="folder with clips.toml")
    one.add_argument("--model", metavar="M.toml", help="model file to start from (default: the base)")
    playing(one)
    own(one)
    one.add_argument("--json", metavar="FILE", help="the same figures as JSON")
    one.add_argument("--report", metavar="FILE.html", help="the same with pictures")
    one = verb("discover", discover, "fit, diagnose and add until nothing more is to be explained")
    one.add_argument("clips", metavar="CLIPS", help="folder with clips.toml")
    one.add_argument("--model", metavar="M.toml", help="model file to start from (default: the base)")
    playing(one)
    one.add_argument("--out", metavar="DIR", required=True, help="where model, result, report and recording go")
    own(one)
    from sysid import cli_measure
    from sysid.vision import cli_calibrate, cli_track

    for name, room, text in (
        ("calibrate", cli_calibrate, "lens and place of the camera, from the table itself or from a board"),
        ("track", cli_track, "from a video to a clip set"),
        ("measure", cli_measure, "friction and restitution by direct methods, without a simulation"),
    ):
        room.add(verb(name, room.run, text))
    one = verb("match", match, "MuJoCo against the analytic models and published measurements, row by row")
    way = one.add_mutually_exclusive_group()
    way.add_argument("--json", metavar="FILE", help="the rows as JSON")
    way.add_argument("--tune", metavar="M.toml", help="instead, fit the native MJCF's terms to the analytic models")
    way.add_argument("--clips", metavar="DIR", help="instead, write shots of the analytic models as clips to fit to")
    one = verb("demo", demo, "the shipped example, start to end")
    one.add_argument("--out", metavar="DIR", default="out/demo", help="where results go (default: out/demo)")
    return top


def run_verb(
    program: str, args: argparse.Namespace, interrupted: str, faults: tuple[type[Exception], ...] = ()
) -> int:  # fmt: skip
    """Run the verb of a command line, its faults one line each; `faults` are those that a user must act on."""
    # Matrices are small here: threads of linear algebra wait for each other longer than they work. NumPy comes later.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    progress = progress_of()
    told: tuple[type[Exception], ...] = (BadInput, *faults)
    try:
        args.own = own_effects(getattr(args, "effects", ()))
        return int(args.run(args, progress))
    except told as error:
        progress.close()
        print(f"{program} {args.verb}: {error}", file=sys.stderr)
        return BAD if isinstance(error, BadInput) else FOUND
    except KeyboardInterrupt:
        progress.close()
        print(f"{program} {args.verb}: interrupted{interrupted}", file=sys.stderr)
        return INTERRUPTED


def main(argv: Sequence[str] | None = None) -> int:
    """Run a verb: 0 done, 1 a finding to act on, 2 bad input."""
    kept = "; files already named above are complete, no other was written"
    return run_verb("sysid", parser().parse_args(argv), kept)


if __name__ == "__main__":
    sys.exit(main())
