"""The closed loop: plan a shot, play it, film it, compare; refit every few shots and plan with the new model.

In: a start model and cueing map, which may be wrong (`LearningConfig`), and a rig (`Rig`). Out: the files of the series
in its folder (robot/learning/history.py) and its `History`. Scenes are drawn from the seed; the balls are set up, the
camera measures their actual positions, and the plan is made for these. Every `every` shots sysid/selection/discover.py
fits all films from the start model on, names missing effects and fits all constants; the cueing map is fitted to the
filmed strokes and their commands. The series ends after `shots`, or earlier without improvement: if the effects stay
the same, and the cue ball's miss has fallen to the plans' prediction, or has not fallen in two refits.

Every result is written to a file immediately; there is no other state. An interrupted series continues with the first
missing shot or refit, with the same result on the emulator. After a refit, the most informative shots come first
(robot/learning/chosen.py); the others are typical shots of play.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from models.commands.console import write_json
from models.errors import BadInput
from models.files import made_folder, write_whole
from models.messages import counted
from models.model_file import Model, read_model, write_model
from models.shot import Array
from planner.evaluation.value import UtilityWeights
from planner.launcher.cueing_map import CueingMap, read_map, write_map
from planner.launcher.mapped import execution_of, with_map
from planner.launcher.stroke import LauncherModel as Strokes
from planner.planning import GIVEN, make_plan, plan_of
from planner.scene import Scene
from planner.search.search import Effort
from planner.study.draws import BALL_NAMES, Study, draw_scene
from robot.device.launcher import Launcher
from robot.learning.chosen import chosen_shot
from robot.learning.ending import why_ended
from robot.learning.history import (
    FIT_FORMAT,
    SERIES_FORMAT,
    History,
    count_played,
    fit_folder,
    plan_file,
    predicted_stop,
    read_history,
    read_json,
)
from robot.learning.refit import relearn
from robot.play import PLAYED_FORMAT, ShotCamera, play_plan, played_file
from sysid.clips import ClipSet, read_clip_set
from sysid.estimation.fitted import MISS_OVER_AXIS

MAX_SCENE_DRAWS = 5  # most scenes drawn for a shot until one can be played
SETTING_DIFFERENCES = {  # what a series was begun with, by the keys of its settings
    "every": "another number of shots between refits", "seed": "another seed", "balls": "another number of balls",
    "chosen": "another number of chosen shots", "wish": "other weights of the outcomes",
    "effort": "another search effort", "model": "another start model", "map": "another cueing map",
}  # fmt: skip
Report = Callable[[str], None]


@dataclass(frozen=True)
class SceneSetup:
    """A scene that was set up, with the launcher behind the cue ball."""

    camera: ShotCamera
    launcher: Launcher  # not yet connected
    turn: Callable[[float], None]  # turns the stand to an azimuth [rad], and returns when it is done
    confirm: Callable[[str], bool] | None = None  # question before the stroke


class Rig(Protocol):
    """The interface of a rig: a table with a launcher and an operator, or the emulator."""

    def set_up(self, scene: Scene, number: int) -> SceneSetup:
        """Set up the balls of a shot, with the errors of placing by hand."""
        ...

    def repeat(self, plan: Path, number: int) -> Array | None:
        """Repeat the stroke from the same place; returns the cue ball's end points (n, 2) [m], None without repeats."""
        ...


@dataclass(frozen=True)
class LearningConfig:
    """Settings of a series."""

    model: Model  # at the start
    cueing_map: CueingMap  # at the start; its [execution] is the launcher's repeatability
    shots: int = 60
    every: int = 10  # shots between refits
    seed: int = 0
    balls: int = 2  # in a scene
    chosen: int = 3  # largest number of shots after a refit that are chosen to separate models
    stops: bool = True  # whether it ends early without improvement
    weights: UtilityWeights = field(default_factory=UtilityWeights)
    effort: Effort = field(default_factory=Effort)

    def __post_init__(self) -> None:
        """Raise BadInput for values out of range."""
        if not 1 <= self.shots <= 9999 or not 4 <= self.every <= 1000:
            raise BadInput(f"{self.shots} shots, a refit every {self.every}; give 1 to 9999, and 4 to 1000")
        if not 0 <= self.chosen < self.every:
            raise BadInput(f"{self.chosen} chosen shots of {self.every} between refits; give 0 to {self.every - 1}")

    @property
    def study(self) -> Study:
        """The study from which scenes are drawn."""
        return Study(self.model, self.cueing_map.execution, self.balls, self.seed)

    def to_dict(self) -> dict[str, Any]:
        """The settings that must not change during a series, that is, all but those of its end."""
        rest = {"every": self.every, "seed": self.seed, "balls": self.balls, "chosen": self.chosen}
        return {"format": SERIES_FORMAT, **rest, "wish": asdict(self.weights), "effort": asdict(self.effort)}


