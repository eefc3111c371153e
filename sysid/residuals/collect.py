"""What the model missed, sample by sample: of whole shots, and of stretches whose motion begins anew at each event."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.shot import Shot, Track
from models.simulation.simulate import simulate
from sysid.clips import ClipSet
from sysid.estimation.problem import Array, turn
from sysid.estimation.segment_problem import SegmentProblem
from sysid.estimation.shot_problem import ShotProblem, residual
from sysid.residuals.samples import Samples

SLIPS = 0.01  # slip speed above which a ball slides [m/s]
STILL = 0.003  # speed below which it rests [m/s]
SPINS = 1.0  # sidespin above which a resting ball spins [rad/s]


def motions(velocity: Array, spin: Array, radius: float) -> tuple[Array, NDArray[np.str_]]:
    """Slip speed (n,) [m/s] and what the ball does, from velocity (n, 2) [m/s] and spin (n, 3) [rad/s]."""
    slip = np.hypot(velocity[:, 0] - radius * spin[:, 1], velocity[:, 1] + radius * spin[:, 0])
    speed = np.hypot(*velocity.T)
    resting = np.where(np.abs(spin[:, 2]) > SPINS, "spin", "rest")
    return slip, np.where(slip > SLIPS, "slide", np.where(speed > STILL, "roll", resting))


def of_shots(problem: ShotProblem, tracks: Sequence[Track], clip_set: ClipSet) -> Samples:
    """Every trusted sample of moving balls with what the model says of that moment."""
    parts: list[Samples] = []
    stretches = 0
    for k, track in enumerate(tracks):
        clip = clip_set.clips[k]
        for b, name in enumerate(track.names):
            seen = clip.balls[name]
            miss, angle = residual(track, b, seen, len(seen.time))
            index = np.searchsorted(track.times, seen.time)
            v, w = track.velocity[index, b], track.spin[index, b]
            own = [e for e in track.events if name in e.balls]
            when = np.array([0.0, *[e.time for e in own]])
            count = np.searchsorted(when[1:], seen.time)
            keep = problem.trusted[k][name] & np.isfinite(v[:, 0]) & ((count > 0) | (b == 0))
            slip, motion = motions(v, w, clip_set.ball.radius)
            kinds = np.array(["strike", *[e.kind for e in own]])
            rails = np.array(["", *[e.rail for e in own]])
            n, count = int(keep.sum()), count[keep]
            parts.append(Samples(
                np.full(n, k, dtype=np.int64), (name,) * n, np.full(n, b == 0), seen.time[keep], seen.xy[keep],
                miss[keep], np.hypot(*v[keep].T), np.arctan2(v[keep, 1], v[keep, 0]), w[keep, 2],
                _words(motion[keep]), _words(kinds[count]), count.astype(np.int64), angle[keep], slip[keep],
                _words(rails[count]), seen.time[keep] - when[count], stretches + count.astype(np.int64),
            ))  # fmt: skip
            stretches += len(own) + 1
    return joined(parts)


def of_stretches(problem: SegmentProblem, x: Array, good: NDArray[np.bool_], tracks: Sequence[Track]) -> Samples:
    """Every sample of the stretches between events, each with its own unknowns x (n, 7), where `good` (n,).

    A stretch by itself does not tell its sidespin: that is taken from the whole shots' tracks.
    """
    radius = problem.model.ball.radius
    which = np.arange(len(x))
    c = np.tile([float(problem.model.parameters()[n]) for n in problem.names], (len(x), 1))
    missed = problem.evaluate(x, c, which) * problem.noise
    parts: list[Samples] = []
    seen: dict[tuple[int, str], int] = {}
    played = simulate(problem.model, begin(problem, x))
    for k, (s, track) in enumerate(zip(problem.segments, played, strict=True)):
        met = seen.get((s.clip, s.ball), 0 if s.before == "strike" else 1)
        seen[s.clip, s.ball] = met + 1
        if not good[k]:
            continue
        n = len(s.time)
        v, w = track.velocity[:, 0], track.spin[:, 0]
        slip, motion = motions(v, w, radius)
        whole = tracks[s.clip]
        b = whole.names.index(s.ball)
        sidespin = np.interp(s.time, whole.times, np.nan_to_num(whole.spin[:, b, 2]))
        parts.append(Samples(
            np.full(n, s.clip), (s.ball,) * n, np.full(n, b == 0), s.time, s.xy, missed[k, : 2 * n].reshape(n, 2),
            np.hypot(*v.T), np.arctan2(v[:, 1], v[:, 0]), sidespin, _words(motion), (s.before,) * n, np.full(n, met),
            np.full(n, np.nan), slip, (s.rail,) * n, s.time - s.time[0], np.full(n, k),
        ))  # fmt: skip
    return joined(parts)


def begin(problem: SegmentProblem, x: Array) -> list[Shot]:
    """The stretches' own unknowns (n, 7) as shots of one ball."""
    radius = problem.model.ball.radius
    shots = []
    for row, azimuth, s in zip(x, problem.azimuth, problem.segments, strict=True):
        q = turn(azimuth)
        spin = np.array([[*(q @ row[4:6]), row[6]]]) / radius
        shots.append(Shot(("ball",), row[None, :2], (q @ row[2:4])[None], spin, s.time - s.time[0]))
    return shots


def joined(parts: Sequence[Samples]) -> Samples:
    """Samples one after another."""
    if not parts:
        none, index = np.empty(0), np.empty(0, dtype=np.int64)
        pair, no = np.empty((0, 2)), np.empty(0, dtype=bool)
        return Samples(index, (), no, none, pair, pair, none, none, none, (), (), index, none, none, (), none, index)
    whole: dict[str, Any] = {}
    for key in vars(parts[0]):
        values = [getattr(p, key) for p in parts]
        whole[key] = sum(values, ()) if isinstance(values[0], tuple) else np.concatenate(values)
    return Samples(**whole)


def _words(values: NDArray[np.str_]) -> tuple[str, ...]:
    return tuple(map(sys.intern, values.tolist()))  # a word once, however many samples it is of
