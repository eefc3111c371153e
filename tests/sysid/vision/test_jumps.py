"""Footage that was cut: balls that are elsewhere from one frame to the next."""

from __future__ import annotations

import numpy as np

from sysid.vision.tracks.follow import BallTrack
from sysid.vision.tracks.jumps import first_jump


def path(xy: np.ndarray) -> BallTrack:
    n = len(xy)
    return BallTrack(
        "white", np.arange(n), np.arange(n) / 120, xy * 400, xy, np.ones(n), np.full(n, 11.0), np.full(n, np.nan)
    )


def test_a_cut_in_the_footage_ends_the_shot() -> None:
    time = np.arange(60)[:, None] / 120
    rolling = time * [1.2, 0.3]
    cut = np.concatenate([rolling[:40], rolling[:20] + 0.3])
    assert first_jump([path(rolling), path(cut)], 0, 59) == (39, "white")


def test_strokes_collisions_and_gaps_are_no_jumps() -> None:
    time = np.arange(60)[:, None] / 120
    struck = np.where(time < 0.2, 0.0, time - 0.2) * [4.0, 0.0]
    turned = np.where(time < 0.25, time, 0.5 - time) * [3.0, 3.0]
    gap = path(time * [2.0, 0.0])
    keep = (gap.frame < 20) | (gap.frame > 35)
    sparse = BallTrack(
        "white",
        gap.frame[keep],
        gap.time[keep],
        *(v[keep] for v in (gap.pixels, gap.xy, gap.sd, gap.radius, gap.face_change)),
    )
    assert first_jump([path(struck), path(turned), sparse], 0, 59) == (59, "")
