"""Model against measurement at the model's constants, the initial state of each clip fitted.

In: a clip set and a model. Out: a `Comparison`: errors of every clip and segment, and where the model fails.
"""

from __future__ import annotations

import dataclasses
import logging
import math

import numpy as np

from models.messages import counted
from models.model_file import Model
from models.shot import Track
from sysid.clips import ClipSet
from sysid.clips.tracker.noise import position_noise
from sysid.clips.tracker.outliers import remove_outliers
from sysid.clips.tracker.slow_noise import slow_noise
from sysid.estimation.chains.chain_search import found_states
from sysid.estimation.discrepancy import events_and_paths
from sysid.estimation.problem import STATE_STEPS, Array, by_events
from sysid.estimation.shot_problem import ShotProblem, residual, shot_problem
from sysid.estimation.solver.blas import on_one_blas_thread
from sysid.estimation.states.initial_states import polished
from sysid.estimation.states.start_values import theta_noise
from sysid.residuals.collect import joined, samples_of_segments, samples_of_shots
from sysid.residuals.comparison import ClipRow, Comparison, SegmentRow
from sysid.residuals.groups import groups
from sysid.residuals.impacts import impacts, no_impacts
from sysid.residuals.localise import find
from sysid.residuals.segment_fits import SegmentFits, fit_segments
from sysid.residuals.whiteness import whiteness

MUJOCO_CLIPS = 256  # clips played in MuJoCo at a time, to bound the memory
MOVED_M = 0.003  # a ball with a smaller range of positions was at rest
log = logging.getLogger(__name__)


@on_one_blas_thread
def compare(clip_set: ClipSet, model: Model, start: Array | None = None) -> Comparison:
    """Compare whole clips and segments with a model.

    Args:
        clip_set: the measurements.
        model: its constants are held.
        start: (n, p) initial states for a warm start; None to search them.
    """
    sigma = position_noise(clip_set)
    clip_set, _ = remove_outliers(clip_set, sigma)
    slow = slow_noise(clip_set, sigma)
    noise, in_means = math.hypot(sigma, slow.sd), slow.as_white(sigma)
    problem = shot_problem(model, (), clip_set, sigma, slow_noise=slow.sd)
    none = np.zeros(0)
    x = found_states(problem, np.zeros(0)) if start is None else start
    x = polished(problem, x, none)
    n = len(clip_set.clips)
    tracks = problem.tracks(x, np.zeros((n, 0)), np.arange(n))
    fits = fit_segments(clip_set, model, sigma, tracks)
    segments = _segment_rows(fits, clip_set, noise) if fits else ()
    log.info("%s between events", counted(len(segments), "segment"))
    used = set(model.fitted.get("clips", ())) if model.fitted else set()
    held = {c.file for c in clip_set.clips} - used if used else set()
    rows = tuple(_clip_row(problem, k, track, clip_set.clips[k].file in held) for k, track in enumerate(tracks))
    in_mujoco: tuple[ClipRow, ...] = ()
    if by_events(model):
        log.info("the same constants in MuJoCo")
        played = with_mujoco(problem)
        in_mujoco = tuple(
            _clip_row(problem, k, track, rows[k].held_out)
            for some in np.split(np.arange(n), range(MUJOCO_CLIPS, n, MUJOCO_CLIPS))
            for k, track in zip(some, played.tracks(x[some], np.zeros((len(some), 0)), some), strict=True)
        )
        del played
    samples, segment_samples, after = samples_of_shots(problem, tracks, clip_set), joined([]), no_impacts()
    if fits:
        log.info("segments and impacts, one by one")
        segment_samples = samples_of_segments(fits, tracks)
        after = impacts(fits, problem, tracks, clip_set, in_means)
    del problem, fits  # frees memory: with thousands of clips the arrays for fits are large
    sd_theta = theta_noise(clip_set.clips)
    return Comparison(
        clip_set, model, noise, slow, rows, segments, groups(samples, segments, rows, clip_set, noise, sd_theta),
        samples, tuple(tracks), clip_set.clips, x, segment_samples, after,
        find(segment_samples, samples, after, clip_set.table, n, in_means, sd_theta), whiteness(samples, noise),
        in_mujoco,
    )  # fmt: skip


