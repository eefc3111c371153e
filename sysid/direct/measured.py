"""What one stretch of a track says of a constant, and what many such values say together.

One stretch. A run is a slide, r = r0 + v0 t + 1/2 (d / T) t^2 until T = |d| / (mu_s g), then a roll that slows down
evenly to its stop, fitted to samples in the plane. A slowing is s = s0 + v t - 1/2 a t^2 to its stop, where s is an
angle or the way along a path.

Many. Values y_k +- s_k are taken to scatter by tau beyond their own errors (random effects). The mean, and tau, are
Huber's: weights 1 / (s_k^2 + tau^2), less for what lies beyond 2.5 of its own, tau such that the clipped squares sum to
what is expected of n values (proposal 2; without the clip it is the tau of Paule and Mandel). The same with columns
beside the mean tells whether values change with speed, or with the heading of the ball. Left out: that two values of
one clip may share an error.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtr

from sysid.clips.segments import Segment

Array = NDArray[np.float64]
Prior = tuple[Array, Array]  # mean and sd of the parameters of a run: inf where nothing is known, 0 where it is held

# Parameters of a run: r0 (2), v0 (2), d (2) its change while sliding, ln(mu_s g), ln(mu_r g), push aside [m/s^2].
UNKNOWN: Prior = (
    np.array([0, 0, 0, 0, 0, 0, math.log(2.0), math.log(0.12), 0.0]),
    np.array([np.inf, np.inf, np.inf, np.inf, 3.0, 3.0, 1.0, 0.7, 0.03]),
)
STEPS = np.array([1e-6, 1e-6, 1e-5, 1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-5])  # of derivatives by them
FIRST = 0.8  # of a segment in which its slide is looked for, at first [s]
TRIED = np.array([0.03, 0.06, 0.12, 0.2, 0.3, 0.45, 0.7, 1.0])  # lengths of a slide over the time seen
FEWEST = 6  # samples on the move that tell a slowing
SHORT = 0.05  # least way along a path [m]

CLIP = 2.5  # standard deviations beyond which a value counts less
EXPECTED = 0.97756  # mean of min(z^2, CLIP^2) of a normal z
FAR = 5.0  # standard deviations from which a value is left out
TOLD = 3.5  # the same from which a dependence is told
AGREE = 3.0  # reduced chi-square from which values are said to differ by more than their errors
FEW = 3  # values below which the user is warned
SPEEDS, SPAN = 6, 0.15  # values, and span of their speeds [m/s], that tell a change with speed
HEADINGS = 8  # values that tell a change with heading


def path(p: Array, t: Array) -> Array:
    """Places (k, n, 2) [m] at times t (n,) [s] of runs with parameters p (k, 9) that begin at t = 0."""
    r0, v0, d = p[:, None, 0:2], p[:, None, 2:4], p[:, None, 4:6]
    slide, roll, push = np.exp(p[:, 6:7]), np.exp(p[:, 7:8]), p[:, 8:9, None]
    size = np.sqrt(np.sum(d**2, axis=2) + 1e-18)
    last = size / slide
    a = np.minimum(t[None], last)[..., None]
    w = v0 + d
    speed = np.sqrt(np.sum(w**2, axis=2) + 1e-18)
    way = w / speed[..., None]
    aside = np.stack([-way[..., 1], way[..., 0]], axis=2)
    b = np.clip(t[None] - last, 0.0, speed / roll)[..., None]
    slid = v0 * a + 0.5 * a**2 * (slide / size)[..., None] * d
    return np.asarray(
        r0 + slid + way * (speed[..., None] * b - 0.5 * roll[..., None] * b**2) + 0.5 * push * b**2 * aside
    )


@dataclass(frozen=True)
class Run:
    """A slide and a roll fitted to one ball's samples."""

    p: Array  # (9,)
    cov: Array  # (9, 9), widened where the run does not fit
    chi2: float  # reduced

    def state(self, t: float) -> tuple[Array, Array]:
        """Place and velocity (4,) and their covariance (4, 4) at a time after the run's beginning [s]."""
        h = 1e-5
        around = np.concatenate([self.p[None], self.p + np.diag(STEPS), self.p - np.diag(STEPS)])
        at = path(around, np.array([t - h, t, t + h]))
        both = np.concatenate([at[:, 1], (at[:, 2] - at[:, 0]) / (2 * h)], axis=1)
        slope = ((both[1:10] - both[10:]) / (2 * STEPS[:, None])).T
        return both[0], slope @ self.cov @ slope.T

    def slid(self) -> tuple[float, float]:
        """How long it slid, and the sd of that [s]."""
        d, a = self.p[4:6], math.exp(self.p[6])
        size = math.hypot(*d)
        slope = np.array([*(d / max(size, 1e-9) / a), -size / a])
        return size / a, math.sqrt(slope @ self.cov[4:7, 4:7] @ slope)


