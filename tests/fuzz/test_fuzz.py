"""Changed inputs for some seconds, on every run of the tests; and inputs that once did harm."""

from __future__ import annotations

import os
import shutil
import struct
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest

from models.errors import BadInput
from models.files import limits
from sysid.foreign.records import read_columns
from tests.fuzz import readers
from tests.fuzz.__main__ import main
from tests.fuzz.readers import READERS, FileReader
from tests.fuzz.trial import Ended, prepare, tried
from tests.fuzz.verbs import SEEDS, VERBS, Command, Verb

SHORT_COUNT = 800
LONG = ("sysid discover", "robot learn", "sysid doctor", "sysid track pictures")  # with slow tests of their own
CHECK, COMPARE, ADD = "sysid check clips", "sysid compare clips", "sysid add squirt --model model.toml --out out.toml"
NEW_EFFECT = "sysid new-effect mine --from result.json --dir out"
SIZES = "--length 1.881 --width 0.943 --diameter 0.0615"
FILES = {"model": "model.toml", "result": "result.json", "picture": "pictures/0000.png"}
CLIP = "clips/clips/0001.csv"


@pytest.fixture(scope="module", autouse=True)
def ready() -> None:
    prepare()


@pytest.mark.slow
def test_changed_inputs_are_refused_in_a_line(tmp_path: Path) -> None:
    assert main(["--count", str(SHORT_COUNT), "--verbs", "40", "--out", str(tmp_path / "fuzz")]) == 0


@pytest.mark.slow
@pytest.mark.parametrize("verb", [
    pytest.param(verb, id=verb.line[:40], marks=[pytest.mark.thorough] * verb.line.startswith(LONG)) for verb in VERBS
])  # fmt: skip
def test_seeds_are_sound(verb: Verb, tmp_path: Path) -> None:
    ended = tried(Command(verb, tuple(verb.words), {}), tmp_path / "trial")
    assert ended.defect == ""
    # Nothing is on these pictures, and no launcher is at the port.
    wanted = {"planner scene pictures": 2, "sysid calibrate": 2, "sysid track": 1, "robot status": 2, "sysid doctor": 2,
              "robot align": 2}  # fmt: skip
    assert ended.status == next((s for head, s in wanted.items() if verb.line.startswith(head)), 0), ended.err


@pytest.mark.parametrize("reader", READERS, ids=[reader.name for reader in READERS])
def test_seeds_of_readers_are_sound(reader: FileReader, tmp_path: Path) -> None:
    shutil.copytree(SEEDS, tmp_path / "seeds")
    for name in reader.seeds:
        reader.read(tmp_path / "seeds" / name)


FIT, PLAYED, PLAN = (f"learn/{name}" for name in ("fits/0002/fit.json", "shots/0001.played.json", "shots/0001.json"))


@pytest.mark.parametrize(("file", "old", "new"), [
    ("learn/ended.txt", "all", "\udcff"),
    ("learn/course.json", '"every": 4', '"every": [4]'),
    (FIT, '"rms_m": ', '"rms_m": "x", "was": '), (FIT, '"unexplained": ""', '"unexplained": [1]'),
    (FIT, '"shots": 2', '"shots": 1e400'), (FIT, '"slide_friction_speed"', "3"),
    (PLAYED, '"from_wanted": ', '"from_wanted": "x", "was": '), (PLAYED, '"cue_end": [', '"cue_end": [1, 2,'),
    (PLAYED, '"potted": true', '"potted": "yes"'), (PLAYED, '"noted": []\n}', '"noted": [3]}'),
    (PLAN, '"t": [0.0, ', '"t": ['), (PLAN, '"pocket": [', '"pocket": [5, '), (PLAN, '"kind": ', '"kind": 3, "was": '),
])  # fmt: skip
def test_a_series_with_a_wrong_entry_is_refused(file: str, old: str, new: str, tmp_path: Path) -> None:
    text = (SEEDS / file).read_text()
    assert old in text
    words = "robot review learn --save out.rrd"
    raw = text.replace(old, new, 1).encode("utf-8", "surrogateescape")
    found = tried(Command(Verb(words, ()), tuple(words.split()), {file: raw}), tmp_path / "trial")
    assert found.defect == "" and found.status == 2, found.err


@pytest.mark.parametrize("text", ["t,ball,x,y\n\n", "t,ball,x,y", "", "# remark\n"])
def test_a_file_without_rows_holds_none(text: str, tmp_path: Path) -> None:
    (tmp_path / "track.csv").write_text(text)
    with pytest.raises(BadInput, match="holds no rows"):
        read_columns(tmp_path / "track.csv")


