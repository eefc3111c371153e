"""Direct measurements against the independent generator: values, uncertainties, warnings, and what the command says."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.commands.console import Progress
from models.model_file import Estimate, full_model, read_model, write_model
from models.shot import GRAVITY, Ball, Table
from sysid.cli.identification.measure import measure as cli_measure
from sysid.clips import read_clip_set
from sysid.direct.cushion import CUSHION_RATIO
from sysid.direct.deceleration import fit_deceleration
from sysid.direct.friction import ROLL_FRICTION, SLIDE_FRICTION
from sysid.direct.measure import measure
from sysid.direct.measured import Measured, Measurements, Single, combine, regress
from sysid.direct.slide_roll import fit_slide_roll, positions
from tests.support.clip_samples import make, refusal
from tests.truth import physics
from tests.truth.__main__ import main as generate
from tests.truth.cloth import Constants

EXAMPLE = Path(__file__).parents[3] / "sysid" / "example"
CONSTANTS = {
    "decoupled_cloth.slide": "mus", "decoupled_cloth.roll": "mur", "decoupled_cloth.spin": "spin",
    "ball_impact.restitution": "ebb", "cushion_impact.restitution": "ec", "cushion_impact.friction": "muc",
}  # fmt: skip


def clips(folder: Path, seed: int, count: int, *words: str) -> Path:
    """A clip set of the independent generator."""
    assert generate([str(folder), "--seed", str(seed), "--clips", str(count), "--seconds", "2.5", *words]) == 0
    return folder


def truth_of(folder: Path) -> dict[str, Any]:
    values: dict[str, Any] = json.loads(Path(f"{folder}.truth.json").read_text())
    return values


def named(found: Measurements) -> dict[str, Measured]:
    return {one.kind.name: one for one in found.all}


def check(one: Measured, truth: float, rel: float, sds: float = 3.0) -> None:
    assert one.value is not None
    assert one.sd is not None
    assert one.value == pytest.approx(truth, rel=rel)
    assert abs(one.value - truth) < sds * one.sd


@pytest.fixture(scope="module")
def cloth(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return clips(tmp_path_factory.mktemp("cloth") / "set", 61, 6, "--kind", "roll,stun,draw,follow")


@pytest.fixture(scope="module")
def rails(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return clips(tmp_path_factory.mktemp("rails") / "set", 62, 11, "--kind", "cushion,cushion,cushion_side")


def test_a_run_is_the_closed_form_of_sliding_and_rolling() -> None:
    """Golden values of the decoupled law: where balls begin to roll, and how fast (mu_s 0.212, R 26.25 mm)."""
    radius, slide = 0.02625, 0.212 * GRAVITY
    for v, w, last, place, then in (
        ((2.0, 0.0), (30.0, 0.0), 0.295295, (0.506219, -0.033221), (1.428571, -0.225)),
        ((1.5, 0.5), (-20.0, -40.0), 0.350339, (0.397885, 0.176421), (0.771429, 0.507143)),
        ((1.0, 0.0), (0.0, 60.0), 0.078994, (0.085483, 0.0), (1.164286, 0.0)),
    ):
        slip = np.array([v[0] - radius * w[1], v[1] + radius * w[0]])
        p = np.array([0, 0, *v, *(-2 / 7 * slip), np.log(slide), np.log(0.0127 * GRAVITY), 0.0])
        at = positions(p[None], np.array([last, last + 1e-6]))[0]
        assert at[0] == pytest.approx(place, abs=2e-6)
        assert np.diff(at, axis=0)[0] / 1e-6 == pytest.approx(then, abs=1e-5)
        t = np.linspace(0, 1.5, 120)
        run = fit_slide_roll(t, positions(p[None], t)[0], 1e-5)
        assert run.parameters == pytest.approx(p, abs=1e-4)
        assert run.slide_duration()[0] == pytest.approx(last, abs=1e-4)
    still = positions(p[None], np.array([20.0, 30.0]))[0]
    assert still[0] == pytest.approx(still[1])  # it has come to rest


def test_a_deceleration_ends_in_a_stop() -> None:
    t = np.linspace(0.2, 6.0, 600)
    u = np.minimum(t - 0.2, 0.6 / 0.125)
    found = fit_deceleration(t, 3.0 + 0.6 * u - 0.0625 * u**2, 1e-5, 1e-3)
    assert found is not None
    assert (found.speed, found.rate, found.slope) == pytest.approx((0.6, 0.125, 0.0), abs=1e-6)
    assert fit_deceleration(t, 0.3 * t**2, 1e-5, 1e-3) is None
    assert fit_deceleration(t, np.full_like(t, 2.0), 1e-5, 1e-3) is None


def test_values_that_disagree_widen_the_sd_and_a_stray_one_is_left_out() -> None:
    rng = np.random.default_rng(4)
    s = np.full(20, 0.01)

    def combined(y: np.ndarray[Any, Any]) -> Measured:
        return combine(SLIDE_FRICTION, [Single("c", "b", 0.0, float(v), float(k)) for v, k in zip(y, s, strict=True)])

    agreeing, wild = combined(2.0 + s * rng.normal(size=20)), combined(2.0 + 0.1 * rng.normal(size=20))
    assert agreeing.sd == pytest.approx(0.01 / np.sqrt(20) / GRAVITY, rel=0.3)
    assert wild.sd == pytest.approx(0.1 / np.sqrt(20) / GRAVITY, rel=0.5)
    assert wild.scatter == pytest.approx(0.1 / GRAVITY, rel=0.5)
    assert any("differ by more than their errors" in w for w in wild.warnings)
    stray = combined(np.concatenate([2.0 + s[1:] * rng.normal(size=19), [3.0]]))
    check(stray, 2.0 / GRAVITY, 0.01)
    assert stray.count == 19
    assert any("1 of 20 segments are outliers" in w for w in stray.warnings)
    two = combine(SLIDE_FRICTION, stray.singles[:2])
    assert any("only 2 segments" in w for w in two.warnings)
    none = combine(SLIDE_FRICTION, [])
    assert (none.value, none.sd, none.count) == (None, None, 0)
    assert "not determined" in none.warnings[0]


def test_a_regression_covers_the_truth() -> None:
    """With scatter and a few strays the mean lies within its 95 % interval as often as it should."""
    rng, inside = np.random.default_rng(8), 0
    for _ in range(200):
        s = rng.uniform(0.01, 0.2, 15)
        y = 1.0 + np.hypot(s, 0.1) * rng.normal(size=15)
        y[0] += 1.0
        value, cov, _ = regress(y, s, np.ones((15, 1)))
        inside += abs(value[0] - 1.0) < 1.96 * np.sqrt(cov[0, 0])
    assert inside > 0.85 * 200


def test_the_slope_of_the_table_is_separated_from_friction() -> None:
    rng = np.random.default_rng(2)
    way = rng.uniform(-np.pi, np.pi, 20)
    y = 0.12 - 0.01 * np.cos(way - 1.0) + 0.0005 * rng.normal(size=20)
    one = combine(ROLL_FRICTION, [Single("c", "b", 0.0, v, 0.0005, 0.5, w) for v, w in zip(y, way, strict=True)])
    check(one, 0.12 / GRAVITY, 0.005)
    (told,) = (w for w in one.warnings if "varies with heading by 0.01" in w)
    toward = float(told.partition("towards ")[2].partition(" deg")[0])
    assert toward == pytest.approx(np.degrees(1.0), abs=3)


def test_sliding_and_rolling_friction(cloth: Path) -> None:
    found, truth = named(measure(read_clip_set(cloth))), truth_of(cloth)["parameters"]
    check(found["decoupled_cloth.roll"], truth["mur"], 0.01)
    check(found["decoupled_cloth.slide"], truth["mus"], 0.03)
    assert found["decoupled_cloth.roll"].count >= 6
    assert found["decoupled_cloth.spin"].value is None  # no mark was seen
    for one in found.values():
        assert not any("varies" in w for w in one.warnings)


def test_sidespin_on_the_spot_and_on_the_way(tmp_path: Path) -> None:
    folder = clips(tmp_path / "set", 63, 4, "--kind", "spin,side", "--marked")
    spin = named(measure(read_clip_set(folder)))["decoupled_cloth.spin"]
    check(spin, truth_of(folder)["parameters"]["spin"], 0.02)
    assert spin.count >= 4


def test_balls_give_back_what_they_do(tmp_path: Path) -> None:
    folder = clips(tmp_path / "set", 64, 9, "--kind", "cut,cut_side", "--seconds", "1.6")
    ball = named(measure(read_clip_set(folder)))["ball_impact.restitution"]
    check(ball, truth_of(folder)["parameters"]["ebb"], 0.02)
    assert ball.count >= 6
    assert not any("varies" in w for w in ball.warnings)


def test_cushions_apparent_and_energetic(rails: Path) -> None:
    clip_set, truth = read_clip_set(rails), truth_of(rails)
    found = named(measure(clip_set))
    check(found["cushion_impact.restitution"], truth["parameters"]["ec"], 0.02)
    check(found["cushion_impact.friction"], truth["parameters"]["muc"], 0.1)
    ratio = found[CUSHION_RATIO.name]
    own = np.array([true_ratio(truth, clip_set.table, s) for s in ratio.singles])
    assert len(own) >= 3
    assert ratio.value == pytest.approx(float(own.mean()), rel=0.02)
    assert all(abs(s.value - w) < 4 * s.sd for s, w in zip(ratio.singles, own, strict=True))
    assert ratio.value is not None
    assert ratio.value < found["cushion_impact.restitution"].value - 0.03  # type: ignore[operator]


def true_ratio(truth: dict[str, Any], table: Table, single: Single) -> float:
    """Normal velocity after over before that the truth's own motion has at a rebound."""
    clip = next(c for c in truth["clips"] if c["file"] == single.clip)
    event = min((e for e in clip["events"] if e["kind"] == "cushion"), key=lambda e: abs(e["time"] - single.time))
    assert abs(event["time"] - single.time) < 0.003
    short = {"R": "radius", "m": "mass"}
    constants = Constants(**{short.get(k, k): v for k, v in truth["parameters"].items()})
    balls = {name: physics.Start(**{k: tuple(v) for k, v in b.items()}) for name, b in clip["balls"].items()}
    times = np.array([event["time"] - 1e-4, event["time"] + 1e-4])
    motion = physics.simulate(physics.Table(table.length, table.width, table.pockets), constants, balls, times)
    before, after = motion.velocity[:, motion.names.index(single.ball), "xy".index(event["rail"][1])]
    return -float(after / before)