def fit_run(t: Array, xy: Array, sigma: float, prior: Prior = UNKNOWN) -> Run:
    """The run through samples xy (n, 2) +- sigma [m] at t (n,) [s] after its beginning."""
    mean, sd = prior
    free = sd > 0
    known = free & np.isfinite(sd)
    scale = np.where(known, sd, 1.0)

    def rest(p: Array) -> Array:
        return np.concatenate([((xy - path(p[None], t)[0]) / sigma).ravel(), ((mean - p) / scale)[known]])

    def slopes(p: Array) -> Array:
        at = path(np.concatenate([p + np.diag(STEPS), p - np.diag(STEPS)]), t)
        own = (at[:9] - at[9:]).reshape(9, -1).T / (2 * STEPS * sigma)
        return np.concatenate([own, (np.eye(9) / scale[:, None])[known]])[:, free]

    best, least = mean, math.inf
    for p in _guesses(t, xy, mean, sd):
        r, damp = rest(p), 1e-3
        for _ in range(60):  # Levenberg and Marquardt
            j = slopes(p)
            square = j.T @ j
            move = np.zeros(9)
            move[free] = np.linalg.solve(square + damp * np.diag(np.diag(square)), j.T @ r)
            move[6:8] = np.clip(move[6:8], -0.7, 0.7)
            then = rest(p + move)
            better = float(r @ r) - float(then @ then)
            if better > 0:
                p, r, damp = p + move, then, damp / 5
            else:
                damp *= 8
            if 0 <= better < 1e-6 * (1 + float(r @ r)) or damp > 1e8:
                break
        if float(r @ r) < least:
            best, least = p, float(r @ r)
    j = slopes(best)
    cov = np.zeros((9, 9))
    cov[np.ix_(free, free)] = np.linalg.pinv(j.T @ j)
    total = float(np.sum((xy - path(best[None], t)[0]) ** 2)) / sigma**2
    chi2 = total / max(xy.size - int(np.sum(free & ~known)) - 2, 1)
    return Run(best, cov * max(chi2, 1.0), chi2)


def _guesses(t: Array, xy: Array, mean: Array, sd: Array) -> list[Array]:
    """Where to begin: a run without a slide, and the slides that fit best of some lengths."""
    line = np.column_stack([np.ones_like(t), t])
    none = mean.copy()
    none[:2], none[2:4] = np.linalg.lstsq(line, xy, rcond=None)[0]
    if sd[4] == 0:
        return [none]
    none[4:6] = -1e-3 * none[2:4]
    found = []
    for last in TRIED * t[-1]:
        early, late = np.minimum(t, last), np.maximum(t - last, 0.0)
        columns = np.column_stack([line, early * (t - early / 2), late**2 / 2])
        value = np.linalg.lstsq(columns, xy, rcond=None)[0]
        p = mean.copy()
        p[:2], p[2:4], p[4:6] = value[0], value[1], value[2] * last
        if sd[6] > 0.5:
            p[6] = math.log(min(max(float(np.hypot(*value[2])), 0.5), 6.0))
        found.append((float(np.sum((xy - path(p[None], t)[0]) ** 2)), p))
    found.sort(key=lambda f: f[0])
    return [none, found[0][1], found[1][1]]


