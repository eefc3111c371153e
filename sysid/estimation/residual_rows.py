"""Residuals of many shots, compiled: the event engine plays each, the camera model observes it, its clip is subtracted.

In: rows of initial states and constants, and what was measured. Out: one row of residuals for each.

Only the residuals of a simulated shot are stored, so that memory does not grow with the length of the clips.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.analytic.geometry import TableGeometry
from models.compiled import compiled, compiled_in_place, compiled_within
from models.engine.columns import ROW_SIZE
from models.engine.impacts import deliver
from models.engine.loop import play_shot
from models.engine.play import MAX_EVENTS, Layout
from models.engine.workspace import Forces, Options, ShotLaws, ShotLog, workspace
from models.errors import BadInput
from models.hooks import STROKE_FIELDS
from models.shot import Session
from models.simulation.observe import camera, expose, see, unsee
from models.workers.threads import over_threads

Array = NDArray[np.float64]
Index = NDArray[np.int64]
RESIDUALS_PER_SAMPLE = 3  # two of the position, one of the mark's angle
MOTION_SIZE = 5  # unknowns of another ball that moves at the start: velocity (2), R omega (3) [m/s], table frame
BACKWARDS_IN_TIME = 1  # fault of a row: its camera looked before the shot, or backwards in time


@dataclass(frozen=True)
class MeasuredShot:
    """The measurements of one shot; lists hold one entry per ball, the struck one first."""

    times: Sequence[Array]  # (s,) [s] from the start of the shot
    positions: Sequence[Array]  # (s, 2) [m]
    angles: Sequence[Array]  # (s,) of the mark [rad], nan where none was seen
    trusted: Sequence[NDArray[np.bool_]]  # (s,) positions to use
    rest: Array  # (b - 1, 2) [m], positions at which the camera first sees the other balls
    stays: Sequence[bool]  # whether the ball is not pocketed
    azimuth: float  # [rad], into which the initial state is turned
    session: Session
    struck: bool  # by a cue, or in motion from the start
    begun: float = 0.0  # [s], the stamp at which the shot begins
    moving: int = 1  # balls that move at its start, the first ones


class ShotData(NamedTuple):
    """The measurements of shots, laid out for compiled code: n shots of at most b balls with s samples each.

    The residuals of a shot come ball after ball: positions (2 s) and angles (s), with s the ball's number of samples.
    """

    stamps: Array  # (n, m) [s], every time at which any ball was seen, inf beyond
    begun: Array  # (n,) [s], the stamp at which each shot begins
    azimuth: Array  # (n,) [rad], into which initial states are turned
    session: Array  # (n, SESSION_FIELDS)
    struck: NDArray[np.bool_]  # (n,)
    balls: Index  # (n,) how many there are
    moving: Index  # (n,) how many of them, the first ones, move at the start
    rest: Array  # (n, b, 2) [m], where the camera first sees the others; the first is not used
    stays: NDArray[np.bool_]  # (n, b), balls that are not pocketed
    count: Index  # type: ignore[assignment]  # (n, b) samples of each ball; hides tuple.count
    at: Index  # (n, b, s) number of a sample's stamp
    xy: Array  # (n, b, s, 2) [m]
    theta: Array  # (n, b, s) [rad], nan where no mark was seen
    trusted: NDArray[np.bool_]  # (n, b, s) positions to use

    @property
    def size(self) -> int:
        """Residuals of the longest shot."""
        return int((RESIDUALS_PER_SAMPLE * self.count.sum(axis=1)).max(initial=0))

    def only(self, rows: Index) -> ShotData:
        """Some of the shots."""
        return ShotData._make(every[rows] for every in self)


class Weighting(NamedTuple):
    """The weights of the samples of n shots, as standard deviations."""

    sd: Array  # (n, b, s) of each sample's position [m]
    sd_theta: Array  # (n,) of a mark's angle [rad]
    horizon: Array  # (n,) end of the part of a shot that counts [s]

    def only(self, rows: Index) -> Weighting:
        """The weighting of some of the shots."""
        return Weighting(self.sd[rows], self.sd_theta[rows], self.horizon[rows])


class StateRows(NamedTuple):
    """Rows of unknowns of shots."""

    x: Array  # (k, p) initial states, as in `residuals`
    which: Index  # (k,) number of the shot of each


class ResidualRows(NamedTuple):
    """What is written of rows."""

    out: Array  # (k, size) residuals over their standard deviations
    faults: Index  # (k,) 0 where a row could be played
    ends: Array  # (k, b, 7), or of no rows, as in `residuals`


class RowArrays(NamedTuple):
    """Arrays that a row of at most b balls and m stamps is played in; no events are logged."""

    start: Array  # (b, ROW_SIZE)
    track: Array  # (m, b, ROW_SIZE)
    cue: Array  # (STROKE_FIELDS,)
    log: Array  # (0,) as the next ones in `ShotLog`
    who: Index
    counts: Index
    potted: NDArray[np.bool_]  # (b,)


@dataclass(frozen=True)
class ShotResiduals:
    """Residuals of n shots as a function of initial states, constants and numbers of shots, see `residuals`."""

    layout: Layout
    data: ShotData
    weighting: Weighting

    def __call__(self, x: Array, c: Array, which: Index) -> Array:
        """Residuals over their standard deviation: (k, m)."""
        return residuals(self.layout, self.data, self.weighting, x, c, which, self.data.size)

    def only(self, rows: Index) -> ShotResiduals:
        """The function of some of the shots."""
        return ShotResiduals(self.layout, self.data.only(rows), self.weighting.only(rows))


def packed(shots: Sequence[MeasuredShot], balls: int = 1) -> ShotData:
    """Lay out shots, and room for so many balls at least, for compiled code."""
    n, b = len(shots), max([balls, *(len(shot.times) for shot in shots)])
    s = max((len(t) for shot in shots for t in shot.times), default=0)
    union = [np.unique(np.concatenate(shot.times)) for shot in shots]
    out = ShotData(
        np.full((n, max((len(u) for u in union), default=0)), np.inf), np.array([shot.begun for shot in shots], float),
        np.array([shot.azimuth for shot in shots], float), np.array([shot.session.row for shot in shots]),
        np.array([shot.struck for shot in shots], bool), np.array([len(shot.times) for shot in shots], np.int64),
        np.array([shot.moving for shot in shots], np.int64), np.zeros((n, b, 2)), np.zeros((n, b), bool),
        np.zeros((n, b), np.int64), np.zeros((n, b, s), np.int64),
        np.zeros((n, b, s, 2)), np.full((n, b, s), np.nan), np.zeros((n, b, s), bool),
    )  # fmt: skip
    for k, shot in enumerate(shots):
        out.stamps[k, : len(union[k])] = union[k]
        out.rest[k, 1 : 1 + len(shot.rest)] = shot.rest
        out.stays[k, : len(shot.stays)] = shot.stays
        for i, t in enumerate(shot.times):
            m = len(t)
            out.count[k, i] = m
            out.at[k, i, :m] = np.searchsorted(union[k], t)
            out.xy[k, i, :m], out.theta[k, i, :m] = shot.positions[i], shot.angles[i]
            out.trusted[k, i, :m] = shot.trusted[i]
    return out


def residuals(
    layout: Layout,
    samples: ShotData,
    weighting: Weighting,
    x: Array,
    c: Array,
    which: Index,
    size: int,
    ends: Array | None = None,
) -> Array:
    """Residuals over their standard deviation of rows of unknowns: (k, size), nan where there is none.

    Args:
        layout: table, ball and effects, and which constants `c` has values of.
        samples: measurements of n shots.
        weighting: their weights.
        x: (k, p) initial states: position, velocity, surface speed of the first ball; displacement of each other one;
            velocity and surface speed of the others that move at the start.
        c: (k, q) constants.
        which: (k,) numbers of the shots.
        size: of a row of residuals.
        ends: (k, b, 7) filled with place, velocity and spin of each ball at the last stamp; states are then true, not
            as the camera sees them. None where they are not asked for.
    """
    k = len(x)
    out = np.empty((k, size))
    if k == 0:
        return out
    game = layout.game(c)
    states = StateRows(np.ascontiguousarray(x), which)
    rows = ResidualRows(out, np.zeros(k, np.int64), np.zeros((0, 0, 0)) if ends is None else ends)

    def part(first: int, last: int) -> None:
        out[first:last] = np.nan
        residual_rows(first, last, states, samples, weighting, game, rows)

    over_threads(part, k)
    if (rows.faults == BACKWARDS_IN_TIME).any():
        effects = ", ".join(e.name() for e in camera(layout.model) if e.opens("exposures"))
        raise BadInput(f"{effects}: exposures run backwards, or to before the shot; correct the effect or its bounds")
    return out


@compiled_within
def stamps_until(stamps, horizon):  # type: ignore[no-untyped-def]
    """How many of a shot's stamps (m,) come up to a time; what pads them, inf, never does."""
    seen = 0
    while seen < stamps.size and stamps[seen] <= horizon + 1e-9 and stamps[seen] < np.inf:
        seen += 1
    return seen


