"""The closed loop: plan, play, film, compare; every few shots refit; plan on with what was learnt.

A series begins with a model and a cueing map that may be wrong. Scenes are drawn from its seed; whoever stands at the
table lays the balls, the camera says where they really lie, and the plan is made for that. Every so many shots
sysid/selection/discover.py looks at all films from the start model on, names the effects that they ask for and fits all
constants; strokes as filmed, beside what was told, fit the cueing map. It ends after `shots`, or by itself where
nothing improves: the effects stay the same, and the cue ball's miss is down to what the plans foresee, or has not
fallen in two refits.

Everything is in files as soon as it is known (robot/learning/history.py); nothing else is remembered. A series that was
broken off goes on with the first shot or refit that is not there; at the emulator it comes to the same. Leaves out
scenes that were chosen to learn from: shots are those that one would play.
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

from models.console import write_json
from models.errors import BadInput
from models.files import write_whole
from models.model_file import Model, read_model, write_model
from models.shot import Array
from planner.evaluation.value import UtilityWeights
from planner.launcher.cueing_map import CueingMap, read_map, write_map
from planner.launcher.mapped import execution_of, with_map
from planner.launcher.stroke import LauncherModel as Strokes
from planner.plan import make_plan
from planner.scene import Scene
from planner.search.search import Effort
from planner.study.draws import Study, draw_scene
from robot.device.launcher import Launcher
from robot.learning.history import (
    FIT_FORMAT,
    FORMAT,
    Story,
    count_played,
    fit_folder,
    middle_of,
    plan_file,
    read_json,
    read_story,
)
from robot.learning.refit import relearn
from robot.play import Camera, play_plan, played_file
from sysid.clips import ClipSet, read_clip_set

OTHERS = 5  # scenes that are drawn for a shot before none is found that can be played
NEAR = 1.3  # times what the plans foresee: a miss that no model makes much smaller
FALLS = 0.9  # of the block before: a miss that fell
BLOCKS = 3  # that it takes to say that nothing improves
Report = Callable[[str], None]


@dataclass(frozen=True)
class Laid:
    """A scene laid out, and the launcher behind it."""

    camera: Camera
    launcher: Launcher  # not yet connected
    turn: Callable[[float], None]  # the stand, to an azimuth [rad]; returns when it is done
    confirm: Callable[[str], bool] | None = None  # asked before the stroke


class Stand(Protocol):
    """Where a series is played: a table with a launcher and somebody who lays balls, or the emulator."""

    def lay(self, scene: Scene, number: int) -> Laid:
        """Lay the balls of a shot, as nearly as by hand."""
        ...

    def repeat(self, plan: Path, number: int) -> Array | None:
        """Where the cue ball stops when the stroke is repeated from the same place (n, 2) [m]; None: not done here."""
        ...


@dataclass(frozen=True)
class Course:
    """What a series is."""

    model: Model  # to begin with
    cueing_map: CueingMap  # to begin with; its [execution] is how well the launcher repeats
    shots: int = 60
    every: int = 10  # shots between refits
    seed: int = 0
    balls: int = 2  # in a scene
    stops: bool = True  # by itself, where nothing improves
    wish: UtilityWeights = field(default_factory=UtilityWeights)
    effort: Effort = field(default_factory=Effort)

    def __post_init__(self) -> None:
        """BadInput for what is no series."""
        if not 1 <= self.shots <= 9999 or not 4 <= self.every <= 1000:
            raise BadInput(f"{self.shots} shots, a refit every {self.every}; give 1 to 9999, and 4 to 1000")

    @property
    def study(self) -> Study:
        """That draws the scenes."""
        return Study(self.model, self.cueing_map.execution, self.balls, self.seed)

    def told(self) -> dict[str, Any]:
        """What must not change while it lasts; whether it stops, and when, may."""
        rest = {"every": self.every, "seed": self.seed, "balls": self.balls}
        return {"format": FORMAT, **rest, "wish": asdict(self.wish), "effort": asdict(self.effort)}


def begin(folder: Path | str, course: Course) -> None:
    """Make the folder of a series, or find that it is this one's; BadInput where it is another's."""
    folder, told = Path(folder), course.told()
    model, cueing_map = folder / "start.toml", folder / "start_map.toml"
    if (folder / "course.json").is_file():
        known = read_json(folder / "course.json", FORMAT)
        other = [name for name, value in told.items() if known.get(name) != value]
        if not other and read_model(model).parameters() != course.model.parameters():
            other = ["model"]
        if not other and read_map(cueing_map).constants != course.cueing_map.constants:
            other = ["map"]
        if other:
            raise BadInput(f"{folder}: holds a series with another {other[0]}; go on with that, or name another folder")
        return
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise BadInput(f"{folder}: is there and holds no series; name another folder")
    try:
        (folder / "shots").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{folder}: cannot be made ({error.strerror}); choose another folder") from error
    write_model(course.model, model)
    write_map(cueing_map, course.cueing_map)
    write_json(str(folder / "course.json"), told)


def learn(
    folder: Path | str, course: Course, stand: Stand, say: Callable[[str], None] = print,
    report: Report = lambda line: None,
) -> Story:  # fmt: skip
    """Play a series, or go on with it.

    Args:
        folder: that holds it.
        course: what it is.
        stand: where it is played.
        say: told what came of every shot and refit.
        report: told what is being done.

    Raises:
        BadInput: for a folder of another series, a scene that was not laid as asked, nobody who said yes.
        LauncherError: as play_plan; what was played is kept.
    """
    folder = Path(folder)
    begin(folder, course)
    while True:
        played = count_played(folder)
        if played and not plan_file(folder, played).with_suffix(".repeats.json").is_file():  # broken off before them
            _repeat(plan_file(folder, played), stand, played)
        learnt = played - played % course.every
        if learnt and not (fit_folder(folder, learnt) / "fit.json").is_file():
            say(_refit(folder, course, learnt, report))
        why = why_ended(read_story(folder), course.every) if course.stops and played == learnt > 0 else ""
        if why or played >= course.shots:
            write_whole(folder / "ended.txt", f"{why or f'all {played} shots are played'}\n".encode())
            return read_story(folder)
        (folder / "ended.txt").unlink(missing_ok=True)
        say(_play(folder, course, stand, played + 1, learnt, report))


def why_ended(story: Story, every: int) -> str:
    """Why a series needs no more shots, after a refit; "" where it does."""
    n, refits = len(story.shots), story.refits
    if n < BLOCKS * every or len(refits) < BLOCKS or refits[-1].verdict != refits[-2].verdict:
        return ""
    blocks = [story.median_miss(n - (k + 1) * every + 1, n - k * every) for k in range(BLOCKS)]
    foreseen = story.median_spread(n - every + 1, n)
    told = (
        f"the cue ball's miss is {1e3 * blocks[0]:.0f} mm (median of {every}), the plans foresee {1e3 * foreseen:.0f}"
    )
    if blocks[0] <= NEAR * foreseen and blocks[0] >= FALLS * blocks[1]:
        return f"{told}: nothing is left to learn"
    if blocks[0] >= FALLS * blocks[1] and blocks[1] >= FALLS * blocks[2]:
        return f"{told}, and it has not fallen in two refits"
    return ""


def latest(folder: Path, course: Course, learnt: int) -> tuple[Model, CueingMap]:
    """Model and map as learnt from so many shots."""
    if not learnt:
        return course.model, course.cueing_map
    return read_model(fit_folder(folder, learnt) / "model.toml"), read_map(fit_folder(folder, learnt) / "map.toml")


def _play(folder: Path, course: Course, stand: Stand, number: int, learnt: int, report: Report) -> str:
    """Plan and play one shot; what came of it, in words."""
    model, cueing_map = latest(folder, course, learnt)
    strokes = with_map(Strokes(), cueing_map, model.ball)
    for other in range(OTHERS):
        report(f"shot {number}: the scene")
        asked, _ = draw_scene(course.study, number + 10_000 * other)
        laid = stand.lay(asked, number)
        seen = laid.camera.look()
        if lacking := [name for name in asked.names if name not in seen]:
            raise BadInput(f"shot {number}: ball {lacking[0]} is not seen on the table; lay it, and go on")
        scene = dataclasses.replace(asked, position=np.array([seen[name] for name in asked.names]))
        plan = make_plan(
            scene, model, execution_of(cueing_map), course.wish, seed=course.study.number(number, 2),
            launcher=strokes, effort=course.effort, report=lambda line: report(f"shot {number}: {line}"),
        )  # fmt: skip
        if plan["stroke"] is not None:
            break
    else:
        raise BadInput(f"shot {number}: no stroke is reasonable in {OTHERS} scenes; look at the model and the launcher")
    path = plan_file(folder, number)
    write_json(str(path), plan | {"learnt": learnt})
    laid.turn(math.radians(plan["launcher"]["theta_deg"]))
    with laid.launcher as launcher:
        played = play_plan(path, launcher, laid.camera, laid.confirm, clips=folder / "clips", say=report)
    _repeat(path, stand, number)
    pot = {True: "potted", False: "not potted", None: "not seen"}[played.potted]
    miss = "not on the table"
    if played.cue_end is not None:
        miss = f"{1e3 * float(np.hypot(*(middle_of(plan)[0] - played.cue_end))):.0f} mm from where it was told to stop"
    return f"shot {number:3d}: {pot} ({100 * plan['pot_probability']['value']:.0f} % promised), the cue ball {miss}"


def _repeat(plan: Path, stand: Stand, number: int) -> None:
    """Where the stroke ends when it is repeated, into a file beside the plan; nothing where nobody repeats it."""
    ends = stand.repeat(plan, number)
    if ends is not None:
        told = {"format": "billiard-repeats/1", "plan": plan.name, "cue": np.round(ends, 5).tolist()}
        write_json(str(plan.with_suffix(".repeats.json")), told)


def _refit(folder: Path, course: Course, learnt: int, report: Report) -> str:
    """Learn table and launcher from the shots so far, into files; what was learnt, in words."""
    began = time.monotonic()
    out = fit_folder(folder, learnt)
    out.mkdir(parents=True, exist_ok=True)
    clip_set, played = films(folder, learnt)
    report(f"{len(clip_set.clips)} clips")
    known, _ = latest(folder, course, learnt - course.every)
    found = relearn(clip_set, played, course.model, course.cueing_map, known)
    result = found.result
    write_model(found.model, out / "model.toml")
    write_map(out / "map.toml", found.cueing_map)
    write_json(str(out / "result.json"), result)
    last, unexplained = result["ladder"][-1], result["unexplained"]
    told = {
        "format": FIT_FORMAT, "shots": learnt, "verdict": result["verdict"],
        "unexplained": unexplained["where"] if unexplained else "", "rms_m": last["rms_m"],
        "held_out_rms_m": last["held_out_rms_m"], "chi2_reduced": last["chi2_reduced"],
        "parameters": {n: {"value": p["value"], "sd": p["sd"]} for n, p in result["parameters"].items()},
        "launcher": found.launcher(), "elapsed_s": time.monotonic() - began,
    }  # fmt: skip
    write_json(str(out / "fit.json"), told)  # the last: with it the refit is there
    names = ", ".join(result["verdict"]) or "no effect beyond the base"
    return f"learnt from {learnt} shots: {names}; whole shots within {1e3 * last['rms_m']:.2f} mm rms"


def films(folder: Path, learnt: int) -> tuple[ClipSet, list[dict[str, Any]]]:
    """The films of the first so many shots that have one, and the records of what was told and done."""
    clip_set = read_clip_set(folder / "clips")
    by_file = {clip.file: clip for clip in clip_set.clips}
    records = [read_json(played_file(plan_file(folder, k)), "billiard-played/1") for k in range(1, learnt + 1)]
    told = [r for r in records if r["struck"] == "yes" and r["clip"] and r["clip"]["file"] in by_file]
    clips = [by_file[r["clip"]["file"]] for r in told]
    last = max(len(clips) - 1, 1)
    ordered = tuple(dataclasses.replace(clip, order=k / last) for k, clip in enumerate(clips))
    return dataclasses.replace(clip_set, clips=ordered), told
