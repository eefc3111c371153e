"""The marks among the spots that pictures show on a ball: landmarks for its rotation.

In: the spots of one ball, picture by picture. Out: `Marks` of every picture, without highlights (mirror images of
lamps, which stay in place while marks move) and with smoothed positions of the ball.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.vision.camera.projection import Array
from sysid.vision.rotation.spots import Spots

MAX_MARK_RAD = 0.9  # angular radius
SMOOTHING_FRAMES = 7  # before and after one, through which a line smooths its position
GLARE_RAD = 0.1  # angular radius of a highlight, and of its wandering
LAG_FRAMES = 5  # over which a mark moves and a highlight does not
MARK_ERROR_RAD = 0.02  # departure of a mark from its place on a rigid ball, standard deviation


@dataclass(frozen=True)
class Marks:
    """The marks of one ball in one picture that are used: landmarks."""

    time: float  # [s]
    xy: Array  # (2,) [m]
    sight: Array  # (3,)
    place: Array  # (k, 3)
    sd: Array  # (k, 2) as in `Spots` [rad]
    glare: Array  # (m, 3) other spots, which may hide marks

    @property
    def weight(self) -> Array:
        """Weight of the place of each mark: (k,) [1/rad^2]."""
        return np.asarray(1.0 / (np.mean(self.sd**2, axis=1) + MARK_ERROR_RAD**2))


def choose_marks(seen: Sequence[Spots], radius: float) -> list[Marks]:
    """The marks among the spots: highlights are removed, and positions of the ball smoothed."""
    areas: dict[bool, float] = {True: 0.0, False: 0.0}
    for s in seen:
        for kind in areas:
            areas[kind] += float(np.sum(s.angle[s.trusted & (s.bright == kind)] ** 2))
    light = areas[False] < 0.3 * areas[True]  # whether the marks are lighter than the ball
    highlights = _highlights(seen) if light else None
    frames: list[Marks] = []
    for s, xy in zip(seen, _smooth(seen), strict=True):
        use = s.trusted & (s.bright == light) & (s.angle < MAX_MARK_RAD)
        if light:
            use &= (
                False
                if highlights is None
                else np.all(s.place @ highlights.T < np.cos(s.angle + GLARE_RAD)[:, None], axis=1)
            )
        place = s.place[use]
        # The same pixels on the shifted ball: moved along the line of sight onto the sphere.
        shift = np.array([*(xy - s.xy), 0.0])
        place = place - (shift - (place @ shift / (place @ s.sight))[:, None] * s.sight) / radius
        place /= np.linalg.norm(place, axis=1, keepdims=True)
        frames.append(Marks(s.time, xy, s.sight, place, s.sd[use], s.place[s.trusted & ~use]))
    return frames


def _highlights(seen: Sequence[Spots]) -> Array | None:
    """Directions (m, 3) of highlights, which stay bright while marks move; None if nothing moves."""
    bright = [s.bright & s.trusted for s in seen]
    place = [s.place[b] for s, b in zip(seen, bright, strict=True)]
    angle = [s.angle[b] for s, b in zip(seen, bright, strict=True)]
    min_cosine = math.cos(GLARE_RAD)
    moving = [
        k
        for k in range(LAG_FRAMES, len(seen))
        if len(place[k])
        and (len(place[k - LAG_FRAMES]) == 0 or ((place[k] @ place[k - LAG_FRAMES].T).max(axis=1) < min_cosine).any())
    ]
    if len(moving) < LAG_FRAMES:
        return None
    candidates, size = np.concatenate([place[k] for k in moving]), np.concatenate([angle[k] for k in moving])
    small = size < 0.7 * np.median(size[size > 0.5 * size.max()])
    highlights = []
    while len(candidates):
        cosines = [place[k] @ candidates.T for k in moving]
        present = sum((c > min_cosine).any(axis=0) for c in cosines)
        # A passing mark hides a highlight or merges with it.
        filled = sum(
            (c > np.cos(angle[k] + GLARE_RAD)[:, None]).any(axis=0) for k, c in zip(moving, cosines, strict=True)
        )
        share = np.where(small & (present > 0.3 * len(moving)), 1.0, filled / len(moving)) * (present > 2)
        best = int(np.argmax(share + 1e-3 * present))
        if share[best] < 0.8:
            break
        highlights.append(candidates[best])
        other = candidates @ candidates[best] < min_cosine
        candidates, small = candidates[other], small[other]
    return np.array(highlights).reshape(-1, 3)


def _smooth(seen: Sequence[Spots]) -> Array:
    """Positions of the ball (n, 2) [m], smoothed by a straight line where their neighbours lie on one."""
    time, xy = np.array([s.time for s in seen]), np.array([s.xy for s in seen]).reshape(-1, 2)
    n, smoothed = len(seen), xy.copy()
    if n < 2 * SMOOTHING_FRAMES + 1:
        return smoothed
    noise = float(np.nanmedian(np.abs(np.diff(xy, 3, axis=0)))) / 0.6745 / math.sqrt(20)
    for k in range(n):
        low = min(max(k - SMOOTHING_FRAMES, 0), n - 2 * SMOOTHING_FRAMES - 1)
        window = slice(low, low + 2 * SMOOTHING_FRAMES + 1)
        basis = np.column_stack([np.ones(2 * SMOOTHING_FRAMES + 1), time[window] - time[k]])
        if not np.isfinite(xy[window]).all():
            continue
        line = np.linalg.solve(basis.T @ basis, basis.T @ xy[window])
        scatter = float(np.sqrt(np.sum((xy[window] - basis @ line) ** 2) / (4 * SMOOTHING_FRAMES - 2)))
        if scatter < 1.5 * noise:
            smoothed[k] = line[0]
    return smoothed