def test_a_deceleration_that_grows_with_speed_is_reported(tmp_path: Path) -> None:
    folder = clips(tmp_path / "set", 65, 8, "--effect", "speed_drag=0.035", "--kind", "roll,follow,stun,cushion")
    roll = named(measure(read_clip_set(folder)))["decoupled_cloth.roll"]
    assert any("varies with speed" in w and "speed_drag" in w for w in roll.warnings)
    assert roll.slope == pytest.approx(0.035, rel=0.1)
    assert roll.value is not None
    at_rest = roll.value - roll.slope * roll.speed / GRAVITY
    assert at_rest == pytest.approx(truth_of(folder)["parameters"]["mur"], rel=0.02)


@pytest.mark.slow
def test_other_constants_that_grow_with_speed_are_reported(tmp_path: Path) -> None:
    for k, (effect, words, name) in enumerate((
        ("cushion_restitution_speed=0.09", ("--kind", "cushion,cushion_side"), "cushion_impact.restitution"),
        ("spin_decay_speed=0.4", ("--kind", "side,spin", "--marked"), "decoupled_cloth.spin"),
    )):  # fmt: skip
        found = named(measure(read_clip_set(clips(tmp_path / str(k), 66, 16, "--effect", effect, *words))))
        assert any("varies with speed" in w for w in found[name].warnings), name
        assert not any("varies" in w for w in found["decoupled_cloth.roll"].warnings)


