"""Effects of a user's own: the file to fill in, its test, the folder that joins the catalogue, and what is refused."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from models import effect_catalogue, model_file
from models.effect_catalogue import add_folder, catalogue, effect_class
from models.errors import BadInput
from models.model_file import read_model
from sysid.cli import main
from sysid.new_effect import EFFECT_TEMPLATE, checked_name, class_name, write
from tests.support.clip_samples import refusal
from tests.support.effect_files import file_faults

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(autouse=True)
def shipped_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """No test sees another's folder."""
    monkeypatch.setattr(effect_catalogue, "_added", {})


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A folder with one effect."""
    folder = tmp_path / "own"
    write("felt_wear", folder)
    return folder


def said(capsys: pytest.CaptureFixture[str], *words: str | Path) -> tuple[int, str, str]:
    capsys.readouterr()
    status = main([str(w) for w in words])
    return status, *capsys.readouterr()


def refused(capsys: pytest.CaptureFixture[str], *words: str | Path) -> str:
    status, _, err = said(capsys, *words)
    assert status == 2
    [line] = err.splitlines()
    assert line.isprintable()
    return line


def test_the_template_keeps_its_contract(own: Path) -> None:
    assert file_faults(own) == []
    assert effect_class("felt_wear").__name__ == "FeltWear"
    assert [
        d for d in ("forces", "impact", "strike", "exposures", "observe", "edit") if f"def {d}(" not in EFFECT_TEMPLATE
    ] == []


@pytest.mark.slow
def test_its_test_runs_with_plain_pytest(own: Path) -> None:
    """In the checkout's folder, as a user runs it: the effect as it is passes, and a broken one is named."""
    run = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(own)]
    done = subprocess.run(run, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "11 passed" in done.stdout, done.stdout
    file = own / "felt_wear.py"
    file.write_text(file.read_text().replace("-self.rate *", "-0.9 * self.rate *"))
    done = subprocess.run(run, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "test_its_physics" in done.stdout


def test_the_files_are_clean(own: Path) -> None:
    ruff = [sys.executable, "-m", "ruff"]
    config = ["--config", str(ROOT / "pyproject.toml")]
    for words in (["check", "--ignore", "S101"], ["format", "--check"]):
        done = subprocess.run([*ruff, *words, *config, str(own)], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout


def test_a_whole_source_may_be_given(tmp_path: Path) -> None:
    text = EFFECT_TEMPLATE.format(title="Mine", cls="MyOwn").replace("0.01, off", "0.02, off")
    effect, test = write("my_own", tmp_path, text)
    assert effect.read_text() == text
    compile(test.read_text(), str(test), "exec")
    assert file_faults(effect) == []


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("FeltWear", "such as felt_wear"), ("felt-wear", "such as felt_wear"), ("2nd", "such as nd"), ("a__b", "a_b"),
        ("", "not a valid effect name"), ("../x", "such as x"), ("class", "is reserved"), ("match", "is reserved"),
        ("native", "is reserved"), ("test_it", "collected as a test"), ("squirt", "already in the catalogue"),
        ("x\ny", "such as x_y"),
    ],
)  # fmt: skip
def test_bad_names_are_refused(name: str, says: str) -> None:
    assert says in refusal(lambda: checked_name(name))


def test_nothing_is_overwritten(own: Path, tmp_path: Path) -> None:
    before = (own / "felt_wear.py").read_bytes()
    assert "already exists" in refusal(lambda: write("felt_wear", own))
    (own / "felt_wear.py").unlink()
    assert "test_felt_wear.py: already exists" in refusal(lambda: write("felt_wear", own))
    assert not (own / "felt_wear.py").exists()
    (tmp_path / "file").write_bytes(before)
    assert "is not a folder" in refusal(lambda: write("other", tmp_path / "file"))
    assert class_name("felt_wear_2b") == "FeltWear2b"


def test_the_verb(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "mine"
    status, out, err = said(capsys, "new-effect", "felt_wear", "--dir", folder)
    assert (status, err) == (0, "") and "felt_wear.py" in out and "test_felt_wear.py" in out
    assert sorted(p.name for p in folder.iterdir()) == ["felt_wear.py", "test_felt_wear.py"]
    assert "already exists" in refused(capsys, "new-effect", "felt_wear", "--dir", folder)
    assert "such as felt_wear" in refused(capsys, "new-effect", "FeltWear", "--dir", folder)


@pytest.mark.parametrize(
    ("text", "says"),
    [("{", "is not JSON ("), ('{"unexplained": null}', "leaves nothing unexplained"), ("[]", "nothing unexplained"),
     ('{"unexplained": {"form": "odd"}}', "has no formula"), ("[" * 100_000, "correct the JSON"),
     ("1" * 5000, "correct the JSON"), ('{"unexplained": {"terms": "drag"}}', "no list of 1 to 64 terms"),
     ('{"unexplained": {"terms": [{"name": "x"}]}}', "a term has no name, door or factor")],
)  # fmt: skip
def test_results_that_cannot_be_written_as_an_effect(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, text: str, says: str
) -> None:
    (tmp_path / "result.json").write_text(text)
    words = ("new-effect", "felt_wear", "--dir", tmp_path / "own", "--from")
    assert says in refused(capsys, *words, tmp_path / "result.json")
    assert "cannot be read" in refused(capsys, *words, tmp_path / "none.json")
    assert not (tmp_path / "own").exists()


def test_a_result_becomes_an_effect(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """From a file whose name and words would end a string in Python, or a line."""
    term = {"name": "cushion_e_rail_2", "door": "cushion_e", "factor": "rail == 2", "unit": "1", "value": -0.12}
    told = {"terms": [term], "what": 'it "does"\n\\', "where": "the cushion at +y: '''its restitution"}
    result = tmp_path / 'a "re\nsult\\.json'
    result.write_text(json.dumps({"unexplained": told}))
    status, out, err = said(capsys, "new-effect", "dead_rail", "--dir", tmp_path / "own", "--from", result)
    assert (status, err) == (0, "") and "state its cause, source and bounds" in out and "replace" not in out
    text = (tmp_path / "own" / "dead_rail.py").read_text()
    assert "hit.restitution += self.cushion_e_rail_2 * (rail == 2)" in text and "exec" not in text
    assert file_faults(tmp_path / "own") == []
    kind = effect_class("dead_rail")
    assert kind.parameters()["cushion_e_rail_2"]["default"] == -0.12
    assert kind.parameters()["cushion_e_rail_2"]["source"] == 'sysid discover, a "re sult\\.json'
    result.write_text(json.dumps({"unexplained": told | {"terms": [term | {"factor": "rail == 3"}]}}))
    words = ("new-effect", "other_rail", "--dir", tmp_path / "own", "--from", result)
    assert "no term 'cushion_e_rail_2' on 'cushion_e' with factor 'rail == 3'" in refused(capsys, *words)


def test_a_folder_joins_every_verb(capsys: pytest.CaptureFixture[str], own: Path, tmp_path: Path) -> None:
    base = tmp_path / "base.toml"
    model_file.write_model(model_file.full_model(model_file.Table(3.569, 1.778), model_file.Ball(0.0525, 0.14)), base)
    out = tmp_path / "m.toml"
    assert "unknown effect 'felt_wear'" in refused(capsys, "add", "felt_wear", "--model", base, "--out", out)
    status, _, _ = said(capsys, "add", "felt_wear", "--model", base, "--out", out, "--effects", own)
    assert status == 0 and [e.name() for e in read_model(out).effects][-1] == "felt_wear"
    for verb in ("compare", "fit"):
        assert main([verb, "--help"]) == 0
        assert "--effects DIR" in capsys.readouterr().out


def test_the_catalogue_as_text_and_json(capsys: pytest.CaptureFixture[str], own: Path, tmp_path: Path) -> None:
    file = tmp_path / "effects.json"
    status, out, _ = said(capsys, "effects", "--effects", own, "--json", file)
    data = {entry["name"]: entry for entry in json.loads(file.read_text())["effects"]}
    assert status == 0 and list(data) == list(catalogue()) and "felt_wear" in data
    assert data["felt_wear"]["doors"] == ["forces"] and data["felt_wear"]["file"] == str(own / "felt_wear.py")
    assert data["felt_wear"]["parameters"]["rate"]["bounds"] == [-0.1, 0.2]
    assert data["decoupled_cloth"]["slot"] == "cloth" and "; slot cloth)" in out
    for entry in data.values():
        assert entry["says"] in out and entry["says"] and entry["formula"] in out
    assert data["air_drag"]["formula"].startswith("Force -M k |v| v through the centre")
    status, out, _ = said(capsys, "effects", "squirt")
    assert status == 0 and out.startswith("squirt  (strike)\n") and "off at 0" in out and "table_tilt" not in out


def test_check_names_the_faults(capsys: pytest.CaptureFixture[str], own: Path, tmp_path: Path) -> None:
    assert said(capsys, "effects", "--check", "--effects", own)[:2] == (0, "felt_wear: no faults\n")
    assert said(capsys, "effects", "--check", "squirt", "lens_distortion")[0] == 0
    file = own / "felt_wear.py"
    file.write_text(file.read_text().replace("-self.rate *", "-self.rat *"))
    status, out, _ = said(capsys, "effects", "--check", "--effects", own, "--json", tmp_path / "c.json")
    assert status == 1 and out.startswith("felt_wear: compiles: FeltWear.forces uses 'rat'") and out.count("\n") == 1
    assert json.loads((tmp_path / "c.json").read_text())["effects"][0]["faults"]
    assert "did you mean squirt" in refused(capsys, "effects", "--check", "squrt")


FAULTY = [
    ("def (", ["line 1", "SyntaxError"]),
    ("import no_such_thing\n", ["line 1", "ModuleNotFoundError", "no_such_thing"]),
    ("x = 1\nraise ValueError('two\\nlines')\n", ["line 2", "ValueError: two lines"]),
    ("import sys\nsys.exit(3)\n", ["line 2", "SystemExit"]),
    ("from models.effect import Effect\nclass Bare(Effect):\n    pass\n", ["Bare is no dataclass"]),
    (
        "from dataclasses import dataclass\nfrom models.effect import Effect\n"
        "@dataclass(frozen=True)\nclass Bare(Effect):\n    size: float = 1.0\n",
        ["Bare.size is not declared", "param("],
    ),
    (EFFECT_TEMPLATE.format(title="X", cls="TableTilt"), ["table_tilt is taken by", "table_tilt.py", "rename"]),
    (EFFECT_TEMPLATE.format(title="X", cls="FeltWear"), ["felt_wear is taken by", "felt_wear.py", "rename"]),
    ("\0", ["zz.py: ", "cannot contain null bytes"]),  # a ValueError until Python 3.11.3
]


@pytest.mark.parametrize(("text", "says"), FAULTY, ids=range(len(FAULTY)))
def test_a_file_that_does_not_fit_is_named(
    capsys: pytest.CaptureFixture[str], own: Path, text: str, says: list[str]
) -> None:
    (own / "zz.py").write_text(text)
    line = refused(capsys, "effects", "--effects", own)
    for word in ("zz.py", *says):
        assert word in line
    assert "felt_wear" not in catalogue(), "all of a folder, or nothing"


def test_folders_that_hold_nothing(tmp_path: Path) -> None:
    assert "no such folder" in refusal(lambda: add_folder(tmp_path / "none"))
    (tmp_path / "test_x.py").write_text("raise SystemExit")
    (tmp_path / "_x.py").write_text("raise SystemExit")
    (tmp_path / "helper.py").write_text("from models.effects.cue.squirt import Squirt\n")
    assert "defines no effect; begin one with: sysid new-effect" in refusal(lambda: add_folder(tmp_path))


def test_folders_are_read_again_when_they_change(own: Path, tmp_path: Path) -> None:
    assert add_folder(own) == ("felt_wear",)
    first = effect_class("felt_wear")
    assert add_folder(own) == ("felt_wear",) and effect_class("felt_wear") is first
    file = own / "felt_wear.py"
    file.write_text(file.read_text().replace("0.01, off", "0.02, off"))
    add_folder(own)
    assert effect_class("felt_wear").parameters()["rate"]["default"] == 0.02
    shutil.copytree(own, tmp_path / "copy")
    with pytest.raises(BadInput, match=f"taken by {file}"):
        add_folder(tmp_path / "copy")
    os.rename(file, own / "other.py")
    assert add_folder(own) == ("felt_wear",)
    write("linen_wear", own)
    assert add_folder(own / "linen_wear.py") == ("linen_wear",)
    assert {"felt_wear", "linen_wear"} <= set(catalogue())


def test_a_model_file_with_an_own_effect(own: Path, tmp_path: Path) -> None:
    add_folder(own)
    path = tmp_path / "m.toml"
    base: Any = model_file.full_model(model_file.Table(3.569, 1.778), model_file.Ball(0.0525, 0.14))
    model_file.write_model(base.add(effect_class("felt_wear")(rate=0.03)), path)
    assert read_model(path).parameters()["felt_wear.rate"] == 0.03