@compiled_within
def _lay_struck(start, u, azimuth, radius):  # type: ignore[no-untyped-def]
    """The struck ball's initial state, turned from its clip's direction (azimuth) into the table's."""
    cs, sn = math.cos(azimuth), math.sin(azimuth)
    start[:] = 0.0
    start[0, 0], start[0, 1] = u[0], u[1]
    start[0, 2], start[0, 3] = cs * u[2] - sn * u[3], sn * u[2] + cs * u[3]
    start[0, 4], start[0, 5] = (cs * u[4] - sn * u[5]) / radius, (sn * u[4] + cs * u[5]) / radius
    start[0, 6] = u[6] / radius


@compiled_within
def _lay_moving(start, u, most, moving, radius):  # type: ignore[no-untyped-def]
    """Motions of the other balls of a clip that begins in mid-shot."""
    for i in range(1, moving):
        unknown = 5 + 2 * most + MOTION_SIZE * (i - 1)
        for k in range(MOTION_SIZE):
            start[i, 2 + k] = u[unknown + k] if k < 2 else u[unknown + k] / radius


@compiled_within
def _hold_last(track, played, seen, potted, start):  # type: ignore[no-untyped-def]
    """Leave balls that have been potted, and all where a shot is given up, where they were last, and as fast."""
    for i in range(potted.size):
        for k in range(played, seen):
            for x in range(ROW_SIZE):
                track[k, i, x] = track[k - 1, i, x] if k > 0 else start[i, x]
        if potted[i]:
            for k in range(1, seen):
                if track[k, i, 0] != track[k, i, 0]:
                    for x in range(4):
                        track[k, i, x] = track[k - 1, i, x]


