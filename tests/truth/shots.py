"""Random shots of named kinds, played until one shows what its kind is for.

Contact points are drawn in ball radii and speeds for a full-size table, scaled by the square root of the table's
length (a ball's run grows with its speed squared), so that every kind works on any table.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tests.truth.camera import rolled
from tests.truth.cloth import Constants
from tests.truth.physics import STEP, Cue, Motion, Start, Table, leaves, simulate, strike

FULL_LENGTH = 3.569  # of the table the speeds are meant for [m]
MISCUE = 0.48  # largest distance of the contact point from the centre, in radii
ATTEMPTS = 2000
AFTER_REST = 0.25  # filmed after the last ball has come to rest [s]


@dataclass(frozen=True)
class Scene:
    """The balls at t = 0 and the stroke that set them going; no stroke where a ball was spun by hand."""

    balls: dict[str, Start]
    cue: Cue | None


@dataclass(frozen=True)
class Shot:
    """A scene, and what came of it."""

    kind: str
    scene: Scene
    motion: Motion


class NoShot(Exception):
    """No draw of a kind did what the kind is for."""


@dataclass(frozen=True)
class Draw:
    """What a kind draws its scenes from."""

    rng: np.random.Generator
    table: Table
    c: Constants

    def between(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def either(self, low: float, high: float) -> float:
        """A size between low and high with a random sign."""
        return float(self.rng.choice([-1.0, 1.0])) * self.between(low, high)

    def place(self) -> tuple[float, float]:
        """Somewhere on the table, two diameters clear of the cushions [m]."""
        room = self.table.reach(self.c.radius) - 4 * self.c.radius
        x, y = self.rng.uniform(-room, room)
        return float(x), float(y)

    def cue(self, speed: tuple[float, float], side: float = 0.0, height: float = 0.0, elevation: float = 0.0) -> Cue:
        """A stroke with its contact point given in radii."""
        v = self.between(*speed) * float(np.sqrt(self.table.length / FULL_LENGTH))
        radius = self.c.radius
        return Cue(v, self.between(-np.pi, np.pi), side * radius, height * radius, elevation)

    def scene(self, cue: Cue) -> Scene:
        return Scene({"cue": strike(self.place(), cue, self.c.radius, self.c.squirt)}, cue)

    def carom_scene(self, cue: Cue) -> Scene:
        """As `cut_scene`, with a third ball, "yellow", somewhere clear of the others."""
        scene = self.cut_scene(cue)
        while True:
            yellow = Start(self.place())
            gaps = [np.hypot(*np.subtract(yellow.xy, ball.xy)) for ball in scene.balls.values()]
            if min(gaps) > 3 * self.c.radius:
                return Scene({**scene.balls, "yellow": yellow}, cue)

    def cut_scene(self, cue: Cue) -> Scene:
        """The struck ball runs 0.15 to 0.45 table widths into "red", 5 to 55 degrees off the line of centres."""
        x, y = self.place()
        way = leaves(cue, self.c.squirt)
        run, line = self.between(0.15, 0.45) * self.table.width, way + self.either(0.09, 0.96)
        red = (
            x + run * float(np.cos(way)) + 2 * self.c.radius * float(np.cos(line)),
            y + run * float(np.sin(way)) + 2 * self.c.radius * float(np.sin(line)),
        )
        return Scene({"cue": strike((x, y), cue, self.c.radius, self.c.squirt), "red": Start(red)}, cue)


def _side(d: Draw) -> Scene:
    """Strong sidespin, 40 to 80 rad/s where the tip's grip allows it."""
    cue = d.cue((1.1, 2.5), height=d.between(-0.12, 0.12))
    omega = d.either(40.0, 80.0)
    limit = np.sqrt(MISCUE**2 - 0.12**2) * d.c.radius
    side = float(np.clip(0.4 * omega * d.c.radius**2 / cue.speed, -limit, limit))
    return d.scene(Cue(cue.speed, cue.azimuth, side, cue.height))


def _spin(d: Draw) -> Scene:
    """A marked ball spun by hand, hardly moving."""
    drift, way = d.between(0.0, 0.02), d.between(-np.pi, np.pi)
    velocity = (drift * float(np.cos(way)), drift * float(np.sin(way)))
    return Scene({"cue": Start(d.place(), velocity, (0.0, 0.0, d.either(30.0, 70.0)))}, None)


@dataclass(frozen=True)
class Kind:
    """How a kind's scenes are drawn, and which event must come first ("" for none in particular)."""

    draw: Callable[[Draw], Scene]
    first: str = ""
    cushions: int = 0  # met by the struck ball at least
    longer: float = 1.0  # filmed this many times as long
    impacts: tuple[int, int] = (0, 0)  # at least and at most, of a shot filmed to its end; 0, 0 where others count


