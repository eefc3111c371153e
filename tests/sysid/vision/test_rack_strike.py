"""A strike into balls that touch each other: one shot, of the ball that the cue struck."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.clips.plausibility import MIN_STRUCK_SAMPLES
from sysid.vision.tracks.following.follow import BallTrack
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


def break_tracks(unseen: range) -> tuple[list[BallTrack], np.ndarray]:
    """A break at 12 m/s and 25 frames a second; the cue ball is not seen in some frames."""
    period, r, frames = 0.04, CAMERA.radius, np.arange(80)
    struck, hit, apart = 29.6, 31.5, 2.002 * r
    place = np.array([-0.05, 0.02])
    toward = np.array([0.96, 0.28])
    at_hit = place - apart * toward
    since, after = (frames - struck).clip(0, hit - struck), (frames - hit).clip(0)
    white = at_hit + (12.0 * period * (since - (hit - struck)))[:, None] * toward
    white = white + (period * after)[:, None] * np.array([-0.3, 0.5]) * np.exp(-0.01 * after)[:, None]
    xy = {"white": white}
    for name, aside, speed in (("red", 0.0, 0.4), ("yellow", 0.5, 3.0), ("green", -0.5, 2.0), ("blue", 0.25, 0.8)):
        way = np.array([np.cos(aside), np.sin(aside)])
        start = place + (apart * way * (2 if name == "blue" else 1) if name != "red" else 0.0)
        slowing = 6.0 * (1 - np.exp(-after / 6.0))
        xy[name] = start + (period * speed * slowing)[:, None] * way
    rng, tracks = np.random.default_rng(3), []
    for name, at in xy.items():
        ones = np.ones(len(frames))
        seen = at + rng.normal(0, 2e-4, at.shape)
        whole = BallTrack(name, frames, frames * period, at, seen, 0.1 * ones, 10 * ones, ones)
        tracks.append(whole.without(np.isin(frames, unseen) if name == "white" else np.zeros(len(frames), bool)))
    return tracks, frames


@pytest.mark.parametrize("unseen", [range(31, 31), range(31, 32), range(31, 36), range(30, 36), range(32, 80)])
def test_a_ball_of_the_rack_was_not_struck_by_the_cue(unseen: range) -> None:
    """What breaks the rack is seen once or twice, or is not seen again; the balls that it hit were not struck."""
    tracks, frames = break_tracks(unseen)
    result = tracked(tracks, frames, frames * 0.04, CAMERA)
    assert all(shot.struck == "white" or shot.running for shot in result.shots)
    for shot, found in zip(result.shots, result.found, strict=True):
        assert found[shot.struck][1].size >= MIN_STRUCK_SAMPLES
    assert bool(result.shots) == (unseen.stop < len(frames)), "what is not seen again may hit others later"
