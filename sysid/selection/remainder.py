"""Residual structure that no effect or formula explains: an oscillation of the camera, or an unknown error.

In: a fit (`Point`). Out: `unexplained` of result.json, or None if the residuals are noise.

The balls of a clip oscillate together in the image, with a phase that differs from clip to clip. So each clip has its
own amplitude and phase, and the frequency is the one that explains most over all clips (a periodogram, summed over
clips). Left out: initial states absorb part of an oscillation of less than a period per clip, so its amplitude is
underestimated.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.special import chdtrc

from sysid.estimation.fitted import Point
from sysid.estimation.problem import Array
from sysid.selection.departures import shared_cause
from sysid.selection.scoring.evidence import MAX_RESIDUAL_SD, correlation_time, excess_variance

MIN_EXCESS_VARIANCE = 0.1  # least variance beyond the noise that is reported, over that of the noise
MIN_CORRELATION_TIME = 1.5  # [samples]; with less correlation the noise is larger than stated, or has heavier tails
MAX_CHANCE = 1e-6  # largest probability that noise alone shows such an oscillation
EVENT_PLACES = {"ball": "collisions of balls", "cushion": "impacts at cushions", "start": "from the start of shots on"}
FREQUENCIES_PER_PERIOD = 4  # frequencies per period in the longest clip
MAX_FREQUENCY_HZ = 60.0
MIN_PERIODS = 2  # fewest periods in the longest clip
MIN_EXPLAINED_SHARE = 0.5  # of chi-square beyond noise, by one frequency: slow errors have some of each
MIN_CLIP_SAMPLES = 20
FREQUENCY_BATCH = 200  # frequencies evaluated at a time, to bound the memory


def remainder(now: Point) -> Mapping[str, Any] | None:
    """The structure that a fit leaves beyond noise, as `unexplained` of result.json; None if it is negligible."""
    excess = excess_variance(now)
    tau = correlation_time(now, now.discrepancy_rate)
    if excess < MIN_EXCESS_VARIANCE or tau < MIN_CORRELATION_TIME:
        return None
    where = EVENT_PLACES.get(shared_cause(now) or "", "not located")
    return oscillation(now) or {
        "where": where, "depends_on": [], "size": now.problem.noise * float(np.sqrt(excess)), "unit": "m",
        "what": f"error beyond the noise, rms, correlated over {tau:.0f} samples", "form": None,
        "delta_bic": None, "terms": [],
    }  # fmt: skip


def oscillation(point: Point) -> Mapping[str, Any] | None:
    """The camera's oscillation, as `unexplained` of result.json; None if there is none."""
    clips = [c for c in _by_clip(point) if len(c[0]) >= MIN_CLIP_SAMPLES]
    if not clips:
        return None
    longest = max(float(np.ptp(t)) for t, _ in clips)
    step = np.median([float(np.median(np.diff(np.unique(t)))) for t, _ in clips])
    frequency = np.arange(
        MIN_PERIODS * FREQUENCIES_PER_PERIOD, int(FREQUENCIES_PER_PERIOD * longest * min(0.5 / step, MAX_FREQUENCY_HZ))
    ) / (FREQUENCIES_PER_PERIOD * longest)
    if frequency.size == 0:
        return None
    power, size, gain = (np.zeros((2, frequency.size)) for _ in range(3))
    for time, r in clips:
        parts = np.array_split(frequency, frequency.size // FREQUENCY_BATCH + 1)
        waves = np.concatenate([np.exp(-2j * np.pi * f[:, None] * time) @ r for f in parts])
        for axis in range(2):
            found = 2 * np.abs(waves[:, axis]) ** 2 / len(time)
            power[axis] += found / max(float(np.mean(r[:, axis] ** 2)) - found.max() / len(time), 0.2)
            size[axis] += 2 * found / len(time)
            gain[axis] += found
    axis, k = (int(v) for v in np.unravel_index(int(np.argmax(power)), power.shape))
    chance = float(chdtrc(2 * len(clips), power[axis, k])) * power.size
    beyond = sum(float(np.sum(r**2 - 1)) for _, r in clips)
    if not chance < MAX_CHANCE or gain[axis, k] < MIN_EXPLAINED_SHARE * beyond:
        return None
    amplitude, f = point.problem.noise * float(np.sqrt(size[axis, k] / len(clips))), float(frequency[k])
    name = "xy"[axis]
    return {
        "where": f"the image: it oscillates along {name} at {f:.2f} Hz", "depends_on": ["time"],
        "size": amplitude, "unit": "m", "what": "place of everything in the image", "frequency_hz": f,
        "form": f"{name} + {amplitude:.2g} m sin(2 pi {f:.2f} t + a phase of each clip)",
        "delta_bic": float(power[axis, k]) - 2 * len(clips) * float(np.log(sum(len(t) for t, _ in clips))), "terms": [],
    }  # fmt: skip


def _by_clip(point: Point) -> list[tuple[Array, Array]]:
    """Times (m,) [s] and residuals (m, 2) [standard deviations] of every clip, of all its balls."""
    clips = point.problem.clips
    found: list[list[tuple[Array, Array]]] = [[] for _ in clips]
    for k, name, xy in point.problem.by_ball(point.residuals()):
        good = np.isfinite(xy).all(axis=1)
        found[k].append((clips[k].balls[name].time[good], np.clip(xy[good], -MAX_RESIDUAL_SD, MAX_RESIDUAL_SD)))
    return [(np.concatenate([t for t, _ in one]), np.concatenate([r for _, r in one])) for one in found]
