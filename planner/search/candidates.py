"""Candidate routes of a shot, and the strokes along them from which the search starts.

In: a scene. Out: `Route`s, the geometric ways to pot the ball, with what blocks them; and from `starting_strokes` the
strokes of highest utility in a coarse scan along the open routes.

A route names the pocket, the rail that the object ball comes off, if any (bank), and the rail that the cue ball comes
off first (kick). The pocket is mirrored in the rail of the bank, the ghost ball (one diameter from the object ball,
opposite to the pocket) in the rail of the kick. This aim neglects throw, swerve, squirt and spin at the cushion:
therefore every combination of speed and tip offset is played in the event engine at a fan of aims about it, and the
utilities are smoothed over the fan with the launcher's distribution of azimuth errors. Sources: ghost-ball aiming
(Alciatore), sizes of throw and swerve (Robotic Billiards 2015, section IV). Left out: routes over two cushions, and
combinations over other balls.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.shot import RAIL_NAMES
from planner.evaluation.outcome import goal_pockets
from planner.evaluation.play import Player
from planner.evaluation.value import UtilityWeights, path_is_clear, utility
from planner.launcher.execution import Execution
from planner.launcher.stroke import AZIMUTH, HEIGHT, SIDE, SPEED, LauncherModel
from planner.scene import POCKETS, Pocket, Scene, pocket_name, pocket_places

Array = NDArray[np.float64]
MAX_CUT_RAD = math.radians(80)  # largest cut angle that is tried
STRAIGHT_CUT_RAD = math.radians(5)  # cut angle up to which a shot is called straight
# Half widths of the fan of aims: generous bounds of deviations from the geometric line.
FAN_MARGIN_RAD = 0.002  # margin of every fan
THROW_RAD = 0.12  # throw of the object ball
SWERVE_RAD = 0.045  # swerve of the cue ball, at the tip's limit and 1 m or more of path
FORCE_EFFECTS_RAD = 0.006  # effects that push a rolling ball; more in long and slow shots
REBOUND_WIDTHS = 0.1  # deviation of a rebound from a mirror image, in widths of the ghost ball
KICK_RAD = 0.06  # deviation of the cue ball by the cushion of a kick
AIMS_PER_FAN = 41
SPEED_STEPS = 7  # number of speeds from the slowest to the fastest
# Contact offsets (side, height) of the scan, over the limit of the tip.
SCAN_OFFSETS = (
    *((0.0, 0.0), (0.0, 0.5), (0.0, 0.9), (0.0, -0.5), (0.0, -0.9)),
    *((0.55, 0.0), (-0.55, 0.0), (0.95, 0.0), (-0.95, 0.0)),
    *((0.6, 0.6), (-0.6, 0.6), (0.6, -0.6), (-0.6, -0.6)),
)


@dataclass(frozen=True)
class Route:
    """One geometric way to pot the ball."""

    pocket: int  # index in planner.scene.POCKETS
    bank: int  # rail of the object ball; -1 for none
    kick: int  # rail of the cue ball; -1 for none
    aim: float  # azimuth of the cue ball [rad]
    cue_path: float  # path length of the cue ball to the ghost ball [m]
    object_path: float  # path length of the object ball to the pocket [m]
    cut: float  # cut angle [rad]
    obstacle: str  # the reason why it cannot be played; "" if it is open

    @property
    def direct(self) -> bool:
        """Whether neither ball uses a cushion."""
        return self.bank < 0 and self.kick < 0

    @property
    def difficulty(self) -> float:
        """Error at the pocket per error of the aim [m/rad], with rough factors for cushions."""
        gain = self.cue_path * self.object_path / max(math.cos(self.cut), 0.05)
        return gain * (1 + 3 * (self.bank >= 0)) * (1 + (self.kick >= 0))


def _mirrored(scene: Scene, place: Array, rail: int) -> Array:
    """A point (2,) mirrored in the line on which ball centres meet a rail; itself for -1."""
    if rail < 0:
        return place
    k, sign = rail // 2, 1.0 - 2.0 * (rail % 2)
    out = place.copy()
    out[k] = 2 * sign * scene.table.centre_limits(scene.ball)[k] - place[k]
    return out


def _bounce(scene: Scene, start: Array, image: Array, rail: int) -> Array | None:
    """Point (2,) at which the line to a mirrored point meets the straight part of the rail; None if it does not."""
    k, sign = rail // 2, 1.0 - 2.0 * (rail % 2)
    level = sign * scene.table.centre_limits(scene.ball)[k]
    line = image - start
    if abs(line[k]) < 1e-9:
        return None
    f = (level - start[k]) / line[k]
    point = start + f * line
    half = np.array([scene.table.length, scene.table.width]) / 2
    from_end = half[1 - k] - abs(point[1 - k])
    if not 0 < f < 1 or from_end < 0.1 or (k == 1 and abs(point[0]) < 0.1):
        return None
    return np.asarray(point)


def _blocker(scene: Scene, legs: list[tuple[Array, Array]], who: str) -> str:
    """A text on the ball that blocks a path of straight legs, apart from cue and object ball; "" for none."""
    for name, place in zip(scene.names[2:], scene.position[2:], strict=True):
        for a, b in legs:
            if not path_is_clear(a[None], b[None], place[None, None], scene.ball.diameter)[0]:
                return f"{name} is in the {who}'s way"
    return ""


def all_routes(scene: Scene) -> Iterator[Route]:
    """All routes to the pockets of the goal, including blocked and impossible ones."""
    ball = scene.position[1]
    places = pocket_places(scene.table)
    for pocket in goal_pockets(scene):
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
            obstacle = _blocker(scene, legs, scene.names[1])
            for kick in range(-1, 4) if bank < 0 else (-1,):
                route = _route(scene, (POCKETS.index(pocket), bank, kick), target, obstacle)
                if route is not None:
                    yield route


def _route(
    scene: Scene, number: tuple[int, int, int], target: Array, object_obstacle: str
) -> Route | None:  # fmt: skip
    """The route of (pocket, bank, kick) with the pocket's image at `target` (2,); None if the kick misses its rail."""
    (pocket, bank, kick), (cue, ball) = number, scene.position[:2]
    line = target - ball
    object_path = float(np.hypot(*line))
    ghost = ball - scene.ball.diameter * line / max(object_path, 1e-9)
    image = _mirrored(scene, ghost, kick)
    aim = image - cue
    cue_path = float(np.hypot(*aim))
    legs, arrival = [(cue, ghost)], aim / max(cue_path, 1e-9)
    if kick >= 0:
        point = _bounce(scene, cue, image, kick)
        if point is None:
            return None
        legs, arrival = [(cue, point), (point, ghost)], (ghost - point) / max(np.hypot(*(ghost - point)), 1e-9)
    cut = math.acos(float(np.clip(arrival @ line / max(object_path, 1e-9), -1.0, 1.0)))
    obstacle = object_obstacle or _blocker(scene, legs, scene.names[0])
    if cut > MAX_CUT_RAD:
        obstacle = f"cut of {math.degrees(cut):.0f} degrees"
    elif (np.abs(ghost) > scene.table.centre_limits(scene.ball) + 1e-3).any():
        obstacle = "the ball is against the cushion, and there is no room behind it"
    return Route(pocket, bank, kick, math.atan2(aim[1], aim[0]), cue_path, object_path, cut, obstacle)