def begin(folder: Path | str, config: LearningConfig) -> None:
    """Make the folder of a series, or check that it holds this one; BadInput if it holds another."""
    folder, fixed = Path(folder), config.to_dict()
    model, cueing_map = folder / "start.toml", folder / "start_map.toml"
    if (folder / "course.json").is_file():
        known = {"chosen": 0} | read_json(folder / "course.json", SERIES_FORMAT)  # missing in older series
        other = [name for name, value in fixed.items() if known.get(name) != value]
        if not other and read_model(model).parameters() != config.model.parameters():
            other = ["model"]
        if not other and read_map(cueing_map).constants != config.cueing_map.constants:
            other = ["map"]
        if other:
            differs = SETTING_DIFFERENCES.get(other[0], f"another {other[0]}")
            raise BadInput(f"{folder}: its series was begun with {differs}; use the same, or name another folder")
        return
    begun = {model.name, cueing_map.name, "shots"}  # files of an interrupted start
    if folder.exists() and (not folder.is_dir() or {path.name for path in folder.iterdir()} - begun):
        raise BadInput(f"{folder}: exists but holds no series; name another folder")
    made_folder(folder / "shots")
    write_model(config.model, model)
    write_map(cueing_map, config.cueing_map)
    write_json(str(folder / "course.json"), fixed)


def learn(
    folder: Path | str, config: LearningConfig, rig: Rig, say: Callable[[str], None] = print,
    report: Report = lambda line: None, watch: Callable[[int], None] = lambda number: None,
) -> History:  # fmt: skip
    """Play a series, or continue it.

    Args:
        folder: of the series.
        config: its settings.
        rig: the rig that plays it.
        say: called with the result of every shot and refit.
        report: called with a description of the current step.
        watch: called with a shot's number when it is planned, when it is played, and after a refit.

    Raises:
        BadInput: for a folder of another series, a scene that was not set up, a stroke that was not confirmed.
        LauncherError: as in play_plan; all shots played so far are kept.
    """
    folder = Path(folder)
    begin(folder, config)
    while True:
        played = count_played(folder)
        if played and not plan_file(folder, played).with_suffix(".repeats.json").is_file():  # interrupted before
            _repeat(plan_file(folder, played), rig, played)
        learnt = played - played % config.every
        if learnt and not (fit_folder(folder, learnt) / "fit.json").is_file():
            say(_refit(folder, config, learnt, report))
            watch(learnt)
        reason = why_ended(read_history(folder), config.every) if config.stops and played == learnt > 0 else ""
        if reason or played >= config.shots:
            write_whole(folder / "ended.txt", f"{reason or f'all {played} shots are played'}\n".encode())
            return read_history(folder)
        (folder / "ended.txt").unlink(missing_ok=True)
        say(_play(folder, config, rig, played + 1, learnt, report, watch))
        watch(played + 1)


def latest(folder: Path, config: LearningConfig, learnt: int) -> tuple[Model, CueingMap]:
    """Model and map learnt from a number of shots; for 0 those of the start."""
    if not learnt:
        return config.model, config.cueing_map
    return read_model(fit_folder(folder, learnt) / "model.toml"), read_map(fit_folder(folder, learnt) / "map.toml")


def _play(
    folder: Path, config: LearningConfig, rig: Rig, number: int, learnt: int, report: Report,
    watch: Callable[[int], None],
) -> str:  # fmt: skip
    """Plan and play one shot; returns its result in words."""
    report(f"shot {number}: the scene")
    setup, plan = _planned(folder, config, rig, number, learnt)
    path = plan_file(folder, number)
    write_json(str(path), plan | {"learnt": learnt})
    watch(number)
    setup.turn(math.radians(plan["launcher"]["theta_deg"]))
    with setup.launcher as launcher:
        played = play_plan(path, launcher, setup.camera, setup.confirm, clips=folder / "clips", say=report)
    if not played_file(path).is_file():
        raise BadInput(f"shot {number} was played, and {played.noted[-1]}")
    _repeat(path, rig, number)
    pot = {True: "potted", False: "not potted", None: "not seen"}[played.potted]
    miss, target = "not on the table", predicted_stop(plan)[0]
    if played.cue_end is not None:
        miss = f"{1e3 * float(np.hypot(*(target - played.cue_end))):.0f} mm from its planned place"
        if not np.isfinite(target).all():
            miss = "stayed on the table, though planned to fall"
    if plan["method"] == GIVEN:
        return f"shot {number:3d}: played {plan['why']}; the cue ball {miss}"
    return f"shot {number:3d}: {pot} ({100 * plan['pot_probability']['value']:.0f} % predicted), the cue ball {miss}"


