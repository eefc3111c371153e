"""What an interrupted run leaves: answered once more, and never trusted."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from sysid.estimation.solver.journal import Array, Journal, recorded, recorded_in
from sysid.estimation.solver.least_squares import Objective, Prior, fit_each

STARTS = np.array([[0.1], [0.4]])
LINES = {
    "deep": "[" * 5000,
    "digits": "1" * 5000,
    "another question": '{"asked": "00", "elapsed_s": 1.0, "numbers": [[0.5, 0.5], [0.0, 0.0]]}',
    "no object": "[1]",
    "lone surrogate": '{"asked": "\\ud800"}',
}


def run(path: Path, fingerprint: str = "a", stop: int = 99) -> tuple[list[Array], int]:
    """Three fits to a parabola, answered by a journal; and how often residuals were asked for."""
    asked: list[int] = []

    def evaluate(x: Array, c: Array, which: np.ndarray) -> Array:
        asked.append(1)
        return x - c + 0.1 * np.sin(3 * x)

    objective = Objective(evaluate, np.array([1e-6]), Prior(np.zeros(1), np.full(1, 10.0)), np.inf)
    found = []
    with recorded_in(Journal(path, fingerprint)):
        for k in range(min(3, stop)):
            found += fit_each(objective, STARTS, np.array([0.3 * k]), 9)
    return found, len(asked)


def test_the_same_again_takes_no_time_and_gives_the_same_bytes(tmp_path: Path) -> None:
    first, asked = run(tmp_path / "j")
    assert asked > 0
    for stop in (1, 2):
        run(tmp_path / f"j{stop}", stop=stop)
        again, _ = run(tmp_path / f"j{stop}")
        assert [a.tobytes() for a in again] == [a.tobytes() for a in first]
    again, asked = run(tmp_path / "j")
    assert asked == 0
    assert [a.tobytes() for a in again] == [a.tobytes() for a in first]


@pytest.mark.parametrize("line", LINES.values(), ids=LINES.keys())
def test_what_is_no_answer_is_dropped(tmp_path: Path, line: str) -> None:
    first, asked = run(tmp_path / "j")
    lines = (tmp_path / "j").read_text().splitlines()
    (tmp_path / "j").write_text("\n".join([*lines[:2], line, *lines[3:]]) + "\n")
    again, few = run(tmp_path / "j")
    assert 0 < few < asked
    assert [a.tobytes() for a in again] == [a.tobytes() for a in first]
    assert (tmp_path / "j").read_text().count("\n") == len(lines)


@pytest.mark.parametrize("value", ["NaN", "1e308", '"0.1"', "[0.1]", "true"])
def test_numbers_outside_their_bounds_are_worked_out_again(tmp_path: Path, value: str) -> None:
    def work() -> tuple[Array, ...]:
        return (np.array([0.5]),)

    def fits(found: tuple[Array, ...]) -> bool:
        return bool(np.all(np.abs(found[0]) < 1))

    for _ in range(2):
        with recorded_in(Journal(tmp_path / "j", "a")):
            [found] = recorded(work, [np.zeros(1)], [(1,)], fits)
            assert found == 0.5
        text = (tmp_path / "j").read_text()
        assert json.loads(text.splitlines()[1])["numbers"] == [[0.5]]
        (tmp_path / "j").write_text(text.replace("[[0.5]]", f"[[{value}]]"))


def test_another_run_and_a_torn_line_are_not_continued(tmp_path: Path) -> None:
    _, asked = run(tmp_path / "j")
    text = (tmp_path / "j").read_text()
    (tmp_path / "j").write_text(text[:-20])
    _, few = run(tmp_path / "j")
    assert 0 < few < asked
    assert (tmp_path / "j").read_text().count("\n") == text.count("\n")
    assert run(tmp_path / "j", "b")[1] == asked
