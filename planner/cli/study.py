"""`planner study`: scenes worked out side by side, each kept in a file of its own as soon as it is done.

A folder holds study.json and model.toml, what its scenes share, and scenes/0001.json and so on, each whole or absent.
A run goes on from what is there; settings, models or sources other than those that the folder was begun with are
refused, as figures over a mixture would be of nothing. Only times differ between runs and numbers of processes.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import os
import pickle
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from models.console import Progress, write_json
from models.errors import BadInput
from models.files import write_whole

if TYPE_CHECKING:
    from planner.study.draws import Study

FORMAT = "billiard-study-plans/1"
DONE, INTERRUPTED = 0, 130
MOST = 100_000  # scenes
# What shows and asks, but changes no figure: another version of it may go on with a study.
ASIDE = ("cli*.py", "*report.py", "from_picture.py", "*environment.py", "view*.py", "recording/*.py", "figures.py",
         "pictures.py")  # fmt: skip


def add(one: argparse.ArgumentParser) -> None:
    """The options."""
    one.add_argument(
        "--out", metavar="DIR", required=True, help="folder of the study; one that is there is gone on with"
    )
    text = "model to plan with (default: the base on a full-size table, with priors for its uncertainty)"
    one.add_argument("--model", metavar="M.toml", help=text)
    one.add_argument("--scenes", metavar="N", type=int, default=200, help="how many (default: 200)")
    one.add_argument("--balls", metavar="N", type=int, default=2, help="in each scene, 2 to 8 (default: 2)")
    one.add_argument("--execution", metavar="E.toml", help="launcher's repeatability (default: the model file's)")
    one.add_argument("--seed", metavar="N", type=int, default=0, help="of everything drawn (default: 0)")
    text = "risk: over errors; ga: the paper's; both, to compare them (default)"
    one.add_argument("--method", choices=("both", "risk", "ga"), default="both", help=text)
    cores = os.cpu_count() or 1
    one.add_argument("--jobs", metavar="N", type=int, default=cores, help="scenes at a time (default: one a core)")
    one.add_argument("--report", metavar="FILE.md", help="figures as Markdown, with pictures in a PNG beside it")
    one.add_argument("--json", metavar="FILE", help="the same figures as JSON")
    text = "write one scene of the folder as a scene file for `planner plan`, and do nothing else"
    one.add_argument("--scene", metavar=("N", "FILE.toml"), nargs=2, help=text)


def run(args: argparse.Namespace, progress: Progress) -> int:
    """Work out the scenes that are not there yet, then tell of all."""
    from models.console import check_outputs

    if args.scene:
        return _write_scene(args.out, *args.scene)
    for name, most in (("scenes", MOST), ("jobs", 1024)):
        if not 1 <= getattr(args, name) <= most:
            raise BadInput(f"--{name} {getattr(args, name)}: give a number from 1 to {most}")
    if args.report and Path(args.report).suffix == ".png":
        raise BadInput(f"{args.report}: is the name of the picture beside the report; give one that ends in .md")
    check_outputs(args.json, args.report)

    from planner.study.figures import figures
    from planner.study.report import text_table, write_report

    study = _study(args)
    begin(args.out, study)
    try:
        carry_out(args.out, study, args.scenes, args.jobs, getattr(args, "effects", ()), progress)
    except KeyboardInterrupt:
        progress.close()
        kept = len(read_scenes(args.out, args.scenes))
        print(
            f"interrupted: {kept} of {args.scenes} scenes are kept in {args.out}; the same command goes on from them",
            file=sys.stderr,
        )
        return INTERRUPTED
    progress.close()
    scenes = read_scenes(args.out, args.scenes)
    told = figures(scenes)
    print(text_table(told))
    print(f"scenes: {args.out}")
    if args.json:
        write_json(args.json, told)
    if args.report:
        write_report(args.report, scenes, described(study), args.out)
        print(f"report: {args.report}")
    return DONE


def _study(args: argparse.Namespace) -> Study:
    from models.model_file import read_model
    from planner.cli.common import load_execution
    from planner.study.draws import Study, usual_model

    model = read_model(args.model) if args.model else usual_model()
    return Study(model, load_execution(args.execution, model), args.balls, args.seed, args.method)


def described(study: Study) -> dict[str, Any]:
    """What every scene of a folder shares, as plain values."""
    return {
        "format": FORMAT, "seed": study.seed, "balls": study.balls, "method": study.method, "plays": study.plays,
        "execution": asdict(study.execution), "wish": asdict(study.weights), "effort": asdict(study.effort),
        "model": hashlib.sha256(repr(study.model).encode()).hexdigest()[:16], "sources": fingerprint(),
    }  # fmt: skip


def fingerprint() -> str:
    """What the sources that figures depend on say, in short."""
    root, seen = Path(__file__).resolve().parents[2], hashlib.sha256()
    for folder in ("models", "planner"):
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in (".py", ".xml") and not any(path.match(pattern) for pattern in ASIDE):
                seen.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return seen.hexdigest()[:16]


def begin(out: Path | str, study: Study) -> None:
    """Make a study's folder, or see that it is this study's; BadInput names the first difference."""
    from models.model_file import write_model

    out, now = Path(out), described(study)
    if out.exists() and not out.is_dir():
        raise BadInput(f"{out}: is a file; name a folder for the study")
    head = out / "study.json"
    if not head.exists():
        if out.is_dir() and any(out.iterdir()):
            raise BadInput(f"{out}: holds something else than a study of plans; choose another folder")
        write_whole(head, (json.dumps(now, indent=1) + "\n").encode(), parents=True)
        write_model(study.model, out / "model.toml")  # to look at single scenes with
        return
    then = _read(head)
    if then is None or then.get("format") != FORMAT:
        raise BadInput(f"{head}: is not of this program; choose another folder")
    for key, value in now.items():
        if then.get(key) != value:
            was, new = _told(then.get(key), value)
            remedy = "choose another --out" if key == "sources" else f"choose another --out, or {key} as then"
            raise BadInput(f"{out}: was begun with {key} {was}, now {new}; figures would mix: {remedy}")


def _told(was: Any, new: Any) -> tuple[str, str]:
    """Two settings that differ; of two tables what differs in them."""
    if isinstance(was, dict) and isinstance(new, dict):
        keys = [k for k in {**was, **new} if was.get(k) != new.get(k)]
        was, new = ({k: side.get(k) for k in keys} for side in (was, new))
        return tuple(", ".join(f"{k} = {v}" for k, v in side.items()) for side in (was, new))  # type: ignore[return-value]
    return str(was), str(new)


def _read(path: Path) -> dict[str, Any] | None:
    """What a JSON file holds; None where it is none."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return data if isinstance(data, dict) else None


