"""The rules of the house: which way imports go, how long a file may be, what a checkout may hold."""

from __future__ import annotations

import importlib
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.architecture.picture import PICTURE, drawing
from tests.architecture.source import FLOW, ROOT, imports, sources

ROOMS: dict[str, dict[str, tuple[str, ...]]] = {  # of each package, and which others of it each may import
    "models": {
        "files": (),
        "commands": ("files",),
        "table": ("files",),
        "analytic": ("table",),
        "effects": (),
        "mjcf": ("commands", "files", "table", "analytic"),
        "workers": (),
        "engine": ("table", "analytic", "workers"),
        "mujoco": ("commands", "table", "analytic", "engine", "files", "mjcf"),
        "simulation": ("analytic", "engine", "mujoco"),
        "contract": ("files", "engine", "mjcf", "simulation"),
        "recording": ("files", "table", "mjcf"),
        "environment": ("mjcf",),
        "report": ("commands", "files", "table", "recording"),
    },
    "sysid": {
        "clips": (),
        "direct": ("clips",),
        "vision": ("clips",),
        "estimation": ("clips",),
        "validation": ("clips", "estimation"),
        "mjcf": ("validation",),
        "residuals": ("clips", "estimation"),
        "selection": ("clips", "estimation"),
        "foreign": ("clips",),
        "pooltool": ("clips", "foreign"),
        "report": ("clips", "vision", "estimation", "residuals", "selection"),
        "cli": (
            "clips",
            "direct",
            "vision",
            "estimation",
            "validation",
            "mjcf",
            "residuals",
            "selection",
            "foreign",
            "pooltool",
            "report",
        ),
    },
    "sysid.cli": {"clips": (), "identification": ()},
    "sysid.clips": {"tracker": (), "consistency": ("tracker",)},
    "sysid.estimation": {"solver": (), "states": ("solver",), "chains": ("solver", "states")},
    "sysid.vision": {
        "sources": (),
        "camera": ("sources",),
        "balls": ("sources", "camera"),
        "cue": ("sources", "camera"),
        "tracks": ("sources", "camera", "balls"),
        "rotation": ("sources", "camera"),
    },
    "sysid.vision.tracks": {"following": (), "times": ("following",), "shots": ("following",)},
    "sysid.vision.camera": {"printed": (), "table": ("printed",), "pictures": ("printed", "table")},
    "planner": {
        "launcher": (),
        "evaluation": ("launcher",),
        "search": ("launcher", "evaluation"),
        "study": ("launcher", "evaluation", "search"),
        "cli": ("launcher", "evaluation", "search", "study"),
    },
    "robot": {
        "device": (),
        "camera": (),
        "cueing": ("device",),
        "emulator": ("device", "cueing"),
        "table": ("device", "camera", "cueing"),
        "learning": ("device", "camera", "cueing", "emulator", "table"),
        "cli": ("device", "camera", "cueing", "emulator", "table", "learning"),
    },
}
LONGEST = 400  # lines
SKIPPED_FOLDERS = {"__pycache__", "out", "dist"}
LOCK_FILES = re.compile(r"(.*\.lock|pylock(\..+)?\.toml|Pipfile\.lock|package-lock\.json)$")
MACHINE_PATH = re.compile(r"(?<![\w.~$}])/(root|work|home|Users)/")


@cache
def tracked_files() -> tuple[Path, ...]:
    """What git tracks, or where there is no repository everything that is not hidden or made."""
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False)
    names = [name for name in listing.stdout.split("\0") if name]
    if listing.returncode == 0 and "pyproject.toml" in names:
        return tuple(path for name in names if (path := ROOT / name).is_file())
    return tuple(walk(ROOT))


def walk(folder: Path) -> Iterator[Path]:
    """Files below a folder, without hidden folders and what programs make."""
    for path in sorted(folder.iterdir()):
        if path.is_dir() and not path.name.startswith(".") and path.name not in SKIPPED_FOLDERS:
            yield from walk(path)
        elif path.is_file():
            yield path


def importers(roots: set[str], files: list[Path]) -> list[str]:
    """Lines "file imports module" for every import of one of these top-level packages."""
    return [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in files
        for name in sorted(imports(path))
        if name.split(".")[0] in roots
    ]


def pinned() -> dict[str, str]:
    """Normalised name and version of every line of constraints.txt."""
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    return {normal(name): release for name, _, release in (line.partition("==") for line in lines)}


