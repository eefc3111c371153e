"""What the verbs of the `sysid` command share: the clip set and model they begin with, options, reports."""

from __future__ import annotations

import contextlib
import dataclasses
import shlex
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from models.commands.console import as_called
from models.commands.options import ABOVE_ZERO, FILE_PATH, given, input_option, json_option, output_option
from models.errors import BadInput
from models.messages import counted

if TYPE_CHECKING:
    from models.model_file import Model
    from sysid.clips import ClipSet
    from sysid.residuals.comparison import Comparison


clips_argument = click.argument("clips", metavar="CLIPS", type=FILE_PATH)
model_option = input_option("model", "M.toml", "Model file to start from; by default the base model.")
models_option = click.option(
    "--model", "model_files", metavar="M.toml", type=FILE_PATH, multiple=True,
    help="Model file to start from; by default the base model.",
)  # fmt: skip
report_option = output_option("report", "FILE.html", "Write the figures with pictures.")
rrd_option = output_option("rrd", "FILE.rrd", "Write measured and modelled shots for Rerun.")

palette_option = input_option(
    "palette", "P.toml", "Names and colours of the balls; by default those of pool or snooker, by their diameter."
)
mass_option = click.option(
    "--mass", metavar="M", type=ABOVE_ZERO, help="Mass of a ball [kg]; by default that of the game's nearest in size."
)


def camera_option(*, required: bool = False) -> Any:
    """The option that names the camera's file."""
    return input_option("camera", "CAM.toml", "Camera file, made with: sysid calibrate.", required=required)


accept_camera_option = click.option(
    "--accept-camera", is_flag=True, help="Continue although the camera's calibration is doubtful."
)


@dataclasses.dataclass(frozen=True)
class Start:
    """The inputs of a verb: clips, a model, and the engine that simulates the shots."""

    clips: Path = given(clips_argument)
    model_files: tuple[Path, ...] = given(models_option, default=())
    engine: str = given(
        "--engine", "", "Engine that simulates the shots: the event engine, or MuJoCo for an independent check.",
        click.Choice(["events", "mujoco"]), "events",
    )  # fmt: skip

    def load(self) -> tuple[ClipSet, Model]:
        """The clip set and the model: the one named, or else the base (decoupled cloth, frictional impacts)."""
        if len(self.model_files) > 1:
            raise BadInput(f"--model is given {len(self.model_files)} times; only sysid compare takes several")
        clip_set, models = self.load_several()
        return clip_set, models[0]

    def load_several(self) -> tuple[ClipSet, list[Model]]:
        """The clip set and the models named, or else the base model alone."""
        from models.model_file import full_model
        from sysid.clips import inspect_clip_set
        from sysid.clips.choose import with_shots
        from sysid.clips.jaws import before_jaws, jaws_line
        from sysid.clips.running import running_line
        from sysid.prepare import prepare

        inspection = inspect_clip_set(self.clips)
        clip_set = with_shots(inspection.sound(), self.clips)
        for warning in inspection.warnings:
            print(f"warning: {warning}", file=sys.stderr, flush=True)
        if running := running_line(clip_set.clips):
            print(f"note: {running}")
        whole, clip_set = clip_set, before_jaws(clip_set)
        if line := jaws_line(whole, clip_set):
            print(f"note: {line}")
        prepare()
        if not self.model_files:
            return clip_set, [dataclasses.replace(full_model(clip_set.table, clip_set.ball), engine=self.engine)]
        return clip_set, [self._model(file, clip_set) for file in self.model_files]

    def _model(self, file: Path, clip_set: ClipSet) -> Model:
        """Read a model file; BadInput if its table or ball differ from those of the clip set."""
        from models.model_file import read_model

        model = dataclasses.replace(read_model(file), engine=self.engine)
        if (model.table, model.ball) != (clip_set.table, clip_set.ball):
            raise BadInput(f"{file}: its table and ball are not those of {self.clips}; fit a model to these clips")
        return model


@dataclasses.dataclass(frozen=True)
class Outputs:
    """Files that a verb writes on request, in addition to what it prints."""

    json_file: Path | None = given(json_option)
    report_file: Path | None = given(report_option)
    rrd_file: Path | None = given(rrd_option)

    def write(self, comparisons: Sequence[tuple[str, Comparison]], notes: Sequence[str]) -> None:
        """Write the report and the recording of comparisons; the verb supplies the figures."""
        last = comparisons[-1][1]
        if self.report_file:
            from sysid.report.html import write_report

            title = f"Model against {counted(len(last.clips), 'clip')}"
            write_report(self.report_file, title, comparisons, notes=notes)
            print(f"report: {self.report_file}")
        if self.rrd_file:
            from sysid.report.recording import write_rrd

            filmed = write_rrd(self.rrd_file, comparisons)
            print(f"film: {filmed}\n" * bool(filmed), end="")
            print_recording(self.rrd_file)


@contextlib.contextmanager
def spread_over_cluster(scheduler: str | None, folders: Sequence[str]) -> Iterator[None]:
    """Within this context a cluster's workers compute the fits; without a scheduler this process does."""
    if scheduler is None:
        yield
        return
    from models.workers import open_workers
    from sysid.estimation.solver.spread import spread_over

    with open_workers(scheduler, 0, folders) as workers, spread_over(workers):
        yield


def print_recording(path: Path) -> None:
    """Print where a recording is, and the command that opens it."""
    print(f"recording: {path} (open it with: {as_called(f'sysid review {shlex.quote(str(path))}')})")
