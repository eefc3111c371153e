"""The Python interface: names load lazily, results are those of the commands."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import models
import planner
import sysid
from sysid.cli.demo import EXAMPLE_FOLDER
from tests.architecture.source import ROOT


@pytest.mark.parametrize("package", [models, sysid, planner], ids=lambda p: str(p.__name__))
def test_every_public_name_is_there(package: object) -> None:
    module = importlib.import_module(str(getattr(package, "__name__", "")))
    names = module.__all__
    assert sorted(names) == dir(module)
    for name in names:
        assert getattr(module, name) is not None
    with pytest.raises(AttributeError, match="nothing"):
        _ = module.nothing


def test_importing_loads_and_compiles_nothing() -> None:
    heavy = "print([m for m in ('numpy', 'numba', 'mujoco') if m in sys.modules])"
    code = f"import sys, models, sysid, planner, robot; {heavy}"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_shot_in_three_lines() -> None:
    model = models.full_model(models.Table(2.84, 1.42), models.Ball(0.0615, 0.21))
    shot = models.Shot(("white",), np.zeros((1, 2)), np.array([[1.0, 0.0]]), np.zeros((1, 3)), np.linspace(0.0, 0.5, 6))
    track = models.simulate(model, [shot])[0]
    assert 0.5 * 5 / 7 < track.position[-1, 0, 0] < 0.5  # it slides into rolling, and slows a little


def test_a_fit_from_python_is_that_of_the_command(tmp_path: Path) -> None:
    clips = sysid.read_clips(EXAMPLE_FOLDER)
    fitted = sysid.fit(clips)
    out, figures = tmp_path / "m.toml", tmp_path / "fit.json"
    words = [sys.executable, "-m", "sysid.cli", "fit", str(EXAMPLE_FOLDER), "--out", str(out), "--json", str(figures)]
    subprocess.run(words, cwd=ROOT, capture_output=True, check=False)
    constants = json.loads(figures.read_text())["parameters"]
    assert {n: c["value"] for n, c in constants.items()} == {n: value for n, (value, _) in fitted.constants.items()}
    assert models.load_model(out).parameters() == fitted.model.parameters()
    comparison = sysid.compare(clips, fitted.model)
    assert len(comparison.clips) == len(clips.clips)
