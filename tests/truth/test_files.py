"""The files of the generator of tracked clips with known truth: bytes, format, refusals, the shipped example."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from tests.truth.__main__ import EXAMPLE, EXAMPLE_HIDES, constants, main, make_example, parser
from tests.truth.physics import Table
from tests.truth.shots import KINDS
from tests.truth.sizes import NATURAL, options
from tests.truth.write import effects_on

ROOT = Path(__file__).parents[2]


def files(folder: Path) -> dict[str, bytes]:
    """A clip set and its truth, by name."""
    truth = folder.with_name(folder.name + ".truth.json")
    found = {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}
    return {**found, "truth": truth.read_bytes()}


def test_equal_seeds_give_equal_bytes(tmp_path: Path) -> None:
    options = ["--seconds", "2", "--kind", "stun,cut,spin", "--clips", "3"]
    for name, seed in (("a", "5"), ("b", "5"), ("c", "6")):
        assert main([str(tmp_path / name), "--seed", seed, *options]) == 0
    assert main([str(tmp_path / "d"), "--seed", "5", *options[:-1], "4"]) == 0
    a, b, c, d = (files(tmp_path / name) for name in "abcd")
    assert a == b
    assert all(a[k] != c[k] for k in a)
    assert all(a[k] == d[k] for k in a if k.startswith("clips/"))
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*"abcd", *(f"{n}.truth.json" for n in "abcd")])


def test_a_clip_set_of_every_kind(tmp_path: Path) -> None:
    """On a table, ball and camera of another size, with effects on."""
    options = "--length 2.84 --width 1.42 --diameter 0.0615 --mass 0.21 --no-pockets --fps 100 --missing 0.1 --seed 2"
    more = ["--effect", "table_tilt=0.001,-0.002", "--constant", "mus=0.2", "--clips", str(len(KINDS))]
    more += ["--kind", ",".join(KINDS)]
    out = tmp_path / "set"
    assert main([str(out), *options.split(), *more]) == 0
    head = tomllib.loads((out / "clips.toml").read_text())
    assert (head["format"], head["table"]["length"], head["table"]["pockets"]) == ("billiard-clips/1", 2.84, False)
    assert head["ball"] == {"diameter": 0.0615, "mass": 0.21}
    assert [clip["note"] for clip in head["clip"]] == list(KINDS)
    assert [("cue" in clip) for clip in head["clip"]] == [kind != "spin" for kind in KINDS]
    truth = json.loads((tmp_path / "set.truth.json").read_text())
    assert truth["effects"] == ["table_tilt"]
    assert (truth["parameters"]["mus"], truth["parameters"]["tilt_y"]) == (0.2, -0.002)
    assert "drag1" not in truth["parameters"]
    reach = Table(2.84, 1.42).reach(0.03075)
    lost, due = 0, 0
    for clip, made in zip(head["clip"], truth["clips"], strict=True):
        lines = (out / clip["file"]).read_text().splitlines()
        assert lines[0] == "t,ball,x,y,theta"
        rows = [line.split(",") for line in lines[1:]]
        t = np.array([float(row[0]) for row in rows])
        assert np.all(np.diff(t) >= 0) and t[0] == 0.0
        xy = np.array([[float(row[2]), float(row[3])] for row in rows])
        assert np.all(np.abs(xy) < reach + 0.005)
        assert {row[1] for row in rows} == set(made["balls"])
        assert all((row[4] != "") == (clip["note"] == "spin") for row in rows)
        due += round(t[-1] * 100 + 1) * len(made["balls"])
        lost += round(t[-1] * 100 + 1) * len(made["balls"]) - len(rows)
        start = xy[[row[1] for row in rows].index("cue")]
        np.testing.assert_allclose(start, made["balls"]["cue"]["xy"], atol=0.003)
    assert 0.07 < lost / due < 0.13


def test_options_change_nothing_but_their_own(tmp_path: Path) -> None:
    """Outliers, marks, a noise kept back and effects at zero leave every other sample as it was."""
    options = ["--clips", "2", "--kind", "stun,cut", "--seconds", "1", "--seed", "4"]
    for name, more in (
        ("plain", []),
        ("zero", ["--effect", "clock_scale=1", "--effect", "cue_hop=0", "--hidden", "worn_patch=0"]),
        ("marked", ["--marked"]),
        ("quiet", ["--no-sigma"]),
        ("far", ["--outliers", "0.1"]),
    ):
        assert main([str(tmp_path / name), *options, *more]) == 0
    plain = files(tmp_path / "plain")
    assert files(tmp_path / "zero") == plain
    quiet = files(tmp_path / "quiet")
    assert quiet["clips.toml"].decode() == plain["clips.toml"].decode().replace("sigma = 0.0005\n", "")
    assert {k: v for k, v in quiet.items() if k != "clips.toml"} == {
        k: v for k, v in plain.items() if k != "clips.toml"
    }
    far, marked = files(tmp_path / "far"), files(tmp_path / "marked")
    assert json.loads(far["truth"])["outliers"] == 0.1
    for name in ("clips/0001.csv", "clips/0002.csv"):
        rows, other, seen = (f[name].decode().splitlines()[1:] for f in (plain, far, marked))
        off = sum(a != b for a, b in zip(rows, other, strict=True))
        assert 0.04 < off / len(rows) < 0.2
        assert [row.rsplit(",", 1)[0] for row in rows] == [row.rsplit(",", 1)[0] for row in seen]
        assert all(bool(row.rsplit(",", 1)[1]) == (row.split(",")[1] == "cue") for row in seen)


def test_what_the_truth_says_of_hidden_effects(tmp_path: Path) -> None:
    out = tmp_path / "set"
    hidden = ["--hidden", "drying_cloth=0.2", "--hidden", "ball_cling=1,0.5", "--effect", "clock_scale=1.01"]
    options = ["--clips", "5", "--kind", "stun", "--seconds", "1", "--no-jitter"]
    assert main([str(out), *options, *hidden, "--effect", "cue_ball_mass=1.02"]) == 0
    truth = json.loads(files(out)["truth"])
    assert truth["effects"] == ["cue_ball_mass", "clock_scale", "drying_cloth", "ball_cling"]
    told = {k: truth["parameters"][k] for k in ("wear", "cling", "cling_share", "clock", "cue_mass")}
    assert told == {"wear": 0.2, "cling": 1.0, "cling_share": 0.5, "clock": 1.01, "cue_mass": 1.02}
    assert truth["clips"][4]["mur"] == pytest.approx(1.2 * truth["parameters"]["mur"])
    assert len({clip.get("cling") for clip in truth["clips"]} - {0.0, None}) == 0
    last = [float(line.split(",")[0]) for line in (out / "clips/0001.csv").read_text().splitlines()[1:]]
    assert last[-1] == pytest.approx(119 / 120 * 1.01, abs=0.02)


def test_every_natural_size_is_taken(tmp_path: Path) -> None:
    for name in NATURAL:
        args = parser().parse_args([str(tmp_path), "--seed", "3", *options(name, 1 / 16)])
        assert effects_on(constants(args)) == [name]


def test_clips_without_commands(tmp_path: Path) -> None:
    assert main([str(tmp_path / "set"), "--clips", "2", "--kind", "roll", "--seconds", "1", "--no-cue"]) == 0
    head = tomllib.loads((tmp_path / "set" / "clips.toml").read_text())
    assert all("cue" not in clip for clip in head["clip"])


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--kind", "rol"], "did you mean 'roll'"),
        (["--effect", "tabletilt=0.1"], "did you mean 'table_tilt'"),
        (["--effect", "table_tilt=1,2,3"], "at most 2: tilt_x, tilt_y"),
        (["--effect", "table_tilt"], "NAME=VALUE"),
        (["--constant", "mus=-0.1"], "mus=-0.1: expected 0"),
        (["--constant", "ec=nan"], "finite"),
        (["--hidden", "wornpatch=0.1"], "did you mean 'worn_patch'"),
        (["--hidden", "dead_cushion=0.1"], "unknown effect 'dead_cushion'"),
        (["--outliers", "0.7"], "--outliers 0.7"),
        (["--clips", "0"], "--clips 0"),
        (["--diameter", "5"], "--diameter 5"),
        (["--fps", "nan"], "--fps nan"),
        (["--kind", "long", "--seconds", "0.03"], "film longer"),
    ],
)
def test_bad_input_is_told_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], says: str
) -> None:
    assert main([str(tmp_path / "set"), *options]) == 2
    assert says in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_only_a_clip_set_is_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--clips", "1", "--kind", "roll", "--seconds", "1"]
    out = tmp_path / "set"
    assert main([str(out), *options]) == 0
    assert main([str(out), *options]) == 2
    assert "--force" in capsys.readouterr().err
    assert main([str(out), *options, "--force"]) == 0
    (out / "clips.toml").unlink()
    assert main([str(out), *options, "--force"]) == 2
    assert (out / "clips").is_dir()


def test_the_shipped_example_is_what_its_script_makes(tmp_path: Path) -> None:
    shipped = ROOT / "sysid" / "example"
    make_example(tmp_path / "example")
    made, kept = files(tmp_path / "example"), files(shipped)
    assert made.keys() == kept.keys()
    assert made["clips.toml"] == kept["clips.toml"]
    for name in (n for n in made if n.startswith("clips/")):
        # Another machine may round the last printed digit otherwise.
        one, other = ([line.split(",") for line in f[name].decode().splitlines()[1:]] for f in (made, kept))
        assert [row[:2] for row in one] == [row[:2] for row in other]
        places = [np.array([[float(row[2]), float(row[3])] for row in rows]) for rows in (one, other)]
        np.testing.assert_allclose(places[0], places[1], atol=2e-6)
    truth = json.loads(kept["truth"])
    assert truth["effects"] == [EXAMPLE_HIDES]
    assert NATURAL[EXAMPLE_HIDES].items() <= truth["parameters"].items()
    assert [clip["kind"] for clip in truth["clips"]] == list(EXAMPLE)
    meets = [bool(clip["events"]) for clip in truth["clips"]]
    assert meets == [kind.startswith(("cut", "cushion")) for kind in EXAMPLE]
    assert sum(map(len, kept.values())) < 500_000
