"""A strike into balls that touch each other: one shot, of the ball that the cue struck."""

from __future__ import annotations

import numpy as np

from sysid.vision.tracks.follow import BallTrack
from sysid.vision.tracks.track import tracked
from tests.support.followed_balls import CAMERA


def test_balls_of_a_rack_are_set_in_motion_through_one_another() -> None:
    """The cue ball touches but the first of three; the others begin to move in the same frame, through it."""
    period, r, hit = 0.02, CAMERA.radius, 60
    frames = np.arange(110)
    aside = 2 * r * np.array([np.cos(np.pi / 6), np.sin(np.pi / 6)])
    ahead = (frames - hit)[:, None] * period
    starts = {"red": np.zeros(2), "yellow": aside, "green": aside * (1, -1)}
    ways = {"red": np.array([0.1, 0.0]), "yellow": aside / r * 0.4, "green": aside * (1, -1) / r * 0.4}
    xy = {name: starts[name] + ways[name] * np.maximum(ahead, 0.0) for name in starts}
    at_hit = np.array([-2.0 * r, 0.0])
    before = np.where(ahead < 0, at_hit + (2.0, 0.0) * np.maximum(ahead, -0.2), 0.0)
    xy["white"] = np.where(ahead < 0, before, at_hit - (0.1, 0.0) * np.maximum(ahead, 0.0))
    rng, ones = np.random.default_rng(2), np.ones(len(frames))
    tracks = [
        BallTrack(name, frames, frames * period, at, at + rng.normal(0, 1e-4, at.shape), 0.1 * ones, 10 * ones, ones)
        for name, at in xy.items()
    ]
    found = tracked(tracks, frames, frames * period, CAMERA)
    assert [(shot.struck, len(shot.balls)) for shot in found.shots] == [("white", 4)], found.left_out
    assert found.left_out == ()
