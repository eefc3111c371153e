"""Model against measurement: each clip's own unknowns fitted, constants as they are, and where it fails."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.model_file import Model
from models.shot import Track
from sysid.clips import ClipSet
from sysid.clips.noise import position_noise
from sysid.clips.outliers import set_aside
from sysid.clips.segments import split_all
from sysid.estimation.discrepancy import events_and_paths
from sysid.estimation.initial_states import grown_states, polished
from sysid.estimation.least_squares import fit_each
from sysid.estimation.open_cloth import START_CAUCHY_SD, UNSEEN_EVENT_RATIO, cloth_constants, ratios
from sysid.estimation.problem import Array, by_events, values_of
from sysid.estimation.segment_problem import SegmentProblem, segment_problem
from sysid.estimation.shot_problem import ShotProblem, residual, shot_problem
from sysid.estimation.start_values import theta_noise
from sysid.residuals.collect import joined, of_shots, of_stretches
from sysid.residuals.comparison import ClipRow, Comparison, SegmentRow
from sysid.residuals.groups import groups
from sysid.residuals.impacts import impacts, no_impacts
from sysid.residuals.localise import find
from sysid.residuals.whiteness import whiteness

SEGMENT_STEPS = 10  # of the initial states of segments
Report = Callable[[str], None]


def compare(
    clip_set: ClipSet, model: Model, report: Report = lambda line: None, start: Array | None = None
) -> Comparison:
    """Compare whole clips and segments with a model; `start` (n, p) are own unknowns that are nearly right already."""
    sigma = position_noise(clip_set)
    clip_set, _ = set_aside(clip_set, sigma)
    parts = fit_stretches(clip_set, model, sigma)
    segments = parts.rows(clip_set) if parts else ()
    report(f"{len(segments)} segments between events")
    problem = shot_problem(model, (), clip_set, sigma)
    none = np.zeros(0)
    x = grown_states(problem, none) if start is None else start
    x = polished(problem, x, none)
    n = len(clip_set.clips)
    tracks = problem.tracks(x, np.zeros((n, 0)), np.arange(n))
    used = set(model.fitted.get("clips", ())) if model.fitted else set()
    held = {c.file for c in clip_set.clips} - used if used else set()
    rows = tuple(_clip_row(problem, clip_set, k, tracks[k], sigma, clip_set.clips[k].file in held) for k in range(n))
    in_mujoco: tuple[ClipRow, ...] = ()
    if by_events(model):
        report("the same constants in MuJoCo")
        in_mujoco = tuple(
            _clip_row(problem, clip_set, k, track, sigma, rows[k].held_out)
            for k, track in enumerate(with_mujoco(problem).tracks(x, np.zeros((n, 0)), np.arange(n)))
        )
    samples, stretches, met = of_shots(problem, tracks, clip_set), joined([]), no_impacts()
    if parts:
        report("stretches and impacts, one by one")
        stretches = of_stretches(parts.problem, parts.own, parts.good, tracks)
        met = impacts(parts.problem, parts.own, parts.good, parts.ratio, problem, tracks, clip_set)
    sd_theta = theta_noise(clip_set.clips)
    return Comparison(
        clip_set, model, sigma, rows, segments, groups(samples, segments, rows, clip_set, sigma, sd_theta), samples,
        tuple(tracks), clip_set.clips, x, stretches, met,
        find(stretches, samples, met, clip_set.table, n, sigma, sd_theta), whiteness(samples, sigma), in_mujoco,
    )  # fmt: skip


def with_mujoco(problem: ShotProblem) -> ShotProblem:
    """The same problem played in MuJoCo, the model that is delivered."""
    return dataclasses.replace(problem, model=dataclasses.replace(problem.model, engine="mujoco"))


@dataclass(frozen=True)
class Stretches:
    """Segments between events, each with its own unknowns."""

    problem: SegmentProblem
    own: Array  # (n, 7)
    ratio: Array  # (n,) rms residual per axis over the noise

    @property
    def good(self) -> NDArray[np.bool_]:
        """(n,) Those that hold no event that was not seen."""
        return np.asarray(self.ratio < UNSEEN_EVENT_RATIO)

    def rows(self, clip_set: ClipSet) -> tuple[SegmentRow, ...]:
        """Every segment's figures."""
        return tuple(
            SegmentRow(
                clip_set.clips[s.clip].file, s.ball, s.before, float(s.time[0]), float(s.time[-1]),
                float(np.hypot(x[2], x[3])), float(ratio),
            )
            for s, x, ratio in zip(self.problem.segments, self.own, self.ratio, strict=True)
        )  # fmt: skip


def fit_stretches(clip_set: ClipSet, model: Model, sigma: float) -> Stretches | None:
    """Fit every segment's own unknowns; None without any."""
    segments = split_all(clip_set.clips, clip_set.table, clip_set.ball, sigma, clip_set.fps)
    if not segments:
        return None
    names = cloth_constants(model)
    problem = segment_problem(model, names, segments, sigma)
    c = values_of(model, names)
    x, _ = fit_each(problem.objective(START_CAUCHY_SD), problem.start, c, SEGMENT_STEPS)
    return Stretches(problem, x, ratios(problem, x, c))


def _clip_row(problem: ShotProblem, clip_set: ClipSet, k: int, track: Track, sigma: float, held: bool) -> ClipRow:
    clip = clip_set.clips[k]
    square, count, moved, moved_count, chi, freedom = 0.0, 0, 0.0, 0, 0.0, -7
    for b, name in enumerate(track.names):
        seen = clip.balls[name]
        miss, _ = residual(track, b, seen, len(seen.time))
        distance = np.sum(miss**2, axis=1)
        if b == 0:
            square, count = float(distance.sum()), len(distance)
        if b == 0 or np.ptp(seen.xy, axis=0).max() > 0.003:
            moved, moved_count = moved + float(distance.sum()), moved_count + len(distance)
        trusted = problem.trusted[k][name]
        chi += float(distance[trusted].sum()) / sigma**2
        freedom += 2 * int(trusted.sum())
    return ClipRow(
        clip.file, float(np.sqrt(square / count)), float(np.sqrt(moved / moved_count)), chi / max(freedom, 1), held
    )


def coverage(comparison: Comparison, rate: float) -> float:
    """Share of held-out residuals inside the 95 % band of noise and the model's error rate; NaN without any."""
    clip_set, sigma = comparison.clip_set, comparison.noise_m
    _, way = events_and_paths(clip_set, sigma)
    inside = total = 0
    for k, row in enumerate(comparison.clips):
        if not row.held_out:
            continue
        track = comparison.tracks[k]
        for b, name in enumerate(track.names):
            seen = clip_set.clips[k].balls[name]
            miss, _ = residual(track, b, seen, len(seen.time))
            band = 1.96 * np.hypot(sigma, rate * way[k][name])[:, None]
            moving = way[k][name] > 0
            inside += int(np.sum(np.abs(miss[moving]) < band[moving]))
            total += 2 * int(moving.sum())
    return inside / total if total else float("nan")
