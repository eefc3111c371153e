"""Motion right before and right after an impact.

In: segments with their fitted slide and roll. Out: the `SlideRoll` of the window before, and of the one after.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.clips.segments import MAX_IMPACT_GAP_S, Segment
from sysid.direct.friction import MAX_CHI2, MIN_SAMPLES
from sysid.direct.slide_roll import ParameterPrior, SegmentMotion, SlideRoll, fit_slide_roll

ROLLING_WINDOW_S, SLIDING_WINDOW_S, WINDOW_AFTER_S = 0.5, 0.3, 0.6  # windows that determine the velocity at an impact
MIN_APPROACH_M_S = 0.2  # slower impacts are left out
MAX_IMPACT_SD = 0.1  # relative sd of an impact that is used


@dataclass(frozen=True)
class Known:
    """Noise and cloth for the fits before and after impacts."""

    sigma: float  # [m]
    frame: float  # [s]
    prior: ParameterPrior
    cloth: float  # mu_s


@dataclass(frozen=True)
class Before:
    """The motion that ends at an impact."""

    fit: SlideRoll
    start: float  # time at which it starts [s]
    rolls: bool


def motion_before(k: SegmentMotion, known: Known) -> Before | None:
    """Fit the end of a segment; None where the fit is poor."""
    s, (mean, sd) = k.segment, known.prior
    rolls = int(np.sum(s.time >= k.rolls)) >= MIN_SAMPLES
    low = max(k.rolls, s.time[-1] - ROLLING_WINDOW_S) if rolls else s.time[-1] - SLIDING_WINDOW_S
    use = s.time >= min(low, s.time[-MIN_SAMPLES])
    start = float(s.time[use][0])
    held = np.where(np.arange(9) // 2 == 2, 0.0, sd) if rolls else sd  # no slide
    fit = fit_slide_roll(s.time[use] - start, s.xy[use], known.sigma, (mean, held))
    return Before(fit, start, rolls) if fit.chi2 < MAX_CHI2 else None


def motion_after(s: Segment, contact: float, known: Known) -> SlideRoll | None:
    """Fit the motion that starts at an impact at a time [s]; None where the fit is poor."""
    use = s.time < max(s.time[0] + WINDOW_AFTER_S, s.time[MIN_SAMPLES - 1] + known.frame / 2)
    fit = fit_slide_roll(s.time[use] - contact, s.xy[use], known.sigma, known.prior)
    return fit if fit.chi2 < MAX_CHI2 else None


def next_segment(found: Sequence[SegmentMotion], clip: int, ball: str, kind: str, time: float) -> Segment | None:
    """The segment of a ball that follows an impact of a kind at a time [s]."""
    for s in (k.segment for k in found):
        if s.clip == clip and s.ball == ball and s.before == kind and time < s.time[0] < time + MAX_IMPACT_GAP_S:
            return s
    return None
