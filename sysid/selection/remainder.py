"""What is left where neither an effect nor a formula explains it: a camera that swings, or that something is there.

The balls of a clip swing together in the picture, with a phase that no clip knows of another. So each clip has an
amplitude and a phase of its own, and the frequency is the one at which they explain most together. What initial
states can imitate, less than a swing a clip, shows too weak.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.special import chdtrc

from sysid.estimation.fitted import Point
from sysid.estimation.problem import Array
from sysid.selection.evidence import CLIPPED_SD, correlation_time, left_over

LEFT = 0.1  # of the noise's square, beyond it, from which something is left
TOGETHER = 1.5  # samples that count as one, from which residuals hang together: else the noise is larger, or has tails
CHANCE = 1e-6  # that noise alone shows such a swing
FINE = 4  # frequencies per swing in the longest clip
FASTEST = 60.0  # [1/s]
FEWEST = 2  # swings in the longest clip
MOST = 0.5  # of what is left, that one frequency must explain: all that moves slowly has some of each
LEAST = 20  # samples of a clip
AT_ONCE = 200  # frequencies


def remainder(now: Point) -> Mapping[str, Any] | None:
    """What a fit leaves beyond noise, as `unexplained` of result.json has it; None where it is nothing to speak of."""
    left = left_over(now)
    together = correlation_time(now, now.discrepancy_rate)
    if left < LEFT or together < TOGETHER:
        return None
    return swing(now) or {
        "where": "not located", "depends_on": [], "size": now.problem.noise * float(np.sqrt(left)), "unit": "m",
        "what": f"error beyond the noise, rms, {together:.0f} samples of which hang together", "form": None,
        "delta_bic": None, "terms": [],
    }  # fmt: skip


def swing(point: Point) -> Mapping[str, Any] | None:
    """The swing that explains most, as `unexplained` of result.json has it; None where there is none."""
    clips = [c for c in _by_clip(point) if len(c[0]) >= LEAST]
    if not clips:
        return None
    longest = max(float(np.ptp(t)) for t, _ in clips)
    step = np.median([float(np.median(np.diff(np.unique(t)))) for t, _ in clips])
    frequency = np.arange(FEWEST * FINE, int(FINE * longest * min(0.5 / step, FASTEST))) / (FINE * longest)
    if frequency.size == 0:
        return None
    power, size, gain = (np.zeros((2, frequency.size)) for _ in range(3))
    for time, r in clips:
        # A few frequencies at a time: long clips at high rates would fill the memory.
        parts = np.array_split(frequency, frequency.size // AT_ONCE + 1)
        waves = np.concatenate([np.exp(-2j * np.pi * f[:, None] * time) @ r for f in parts])
        for axis in range(2):
            found = 2 * np.abs(waves[:, axis]) ** 2 / len(time)
            power[axis] += found / max(float(np.mean(r[:, axis] ** 2)) - found.max() / len(time), 0.2)
            size[axis] += 2 * found / len(time)
            gain[axis] += found
    axis, k = (int(v) for v in np.unravel_index(int(np.argmax(power)), power.shape))
    chance = float(chdtrc(2 * len(clips), power[axis, k])) * power.size
    left = sum(float(np.sum(r**2 - 1)) for _, r in clips)
    if not chance < CHANCE or gain[axis, k] < MOST * left:
        return None
    amplitude, f = point.problem.noise * float(np.sqrt(size[axis, k] / len(clips))), float(frequency[k])
    name = "xy"[axis]
    return {
        "where": f"the image: it swings along {name}, {f:.2f} times a second", "depends_on": ["time"],
        "size": amplitude, "unit": "m", "what": "place of everything in the image", "frequency_hz": f,
        "form": f"{name} + {amplitude:.2g} m sin(2 pi {f:.2f} t + a phase of each clip)",
        "delta_bic": float(power[axis, k]) - 2 * len(clips) * float(np.log(sum(len(t) for t, _ in clips))), "terms": [],
    }  # fmt: skip


def _by_clip(point: Point) -> list[tuple[Array, Array]]:
    """Times (m,) and residuals (m, 2) of every clip, in standard deviations, all balls that were trusted together."""
    clips = point.problem.clips
    found: list[list[tuple[Array, Array]]] = [[] for _ in clips]
    for k, name, xy in point.problem.by_ball(point.residuals()):
        good = np.isfinite(xy).all(axis=1)
        found[k].append((clips[k].balls[name].time[good], np.clip(xy[good], -CLIPPED_SD, CLIPPED_SD)))
    return [(np.concatenate([t for t, _ in one]), np.concatenate([r for _, r in one])) for one in found]
