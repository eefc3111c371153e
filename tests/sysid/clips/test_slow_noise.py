"""Slow noise: none where tracks hold white noise alone, whatever the physics; its size where they wander."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from models.errors import BadInput
from models.model_file import full_model
from models.shot import Ball, Table
from sysid.clips import ClipSet, read_clip_set
from sysid.clips.clip_set import Clip, Observation
from sysid.clips.tracker.noise import position_noise
from sysid.clips.tracker.slow_noise import SlowNoise, slow_noise
from sysid.report.text import summary_lines
from sysid.residuals.compare import compare
from tests.support.hidden_truth import truth_of
from tests.truth.__main__ import main as generate
from tests.truth.sizes import NATURAL

SIGMA_M = 2e-4
WAVE_S = 0.15  # of the wandering: its autocorrelation falls by e within
FPS = 60.0


def made(folder: Path, *words: str) -> ClipSet:
    common = ("--seed", "12", "--clips", "8", "--sigma", str(SIGMA_M), "--seconds", "4", "--fps", str(FPS))
    assert generate([str(folder / "set"), *common, *words]) == 0
    return read_clip_set(folder / "set")


def wandering(clip_set: ClipSet, sd: float) -> ClipSet:
    """The same tracks with an Ornstein-Uhlenbeck error on each axis."""
    rng = np.random.default_rng(3)
    clips = []
    for clip in clip_set.clips:
        balls = {}
        for name, seen in clip.balls.items():
            keep = np.exp(-np.diff(seen.time, prepend=seen.time[0]) / WAVE_S)
            off, at = np.zeros_like(seen.xy), rng.normal(size=2)
            for k, share in enumerate(keep):
                at = share * at + np.sqrt(1 - share**2) * rng.normal(size=2)
                off[k] = at
            balls[name] = dataclasses.replace(seen, xy=seen.xy + sd * off)
        clips.append(dataclasses.replace(clip, balls=balls))
    return dataclasses.replace(clip_set, clips=tuple(clips))


@pytest.mark.parametrize("effect", [None, "table_tilt", "air_drag", "lens_distortion", "side_curve", "off_centre_ball"])
def test_physics_is_no_slow_noise(tmp_path: Path, effect: str | None) -> None:
    sizes = NATURAL[effect].items() if effect else ()
    clip_set = made(tmp_path, *(word for key, value in sizes for word in ("--constant", f"{key}={value}")))
    assert slow_noise(clip_set, position_noise(clip_set)).sd < 0.5 * SIGMA_M


@pytest.mark.parametrize("sd", [5e-4, 1e-3])
def test_tracks_that_wander_have_slow_noise(tmp_path: Path, sd: float) -> None:
    """A cubic follows some of it, so it comes out small, never large."""
    found = slow_noise(wandering(made(tmp_path), sd), SIGMA_M)
    assert 0.6 * sd < found.sd < 1.1 * sd
    assert 0.3 < found.correlation_time / (1 + 2 * WAVE_S * FPS) < 1.1


def test_wandering_is_not_taken_for_physics(tmp_path: Path) -> None:
    """Of the right model nothing is named, and its residuals are what the noise is."""
    clip_set = wandering(made(tmp_path), 1e-3)
    right = full_model(clip_set.table, clip_set.ball).with_values(truth_of(tmp_path / "set"))
    found = compare(clip_set, right)
    assert found.local.named == ()
    assert 0.5 < found.summary()["segment_ratio_median"] < 1.25
    assert found.noise_m == pytest.approx(np.hypot(SIGMA_M, found.slow_noise.sd))
    assert "tracks wander by" in summary_lines(found)[1]


def test_few_stretches_tell_nothing(tmp_path: Path) -> None:
    clip_set = made(tmp_path)
    few = dataclasses.replace(clip_set, clips=wandering(clip_set, 1e-3).clips[:1])
    assert slow_noise(few, SIGMA_M) == SlowNoise()


def test_noises_together_have_the_correlation_of_the_larger() -> None:
    assert SlowNoise().together(1e-3, 2.0) == 2.0
    assert SlowNoise(1e-3, 11.0).together(1e-3, 1.0) == pytest.approx(6.0)
    assert SlowNoise(1e-3, 11.0).together(1e-6, 1.0) == pytest.approx(11.0, rel=1e-4)


def test_clips_in_which_nothing_moves_are_not_called_too_short() -> None:
    rng = np.random.default_rng(0)
    time = np.arange(300) / FPS
    still = Observation(time, rng.normal(0, 1e-5, (300, 2)), np.full(300, np.nan))
    clip_set = ClipSet(Table(3.569, 1.778), Ball(0.0525, 0.14), FPS, (Clip("1.csv", "cue", {"cue": still}),))
    with pytest.raises(BadInput, match="no ball moves to estimate it; record shots in which balls move, or add"):
        position_noise(clip_set)
    short = dataclasses.replace(clip_set, clips=(Clip("1.csv", "cue", {"cue": still.at(np.arange(5))}),))
    with pytest.raises(BadInput, match="the tracks are too short to estimate it"):
        position_noise(short)