def _at_rail(pocket: Pocket, rail: int) -> bool:
    """Whether a pocket stands on a rail."""
    return bool(pocket[rail // 2] == 1 - 2 * (rail % 2))


def open_routes(scene: Scene, count: int = 8) -> list[Route]:
    """All open direct routes, then open ones over a cushion, `count` in all; the least difficult first."""
    routes = sorted((r for r in all_routes(scene) if not r.obstacle), key=lambda r: r.difficulty)
    direct = [r for r in routes if r.direct]
    return (direct + [r for r in routes if not r.direct])[: max(count, len(direct))]


@dataclass(frozen=True)
class StartingStrokes:
    """Start strokes of the search, the best first."""

    q: Array  # (n, 4)
    route: NDArray[np.int64]  # (n,), index of the route
    score: Array  # (n,), utility averaged over the error of the azimuth alone


def starting_strokes(
    player: Player, routes: list[Route], execution: Execution, weights: UtilityWeights, count: int
) -> StartingStrokes:
    """Play fans of aims along routes, and return the `count` strokes of highest smoothed utility."""
    scene, launcher = player.scene, player.launcher
    base = stroke_grid(launcher, scene)
    if not routes:
        return StartingStrokes(np.zeros((0, 4)), np.zeros(0, np.int64), np.zeros(0))
    fans = np.concatenate([_fan(player, route, base) for route in routes])
    which = np.repeat(np.arange(len(routes)), len(base))
    values = utility(scene, player.screen(fans.reshape(-1, 4)), weights).reshape(fans.shape[:2])
    step = fans[:, 1, AZIMUTH] - fans[:, 0, AZIMUTH]
    apart = np.arange(AIMS_PER_FAN)[:, None] - np.arange(AIMS_PER_FAN)[None]
    kernel = np.exp(-0.5 * (apart[None] * step[:, None, None] / max(execution.azimuth_sd, 1e-5)) ** 2)
    kernel /= kernel.sum(axis=2, keepdims=True)
    smoothed = np.einsum("nij,nj->ni", kernel, values)
    best = np.argmax(smoothed, axis=1)
    score = smoothed[np.arange(len(fans)), best]
    order = np.argsort(-score, kind="stable")
    good = [int(k) for k in order if score[k] > 0]
    chosen: list[int] = []
    per_route = np.zeros(len(routes), int)
    for k in good:  # a route gets at most half of the list while others have strokes
        if per_route[which[k]] < count // 2:
            chosen.append(k)
            per_route[which[k]] += 1
    chosen = (chosen + [k for k in good if k not in chosen])[:count]
    return StartingStrokes(fans[chosen, best[chosen]], which[chosen], score[chosen])


def _fan(player: Player, route: Route, base: Array) -> Array:
    """Strokes (n, AIMS_PER_FAN, 4) with the speeds and offsets of `base` (n, 4) at aims about a route's."""
    q = aimed_along(player, route, base)
    half = fan_half_width(player, route, base)
    half = half + FORCE_EFFECTS_RAD * any(e.opens("forces") for e in player.model.effects)
    if not route.direct:
        half = half + REBOUND_WIDTHS * _ghost_width(player, route) + (KICK_RAD if route.kick >= 0 else 0.0)
    fan = np.repeat(q[:, None], AIMS_PER_FAN, axis=1)
    fan[..., AZIMUTH] += half[:, None] * np.linspace(-1, 1, AIMS_PER_FAN)
    return fan


def aimed_along(player: Player, route: Route, q: Array) -> Array:
    """Strokes (n, 4) turned so that the ball leaves along a route, against the model's own squirt."""
    out = np.array(q)
    out[:, AZIMUTH] = route.aim
    out[:, AZIMUTH] -= player.deflection(out)
    return out


def fan_half_width(player: Player, route: Route, q: Array) -> Array:
    """Half width of the fan of aims of strokes (n, 4) along a direct route, for throw and swerve: (n,) [rad]."""
    side = np.abs(q[:, SIDE]) / player.launcher.max_offset(player.scene.ball)
    swerve = SWERVE_RAD * side * min(1.0, route.cue_path)
    return np.asarray(THROW_RAD * _ghost_width(player, route) + swerve + FAN_MARGIN_RAD)


def _ghost_width(player: Player, route: Route) -> float:
    """Angle under which the cue ball sees the ghost ball's diameter, 1 at most [rad]."""
    diameter = player.scene.ball.diameter
    return diameter / max(route.cue_path, diameter)


def stroke_grid(launcher: LauncherModel, scene: Scene) -> Array:
    """All combinations of speeds and tip offsets of the scan, azimuth 0: (n, 4)."""
    limit = launcher.max_offset(scene.ball)
    speeds = np.geomspace(launcher.slowest * 1.1, launcher.fastest * 0.98, SPEED_STEPS)
    out = np.zeros((len(SCAN_OFFSETS), SPEED_STEPS, 4))
    for rows, (side, height) in zip(out, SCAN_OFFSETS, strict=True):
        size = math.hypot(side, height)
        shrink = min(1.0, 0.95 / size) * limit if size else limit
        rows[:, SIDE], rows[:, HEIGHT] = side * shrink, height * shrink
        rows[:, SPEED] = speeds * launcher.gain(rows[:1], scene.ball)[0]
    return out.reshape(-1, 4)


def describe_route(route: Route) -> str:
    """A route in words."""
    pocket = POCKETS[route.pocket]
    style, sides = pocket_name(pocket).split(" ", 1)
    kind = "straight" if route.cut < STRAIGHT_CUT_RAD else f"cut of {math.degrees(route.cut):.0f} degrees"
    bank = f" off the {RAIL_NAMES[route.bank]} cushion" if route.bank >= 0 else ""
    kick = f", cue ball via the {RAIL_NAMES[route.kick]} cushion" if route.kick >= 0 else ""
    return f"{kind} into the {style} pocket {sides}{bank}{kick}"