def _planned(
    folder: Path, config: LearningConfig, rig: Rig, number: int, learnt: int
) -> tuple[SceneSetup, dict[str, Any]]:
    """Set up a shot and plan it: a chosen one, or one of a drawn scene."""
    model, cueing_map = latest(folder, config, learnt)
    seed, turn = config.study.number(number, 2), number - learnt - 1
    strokes, execution = with_map(Strokes(), cueing_map, model.ball), execution_of(cueing_map)
    one = chosen_shot(folder, learnt, turn, config.chosen, model, strokes, BALL_NAMES)
    if one is not None:
        setup, scene = _set_up(rig, one.scene, number)
        return setup, plan_of(scene, model, one.stroke, one.why, execution, strokes, seed=seed, effort=config.effort)
    for draw in range(MAX_SCENE_DRAWS):
        setup, scene = _set_up(rig, draw_scene(config.study, number + 10_000 * draw)[0], number)
        plan = make_plan(scene, model, execution, config.weights, seed=seed, launcher=strokes, effort=config.effort)
        if plan["stroke"] is not None:
            return setup, plan
    raise BadInput(f"shot {number}: none of {MAX_SCENE_DRAWS} scenes can be played; check model and launcher")


def _set_up(rig: Rig, asked: Scene, number: int) -> tuple[SceneSetup, Scene]:
    """Set up a scene; returns it with the positions measured by the camera."""
    setup = rig.set_up(asked, number)
    seen = setup.camera.look()
    if lacking := [name for name in asked.names if name not in seen]:
        raise BadInput(f"shot {number}: ball {lacking[0]} is not seen; put it in place and run the same command again")
    return setup, dataclasses.replace(asked, position=np.array([seen[name] for name in asked.names]))


def _repeat(plan: Path, rig: Rig, number: int) -> None:
    """Repeat the stroke and write the cue ball's end points next to the plan; without repeats there is no file."""
    ends = rig.repeat(plan, number)
    if ends is not None:
        record = {"format": "billiard-repeats/1", "plan": plan.name, "cue": np.round(ends, 5).tolist()}
        write_json(str(plan.with_suffix(".repeats.json")), record)


def _refit(folder: Path, config: LearningConfig, learnt: int, report: Report) -> str:
    """Fit table and launcher to the shots so far and write the result; returns it in words."""
    began = time.monotonic()
    out = fit_folder(folder, learnt)
    made_folder(out)
    clip_set, played = films(folder, learnt)
    report(counted(len(clip_set.clips), "clip"))
    known, _ = latest(folder, config, learnt - config.every)
    found = relearn(clip_set, played, config.model, config.cueing_map, known)
    result = found.result
    write_model(found.model, out / "model.toml")
    write_map(out / "map.toml", found.cueing_map)
    write_json(str(out / "result.json"), result)
    last, unexplained = result["ladder"][-1], result["unexplained"]
    record = {
        "format": FIT_FORMAT, "shots": learnt, "verdict": result["verdict"],
        "unexplained": unexplained["where"] if unexplained else "", "rms_m": last["rms_m"],
        "held_out_rms_m": last["held_out_rms_m"], "chi2_reduced": last["chi2_reduced"],
        "parameters": {n: {"value": p["value"], "sd": p["sd"]} for n, p in result["parameters"].items()},
        "launcher": found.launcher(), "elapsed_s": time.monotonic() - began,
    }  # fmt: skip
    write_json(str(out / "fit.json"), record)  # the last file: it marks the refit as complete
    names, miss = ", ".join(result["verdict"]) or "no effect beyond the base", MISS_OVER_AXIS * last["rms_m"]
    return f"learnt from {learnt} shots: {names}; rms distance of model and shots {1e3 * miss:.2f} mm"


def films(folder: Path, learnt: int) -> tuple[ClipSet, list[dict[str, Any]]]:
    """The films of the first `learnt` shots with their played records, without shots that have no film."""
    clip_set = read_clip_set(folder / "clips")
    by_file = {clip.file: clip for clip in clip_set.clips}
    records = [read_json(played_file(plan_file(folder, k)), PLAYED_FORMAT) for k in range(1, learnt + 1)]
    filmed = [r for r in records if r["struck"] == "yes" and r["clip"] and r["clip"]["file"] in by_file]
    clips = [by_file[r["clip"]["file"]] for r in filmed]
    last = max(len(clips) - 1, 1)
    sessions = [dataclasses.replace(clip.session, order=k / last) for k, clip in enumerate(clips)]
    ordered = [dataclasses.replace(clip, session=one) for clip, one in zip(clips, sessions, strict=True)]
    return dataclasses.replace(clip_set, clips=tuple(ordered)), filmed