def normal(name: str) -> str:
    """A distribution's name as indexes compare it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


@pytest.mark.parametrize("folder", FLOW)
def test_imports_go_one_way(folder: str) -> None:
    later = {*FLOW[FLOW.index(folder) + 1 :], "tests"}
    assert importers(later, sources(folder)) == []


@pytest.mark.parametrize(("package", "room"), [(package, room) for package, rooms in ROOMS.items() for room in rooms])
def test_rooms_import_only_what_lies_below_them(package: str, room: str) -> None:
    files = sources(f"{package.replace('.', '/')}/{room}")
    assert files
    start = f"{package}."
    found = {name.removeprefix(start).split(".")[0] for f in files for name in imports(f) if name.startswith(start)}
    assert found & set(ROOMS[package]) <= {room, *ROOMS[package][room]}


def test_vision_is_entered_by_its_door() -> None:
    """Other rooms import the names that `sysid.vision` offers, and it imports nothing of sysid but clips."""
    inside = sources("sysid/vision")
    offered = {f"sysid.vision.{name}" for name in importlib.import_module("sysid.vision").__all__}
    deep = {
        f"{path.relative_to(ROOT)} imports {name}"
        for folder in FLOW for path in sources(folder) if path not in inside
        for name in imports(path) if name.startswith("sysid.vision") and name not in offered
    }  # fmt: skip
    assert deep == set()
    above = {name for path in inside for name in imports(path) if name.startswith("sysid.")}
    assert {name for name in above if not name.startswith(("sysid.clips", "sysid.vision"))} == set()


def test_no_imports_go_in_a_circle() -> None:
    modules = {".".join(p.relative_to(ROOT).with_suffix("").parts): p for f in FLOW for p in sources(f)}
    needs: dict[str, set[str]] = {}
    for module, path in modules.items():
        named = imports(path)
        needs[module] = {n for one in named for n in (one, one.rpartition(".")[0]) if n in modules and n != module}
    while free := [m for m, rest in needs.items() if not rest & needs.keys()]:
        for module in free:
            del needs[module]
    assert not needs, f"circles among {sorted(needs)}"


def test_the_picture_of_the_architecture_is_that_of_the_code() -> None:
    """`python -m tests.architecture.picture` draws it anew."""
    assert (ROOT / PICTURE).read_text(encoding="utf-8") == drawing()


def test_lazy_and_relative_imports_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.architecture.source.ROOT", tmp_path)
    path = tmp_path / "models" / "effects" / "tilt.py"
    path.parent.mkdir(parents=True)
    path.write_text(
        "import sysid.fit as f\nfrom . import drag\nfrom ..world import build\n"
        "def g():\n    from robot.device import link\n    import_module('planner.aim')\n"
    )
    expected = {"sysid.fit", "models.effects.drag", "models.world.build", "robot.device.link", "planner.aim"}
    assert imports(path) == expected


@pytest.mark.parametrize("name", FLOW)
def test_packages_are_those_of_this_checkout(name: str) -> None:
    file = importlib.import_module(name).__file__
    assert file is not None
    assert Path(file).resolve().parent == ROOT / name


def test_only_the_views_import_rerun() -> None:
    files = [path for folder in FLOW for path in sources(folder) if not path.match("models/recording/*.py")]
    assert importers({"rerun", "rerun_sdk"}, files) == []


def test_the_truth_is_independent_of_what_it_judges() -> None:
    assert importers({"models", "sysid"}, sources("tests/truth")) == []
    made = [path for path in sources("tests/examination") if not path.name.startswith("test_")]
    assert importers({"models", "sysid"}, made) == []
    assert not [name for path in made for name in imports(path) if name.startswith("tests.truth")]


def test_no_test_is_borrowed_from() -> None:
    """What several test modules need is in tests/support."""
    taken = {(path.name, name) for path in sources("tests") for name in imports(path)}
    assert {one for one in taken if one[1].startswith("tests.") and ".test_" in one[1]} == set()


def test_no_source_is_long() -> None:
    files = [path for path in tracked_files() if path.suffix in (".py", ".xml")]
    files += [path for folder in (*FLOW, "tests") for path in sources(folder)]
    lengths = {str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines()) for path in files}
    assert {name: lines for name, lines in lengths.items() if lines > LONGEST} == {}


def test_constraints_name_no_host() -> None:
    for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines():
        assert re.fullmatch(r"[A-Za-z0-9._-]+==[A-Za-z0-9.+!]+", line), line
        assert not line.startswith("-"), line
        assert not line.lower().startswith("cuelab"), line


def test_direct_dependencies_are_pinned() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [
        *project["dependencies"],
        *(line for extra in project["optional-dependencies"].values() for line in extra),
    ]
    names = {normal(re.split(r"[^\w.-]", line, maxsplit=1)[0]) for line in wanted}
    assert names - set(pinned()) == set()


def test_no_lock_file_is_tracked() -> None:
    assert [path.name for path in tracked_files() if LOCK_FILES.match(path.name)] == []


def test_no_link_is_tracked() -> None:
    """A link leads out of the checkout, to a folder of some machine."""
    listing = subprocess.run(["git", "ls-files", "--stage"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert [line for line in listing.stdout.splitlines() if line.startswith("120000")] == []


def test_no_text_names_a_folder_of_some_machine() -> None:
    found = []
    for path in tracked_files():
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue  # a picture or a video
        for number, line in enumerate(text.splitlines(), start=1):
            if MACHINE_PATH.search(line):
                found.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()[:80]}")
    assert found == []


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the models, nothing of which has been compiled."""
    copy = tmp_path_factory.mktemp("copy") / "checkout"
    shutil.copytree(ROOT / "models", copy / "models", ignore=shutil.ignore_patterns("__pycache__"))
    return copy


