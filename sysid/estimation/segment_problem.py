"""Segments between events as a least-squares problem: motion on open cloth, each with an initial state of its own."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from models.engine.play import Layout
from models.model_file import Model
from models.simulation.observe import observed
from sysid.clips.segments import Segment
from sysid.estimation.least_squares import Prior
from sysid.estimation.problem import Array, Index, by_events, open_table, shot_of
from sysid.estimation.residual_rows import ShotData, packed, residuals
from sysid.estimation.start_values import running_sd, straight

START_SAMPLES = 6  # a straight line through so many is where a segment begins


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

    @cached_property
    def layout(self) -> Layout | None:
        """The model, laid out for the event engine; None where MuJoCo plays it."""
        return Layout(self.model, self.names) if by_events(self.model) else None

    def evaluate(self, x: Array, c: Array, which: Index) -> Array:
        """Residuals over the noise: (k, 2 m)."""
        if self.layout is not None:
            n, size = len(self.segments), 2 * max(len(s.time) for s in self.segments)
            sd = np.full(self.data.theta.shape, self.noise)
            return residuals(self.layout, self.data, sd, np.ones(n), np.full(n, np.inf), x, c, which, size)
        return self._in_mujoco(x, c, which)

    def _in_mujoco(self, x: Array, c: Array, which: Index) -> Array:
        segments = [self.segments[w] for w in which]
        shots = [
            shot_of(
                ("ball",), row, self.azimuth[w], self.model.ball.radius, np.zeros((0, 2)), s.time - s.time[0], s.order,
                s.before == "strike",
            )
            for row, w, s in zip(x, which, segments, strict=True)
        ]  # fmt: skip
        values = {n: c[:, k] for k, n in enumerate(self.names)}
        tracks = observed(self.model.with_values(values), shots, [float(s.time[0]) for s in segments])
        out = np.full((len(x), 2 * max(len(s.time) for s in self.segments)), np.nan)
        for k, (track, s) in enumerate(zip(tracks, segments, strict=True)):
            r = (track.position[:, 0] - s.xy) / self.noise
            out[k, : r.size] = r.ravel()
        return out


def segment_problem(model: Model, names: Sequence[str], segments: Sequence[Segment], noise: float) -> SegmentProblem:
    """Set up segments with starting values: straight through the first samples, rolling."""
    open_cloth = dataclasses.replace(model, table=open_table(model.table))
    start, azimuth = np.zeros((len(segments), 7)), np.zeros(len(segments))
    for k, s in enumerate(segments):
        n = min(START_SAMPLES, len(s.time))
        start[k], azimuth[k] = straight(s.time[:n] - s.time[0], s.xy[:n], 1.0)
    sd = np.array([running_sd(v) for v in start[:, 2]])
    n = len(segments)
    data = packed(
        [[s.time - s.time[0]] for s in segments], [[s.xy] for s in segments],
        [[np.full(len(s.time), np.nan)] for s in segments], [[np.ones(len(s.time), bool)] for s in segments],
        [np.zeros((0, 2))] * n, [[False]] * n, azimuth, [s.order for s in segments],
        [s.before == "strike" for s in segments], [float(s.time[0]) for s in segments],
    )  # fmt: skip
    return SegmentProblem(open_cloth, tuple(names), tuple(segments), noise, start, azimuth, Prior(start, sd), data)