@dataclass(frozen=True)
class Stretch:
    """A segment, the run at its beginning, and since when the ball rolls."""

    segment: Segment
    run: Run
    rolls: float  # [s], as in the segment; inf where it may slide to the end


def stretches(segments: Sequence[Segment], sigma: float, frame: float) -> list[Stretch]:
    """Where each segment slides and where it rolls."""
    found = []
    for s in segments:
        if s.before == "strike":  # its first sample may be one of the rest, with a time nearer to the strike
            s = dataclasses.replace(s, time=s.time[1:], xy=s.xy[1:])
        t = s.time - s.time[0]
        span = max(FIRST, float(t[min(len(t) - 1, 12)]))
        while True:
            use = t <= span
            run = fit_run(t[use], s.xy[use], sigma)
            last, sd = run.slid()
            if last + 3 * sd < 0.6 * span or use.all():
                break
            span *= 2
        since = last + 3 * sd + frame
        found.append(Stretch(s, run, float(s.time[0]) + since if since < t[-1] else math.inf))
    return found


@dataclass(frozen=True)
class Slowing:
    """A way that slows down evenly to its stop."""

    speed: float  # at the first sample
    rate: float  # of slowing down
    sd: float
    at: float  # speed at which the rate holds
    slope: float  # of the rate with speed
    slope_sd: float
    chi2: float  # reduced, that slope included; 1 where the noise was not given


def slowing(t: Array, s: Array, sigma: float | None, rough: float) -> Slowing | None:
    """Of a way s (n,) at t (n,) [s]; within `rough` of its end it may rest. None where it does not slow down."""
    t = t - t[0]
    moving = np.flatnonzero(np.abs(s - np.median(s[-5:])) > rough)
    n = int(moving[-1]) + 1 if moving.size else 0
    if n < FEWEST:
        return None
    half, v, s0 = (float(k) for k in np.polyfit(t[:n], s[:n], 2))
    a = max(-2 * half, 0.02 * abs(v) / float(t[n - 1]))
    for _ in range(40):
        if not v > 0:
            return None
        u = np.minimum(t, v / a)  # time on the move; where it ends the velocity is 0, so its end adds no slope
        left = s - (s0 + v * u - 0.5 * a * u**2)
        columns = np.column_stack([np.ones_like(u), u, -0.5 * u**2, a * u**3 / 6 - v * u**2 / 2])
        step = np.linalg.lstsq(columns[:, :3], left, rcond=None)[0]
        step *= min(1.0, 0.5 * a / max(abs(step[2]), 1e-12))
        s0, v, a = s0 + float(step[0]), v + float(step[1]), a + float(step[2])
        if abs(step[2]) < 1e-7 * a:
            break
    if a * t[-1] < 1e-3 * v:
        return None
    more = np.linalg.lstsq(columns, left, rcond=None)[0]
    square = float(np.sum((left - columns @ more) ** 2)) / max(len(t) - 4, 1)
    chi2 = 1.0 if sigma is None else square / sigma**2
    noise = square if sigma is None else max(square, sigma**2)
    three, four = (np.linalg.pinv(columns[:, :k].T @ columns[:, :k]) * noise for k in (3, 4))
    at = -float(four[2, 3] / four[3, 3])
    return Slowing(v, a, math.sqrt(three[2, 2]), at, float(more[3]), math.sqrt(four[3, 3]), chi2)


def along(xy: Array) -> tuple[Array, float] | None:
    """The way along a smooth path (n, 2): (n,) [m], and its heading [rad]; None where it is short."""
    chord = xy[-1] - xy[0]
    length = math.hypot(*chord)
    if length < SHORT:
        return None
    e = chord / length
    x, y = (xy - xy[0]) @ e, (xy - xy[0]) @ np.array([-e[1], e[0]])
    grid = np.linspace(x.min(), x.max(), 400)
    pace = np.hypot(1.0, np.polynomial.Polynomial.fit(x, y, 3).deriv()(grid))
    total = np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]) * np.diff(grid))])
    return np.interp(x, grid, total), math.atan2(e[1], e[0])