@pytest.mark.slow
def test_the_uncertainties_cover_the_truth(tmp_path: Path) -> None:
    """Over several tables with all kinds of shots nothing lies beyond three standard deviations, most within one."""
    away: list[float] = []
    for seed in range(100, 106):
        folder = clips(tmp_path / str(seed), seed, 12)
        found, truth = named(measure(read_clip_set(folder))), truth_of(folder)["parameters"]
        for name, key in CONSTANTS.items():
            one = found[name]
            if one.value is not None and one.sd is not None:
                away.append((one.value - truth[key]) / one.sd)
                assert abs(away[-1]) < 3, (seed, name)
        assert not any("varies" in w for one in found.values() for w in one.warnings)
    assert len(away) > 25
    assert 0.3 < float(np.sqrt(np.mean(np.square(away)))) < 1.5


def test_noise_unknown_frames_missing_no_commands(tmp_path: Path) -> None:
    words = ("--no-sigma", "--no-cue", "--missing", "0.15", "--kind", "stun,roll")
    folder = clips(tmp_path / "set", 67, 6, *words)
    found, truth = named(measure(read_clip_set(folder))), truth_of(folder)["parameters"]
    check(found["decoupled_cloth.roll"], truth["mur"], 0.01)
    check(found["decoupled_cloth.slide"], truth["mus"], 0.03)


def command(*words: str) -> int:
    """The verb as the command line runs it."""
    return int(cli_measure.main(words, standalone_mode=False, obj=Progress()))


