"""Friction and restitution from tracks, each by a method of its own: no simulator, no common fit.

After Mathavan, Jackson, Parkin 2009 and Robotic Billiards (2015) section III:

* rolling, mu_r: s(t) along the path of every stretch that rolls, s = s0 + v t - 1/2 mu_r g t^2 to its stop;
* sliding, mu_s: slide and roll joined at an unknown instant where a segment begins, in the plane, with the slip in any
  direction; sliding, the velocity changes by d = -2/7 of the slip, at mu_s g;
* sidespin: the mark's angle between two events, a = a0 + w t - 1/2 alpha t^2 to its stop;
* balls: velocities of both at the instant where their centres are 2R apart, along the line between them, the other
  ball having rested. Friction changes that ratio by 0.001 at most;
* cushion: velocities before and after, at the instant where the two paths meet. Their ratio along the normal is the
  APPARENT restitution: the nose is above the centre and the cloth acts, so it depends on the spin (0.91 rolling, 0.84
  in stun, of an energetic 0.98). For balls that came rolling, it and the slip that they left with are turned into the
  energetic restitution and the friction of the impact model of models/analytic/impulse.py.

Left out: what pushes a ball besides the cloth's friction (a constant push aside is allowed for), contact times.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.analytic.impulse import collide_rows
from models.shot import GRAVITY, Ball
from sysid.clips import ClipSet, Observation
from sysid.clips.noise import position_noise
from sysid.clips.outliers import remove_outliers
from sysid.clips.segments import Segment, cuts_of, split_all
from sysid.direct.measured import (
    SPEEDS,
    UNKNOWN,
    Array,
    Kind,
    Measured,
    Measurements,
    Prior,
    Run,
    Single,
    Stretch,
    along,
    combine,
    fit_run,
    path,
    slowing,
    stretches,
)

LEAST = 8  # samples of a segment that tells a friction
BEFORE, SLIDING, AFTER = 0.5, 0.3, 0.6  # of a segment that tell the velocity at an impact: rolling, else, after [s]
GAP = 0.15  # longest time between the segments beside an impact [s]
MISFIT = 9.0  # reduced chi-square of a run from which it is left out
WORST = 14.0  # chi-square of a rebound, of four velocities, from which it is left out
SURE, ROUGH, COARSE = 0.12, 0.2, 0.1  # relative sd of a slide, of a slowing, of an impact from which it is left out
LIGHT = 0.4  # least deceleration of a slide [m/s^2]
TURNED = 0.5  # least angle that a spinning ball turns [rad]
SLOW = 0.2  # slower impacts are left out [m/s]
STEEP, OBLIQUE, CUT = np.radians([25.0, 50.0, 55.0])  # widest angles off the normal: ratio, restitution, balls
SPUN = 0.35  # sidespin R w / v above which a rebound's ratio is left out
STRAY = 0.02  # a rebound seen farther than this from the cushion is none [m]
LAIN = 0.002  # how far a ball that lies may seem to move [m]
USUAL = (0.14, 0.05)  # friction of a cushion and its sd, where the tracks do not tell: Mathavan 2010
ENOUGH, MOST = 5, 40  # rebounds of which the cushion's friction is sought, at least and at most

SLIDE = Kind("decoupled_cloth.slide", "1", "segments", "slide and roll joined at an unknown instant",
             "film stun, draw or follow shots at 1 m/s or more", GRAVITY, "slide_friction_speed", "1/s")  # fmt: skip
ROLL = Kind("decoupled_cloth.roll", "1", "segments", "even slowing along the path while rolling",
            "film balls that roll for a second or more", GRAVITY, "speed_drag (or air_drag)", "1/s", True)  # fmt: skip
SPIN = Kind("decoupled_cloth.spin", "rad/s^2", "segments", "even slowing of the turned angle",
            "film a marked ball spun on the spot", 1.0, "spin_decay_speed", "rad/s^2 per m/s")  # fmt: skip
BALL = Kind("ball_impact.restitution", "1", "impacts", "velocities of both balls along the line of centres",
            "film balls that run into resting ones", 1.0, "ball_restitution_speed", "s/m")  # fmt: skip
RATIO = Kind("cushion velocity ratio", "1", "rebounds", "normal velocity after over before, rolling, within 25 deg",
             "film balls that roll straight at a cushion", 1.0, "cushion_restitution_speed", "s/m")  # fmt: skip
CUSHION = Kind("cushion_impact.restitution", "1", "rebounds", "energetic, of velocity and slip after a rolling ball's",
               "film balls that roll at a cushion", 1.0, "cushion_restitution_speed", "s/m")  # fmt: skip
NOSE = Kind("cushion_impact.friction", "1", "rebounds", "the one with which rebounds agree best",
            "film five or more balls that roll at a cushion at angles")  # fmt: skip


@dataclass(frozen=True)
class Known:
    """What the cloth's measurements give to the fits beside impacts."""

    sigma: float  # [m]
    frame: float  # [s]
    prior: Prior  # of a run
    cloth: float  # mu_s


