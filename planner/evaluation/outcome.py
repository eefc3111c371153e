"""What came of shots, as the goal sees it: potted, fouled, and where the cue ball stopped.

A foul is an in-off, a first ball that is not the object ball (or none), another ball potted, or a touch of one of the
balls that nothing may touch. Leaves out the rest of a referee's book.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from models.engine.play import Result
from models.engine.touch import BALL, CUSHION
from models.shot import Track
from planner.scene import POCKETS, Pocket, Scene, pocket_places

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
FOULS = ("in-off", "wrong ball first", "another ball potted", "forbidden touch")


@dataclass(frozen=True)
class Outcomes:
    """How n shots ended; a shot that was given up is no pot, and a foul of no kind."""

    potted: Flags  # (n,), the object ball in a wanted pocket
    pocket: NDArray[np.int64]  # (n,), which of planner.scene.POCKETS took the object ball; -1 for none
    fouls: Flags  # (n, 4), by FOULS
    place: Array  # (n, nball, 2) [m], where balls stopped; NaN where potted
    hits: NDArray[np.int64]  # (n, 3): cushions and jaws: cue ball before the object ball, after it; object ball

    @property
    def foul(self) -> Flags:
        """Any foul: (n,)."""
        return np.asarray(self.fouls.any(axis=1))

    @property
    def made(self) -> Flags:
        """Potted, and no foul: (n,)."""
        return np.asarray(self.potted & ~self.foul)

    @property
    def cue(self) -> Array:
        """Where the cue ball stopped: (n, 2) [m]."""
        return self.place[:, 0]

    def __len__(self) -> int:
        """Shots."""
        return len(self.potted)

    def rows(self, index: slice | NDArray[np.int64] | Flags) -> Outcomes:
        """Some of the shots."""
        return Outcomes(**{f.name: getattr(self, f.name)[index] for f in fields(self)})


def joined(parts: Sequence[Outcomes]) -> Outcomes:
    """Shots one after another."""
    return Outcomes(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Outcomes)})


def _nearest(scene: Scene, xy: Array) -> NDArray[np.int64]:
    """Number of the pocket that is nearest to places (n, 2)."""
    places = np.array([pocket_places(scene.table)[p] for p in POCKETS])
    return np.asarray(np.argmin(np.linalg.norm(xy[:, None] - places, axis=-1), axis=1))


def wanted(scene: Scene) -> tuple[Pocket, ...]:
    """The pockets that count."""
    return POCKETS if scene.goal.pocket is None else (scene.goal.pocket,)


def _judged(
    scene: Scene, gone: Flags, place: Array, ended: Flags, first: NDArray[np.int64], touched: Flags,
    hits: NDArray[np.int64],
) -> Outcomes:  # fmt: skip
    """Outcomes from which balls are gone (n, nball), where all are or fell, the ball hit first, forbidden touches."""
    pocket = np.where(gone[:, 1] & ended, _nearest(scene, place[:, 1]), -1)
    counts = np.isin(pocket, [POCKETS.index(p) for p in wanted(scene)])
    fouls = np.stack([gone[:, 0], first != 1, gone[:, 2:].any(axis=1), touched], axis=1)
    return Outcomes(
        counts, pocket, fouls & ended[:, None], np.where((gone | ~ended[:, None])[..., None], np.nan, place), hits
    )


def of_result(scene: Scene, result: Result) -> Outcomes:
    """Outcomes of shots of the event engine, which logged enough events."""
    kind, i, j = result.event[..., 0], result.event[..., 1], result.event[..., 2]
    ball, cushion = kind == BALL, kind == CUSHION
    met = ball & (i == 0)
    n = len(kind)
    when = np.where(met.any(axis=1), np.argmax(met, axis=1), kind.shape[1])
    first = np.where(met.any(axis=1), np.take_along_axis(j, np.argmax(met, axis=1)[:, None], axis=1)[:, 0], -1)
    touched = np.zeros(n, bool)
    for name in scene.goal.avoid:
        k = scene.names.index(name)
        touched |= (ball & ((i == k) | (j == k))).any(axis=1)
    order = np.arange(kind.shape[1])[None]
    own = cushion & (i == 0)
    hits = np.stack(
        [
            (own & (order < when[:, None])).sum(axis=1),
            (own & (order > when[:, None])).sum(axis=1),
            (cushion & (i == 1)).sum(axis=1),
        ],
        axis=1,
    )
    return _judged(scene, result.potted, result.position, np.isfinite(result.time), first, touched, hits)


def of_tracks(scene: Scene, tracks: Sequence[Track]) -> Outcomes:
    """Outcomes of tracks that last until everything rests; a potted ball fell where its event says."""
    names, n = scene.names, len(tracks)
    place = np.array([t.position[-1] for t in tracks]).reshape(n, len(names), 2)
    gone, first = np.isnan(place[..., 0]), np.full(n, -1)
    touched, hits = np.zeros(n, bool), np.zeros((n, 3), np.int64)
    forbidden = set(scene.goal.avoid)
    for k, track in enumerate(tracks):
        for event in track.events:
            if event.kind == "ball":
                touched[k] |= not forbidden.isdisjoint(event.balls)
                if first[k] < 0 and names[0] in event.balls:
                    other = event.balls[event.balls[0] == names[0]]
                    first[k] = names.index(other)
            elif event.kind == "cushion" and event.balls[0] in names[:2]:
                hits[k, 2 if event.balls[0] == names[1] else int(first[k] >= 0)] += 1
            elif event.kind == "pocket":
                place[k, names.index(event.balls[0])] = event.place
    return _judged(scene, gone, place, np.ones(n, bool), first, touched, hits)
