"""Test of residuals for white noise, by their autocorrelation and their number of sign changes.

In: samples and the noise per axis. Out: a `Whiteness`.

r_k = sum of e_i e_(i+k) / sum of e_i^2 over all pairs of one ball's segment; of white noise it lies within 1.96 over
the square root of the number of pairs in 95 % of cases. Signs of white noise change with probability one half: the
number of changes is binomial. Both axes count. A little less than 0 is usual: fitted unknowns absorb noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.residuals.samples import Array, Samples

MAX_LAG = 40
NEGLIGIBLE_CORRELATION = 0.1  # too small to matter
MAX_NOISE_RATIO = 2.0  # rms over the noise above which residuals are more than noise
MAX_STATED_RATIO = 10.0  # rms over the noise above which a wrongly stated noise cannot explain them
SIGNIFICANT_SD = 4.0  # least significance, in standard deviations


@dataclass(frozen=True)
class Whiteness:
    """Autocorrelation and sign changes of residuals."""

    ratio: float  # root mean square over the noise
    autocorrelation: tuple[float, ...]  # of lags 1, 2, ...
    band: tuple[float, ...]  # white noise is within plus or minus this in 95 % of cases
    changes: float  # sign changes over the number expected for white noise
    z: float  # of that number, negative if signs persist
    samples: int

    @property
    def white(self) -> bool:
        """Whether residuals are of the size of the noise and uncorrelated."""
        return self.uncorrelated and not self.ratio > MAX_NOISE_RATIO

    @property
    def uncorrelated(self) -> bool:
        """Whether neither the first lags' autocorrelation nor a lack of sign changes exceeds chance."""
        first = zip(self.autocorrelation[:10], self.band[:10], strict=True)
        return not any(r > max(SIGNIFICANT_SD / 1.96 * b, NEGLIGIBLE_CORRELATION) for r, b in first) and not (
            self.z < -SIGNIFICANT_SD and self.changes < 1 - NEGLIGIBLE_CORRELATION
        )

    def in_words(self) -> str:
        """One sentence."""
        if not self.samples:
            return "Residuals: too few samples for a test of whether they are noise."
        first = self.autocorrelation[0]
        if self.white:
            return f"Residuals are white: neighbours correlate by {first:+.2f}, {self.ratio:.2f} times the noise."
        if self.uncorrelated and self.ratio > MAX_STATED_RATIO:
            return (
                f"Residuals are {self.ratio:.0f} times the noise: too large to be noise, though neighbours correlate "
                f"by {first:+.2f} only. Some samples or clips are far from any motion of the model; start with the "
                "worst clips."
            )
        if self.uncorrelated:
            return (
                f"Residuals are {self.ratio:.2f} times the noise, though neighbours correlate by {first:+.2f} only: "
                "there are outliers, or the noise is larger than stated."
            )
        least = max(max(self.band), 0.2)
        last = next((k for k, r in enumerate(self.autocorrelation) if r < least), len(self.autocorrelation))
        more = "at least " if last == len(self.autocorrelation) else ""
        return (
            f"Residuals are not white: neighbours correlate by {first:+.2f}, over {more}{max(last, 1)} samples; "
            f"signs change {self.changes:.2f} times as often as for noise (z {self.z:.0f}); {self.ratio:.2f} times "
            "the noise."
        )

    def to_json(self) -> dict[str, Any]:
        """The figures, and a sentence on their meaning."""
        return {**vars(self), "white": self.white, "words": self.in_words()}


def whiteness(samples: Samples, sigma: float) -> Whiteness:
    """The whiteness of moving balls' residuals; sigma is the noise per axis [m]."""
    moving = np.array([m != "rest" for m in samples.motion], dtype=bool) & np.isfinite(samples.residual).all(axis=1)
    e: Array = samples.residual[moving] / sigma
    label: NDArray[np.int64] = samples.segment[moving]
    n = len(e)
    total = float(np.sum(e**2))
    if n < 2 or not total > 0:
        nan = (float("nan"),) * MAX_LAG
        return Whiteness(float("nan"), nan, nan, float("nan"), float("nan"), 0)
    found, band = [], []
    for lag in range(1, MAX_LAG + 1):
        pair = label[lag:] == label[:-lag]
        count = int(pair.sum())
        cross = float(np.sum(e[lag:][pair] * e[:-lag][pair]))
        found.append(cross / count / (total / n) if count else float("nan"))
        band.append(1.96 / float(np.sqrt(2 * count)) if count else float("nan"))
    pair = label[1:] == label[:-1]
    changes = int(np.sum((e[1:][pair] > 0) != (e[:-1][pair] > 0)))
    count = 2 * int(pair.sum())
    z = (changes - count / 2) / np.sqrt(count / 4) if count else float("nan")
    return Whiteness(
        float(np.sqrt(total / n / 2)), tuple(found), tuple(band), 2 * changes / count if count else float("nan"),
        float(z), n,
    )  # fmt: skip
