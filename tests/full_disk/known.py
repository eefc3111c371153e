"""Computations whose results an undisturbed run leaves to the runs after it, which then only write.

In: a folder for the results. Out: the functions in their modules, each computing once. What is computed and written
in turn, as discoveries and series are, is computed each time.
"""

from __future__ import annotations

import functools
import importlib
import itertools
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

FUNCTIONS = (
    "sysid.interface.compare", "sysid.interface.fit", "sysid.interface.diagnose",
    "sysid.report.outcome.compare", "sysid.vision.film.tried_film", "sysid.vision.camera.calibrate.calibrate",
    "planner.planning.make_plan", "planner.study.runs.study_scene", "robot.cueing.map_fit.fit_map",
    "robot.cueing.held_out.compare_maps",
)  # fmt: skip


def keep_results(folder: Path) -> None:
    """Let each function keep what it gives, call by call, and give that again where it is there."""
    for name in FUNCTIONS:
        module, _, function = name.rpartition(".")
        home = importlib.import_module(module)
        found: Any = getattr(home, function)
        setattr(home, function, _kept(getattr(found, "__wrapped__", found), folder, name))


def _kept(function: Callable[..., Any], folder: Path, name: str) -> Callable[..., Any]:
    calls = itertools.count()

    @functools.wraps(function)
    def call(*words: Any, **named: Any) -> Any:
        place = folder / f"{name}-{next(calls)}.pickle"
        if place.is_file():
            return pickle.loads(place.read_bytes())
        found = function(*words, **named)
        try:
            place.write_bytes(pickle.dumps(found))
        except (pickle.PicklingError, AttributeError, TypeError, OSError):  # holds what cannot be kept, or no room
            place.unlink(missing_ok=True)
        return found

    return call
