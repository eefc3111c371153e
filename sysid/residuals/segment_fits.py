"""Segments between events, each with its fitted initial state.

In: a clip set, a model and the noise of the camera. Out: a `SegmentFits`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from models.model_file import Model
from models.shot import Track
from models.simulation.simulate import simulate
from sysid.clips import ClipSet
from sysid.clips.segments import split_all
from sysid.estimation.open_cloth import START_CAUCHY_SD, UNSEEN_EVENT_RATIO, cloth_constants, ratios
from sysid.estimation.problem import STATE_STEPS, Array, values_of
from sysid.estimation.segment_problem import SegmentProblem, segment_problem
from sysid.estimation.solver.least_squares import fit_each
from sysid.estimation.states.state_search import state_information

MAX_FIT_STEPS = 10
START_ROLLS = (1.0, 0.0)  # start values of a segment's spin, over natural roll


@dataclass(frozen=True)
class SegmentFits:
    """Segments between events, each with its fitted initial state."""

    problem: SegmentProblem
    initial_states: Array  # (n, 7)
    ratio: Array  # (n,) rms residual per axis over the noise

    @property
    def good(self) -> NDArray[np.bool_]:
        """Which segments contain no undetected event: (n,)."""
        return np.asarray(self.ratio < UNSEEN_EVENT_RATIO)

    @cached_property
    def tracks(self) -> list[Track]:
        """The segments as the model plays them from their initial states."""
        x = self.initial_states
        return simulate(self.problem.model, [self.problem.shot(row, k) for k, row in enumerate(x)])

    @cached_property
    def velocity_sds(self) -> Array:
        """Standard deviations per axis of the velocities at the beginning and end of each segment: (n, 2) [m/s].

        They follow from the information on the initial state, including its prior.
        """
        p, x = self.problem, self.initial_states
        c, every = values_of(p.model, p.names), np.arange(len(x))
        covariance = np.linalg.inv(state_information(p.objective(START_CAUCHY_SD), x, c, every))
        steps = np.diag(STATE_STEPS)
        shots = [p.shot(row, k) for step in steps for k, row in enumerate(x + step)]
        end = np.array([track.velocity[-1, 0] for track in self.tracks])
        moved = np.array([track.velocity[-1, 0] for track in simulate(p.model, shots)]).reshape(len(steps), *end.shape)
        by_state = np.moveaxis((moved - end) / STATE_STEPS[:, None, None], 0, -1)  # (n, 2, p)
        at_end = np.einsum("nap,npq,naq->n", by_state, covariance, by_state)
        at_start = covariance[:, 2, 2] + covariance[:, 3, 3]
        return np.sqrt(np.column_stack([at_start, at_end]) / 2)


def sidespin(track: Track, ball: int, time: Array) -> Array:
    """Of a ball at times of a track [rad/s]."""
    return np.interp(time, track.times, np.nan_to_num(track.spin[:, ball, 2]))


def fit_segments(clip_set: ClipSet, model: Model, sigma: float, shots: Sequence[Track]) -> SegmentFits | None:
    """Fit the initial state of every segment at the model's constants; None without segments.

    Args:
        clip_set: what was measured.
        model: its constants are held.
        sigma: noise of positions per axis [m].
        shots: the whole shots of the model, whose sidespins are among those with which fits begin: a segment that
            began with another one would end at another optimum.
    """
    segments = split_all(clip_set.clips, clip_set.table, clip_set.ball, sigma, clip_set.fps)
    if not segments:
        return None
    names = cloth_constants(model)
    problem = segment_problem(model, names, segments, sigma)
    c = values_of(model, names)
    # A ball that slides is not found from one that rolls: its first samples would count as outliers.
    balls = [shots[s.clip].names.index(s.ball) for s in segments]
    spins = [sidespin(shots[s.clip], ball, s.time[:1])[0] for s, ball in zip(segments, balls, strict=True)]
    starts = [problem.spinning(roll) for roll in START_ROLLS]
    starts += [np.column_stack([start[:, :6], clip_set.ball.radius * np.array(spins)]) for start in starts]
    fits = [fit_each(problem.objective(START_CAUCHY_SD), start, c, MAX_FIT_STEPS) for start in starts]
    best = np.argmin([cost for _, cost in fits], axis=0)
    x = np.array([fits[k][0][row] for row, k in enumerate(best)])
    return SegmentFits(problem, x, ratios(problem, x, c))
