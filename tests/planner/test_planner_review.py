"""`planner review`: the recording of a plan from its file."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from models.recording.plan import write_plan
from planner.cli.verbs import main
from tests.support.plan_samples import sample
from tests.support.reviewed_clips import column, read


def test_a_plan_file_is_shown_whole(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = sample()
    (tmp_path / "plan.json").write_text(json.dumps(plan), encoding="utf-8")
    assert main(["review", str(tmp_path / "plan.json"), "--save", str(tmp_path / "r.rrd")]) == 0
    assert f"recording: {tmp_path / 'r.rrd'} (open it with: " in capsys.readouterr().out
    write_plan(tmp_path / "direct.rrd", plan, title="The plan plan.json")
    shown, direct = read(tmp_path / "r.rrd"), read(tmp_path / "direct.rrd")
    assert shown.keys() == direct.keys()
    assert {"/top/rest/potted", "/top/rest/outline", "/text/alternatives"} <= shown.keys()
    assert any(path.startswith("/top/alternative/1/ball") for path in shown)
    pages = [column(one["/text/plan"], "TextDocument:text") for one in (shown, direct)]
    assert pages[0] == pages[1]


def test_what_is_no_plan_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "plan.json").write_text('{"format": "billiard-scene/1"}', encoding="utf-8")
    assert main(["review", str(tmp_path / "plan.json"), "--save", str(tmp_path / "r.rrd")]) == 2
    assert "plan.json" in capsys.readouterr().err and not (tmp_path / "r.rrd").exists()