def scene_path(out: Path | str, number: int) -> Path:
    """Where a scene's results are."""
    return Path(out) / "scenes" / f"{number:04d}.json"


def read_scenes(out: Path | str, count: int) -> list[dict[str, Any]]:
    """The results there are of the first so many scenes, by their number."""
    found = (_read(scene_path(out, number)) for number in range(1, count + 1))
    return [data for data in found if data is not None]


def carry_out(out: Path | str, study: Study, count: int, jobs: int, folders: Sequence[str], progress: Progress) -> None:
    """Work out the scenes up to `count` that are not there yet, and keep each as it comes."""
    todo = [number for number in range(1, count + 1) if _read(scene_path(out, number)) is None]
    began, total = time.monotonic(), len(todo)
    there = count - total
    if todo:
        progress(f"{there} of {count} scenes")
    for done, told in enumerate(_worked_out(study, todo, min(jobs, total), folders), 1):
        text = json.dumps(_plain(told), separators=(",", ":"))
        write_whole(scene_path(out, told["number"]), (text + "\n").encode(), parents=True)
        left = (time.monotonic() - began) / done * (total - done)
        progress(f"{there + done} of {count} scenes, {left / 60:.0f} min left")


def _plain(value: Any) -> Any:
    """Without what JSON has no word for."""
    if isinstance(value, float):
        return value if abs(value) < float("inf") else None
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    return [_plain(v) for v in value] if isinstance(value, list | tuple) else value


def _worked_out(study: Study, todo: Sequence[int], jobs: int, folders: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Results of scenes as they come, from processes side by side where there are several jobs."""
    from planner.study.runs import study_scene

    if jobs <= 1:
        for number in todo:
            yield study_scene(study, number)
        return
    before = set(multiprocessing.active_children())
    packed, where = pickle.dumps(study), tuple(str(Path(f).resolve()) for f in folders)
    pool = ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn"), initializer=_deaf)
    try:
        # A few ahead: what waits is not pickled before it is needed.
        rest, running = iter(todo), set[Future[dict[str, Any]]]()
        while True:
            for number in islice(rest, jobs + 1 - len(running)):
                running.add(pool.submit(_one, packed, where, number))
            if not running:
                break
            finished, running = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                yield future.result()
        pool.shutdown()
    except BrokenProcessPool:
        raise BadInput(f"--jobs {jobs}: one of the processes was ended; give fewer if memory is short") from None
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in set(multiprocessing.active_children()) - before:
            child.terminate()


def _deaf() -> None:
    """Leave Ctrl-C to the process that keeps the results, which ends this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _one(packed: bytes, folders: Sequence[str], number: int) -> dict[str, Any]:
    """One scene in a process of its own; a user's effects must join the catalogue before the model is unpacked."""
    from models.model_file import add_folder
    from planner.study.runs import study_scene

    for folder in folders:
        add_folder(folder)
    return study_scene(pickle.loads(packed), number)


def _write_scene(out: str, number: str, path: str) -> int:
    """One scene as a scene file."""
    from planner.scene import scene_from, write_scene

    told = _read(scene_path(out, int(number))) if number.isdigit() else None
    if told is None or "scene" not in told:
        raise BadInput(f"--scene {number}: is not among the scenes worked out in {out}; name one that its report does")
    write_scene(scene_from(told["scene"], str(scene_path(out, int(number)))), path)
    stroke = told["methods"].get("risk", {}).get("stroke")
    print(f"scene: {path}" + ("" if stroke else " (no stroke was found for it)"))
    return DONE