@dataclass(frozen=True)
class Single:
    """What one segment or event says of a constant."""

    clip: str  # its file
    ball: str
    time: float  # [s]
    value: float
    sd: float  # one standard deviation
    speed: float = math.nan  # at which it holds [m/s]
    heading: float = math.nan  # of the ball [rad]
    slope: float = math.nan  # its change with speed inside this segment, per m/s
    slope_sd: float = math.nan


@dataclass(frozen=True)
class Kind:
    """Of what the singles are, and how they are told."""

    name: str  # of the constant in the model, or in words where it is none
    unit: str
    of: str  # "segments", "rebounds", ...
    method: str  # in a few words
    lacking: str  # what would tell it
    over: float = 1.0  # singles are divided by this
    effect: str = ""  # what a model needs where it changes with speed
    slope_unit: str = ""  # of the singles, per m/s
    headings: bool = False  # whether a change with the ball's heading is looked for [m/s^2]


@dataclass(frozen=True)
class Measured:
    """One constant: value and standard deviation, None where the clips do not tell."""

    kind: Kind
    value: float | None
    sd: float | None
    count: int = 0  # singles that it is of
    singles: tuple[Single, ...] = ()
    chi2: float = math.nan  # of the singles with what is told, per degree of freedom, by their own errors
    scatter: float = math.nan  # tau: standard deviation of the singles beyond their own errors
    speed: float = math.nan  # at which the value holds [m/s]
    slope: float = math.nan  # change with speed [kind.slope_unit]
    slope_sd: float = math.nan
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Measurements:
    """All constants of a clip set."""

    clips: int
    noise: float  # of a position, per axis [m]
    spikes: int  # samples set aside
    all: tuple[Measured, ...]


def surprise(value: float, sd: float, free: int) -> float:
    """Standard deviations of a normal deviate as rare as value / sd is of Student's t with so many degrees."""
    tail = float(stdtr(free, -abs(value) / sd)) if free > 0 and sd > 0 else 0.5
    return min(float(-ndtri(tail)), 99.0) if tail > 0 else 99.0


def regress(y: Array, s: Array, columns: Array) -> tuple[Array, Array, float]:
    """Coefficients (p,) of columns (n, p) that values y +- s (n,) follow, robustly; their covariance; tau."""
    n, p = columns.shape

    def fit(tau: float) -> tuple[Array, Array, float]:
        value: Array
        plain = weight = 1.0 / (s**2 + tau**2)
        for _ in range(30):
            root = np.sqrt(weight)
            value = np.asarray(np.linalg.lstsq(columns * root[:, None], y * root, rcond=None)[0])
            z = np.abs(y - columns @ value) * np.sqrt(plain)
            before, weight = weight, plain * np.minimum(1.0, CLIP / np.maximum(z, 1e-12))
            if np.allclose(before, weight, rtol=1e-6, atol=0.0):
                break
        return value, weight, float(np.sum(np.minimum(z, CLIP) ** 2))

    tau, wanted = 0.0, EXPECTED * (n - p)
    value, weight, total = fit(tau)
    if n > p and total > wanted:
        low, high = 0.0, float(np.ptp(y) + s.max())
        for _ in range(40):
            tau = 0.5 * (low + high)
            value, weight, total = fit(tau)
            low, high = (tau, high) if total > wanted else (low, tau)
    return value, np.asarray(np.linalg.pinv(columns.T @ (columns * weight[:, None]))), tau


