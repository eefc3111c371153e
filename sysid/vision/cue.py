"""The cue before the strike: its line, where its tip is in each picture, how fast it comes.

Everything is measured on the plane of the balls' centres, z = R, where a cue held level is. Its line is found where the
pictures change in a narrow strip that leads to the struck ball; there, sections across it give both its edges to a part
of a pixel. The taper is symmetric, so the middles of the edges lie on its axis. Along the axis, the tip is the end of
what is not there when the cue is drawn back: the same pattern is shifted in every picture until it fits, so that what
its leather looks like errs alike in all of them, and not in the speed. How a raised cue would be misjudged is told.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from sysid.vision.camera.projection import Array, Camera

Picture = NDArray[np.uint8]
Grey = NDArray[np.float32]

REACH = 0.35  # behind the ball in which a cue is looked for [m]
FAR = 0.8  # behind the ball up to which its edges are measured [m]
LANES = (0.008, 0.012)  # from a cue's axis to cloth beside it, near its tip: at least, and far enough to search [m]
WINGS = (0.013, 0.018)  # and all along [m]
WIDTHS = (0.004, 0.026)  # of a cue [m]
BIN = 0.012  # length of a section [m]
FAINT = 10.0  # least contrast of an edge [grey levels]
SECTIONS = 6  # that make a line
RAISED = math.radians(5.0)  # elevation whose effect is told
WINDOW = 0.15  # before contact from which the speed is taken [s]
MOST = 16  # frames of it
FINE = 4  # samples a pixel along the axis
FRONT, TIP = 4 * FINE, 9 * FINE  # samples before a tip and of it that are compared
ROUNDS = 12  # of comparing
SHAKEN = math.radians(0.3)  # swing of the line that is told


@dataclass(frozen=True)
class CueMotion:
    """What the cue did, up to the strike. Values are NaN where the pictures did not tell."""

    speed: float  # of its tip at contact [m/s]
    speed_sd: float
    acceleration: float  # then [m/s^2]; 0 where a constant speed explains all
    azimuth: float  # of its travel [rad]
    azimuth_sd: float
    side: float  # of its line from the ball's centre, positive to the right as the player sees it [m]
    side_sd: float
    contact: float  # when the tip reaches the ball [s]
    contact_sd: float
    time: Array  # (k,) at which the tip was seen [s]
    tip: Array  # (k, 2) where [m], table frame
    lean: float  # by which the azimuth is seen wrong, for each radian that the butt is raised [rad]
    told: tuple[str, ...] = ()  # what a user should know

    def off(self, azimuth: float) -> float:
        """Angle of the cue from a wanted azimuth, counter-clockwise [rad]."""
        return math.remainder(self.azimuth - azimuth, 2 * math.pi)


@dataclass(frozen=True)
class _Line:
    """A line on the plane of the balls' centres, seen from the ball."""

    ball: Array  # (2,) [m]
    azimuth: float  # of travel [rad]
    side: float  # [m]

    @property
    def way(self) -> Array:
        """Unit vector of travel: (2,)."""
        return np.array([math.cos(self.azimuth), math.sin(self.azimuth)])

    def points(self, behind: Array, across: Array) -> Array:
        """Places (n, m, 2) [m] so far behind the ball (n,) and to the right of the line (m,) [m]."""
        right = np.array([self.way[1], -self.way[0]])
        return np.asarray(self.ball + (self.side + across)[:, None] * right - behind[:, None, None] * self.way)

    def moved(self, offset: float, slope: float) -> _Line:
        """The line that lies `offset` [m] to the right at the ball, and by `slope` of the way back farther there."""
        return replace(self, azimuth=self.azimuth + math.atan(slope), side=self.side + offset)


