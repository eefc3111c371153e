"""What the verbs of the `sysid` command share: the clip set and model they begin with, options, reports."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from models.command_line import ABOVE_ZERO, FILE_PATH, given, input_option, json_option, output_option
from models.console import as_called
from models.errors import BadInput

if TYPE_CHECKING:
    from models.model_file import Model
    from sysid.clips import ClipSet
    from sysid.residuals.comparison import Comparison


clips_argument = click.argument("clips", metavar="CLIPS", type=FILE_PATH)
model_option = input_option("model", "M.toml", "Model file to start from; by default the base model.")
report_option = output_option("report", "FILE.html", "Write the figures with pictures.")
rrd_option = output_option("rrd", "FILE.rrd", "Write measured and modelled shots for Rerun.")

palette_option = input_option("palette", "P.toml", "Names and colours of the balls; by default those of snooker.")
mass_option = click.option(
    "--mass", metavar="M", type=ABOVE_ZERO, help="Mass of a ball [kg]; by default a snooker ball's of this size."
)


def camera_option(*, required: bool = False) -> Any:
    """The camera's file."""
    return input_option("camera", "CAM.toml", "Camera file, made with: sysid calibrate.", required=required)


@dataclasses.dataclass(frozen=True)
class Start:
    """What a verb begins with: clips, a model, how far to look at each shot, and what simulates it."""

    clips: Path = given(clips_argument)
    model_file: Path | None = given(model_option)
    jaws: bool = given(
        "--jaws", "", "The table's pockets have jaws: use every shot only until a ball touches one.", bool, False
    )
    engine: str = given(
        "--engine", "", "What simulates the shots: the compiled event engine, or MuJoCo, which checks results anyway.",
        click.Choice(["events", "mujoco"]), "events",
    )  # fmt: skip

    def load(self) -> tuple[ClipSet, Model]:
        """The clip set, and the model named or the base: decoupled cloth with frictional impacts."""
        from models.model_file import full_model, read_model
        from sysid.clips import inspect_clip_set
        from sysid.prepare import prepare

        inspection = inspect_clip_set(self.clips)
        clip_set = inspection.sound()
        for warning in inspection.warnings:
            print(f"warning: {warning}", file=sys.stderr, flush=True)
        if self.jaws:
            from sysid.clips.jaws import before_jaws

            clip_set = before_jaws(clip_set)
        prepare()
        if self.model_file is None:
            return clip_set, dataclasses.replace(full_model(clip_set.table, clip_set.ball), engine=self.engine)
        model = dataclasses.replace(read_model(self.model_file), engine=self.engine)
        if (model.table, model.ball) != (clip_set.table, clip_set.ball):
            raise BadInput(
                f"{self.model_file}: its table and ball are not those of {self.clips}; fit a model to this clip set"
            )
        return clip_set, model


@dataclasses.dataclass(frozen=True)
class Outputs:
    """Files that a verb writes where asked, beside what it prints."""

    json_file: Path | None = given(json_option)
    report_file: Path | None = given(report_option)
    rrd_file: Path | None = given(rrd_option)

    def write(self, comparisons: Sequence[tuple[str, Comparison]], notes: Sequence[str]) -> None:
        """The report and the recording of comparisons; the figures are the verb's."""
        last = comparisons[-1][1]
        if self.report_file:
            from sysid.report.html import write_report

            title = f"Model against {len(last.clips)} clips"
            write_report(self.report_file, title, comparisons, notes=notes)
            print(f"report: {self.report_file}")
        if self.rrd_file:
            from sysid.report.recording import write_rrd

            write_rrd(self.rrd_file, last)
            print_recording(self.rrd_file)


def print_recording(path: Path) -> None:
    """Say where a recording is, and how to open it."""
    print(f"recording: {path} (open it with: {as_called(f'rerun {path}')})")
