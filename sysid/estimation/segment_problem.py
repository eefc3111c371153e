"""Segments between events as a least-squares problem: motion on open cloth, each with its initial state.

In: a model, segments and the noise of the camera. Out: a `SegmentProblem`, which evaluates residuals.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from models.engine.play import Layout
from models.model_file import Model
from models.shot import Shot
from models.simulation.observe import observed
from sysid.clips.segments import Segment
from sysid.estimation.problem import STATE_STEPS, Array, Index, ball_of, by_events, on_open_table, state_bounds
from sysid.estimation.residual_rows import MeasuredShot, ShotData, Weighting, packed, residuals
from sysid.estimation.solver.least_squares import Evaluate, Objective, Prior
from sysid.estimation.states.start_values import running_sd, straight

START_SAMPLES = 6  # a straight line through these first samples starts a segment


@dataclass(frozen=True)
class SegmentProblem:
    """Segments between events, on open cloth without cushions."""

    model: Model
    names: tuple[str, ...]  # constants
    segments: tuple[Segment, ...]
    noise: float  # one standard deviation per axis [m]
    start: Array  # (n, 7)
    azimuth: Array  # (n,)
    prior: Prior
    data: ShotData

    def only(self, rows: Index) -> SegmentProblem:
        """Some of the segments."""
        return dataclasses.replace(
            self, segments=tuple(self.segments[k] for k in rows), start=self.start[rows], azimuth=self.azimuth[rows],
            prior=self.prior.only(rows), data=self.data.only(rows),
        )  # fmt: skip

    def spinning(self, roll: float) -> Array:
        """Start values of fits, with spins of `roll` times natural roll: (n, 7)."""
        start = self.start.copy()
        start[:, 5] *= roll
        return start

    def objective(self, cauchy_sd: float) -> Objective:
        """The objective of a fit of initial states, with Cauchy's constant in standard deviations."""
        high = state_bounds(self.model.table, self.model.ball)
        bounds = np.column_stack([-high, high])
        return Objective(self.evaluate, STATE_STEPS, self.prior, cauchy_sd, bounds=bounds, part=self._part)

    def _part(self, rows: Index) -> Evaluate:
        """`evaluate` of some of the segments."""
        return self.only(rows).evaluate

    @cached_property
    def layout(self) -> Layout | None:
        """The model, laid out for the event engine; None if MuJoCo plays it."""
        return Layout(self.model, self.names) if by_events(self.model) else None

    @cached_property
    def size(self) -> int:
        """Length of a row of residuals: x and y of every sample of the longest segment."""
        return 2 * max(len(s.time) for s in self.segments)

    def evaluate(self, x: Array, c: Array, which: Index) -> Array:
        """Residuals over the noise: (k, 2 m)."""
        if self.layout is not None:
            n = len(self.segments)
            weighting = Weighting(np.full(self.data.theta.shape, self.noise), np.ones(n), np.full(n, np.inf))
            return residuals(self.layout, self.data, weighting, x, c, which, self.size)
        return self._in_mujoco(x, c, which)

    def shot(self, x: Array, segment: int) -> Shot:
        """The shot of one ball that an initial state (7,) of a segment stands for."""
        position, velocity, spin = ball_of(x, self.azimuth[segment], self.model.ball.radius)
        time = self.segments[segment].time
        return Shot(("ball",), position[None], velocity[None], spin[None], time - time[0])

    def _in_mujoco(self, x: Array, c: Array, which: Index) -> Array:
        segments = [self.segments[w] for w in which]
        shots = [
            dataclasses.replace(self.shot(row, w), session=s.session, struck=s.before == "strike")
            for row, w, s in zip(x, which, segments, strict=True)
        ]
        values = {n: c[:, k] for k, n in enumerate(self.names)}
        tracks = observed(self.model.with_values(values), shots, [float(s.time[0]) for s in segments])
        out = np.full((len(x), self.size), np.nan)
        for k, (track, s) in enumerate(zip(tracks, segments, strict=True)):
            r = (track.position[:, 0] - s.xy) / self.noise
            out[k, : r.size] = r.ravel()
        return out


def segment_problem(model: Model, names: Sequence[str], segments: Sequence[Segment], noise: float) -> SegmentProblem:
    """Set up segments with start values: a straight line through the first samples, rolling."""
    open_cloth = on_open_table(model)
    start, azimuth = np.zeros((len(segments), 7)), np.zeros(len(segments))
    for k, s in enumerate(segments):
        n = min(START_SAMPLES, len(s.time))
        start[k], azimuth[k] = straight(s.time[:n] - s.time[0], s.xy[:n], 1.0)
    sd = np.array([running_sd(v) for v in start[:, 2]])
    data = packed([
        MeasuredShot(
            [s.time - s.time[0]], [s.xy], [np.full(len(s.time), np.nan)], [np.ones(len(s.time), bool)],
            np.zeros((0, 2)), [False], a, s.session, s.before == "strike", float(s.time[0]),
        )
        for s, a in zip(segments, azimuth, strict=True)
    ])  # fmt: skip
    return SegmentProblem(open_cloth, tuple(names), tuple(segments), noise, start, azimuth, Prior(start, sd), data)