def test_the_command_prints_and_writes(cloth: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told, model, drawn = (tmp_path / name for name in ("m.json", "m.toml", "m.png"))
    words = ("--json", str(told), "--out", str(model), "--report", str(drawn))
    assert command(str(cloth), *words) == 0
    said = capsys.readouterr().out
    assert "decoupled_cloth.roll" in said
    assert "cushion velocity ratio" in said
    assert "not determined by these clips: film a marked ball" in said
    first = (told.read_bytes(), model.read_bytes(), drawn.read_bytes())
    assert command(str(cloth), *words) == 0
    assert (told.read_bytes(), model.read_bytes(), drawn.read_bytes()) == first
    assert first[2].startswith(b"\x89PNG")
    data = json.loads(told.read_text())
    assert data["format"] == "billiard-measurement/1"
    rows = {m["name"]: m for m in data["measured"]}
    roll, spin = rows["decoupled_cloth.roll"], rows["decoupled_cloth.spin"]
    assert spin["value"] is None
    assert len(roll["singles"]) == roll["count"]
    assert np.median([s["value"] for s in roll["singles"]]) == pytest.approx(roll["value"], rel=0.03)
    start = read_model(model)
    assert start.parameters()["decoupled_cloth.roll"] == pytest.approx(roll["value"])
    assert start.estimates["decoupled_cloth.roll"].sd == pytest.approx(roll["sd"])
    assert "sysid measure" in start.estimates["decoupled_cloth.roll"].source
    plain = full_model(start.table, start.ball).parameters()
    assert start.parameters()["decoupled_cloth.spin"] == plain["decoupled_cloth.spin"]


def test_a_fitted_model_is_held_against_it(cloth: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    clip_set, truth = read_clip_set(cloth), truth_of(cloth)["parameters"]
    model = full_model(clip_set.table, clip_set.ball)
    model = model.with_values({"decoupled_cloth.roll": truth["mur"], "decoupled_cloth.slide": 1.3 * truth["mus"]})
    model = dataclasses.replace(model, estimates={"decoupled_cloth.roll": Estimate(1e-5, "here")})
    file, out = tmp_path / "m.toml", tmp_path / "m.json"
    write_model(model, file)
    assert command(str(cloth), "--model", str(file), "--json", str(out)) == 0
    said = capsys.readouterr().out
    assert "apart" in said
    assert "decoupled_cloth.slide: measurement and model are" in said
    assert "decoupled_cloth.roll: measurement and model are" not in said
    rows = {m["name"]: m for m in json.loads(out.read_text())["measured"]}
    assert abs(rows["decoupled_cloth.roll"]["sds_apart"]) < 3
    assert rows["decoupled_cloth.slide"]["sds_apart"] < -5
    assert "model" not in rows["cushion velocity ratio"]


def test_nothing_to_measure_and_bad_input(cloth: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    small, out = make(tmp_path / "small"), tmp_path / "m.toml"
    assert command(str(small), "--out", str(out)) == 1
    assert "nothing could be measured" in capsys.readouterr().out
    assert not out.exists()
    assert "no such folder" in refusal(lambda: command(str(tmp_path / "none")))
    assert "folder does not exist" in refusal(lambda: command(str(cloth), "--out", str(tmp_path / "no" / "m.toml")))
    other = tmp_path / "other.toml"
    write_model(full_model(Table(2.84, 1.42), Ball(0.0615, 0.21)), other)
    assert "not those of" in refusal(lambda: command(str(cloth), "--model", str(other)))


def test_the_shipped_example() -> None:
    """A tilted table: friction is found beside the tilt, which is reported, as balls are pushed downhill."""
    found = named(measure(read_clip_set(EXAMPLE)))
    truth = json.loads((EXAMPLE.parent / "example.truth.json").read_text())["parameters"]
    check(found["decoupled_cloth.roll"], truth["mur"], 0.01)
    check(found["decoupled_cloth.slide"], truth["mus"], 0.03)
    check(found["decoupled_cloth.spin"], truth["spin"], 0.02)
    check(found["ball_impact.restitution"], truth["ebb"], 0.05)
    told = " ".join(found["decoupled_cloth.roll"].warnings)
    assert "varies with heading" in told
    assert "towards -66 deg" in told


@pytest.mark.slow
@pytest.mark.thorough
def test_a_real_match(data_folder: Path) -> None:
    """Three-cushion shots at 50 frames a second: deceleration that grows with speed, as free fits of segments show."""
    found = named(measure(read_clip_set(data_folder / "carom-match")))
    roll = found["decoupled_cloth.roll"]
    assert roll.value is not None
    for speed, known in ((0.15, 0.040), (0.8, 0.052)):
        assert roll.value * GRAVITY + roll.slope * (speed - roll.speed) == pytest.approx(known, abs=0.003)
    assert any("varies with speed" in w for w in roll.warnings)
    assert found["decoupled_cloth.slide"].value == pytest.approx(0.205, abs=0.01)
    hit = found["ball_impact.restitution"]  # few impacts, at 50 frames a second
    assert hit.sd < 0.05 and abs(hit.value - 0.96) < 2 * hit.sd