def combine(kind: Kind, singles: Sequence[Single], notes: Sequence[str] = ()) -> Measured:
    """One figure of many, and what to say of them."""
    if not singles:
        return Measured(kind, None, None, warnings=(f"these clips do not tell: {kind.lacking}", *notes))
    y, s = np.array([k.value for k in singles]), np.array([k.sd for k in singles])
    first, _, tau = regress(y, s, np.ones((len(y), 1)))
    near = np.abs(y - first[0]) <= FAR * np.hypot(s, tau)  # what is not met no event, or a wrong angle
    y, s, kept = y[near], s[near], [k for k, good in zip(singles, near, strict=True) if good]
    n, ones, weight = len(y), np.ones((len(y), 1)), 1.0 / (s**2 + tau**2)
    v, way = np.array([k.speed for k in kept]), np.array([k.heading for k in kept])
    seen = np.isfinite(v)
    middle = float(np.average(v[seen], weights=weight[seen])) if seen.any() else math.nan
    turns = np.column_stack([np.cos(way), np.sin(way)]) if kind.headings and n >= HEADINGS else ones[:, :0]
    sped = bool(kind.effect) and seen.sum() >= SPEEDS and np.ptp(v[seen]) > SPAN
    pace = np.where(seen, v - middle, 0.0)[:, None] if sped else ones[:, :0]
    full = np.concatenate([ones, turns, pace], axis=1)
    value, cov, _ = regress(y, s, full)
    free = n - full.shape[1]
    warnings = [f"only {n} {kind.of if n > 1 else kind.of.removesuffix('s')}"] if n < FEW else []
    slope, slope_sd, sds = _slope(kept, [(float(value[-1]), math.sqrt(cov[-1, -1]), free)] if sped else [])
    if turns.size:
        size = float(np.hypot(*value[1:3]))
        size_sd = math.sqrt(value[1:3] @ cov[1:3, 1:3] @ value[1:3]) / size
        if surprise(size, size_sd, free) > TOLD + 0.5:  # the direction is free, too
            toward = math.degrees(math.atan2(-value[2], -value[1]))
            warnings.append(
                f"varies with heading by {size:.4f} +- {size_sd:.4f} m/s^2, balls are pushed towards {toward:.0f} deg:"
                " the fit should have table_tilt or cloth_nap"
            )
        else:
            turns = turns[:, :0]
    if sds > TOLD:
        warnings.append(
            f"varies with speed by {slope:+.2g} +- {slope_sd:.1g} {kind.slope_unit} ({sds:.0f} sd):"
            f" the fit should have {kind.effect}"
        )
    full = np.concatenate([ones, turns, pace if sds > TOLD else ones[:, :0]], axis=1)
    value, cov, tau = regress(y, s, full)
    free = n - full.shape[1]
    own = np.linalg.lstsq(full / s[:, None], y / s, rcond=None)[0]
    chi2 = float(np.sum(((y - full @ own) / s) ** 2)) / free if free else math.nan
    if n > 2 and chi2 > AGREE:
        warnings.append(f"{kind.of} differ by more than their errors (chi2 {chi2:.1f}): the sd is widened")
    if n < len(singles):
        warnings.append(f"{len(singles) - n} of {len(singles)} {kind.of} lie far off and are left out")
    mean, sd = float(value[0]) / kind.over, math.sqrt(cov[0, 0]) / kind.over
    told = (chi2, tau / kind.over, middle, slope, slope_sd)
    return Measured(kind, mean, sd, n, tuple(kept), *told, (*warnings, *notes))


def _slope(singles: Sequence[Single], found: list[tuple[float, float, int]]) -> tuple[float, float, float]:
    """Change with speed, its sd and how many that is: between singles, where found, and inside them."""
    inside = np.array([(k.slope, k.slope_sd) for k in singles if math.isfinite(k.slope_sd)]).reshape(-1, 2)
    if len(inside) >= FEW:
        own, cov, _ = regress(inside[:, 0], inside[:, 1], np.ones((len(inside), 1)))
        found = [*found, (float(own[0]), math.sqrt(cov[0, 0]), len(inside) - 1)]
    if not found:
        return math.nan, math.nan, 0.0
    weight = np.array([sd**-2.0 for _, sd, _ in found])
    value, sd = float(np.average([b for b, _, _ in found], weights=weight)), float(weight.sum() ** -0.5)
    return value, sd, surprise(value, sd, sum(free for *_, free in found))
