"""What no shot may do, whatever the table, the effects and their constants: one line for each breach.

Energy counts kinetic energy over the mass of a ball, and the work of pushes that are the same everywhere (slope, and
nap but for a flight). Springs of balls that touch several at once hold some for a moment: what counts is the most of
three samples. A ball that stays in a cushion is laid into it without work against a push: so much may come out of it.
Bodies may overlap by what springs give while they meet, and no more than rounding otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from models.analytic.events import in_mouth
from models.analytic.pocket import jaw_gaps, pockets_of
from models.analytic.spring import CUSHION_TIME, MAX_CLUSTER_S
from models.engine.play import MAX_EVENTS, Game, Result, ShotRows, lay_out, run
from models.engine.rubber import MAX_RAIL_DEPTH
from models.shot import GRAVITY, Array
from tests.random_shots.draws import Batch

TOUCHING_M = 5e-6  # overlap that is none: what leans sinks in between two looks at it [m]
MEETING_S = 2.5 * MAX_CLUSTER_S  # after an event, for which springs may be pressed [s]
SPRING_DEPTH_S = 3 * CUSHION_TIME  # depth of a pressed cushion over the largest speed, at most [s]
ENERGY_SHARE, ENERGY_FLOOR = 1e-6, 1e-9  # gain that is none: of the kinetic energy meanwhile, and [m^2/s^2]
ENERGY_WINDOW = 3  # samples before
LOG_ROOM = 600
MOST_EVENTS = MAX_EVENTS - 1  # with which a shot that is given up is no error


@dataclass(frozen=True)
class Breach:
    """A shot that breaks a law."""

    law: str
    row: int  # of its batch
    said: str


@dataclass(frozen=True)
class Played:
    """A batch as the event engine plays it, to rest."""

    game: Game
    result: Result
    samples: Array  # (n, m, nball, 8)


def play(batch: Batch, threads: int = 1) -> Played:
    """Play a batch to rest, and sample it."""
    shots, n = batch.shots, len(batch.shots)
    game = lay_out(batch.model, n, batch.jaws)
    start = np.zeros((n, len(shots[0].names), 8))
    for k, one in enumerate(shots):
        start[k, :, :2], start[k, :, 2:4], start[k, :, 4:7] = one.position, one.velocity, one.spin
    times = np.array([s.times for s in shots])
    stays, struck = np.zeros(start.shape[:2], np.bool_), np.ones(n, np.bool_)
    session = np.array([s.session.row for s in shots])
    until = np.full(n, np.inf)
    result, out = run(game, ShotRows(start, stays, struck, session, until, times), LOG_ROOM, threads, MOST_EVENTS, True)
    return Played(game, result, out)


def breaches(batch: Batch, played: Played) -> list[Breach]:
    """Every law that a shot of a batch breaks, the first breach of each."""
    found: list[Breach] = []
    for row in range(len(batch.shots)):
        for law in (_ends, _finite, _apart, _inside, _energy):
            said = next(law(batch, played, row), None)
            if said is not None:
                found.append(Breach(law.__name__.strip("_"), row, said))
    return found


def _ends(batch: Batch, played: Played, row: int) -> Iterator[str]:
    """A shot comes to rest."""
    if not np.isfinite(played.result.time[row]):
        counts = played.result.counts[row]
        yield f"given up after {int(counts.sum())} events {counts.tolist()}"


def _finite(batch: Batch, played: Played, row: int) -> Iterator[str]:
    """Balls are somewhere until they are potted, and nowhere after."""
    seen, result = played.samples[row], played.result
    ended = np.isfinite(result.time[row])
    gone = np.isnan(seen).any(axis=2)  # (m, nball)
    if ended and (gone[:-1] & ~gone[1:]).any():
        yield "a ball comes back"
    last = np.concatenate([result.position[row], result.velocity[row], result.spin[row]], axis=1)
    odd = ~np.isfinite(last).all(axis=1) | (ended & gone[-1] & ~result.potted[row])
    if odd.any():
        yield f"ball {int(np.argmax(odd))} is nowhere"


def _meeting(batch: Batch, played: Played, row: int) -> NDArray[np.bool_]:
    """At which samples (m,) springs may be pressed."""
    times = batch.shots[row].times
    when = played.result.event_time[row]
    if np.isfinite(when[-1]):  # more events than were logged
        return np.ones(len(times), bool)
    when = when[np.isfinite(when)]
    since = times - np.concatenate([[-np.inf], when])[np.searchsorted(when, times, side="right")]
    return np.asarray(since < MEETING_S)


def _allowed(batch: Batch, played: Played, row: int) -> Array:
    """Overlap at every sample and at the end (m + 1,) that is in order [m]."""
    fastest = float(np.nanmax(np.hypot(played.samples[row, :, :, 2], played.samples[row, :, :, 3]), initial=0.0))
    pressed = np.where(_meeting(batch, played, row), SPRING_DEPTH_S * fastest, 0.0)
    return np.append(TOUCHING_M + pressed, TOUCHING_M)


def _places(played: Played, row: int) -> Array:
    """Places at every sample and at the end, NaN where potted: (m + 1, nball, 2) [m]."""
    last = np.where(played.result.potted[row][:, None], np.nan, played.result.position[row])
    return np.concatenate([played.samples[row, :, :, :2], last[None]])


def _apart(batch: Batch, played: Played, row: int) -> Iterator[str]:
    """Balls do not overlap."""
    xy, allowed = _places(played, row), _allowed(batch, played, row)
    for i in range(1, xy.shape[1]):
        off = xy[:, :i] - xy[:, i : i + 1]
        over = batch.model.ball.diameter - np.hypot(off[..., 0], off[..., 1])  # (m + 1, i)
        bad = over > allowed[:, None]
        if bad.any():
            j = int(np.argmax(bad.any(axis=0)))
            k, most = int(np.argmax(bad[:, j])), float(np.nanmax(over[:, j]))
            yield f"balls {j} and {i} overlap by {1e3 * most:.2g} mm at sample {k} of {len(xy)}"


def _inside(batch: Batch, played: Played, row: int) -> Iterator[str]:
    """Balls stay within the noses, but for where pockets let them in."""
    xy, allowed = _places(played, row), _allowed(batch, played, row)
    allowed[:-1] += _deepest(batch)
    half, limits = played.game.half[row], played.game.limits[row]
    ends = played.game.pockets.ends
    for rail in range(4):
        k, sign = rail // 2, 1.0 - 2.0 * (rail % 2)
        over = sign * xy[..., k] - limits[k]
        for s, i in np.argwhere(over > allowed[:, None]).tolist():
            if not in_mouth(float(xy[s, i, 1 - k]), rail, half, ends):
                along = float(xy[s, i, 1 - k])
                deep = 1e3 * float(over[s, i])
                yield f"ball {i} is {deep:.2g} mm into rail {rail} at sample {s}, {along:.3f} m along"
                break
    if batch.jaws:
        jaws = pockets_of(batch.model.table, batch.model.ball).jaws
        gaps = jaw_gaps(xy.reshape(-1, 2), jaws[:12]).reshape(len(xy), -1)
        bad = (gaps < -allowed[:, None]).any(axis=1)
        if bad.any():
            s = int(np.argmax(bad))
            yield f"a ball is {-1e3 * float(np.nanmin(gaps[s])):.2g} mm into a jaw at sample {s}"


def _deepest(batch: Batch) -> float:
    """How deep a ball may be in a rail that it stays in, the longer if another one hits it there [m]."""
    stays = any(effect.name() == "cushion_contact_time" for effect in batch.model.effects)
    return MAX_RAIL_DEPTH * batch.model.ball.radius if stays else 0.0


def pushes(batch: Batch, row: int) -> tuple[Array, float]:
    """What pushes every ball the same way everywhere: a slope (2,), and the nap along x what the cloth carries."""
    slope, nap = np.zeros(2), 0.0
    for effect in batch.model.select(np.array([row])).effects:
        own = {k: float(np.ravel(getattr(effect, k))[0]) for k in effect.parameters()}
        if effect.name() == "table_tilt":
            slope += GRAVITY * np.array([own["slope_x"], own["slope_y"]])
        elif effect.name() == "cloth_nap":
            nap += own["push"]
    return slope, nap


def _landing(batch: Batch, row: int) -> float:
    """When the struck ball lies on the cloth [s]."""
    hops = [e for e in batch.model.select(np.array([row])).effects if e.name() == "cue_hop"]
    speed = float(np.hypot(*batch.shots[row].velocity[0]))
    return sum(float(np.ravel(e.time_per_speed)[0]) * speed for e in hops)  # type: ignore[attr-defined]


def _napped(batch: Batch, row: int, x: Array, nap: float) -> Array:
    """How far along x (m, nball) the nap has pushed every ball: the whole way, but for a flight (m, nball) [m]."""
    times, landing = batch.shots[row].times, _landing(batch, row)
    way = np.diff(x[:, 0])
    flies, lands = times[1:] <= landing, (times[:-1] < landing) & (landing < times[1:])
    # Where it lands within an interval the nap has done no more than its work of the whole of it.
    counted = np.where(flies | (lands & (nap * way < 0.0)), 0.0, way)
    out = x.copy()
    out[:, 0] = x[0, 0] + np.concatenate([[0.0], np.cumsum(counted)])
    return out


def _energy(batch: Batch, played: Played, row: int) -> Iterator[str]:
    """No energy comes from nowhere."""
    if not np.isfinite(played.result.time[row]):
        return
    slope, nap = pushes(batch, row)
    seen = played.samples[row]
    weight = np.ones(seen.shape[1])
    for effect in batch.model.select(np.array([row])).effects:
        if effect.name() == "cue_ball_mass":
            weight[0] = float(np.ravel(effect.factor)[0])  # type: ignore[attr-defined]
    here = np.isfinite(seen[..., 0])
    speed = np.sum(seen[..., 2:4] ** 2, axis=-1) + 0.4 * batch.model.ball.radius**2 * np.sum(
        seen[..., 4:7] ** 2, axis=-1
    )
    height = -2.0 * (np.sum(slope * seen[..., :2], axis=-1) + nap * _napped(batch, row, seen[..., 0], nap))
    kinetic = np.nansum(weight * speed, axis=1)
    if not slope.any() and nap == 0.0:
        whole = kinetic
    else:
        few = int(np.argmax(~here.all(axis=1))) if not here.all() else len(here)  # until the first is potted
        whole = kinetic[:few] + np.sum(weight * height[:few], axis=1)
    w = ENERGY_WINDOW
    if len(whole) <= w:
        return
    before = sliding_window_view(whole[:-1], w).max(axis=1)
    # What moves meanwhile counts: a slope may have driven balls that began at next to nothing.
    moving = sliding_window_view(kinetic[: len(whole)], w + 1).max(axis=1)
    laid = 2.0 * float(np.abs(slope).sum() + abs(nap)) * _deepest(batch) * float(weight.sum())
    rises = whole[w:] > before + ENERGY_SHARE * moving + ENERGY_FLOOR + laid
    if rises.any():
        k = int(np.argmax(rises))
        yield f"energy rises by {whole[k + w] - before[k]:.2g} of {moving[k]:.2g} m^2/s^2 at sample {k + w}"