def sliding(found: Sequence[Stretch], names: Sequence[str]) -> list[Single]:
    """Deceleration of every slide that is long enough to tell it [m/s^2]."""
    singles = []
    for k in found:
        p, cov = k.run.p, k.run.cov
        value, rel, size = math.exp(p[6]), math.sqrt(cov[6, 6]), math.hypot(*p[4:6])
        sure = rel < SURE and size > 5 * math.sqrt(max(cov[4, 4], cov[5, 5]))
        if sure and value > LIGHT and k.run.chi2 < MISFIT:
            slip = 1.75 * size if math.isfinite(k.rolls) else math.nan  # mean of what falls from 7/2 |d| to nothing
            where = names[k.segment.clip], k.segment.ball, float(k.segment.time[0])
            singles.append(Single(*where, value, rel * value, slip, math.atan2(p[3], p[2])))
    return singles


def rolling(found: Sequence[Stretch], names: Sequence[str], sigma: float) -> list[Single]:
    """Deceleration of every stretch that rolls far enough [m/s^2]."""
    singles = []
    for k in found:
        use = k.segment.time >= k.rolls
        way = along(k.segment.xy[use]) if use.sum() >= LEAST else None
        r = slowing(k.segment.time[use], way[0], sigma, max(6 * sigma, 0.004)) if way is not None else None
        if way is not None and r is not None and r.chi2 < MISFIT and r.sd < ROUGH * r.rate:
            widened = math.sqrt(max(r.chi2, 1.0))
            where = names[k.segment.clip], k.segment.ball, float(k.segment.time[use][0])
            singles.append(Single(*where, r.rate, r.sd * widened, r.at, way[1], r.slope, r.slope_sd * widened))
    return singles


