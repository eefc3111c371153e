"""The examples of the manual: each runs, and says what it is for."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
SAYS = {
    "own_loop": r"at rest after \d+\.\d+ s; the hardest contact took \d{3,5} N",
    "batch": r"red +\+\d+\.\d mm aside: at \[.* after 1\.5 s",
    "paddle": r"paddle at -?0\.\d+ m, white at 0\.\d+ m",
    "launcher": r"cue 1\.[45]\d+ m/s, ball 1\.\d+ m/s, squirt 0\.\d+ degrees, tip \d{3} N\nthe slate bears \d\.\d+ N",
    "gymnasium_env": r"reward -?\d\.\d+; white stopped at \[",
    "dm_control_task": r"the red has moved 0\.[3-9]\d m",
    "viewer": r"red after the shot: \[",
    "physics": r"a picture of \(360, 640, 3\)",
}


def test_each_example_is_run_here() -> None:
    assert {path.stem for path in EXAMPLES.glob("*.py")} == set(SAYS)


@pytest.mark.parametrize(
    "name", ["own_loop", "batch", "paddle", "launcher", "viewer", "gymnasium_env", "dm_control_task"]
)
def test_an_example_runs(name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    if name == "gymnasium_env":
        pytest.importorskip("shimmy", reason="needs the extra gym: pip install -e '.[gym]'")
    monkeypatch.chdir(EXAMPLES.parents[1])
    for name_of_display in ("DISPLAY", "WAYLAND_DISPLAY"):  # no window opens
        monkeypatch.delenv(name_of_display, raising=False)
    runpy.run_path(str(EXAMPLES / f"{name}.py"))
    assert re.search(SAYS[name], capsys.readouterr().out)


def test_a_picture_is_drawn(gl: str, capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(EXAMPLES / "physics.py"))
    assert re.search(SAYS["physics"], capsys.readouterr().out)
