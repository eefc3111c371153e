"""The history of a series of shots, read from the folder of `robot learn`.

In: the folder, which stores every fact once:

    course.json        settings shared by all parts of the series
    start.toml         the start model, and start_map.toml the start cueing map
    shots/0001.json    plans, with 0001.played.json beside each that was played
    clips/             the films, as a clip set
    fits/0010/         the refit after the first ten shots: fit.json, model.toml, map.toml

Out: a `History` of shots and refits. The cue ball's miss is its distance from the planned place, which is the median
of x and y over the plays that evaluated the plan. The launcher's scatter is the floor for any model's prediction.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from models import files
from models.errors import one_line
from models.files.faults import Faults
from models.shot import Array
from planner.planning import GIVEN, read_plan
from planner.scene import Scene, scene_from
from robot.play import PLAYED_FORMAT, played_file
from sysid.clips import Clip, read_clip_set

FOLDER_REMEDY = "name a folder of robot learn, or remove the file and run robot learn again"
SERIES_FORMAT, FIT_FORMAT = "billiard-course/1", "billiard-refit/1"


@dataclass(frozen=True)
class PlayedShot:
    """One shot of a series: its plan and its result."""

    number: int  # from 1
    scene: Scene
    learnt: int  # number of shots to which model and map were fitted
    planned_end: Array  # (2,) predicted resting place of the cue ball [m]
    spread: float  # predicted miss: median distance from there over the plays that evaluated the plan [m]
    pot_probability: float  # predicted
    potted: bool | None  # None if it was not seen
    cue_end: Array | None  # (2,) resting place of the cue ball [m]; None if it fell, or was not seen
    floor: float  # median distance of the stroke's repeats from their middle [m]; nan without repeats
    plan: dict[str, Any]
    played: dict[str, Any]
    clip: Clip | None

    @property
    def miss(self) -> float:
        """Distance of the cue ball from its planned place [m]; nan if it did not stop on the table."""
        return math.nan if self.cue_end is None else float(np.hypot(*(self.cue_end - self.planned_end)))

    @property
    def chosen(self) -> bool:
        """Whether the shot was chosen for learning, not for potting."""
        return self.plan.get("method") == GIVEN

    @property
    def from_wanted(self) -> float:
        """Distance of the cue ball from its wanted place [m]; nan if it fell."""
        return _number(self.played.get("from_wanted"))


@dataclass(frozen=True)
class Refit:
    """The result of a refit to the shots so far."""

    shots: int
    verdict: tuple[str, ...]  # effects added to the base
    unexplained: str  # unexplained structure in words; "" for none
    rms: float  # of the fitted clips, per axis [m]
    held_rms: float  # of the held-out clips [m]; nan without any
    chi2: float
    values: dict[str, tuple[float, float]]  # constants of the table, with standard deviations
    launcher: dict[str, tuple[float, float]]  # constants of the cueing map, with standard deviations
    seconds: float


@dataclass(frozen=True)
class History:
    """A series so far."""

    course: dict[str, Any]  # the settings in course.json
    shots: tuple[PlayedShot, ...]
    refits: tuple[Refit, ...]
    ended: str  # the reason why it stopped early; "" if it did not

    def played_to_pot(self, first: int, last: int) -> list[PlayedShot]:
        """Shots first to last, both counted from 1, without those chosen for learning."""
        return [s for s in self.shots if first <= s.number <= last and not s.chosen]

    def median_miss(self, first: int, last: int) -> float:
        """Median miss of potting shots, first to last [m]; nan without any."""
        return _median([s.miss for s in self.played_to_pot(first, last)])

    def median_spread(self, first: int, last: int) -> float:
        """Median miss predicted by the plans of these shots [m]."""
        return _median([s.spread for s in self.played_to_pot(first, last)])

    def floor(self, first: int, last: int) -> float:
        """The launcher's scatter in these shots, measured by repeats [m]; nan without repeats."""
        return _median([s.floor for s in self.played_to_pot(first, last)])


def _median(values: list[float]) -> float:
    known = [v for v in values if math.isfinite(v)]
    return float(np.median(known)) if known else math.nan


def plan_file(folder: Path | str, number: int) -> Path:
    """File of a shot's plan."""
    return Path(folder) / "shots" / f"{number:04d}.json"


def fit_folder(folder: Path | str, shots: int) -> Path:
    """Folder of the refit after that many shots."""
    return Path(folder) / "fits" / f"{shots:04d}"


def read_json(path: Path, form: str) -> dict[str, Any]:
    """A JSON file of a given format; BadInput if it cannot be read or has another format."""
    return files.read_json(path, form, FOLDER_REMEDY)


def count_played(folder: Path | str) -> int:
    """Number of shots played, counted from the first to the first gap."""
    number = 0
    while played_file(plan_file(folder, number + 1)).is_file():
        number += 1
    return number


