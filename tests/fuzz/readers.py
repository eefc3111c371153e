"""Readers of files, called in this process: thousands of changed files in the time of some commands.

In: a changed seed of a reader. Out: what is wrong with how it was read: an exception that is none of ours, a message
that is no line, a wait, too much memory. What a command says of it, and does with what was read, is tried by
tests/fuzz/trial.py.
"""

from __future__ import annotations

import contextlib
import dataclasses
import signal
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from models.errors import BadInput
from models.model_file import read_model
from models.table.presets import TABLE_SETS
from planner.launcher.cueing_map import read_map
from planner.launcher.execution import read_execution
from planner.planning import read_plan
from planner.scene import read_scene
from planner.study.folder import read_object
from robot.cueing.campaign import read_campaign
from robot.device.protocol import Reader as LineReader
from robot.device.protocol import parse_status
from robot.device.settings import read_settings
from robot.learning.history import read_history
from robot.order import read_order
from sysid.clips import read_clip_set
from sysid.estimation.solver.journal import Journal
from sysid.foreign.convert import ShotFile, import_files
from sysid.foreign.stated import Stated
from sysid.new_effect import source_of
from sysid.vision.balls.colours.palette import read_palette
from sysid.vision.camera.pictures.clicks import read_points
from sysid.vision.camera.projection import read_camera
from sysid.vision.frames import open_footage
from sysid.vision.sources.picture_files import Pictures
from sysid.vision.sources.pictures import read_picture
from tests.fuzz.verbs import SEEDS, SERIES

TABLE = TABLE_SETS["snooker"]
FOREIGN = Stated("m", exchanged=False, y_down=False, fps=60.0)
LIMIT_MEMORY = 2 << 30
LIMIT_S, LIMIT_WAITING_S = 30.0, 240.0  # of processor time; of the clock, since other work may have the processor


@dataclass(frozen=True)
class FileReader:
    """A function that reads a file, and the seeds that it reads."""

    name: str
    seeds: tuple[str, ...]
    read: Callable[[Path], object]  # of the changed file, which lies among the other seeds
    share: int = 1  # how often it is chosen


def _journal(path: Path) -> object:
    """All answers that a run may have left, as a run asks for them."""
    journal = Journal(path, "a")
    while journal.answer("q", [(2,), (2, 1)]) is not None:
        pass
    journal.add("q", [np.zeros(2), np.zeros((2, 1))])
    return journal.elapsed


def _series(path: Path) -> object:
    """The series of `robot learn` that a file belongs to, and its figures."""
    while path.name != "learn":
        path = path.parent
    story = read_history(path)
    return [(shot.miss, shot.from_wanted) for shot in story.shots], story.median_spread(1, 2), story.floor(1, 2)


def _times(path: Path) -> object:
    """When the pictures beside a file of times were taken."""
    return Pictures("pictures", sorted(path.parent.glob("*.png"))).frame_times(None)


def _line(path: Path) -> object:
    """Bytes of a launcher, and what they say."""
    raw, found = path.read_bytes(), []
    for lead in ":=":
        reader = LineReader(lead, commands=lead == ":")
        for at in range(0, len(raw), 7):
            found += reader.feed(raw[at : at + 7])
    return found, parse_status(raw.decode("latin-1"))


def _foreign(path: Path) -> object:
    """Tracks of another program, and the clip that they give."""
    stated = dataclasses.replace(FOREIGN, corner=path.suffix == ".json")
    found = import_files([path], [ShotFile("clips/1.csv")], TABLE.table, TABLE.ball, stated)
    return found.says


def _film(path: Path) -> object:
    """Some frames of a film."""
    return [frame.time for frame in open_footage(path).sample(3)]


READERS = (
    FileReader("model", ("model.toml",), read_model),
    FileReader("scene", ("scene.toml",), read_scene),
    FileReader("plan", ("plan.json",), read_plan),
    FileReader("order", ("plan.json",), lambda path: read_order(path, read_settings(SEEDS / "launcher.toml"))),
    FileReader("map", ("map.toml",), read_map),
    FileReader("execution", ("execution.toml",), read_execution),
    FileReader("campaign", ("campaign.csv",), read_campaign),
    FileReader("settings", ("launcher.toml",), read_settings),
    FileReader("study", ("study/scenes/0001.json",), read_object),
    FileReader("camera", ("camera.toml",), read_camera),
    FileReader("palette", ("palette.toml",), read_palette),
    FileReader("picture", ("pictures/0000.png",), read_picture),
    FileReader("times", ("pictures/times.csv",), _times),
    FileReader("result", ("result.json",), lambda path: source_of(path, "mine")),
    FileReader("clip set", ("clips/clips.toml",), lambda path: read_clip_set(path.parent)),
    FileReader("clip", ("clips/clips/0001.csv", "clips/clips/0003.csv"), lambda path: read_clip_set(path.parents[1])),
    FileReader("foreign", ("track.csv", "track.json", "track.parquet"), _foreign, 3),
    FileReader("film", ("film.avi",), _film),
    FileReader("series", SERIES, _series),
    FileReader("journal", ("found/unfinished.jsonl",), _journal),
    FileReader("clicks", ("clicks.json",), lambda path: read_points(path.read_bytes(), (1920, 1080))),
    FileReader("line", ("line.txt",), _line),
)


@contextlib.contextmanager
def _within(seconds: float, timer: int, number: signal.Signals) -> Iterator[None]:
    """TimeoutError after so many seconds of a timer, which gives that signal."""

    def ring(number: int, frame: FrameType | None) -> None:
        raise TimeoutError

    before: Any = signal.signal(number, ring)
    signal.setitimer(timer, seconds)
    try:
        yield
    finally:
        signal.setitimer(timer, 0.0)
        signal.signal(number, before)


def defect_of(reader: FileReader, path: Path) -> str:
    """What is wrong with how a file is read; "" for nothing."""
    before = _begin_measuring()
    try:
        with (
            _within(LIMIT_S, signal.ITIMER_PROF, signal.SIGPROF),
            _within(LIMIT_WAITING_S, signal.ITIMER_REAL, signal.SIGALRM),
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("ignore", RuntimeWarning)  # as commands do
            reader.read(path)
    except BadInput as error:
        if not str(error).isprintable() or not str(error):  # a command shortens it
            return f"{reader.name}: message is no line: {str(error)[:60]!a}"
    except TimeoutError:
        return f"{reader.name}: hang"
    except Exception as error:  # noqa: BLE001 (whatever it is, it is what we look for)
        frame = traceback.extract_tb(error.__traceback__)[-1]
        return f"{reader.name}: {type(error).__name__} at {Path(frame.filename).name}:{frame.lineno}"
    if (used := _memory("VmHWM") - before) > LIMIT_MEMORY:
        return f"{reader.name}: memory {used >> 20} MB"
    return ""


def _begin_measuring() -> int:
    """Memory in use [bytes]; the most that is in use is counted anew from here on."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
    return _memory("VmRSS")


def _memory(what: str) -> int:
    """Memory of this process [bytes], as the system names it; 0 where it does not."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith(what):
                return int(line.split()[1]) << 10
    return 0
