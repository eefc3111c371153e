"""The study of how reliably hidden effects are found: its plan, its judgement, its bookkeeping."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from models.commands.console import write_json
from models.effect_catalogue import catalogue
from tests.study import __main__ as command
from tests.study import run
from tests.study.judge import BASE, EFFECT_TRUTH, RIGHT, Row
from tests.study.plan import CLIPS, GROUPS, LONG, MIXES, NONE, PAIRS, VARIATIONS, Entry, plan
from tests.study.report import rate, text
from tests.truth.__main__ import constants, parser
from tests.truth.effects import EFFECTS, STRUCTURES

RIGHTLY: dict[str, dict[str, Any]] = {  # what a discovery would say
    "crowned_slate": {"where": "everywhere on the cloth", "depends_on": ["place"]},
    "drying_cloth": {"where": "rolling on the cloth", "depends_on": ["order of the clips"]},
    "ball_cling": {"where": "collisions of balls", "depends_on": ["order of the clips"]},
    "soft_rail_ends": {"where": "all cushions, along their length", "depends_on": ["place"]},
    "slow_drag": {"where": "rolling on the cloth", "depends_on": ["speed"]},
    "camera_shake": {"where": "in the camera's image", "depends_on": ["time"]},
}


def perfect(entry: Entry, mark: str = "m") -> dict[str, Any]:
    """The result of a set on which all went right."""
    truth = constants(parser().parse_args(["out", *entry.words()]))._asdict()
    values = {name: truth[constant] for name, constant in BASE.items()}
    told = None
    if entry.group == "outside":
        told = dict(RIGHTLY[entry.hidden[0]])
    else:
        values |= {f"{e}.{k.key}": k.true(truth) for e in entry.hidden for k in EFFECT_TRUTH[e]}
    found = [] if told else list(entry.hidden)
    ladder = [{"effects": found[:k], "chi2_reduced": 1.2, "held_out_rms_m": 0.0005} for k in range(len(found) + 1)]
    return run.head(entry, mark) | {
        "error": None, "truth": truth, "verdict": found, "unexplained": told, "ladder": ladder, "converged": True,
        "parameters": {k: {"value": v, "sd": 0.01 * abs(v) + 1e-9, "unit": ""} for k, v in values.items()},
        "rounds": [], "noise_floor_m": 0.0005, "elapsed_s": 10.0,
    }  # fmt: skip


def figure(report: str, name: str) -> str:
    """What the report measured, of a row of its table."""
    row = next(line for line in report.splitlines() if line.startswith(f"| {name}"))
    return row.split(" | ")[2]


def test_plan_is_well_formed() -> None:
    entries = plan()
    assert len({e.name for e in entries}) == len({e.seed for e in entries}) == len({e.words() for e in entries})
    assert {e.group for e in entries[: len(GROUPS) + 2]} == set(GROUPS)
    none = [e for e in entries if e.group == "none"]
    assert len(none) == NONE and sum(bool(e.variation) for e in none) == NONE // 3
    assert {e.variation for e in none} == {"", *VARIATIONS}
    for group, times in (("natural", 3), ("quarter", 3), ("sixteenth", 2)):
        assert sorted(e.hidden[0] for e in entries if e.group == group) == sorted([*EFFECTS] * times)
    assert sorted(e.hidden[0] for e in entries if e.group == "outside") == sorted([*STRUCTURES] * 2)
    soiled = [e.hidden for e in entries if e.group == "soiled"]
    assert sorted(soiled) == sorted([()] * 12 + [(effect,) for effect in EFFECTS] + list(PAIRS[:6]))
    assert [e.hidden for e in entries if e.group == "long"] == [(effect,) for effect in LONG]
    assert len(PAIRS) == 15 and {effect for pair in PAIRS for effect in pair} <= set(EFFECTS)
    for entry in entries:
        assert len(entry.kinds) in (0, CLIPS) or entry.group == "long"
    cuts, sides = (mix.kinds for mix in MIXES)
    assert sum(k.startswith("cut") for k in cuts) == CLIPS // 2
    assert sum(k.endswith("side") or k == "swerve" for k in sides) == CLIPS * 7 // 12


def test_the_generator_takes_every_set_and_hides_what_the_plan_says() -> None:
    from tests.truth.write import effects_on

    for entry in plan():
        args = parser().parse_args(["out", *entry.words()])
        assert set(effects_on(constants(args))) == set(entry.hidden), entry.name
        assert args.seed == entry.seed and args.clips == entry.clips and args.seconds == 4.0


def test_every_effect_is_known_by_the_parameters_of_its_model() -> None:
    assert set(EFFECT_TRUTH) == set(EFFECTS) and set(RIGHT) == set(STRUCTURES)
    for effect, known in EFFECT_TRUTH.items():
        declared = catalogue()[effect].parameters()
        assert {k.key for k in known} == set(declared)
        assert known[0].off == declared[known[0].key]["off"]
    for name in BASE:
        effect, key = name.split(".")
        assert key in catalogue()[effect].parameters()


@pytest.mark.slow
def test_a_study_without_a_fault_is_reported_as_such() -> None:
    entries = plan()
    results = [perfect(e) for e in entries]
    report = text(results, len(entries))
    for name in ("the hidden effect is the verdict", "the same at a quarter", "the same at a sixteenth", "two hidden",
                 "outside the catalogue: reported as unexplained, with", "coverage of the 95 % interval, effects",
                 "coverage of the 95 % interval, constants"):  # fmt: skip
        assert "= 100 %" in figure(report, name), name
    assert figure(report, "false alarms").startswith(f"0/{NONE} = 0 %")
    assert figure(report, "size of the effect").startswith("0.0 %")
    assert figure(report, "error on held-out").startswith("median 1.000")
    assert "## Misses (0)" in report
    assert text(results[::-1], len(entries)) == report


def test_faults_show_in_the_report() -> None:
    entries = {e.name: e for e in plan()}
    results = {name: perfect(e) for name, e in entries.items()}
    results["none-01"]["verdict"] = ["air_drag"]
    results["none-02"]["unexplained"] = RIGHTLY["slow_drag"]
    results["none-04"] = run.failed(entries["none-04"], "m", "ValueError: it broke", 3.0)
    results["natural-speed_drag-1"]["verdict"] = ["air_drag"]
    results["natural-table_tilt-1"]["verdict"] = ["table_tilt", "cloth_nap"]
    results["quarter-cue_hop-1"]["verdict"] = []
    results["quarter-squirt-1"]["verdict"] = []
    results["quarter-squirt-1"]["ladder"][0]["chi2_reduced"] = 1.01
    results["two-table_tilt-speed_drag"]["verdict"] = ["speed_drag"]
    results["outside-slow_drag-1"] |= {"verdict": ["table_tilt"], "unexplained": None}
    report = text(list(results.values()), len(entries))
    sets = 3 * len(EFFECTS)
    assert figure(report, "the hidden effect is the verdict").startswith(f"{sets - 2}/{sets}")
    assert figure(report, "the same at a quarter").startswith(f"{sets - 2}/{sets - 1}")
    assert figure(report, "false alarms").startswith(f"3/{NONE}")
    assert figure(report, "two hidden effects, both named").startswith("14/15")
    assert figure(report, "outside the catalogue: reported as unexplained, with").startswith("11/12")
    assert figure(report, "outside the catalogue: a wrong effect").startswith("1/12")
    misses = report.split("## Misses")[1]
    assert misses.startswith(" (8)") and "* none-04: failed: ValueError: it broke" in misses
    assert "quarter-squirt-1" not in misses and "speed_drag was not tried" in misses
    matrix = report.split("### Natural size")[1].split("###")[0]
    assert "3 speed_drag" in matrix and "4 air_drag" in matrix


def test_sizes_and_intervals_can_be_wrong() -> None:
    entries = [e for e in plan() if e.name.startswith("natural-air_drag")]
    results = [perfect(e) for e in entries]
    for result in results:
        result["parameters"]["air_drag.rate"] |= {"value": 0.03, "sd": 0.001}
        result["parameters"]["decoupled_cloth.slide"]["value"] *= 1.05
        result["ladder"][-1]["held_out_rms_m"] = 0.0006
    report = text(results, 3)
    assert figure(report, "size of the effect").startswith("50.0 %")
    assert figure(report, "coverage of the 95 % interval, effects").startswith("0/3")
    assert figure(report, "coverage of the 95 % interval, constants").startswith("18/21")
    assert figure(report, "error on held-out").startswith("median 1.200; 0/3")


@pytest.mark.parametrize("name", STRUCTURES)
def test_another_place_is_not_right(name: str) -> None:
    entry = next(e for e in plan() if e.hidden == (name,))
    result = perfect(entry)
    assert Row(result).right_place
    result["unexplained"] = {"where": "somewhere", "depends_on": ["nothing"]}
    assert not Row(result).right_place
    others = [told for other, told in RIGHTLY.items() if other != name]
    assert not all(Row(result | {"unexplained": told}).right_place for told in others)


def test_rates_carry_their_interval() -> None:
    assert rate(0, 0) == "-"
    assert rate(30, 30) == "30/30 = 100 % (89 to 100)"


def test_fingerprint_follows_the_sources(tmp_path: Path) -> None:
    for folder in run.SOURCES:
        (tmp_path / folder / "deeper").mkdir(parents=True)
        (tmp_path / folder / "deeper" / "a.py").write_text("a = 1\n")
    marks = [run.fingerprint(tmp_path)]
    (tmp_path / "models" / "notes.txt").write_text("no source")
    assert run.fingerprint(tmp_path) == marks[0]
    for folder in run.SOURCES:
        (tmp_path / folder / "deeper" / "a.py").write_text("a = 2\n")
        marks.append(run.fingerprint(tmp_path))
    (tmp_path / "sysid" / "deeper" / "a.py").rename(tmp_path / "sysid" / "a.py")
    marks.append(run.fingerprint(tmp_path))
    assert len(set(marks)) == len(marks)


def keep_result(out: Path, result: dict[str, Any]) -> None:
    """Write a result where the study looks for it."""
    path = run.result_path(result["name"], out)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(str(path), result)


def test_a_study_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    a, b, c, d, *_ = plan()
    mark = run.fingerprint()
    keep_result(tmp_path, perfect(a, mark))
    keep_result(tmp_path, perfect(b, "of other sources"))
    keep_result(tmp_path, perfect(replace(c, seed=1), mark))
    run.result_path(d.name, tmp_path).write_text('{"format": "billiard-st')
    seen: list[str] = []

    def run_all(todo: Sequence[Entry], *rest: object) -> int:
        seen[:] = [e.name for e in todo]
        return 0

    monkeypatch.setattr(command, "run_all", run_all)
    where = ["--out", str(tmp_path), "--report", str(tmp_path / "r.md")]
    assert command.main(where) == 0
    assert a.name not in seen and {b.name, c.name, d.name} <= set(seen)
    assert command.main([*where, "--keep"]) == 0
    assert b.name not in seen and {c.name, d.name} <= set(seen)
    assert "are mixed here" in (tmp_path / "r.md").read_text()
    assert command.main([*where, "--only", "squirt", "--limit", "2"]) == 0
    assert len(seen) == 2 and all("squirt" in name for name in seen)
    assert command.main([*where, "--only", "nothing-like-it"]) == 2


def test_an_interrupted_study_says_that_results_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    keep_result(tmp_path, perfect(plan()[0], run.fingerprint()))

    def run_all(*args: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "run_all", run_all)
    assert command.main(["--out", str(tmp_path), "--report", str(tmp_path / "r.md")]) == command.INTERRUPTED
    assert "finished sets are kept" in capsys.readouterr().err
    assert (tmp_path / "r.md").is_file()


def test_what_the_engine_raises_is_a_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(entry: Entry, out: Path) -> Path:
        raise ValueError("no such\nluck")

    monkeypatch.setattr(run, "made", broken)
    result = run.study_one(plan()[0], tmp_path)
    assert result is not None and "ValueError" in result["error"] and result["error"].endswith("no such luck")
    assert Row(result).alarm and "no such luck" in text([result], 1)


@pytest.mark.parametrize(("limit", "said"), [(0.0, "not done after 0 minutes"), (60.0, "StopIteration")])
def test_a_set_without_an_end_or_a_result_is_a_miss(tmp_path: Path, limit: float, said: str) -> None:
    entry = replace(plan()[0], name="none-of-the-plan")
    running = run.Running(entry, "m", tmp_path, limit)
    with run.stopped_in_the_end([running]):
        while not running.done():
            time.sleep(0.05)
    result = json.loads(run.result_path(entry.name, tmp_path).read_text())
    assert said in result["error"] and result["fingerprint"] == "m"
    assert running.process.poll() is not None and not list((tmp_path / "results").glob(".*"))


def test_a_set_is_made_once_for_the_same_generator(tmp_path: Path) -> None:
    entry = replace(plan()[0], clips=1)
    folder = run.made(entry, tmp_path)
    first = (folder / "clips.toml").stat().st_mtime_ns
    assert (run.made(entry, tmp_path) / "clips.toml").stat().st_mtime_ns == first
    run.made(replace(entry, seed=77), tmp_path)
    assert json.loads((tmp_path / "sets" / f"{entry.name}.truth.json").read_text())["seed"] == 77


def test_sets_run_on_a_cluster_are_kept_as_those_run_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its workers stand in for themselves here: one thread of this process."""
    entry, mark = plan()[1], run.fingerprint()
    marks = [mark, "of other sources"]

    class Workers:
        def as_they_come(self, function: object, tasks: Sequence[tuple[str]]) -> Iterator[tuple[int, dict[str, Any]]]:
            assert function is run.study_there and tasks == [(entry.name,)]
            yield 0, perfect(entry, marks.pop(0))

    monkeypatch.setattr(command, "open_workers", lambda address, jobs: nullcontext(Workers()))
    words = ["--only", entry.name, "--out", str(tmp_path), "--report", str(tmp_path / "r.md"), "--scheduler", "there:1"]
    assert command.main(words) == 0
    assert run.valid(entry, run.read_result(entry.name, tmp_path), mark)
    run.result_path(entry.name, tmp_path).unlink()
    assert command.main(words) == 2
    assert "there:1: a worker has other sources" in capsys.readouterr().err
    assert run.read_result(entry.name, tmp_path) is None


def test_a_set_that_takes_too_long_on_a_worker_is_a_miss() -> None:
    result = run.study_there(plan()[1].name, limit=0.0)
    assert result["error"] == "not done after 0 minutes" and result["name"] == plan()[1].name