def predicted_stop(plan: dict[str, Any]) -> tuple[Array, float]:
    """A plan's predicted resting place of the cue ball (2,) [m], and the median distance of its plays from it [m]."""
    places = _points(plan["places"]["cue"])
    if len(places) == 0:
        return np.full(2, math.nan), math.nan
    middle = np.median(places, axis=0)
    return middle, float(np.median(np.hypot(*(places - middle).T)))


def read_history(folder: Path | str) -> History:
    """Read a series from its folder.

    Raises:
        BadInput: for a folder without a series, or with an unreadable file.
    """
    folder = Path(folder)
    course = read_json(folder / "course.json", SERIES_FORMAT)
    with files.entries_of(folder / "course.json", FOLDER_REMEDY):
        _number(course.get("every"))
    count = count_played(folder)
    clips: dict[str, Clip] = {}
    if (folder / "clips" / "clips.toml").is_file():
        clips = {clip.file: clip for clip in read_clip_set(folder / "clips").clips}
    shots = []
    for number in range(1, count + 1):
        with files.entries_of(plan_file(folder, number), FOLDER_REMEDY):
            shots.append(_shot(folder, number, clips))
    fits = sorted(path.parent for path in folder.glob("fits/*/fit.json"))
    refits = []
    for path in fits:
        with files.entries_of(path / "fit.json", FOLDER_REMEDY):
            refits.append(_refit(read_json(path / "fit.json", FIT_FORMAT)))
    return History(course, tuple(shots), tuple(refits), _ended(folder / "ended.txt"))


def _ended(path: Path) -> str:
    """The reason why a series stopped early, in a line; "" if it did not."""
    faults = Faults()
    text = faults.settle(files.read_text(path, str(path), faults, FOLDER_REMEDY)) if path.is_file() else ""
    return one_line(text.strip())


def _number(value: Any) -> float:
    """A number from a file, or nan for null; ValueError for anything else."""
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{value!r} is not a number")
    return float(value)


def _points(values: Any) -> Array:
    """Positions from a file: (n, 2) [m]; ValueError for anything else."""
    found = np.array(values, float)
    if found.size and (found.ndim != 2 or found.shape[1] != 2 or not np.isfinite(found).all()):
        raise ValueError("a position is not a pair of numbers")
    return found.reshape(-1, 2)


def _text(value: Any) -> str:
    """A text from a file, or "" for null; ValueError for anything else."""
    if not isinstance(value, str | None):
        raise ValueError(f"{value!r} is not a text")
    return value or ""


def _check_shot(plan: Mapping[str, Any], played: Mapping[str, Any]) -> None:
    """Raise ValueError, or a similar error, for values that reports and recordings cannot draw."""
    for track in plan.get("tracks") or []:
        if len(_points(track["xy"])) != np.array(track["t"], float).size or not _text(track["ball"]):
            raise ValueError("a track has more times than places, or no ball")
    pocket = plan.get("pocket")
    if pocket is not None and not (len(pocket) == 2 and all(side in (-1, 0, 1) for side in pocket) and pocket[1]):
        raise ValueError(f"{pocket!r} is not a pocket")
    if any(played.get(key) not in (True, False, None) for key in ("potted", "cue_fell")):
        raise ValueError("potted and cue_fell are true, false or null")
    for text in (plan.get("kind"), *(played.get("noted") or [])):
        _text(text)
    _number(played.get("from_wanted"))


def _shot(folder: Path, number: int, clips: dict[str, Clip]) -> PlayedShot:
    path = plan_file(folder, number)
    plan = read_plan(path)
    played = read_json(played_file(path), PLAYED_FORMAT)
    _check_shot(plan, played)
    planned_end, spread = predicted_stop(plan)
    repeats = path.with_suffix(".repeats.json")
    floor = math.nan
    if repeats.is_file():
        ends = _points(read_json(repeats, "billiard-repeats/1")["cue"])
        floor = float(np.median(np.hypot(*(ends - np.median(ends, axis=0)).T))) if len(ends) > 2 else math.nan
    end, clip = played.get("cue_end"), played.get("clip")
    return PlayedShot(
        number, scene_from(plan["scene"], str(path)), int(_number(plan["learnt"])), planned_end, spread,
        _number(plan["pot_probability"]["value"]), played.get("potted"), None if end is None else _points([end])[0],
        floor, plan, played, clips.get(clip["file"]) if clip else None,
    )  # fmt: skip


def _refit(data: dict[str, Any]) -> Refit:
    values, launcher = (
        {name: (_number(one["value"]), _number(one["sd"])) for name, one in part.items()}
        for part in (data["parameters"], data["launcher"])
    )
    return Refit(
        int(_number(data["shots"])), tuple(_text(name) for name in data["verdict"]), _text(data["unexplained"]),
        _number(data["rms_m"]), _number(data["held_out_rms_m"]), _number(data["chi2_reduced"]), values, launcher,
        _number(data["elapsed_s"]),
    )  # fmt: skip
