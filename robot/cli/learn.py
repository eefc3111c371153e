"""`robot learn`: the closed loop, at a table or on the emulator, where it is compared with the truth.

The emulator's hidden constants are drawn from the seed and stay in this process: DIR/emulated.json holds only a
fingerprint, so that a series continues with the same table and launcher or not at all; DIR/hidden.toml and
DIR/hidden_cue.json are written when the series has ended. Report and recording are always made from the folder alone.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from models.commands.console import Progress, Status, write_json
from models.commands.options import (
    FILE_PATH,
    NON_NEGATIVE,
    Number,
    at_most_one,
    effects_option,
    gathered,
    given,
    input_option,
    json_option,
)
from models.errors import BadInput
from models.files import alone_in
from models.messages import counted
from robot.cli.common import Filming, Wire, confirmed, set_up, yes_option
from sysid.cli.viewing import Live

if TYPE_CHECKING:
    from models.recording.viewer import Feed
    from models.shot import Ball, Table
    from robot.camera.live import LiveCamera
    from robot.learning.emulated_rig import EmulatedRig
    from robot.learning.history import History
    from robot.learning.live_rig import LiveRig
    from robot.learning.loop import LearningConfig

CUE_FORMAT, EMULATED_FORMAT = "billiard-hidden-cue/1", "billiard-emulated/1"
OTHER_CONSTANTS = "an emulated table or launcher with other constants"
HIDDEN_STREAM = 7  # stream of random numbers, separate from that of the scenes


@dataclass(frozen=True)
class Series:
    """Options of a series of shots: its start and its length."""

    out: Path = given("--out", "DIR", "Folder of the series; an existing one is continued.", FILE_PATH, required=True)
    model_file: Path | None = given(input_option("model", "START.toml", "Start model; by default the base."))
    map_file: Path | None = given(input_option("map", "MAP.toml", "Start cueing map; by default the usual constants."))
    shots: int = given("--shots", "N", "Largest number of shots.", int, 60)
    every: int = given("--every", "N", "Shots between refits.", int, 10)
    chosen: int = given(
        "--chosen", "N", "Largest number of shots after each refit that are chosen to separate models.", int, 3
    )
    balls: int = given("--balls", "N", "Balls in each scene, 2 to 8.", int, 2)
    seed: int = given("--seed", "N", "Seed of the random numbers.", NON_NEGATIVE, 0)
    all_shots: bool = given("--all", "", "Play all shots, even without further improvement.", bool, False)

    def course(self, table: Table, ball: Ball) -> LearningConfig:
        """The configuration of the loop; without a model file it starts from the base on this table."""
        from models.model_file import full_model, read_model
        from planner.launcher.cueing_map import read_map
        from planner.launcher.mapped import usual_map, with_map
        from planner.launcher.stroke import LauncherModel
        from robot.emulator.table import BASE_EFFECTS
        from robot.learning.loop import LearningConfig

        model = read_model(self.model_file) if self.model_file else full_model(table, ball)
        if lacking := sorted(set(BASE_EFFECTS) - {e.name() for e in model.stack()}):
            raise BadInput(f"{self.model_file}: lacks {', '.join(lacking)}; give a model based on the base")
        cueing_map = read_map(self.map_file) if self.map_file else usual_map(model.ball)
        with_map(LauncherModel(), cueing_map, model.ball)  # raises BadInput for other balls, before anything is played
        course = LearningConfig(
            model, cueing_map, self.shots, self.every, self.seed, self.balls, self.chosen, stops=not self.all_shots
        )
        _ = course.study  # raises BadInput for wrong balls or table
        return course


@dataclass(frozen=True)
class Truth:
    """Options of the true emulated table and launcher."""

    hidden: Path | None = given(
        "--hidden", "TABLE.toml", "Model of the emulated table; by default drawn from the seed.", FILE_PATH
    )
    effect: str | None = given("--effect", "NAME", "Effect of the drawn table; by default drawn as well.")
    repeats: int = given(
        "--repeats", "N", "Repeats of every stroke, for the scatter of the launcher alone.", Number(0, whole=True), 20
    )

    def refuse(self) -> None:
        """Raise BadInput if a real table is used."""
        for name, value in (("hidden", self.hidden), ("effect", self.effect)):
            if value:
                raise BadInput(f"--{name} applies to the emulated table; omit it, or omit --port")

    def stand(self, course: LearningConfig) -> EmulatedRig:
        """The emulated rig with its hidden constants."""
        import numpy as np

        from models.model_file import read_model
        from robot.device.settings import Settings
        from robot.emulator.table import EmulatedTable
        from robot.learning.emulated_rig import EmulatedRig, draw_hidden_cue, draw_hidden_table

        start = course.model
        rng = np.random.default_rng([course.seed, HIDDEN_STREAM])
        cue = draw_hidden_cue(rng)
        if self.hidden:
            hidden = read_model(self.hidden)
            if (hidden.table, hidden.ball) != (start.table, start.ball):
                raise BadInput(f"{self.hidden}: its table or ball differs from the first model's; name another")
        else:
            hidden = draw_hidden_table(start, rng, self.effect)
        played = EmulatedTable(hidden, {"white": (0.0, 0.0)}, 0.0).model  # BadInput for a model without the base
        if self.effect and self.effect not in {e.name() for e in played.effects}:
            raise BadInput(
                f"--effect {self.effect}: changes no shot on the emulated table; choose one that affects motion"
            )
        settings = Settings()
        stage = dataclasses.replace(settings.stage, ball_radius_mm=1e3 * start.ball.radius)
        return EmulatedRig(hidden, cue, dataclasses.replace(settings, stage=stage), course.seed, self.repeats)


@click.command()
@gathered("series", Series)
@gathered("wire", Wire)
@gathered("filming", Filming)
@gathered("truth", Truth)
@gathered("live", Live)
@yes_option
@json_option
@effects_option()
@click.pass_obj
def learn(
    progress: Progress, series: Series, wire: Wire, filming: Filming, truth: Truth, live: Live, yes: bool,
    json_file: Path | None,
) -> int:  # fmt: skip
    """Learn from shots: plan, play, film, refit table and launcher.

    Writes every shot and refit into DIR, with a report and a recording; after an interrupt the same command continues
    there. Without --port it plays on the emulated launcher and table, and prints the true constants at the end. With
    --live each shot is shown as planned and as played.

    Example: robot learn --out out/series --shots 40
    """
    from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE
    from robot.learning.loop import begin
    from robot.learning.loop import learn as play_series
    from robot.learning.summary import figures, text_of

    at_most_one(hidden=truth.hidden, effect=truth.effect)
    folder = series.out
    click.get_current_context().with_resource(alone_in(folder))
    feed = click.get_current_context().with_resource(live.feed())

    def say(line: str) -> None:
        progress.close()
        print(line, flush=True)

    try:
        emulated = None
        if wire.port:
            truth.refuse()
            filming.require("a series")
            with filming.open(folder / "films") as camera:
                course = series.course(camera.table, camera.ball)
                wire.print_needs(
                    filming.need,
                    "a person who places the balls of each shot as requested, and turns the stand",
                    yes=yes,
                )
                story = play_series(folder, course, _at_the_table(wire, camera, yes, say), say, progress,
                                    _watch(folder, course, feed))  # fmt: skip
        else:
            filming.refuse()
            course = series.course(SNOOKER_TABLE, SNOOKER_BALL)
            emulated = truth.stand(course)
            begin(folder, course)
            _check_hidden(folder, emulated)
            say("no --port: using the emulated launcher and table")
            story = play_series(folder, course, emulated, say, progress, _watch(folder, course, feed))
            _reveal(folder, emulated)
        result = figures(story, course, emulated)
        say(f"\n{text_of(result)}")
        if json_file:
            write_json(json_file, result)
        _draw(folder, story, progress)
        hidden = ", hidden.toml, hidden_cue.json" if emulated else ""
        say(f"\nseries: {folder} (report.html, story.png, story.rrd{hidden})")
    except KeyboardInterrupt as end:
        end.add_note(f"{folder} is kept: the same command continues from there")
        raise
    return Status.DONE


def _watch(folder: Path, course: LearningConfig, feed: Feed | None) -> Callable[[int], None]:
    """The live viewer of the series, or None."""
    if feed is None:
        return lambda number: None
    from robot.learning.loop import begin
    from robot.learning.watch import SeriesWatch

    begin(folder, course)
    return SeriesWatch(folder, feed, course.model.table, course.model.ball)


def _at_the_table(wire: Wire, camera: LiveCamera, yes: bool, say: Callable[[str], None]) -> LiveRig:
    """The rig at a port, with a person at the terminal."""
    from robot.learning.live_rig import LiveRig

    settings = wire.settings()

    def confirm(action: str) -> bool:
        return yes or confirmed(action, "the stand is aligned")

    return LiveRig(camera, settings, lambda: wire.launcher(settings), confirm, set_up, say)


def _check_hidden(folder: Path, stand: EmulatedRig) -> None:
    """Write a fingerprint of the hidden constants; BadInput if the series was started with others."""
    hidden = repr((sorted(stand.model.parameters().items()), sorted(dataclasses.asdict(stand.cue).items())))
    now = {"format": EMULATED_FORMAT, "hidden": hashlib.sha256(hidden.encode()).hexdigest(), "repeats": stand.repeats}
    path = folder / "emulated.json"
    if not path.is_file():
        write_json(path, now)
        return
    from robot.learning.history import read_json

    then = read_json(path, EMULATED_FORMAT)
    for key, word in (("hidden", OTHER_CONSTANTS), ("repeats", "another number of repetitions")):
        if then.get(key) != now[key]:
            raise BadInput(f"{folder}: its series was begun with {word}; use the same, or name another folder")
    for name in ("hidden.toml", "hidden_cue.json"):  # they exist once the series has ended
        (folder / name).unlink(missing_ok=True)


def _reveal(folder: Path, stand: EmulatedRig) -> None:
    """Write the hidden constants."""
    from models.model_file import write_model

    write_model(stand.model, folder / "hidden.toml")
    write_json(folder / "hidden_cue.json", {"format": CUE_FORMAT, "constants": dataclasses.asdict(stand.cue)})


def _draw(folder: Path, story: History, progress: Progress) -> None:
    """Write the report and the recording."""
    from robot.learning.report import write_picture, write_recording, write_report
    from sysid.clips import read_clip_set
    from sysid.report.recording import found_films

    progress("report and recording")
    write_report(folder / "report.html", story, f"The closed loop: {counted(len(story.shots), 'shot')}")
    write_picture(folder / "story.png", story)
    filmed = (folder / "clips" / "clips.toml").is_file()
    write_recording(folder / "story.rrd", story, films=found_films(read_clip_set(folder / "clips")) if filmed else ())
