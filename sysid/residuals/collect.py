"""Residuals of every sample, in whole shots and in segments, which start again at each event.

In: a problem with its fitted tracks, or fitted segments. Out: `Samples`.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.shot import Track
from sysid.clips import ClipSet
from sysid.estimation.problem import Array, values_of
from sysid.estimation.shot_problem import ShotProblem, residual
from sysid.residuals.samples import Samples
from sysid.residuals.segment_fits import SegmentFits, sidespin

MIN_SLIP_M_S = 0.01  # slip speed above which a ball slides
REST_SPEED_M_S = 0.003  # speed below which a ball rests
SPINNING_RAD_S = 1.0  # sidespin above which a resting ball spins


def motions(velocity: Array, spin: Array, radius: float) -> tuple[Array, NDArray[np.str_]]:
    """Slip speed (n,) [m/s] and phase of motion, from velocity (n, 2) [m/s] and spin (n, 3) [rad/s]."""
    slip = np.hypot(velocity[:, 0] - radius * spin[:, 1], velocity[:, 1] + radius * spin[:, 0])
    speed = np.hypot(*velocity.T)
    resting = np.where(np.abs(spin[:, 2]) > SPINNING_RAD_S, "spin", "rest")
    return slip, np.where(slip > MIN_SLIP_M_S, "slide", np.where(speed > REST_SPEED_M_S, "roll", resting))


def samples_of_shots(problem: ShotProblem, tracks: Sequence[Track], clip_set: ClipSet) -> Samples:
    """Every trusted sample of moving balls, with the modelled state of the ball there."""
    return joined(
        _parts_of_shots(problem, tracks, clip_set), sum(len(b.time) for c in clip_set.clips for b in c.balls.values())
    )


def _parts_of_shots(problem: ShotProblem, tracks: Sequence[Track], clip_set: ClipSet) -> Iterator[Samples]:
    """The samples of each ball in turn."""
    segments = 0
    for k, track in enumerate(tracks):
        clip = clip_set.clips[k]
        for b, name in enumerate(track.names):
            seen = clip.balls[name]
            error, angle = residual(track, b, seen, len(seen.time))
            index = np.searchsorted(track.times, seen.time)
            v, w = track.velocity[index, b], track.spin[index, b]
            events = [e for e in track.events if name in e.balls]
            when = np.array([0.0, *[e.time for e in events]])
            count = np.searchsorted(when[1:], seen.time)
            use = problem.trusted[k][name] & np.isfinite(v[:, 0]) & ((count > 0) | (name in clip.first))
            slip, motion = motions(v, w, clip_set.ball.radius)
            kinds = np.array(["start" if clip.running else "strike", *[e.kind for e in events]])
            rails = np.array(["", *[e.rail for e in events]])
            n, count = int(use.sum()), count[use]
            yield Samples(
                np.full(n, k, dtype=np.int64), (name,) * n, np.full(n, b == 0 and not clip.running), seen.time[use],
                seen.xy[use], error[use], np.hypot(*v[use].T), np.arctan2(v[use, 1], v[use, 0]), w[use, 2],
                _words(motion[use]), _words(kinds[count]), count.astype(np.int64), angle[use], slip[use],
                _words(rails[count]), seen.time[use] - when[count], segments + count.astype(np.int64),
            )  # fmt: skip
            segments += len(events) + 1


def samples_of_segments(fits: SegmentFits, tracks: Sequence[Track]) -> Samples:
    """Every sample of the good segments, each with its own initial state.

    A single segment does not determine its sidespin, which is therefore taken from the whole shots' tracks.
    """
    return joined(_parts_of_segments(fits, tracks), sum(len(s.time) for s in fits.problem.segments))


def _parts_of_segments(fits: SegmentFits, tracks: Sequence[Track]) -> Iterator[Samples]:
    """The samples of each segment in turn."""
    problem, x = fits.problem, fits.initial_states
    c = np.tile(values_of(problem.model, problem.names), (len(x), 1))
    errors = problem.evaluate(x, c, np.arange(len(x)))
    errors *= problem.noise
    seen: dict[tuple[int, str], int] = {}
    running = {s.clip for s in problem.segments if s.before == "start"}
    for k, (s, track) in enumerate(zip(problem.segments, fits.tracks, strict=True)):
        events = seen.get((s.clip, s.ball), 0 if s.before in ("strike", "start") else 1)
        seen[s.clip, s.ball] = events + 1
        if not fits.good[k]:
            continue
        n = len(s.time)
        v, w = track.velocity[:, 0], track.spin[:, 0]
        slip, motion = motions(v, w, problem.model.ball.radius)
        shot = tracks[s.clip]
        b = shot.names.index(s.ball)
        yield Samples(
            np.full(n, s.clip), (s.ball,) * n, np.full(n, b == 0 and s.clip not in running), s.time, s.xy,
            errors[k, : 2 * n].reshape(n, 2),
            np.hypot(*v.T), np.arctan2(v[:, 1], v[:, 0]), sidespin(shot, b, s.time), _words(motion), (s.before,) * n,
            np.full(n, events), np.full(n, np.nan), slip, (s.rail,) * n, s.time - s.time[0], np.full(n, k),
        )  # fmt: skip


def joined(parts: Iterable[Samples], most: int = 0) -> Samples:
    """Concatenate parts of samples, of at most `most` in all; each part is released once it is copied."""
    numbers: dict[str, NDArray[Any]] = {}
    words: dict[str, list[str]] = {}
    n = 0
    for part in parts:
        end = n + len(part.time)
        for key, value in vars(part).items():
            if isinstance(value, tuple):
                words.setdefault(key, []).extend(value)
            else:
                if key not in numbers:
                    numbers[key] = np.empty((most, *value.shape[1:]), value.dtype)
                numbers[key][n:end] = value
        n = end
    if not numbers:
        none, index = np.empty(0), np.empty(0, dtype=np.int64)
        pair, no = np.empty((0, 2)), np.empty(0, dtype=bool)
        return Samples(index, (), no, none, pair, pair, none, none, none, (), (), index, none, none, (), none, index)
    whole: dict[str, Any] = {key: value[:n] for key, value in numbers.items()}
    return Samples(**whole | {key: tuple(values) for key, values in words.items()})


def _words(values: NDArray[np.str_]) -> tuple[str, ...]:
    return tuple(map(sys.intern, values.tolist()))  # stores each word once
