"""Formulas for structure outside the catalogue, and the effect files that they become."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import models.model_file
from models.contract import check_file
from models.model_file import full_model
from models.shot import Ball, Shot, Table, Track
from models.simulate import simulate
from sysid.terms import Term, effect_of, library, source, tidy

TABLE, BALL = Table(3.569, 1.778), Ball(0.0525, 0.1406)
TERMS = library(TABLE, 3)


def track(*names: str, values: tuple[float, ...] = (), order: float = 0.0) -> Track:
    """A ball that rolls along x and comes back from the rail, under some terms."""
    model = full_model(TABLE, BALL)
    if names:
        chosen = [next(t for t in TERMS if t.name == n) for n in names]
        model = model.add(effect_of("odd_cloth", chosen, values))
    v, w = np.array([[1.5, 0.2]]), np.array([[-0.2, 1.5, 0.0]]) / BALL.radius
    shot = Shot(("cue",), np.array([[0.3, 0.0]]), v, w, np.linspace(0, 3, 31), order=order)
    return simulate(model, [shot])[0]


def test_names_are_distinct_and_words_complete() -> None:
    assert len({t.name for t in TERMS}) == len(TERMS)
    assert all(t.where and t.depends_on and t.unit and t.width > 0 and t.name.isidentifier() for t in TERMS)


@pytest.mark.parametrize("term", TERMS[::6], ids=lambda t: t.name)
def test_the_file_of_every_term_keeps_the_contract(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, term: Term) -> None:
    monkeypatch.setattr(models.model_file, "_added", {})
    path = tmp_path / "odd_cloth.py"
    path.write_text(source("odd_cloth", (term,), (term.width / 4,), "Odd.", "a test of terms"))
    shows_elsewhere = ("does nothing", "changes nothing", "nothing changes")  # in a cell or at a rail not met there
    assert [f for f in check_file(path) if not any(words in f for words in shows_elsewhere)] == []


def test_terms_do_what_they_say() -> None:
    plain = track()
    rail = next(e.time for e in plain.events if e.kind == "cushion")
    before = plain.times < rail
    after = ~before
    dead = track("cushion_e_rail_0", values=(-0.2,))
    assert np.array_equal(dead.position[before], plain.position[before])
    assert np.abs(dead.velocity[after][0, 0, 0]) < np.abs(plain.velocity[after][0, 0, 0]) - 0.1
    assert np.array_equal(track("cushion_e_rail_1", values=(-0.2,)).position, plain.position)
    slower = track("drag_cos2", values=(0.05,))
    lost = plain.velocity[5, 0, 0] - slower.velocity[5, 0, 0]
    heading = np.arctan2(0.2, 1.5)
    assert lost == pytest.approx(0.05 * np.cos(2 * heading) * np.cos(heading) * plain.times[5], rel=2e-3)
    left = track("side_one", values=(0.02,))
    assert left.position[5, 0, 1] > plain.position[5, 0, 1]
    late = track("drag_order", values=(0.05,), order=1.0)
    first = track("drag_order", values=(0.05,), order=0.0)
    np.testing.assert_allclose(first.position[before], plain.position[before], atol=2e-5)
    assert late.velocity[5, 0, 0] < plain.velocity[5, 0, 0] - 0.02
    crown = track("push_x_x", values=(0.1,))
    assert crown.velocity[5, 0, 0] > plain.velocity[5, 0, 0]


def test_a_cell_acts_in_its_place_alone() -> None:
    plain, far = track(), track("drag_at_0_0", values=(0.05,))
    assert np.abs(far.position - plain.position).max() < 1e-4
    near = track("drag_at_3_1", values=(0.05,))
    assert np.abs(near.position - plain.position).max() > 1e-3


@pytest.mark.parametrize(
    "names", [("cushion_e_rail_2",), ("drag_at_1_1", "push_y_order"), ("image_x_xy", "ball_mu_order")]
)
def test_the_file_is_clean(tmp_path: Path, names: tuple[str, ...]) -> None:
    """What is written passes a linter, and holds nothing that it does not use."""
    chosen = [next(t for t in TERMS if t.name == n) for n in names]
    path = tmp_path / "odd_cloth.py"
    path.write_text(source("odd_cloth", chosen, [0.01] * len(chosen), "Odd.", "a test"))
    words = [sys.executable, "-m", "ruff", "check", "--isolated", "--select", "F,E9", str(path)]
    said = subprocess.run(words, capture_output=True, text=True)
    assert said.returncode == 0, said.stdout


def test_tidy_keeps_what_is_needed() -> None:
    text = "from a import b, c\n\n\n@dataclass(frozen=True)\nclass A:\n    def f(self):\n"
    text += "        x = 1\n        y = c\n        return y\n"
    assert tidy(text) == text.replace("b, ", "").replace("        x = 1\n", "")
