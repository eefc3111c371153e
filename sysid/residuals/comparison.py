"""The result of a comparison of model and measurement.

In: the figures of sysid/residuals/compare.py. Out: a `Comparison` of values only, and its JSON, billiard-comparison/1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.model_file import Model
from models.shot import Track
from sysid.clips import Clip, ClipSet
from sysid.clips.tracker.slow_noise import SlowNoise
from sysid.residuals.impacts import Impacts
from sysid.residuals.samples import Samples
from sysid.residuals.significance import Findings
from sysid.residuals.whiteness import Whiteness

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ClipRow:
    """One clip's error over the whole clip, its initial state fitted."""

    file: str
    struck_rms_m: float  # square root of the mean squared distance of the struck ball
    rms_m: float  # likewise, over all moving balls
    chi2_reduced: float
    held_out: bool  # not used for the model's constants


@dataclass(frozen=True)
class SegmentRow:
    """One segment between events, its initial state fitted."""

    file: str
    ball: str
    before: str  # "strike", "ball", "cushion"; "start" of a clip that begins in mid-motion
    start: float  # [s]
    end: float
    speed: float  # at the start [m/s]
    ratio: float  # rms residual per axis over the noise


@dataclass(frozen=True)
class Group:
    """A group of samples or segments with the model's position error, which accumulates from event to event."""

    by: str  # "phase", "event", "speed", "clip", "ball", "rail", ...
    where: str  # description of the group
    rms_m: float  # distance
    ratio: float  # rms per axis over the noise
    samples: int


@dataclass(frozen=True)
class Comparison:
    """The comparison of a model with measurements."""

    clip_set: ClipSet
    model: Model
    noise_m: float  # one standard deviation per axis, including slow noise
    slow_noise: SlowNoise  # its part that wanders about smooth paths
    clips: tuple[ClipRow, ...]
    segments: tuple[SegmentRow, ...]
    where: tuple[Group, ...]  # whole shots, by group
    samples: Samples  # of whole shots
    tracks: tuple[Track, ...]  # whole shots of the model, at the measured times
    shots: tuple[Clip, ...]  # the clips compared, in the order of `tracks`
    initial_states: Array  # (n, p) of the clips, see sysid/estimation/shot_problem.py
    segment_samples: Samples  # of segments, which start again at each event
    impacts: Impacts
    local: Findings  # significant departures, see sysid/residuals/localise.py
    white: Whiteness
    mujoco: tuple[
        ClipRow, ...
    ] = ()  # the same constants and initial states played in MuJoCo; empty if MuJoCo played everything

    def summary(self) -> dict[str, float]:
        """Medians of the main figures; NaN if there are none."""

        def median(values: list[float]) -> float:
            return float(np.median(values)) if values else float("nan")

        held = [c.struck_rms_m for c in self.clips if c.held_out]
        return {
            "segment_ratio_median": median([s.ratio for s in self.segments]),
            "struck_rms_median_m": median([c.struck_rms_m for c in self.clips]),
            "struck_rms_median_held_out_m": median(held),
            "rms_median_m": median([c.rms_m for c in self.clips]),
            "mujoco_struck_rms_median_m": median([c.struck_rms_m for c in self.mujoco or self.clips]),
            "mujoco_rms_median_m": median([c.rms_m for c in self.mujoco or self.clips]),
        }

    def to_json(self) -> dict[str, Any]:
        """The content of the JSON file."""
        return {
            "format": "billiard-comparison/1",
            "noise_m": self.noise_m,
            "slow_noise": vars(self.slow_noise),
            "summary": self.summary(),
            "clips": [vars(c) for c in self.clips],
            "engine": "events" if self.mujoco else "mujoco",
            "mujoco": [vars(c) for c in self.mujoco or self.clips],
            "where": [vars(d) for d in self.local.named],
            "dependence": [vars(d) for d in self.local.dependence],
            "whiteness": self.white.to_json(),
            "groups": [vars(d) for d in self.where],
            "local_groups": [vars(d) for d in self.local.groups],
            "segments": [vars(s) for s in self.segments],
        }
