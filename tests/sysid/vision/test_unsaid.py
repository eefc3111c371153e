"""What becomes no clip is said, with its frame and the reason."""

from __future__ import annotations

import numpy as np

from sysid.vision.tracks.shots.unsaid import unsaid
from tests.support.followed_balls import FPS, Recording, tracked_of


def test_a_shot_during_which_the_ball_is_not_seen_is_said() -> None:
    made = Recording().wait(0.5).shot((1.2, 0.45)).wait(0.6).shot((-0.9, 0.1)).wait(0.5)
    hidden = round(made.struck[1] * FPS) - 5
    made.rows[2][-5:, 0] = made.rows[3][:, 0] = np.nan
    found = tracked_of(made)
    assert [shot.struck for shot in found.shots] == ["white"]
    (line,) = found.left_out
    assert "white is not seen until frame" in line
    assert f"frame {hidden}" in line or f"frame {hidden - 1}" in line


def test_every_move_is_in_a_clip_or_in_a_message() -> None:
    found = tracked_of(Recording().wait(0.5).shot((1.2, 0.45)).wait(0.5).push(1, (0.3, 0.3)).wait(0.5))
    assert len(found.left_out) == 1, "the red that a hand moves; the shot is a clip"
    moved = {move.name for move in found.scene.moves}
    said = unsaid(found.scene, [], [])
    assert {text.split()[0] for _, text in said} == moved
    assert all("moved until frame" in text and text.endswith(": in no clip") for _, text in said)
    (shot,) = found.shots
    assert [text.split()[0] for _, text in unsaid(found.scene, [shot], [])] == ["red"]


def test_a_ball_that_is_lost_to_the_end_is_said() -> None:
    made = Recording().wait(0.5).shot((1.2, 0.45)).wait(2.0)
    made.rows[-1][20:, 0] = np.nan
    (line,) = tracked_of(made).left_out
    assert "white is not seen any more" in line


def test_motion_after_a_jump_is_a_running_clip() -> None:
    """A film that is cut from one motion to the next lost all that came after the cut."""
    made = Recording().wait(0.5).shot((1.2, 0.45))
    made.rows[-1] = made.rows[-1][:100]
    made.now = np.array([[0.6, 0.2], *made.now[1:]])
    made.shot((-0.9, 0.35)).wait(0.5)
    made.rows[-2] = made.rows[-2][5:]
    found = tracked_of(made)
    assert [(shot.struck, shot.running) for shot in found.shots] == [("white", ()), ("white", ("white",))]
    assert found.shots[1].first > found.shots[0].last
    assert "ends early, at frame" in found.shots[1].remarks[0]
