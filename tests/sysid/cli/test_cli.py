"""The `sysid` command: exit statuses, one-line errors, files that are whole or absent, and the demo start to end."""

from __future__ import annotations

import importlib
import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from models.effect_catalogue import catalogue
from models.model_file import full_model, read_model, write_model
from models.shot import Ball, Table
from sysid.cli import main
from tests.bench.accuracy import CONSTANTS
from tests.figures.pages import read_figures
from tests.figures.sources import demo as figures_of_demo
from tests.figures.sources import unlike
from tests.support.clip_samples import contents, edit, make
from tests.support.commands import EXAMPLE, ROOT, Said, one_line, said_by
from tests.truth.__main__ import main as make_truth

TRUTH = EXAMPLE.parent / "example.truth.json"
NOISE = 5e-4  # of the example's tracker, per axis [m]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Any:
    def play(*words: str | Path) -> Said:
        return said_by(main, words, capsys)

    return play


@pytest.fixture
def clips(tmp_path: Path) -> Path:
    return make(tmp_path / "clips")


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """A model of the sample clips' table."""
    path = tmp_path / "m.toml"
    write_model(full_model(Table(3.569, 1.778), Ball(0.0525, 0.1406)), path)
    return path


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A few real clips to work on."""
    folder = tmp_path_factory.mktemp("cli") / "set"
    kinds = "stun,side,spin,cushion,cut"
    assert make_truth([str(folder), "--seed", "8", "--clips", "7", "--seconds", "1.2", "--kind", kinds]) == 0
    return folder


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        ((), ("verb", "check", "discover")), (("chek",), ("chek", "check")), (("compare",), ("CLIPS",)),
        (("fit", "x"), ("--out",)), (("fit", "x", "--modle", "m"), ("--modle", "--model")),
        (("fit", "x", "--out"), ("--out", "argument")), (("check", "x", "y"), ("y",)),
        (("compare", "x", "--engine", "bullet"), ("--engine", "bullet", "mujoco")),
        (("compare", "x", "--mod", "m"), ("--mod", "--model")), (("track", "v", "--mass", "big"), ("--mass", "big")),
        (("match", "--json", "a", "--clips", "b"), ("--json", "--clips")),
    ],
)  # fmt: skip
def test_a_wrong_command_line_is_one_line_with_the_offender_and_what_is_near_to_it(
    run: Any, words: tuple[str, ...], parts: tuple[str, ...]
) -> None:
    said = run(*words)
    assert said.status == 2 and said.out == ""
    [line] = said.err.splitlines()
    assert line.startswith(" ".join(("sysid", *[w for w in words[:1] if w != "chek"])) + ": ")
    assert all(part in line for part in parts), line


def test_help_names_every_verb(run: Any) -> None:
    said = run("--help")
    assert said.status == 0
    for verb in ("check", "compare", "fit", "add", "remove", "effects", "new-effect", "demo", "import", "init"):
        assert verb in said.out
        text = run(verb, "-h")
        assert text.status == 0 and f"Example: sysid {verb}" in text.out


def test_check_of_a_sound_set(run: Any, clips: Path) -> None:
    said = run("check", clips)
    assert (said.status, said.err) == (0, "")
    assert "2 clips" in said.out and "no faults" in said.out


def test_check_names_all_faults(run: Any, clips: Path, tmp_path: Path) -> None:
    edit(clips / "clips/1.csv", "0.020,cue,0.12,0.2,", "0.020,cue,nan,0.2,")
    edit(clips / "clips/1.csv", "0.030,cue,0.13,0.2,0.3", "0.030,cue,five,0.2,0.3")
    (clips / "clips/2.csv").unlink()
    said = run("check", clips, "--json", tmp_path / "faults.json")
    assert said.status != 0 and said.status in (1, 2)
    for what in ("clips/1.csv", "row 6", "row 7", "five", "clips/2.csv"):
        assert what in said.out, what
    assert "3 faults" in said.out
    assert len(json.loads((tmp_path / "faults.json").read_text())["faults"]) == 3


@pytest.mark.parametrize("verb", ["compare", "fit"])
def test_clips_that_cannot_be_used(run: Any, clips: Path, tmp_path: Path, verb: str) -> None:
    out = ("--out", tmp_path / "m2.toml") if verb == "fit" else ()
    assert "no such folder" in one_line(run(verb, tmp_path / "nowhere", *out))
    edit(clips / "clips/1.csv", "0.020,cue,0.12", "0.020,cue,here")
    line = one_line(run(verb, clips, *out))
    assert "clips/1.csv" in line and "row 6" in line and "here" in line
    assert not (tmp_path / "m2.toml").exists()


def test_a_clip_set_too_short_to_fit(run: Any, clips: Path, tmp_path: Path) -> None:
    one_line(run("fit", clips, "--out", tmp_path / "m2.toml"))
    assert not (tmp_path / "m2.toml").exists()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("not toml = = 1", "not TOML"),
        ('format = "billiard-model/9"', 'this version reads format = "billiard-model/1"'),
        ("", "format is missing"),
    ],
)
def test_a_bad_model_file(run: Any, clips: Path, tmp_path: Path, text: str, says: str) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text(text, encoding="utf-8")
    line = one_line(run("compare", clips, "--model", bad))
    assert "bad.toml" in line and says in line
    assert "cannot be read" in one_line(run("compare", clips, "--model", tmp_path / "none.toml"))


def test_slips_in_a_model_file_are_guessed(run: Any, clips: Path, model: Path) -> None:
    whole = model.read_text()
    for old, new, says in (
        ('"decoupled_cloth"', '"decoupled_clot"', "did you mean decoupled_cloth"),
        ("roll =", "rol =", "did you mean 'roll'"),
        ("[table]", "[tabel]", "did you mean 'table'"),
    ):
        model.write_text(whole)
        edit(model, old, new) if old in whole else edit(model, old.replace(" =", "]"), new.replace(" =", "]"))
        assert says in one_line(run("compare", clips, "--model", model))


def test_the_model_of_another_table(run: Any, clips: Path, tmp_path: Path) -> None:
    other = tmp_path / "carom.toml"
    write_model(full_model(Table(2.84, 1.42, pockets=False), Ball(0.0615, 0.21)), other)
    line = one_line(run("compare", clips, "--model", other))
    assert "carom.toml" in line and "table and ball" in line


@pytest.mark.parametrize(
    "words",
    [
        ("compare", "--json"), ("compare", "--report"), ("compare", "--rrd"),
        ("fit", "--out"), ("fit", "--out", "OK", "--json"), ("add", "--out"),
    ],
)  # fmt: skip
def test_an_output_that_cannot_be_written_is_refused_before_the_work(
    run: Any, clips: Path, model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    def worked(*_: Any, **__: Any) -> None:
        raise AssertionError("the work began")

    monkeypatch.setattr("sysid.residuals.compare.compare", worked)
    monkeypatch.setattr("sysid.estimation.clip_fit.fit_clips", worked)
    verb, *options = [str(tmp_path / "ok.toml") if w == "OK" else w for w in words]
    what = ["side_curve", "--model", str(model)] if verb == "add" else [str(clips)]
    line = one_line(run(verb, *what, *options, tmp_path / "none" / "file"))
    assert "folder does not exist" in line
    assert "is a folder" in one_line(run(verb, *what, *options, tmp_path))
    assert not (tmp_path / "none").exists() and not (tmp_path / "ok.toml").exists()


def test_effects_lists_the_catalogue(run: Any) -> None:
    said = run("effects")
    assert (said.status, said.err) == (0, "")
    for name, kind in catalogue().items():
        assert name in said.out
        for key, meta in kind.parameters().items():
            assert f"{key} = " in said.out and meta["unit"] in said.out and meta["source"] in said.out


def test_add_puts_an_effect_on_the_stack(run: Any, model: Path, tmp_path: Path) -> None:
    before, out = model.read_bytes(), tmp_path / "m2.toml"
    said = run("add", "side_curve", "--model", model, "--out", out)
    assert said.status == 0 and "side_curve" in said.out
    assert [e.name() for e in read_model(out).effects] == [*[e.name() for e in read_model(model).effects], "side_curve"]
    assert model.read_bytes() == before
    again = one_line(run("add", "side_curve", "--model", out, "--out", tmp_path / "m3.toml"))
    assert "already has side_curve" in again and not (tmp_path / "m3.toml").exists()


def test_an_unknown_effect_is_guessed(run: Any, model: Path, tmp_path: Path) -> None:
    line = one_line(run("add", "side_curv", "--model", model, "--out", tmp_path / "m2.toml"))
    assert "did you mean side_curve" in line
    assert "see sysid effects" in one_line(run("add", "xyz", "--model", model, "--out", tmp_path / "m2.toml"))
    assert not (tmp_path / "m2.toml").exists()


def test_compare_and_fit_write_what_they_print(run: Any, filmed: Path, tmp_path: Path) -> None:
    fitted = tmp_path / "fit.toml"
    said = run("fit", filmed, "--out", fitted, "--json", tmp_path / "fit.json")
    data = json.loads((tmp_path / "fit.json").read_text())
    assert data["format"] == "billiard-fit/1"
    assert said.status == (0 if data["converged"] else 1)
    for name, entry in data["parameters"].items():
        assert name in said.out and {"value", "sd", "unit"} <= set(entry)
        assert entry["value"] == pytest.approx(read_model(fitted).parameters()[name])
        assert entry["sd"] is None or entry["sd"] > 0
    said = run(
        "compare", filmed, "--model", fitted, "--json", tmp_path / "c.json",
        "--report", tmp_path / "c.html", "--rrd", tmp_path / "c.rrd",
    )  # fmt: skip
    assert said.status == 0
    assert json.loads((tmp_path / "c.json").read_text())["format"] == "billiard-comparison/1"
    assert "<html" in (tmp_path / "c.html").read_text(encoding="utf-8")
    assert (tmp_path / "c.rrd").stat().st_size > 1000
    assert sorted(p.name for p in tmp_path.iterdir()) == ["c.html", "c.json", "c.rrd", "fit.json", "fit.toml"]


def test_models_are_set_beside_each_other(run: Any, filmed: Path, model: Path, tmp_path: Path) -> None:
    other, figures, page = tmp_path / "fast.toml", tmp_path / "c.json", tmp_path / "c.html"
    fast = read_model(model).with_values({"decoupled_cloth.roll": 0.009})
    write_model(fast, other)
    words = ("--model", str(other), "--model", str(model))
    said = run("compare", str(filmed), *words, "--json", str(figures), "--report", str(page), "--quiet")
    assert said.status == 0 and said.err == ""
    rows = [line.split() for line in said.out.splitlines()[1:3]]
    assert [row[0] for row in rows] == ["fast", "m"]
    told = json.loads(figures.read_text())
    assert [one["model"] for one in told["beside"]] == ["fast"]
    assert float(rows[0][1]) == pytest.approx(1e3 * told["beside"][0]["summary"]["struck_rms_median_m"], abs=0.005)
    assert float(rows[1][1]) == pytest.approx(1e3 * told["summary"]["struck_rms_median_m"], abs=0.005)
    assert "Before and after" in page.read_text() and "before: fast" in page.read_text()
    assert "given twice" in one_line(run("compare", str(filmed), "--model", str(model), "--model", str(model)))
    said = run("fit", str(filmed), *words, "--out", str(tmp_path / "n.toml"))
    assert "2 times" in one_line(said) and not (tmp_path / "n.toml").exists()


@pytest.mark.parametrize(
    ("verb", "where"),
    [
        ("fit", "sysid.estimation.clip_fit.fit_from_nothing"), ("compare", "sysid.residuals.compare.polished"),
        ("fit", "models.model_file.tomli_w.dumps"), ("compare", "models.commands.console.json.dumps"),
    ],
)  # fmt: skip
def test_an_interruption_leaves_no_half_written_file(
    run: Any, clips: Path, filmed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, verb: str, where: str
) -> None:
    def interrupt(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    few = tmp_path / "few"
    shutil.copytree(filmed, few)
    text = (few / "clips.toml").read_text()
    entries = text.split("[[clip]]")
    (few / "clips.toml").write_text("[[clip]]".join(entries[:5]))
    module, _, name = where.rpartition(".")
    owner = sys.modules.get(module) or importlib.import_module(module.rpartition(".")[0])
    target = owner if module in sys.modules else getattr(owner, module.rpartition(".")[2])
    monkeypatch.setattr(target, name, interrupt)
    before = contents(tmp_path)
    out = ("--out", tmp_path / "m2.toml") if verb == "fit" else ()
    said = run(verb, few, *out, "--json", tmp_path / "x.json")
    assert said.status == 130
    assert said.err.splitlines()[-1].startswith(f"sysid {verb}: interrupted")
    assert contents(tmp_path) == before


def test_the_command_from_a_shell(clips: Path, tmp_path: Path) -> None:
    """As a user starts it: status and streams."""
    base = [sys.executable, "-m", "sysid.cli"]
    good = subprocess.run([*base, "check", clips], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (good.returncode, good.stderr) == (0, "") and "no faults" in good.stdout
    bad = subprocess.run([*base, "compare", tmp_path / "none"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert bad.returncode == 2 and bad.stdout == "" and len(bad.stderr.splitlines()) == 1


def test_a_reader_that_leaves_ends_the_command_quietly() -> None:
    words = f"{sys.executable} -m sysid.cli effects | head -n 1"
    done = subprocess.run(["sh", "-c", words], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, len(done.stdout.splitlines()), done.stderr) == (0, 1, "")


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """`sysid demo` as a user starts it: its folder, and what it said."""
    out = tmp_path_factory.mktemp("demo") / "out"
    words = [sys.executable, "-m", "sysid.cli", "demo", "--out", str(out)]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    return out, done.stdout


@pytest.mark.slow
def test_the_demo_writes_its_files(demo: tuple[Path, str]) -> None:
    out, said = demo
    results = ["model.toml", "report.html", "result.json", "review.rrd"]
    assert sorted(p.name for p in out.iterdir()) == ["made.json", *results]
    for name in ("model.toml", "report.html", "result.json", "review.rrd"):
        assert name in said
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "<html" in page and "decoupled_cloth" in page and "table_tilt" in page
    assert page.index("Before: base") < page.index("What to film next") < page.index("could be missing")


@pytest.mark.slow
def test_the_demo_names_what_the_example_hides(demo: tuple[Path, str]) -> None:
    out, said = demo
    result = json.loads((out / "result.json").read_text())
    hidden = json.loads(TRUTH.read_text())["effects"]
    assert (result["format"], result["verdict"]) == ("billiard-discovery/1", hidden)
    assert result["unexplained"] is None and result["converged"] and result["doubtful"] == []
    assert result["next_shot"]["separates_sd"] > 3
    first, last = result["rounds"][0], result["rounds"][-1]
    assert first[0]["effect"] == hidden[0] and first[0]["delta_bic"] > 5 * first[1]["delta_bic"] > 0
    assert max(row["delta_bic"] for row in last) < 10
    told = [f"missing: {hidden[0]}", "are pulled by", "margin over", "confounded", "Nothing stands out", "next shot"]
    told += ["In short", "A table that is not level (certain): +x end", "next: raise the +x end by"]
    assert all(words in said for words in told)
    assert said.index("are pulled by") < said.index(hidden[0]) < said.index(TRUTH.name), "what it knows, and when"


@pytest.mark.slow
def test_the_demo_takes_the_error_down_to_the_noise(demo: tuple[Path, str]) -> None:
    result = json.loads((demo[0] / "result.json").read_text())
    base, last = result["ladder"]
    assert result["noise_floor_m"] == pytest.approx(NOISE)
    assert min(base["rms_m"], base["held_out_rms_m"]) > 2.5 * last["rms_m"]
    assert last["rms_m"] == pytest.approx(NOISE, rel=0.05)
    assert 0.8 * NOISE < last["held_out_rms_m"] <= 1.05 * NOISE
    assert last["converged"] and last["chi2_reduced"] == pytest.approx(1, rel=0.1)


@pytest.mark.slow
def test_the_pages_have_the_demo_s_figures(demo: tuple[Path, str]) -> None:
    assert not unlike(figures_of_demo(demo[0]), read_figures()["demo"], 0.02)


@pytest.mark.slow
def test_the_demo_finds_the_constants_that_the_example_hides(demo: tuple[Path, str]) -> None:
    truth = json.loads(TRUTH.read_text())["parameters"]
    model = read_model(demo[0] / "model.toml")
    assert len(model.fitted["clips"]) == 10
    for name, short in {**CONSTANTS, "table_tilt.slope_x": "tilt_x", "table_tilt.slope_y": "tilt_y"}.items():
        sd = model.estimates[name].sd
        assert 0 < sd < 0.05 * abs(truth[short])
        assert abs(model.parameters()[name] - truth[short]) < 4 * sd, name


@pytest.mark.slow
def test_the_demo_s_recording_reads_back(demo: tuple[Path, str]) -> None:
    from rerun.chunk import RrdReader

    paths = {chunk.entity_path for chunk in RrdReader(demo[0] / "review.rrd").stream().to_chunks()}
    assert any("cue" in path for path in paths) and any("red" in path for path in paths)