KINDS: dict[str, Kind] = {
    "roll": Kind(lambda d: d.scene(d.cue((0.5, 1.7), height=0.4))),
    "stun": Kind(lambda d: d.scene(d.cue((1.0, 2.5)))),
    "draw": Kind(lambda d: d.scene(d.cue((1.0, 2.2), height=d.between(-0.45, -0.2)))),
    "follow": Kind(lambda d: d.scene(d.cue((0.7, 2.0), height=d.between(0.1, MISCUE)))),
    "side": Kind(_side),
    "swerve": Kind(lambda d: d.scene(d.cue((0.9, 1.8), d.either(0.2, 0.45), elevation=d.between(0.3, 0.9)))),
    "spin": Kind(_spin),
    "cushion": Kind(lambda d: d.scene(d.cue((0.8, 2.3), height=d.between(0.0, 0.4))), "cushion", 1),
    "cushion_side": Kind(lambda d: d.scene(d.cue((0.8, 2.3), d.either(0.15, 0.45))), "cushion", 1),
    "cut": Kind(lambda d: d.cut_scene(d.cue((0.9, 2.3), height=d.between(-0.35, 0.4))), "ball"),
    "cut_side": Kind(
        lambda d: d.cut_scene(d.cue((0.9, 2.3), d.either(0.15, 0.33), d.between(-0.33, 0.33))),
        "ball",
    ),
    "carom": Kind(
        lambda d: d.carom_scene(d.cue((2.5, 5.5), d.between(-0.33, 0.33), d.between(-0.2, 0.4))),
        longer=4.0,
        impacts=(6, 14),
    ),
    "long": Kind(lambda d: d.scene(d.cue((1.8, 3.2), d.between(-0.2, 0.2), 0.35)), "cushion", 2, 1.5),
}
USUAL = tuple(name for name, kind in KINDS.items() if not any(kind.impacts))  # not filmed to their end


def _shows(kind: Kind, motion: Motion, open_cloth: bool) -> bool:
    """Whether the film shows what the kind is for, with room around the first event, and mostly the struck ball."""
    seen = np.isfinite(motion.xy[:, 0, 0])
    if np.count_nonzero(seen) < max(3, 0.6 * len(seen)):
        return False
    if any(kind.impacts):
        return kind.impacts[0] <= len(motion.events) <= kind.impacts[1]
    if not kind.first:
        return not (open_cloth and motion.events)
    cushions = sum(e.kind == "cushion" and e.balls[0] == motion.names[0] for e in motion.events)
    if not motion.events or motion.events[0].kind != kind.first or cushions < kind.cushions:
        return False
    return bool(0.15 < motion.events[0].time / motion.times[-1] < 0.7)


def _fits(scene: Scene, table: Table, radius: float) -> bool:
    """Whether all balls lie clear of the cushions."""
    room = table.reach(radius) - radius
    return all(bool(np.all(np.abs(ball.xy) < room)) for ball in scene.balls.values())


def film(motion: Motion, fps: float) -> Motion:
    """The motion until a little after all has come to rest."""
    still = np.flatnonzero(motion.resting)
    if len(still) == 0:
        return motion
    n = min(len(motion.times), max(3, int(still[0]) + int(AFTER_REST * fps)))
    rows = ("times", "xy", "velocity", "omega", "theta", "resting")
    return replace(motion, **{name: getattr(motion, name)[:n] for name in rows})


def clip_constants(c: Constants, seed: int, clip: int, clips: int) -> Constants:
    """The constants of one clip, counted from 1, of a session in which some change.

    Whether balls cling is drawn from a stream of its own, so that the shots are those of the session without.
    """
    if c.wear != 0.0:
        c = c._replace(mur=c.mur * (1.0 + c.wear * (clip - 1) / max(1, clips - 1)))
    if c.cling != 0.0 and np.random.default_rng([seed, clip, 2]).random() >= c.cling_share:
        c = c._replace(cling=0.0)
    return c


def play(
    name: str,
    rng: np.random.Generator,
    table: Table,
    c: Constants,
    seconds: float,
    fps: float,
    open_cloth: bool = False,
    step: float = STEP,
) -> Shot:
    """Draw scenes of the named kind until one shows what the kind is for, filmed for seconds [s] at fps [1/s].

    With open_cloth, kinds that need no event must have none while filmed.
    """
    kind = KINDS[name]
    times = np.arange(max(3, round(seconds * kind.longer * fps))) / fps
    for _ in range(ATTEMPTS):
        scene = kind.draw(Draw(rng, table, c))
        if not _fits(scene, table, c.radius):
            continue
        motion = film(simulate(table, c, scene.balls, times, step), fps)
        if _shows(kind, motion, open_cloth):
            return Shot(name, scene, rolled(motion, table, c, scene.balls, step))
    raise NoShot(
        f"kind {name!r}: none of {ATTEMPTS} draws did what it is for within {seconds:g} s on a table of"
        f" {table.length:g} x {table.width:g} m; film longer (--seconds), or leave the kind out"
    )