@compiled_within
def _write_row(out, w, seen, track, samples, weighting):  # type: ignore[no-untyped-def]
    """Residuals of shot w: places and angles against its samples, over their standard deviations."""
    count, at, xy, theta = samples.count[w], samples.at[w], samples.xy[w], samples.theta[w]
    trusted, sd, sd_theta = samples.trusted[w], weighting.sd[w], weighting.sd_theta[w]
    to = 0
    for i in range(samples.balls[w]):
        marked, mean = 0, 0.0
        for k in range(count[i]):
            s = at[i, k]
            if s >= seen:
                break
            if trusted[i, k]:
                for axis in range(2):
                    out[to + 2 * k + axis] = (track[s, i, axis] - xy[i, k, axis]) / sd[i, k]
            angle = track[s, i, 7] - theta[i, k]
            if angle == angle:
                marked, mean = marked + 1, mean + angle
                out[to + 2 * count[i] + k] = angle
        # The angle at which the mark begins is unknown: the mean removes it, as a fitted offset would.
        if marked > 0:
            for k in range(count[i]):
                at_angle = to + 2 * count[i] + k
                out[at_angle] = (out[at_angle] - mean / marked) / sd_theta
        to += 3 * count[i]


@compiled_in_place
def _play_row(work, game, samples, arrays, row, w, looked):  # type: ignore[no-untyped-def]
    """Play row number `row` of a shot w from `arrays.start`, sampled at the times `looked` into `arrays.track`.

    A function of its own, which counts none of the arrays that it puts together: see `compiled_in_place`.
    """
    hooks, cloth, pockets, limits, half, mass, radii = game
    n, radius, start, own = samples.balls[w], radii[row], arrays.start, hooks.own[row].ctypes.data
    launch = 0.0
    if samples.struck[w]:
        launch = deliver(start[0, 2:4], start[0, 4:7], own, hooks.strike, radius, mass, arrays.cue)
    geometry = TableGeometry(radius, limits[row], half[row], pockets.ends, pockets.jaws, pockets.falls)
    forces = Forces(own, hooks.forces, hooks.support)
    laws = ShotLaws(forces, hooks.horizon, hooks.impact, cloth[row], mass, samples.session[w], launch)
    track, potted = arrays.track[: looked.size, :n], arrays.potted[:n]
    record = ShotLog(looked, track, arrays.log, arrays.who, arrays.counts, potted, work.cursor)
    options = Options(looked[looked.size - 1], MAX_EVENTS, True)
    play_shot(work, start[:n], samples.stays[w, :n], geometry, laws, options, record)


