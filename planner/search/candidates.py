"""Ways to play a scene, and a fan of aims along each: where the search begins.

A way says which pocket, over which cushion the object ball goes, if any, and over which the cue ball comes to it. The
pocket is mirrored in the object ball's cushion, the ghost ball (one diameter from the object ball, away from the
pocket) in the cue ball's. That aim leaves out throw, swerve, squirt, spin at the cushion: so every combination of speed
and tip offset is played at aims in a fan about it, in the event engine, and the aims are weighed by how often the
launcher's azimuth errs from one to the other. Sources: ghost-ball aiming (Alciatore), and what throw and swerve can be
(Robotic Billiards 2015, section IV). Leaves out two cushions on one way, and combinations over other balls.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.shot import RAIL_NAMES
from planner.evaluation.outcome import wanted
from planner.evaluation.play import Player
from planner.evaluation.value import Wish, clear, worth
from planner.launcher.execution import Execution
from planner.launcher.stroke import AZIMUTH, SPEED, Launcher
from planner.scene import POCKETS, Pocket, Scene, pocket_name, pocket_places

Array = NDArray[np.float64]
THINNEST = math.radians(80)  # cut beyond which a ball is not aimed at
STRAIGHT = math.radians(5)  # cut up to which a shot is called straight
THROW = 0.12  # what throw may turn the object ball by, ample [rad]
PUSH = 0.006  # what effects that push a ball may turn it by, more at long and slow shots [rad]
CURVE = 0.045  # what swerve may turn the cue ball by at the tip's limit [rad]
SOFT = 0.1  # more that a cushion, whose rebound is no mirror, asks of the fan, in widths of the ghost ball's diameter
AIMS = 41  # in a fan
SPEEDS = 7  # from the slowest to the fastest
# Side and height over the limit of the tip.
OFFSETS = (
    *((0.0, 0.0), (0.0, 0.5), (0.0, 0.9), (0.0, -0.5), (0.0, -0.9)),
    *((0.55, 0.0), (-0.55, 0.0), (0.95, 0.0), (-0.95, 0.0)),
    *((0.6, 0.6), (-0.6, 0.6), (0.6, -0.6), (-0.6, -0.6)),
)


@dataclass(frozen=True)
class Way:
    """One geometric way to pot the ball."""

    pocket: int  # of planner.scene.POCKETS
    bank: int  # rail of the object ball; -1 for none
    kick: int  # rail of the cue ball; -1 for none
    aim: float  # of the cue ball [rad]
    run: float  # of the cue ball to the ghost ball [m]
    roll: float  # of the object ball to the pocket [m]
    cut: float  # [rad], 0 to pi/2
    lies: str  # what is in the way, "" for nothing

    @property
    def effort(self) -> float:
        """How hard it is, roughly: what an error of the aim grows to at the pocket [m/rad]."""
        return (
            self.run * self.roll / max(math.cos(self.cut), 0.05) * (1 + 3 * (self.bank >= 0)) * (1 + (self.kick >= 0))
        )


def _mirrored(scene: Scene, place: Array, rail: int) -> Array:
    """A place mirrored in the line where ball centres meet a rail; itself for -1."""
    if rail < 0:
        return place
    k, sign = rail // 2, 1.0 - 2.0 * (rail % 2)
    out = place.copy()
    out[k] = 2 * sign * scene.table.centre_limits(scene.ball)[k] - place[k]
    return out


def _bounce(scene: Scene, start: Array, image: Array, rail: int) -> Array | None:
    """Where the line to a mirrored place meets the rail, within its straight part; None where it does not."""
    k, sign = rail // 2, 1.0 - 2.0 * (rail % 2)
    level = sign * scene.table.centre_limits(scene.ball)[k]
    way = image - start
    if abs(way[k]) < 1e-9:
        return None
    f = (level - start[k]) / way[k]
    point = start + f * way
    half = np.array([scene.table.length, scene.table.width]) / 2
    apart = half[1 - k] - abs(point[1 - k])
    if not 0 < f < 1 or apart < 0.1 or (k == 1 and abs(point[0]) < 0.1):
        return None
    return np.asarray(point)


def _blocked(scene: Scene, legs: list[tuple[Array, Array]], apart: tuple[int, ...], who: str) -> str:
    """Which ball stands in the way of a path, "" for none."""
    for k, name in enumerate(scene.names):
        if k in apart:
            continue
        other = scene.position[k][None, None]
        for a, b in legs:
            if not clear(a[None], b[None], other, scene.ball.diameter)[0]:
                return f"{name} is in the {who}'s way"
    return ""


def every_way(scene: Scene) -> Iterator[Way]:
    """All ways, blocked and impossible ones too: `lies` says what is wrong with them."""
    cue, ball = scene.position[:2]
    diameter = scene.ball.diameter
    places = pocket_places(scene.table)
    for pocket in wanted(scene):
        for bank in range(-1, 4):
            if bank >= 0 and _at_rail(pocket, bank):
                continue
            target = _mirrored(scene, places[pocket], bank)
            legs = [(ball, target)]
            if bank >= 0:
                point = _bounce(scene, ball, target, bank)
                if point is None:
                    continue
                legs = [(ball, point), (point, places[pocket])]
            line = target - ball
            roll = float(np.hypot(*line))
            ghost = ball - diameter * line / max(roll, 1e-9)
            lies = _blocked(scene, legs, (0, 1), scene.names[1])
            for kick in range(-1, 4) if bank < 0 else (-1,):
                image = _mirrored(scene, ghost, kick)
                way = image - cue
                run = float(np.hypot(*way))
                runs, last = [(cue, ghost)], way / max(run, 1e-9)
                if kick >= 0:
                    point = _bounce(scene, cue, image, kick)
                    if point is None:
                        continue
                    runs, last = [(cue, point), (point, ghost)], (ghost - point) / max(np.hypot(*(ghost - point)), 1e-9)
                cut = math.acos(float(np.clip(last @ line / max(roll, 1e-9), -1.0, 1.0)))
                fault = lies or _blocked(scene, runs, (0, 1), scene.names[0])
                if cut > THINNEST:
                    fault = f"cut of {math.degrees(cut):.0f} degrees"
                elif _beyond(scene, ghost):
                    fault = "the ball lies against the cushion, behind it is no room to hit it from"
                yield Way(POCKETS.index(pocket), bank, kick, math.atan2(way[1], way[0]), run, roll, cut, fault)


def _beyond(scene: Scene, ghost: Array) -> bool:
    return bool((np.abs(ghost) > scene.table.centre_limits(scene.ball) + 1e-3).any())


def _at_rail(pocket: Pocket, rail: int) -> bool:
    """Whether a pocket stands on a rail."""
    return bool(pocket[rail // 2] == 1 - 2 * (rail % 2))


def ways(scene: Scene, most: int = 8) -> list[Way]:
    """The ways that lie open, the least demanding first: direct ones, then those over a cushion."""
    found = sorted((w for w in every_way(scene) if not w.lies), key=lambda w: w.effort)
    direct = [w for w in found if w.bank < 0 and w.kick < 0]
    return (direct + [w for w in found if w not in direct])[: max(most, len(direct))]


@dataclass(frozen=True)
class Starts:
    """Strokes from which to search, the best first."""

    q: Array  # (n, 4)
    way: NDArray[np.int64]  # (n,), which of the ways
    score: Array  # (n,), worth, averaged over the azimuth's error alone


def starts(player: Player, found: list[Way], execution: Execution, wish: Wish, count: int) -> Starts:
    """Play fans of aims along ways, and keep the best strokes that differ."""
    scene, launcher = player.scene, player.launcher
    base = combinations(launcher, scene)
    pushed = any(e.opens("forces") for e in player.model.effects)
    parts, who = [], []
    for k, way in enumerate(found):
        # The model's own squirt is known: it is aimed off from the first.
        q = np.array(base)
        q[:, AZIMUTH] = way.aim
        q[:, AZIMUTH] -= player.deflection(q)
        side = np.abs(base[:, 2]) / (launcher.offset * scene.ball.radius)
        width = scene.ball.diameter / max(way.run, scene.ball.diameter)
        half = THROW * width + CURVE * side * min(1.0, way.run) + 0.002
        half = half + PUSH * pushed
        if way.bank >= 0 or way.kick >= 0:
            half = half + SOFT * width + (0.06 if way.kick >= 0 else 0.0)
        fan = np.repeat(q[:, None], AIMS, axis=1)
        fan[..., AZIMUTH] += half[:, None] * np.linspace(-1, 1, AIMS)
        parts.append(fan)
        who.append(np.full(len(base), k))
    if not parts:
        return Starts(np.zeros((0, 4)), np.zeros(0, np.int64), np.zeros(0))
    fans, which = np.concatenate(parts), np.concatenate(who)
    values = worth(scene, player.screen(fans.reshape(-1, 4)), wish).reshape(fans.shape[:2])
    step = fans[:, 1, AZIMUTH] - fans[:, 0, AZIMUTH]
    apart = np.arange(AIMS)[:, None] - np.arange(AIMS)[None]
    blur = np.exp(-0.5 * (apart[None] * step[:, None, None] / max(execution.azimuth_sd, 1e-5)) ** 2)
    blur /= blur.sum(axis=2, keepdims=True)
    weighed = np.einsum("nij,nj->ni", blur, values)
    best = np.argmax(weighed, axis=1)
    rows = np.arange(len(fans))
    score = weighed[rows, best]
    order = np.argsort(-score, kind="stable")
    good = [int(k) for k in order if score[k] > 0]
    first: list[int] = []
    per_way = np.zeros(len(found), int)
    for k in good:  # no way takes more than half of the places that others could use
        if per_way[which[k]] < count // 2:
            first.append(k)
            per_way[which[k]] += 1
    kept = (first + [k for k in good if k not in first])[:count]
    return Starts(fans[kept, best[kept]], which[kept], score[kept])


def combinations(launcher: Launcher, scene: Scene) -> Array:
    """Speeds and tip offsets that the launcher can play, azimuth 0: (n, 4)."""
    limit = launcher.offset * scene.ball.radius
    out = []
    for side, height in OFFSETS:
        size = math.hypot(side, height)
        shrink = min(1.0, 0.95 / size) * limit if size else limit
        for speed in np.geomspace(launcher.slowest * 1.1, launcher.fastest * 0.98, SPEEDS):
            q = np.array([[1.0, 0.0, side * shrink, height * shrink]])
            q[0, SPEED] = speed * launcher.gain(q, scene.ball)[0]
            out.append(q[0])
    return np.array(out)


def describe(way: Way) -> str:
    """A way in words."""
    pocket = POCKETS[way.pocket]
    style, sides = pocket_name(pocket).split(" ", 1)
    kind = "straight" if way.cut < STRAIGHT else f"cut of {math.degrees(way.cut):.0f} degrees"
    bank = f" off the {RAIL_NAMES[way.bank]} cushion" if way.bank >= 0 else ""
    kick = f", cue ball by way of the {RAIL_NAMES[way.kick]} cushion" if way.kick >= 0 else ""
    return f"{kind} into the {style} pocket {sides}{bank}{kick}"