def ended(line: str, tmp_path: Path, **files: bytes) -> Ended:
    """How a command ends with other files: `clip`, `model`, ..."""
    changed = {FILES.get(key, CLIP): text for key, text in files.items()}
    return tried(Command(Verb(line, ()), tuple(line.split(" ")), changed), tmp_path / "trial")


def changed_rows(change: Callable[[int, list[str]], None]) -> bytes:
    """The first clip with its rows' cells changed."""
    head, *rows = (SEEDS / CLIP).read_text().splitlines()
    cells = [row.split(",") for row in rows]
    for k, row in enumerate(cells):
        change(k, row)
    return "\n".join([head, *map(",".join, cells), ""]).encode()


def at_denormal_times(k: int, row: list[str]) -> None:
    row[0] = f"{k}e-300"


def turned_without_end(k: int, row: list[str]) -> None:
    row[4] = "1e308"


def blank_picture(width: int, height: int) -> bytes:
    """A PNG of so many black pixels, small as a file."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    packer = zlib.compressobj(9)
    rows = b"".join(packer.compress(b"\0" * (1 + width)) for _ in range(height)) + packer.flush()
    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


MODEL = (SEEDS / "model.toml").read_bytes()
CASES: dict[str, tuple[str, dict[str, bytes], str]] = {
    "fit of a model": (ADD, {"model": b"fit = 3\n" + MODEL}, "model.toml"),
    "long integer": (ADD, {"model": MODEL.replace(b"3.569", b"9" * 400)}, "length"),
    "digits": (ADD, {"model": MODEL.replace(b"3.569", b"1" * 5000)}, "TOML"),
    "brackets": (NEW_EFFECT, {"result": b"[" * 3000}, "JSON"),
    "stamps": (CHECK, {"clip": changed_rows(at_denormal_times)}, "keep one row"),
    "stamps compared": (COMPARE, {"clip": changed_rows(at_denormal_times)}, "keep one row"),
    "angles": (COMPARE, {"clip": changed_rows(turned_without_end)}, "not a valid angle of a ball"),
    "rows": (CHECK, {"clip": b"t,ball,x,y,theta\n" + b"0,cue,0,0,\n" * 21_000}, "more than 20000 rows"),
    "pixels": (f"sysid calibrate pictures/0000.png {SIZES} --out out.toml", {"picture": blank_picture(9_000, 9_000)},
               "is not a picture that can be read"),
    "line break": ("sysid effects sq\nuirt", {}, "unknown effect 'sq\\nuirt'"),
    "long word": (f"planner plan {'x' * 5000} --out out.json", {}, "cannot be read"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_what_once_did_harm_is_refused_in_a_line(
    case: tuple[str, dict[str, bytes], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "MAX_ROWS", 20_000)
    line, files, told = case
    found = ended(line, tmp_path, **files)
    assert found.defect == "" and found.status == 2
    assert told in found.err + found.out


@pytest.mark.parametrize("line", [
    "sysid compare clips --model {}", "sysid effects --effects {}", "sysid check {}", "planner plan {} --out out.json",
    "sysid track {} --camera camera.toml --out out", "robot map {} --out out.toml", "robot campaign {}",
    "sysid new-effect mine --from {}", "robot play {}", f"sysid calibrate {{}} {SIZES} --out out.toml",
])  # fmt: skip
def test_nobody_waits_for_a_pipe(line: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    found = ended(line.format(tmp_path / "pipe"), tmp_path)
    assert found.defect == "" and found.status == 2


def test_an_unpaired_surrogate_in_a_result_is_text(tmp_path: Path) -> None:
    text = (SEEDS / "result.json").read_bytes().replace(b'"drag"', b'"\\ud800"', 1)
    assert ended(NEW_EFFECT, tmp_path, result=text).defect == ""


def test_a_reader_hangs_that_computes_too_long_not_one_that_others_keep_waiting(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def compute(path: Path) -> None:
        while True:
            pass

    monkeypatch.setattr(readers, "LIMIT_S", 0.2)
    waits, computes = (readers.FileReader("made up", (), read) for read in (lambda path: time.sleep(0.4), compute))
    assert readers.defect_of(waits, Path()) == ""
    assert readers.defect_of(computes, Path()) == "made up: hang"