@compiled
def residual_rows(first, last, states, samples, weighting, game, rows):  # type: ignore[no-untyped-def]
    """Residuals of rows number `first` to `last` of `StateRows`, into `ResidualRows`; see `residuals`."""
    (x, which), (out, faults, ends) = states, rows
    hooks, radius = game.hooks, game.radius
    observe, exposures, rest = hooks.observe, hooks.exposures, samples.rest
    stamps, begun, session = samples.stamps, samples.begun, samples.session
    most = rest.shape[1]
    track = np.zeros((stamps.shape[1], most, ROW_SIZE))
    position, velocity = np.zeros((stamps.shape[1], most, 2)), np.zeros((stamps.shape[1], most, 2))
    start, place = np.zeros((most, ROW_SIZE)), np.zeros((most, 2))
    arrays = RowArrays(
        start, track, np.zeros(STROKE_FIELDS), np.zeros(0), np.zeros((0, 3), np.int64), np.zeros(4, np.int64),
        np.zeros(most, np.bool_),
    )  # fmt: skip
    curved = hooks.forces.shape[0] > 0
    size, work = most, workspace(most, curved)
    for row in range(first, last):
        w = which[row]
        n, here = samples.balls[w], hooks.own[row].ctypes.data
        u = x[row]
        _lay_struck(start, u, samples.azimuth[w], radius[row])
        for i in range(1, n):
            place[i, 0], place[i, 1] = rest[w, i, 0] + u[5 + 2 * i], rest[w, i, 1] + u[6 + 2 * i]
        if observe.shape[0] > 0 and n > 1 and ends.shape[0] == 0:
            unsee(place[1:n].copy(), session[w], here, observe, place[1:n])
        for i in range(1, n):
            start[i, 0], start[i, 1] = place[i, 0], place[i, 1]
        _lay_moving(start, u, most, samples.moving[w], radius[row])
        seen = stamps_until(stamps[w], weighting.horizon[w])
        if seen == 0:
            continue
        looked = stamps[w, :seen].copy()
        moment = looked
        if exposures.shape[0] > 0:
            moment = expose(looked + begun[w], here, exposures)
            since = expose(begun[w : w + 1], here, exposures)[0]
            looked = moment - since
            back = looked[0] < 0.0
            for k in range(1, seen):
                back = back or looked[k] < looked[k - 1]
            if back:
                faults[row] = BACKWARDS_IN_TIME
                continue
        if n != size:
            size, work = n, workspace(n, curved)
        _play_row(work, game, samples, arrays, row, w, looked)
        if ends.shape[0] > 0:
            ends[row, :n] = track[seen - 1, :n, :7]
        _hold_last(track, work.cursor[0], seen, arrays.potted[:n], start)
        if observe.shape[0] > 0:
            position[:seen, :n], velocity[:seen, :n] = track[:seen, :n, :2], track[:seen, :n, 2:4]
            see(position[:seen, :n], velocity[:seen, :n], moment, session[w], here, observe)
            track[:seen, :n, :2] = position[:seen, :n]
        _write_row(out[row], w, seen, track, samples, weighting)
