"""Outcomes of shots with respect to the goal: potted, fouls, and where the balls stopped.

In: a scene, and results of the event engine or MuJoCo tracks. Out: `Outcomes` of n shots. A foul is an in-off, a first
contact with a ball other than the object ball (or with none), another ball potted, or contact with a ball to be
avoided. Left out: all other rules of the game.
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
    """How n shots ended; a shot that was abandoned is neither a pot nor a foul."""

    potted: Flags  # (n,), the object ball in a pocket of the goal
    pocket: NDArray[np.int64]  # (n,), which of planner.scene.POCKETS took the object ball; -1 for none
    fouls: Flags  # (n, 4), by FOULS
    place: Array  # (n, nball, 2) [m], end points of balls; NaN if potted
    hits: NDArray[np.int64]  # (n, 3), cushion contacts: cue ball before meeting the object ball, after; object ball

    @property
    def foul(self) -> Flags:
        """Whether there was any foul: (n,)."""
        return np.asarray(self.fouls.any(axis=1))

    @property
    def made(self) -> Flags:
        """Whether the ball was potted without a foul: (n,)."""
        return np.asarray(self.potted & ~self.foul)

    @property
    def cue(self) -> Array:
        """End points of the cue ball: (n, 2) [m]."""
        return self.place[:, 0]

    def __len__(self) -> int:
        """Shots."""
        return len(self.potted)

    def rows(self, index: slice | NDArray[np.int64] | Flags) -> Outcomes:
        """Some of the shots."""
        return Outcomes(**{f.name: getattr(self, f.name)[index] for f in fields(self)})


def concatenate(parts: Sequence[Outcomes]) -> Outcomes:
    """Concatenate outcomes."""
    return Outcomes(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Outcomes)})


def _nearest(scene: Scene, xy: Array) -> NDArray[np.int64]:
    """Numbers of the pockets nearest to places (n, 2) [m]: (n,)."""
    places = np.array([pocket_places(scene.table)[p] for p in POCKETS])
    return np.asarray(np.argmin(np.linalg.norm(xy[:, None] - places, axis=-1), axis=1))


def goal_pockets(scene: Scene) -> tuple[Pocket, ...]:
    """The pockets that count as a pot."""
    return POCKETS if scene.goal.pocket is None else (scene.goal.pocket,)


@dataclass(frozen=True)
class _Facts:
    """The facts of n shots, from either engine."""

    gone: Flags  # (n, nball), balls that were potted
    place: Array  # (n, nball, 2) [m], where balls stopped or fell
    ended: Flags  # (n,), False for shots that were abandoned
    first: NDArray[np.int64]  # (n,), number of the ball that the cue ball met first; -1 for none
    touched: Flags  # (n,), a ball to be avoided was touched
    hits: NDArray[np.int64]  # (n, 3), as in Outcomes

    def outcomes(self, scene: Scene) -> Outcomes:
        """The outcomes with respect to the goal."""
        gone, ended = self.gone, self.ended[:, None]
        pocket = np.where(gone[:, 1] & self.ended, _nearest(scene, self.place[:, 1]), -1)
        potted = np.isin(pocket, [POCKETS.index(p) for p in goal_pockets(scene)])
        fouls = np.stack([gone[:, 0], self.first != 1, gone[:, 2:].any(axis=1), self.touched], axis=1)
        place = np.where((gone | ~ended)[..., None], np.nan, self.place)
        return Outcomes(potted, pocket, fouls & ended, place, self.hits)


def of_result(scene: Scene, result: Result) -> Outcomes:
    """Outcomes of shots played by the event engine with a log of events."""
    kind, i, j = result.event[..., 0], result.event[..., 1], result.event[..., 2]
    ball, cushion = kind == BALL, kind == CUSHION
    met = ball & (i == 0)
    any_met, index = met.any(axis=1), np.argmax(met, axis=1)
    first_contact = np.where(any_met, index, kind.shape[1])[:, None]
    first = np.where(any_met, np.take_along_axis(j, index[:, None], axis=1)[:, 0], -1)
    touched = np.zeros(len(kind), bool)
    for name in scene.goal.avoid:
        k = scene.names.index(name)
        touched |= (ball & ((i == k) | (j == k))).any(axis=1)
    order = np.arange(kind.shape[1])[None]
    of_cue_ball = cushion & (i == 0)
    counted = (of_cue_ball & (order < first_contact), of_cue_ball & (order > first_contact), cushion & (i == 1))
    hits = np.stack([flags.sum(axis=1) for flags in counted], axis=1)
    return _Facts(result.potted, result.position, np.isfinite(result.time), first, touched, hits).outcomes(scene)


def of_tracks(scene: Scene, tracks: Sequence[Track]) -> Outcomes:
    """Outcomes of tracks that last until all balls rest; the event of a potted ball gives its place."""
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
    return _Facts(gone, place, np.ones(n, bool), first, touched, hits).outcomes(scene)