def spinning(clip_set: ClipSet, sigma: float) -> list[Single]:
    """Deceleration of the sidespin of every marked ball between two events [rad/s^2]."""
    singles = []
    for clip in clip_set.clips:
        for name, seen in clip.balls.items():
            if np.isfinite(seen.theta).sum() < LEAST:
                continue
            cuts = [c.sample for c in cuts_of(name, dict(clip.balls), clip_set.table, clip_set.ball, sigma)]
            for low, high in zip([-1, *cuts], [*cuts, len(seen.time)], strict=True):
                part = _turning(seen, low + 1, high)
                if len(part) < LEAST:
                    continue
                t, angle = seen.time[part], seen.theta[part]
                r = slowing(t, angle * np.sign(angle[len(angle) // 3] - angle[0]), None, 0.15)
                if r is not None and r.sd < ROUGH * r.rate and r.speed**2 > 2 * r.rate * TURNED:
                    speed = float(np.hypot(*(seen.xy[part[-1]] - seen.xy[part[0]])) / (t[-1] - t[0]))
                    singles.append(Single(clip.file, name, float(t[0]), r.rate, r.sd, speed))
    return singles


def _turning(seen: Observation, low: int, high: int) -> NDArray[np.int64]:
    """Samples from low to high whose angle is seen, without those before the ball begins to turn."""
    part = low + np.flatnonzero(np.isfinite(seen.theta[low:high]))
    if len(part) < LEAST:
        return part
    angle = seen.theta[part]
    noise = float(np.median(np.abs(np.diff(angle, 3)))) / 0.6745 / math.sqrt(20)
    begun = np.flatnonzero(np.abs(angle - angle[0]) > 8 * noise + 0.02)
    return part[int(begun[0]) if begun.size and begun[0] > 1 else 0 :]


def _before(k: Stretch, known: Known) -> tuple[Run, float, bool] | None:
    """The run that ends at an impact, when it begins [s], and whether it rolls; None where it does not fit."""
    s, (mean, sd) = k.segment, known.prior
    rolls = int(np.sum(s.time >= k.rolls)) >= LEAST
    use = s.time >= min(max(k.rolls, s.time[-1] - BEFORE) if rolls else s.time[-1] - SLIDING, s.time[-LEAST])
    start = float(s.time[use][0])
    held = np.where(np.arange(9) // 2 == 2, 0.0, sd) if rolls else sd  # no slide
    run = fit_run(s.time[use] - start, s.xy[use], known.sigma, (mean, held))
    return (run, start, rolls) if run.chi2 < MISFIT else None


def _after(s: Segment, contact: float, known: Known) -> Run | None:
    """The run that begins at an impact at a time [s]; None where it does not fit."""
    use = s.time < max(s.time[0] + AFTER, s.time[LEAST - 1] + known.frame / 2)
    run = fit_run(s.time[use] - contact, s.xy[use], known.sigma, known.prior)
    return run if run.chi2 < MISFIT else None


def _next(found: Sequence[Stretch], clip: int, ball: str, kind: str, time: float) -> Segment | None:
    """The segment with which a ball goes on after an impact at a time [s]."""
    for s in (k.segment for k in found):
        if s.clip == clip and s.ball == ball and s.before == kind and time < s.time[0] < time + GAP:
            return s
    return None


@dataclass(frozen=True)
class Rebound:
    """A ball that met a cushion: how it came, and the run after it."""

    ratio: Single  # of the normal velocities
    into: Array  # (2,) velocity before [m/s]
    own: Array  # (2, 2) its covariance
    run: Run
    normal: Array  # (2,) into the cushion
    angle: float  # of the way in, off the normal [rad]
    rolled: bool  # whether it came rolling


def rebounds(found: Sequence[Stretch], clip_set: ClipSet, known: Known) -> list[Rebound]:
    """Every rebound with enough of the tracks beside it."""
    kept = []
    reach = clip_set.table.centre_limits(clip_set.ball)
    for k in found:
        s, end = k.segment, float(k.segment.time[-1])
        after = _next(found, s.clip, s.ball, "cushion", end) if s.after == "cushion" else None
        before = _before(k, known) if after is not None else None
        if after is None or before is None:
            continue
        axis, sign = "xy".index(after.rail[1]), 1.0 if after.rail[0] == "+" else -1.0
        met = _contact(before[0], before[1], after, axis, known)
        if met is None or not end < met[0] < after.time[0]:
            continue
        (into, own), (out, cov) = before[0].state(met[0] - before[1]), met[1].state(0.0)
        v, w, n = sign * float(into[2 + axis]), -sign * float(out[2 + axis]), 2 + axis
        if v > SLOW and w > 0 and abs(sign * into[axis] - reach[axis]) < STRAY:
            sd = math.hypot(math.sqrt(cov[n, n]), w / v * math.sqrt(own[n, n])) / v
            ratio = Single(clip_set.clips[s.clip].file, s.ball, met[0], w / v, sd, v)
            angle = math.acos(min(v / math.hypot(*into[2:]), 1.0))
            kept.append(Rebound(ratio, into[2:], own[2:, 2:], met[1], sign * np.eye(2)[axis], angle, before[2]))
    return kept


def _contact(before: Run, start: float, after: Segment, axis: int, known: Known) -> tuple[float, Run] | None:
    """When the two paths beside a rebound meet, across the cushion [s], and the run from then on."""
    contact = float(after.time[0]) - known.frame
    run = _after(after, contact, known)
    for _ in range(2):
        if run is None:
            return None
        here, there = before.state(contact - start)[0], run.state(0.0)[0]
        closing = max(abs(float(here[2 + axis] - there[2 + axis])), SLOW)
        contact += float(np.clip(abs(there[axis]) - abs(here[axis]), -GAP * closing, GAP * closing)) / closing
        run = _after(after, contact, known)
    return None if run is None else (contact, run)


def solved(came: Sequence[Rebound], ball: Ball, cloth: float, frictions: Array) -> Array:
    """Of balls that came rolling, for frictions of the cushion (g,): (g, n, 4).

    Energetic restitution, its sd, R omega_z over the normal speed, chi-square: what the impact model says of the
    velocity after, and of the slip, which the slide after it takes up, is met with the first and the third. (Frame: y
    into the cushion.)
    """
    if not came:
        return np.zeros((len(frictions), 0, 4))
    turn = np.array([[[r.normal[1], -r.normal[0]], r.normal] for r in came])
    both = np.array([np.kron(np.eye(2), k) for k in turn])
    into = np.einsum("nij,nj->ni", turn, [r.into for r in came])
    seen = np.einsum("nij,nj->ni", both, [r.run.p[2:6] for r in came])

    def says(x: Array, v: Array, mu: Array) -> Array:
        shape = np.broadcast_shapes(x.shape[:-1], v.shape[:-1], mu.shape)
        e, side, friction = (np.broadcast_to(k, shape).flatten() for k in (x[..., 0], x[..., 1], mu))
        n = len(e)
        go, spin, hit = np.zeros((n, 1, 3)), np.zeros((n, 1, 3)), np.tile(np.array([0, 0, 2]), (n, 1))
        go[:, 0, :2] = np.broadcast_to(v, (*shape, 2)).reshape(n, 2)
        spin[:, 0] = np.column_stack([-go[:, 0, 1], go[:, 0, 0], side * go[:, 0, 1]]) / ball.radius
        collide_rows(True, hit, np.zeros((n, 1, 3)), go, spin, e, friction, np.full(n, cloth), ball.mass, ball.radius)
        slip = go[:, 0, :2] + ball.radius * np.column_stack([-spin[:, 0, 1], spin[:, 0, 0]])
        return np.concatenate([go[:, 0, :2], -2 / 7 * slip], axis=1).reshape(*shape, 4)

    def slope(f: Callable[[Array], Array]) -> Array:
        return np.stack([f(d) - f(-d) for d in 1e-4 * np.eye(2)], axis=-1) / 2e-4

    usual, loose = np.array([0.9, 0.0]), np.diag([4.0, 0.4])  # weakly: neither is far from usual
    carried = slope(lambda d: says(usual, into + d, np.array(USUAL[0]))) @ turn
    cov = both @ np.array([r.run.cov[2:6, 2:6] for r in came]) @ both.transpose(0, 2, 1)
    weight = np.linalg.inv(cov + carried @ np.array([r.own for r in came]) @ carried.transpose(0, 2, 1))
    mu = frictions[:, None, None]
    x = np.tile(usual, (len(frictions), 3, len(came), 1))
    x[..., 1] += np.array([-0.7, 0.0, 0.7])[:, None]  # a slip that sticks hides which side it began on
    for _ in range(10):
        j = slope(lambda d: says(x + d, into, mu))  # noqa: B023 (called at once)
        left = seen - says(x, into, mu)
        back = np.swapaxes(j, -1, -2) @ weight
        square = back @ j + loose
        step = np.linalg.solve(square, back @ left[..., None] + loose @ (usual - x)[..., None])[..., 0]
        x = np.clip(x + np.clip(step, -0.2, 0.2), [0.2, -3.0], [1.2, 3.0])
    chi2 = np.einsum("gsni,nij,gsnj->gsn", left, weight, left)
    told = np.stack([x[..., 0], np.sqrt(np.linalg.inv(square)[..., 0, 0]), x[..., 1], chi2], axis=-1)
    return np.take_along_axis(told, np.argmin(chi2, axis=1)[:, None, :, None], axis=1)[:, 0]


def nose_friction(came: Sequence[Rebound], ball: Ball, cloth: float) -> Measured:
    """Friction of the cushion with which rebounds are met best, and agree best on a restitution."""
    best = sorted(came, key=lambda r: r.ratio.sd / r.ratio.value)[:MOST]
    grid, rows, value = np.zeros(0), np.zeros((0, len(best), 4)), 0.0
    for more in (np.linspace(0.02, 0.42, 15), np.linspace(-0.05, 0.05, 21)):
        more = np.clip(more + value, 0.005, 0.43)
        rows = np.concatenate([rows, solved(best, ball, cloth, more)])[np.argsort(np.concatenate([grid, more]))]
        grid = np.sort(np.concatenate([grid, more]))
        met = rows[..., 3].min(axis=0) < WORST
        n = int(met.sum())
        if n < ENOUGH:
            return combine(NOSE, [])
        e, sd, _, chi2 = np.moveaxis(rows[:, met], -1, 0)
        speed = np.array([r.ratio.speed for r in best])[met]
        columns = np.column_stack([np.ones(n), speed])[:, : 2 if n >= SPEEDS else 1]  # e may fall with speed
        root = (np.abs(e - np.median(e, axis=1)[:, None]) < 9 * np.hypot(sd, 0.03)) / sd
        line = (columns @ (np.linalg.pinv(columns * root[..., None]) @ (e * root)[..., None]))[..., 0]
        total = np.sum(np.minimum(chi2, WORST) + np.minimum(((e - line) / sd) ** 2, WORST), axis=1)
        total = total / max(float(total.min()) / (3 * n - 2), 1.0) + ((grid - USUAL[0]) / USUAL[1]) ** 2
        value = float(grid[np.argmin(total)])
    chance = np.exp(-0.5 * (total - total.min())) * np.gradient(grid)
    value = float(np.average(grid, weights=chance))
    width = math.hypot(math.sqrt(np.average((grid - value) ** 2, weights=chance)), 0.001)
    return Measured(NOSE, value, width, n) if width < USUAL[1] / 2 else combine(NOSE, [])


def cushion(found: Sequence[Rebound], ball: Ball, cloth: float, notes: Sequence[str]) -> list[Measured]:
    """Ratio of the normal velocities, energetic restitution, friction; of balls that came rolling."""
    came = [r for r in found if r.rolled and r.angle < OBLIQUE]
    nose = nose_friction(came, ball, cloth)
    mu, mu_sd = (nose.value, nose.sd) if nose.value is not None and nose.sd is not None else USUAL
    rows = solved(came, ball, cloth, np.array([mu, mu - mu_sd, mu + mu_sd]))

    def energetic(row: Array) -> list[Single]:
        own = [(r, float(x[0]), float(x[1])) for r, x in zip(came, row, strict=True) if x[3] < WORST]
        return [dataclasses.replace(r.ratio, value=e, sd=sd) for r, e, sd in own if sd < COARSE]

    slid = len(found) - sum(r.rolled for r in found)
    told = [f"{slid} of {len(found)} balls came sliding and are left out: their spin is not seen"] if slid else []
    more = [] if nose.value else ["the cushion's friction is not measured here and taken as 0.14 +- 0.05"]
    e, low, high = (combine(CUSHION, energetic(row), [*notes, *told, *more]) for row in rows)
    if e.value is not None and e.sd is not None and low.value is not None and high.value is not None:
        e = dataclasses.replace(e, sd=math.hypot(e.sd, (high.value - low.value) / 2))
    plain = [r.ratio for r, x in zip(came, rows[0], strict=True) if r.angle < STEEP and abs(x[2]) < SPUN]
    return [combine(RATIO, [k for k in plain if k.sd < COARSE], told), e, nose]


def collisions(found: Sequence[Stretch], clip_set: ClipSet, known: Known) -> list[Single]:
    """Restitution of every impact of a ball on one that rested."""
    singles = []
    for k in found:
        s = k.segment
        before = _before(k, known) if s.after == "ball" else None
        met = _touch(before[0], before[1], s, clip_set, known) if before is not None else None
        if before is None or met is None:
            continue
        contact, name, rest, rest_sd = met
        ways = [_next(found, s.clip, ball, "ball", contact - known.frame) for ball in (s.ball, name)]
        runs = [run for way in ways if way is not None and (run := _after(way, contact, known)) is not None]
        if len(runs) < 2:
            continue
        (into, own), (one, first), (two, second) = before[0].state(contact - before[1]), *(r.state(0.0) for r in runs)
        line = (rest - into[:2]) / np.hypot(*(rest - into[:2]))
        cross = np.array([-line[1], line[0]])
        v, out, hit = into[2:], two[2:] - one[2:], two[2:]
        closing = float(v @ line)
        if closing < SLOW or abs(v @ cross) > math.tan(CUT) * closing or abs(hit @ cross) > 0.2 * hit @ line:
            continue
        e = float(out @ line) / closing
        turn = (float(out @ cross) - e * float(v @ cross)) / closing  # de per turn of the line of centres
        aside = math.hypot(math.sqrt(cross @ own[:2, :2] @ cross), rest_sd) / clip_set.ball.diameter
        errors = [math.sqrt(line @ cov[2:, 2:] @ line) / closing for cov in (first, second, e**2 * own)]
        sd = math.hypot(*errors, turn * aside * math.hypot(*v) / closing)
        if sd < COARSE and 0.3 < e < 1.3:
            singles.append(Single(clip_set.clips[s.clip].file, s.ball, contact, e, sd, closing))
    return singles


def _touch(
    run: Run, start: float, s: Segment, clip_set: ClipSet, known: Known
) -> tuple[float, str, Array, float] | None:
    """When a run touches a ball that rests, and no third one [s]; which, where it lay and how well that is known."""
    rests = {}
    for name, seen in clip_set.clips[s.clip].balls.items():
        lay = seen.xy[: max(int(np.sum(seen.time <= s.time[-1])), 1)]
        if name != s.ball and np.abs(lay - np.median(lay, axis=0)).max() < max(5 * known.sigma, LAIN):
            rests[name] = lay.mean(axis=0), known.sigma / math.sqrt(len(lay))
    times = s.time[-1] - start + np.linspace(-1.0, 4.0, 400) * max(known.frame, float(s.time[-1] - s.time[-2]))
    places = path(run.p[None], times)[0]
    size = clip_set.ball.diameter
    for name, (rest, sd) in rests.items():
        gap = np.hypot(*(places - rest).T) - size
        at = int(np.argmax(gap < 0))
        if gap[at] >= 0 or at == 0:
            continue
        near = [n for n, (other, _) in rests.items() if n != name and np.hypot(*(other - rest)) < size + 2 * LAIN]
        part = gap[at - 1] / (gap[at - 1] - gap[at])
        return None if near else (start + float(times[at - 1] + part * (times[at] - times[at - 1])), name, rest, sd)
    return None


def measure(clip_set: ClipSet, progress: Callable[[str], None] = lambda line: None) -> Measurements:
    """Every constant that the clips tell by itself."""
    sigma = position_noise(clip_set)
    clip_set, spikes = remove_outliers(clip_set, sigma)
    frame, names = 1 / clip_set.fps, [c.file for c in clip_set.clips]
    progress("where balls slide and where they roll")
    segments = split_all(clip_set.clips, clip_set.table, clip_set.ball, sigma, clip_set.fps, LEAST + 1)
    found = stretches(segments, sigma, frame)
    slide, roll = combine(SLIDE, sliding(found, names)), combine(ROLL, rolling(found, names, sigma))
    progress("sidespin")
    spin = combine(SPIN, spinning(clip_set, sigma))
    mean, sd = UNKNOWN[0].copy(), UNKNOWN[1].copy()
    for k, one, usual, least in ((6, slide, (0.2, 0.3), 0.02), (7, roll, (0.0127, 0.5), 0.1)):
        value, wide = (one.value, math.hypot(one.sd or 0.0, one.scatter) / one.value) if one.value else usual
        mean[k], sd[k] = math.log(value * GRAVITY), max(wide, least)
    known = Known(sigma, frame, (mean, sd), math.exp(float(mean[6])) / GRAVITY)
    notes = () if slide.value else ("mu_s is not measured here and taken as 0.2 +- 0.06 at impacts",)
    progress("impacts")
    ball = combine(BALL, collisions(found, clip_set, known), notes)
    three = cushion(rebounds(found, clip_set, known), clip_set.ball, known.cloth, notes)
    return Measurements(len(names), sigma, spikes, (slide, roll, spin, ball, *three))