def watch_cue(
    frames: Sequence[tuple[float, Picture]], camera: Camera, ball_xy: Array, backdrop: Picture | None = None
) -> CueMotion | None:
    """The cue that is about to strike a ball; None where there is none.

    Args:
        frames: times [s] and pictures (height, width, 3) before the strike, some after it at most.
        camera: that took them.
        ball_xy: (2,) the struck ball's centre [m].
        backdrop: the same table without a cue, with or without balls.
    """
    time = np.array([t for t, _ in frames], float)
    if len(frames) < 2 or np.any(np.diff(time) <= 0):
        raise BadInput(f"{len(frames)} frames at {time.tolist()[:4]}... s: give two or more, in order of time")
    ball = np.asarray(ball_xy, float).reshape(2)
    scale = camera.radius / float(camera.radius_px(ball[None])[0])  # [m] a pixel
    pictures = [p for _, p in frames]
    lines = _candidates(pictures, camera, ball, scale, backdrop)
    found = [fit for line in lines if (fit := _aligned(line, pictures, camera, scale, backdrop)) is not None]
    if not found:
        return None
    line, fits = max(found, key=lambda fit: float(fit[1][:, 5].sum()))
    touch = math.sqrt(max(camera.radius**2 - line.side**2, 0.0))
    away = _tips(line, touch, pictures, camera, scale)
    return _summary(camera, line, fits, time, away, touch, scale)


def _sample(picture: Picture, pixels: Array) -> Grey:
    """Colours (n, m, c) at pixels (n, m, 2); NaN outside the picture."""
    h, w = picture.shape[:2]
    low = np.clip(np.floor(pixels.reshape(-1, 2).min(axis=0)).astype(int) - 1, 0, [w - 1, h - 1])
    high = np.clip(np.ceil(pixels.reshape(-1, 2).max(axis=0)).astype(int) + 2, low + 1, [w, h])
    part = np.ascontiguousarray(picture[low[1] : high[1], low[0] : high[0]], np.float32)
    where = (pixels - low).astype(np.float32)
    beyond = (math.nan,) * 4
    seen = cv2.remap(part, where[..., 0], where[..., 1], cv2.INTER_LINEAR, None, cv2.BORDER_CONSTANT, beyond)
    return np.asarray(seen, np.float32).reshape(*pixels.shape[:2], -1)


def _pixels(camera: Camera, points: Array) -> Array:
    """Pixels (n, m, 2) of points (n, m, 2) [m] on the plane of the balls' centres."""
    flat = points.reshape(-1, 2)
    return camera.project(np.column_stack([flat, np.full(len(flat), camera.radius)])).reshape(points.shape)


