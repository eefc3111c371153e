"""Effects tried at their usual size or larger, where a fit in a false optimum deceives their score."""

from __future__ import annotations

from pathlib import Path

import pytest

from models.model_file import full_model
from sysid.clips import read_clip_set
from sysid.estimation import FittedModel, begin
from sysid.estimation.split import Split
from sysid.selection.score import candidate, score_all
from sysid.selection.screening import MAX_FITS, candidates_for, screen
from sysid.selection.trials import fit_from_trial, most_promising
from tests.truth.__main__ import main as generate


def fitted(folder: Path, seed: str, constant: str) -> tuple[Split, FittedModel]:
    """The base fitted to a clip set of the independent generator that hides a constant."""
    words = ("--seed", seed, "--clips", "12", "--seconds", "4", "--missing", "0.01", "--constant", constant)
    assert generate([str(folder), *words]) == 0
    clip_set = read_clip_set(folder)
    return begin(clip_set, full_model(clip_set.table, clip_set.ball))


@pytest.mark.slow
def test_low_noses_stand_out_at_their_usual_size_and_not_by_their_score(tmp_path: Path) -> None:
    parts, base = fitted(tmp_path / "set", "20290", "nose=-0.13")
    candidates = candidates_for(base.model)
    kinds = list(dict.fromkeys(type(one.effect) for one in candidates))
    by_score = [row.candidate.name for row in score_all(base, candidates).rows[:MAX_FITS]]
    effect = most_promising(base, kinds)[0]
    assert effect.name() == "nose_height" and "nose_height" not in by_score
    found = fit_from_trial(parts, base, effect)
    value, sd = found.value("nose_height.change")
    assert abs(value + 0.13) < 4 * sd < 0.01
    assert most_promising(found, [k for k in kinds if k.name() != effect.name()]) == []  # it leaves nothing to find
    seen = screen(parts, base, [candidate(k) for k in kinds])
    assert seen.best is not None and seen.best.name == "nose_height"


@pytest.mark.slow
def test_an_effect_that_grows_with_the_square_of_its_parameter_is_found(tmp_path: Path) -> None:
    """A struck ball that flies at first: the derivative vanishes where it does not, and the usual size is too small."""
    parts, base = fitted(tmp_path / "set", "20140", "hop=0.06")
    seen = screen(parts, base, candidates_for(base.model))
    assert seen.best is not None and seen.best.name == "cue_hop"
    value, sd = seen.best.fitted.value("cue_hop.time_per_speed")
    assert abs(value - 0.06) < 4 * sd < 0.01
