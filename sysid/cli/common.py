"""What the verbs of the `sysid` command share: clip set and model, options that mean the same in all, their outputs."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

from models.errors import BadInput

if TYPE_CHECKING:
    from models.model_file import Model
    from sysid.clips import ClipSet
    from sysid.residuals.comparison import Comparison


def with_clips(one: argparse.ArgumentParser) -> None:
    """The clip set of a verb."""
    one.add_argument("clips", metavar="CLIPS", help="folder with clips.toml")


def with_engine(one: argparse.ArgumentParser) -> None:
    """Options of a verb that plays shots."""
    text = "the table's pockets have jaws: look at every shot up to where a ball touches one"
    one.add_argument("--jaws", action="store_true", help=text)
    text = "what plays the shots: the compiled event engine (default), or MuJoCo, in which the result is checked anyway"
    one.add_argument("--engine", choices=("events", "mujoco"), default="events", help=text)


def with_effects(one: argparse.ArgumentParser) -> None:
    """The option of a verb that knows effects."""
    text = "folder, or file, with effects of your own (may be given again)"
    one.add_argument("--effects", metavar="DIR", action="append", default=[], help=text)


def with_drawings(one: argparse.ArgumentParser) -> None:
    """Where a verb's figures go beside the terminal."""
    one.add_argument("--json", metavar="FILE", help="the same figures as JSON")
    one.add_argument("--report", metavar="FILE.html", help="the same with pictures")
    one.add_argument("--rrd", metavar="FILE.rrd", help="measured and modelled shots for Rerun")


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
        from sysid.report.html import write_report

        write_report(args.report, f"Model against {len(last.clips)} clips", comparisons, notes=notes, model=last.model)
        print(f"report: {args.report}")
    if args.rrd:
        from sysid.report.recording import write_rrd

        write_rrd(args.rrd, last)
        print(f"recording: {args.rrd} (open it with: rerun {args.rrd})")
