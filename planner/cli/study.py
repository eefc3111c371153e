"""`planner study`: statistics over many random scenes."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from models.commands.console import Progress, Status, write_json
from models.commands.options import (
    FILE_PATH,
    Number,
    at_most_one,
    effects_option,
    gathered,
    given,
    input_option,
    json_option,
    output_option,
    scheduler_option,
    seed_option,
)
from models.errors import BadInput
from models.files import alone_in, entries_of
from planner.cli.common import execution_option, load_execution

if TYPE_CHECKING:
    from models.workers import Workers
    from planner.study.draws import Study

MAX_SCENES = 100_000
MAX_JOBS = 1024
CPU_COUNT = os.cpu_count() or 1


@dataclass(frozen=True)
class StudyOptions:
    """Options of a study: model, scenes, methods and processes."""

    model_file: Path | None = given(
        input_option("model", "M.toml", "Model to plan with; by default the base on a full-size table, with priors.")
    )
    scenes: int = given("--scenes", "N", "Number of scenes.", Number(1, MAX_SCENES, whole=True), 200)
    balls: int = given("--balls", "N", "Balls in a scene, 2 to 8.", int, 2)
    execution_file: Path | None = given(execution_option)
    seed: int = given(seed_option())
    method: str = given(
        "--method",
        "",
        "risk: over errors of launcher and model; ga: the published genetic search; both, to compare them.",
        click.Choice(["both", "risk", "ga"]),
        "both",
    )
    jobs: int | None = given(
        "--jobs", "N", "Number of parallel scenes; by default one per core.", Number(1, MAX_JOBS, whole=True)
    )
    scheduler: str | None = given(scheduler_option)

    def study(self) -> Study:
        """The study with these settings."""
        from models.model_file import read_model
        from planner.study.draws import Study, usual_model

        model = read_model(self.model_file) if self.model_file else usual_model()
        return Study(model, load_execution(self.execution_file, model), self.balls, self.seed, self.method)

    def workers(self, folders: Sequence[str], progress: Progress) -> contextlib.AbstractContextManager[Workers | None]:
        """The workers that simulate the scenes; None for one scene at a time in this process."""
        from models.workers import open_workers

        jobs = min(self.jobs or CPU_COUNT, self.scenes)
        if jobs == 1 and self.scheduler is None:
            return contextlib.nullcontext()
        return open_workers(self.scheduler, jobs, folders, progress)


@click.command()
@click.option("--out", metavar="DIR", type=FILE_PATH, required=True, help="Folder of the study, new or to continue.")
@gathered("settings", StudyOptions)
@output_option("report", "FILE.md", "Write the figures as Markdown, with pictures in a PNG next to it.")
@json_option
@click.option(
    "--scene", metavar="N FILE.toml", type=(str, FILE_PATH),
    help="Only write scene N of the folder as a scene file for `planner plan`.",
)  # fmt: skip
@effects_option(exposed=True)
@click.pass_obj
def study(
    progress: Progress, out: Path, settings: StudyOptions, report_file: Path | None, json_file: Path | None,
    scene: tuple[str, Path] | None, effect_folders: tuple[str, ...],
) -> int:  # fmt: skip
    """Study the success of plans over many random scenes.

    Each scene is planned with a model, and evaluated on a hidden table unknown to the planner. Writes a file for each
    scene into DIR; after an interrupt the same command continues there.

    Example: planner study --out out/study --scenes 50 --report study.md
    """
    if scene:
        return _write_scene(out, *scene)
    if report_file and report_file.suffix == ".png":
        raise BadInput(f"{report_file}: is the name of the report's picture; give one that ends in .md")

    from planner.study.figures import figures
    from planner.study.folder import begin, carry_out, describe, read_scenes
    from planner.study.report import text_table, write_report

    at_most_one(jobs=settings.jobs, scheduler=settings.scheduler)
    asked = settings.study()
    click.get_current_context().with_resource(alone_in(out))
    try:
        with settings.workers(effect_folders, progress) as workers:
            begin(out, asked)
            carry_out(out, asked, settings.scenes, workers, progress)
    except KeyboardInterrupt as end:
        count = len(read_scenes(out, settings.scenes))
        end.add_note(f"{count} of {settings.scenes} scenes are kept in {out}; the same command continues from there")
        raise
    progress.close()
    scenes = read_scenes(out, settings.scenes)
    with entries_of(out / "scenes", "remove the scene's file; the same command simulates it again"):
        result = figures(scenes)
    print(text_table(result))
    print(f"scenes: {out}")
    if json_file:
        write_json(json_file, result)
    if report_file:
        write_report(report_file, scenes, describe(asked), out)
        print(f"report: {report_file}")
    return Status.DONE


def _write_scene(out: Path, number: str, path: Path) -> int:
    """Write one scene as a scene file."""
    from planner.scene import read_scene, scene_dict, scene_from, write_scene
    from planner.study.folder import read_object, scene_path

    result = read_object(scene_path(out, int(number))) if number.isdigit() else None
    if result is None or "scene" not in result:
        raise BadInput(f"--scene {number}: is not in {out}; give a number from its report")
    source = scene_path(out, int(number))
    with entries_of(source, "remove it; the study's command simulates it again"):
        asked = scene_from(result["scene"], str(source))
        stroke = result["methods"].get("risk", {}).get("stroke")
    same = not path.exists()
    with contextlib.suppress(BadInput):
        same = same or scene_dict(read_scene(path)) == scene_dict(asked)
    if not same:
        raise BadInput(f"{path}: already exists and holds something else; name another file")
    write_scene(asked, path)
    print(f"scene: {path}" + ("" if stroke else " (no stroke was found for it)"))
    return Status.DONE
