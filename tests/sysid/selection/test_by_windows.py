"""Effects that are found where whole shots are not followed, and losses of windows."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.effect import Effect
from models.effect_catalogue import catalogue
from models.effects.cue.cue_hop import CueHop
from models.effects.cue.squirt import Squirt
from models.free_form import ALONE, Axis, FreeForm
from models.model_file import full_model
from models.shot import Ball, Shot, Table
from models.simulation.simulate import simulate
from sysid.clips import ClipSet, read_clip_set
from sysid.estimation.chains.chain import Chain
from sysid.estimation.from_nothing import fit_windows
from sysid.estimation.split import split
from sysid.selection.diagnose import diagnose
from sysid.selection.discover import discover
from sysid.selection.fits.by_windows import linearise_windows
from sysid.selection.formulas.free_forms import Block, free_candidates
from sysid.selection.result import DiscoveryResult
from sysid.selection.scoring.signatures import candidate
from tests.examination.__main__ import make
from tests.examination.contacts import chalky_stretch
from tests.truth.__main__ import main as generate

TABLE, BALL = Table(3.569, 1.778), Ball(0.0525, 0.1406)


def made(folder: Path, *words: str) -> tuple[ClipSet, dict[str, float]]:
    """A clip set of the independent generator, and its constants."""
    assert generate([str(folder), "--no-cue", *words]) == 0
    truth: dict[str, float] = json.loads(Path(f"{folder}.truth.json").read_text())["parameters"]
    return read_clip_set(folder), truth


def found_beyond(data_folder: Path, name: str) -> tuple[ClipSet, DiscoveryResult, dict[str, Any]]:
    """A clip set of another program, what is found in it, and what hides there."""
    folder = data_folder / "beyond" / name
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    clip_set = read_clip_set(folder)
    truth: dict[str, Any] = json.loads((folder.parent / f"{name}.truth.json").read_text())
    return clip_set, discover(clip_set, full_model(clip_set.table, clip_set.ball)), truth


def test_what_the_cue_did_does_not_act_on_a_ball_that_was_on_its_way() -> None:
    times = np.linspace(0, 0.5, 20)

    def played(struck: bool, *effects: CueHop | Squirt) -> np.ndarray:
        model = full_model(TABLE, BALL)
        for effect in effects:
            model = model.add(effect)
        shot = Shot(
            ("cue",), np.zeros((1, 2)), np.array([[1.5, 0.0]]), np.array([[0.0, 0.0, 60.0]]), times, struck=struck
        )
        return simulate(model, [shot])[0].position[:, 0]

    cue = CueHop(time_per_speed=0.05), Squirt(per_offset=10.0)
    np.testing.assert_allclose(played(False, *cue), played(False), atol=1e-9)
    assert np.abs(played(True, *cue) - played(True)).max() > 0.005


def test_what_acts_at_impacts_alone_is_played_where_there_are_any(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And says the same as where it is played everywhere."""
    clip_set, _ = made(tmp_path / "set", "--seed", "4", "--clips", "4", "--kind", "roll,cushion,cut", "--seconds", "2")
    parts, _, model = split(clip_set, full_model(clip_set.table, clip_set.ball))
    at = fit_windows(dataclasses.replace(parts, held_out=None), model)
    kinds = [Block(q, ("speed" if q == "drag" else "approach",), (Axis.over("approach", 0.0, 2.0, 5), ALONE))
             for q in ("drag", "cushion_e", "ball_mu")]  # fmt: skip
    several = [
        *free_candidates(kinds),
        candidate(catalogue()["cue_ball_mass"]()),
        candidate(catalogue()["nose_height"]()),
    ]
    assert [one.effect.impacts() for one in several] == [
        None,
        ("cushion",),
        ("ball",),
        ("ball", "cushion"),
        ("ball", "cushion"),
    ]
    played = list[int]()

    def counted(chain: Chain, states: np.ndarray, c: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        played.append(len(which))
        return play(chain, states, c, which)

    play = Chain.play
    monkeypatch.setattr(Chain, "play", counted)
    few = linearise_windows(at, several)
    count, played[:] = sum(played), []
    monkeypatch.setattr(Effect, "impacts", classmethod(lambda cls: None))
    monkeypatch.setattr(FreeForm, "impacts", classmethod(lambda cls: None))
    every = linearise_windows(at, several)
    np.testing.assert_array_equal(few.information, every.information)
    np.testing.assert_array_equal(few.gradient, every.gradient)
    assert count < sum(played)


@pytest.mark.slow
def test_a_strong_effect_on_the_cloth_is_found_where_whole_shots_are_not_followed(tmp_path: Path) -> None:
    words = ("--seed", "5", "--clips", "10", "--seconds", "6", "--kind", "long", "--kind", "cushion_side")
    clip_set, truth = made(tmp_path / "set", *words, "--constant", "mur=0.005", "--effect", "speed_drag=0.08")
    found = discover(clip_set, full_model(clip_set.table, clip_set.ball))
    assert found.verdict == ("speed_drag",)
    assert found.last.value("speed_drag.rate")[0] == pytest.approx(truth["drag1"], rel=0.02)
    assert found.last.rms < 1.05 * 0.0005
    assert found.ladder[0].rms > 10 * found.last.rms


@pytest.mark.slow
@pytest.mark.thorough
def test_a_step_has_its_place_and_two_quantities_share_it(data_folder: Path) -> None:
    """Of another program: sliding and rolling friction are 1.3 times as high where x > 0.2 m."""
    _, found, known = found_beyond(data_folder, "set-41")
    assert found.verdict == () and found.unexplained is not None and found.explained is not None
    values = dict(zip(found.explained.names, found.explained.constants.tolist(), strict=True))
    for key, size in (("drag", 0.3 * 9.81 * known["constants"]["mur"]), ("grip", 0.3)):
        assert values[f"unexplained.{key}_x_above"] == pytest.approx(size, rel=0.05)
        assert values[f"unexplained.{key}_x_above_at"] == pytest.approx(0.2, abs=0.01)
    assert found.explained.held_rms < 1.1 * 0.0005 < found.last.held_rms / 2


@pytest.mark.slow
@pytest.mark.thorough
def test_a_drift_over_the_clips_is_found(data_folder: Path) -> None:
    """Of another program: rolling friction grows by 1.2 % of its first value from clip to clip."""
    _, found, known = found_beyond(data_folder, "set-43")
    whole = 0.012 * (len(known["clips"]) - 1) * 9.81 * known["constants"]["mur"]
    assert found.verdict == () and found.unexplained is not None and found.explained is not None
    assert found.unexplained["depends_on"] == ["order of the clips"]
    assert found.unexplained["size"] == pytest.approx(whole, rel=0.03)
    assert found.explained.held_rms < 1.1 * 0.0005


@pytest.mark.slow
@pytest.mark.thorough
def test_a_law_of_the_angle_at_cushions_is_found_in_windows(data_folder: Path) -> None:
    """Of another program: no effect of the catalogue comes near, so none is named beside the formula."""
    clip_set, found, _ = found_beyond(data_folder, "set-42")
    assert found.verdict == () and found.unexplained is not None
    assert found.unexplained["depends_on"] == ["angle"]
    assert found.unexplained["size"] == pytest.approx(-0.10, rel=0.03)
    assert found.explained is not None and found.explained.chi2 < 1.05
    assert found.explained.held_rms < 1.1 * 0.0005 < found.last.held_rms / 2
    diagnosed = diagnose(clip_set, full_model(clip_set.table, clip_set.ball))
    assert diagnosed.verdict is None and diagnosed.unexplained is not None
    assert diagnosed.unexplained["depends_on"] == ["angle"]
    assert diagnosed.unexplained["size"] == pytest.approx(-0.10, rel=0.03)


@pytest.mark.slow
@pytest.mark.thorough
def test_a_stretch_of_one_cushion_is_found(tmp_path: Path) -> None:
    """Of another program: the cushion at +y has 0.10 more friction between x = -0.9 and 0.3 m."""
    make(tmp_path / "set", chalky_stretch.__name__, 5)
    clip_set = read_clip_set(tmp_path / "set")
    found = discover(clip_set, full_model(clip_set.table, clip_set.ball))
    assert found.verdict == () and found.unexplained is not None and found.explained is not None
    steps = {term["factor"].partition(" > ")[0]: term for term in found.unexplained["terms"]}
    assert set(steps) == {"(rail == 2) * (along"} and len(found.unexplained["terms"]) == 2
    first, second = sorted(found.unexplained["terms"], key=lambda term: float(term["at"]))
    assert (first["at"], second["at"]) == (pytest.approx(-0.9, abs=0.05), pytest.approx(0.3, abs=0.05))
    assert (first["value"], second["value"]) == (pytest.approx(0.10, rel=0.1), pytest.approx(-0.10, rel=0.1))
    assert found.explained.held_rms < 1.1 * 0.0005
