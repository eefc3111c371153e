"""Footage that was cut: balls that are elsewhere from one frame to the next."""

from __future__ import annotations

import dataclasses

import numpy as np

from models.shot import Table
from sysid.vision.tracks.following.follow import BallTrack
from sysid.vision.tracks.moves import TrackedScene
from sysid.vision.tracks.shots.breaks import first_break


def first_jump(tracks: list[BallTrack], first: int, last: int) -> tuple[int, str]:
    named = [dataclasses.replace(one, name=f"ball {k}") for k, one in enumerate(tracks)]
    scene = TrackedScene(named, np.arange(60), np.arange(60) / 120, Table(2.0, 1.0), 0.026, 1e-4)
    return first_break(scene, first, last)


def path(xy: np.ndarray) -> BallTrack:
    n = len(xy)
    return BallTrack(
        "white", np.arange(n), np.arange(n) / 120, xy * 400, xy, np.ones(n), np.full(n, 11.0), np.full(n, np.nan)
    )


def test_a_cut_in_the_footage_ends_the_shot() -> None:
    time = np.arange(60)[:, None] / 120
    rolling = time * [1.2, 0.3]
    cut = np.concatenate([rolling[:40], rolling[:20] + 0.3])
    assert first_jump([path(rolling), path(cut)], 0, 59) == (39, "ball 1")


def test_strokes_collisions_and_gaps_are_no_jumps() -> None:
    time = np.arange(60)[:, None] / 120
    struck = np.where(time < 0.2, 0.0, time - 0.2) * [4.0, 0.0]
    turned = np.where(time < 0.25, time, 0.5 - time) * [3.0, 3.0]
    assert first_jump([path(struck), path(turned), hidden(path(time * [2.0, 0.0]))], 0, 59) == (59, "")


def hidden(one: BallTrack) -> BallTrack:
    """The same, unseen from frame 20 to 35."""
    keep = (one.frame < 20) | (one.frame > 35)
    arrays = (one.frame, one.time, one.pixels, one.xy, one.sd, one.radius, one.face_change)
    return BallTrack("white", *(values[keep] for values in arrays))


def test_a_ball_that_comes_out_of_a_gap_faster_than_any_went_in_has_been_moved() -> None:
    """Slower, or as fast as another ball was, it may have been hit; one that rested may have been struck."""
    time = np.arange(60)[:, None] / 120
    late = np.clip(time - 30 / 120, 0, None)
    faster, slower, resting = time * [0.8, 0] + late * [0, 2.0], time * [0.8, 0] - late * [0.4, 0], late * [1.5, 0]
    quick = path(time * [0, 3.0])
    assert first_jump([hidden(path(faster))], 0, 59) == (19, "ball 0")
    assert first_jump([hidden(path(slower))], 0, 59) == (59, "")
    assert first_jump([hidden(path(resting))], 0, 59) == (59, "")
    assert first_jump([hidden(path(faster)), quick], 0, 59) == (59, "")