def told_by(code: str, checkout: Path, **environment: str) -> str:
    """What a program prints that imports the models of a checkout."""
    env = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"} | environment
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=checkout, env=env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_an_import_sets_no_variable_and_compiles_nothing() -> None:
    code = """
import os, sys
import mujoco  # it chooses a renderer
before = dict(os.environ)
import models.simulation.simulate, models.simulation.observe, models.engine.play, sysid.estimation
import planner.search.search, robot.play
from numba.core.dispatcher import Dispatcher
from models.hooks import address
made = [f for m in list(sys.modules.values()) for f in vars(m).values() if isinstance(f, Dispatcher)
        and f.py_func.__module__.startswith("models.")]
assert dict(os.environ) == before, set(os.environ.items()) ^ set(before.items())
assert address.cache_info().currsize == 0
print(len(made), sum(len(f.signatures) for f in made))
"""
    functions, compiled = map(int, told_by(code, ROOT).split())
    assert functions > 50
    assert compiled == 0


def test_a_change_in_what_compiled_code_reads_changes_the_stamp(checkout: Path) -> None:
    def stamp() -> str:
        return told_by("from models.compiled import stamp; print(stamp())", checkout)

    before = stamp()
    assert before == stamp()
    for name in ("recording/shots.py", "shot.py", "engine/loop.py", "analytic/coulomb.py", "effect.py"):
        file = checkout / "models" / name
        file.write_text(file.read_text() + "\n")
        after = stamp()
        assert (after == before) is (name == "recording/shots.py"), "nothing compiled uses views"
        before = after


STRUCK = """
import numpy as np
from models.effects.cue.squirt import Squirt
from models.hooks import hooks_of
from models.engine.impacts import strike_rows
hooks, v, w = hooks_of([Squirt()], 1), np.array([[[1.0, 0.0]]]), np.array([[[0.0, 0.0, 40.0]]])
strike_rows(hooks.own, hooks.strike, 0.026, 0.14, np.ones(1, bool), v, w)
print(v[0, 0, 1])
"""


@pytest.mark.slow
def test_a_constant_of_an_effect_that_changes_is_played_at_once(checkout: Path) -> None:
    before = float(told_by(STRUCK, checkout))
    file = checkout / "models" / "effects" / "cue" / "squirt.py"
    text = file.read_text()
    assert "MISCUE_OFFSET = 0.5 " in text
    file.write_text(text.replace("MISCUE_OFFSET = 0.5 ", "MISCUE_OFFSET = 0.1 "))
    assert float(told_by(STRUCK, checkout)) < 0.5 * before


HITS = """
from models.analytic.cloth import turned
turned(2.0, 1.0, 0.5)
print(sum(turned.stats.cache_hits.values()))
"""


@pytest.mark.slow
def test_compiled_code_is_read_again_until_a_source_changes(checkout: Path) -> None:
    assert [told_by(HITS, checkout) for _ in range(2)] == ["0", "1"]
    assert list((checkout / "models/analytic/__pycache__/compiled").glob("cloth.turned*.nbi"))
    file = checkout / "models" / "shot.py"
    file.write_text(file.read_text() + "\n")
    assert [told_by(HITS, checkout) for _ in range(2)] == ["0", "1"]


@pytest.mark.slow
def test_a_checkout_that_cannot_be_written_uses_the_user_s_cache(checkout: Path, tmp_path: Path) -> None:
    kept = checkout / "models" / "analytic" / "__pycache__"
    shutil.rmtree(kept, ignore_errors=True)
    kept.touch()  # no folder can be made there, whoever asks
    try:
        for variable in ("XDG_CACHE_HOME", "NUMBA_CACHE_DIR"):
            folder = tmp_path / variable
            assert [told_by(HITS, checkout, **{variable: str(folder)}) for _ in range(2)] == ["0", "1"]
            assert list(folder.glob("cuelab/*/cloth.turned*.nbi"))
        nowhere = tmp_path / "file"
        nowhere.touch()
        assert [told_by(HITS, checkout, XDG_CACHE_HOME=str(nowhere)) for _ in range(2)] == ["0", "0"], "none is needed"
    finally:
        kept.unlink()