def _candidates(
    pictures: Sequence[Picture], camera: Camera, ball: Array, scale: float, backdrop: Picture | None
) -> list[_Line]:
    """Lines to the ball along which a narrow strip of the pictures changes, the best first."""
    step = max(scale, 0.0015)
    ticks = np.arange(-REACH - LANES[1], REACH + LANES[1] + step / 2, step)
    pixels = _pixels(camera, ball + np.stack(np.meshgrid(ticks, ticks), axis=-1))

    def view(picture: Picture) -> Grey:
        """The cloth around the ball from above."""
        return np.reshape(cv2.GaussianBlur(_sample(picture, pixels), (0, 0), 0.8), (len(ticks), len(ticks), -1))

    views = np.array([view(p) for p in (*pictures[:: max(1, len(pictures) // 10)], pictures[-1])])
    empty = views.min(axis=0) if backdrop is None else view(backdrop)
    change = np.nan_to_num(np.abs(views - empty).max(axis=0)).sum(axis=2)
    noise = float(np.median(change)) + 1.0
    behind = np.arange(camera.radius + 0.01, REACH, 0.004)
    angles = np.radians(np.arange(0, 360, 1.5))
    sides = np.arange(-0.8, 0.81, 0.13) * camera.radius
    found: list[_Line] = []
    score = _strip(change, step, angles, sides, behind, noise, LANES[1])
    for _ in range(4):
        a, s = np.unravel_index(int(np.argmax(score)), score.shape)
        if score[a, s] < 0.08:
            break
        near, fine = angles[a] + np.radians(np.arange(-5, 5.01, 0.25)), sides[s] + np.arange(-8, 8.1, 1.0) * 1e-3
        closer = _strip(change, step, near, fine, behind, noise, LANES[0])
        i, j = np.nonzero(closer > 0.95 * closer.max())
        found.append(_Line(ball, float(near[i].mean()), float(fine[j].mean())))
        score[np.abs(np.angle(np.exp(1j * (angles - angles[a])))) < math.radians(4)] = 0
    return found


def _strip(change: Grey, step: float, angles: Array, sides: Array, behind: Array, noise: float, lane: float) -> Array:
    """How much a strip stands out from what is beside it, along lines with angles (n,) and sides (m,): (n, m)."""
    middle = (change.shape[0] - 1) / 2
    way = np.exp(1j * angles)[:, None, None, None]
    lanes = sides[:, None, None] + np.array([0.0, -lane, lane])[:, None]
    spots = -1j * way * lanes - way * behind
    x, y = (np.clip(np.rint(v / step + middle), 0, 2 * middle).astype(int) for v in (spots.real, spots.imag))
    seen = change[y, x]  # (n, m, 3, stations)
    stand = seen[:, :, 0] - np.maximum(seen[:, :, 1], seen[:, :, 2])
    return np.asarray(np.clip(stand / noise - 1.5, 0, 3).mean(axis=2))


def _aligned(
    line: _Line, pictures: Sequence[Picture], camera: Camera, scale: float, backdrop: Picture | None
) -> tuple[_Line, Array] | None:
    """A cue's line, and by picture (k, 6): which, offset at the ball [m], slope, their sd, how many sections."""
    across = np.arange(-WINGS[1], WINGS[1] + 1e-9, max(scale / 4, 2e-4))
    behind = np.arange(camera.radius + 0.008, FAR, max(BIN / 8, scale / 2))
    for last in (False, False, True):
        pixels = _pixels(camera, line.points(behind, across))
        empty = None if backdrop is None else _sample(backdrop, pixels)
        fits: list[tuple[float, ...]] = []
        for k in range(0, len(pictures), 1 if last else max(1, len(pictures) // 8)):
            seen = _sample(pictures[k], pixels)
            fit = _straight(*_edges(seen if empty is None else seen - empty, behind, across), scale)
            if fit is not None:
                fits.append((k, *fit))
        if not fits:
            return None
        if not last:
            _, offset, slope, *_ = np.median(np.array(fits[-8:]), axis=0)
            line = line.moved(float(offset), float(slope))
    return line, np.array(fits)


def _edges(seen: Grey, behind: Array, across: Array) -> tuple[Array, Array, Array]:
    """Where sections of a strip (n, m, c) have both their edges: how far behind (k,), their middle, their width [m]."""
    count = max(1, round(BIN / (behind[1] - behind[0])))
    n = len(behind) // count
    block = seen[: n * count].reshape(n, count, len(across), -1).mean(axis=1)
    place = behind[: n * count].reshape(n, count).mean(axis=1)
    whole = np.isfinite(block).all(axis=(1, 2))
    block, place = block[whole], place[whole]
    inner = np.median(block[:, np.abs(across) < 0.002], axis=1)
    edges = []
    for sign in (-1, 1):
        outside = np.median(block[:, (sign * across > WINGS[0])], axis=1)
        contrast = inner - outside
        size = np.sum(contrast**2, axis=1) + 1e-9
        part = np.sum((block - outside[:, None]) * contrast[:, None], axis=2) / size[:, None]
        y, level = across[::sign], part[:, ::sign]
        y, level = y[sign * y >= 0], level[:, sign * y >= 0]
        below = level < 0.5
        first = np.maximum(below.argmax(axis=1), 1)
        rows = np.arange(len(block))
        one, two = level[rows, first - 1], level[rows, first]
        edge = y[first - 1] + (y[first] - y[first - 1]) * (one - 0.5) / np.maximum(one - two, 1e-9)
        edges.append(np.where(below.any(axis=1) & (one >= 0.5) & (size > FAINT**2), edge, np.nan))
    middle, width = 0.5 * (edges[0] + edges[1]), edges[1] - edges[0]
    good = (width > WIDTHS[0]) & (width < WIDTHS[1])
    return place[good], middle[good], width[good]


def _straight(place: Array, middle: Array, width: Array, scale: float) -> tuple[float, float, float, float, int] | None:
    """Offset at the ball [m], slope, their sd, and number of the sections that agree with a taper; None if too few."""
    if len(place) < SECTIONS:
        return None
    agree = _agree(place, width, 0.5 * scale)
    taper = np.polyfit(place[agree], width[agree], 1)
    agree &= np.abs(width - np.polyval(taper, place)) < np.maximum(scale, 0.15 * width)
    if agree.sum() < SECTIONS or not -0.002 < taper[0] < 0.03:
        return None
    place, middle = place[agree], middle[agree]
    use = _agree(place, middle, 0.1 * scale)
    if use.sum() < SECTIONS:
        return None
    (slope, offset), spread = np.polyfit(place[use], middle[use], 1, cov="unscaled")
    rest = middle[use] - offset - slope * place[use]
    rms = max(math.sqrt(float(rest @ rest) / (len(rest) - 2)), 0.02 * scale)
    if rms > 0.5 * scale:
        return None
    return float(offset), float(slope), rms * math.sqrt(spread[1, 1]), rms * math.sqrt(spread[0, 0]), len(rest)


def _agree(x: Array, y: Array, least: float) -> NDArray[np.bool_]:
    """Which points (n,) lie on the line that most pairs of them are on; `least` is the least noise of y."""
    i, j = np.triu_indices(len(x), 1)
    apart = np.abs(x[i] - x[j]) >= 0.5 * np.median(np.abs(x[i] - x[j]))
    rest = y - x * float(np.median((y[i] - y[j])[apart] / (x[i] - x[j])[apart]))
    rest = np.abs(rest - np.median(rest))
    return np.asarray(rest < 4.0 * max(1.4826 * float(np.median(rest)), least))


def _tips(line: _Line, touch: float, pictures: Sequence[Picture], camera: Camera, scale: float) -> Array:
    """How far the tip is from where it meets the ball, in every picture (n,) [m]; NaN where that is not seen."""
    step = scale / FINE
    behind = np.arange(touch - 0.01, touch + FAR, step)
    pixels = _pixels(camera, line.points(behind, np.linspace(-0.0025, 0.0025, 5)))
    seen = np.array([_sample(p, pixels).mean(axis=1) for p in pictures])  # (n, m, c)
    seen = seen[:, np.cumsum(~np.isfinite(seen).all(axis=(0, 2))) == 0]  # up to the edge of the pictures
    place, empty = _onsets(seen, FINE) if seen.shape[1] > TIP else (np.full(len(seen), np.nan), seen[0])
    use = np.flatnonzero(np.isfinite(place))
    if len(use) < 2:
        return np.full(len(seen), np.nan)
    window = np.arange(-FRONT, TIP)
    tip = 0.0
    for _ in range(ROUNDS):
        cuts = np.array([_cut(seen[k], place[k] + window) for k in use])
        hidden = np.array([_cut(empty, place[k] + window) for k in use])
        cover, tip = _cover(_mean(cuts - hidden))
        # What is seen is the cue where it covers all, what it hides where it covers nothing, and a mixture between.
        part = cover[:, None]
        hidden = np.where(part < 1, hidden, 0.0)
        own = _mean(cuts - (1 - part) * hidden)
        rest = cuts - (1 - part) * hidden - own
        bend = np.gradient(cover)[:, None] * hidden - np.gradient(own, axis=0)
        bend, rest = np.where(np.isfinite(rest), bend, 0.0), np.where(np.isfinite(rest), rest, 0.0)
        place[use] += np.clip(np.sum(bend * rest, axis=(1, 2)) / (np.sum(bend**2, axis=(1, 2)) + 1e-9), -3.0, 3.0)
    return np.asarray(behind[0] - touch + (place + window[0] + tip) * step)


def _mean(values: Array) -> Array:
    """Mean over the first axis of what is known; 0 where nothing is."""
    known = np.isfinite(values)
    return np.asarray(np.where(known, values, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1))


def _cover(change: Array) -> tuple[Array, float]:
    """Which part of what lies below it the cue hides along its axis (k,), and the index at which that is a half."""
    full = change[-1]
    for first in range(FRONT + 2 * FINE, len(change) - 3 * FINE, 3 * FINE):
        full = np.median(change[first : first + 3 * FINE], axis=0)
        if full @ full > FAINT**2:
            break
    cover = np.clip(change @ full / max(float(full @ full), 1e-9), 0.0, 1.0)
    half = max(int(np.argmax(cover > 0.5)), 1)
    whole = half + int(np.argmax(cover[half:] > 0.98))
    cover[whole:] = 1.0
    return cover, half - 1 + float((0.5 - cover[half - 1]) / max(cover[half] - cover[half - 1], 1e-9))


def _cut(change: Array, at: Array) -> Array:
    """Values (k, c) of samples (m, c) at fractions of an index (k,); NaN where they are not known."""
    return np.stack([np.interp(at, np.arange(len(change)), colour, np.nan, np.nan) for colour in change.T], axis=1)


def _onsets(seen: Array, pixel: int) -> tuple[Array, Array]:
    """Index at which the cue begins along its axis in pictures (n, m, c): (n,), and what it hides: (m, c)."""
    noise = 1.4826 * float(np.median(np.abs(np.diff(seen, axis=0)))) / math.sqrt(2)
    limit = max(FAINT, 6.0 * noise)
    # What it hides is seen where it is drawn back, farthest in one of the pictures.
    last = np.sqrt(np.sum((seen - seen[-1]) ** 2, axis=2)) > limit
    back = int(np.argmax(last.sum(axis=1)))
    apart = np.sqrt(np.sum((seen - seen[back]) ** 2, axis=2)) > limit
    # Two pixels in a row: one may be noise.
    run = np.all(np.lib.stride_tricks.sliding_window_view(apart, 2 * pixel, axis=1), axis=2)
    place = np.where(run.any(axis=1), run.argmax(axis=1), np.nan)
    known = max(int(np.flatnonzero(run.any(axis=0)).max(initial=0)) - 2 * pixel, 0)
    empty = np.full(seen.shape[1:], np.nan)
    clear = np.arange(known)[None, :] < np.where(np.isfinite(place), place, known)[:, None] - 4 * pixel
    clear[back] = True
    empty[:known] = np.sum(seen[:, :known] * clear[..., None], axis=0) / clear.sum(axis=0)[:, None]
    place[place > known - 4 * pixel] = np.nan
    return place, empty


def _summary(
    camera: Camera, line: _Line, fits: Array, time: Array, away: Array, touch: float, scale: float
) -> CueMotion:
    """What lines (k, 6) and places of the tip (n,) come to."""
    foot = line.points(touch + away, np.zeros(1))[:, 0]
    seen, rows = np.flatnonzero(np.isfinite(away)), _pixels(camera, np.nan_to_num(foot)[None])[0, :, 1]
    time = time + camera.readout * (rows / max(camera.size[1] - 1, 1) - 0.5)
    told: list[str] = []
    speed = _speed(time, away, scale, told)
    before = fits[np.isin(fits[:, 0], seen[away[seen] > 0])]
    late = (before if len(before) else fits)[-8:]
    line = line.moved(float(np.median(late[:, 1])), float(np.median(late[:, 2])))
    # The same pixels meet the same edges again and again: pictures of one stroke err alike.
    sd = np.sqrt(np.mean(late[:, 3:5] ** 2, axis=0) + np.var(late[:, 1:3], axis=0) / len(late))
    sd[0] = math.hypot(sd[0], 0.05 * scale)
    if np.ptp(late[:, 2]) > SHAKEN + 4 * float(np.mean(late[:, 4])):
        told.append(f"the cue swings by {math.degrees(float(np.ptp(late[:, 2]))):.2f} degrees")
    x, y = (camera.eye[:2] - line.ball + touch * line.way) / (camera.eye[2] - camera.radius)
    (c, s), turned = line.way, math.degrees(RAISED)
    lean, fast = float(c * y - s * x), 100 * (math.cos(RAISED) + math.sin(RAISED) * float(c * x + s * y) - 1)
    told.append(
        f"raised by {turned:.0f} degrees, a cue is seen turned by {lean * turned:+.2f} degrees and {fast:+.1f} % faster"
    )
    return CueMotion(
        *speed[:3], math.remainder(line.azimuth, 2 * math.pi), float(sd[1]), line.side, float(sd[0]), *speed[3:],
        time[seen], foot[seen], lean, tuple(told),
    )  # fmt: skip


def _speed(time: Array, away: Array, scale: float, told: list[str]) -> tuple[float, float, float, float, float]:
    """Speed, its sd, acceleration, all at contact, when that is, and its sd."""
    met = np.flatnonzero(away < 0)
    seen = np.flatnonzero(np.isfinite(away[: met[0]] if len(met) else away))
    t, x = time[seen], away[seen]
    first = max(len(x) - 1, 0)
    while first > 0 and x[first - 1] > x[first] - 0.05 * scale:  # it comes on
        first -= 1
    recent = (np.arange(len(x)) >= max(first, len(x) - MOST)) & (t > (t[-1] if len(t) else 0.0) - WINDOW)
    t, x = t[recent], x[recent]
    if len(x) < 3 or x[0] - x[-1] < scale:
        told.append(f"the tip is seen coming on in {len(x)} pictures before contact: too little for a speed")
        return (math.nan,) * 5
    noise = 0.02 * scale
    if len(x) > 6:
        noise = max(noise, float(np.median(np.abs(np.diff(x, 3)))) / 0.6745 / math.sqrt(20))
    while True:
        value, spread = np.polyfit(t - t[-1], x, 1, cov=True)
        bent = np.polyfit(t - t[-1], x, 2, cov=True) if len(x) > 4 else None
        if bent is not None and abs(bent[0][0]) > 4 * math.sqrt(bent[1][0, 0]):
            value, spread = bent
        rest = x - np.polyval(value, t - t[-1])
        if rest @ rest < (1.8 * noise) ** 2 * (len(x) - len(value)) or len(x) <= 5:
            break
        t, x = t[1:], x[1:]
    later = -float(value[-1] / value[-2])
    for _ in range(10):
        later -= float(np.polyval(value, later) / np.polyval(np.polyder(value), later))
    speed = -float(np.polyval(np.polyder(value), later))
    if not speed > 0 or not later > -2 * WINDOW:
        told.append("the cue does not come as far as the ball: no speed")
        return (math.nan,) * 5
    if later > 0.05:
        told.append(f"the pictures end {later:.3f} s before contact: the speed is what it would be then")
    powers = np.arange(len(value))[::-1]
    place, rise = later**powers, powers * later ** np.maximum(powers - 1, 0)
    # Where a tip begins is known to half a pixel.
    wait = math.sqrt(place @ spread @ place + (0.5 * scale) ** 2) / speed
    bend = 0.0 - float(np.polyval(np.polyder(value, 2), later))
    return speed, math.sqrt(rise @ spread @ rise), bend, float(t[-1]) + later, wait