def played_clips(clip_set: ClipSet, model: Model, start: Array | None = None) -> dict[str, Track]:
    """A model's whole shots by clip, as in `compare`, with the same arguments."""
    sigma = position_noise(clip_set)
    clip_set, _ = remove_outliers(clip_set, sigma)
    slow, none, n = slow_noise(clip_set, sigma), np.zeros(0), len(clip_set.clips)
    problem = shot_problem(model, (), clip_set, sigma, slow_noise=slow.sd)
    x = polished(problem, found_states(problem, np.zeros(0)) if start is None else start, none)
    tracks = problem.tracks(x, np.zeros((n, 0)), np.arange(n))
    return {clip.file: track for clip, track in zip(clip_set.clips, tracks, strict=True)}


def with_mujoco(problem: ShotProblem) -> ShotProblem:
    """The errors of the same problem played in MuJoCo, for which the model is exported."""
    return dataclasses.replace(problem, model=dataclasses.replace(problem.model, engine="mujoco"))


def _segment_rows(fits: SegmentFits, clip_set: ClipSet, noise: float) -> tuple[SegmentRow, ...]:
    """Figures of every segment; `noise` includes slow noise [m]."""
    share = fits.problem.noise / noise
    return tuple(
        SegmentRow(
            clip_set.clips[s.clip].file, s.ball, s.before, float(s.time[0]), float(s.time[-1]),
            float(np.hypot(x[2], x[3])), float(ratio) * share,
        )
        for s, x, ratio in zip(fits.problem.segments, fits.initial_states, fits.ratio, strict=True)
    )  # fmt: skip


def _clip_row(problem: ShotProblem, k: int, track: Track, held: bool) -> ClipRow:
    clip, sigma = problem.clips[k], problem.noise_of_fits
    square, count, moved, moved_count, chi, freedom = 0.0, 0, 0.0, 0, 0.0, -len(STATE_STEPS) * len(clip.first)
    for b, name in enumerate(track.names):
        seen = clip.balls[name]
        error, _ = residual(track, b, seen, len(seen.time))
        distance = np.sum(error**2, axis=1)
        if b == 0:
            square, count = float(distance.sum()), len(distance)
        if b == 0 or np.ptp(seen.xy, axis=0).max() > MOVED_M:
            moved, moved_count = moved + float(distance.sum()), moved_count + len(distance)
        trusted = problem.trusted[k][name]
        chi += float(distance[trusted].sum()) / sigma**2
        freedom += 2 * int(trusted.sum())
    return ClipRow(
        clip.file, float(np.sqrt(square / count)), float(np.sqrt(moved / moved_count)), chi / max(freedom, 1), held
    )


def coverage(comparison: Comparison, rate: float) -> float:
    """Share of held-out residuals inside the 95 % band of noise and discrepancy; NaN without held-out clips."""
    clip_set, sigma = comparison.clip_set, comparison.noise_m
    _, path = events_and_paths(clip_set, position_noise(clip_set))
    inside = total = 0
    for k, row in enumerate(comparison.clips):
        if not row.held_out:
            continue
        track = comparison.tracks[k]
        for b, name in enumerate(track.names):
            seen = clip_set.clips[k].balls[name]
            error, _ = residual(track, b, seen, len(seen.time))
            band = 1.96 * np.hypot(sigma, rate * path[k][name])[:, None]
            moving = path[k][name] > 0
            inside += int(np.sum(np.abs(error[moving]) < band[moving]))
            total += 2 * int(moving.sum())
    return inside / total if total else float("nan")
