"""A study's folder: common settings, and a file for each scene as soon as it is simulated.

study.json and model.toml hold the common settings, scenes/0001.json and so on one scene each, complete or absent. A run
continues from the existing scenes. Settings, models or sources that differ from those at the start are refused, since
figures over a mixture would be meaningless. Only times differ between runs and numbers of processes.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from models.commands.console import Progress, plain
from models.errors import BadInput
from models.files import read_document, write_whole
from models.files.faults import Faults
from models.messages import counted

if TYPE_CHECKING:
    from models.workers import Workers
    from planner.study.draws import Study

STUDY_FORMAT = "billiard-study-plans/1"
MODEL_FILE = "model.toml"
# Sources of input and output that change no figure: another version of them may continue a study.
UNCHECKED_SOURCES = (
    "cli/*.py", "commands/*.py", "*report.py", "figures.py", "pictures.py",
    "from_picture.py", "*environment.py", "view*.py", "recording/*.py",
)  # fmt: skip


def describe(study: Study) -> dict[str, Any]:
    """The common settings of a folder's scenes, as plain values."""
    return {
        "format": STUDY_FORMAT, "seed": study.seed, "balls": study.balls, "method": study.method, "plays": study.plays,
        "execution": asdict(study.execution), "weights": asdict(study.weights), "effort": asdict(study.effort),
        "model": hashlib.sha256(repr(vars(study.model)).encode()).hexdigest()[:16], "sources": fingerprint(),
    }  # fmt: skip


def fingerprint() -> str:
    """A digest of the sources that figures depend on."""
    root, seen = Path(__file__).resolve().parents[2], hashlib.sha256()
    for folder in ("models", "planner"):
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in (".py", ".xml") and not any(path.match(pattern) for pattern in UNCHECKED_SOURCES):
                seen.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return seen.hexdigest()[:16]


def begin(out: Path | str, study: Study) -> None:
    """Make a study's folder, or check that it belongs to this study; BadInput names the first difference."""
    from models.model_file import write_model

    out, now = Path(out), describe(study)
    if out.exists() and not out.is_dir():
        raise BadInput(f"{out}: is a file; name a folder for the study")
    head = out / "study.json"
    if not head.exists():
        if out.is_dir() and {path.name for path in out.iterdir()} - {MODEL_FILE}:
            raise BadInput(f"{out}: holds something other than a study; choose another folder")
        write_model(study.model, out / MODEL_FILE)  # to plan and view single scenes with
        write_whole(head, (json.dumps(now, indent=1) + "\n").encode())  # written last: it marks a complete start
        return
    then = read_object(head)
    if then is None or then.get("format") != STUDY_FORMAT:
        raise BadInput(f"{head}: was not made by this program; choose another folder")
    for key, value in now.items():
        if then.get(key) != value:
            was, new = _differing(then.get(key), value)
            remedy = "choose another --out" if key == "sources" else f"choose another --out, or {key} as then"
            raise BadInput(f"{out}: was started with {key} {was}, now it is {new}, and figures must not mix: {remedy}")


def _differing(was: Any, new: Any) -> tuple[str, str]:
    """Two different settings as text; of two tables only the different keys."""
    if isinstance(was, dict) and isinstance(new, dict):
        keys = [k for k in {**was, **new} if was.get(k) != new.get(k)]
        was, new = ({k: side.get(k) for k in keys} for side in (was, new))
        return tuple(", ".join(f"{k} = {v}" for k, v in side.items()) for side in (was, new))  # type: ignore[return-value]
    return str(was), str(new)


def read_object(path: Path) -> dict[str, Any] | None:
    """The object in a JSON file; None if the file does not exist."""
    data = read_document(path, str(path), Faults(), "", json.loads)
    return data if isinstance(data, dict) else None


def scene_path(out: Path | str, number: int) -> Path:
    """The file of a scene's results."""
    return Path(out) / "scenes" / f"{number:04d}.json"


def read_scenes(out: Path | str, count: int) -> list[dict[str, Any]]:
    """Existing results of the first `count` scenes, by number."""
    found = (read_object(scene_path(out, number)) for number in range(1, count + 1))
    return [data for data in found if data is not None]


def carry_out(out: Path | str, study: Study, count: int, workers: Workers | None, progress: Progress) -> None:
    """Simulate the missing scenes up to `count`, and write each when it is done; in this process without workers."""
    todo = [number for number in range(1, count + 1) if read_object(scene_path(out, number)) is None]
    started, total = time.monotonic(), len(todo)
    present = count - total
    if todo:
        progress(f"{present} of {counted(count, 'scene')}")
    for done, result in enumerate(_simulated(study, todo, workers), 1):
        text = json.dumps(plain(result), separators=(",", ":"))
        write_whole(scene_path(out, result["number"]), (text + "\n").encode(), parents=True)
        left = (time.monotonic() - started) / done * (total - done)
        progress(f"{present + done} of {counted(count, 'scene')}, {left / 60:.0f} min left")


def _simulated(study: Study, todo: Sequence[int], workers: Workers | None) -> Iterator[dict[str, Any]]:
    """Yield results of scenes as they are finished."""
    from planner.study.runs import study_scene

    if workers is None:
        yield from (study_scene(study, number) for number in todo)
    else:
        yield from (result for _, result in workers.as_they_come(study_scene, [(study, number) for number in todo]))
