"""Whole commands on a Dask cluster of two worker processes: the same files as without, even if a worker is killed."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import planner.cli
import sysid.cli
from models.workers import cluster as dask
from planner.cli.study import StudyOptions
from sysid.estimation.solver import spread
from tests.footage.__main__ import main as film
from tests.kills.works import lines_of, plain
from tests.support.dask_cluster import pids, two_workers
from tests.support.quick_plans import STUDY
from tests.truth.__main__ import main as generate

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    with two_workers() as made:
        yield made


def kill_one_once(cluster: Any, begun: Callable[[], bool]) -> None:
    def kill() -> None:
        while not begun():
            time.sleep(0.02)
        os.kill(pids(cluster)[0], signal.SIGKILL)

    threading.Thread(target=kill, daemon=True).start()


def files(folder: Path) -> dict[str, Any]:
    """What a command has written, JSON without times; a recording holds the moment at which it was made."""
    found: dict[str, Any] = {}
    for path in sorted(p for p in folder.rglob("*") if p.is_file() and p.suffix != ".rrd"):
        name = path.relative_to(folder).as_posix()
        found[name] = plain(json.loads(path.read_text())) if path.suffix == ".json" else path.read_bytes()
    return found


@pytest.mark.slow
def test_discover(cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spread, "MIN_PROBLEMS_SENT", 3)
    clips, there, here = (tmp_path / name for name in ("set", "there", "here"))
    assert generate([str(clips), "--seed", "36", "--clips", "7", "--seconds", "1.5", "--kind", "roll,stun"]) == 0
    words = ["discover", str(clips), "--quiet", "--out"]
    kill_one_once(cluster, lambda: lines_of(there / "unfinished.jsonl") > 1)  # in the midst of the fits
    status = sysid.cli.main([*words, str(there), "--scheduler", cluster.scheduler_address])
    assert sysid.cli.main([*words, str(here)]) == status < 2
    assert files(there) == files(here)


@pytest.mark.slow
def test_track(cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    small = ["--clips", "1", "--seconds", "0.6", "--fps", "60", "--kind", "roll", "--length", "1.1", "--width", "0.6"]
    for seed, name in enumerate(("one", "two")):
        assert generate([name, "--seed", str(seed), "--no-cue", *small]) == 0
        assert film([name, f"{name}.mkv", "--size", "360x220"]) == 0
    words = ["track", "one.mkv", "two.mkv", "--camera", "one.camera.toml", "--out"]
    here = sysid.cli.main([*words, "here"])
    assert sysid.cli.main([*words, "there", "--scheduler", cluster.scheduler_address]) == here < 2
    assert files(tmp_path / "there") == files(tmp_path / "here")


@pytest.mark.slow
def test_study(cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(StudyOptions, "study", lambda self: STUDY)
    words = ["study", "--scenes", "2", "--quiet", "--out"]
    assert planner.cli.main([*words, str(tmp_path / "here"), "--jobs", "1"]) == 0
    assert planner.cli.main([*words, str(tmp_path / "there"), "--scheduler", cluster.scheduler_address]) == 0
    assert files(tmp_path / "there") == files(tmp_path / "here")


@pytest.mark.parametrize("words", [
    ["sysid", "discover", str(ROOT / "sysid" / "example"), "--out", "out"],
    ["sysid", "fit", str(ROOT / "sysid" / "example"), "--out", "out.toml"],
    ["planner", "study", "--out", "out"],
])  # fmt: skip
def test_a_wrong_address_is_one_line(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("distributed", reason="no Dask")
    monkeypatch.setattr(dask, "CONNECT_TIMEOUT_S", 1)
    monkeypatch.chdir(tmp_path)
    program = {"sysid": sysid.cli, "planner": planner.cli}[words[0]]
    assert program.main([*words[1:], "--scheduler", "tcp://127.0.0.1:9", "--quiet"]) == 2
    said = capsys.readouterr().err.splitlines()
    assert len([line for line in said if "no scheduler answers" in line]) == 1
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_jobs_are_those_of_this_machine(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["study", "--out", str(tmp_path / "out"), "--jobs", "2", "--scheduler", "tcp://127.0.0.1:9"]
    assert planner.cli.main(words) == 2
    assert "--jobs and --scheduler exclude each other" in capsys.readouterr().err
