"""Comparisons to write reports of: straight shots that a model misses by a known length."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from models.model_file import full_model
from models.shot import Ball, Table, Track
from sysid.clips import Clip, ClipSet, Observation
from sysid.clips.tracker.slow_noise import SlowNoise
from sysid.residuals.comparison import ClipRow, Comparison, Group, SegmentRow
from sysid.residuals.impacts import no_impacts
from sysid.residuals.localise import find
from sysid.residuals.samples import Samples
from sysid.residuals.whiteness import whiteness

TABLE, BALL = Table(3.569, 1.778), Ball(0.0525, 0.1406)
NOISE = 0.0005  # of positions, per axis [m]
FPS, SECONDS, SLOWING = 120.0, 2.0, 0.12  # of balls that roll straight on
Array = NDArray[np.float64]


def comparison(count: int = 3, size: float = 0.002, file: str = "clips/{}.csv") -> Comparison:
    """Straight shots that slow down; the model misses by `size` times the time, towards +y."""
    rng = np.random.default_rng(7)
    model = full_model(TABLE, BALL)
    shots, tracks, rows, segments, parts = [], [], [], [], []
    for k in range(count):
        time = np.arange(0.0, 2.0, 0.02)
        heading, way = 0.4 * k, 1.0 * time - 0.2 * time**2
        cue = np.column_stack([way * math.cos(heading) - 1.0, way * math.sin(heading) - 0.5])
        red = np.broadcast_to([0.5, 0.3], cue.shape)
        balls = {name: Observation(time, xy, np.full(len(time), np.nan)) for name, xy in (("cue", cue), ("red", red))}
        shots.append(Clip(file.format(k), "cue", balls))
        miss = np.column_stack([0 * time, size * time]) + rng.normal(0, NOISE, (len(time), 2))
        position = np.stack([cue + miss, red], axis=1)
        position[-5:, 1] = np.nan
        still = np.zeros((*position.shape[:2], 3))
        tracks.append(Track(("cue", "red"), time, position, still[..., :2], still, still[..., 0]))
        rms = float(np.sqrt((miss**2).sum(axis=1).mean()))
        rows.append(ClipRow(shots[-1].file, rms, 0.9 * rms, 40.0 + k, k % 2 == 1))
        segments.append(SegmentRow(shots[-1].file, "cue", "strike", 0.0, 1.0, 1.0, 1.1 + k))
        parts.append((np.full(len(time), k), time, cue, miss, 1.0 - 0.4 * time, np.full(len(time), heading)))
    clip, time, xy, miss, speed, heading_ = (
        [np.concatenate(p) for p in zip(*parts, strict=True)]
        if parts
        else [np.empty(0, dtype=np.int64), np.empty(0), np.empty((0, 2)), np.empty((0, 2)), np.empty(0), np.empty(0)]
    )
    n = len(time)
    motion = tuple("slide" if t < 0.5 else "roll" if t < 1.8 else "rest" for t in time)
    samples = Samples(
        clip, ("cue",) * n, np.ones(n, dtype=bool), time, xy, miss, speed, heading_, 20 * speed, motion,
        ("strike",) * n, (time > 1).astype(np.int64), np.full(n, np.nan), 0.1 * speed, ("",) * n, time, clip,
    )  # fmt: skip
    where = (
        Group("phase", "while rolling", 0.00123, 1.74, 210),
        Group("phase", "while sliding", 0.00777, 10.99, 90),
        Group("own kind", "behind the <sofa>", math.nan, math.nan, 3),
    )
    clip_set = ClipSet(TABLE, BALL, 50.0, tuple(shots), NOISE)
    return Comparison(
        clip_set=clip_set, model=model, noise_m=NOISE, slow_noise=SlowNoise(), clips=tuple(rows),
        segments=tuple(segments), where=where if n else (), samples=samples, tracks=tuple(tracks), shots=tuple(shots),
        initial_states=np.zeros((count, 7)), segment_samples=samples, impacts=no_impacts(),
        local=find(samples, samples, no_impacts(), TABLE, count, NOISE, 1.0), white=whiteness(samples, NOISE),
    )  # fmt: skip


def rolled(lacks: Callable[[Array, Array, Array], Array], balls: int = 60, seed: int = 3) -> Comparison:
    """Balls that roll straight on every way, and lack an acceleration by place, direction (n, 2) and speed (n,)."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, SECONDS, 1 / FPS)
    n, parts = len(time), []
    for k in range(balls):
        speed, heading = rng.uniform(0.3, 1.2), rng.uniform(-np.pi, np.pi)
        way = np.array([np.cos(heading), np.sin(heading)])
        start = rng.uniform(-0.42, 0.42, 2) * (TABLE.length, TABLE.width) - 0.3 * speed * way
        fast = np.maximum(speed - SLOWING * time, 0.05)
        xy = start + np.outer(np.cumsum(fast) / FPS, way)
        acceleration = lacks(xy, np.tile(way, (n, 1)), fast)
        missed = np.cumsum(np.cumsum(acceleration, axis=0), axis=0) / FPS**2
        seen = missed + rng.normal(0.0, NOISE, (n, 2))
        parts.append((k, time, xy, -seen, fast, np.full(n, heading)))
    clip = np.repeat(np.arange(balls), n)
    times, xy, residual, fast, heading_ = (np.concatenate([part[j] for part in parts]) for j in range(1, 6))
    count = len(clip)
    zero = np.zeros(count)
    samples = Samples(
        clip, ("cue",) * count, np.ones(count, bool), times, xy, residual, fast, heading_, zero, ("roll",) * count,
        ("strike",) * count, np.zeros(count, np.int64), np.full(count, np.nan), zero, ("",) * count, times, clip,
    )  # fmt: skip
    return dataclasses.replace(comparison(0), segment_samples=samples, tracks=())
