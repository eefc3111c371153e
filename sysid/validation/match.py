"""MuJoCo against the analytic spin models and against published measurements, row by row.

Two models with the same constants: the native MJCF, as well tuned as its terms allow (mjcf/native.py), and MJCF with
effects. Each plays the same shots as the analytic models, in closed form (models/analytic) and from event to event
(models/engine); impacts of the effects are measured through MuJoCo's contacts, and by the impulse that isolated impacts
take. The constants are those of the snooker table of Mathavan, Jackson and Parkin (2009, 2010, 2014). At last every
effect of the catalogue, at its usual size: MuJoCo against the event engine, which both call the same hooks.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from models.analytic import cloth
from models.engine.play import lacking, play
from models.mjcf import stroke
from models.mjcf.launcher import build_scene, strike_all
from models.mjcf.snooker import SNOOKER_BALL, SNOOKER_TABLE
from models.model_file import Model, catalogue, full_model
from models.shot import Array, Ball, Shot, Table, Track
from models.simulation.observe import observed
from models.simulation.simulate import simulate
from sysid.validation.published import CUSHION_2009, CUSHION_2010, OBLIQUE_2009

BALL = Ball(0.0525, 0.1406)
OPEN = Table(60.0, 60.0, pockets=False)
TABLE = Table(2.959, 1.473, pockets=False)
WIDE = dataclasses.replace(SNOOKER_TABLE, pockets=False)
SLIDE, ROLL, SPIN = 0.212, 0.0127, 22.0
CONSTANTS = {
    "decoupled_cloth.slide": SLIDE, "decoupled_cloth.roll": ROLL, "decoupled_cloth.spin": SPIN,
    "ball_impact.restitution": 0.89, "ball_impact.friction": 0.05,
    "cushion_impact.restitution": 0.98, "cushion_impact.friction": 0.14,
}  # fmt: skip
ANALYTIC = full_model(TABLE, BALL).with_values(CONSTANTS)
SETTLED = {"native": 3e-3, "effects": 6e-4, "impulse": 1e-5}  # after the touch, when the contact is over [s]
LEAD = 1e-4  # before the touch [s]
SEED = 3


@dataclass(frozen=True)
class Row:
    """One figure: how far a model is from what it is held against."""

    case: str
    model: str  # "native" or "effects"
    error: float
    unit: str
    reach: float | None = None
    analytic: float | None = None  # the analytic model's own figure, where it has one

    @property
    def ok(self) -> bool:
        """Whether the figure is reached; True where there is none."""
        return self.reach is None or self.error <= self.reach


@dataclass(frozen=True)
class Player:
    """A model of the table and the way it plays."""

    name: str
    model: Model
    contacts: str = "clusters"

    def __call__(self, table: Table, shots: Sequence[Shot]) -> list[Track]:
        """The tracks of shots."""
        return simulate(dataclasses.replace(self.model, table=table), shots, contacts=self.contacts)


def in_mujoco(model: Model) -> Model:
    """The model played in MuJoCo."""
    return dataclasses.replace(model, engine="mujoco")


def players() -> tuple[Player, Player]:
    """Native MJCF, and MJCF with effects whose every impact goes through MuJoCo's contacts."""
    return Player("native", in_mujoco(Model(TABLE, BALL))), Player("effects", in_mujoco(ANALYTIC), "always")


def random_states(count: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(SEED)
    heading, speed = rng.uniform(-np.pi, np.pi, count), rng.uniform(0.2, 3.0, count)
    velocity = speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    return velocity, rng.normal(0, 1, (count, 3)) * np.minimum(speed[:, None], 2.0) / BALL.radius


def motion(player: Player, count: int = 500) -> list[Row]:
    """Open cloth, 3 s, random speeds and spins: position all the way, and sidespin while there is some."""
    velocity, spin = random_states(count)
    times = np.linspace(0, 3, 61)
    still = np.zeros((1, 2))
    tracks = player(
        OPEN, [Shot(("white",), still, v[None], w[None], times) for v, w in zip(velocity, spin, strict=True)]
    )
    xy, _, turning = cloth.state_at(
        times, np.zeros((count, 1, 2)), velocity[:, None], spin[:, None], BALL.radius, SLIDE, ROLL, SPIN
    )  # fmt: skip
    away = np.array([np.linalg.norm(t.position[:, 0] - p, axis=-1).max() for t, p in zip(tracks, xy, strict=True)])
    side = np.array([np.abs(t.spin[:, 0, 2] - w[:, 2]).max() for t, w in zip(tracks, turning, strict=True)])
    effects = player.name == "effects"
    name = f"cloth, {count} random states, 3 s"
    return [
        Row(f"{name}: position, worst", player.name, 1e3 * away.max(), "mm", 0.02 if effects else None),
        Row(f"{name}: position, median", player.name, 1e3 * float(np.median(away)), "mm"),
        Row(f"{name}: sidespin, worst", player.name, 100 * float(np.max(side / np.abs(spin[:, 2]))), "%",
            0.1 if effects else None),
    ]  # fmt: skip


GOLDEN_BALL = (  # angle to the line of centres [degrees], R w_roll and R w_z over speed
    (0, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (30, 0, 0), (30, 1, 0), (30, -0.5, 0), (30, 0, 0.75), (30, 0, -0.75),
    (30, 1, 0.5), (60, 1, 0),
)  # fmt: skip
GOLDEN_CUSHION = (  # angle to the cushion [degrees], R w_top and R w_side over speed
    (30, 1, 0), (30, 0, 0), (30, 1, 1), (30, 1, -1), (45, 1, 0), (45, 0, 0), (45, 1, 1), (45, 1, -1), (45, 2, 0),
    (60, 1, 0), (60, 0, 0), (60, 1, 1), (90, 1, 0), (90, 1, 1),
)  # fmt: skip


def impact_shot(kind: str, speed: float, angle: float, top: float, side: float, after: float) -> Shot:
    """A ball LEAD before it touches, at an angle to the normal [rad], spin over speed; sampled `after` the touch."""
    way = np.array([np.cos(angle), np.sin(angle)])
    spin = np.array([-top * way[1], top * way[0], side]) * speed / BALL.radius
    start = -LEAD * speed * way
    times = np.array([0.0, LEAD + after])
    if kind == "cushion":
        start = start + np.array([float(TABLE.centre_limits(BALL)[0]), 0.0])
        return Shot(("white",), start[None], speed * way[None], spin[None], times)
    places = np.array([start - [BALL.diameter, 0.0], [0.0, 0.0]])
    return Shot(
        ("white", "red"), places, np.array([speed * way, [0, 0]]), np.array([spin, np.zeros(3)]), times
    )  # fmt: skip


def impact_states(kind: str, count: int = 500) -> tuple[Array, Array]:
    """Golden rows and random impacts: (n, 4) of speed [m/s], angle to the normal [rad], top and side over speed."""
    rng = np.random.default_rng(SEED)
    golden = np.array(GOLDEN_BALL if kind == "ball" else GOLDEN_CUSHION, float)
    angle = np.radians(golden[:, 0] if kind == "ball" else 90 - golden[:, 0])
    # The cushion's table has it along x, ahead of the ball; here it lies across, so angles turn the other way.
    fixed = np.column_stack([np.ones(len(golden)), angle if kind == "ball" else -angle, golden[:, 1:]])
    some = np.column_stack(
        [rng.uniform(0.5, 3, count), np.radians(rng.uniform(-70, 70, count)), rng.uniform(-1.5, 1.5, count),
         rng.normal(0, 1, count)]
    )  # fmt: skip
    return fixed, some


def impacts(player: Player, kind: str, count: int = 500) -> list[Row]:
    """Velocity and R omega after an impact over the speed before it, against the impulse models."""
    after = SETTLED["impulse" if player.contacts == "clusters" and player.name == "effects" else player.name]
    found = []
    label = {"ball": "ball-ball", "cushion": "cushion"}[kind]
    # By impulse both sides are the same code: what is left is the landing on the touch, and no figure to reach.
    reach = (0.5, 1.0) if player.name == "effects" and player.contacts == "always" else (None, None)
    way = ", impulse" if player.name == "effects" and player.contacts == "clusters" else ""
    for name, states in zip(("golden", f"{count} random"), impact_states(kind, count), strict=True):
        shots = [impact_shot(kind, v, angle, top, side, after) for v, angle, top, side in states]
        ours, theirs = player(TABLE, shots), play(ANALYTIC, shots)
        v = np.array([np.abs(a.velocity[-1] - b.velocity[-1]).max() for a, b in zip(ours, theirs, strict=True)])
        w = np.array([np.abs(a.spin[-1] - b.spin[-1]).max() for a, b in zip(ours, theirs, strict=True)])
        for what, error in (("velocity", v / states[:, 0]), ("R omega", BALL.radius * w / states[:, 0])):
            case = f"{label}{way}, {name}: {what}"
            found.append(Row(f"{case}, median", player.name, 100 * float(np.median(error)), "%", reach[0]))
            found.append(Row(f"{case}, worst", player.name, 100 * float(error.max()), "%", reach[1]))
    return found


def random_shots(count: int = 200, most: int = 4) -> tuple[list[Shot], list[Track]]:
    """Shots of one to three balls with one to `most` impacts, sampled at the rest of the struck ball; their tracks."""
    rng = np.random.default_rng(SEED)
    shots: list[Shot] = []
    half = TABLE.centre_limits(BALL) - 0.1
    while len(shots) < count:
        n = int(rng.integers(1, 4))
        places = rng.uniform(-half, half, (n, 2))
        gaps = np.linalg.norm(places[:, None] - places, axis=-1) + np.eye(n)
        if gaps.min() < 0.2:
            continue
        to = places[1] - places[0] if n > 1 else rng.normal(size=2)
        off = 0.6 * BALL.diameter / np.linalg.norm(to) if n > 1 else 0.0
        heading = np.arctan2(to[1], to[0]) + rng.uniform(-1, 1) * off
        way, speed = np.array([np.cos(heading), np.sin(heading)]), rng.uniform(0.5, 2.0)
        velocity, spin = np.zeros((n, 2)), np.zeros((n, 3))
        velocity[0] = speed * way
        top, side = rng.uniform(-1, 1), rng.normal(0, 0.5)
        spin[0] = np.array([-top * way[1], top * way[0], side]) * speed / BALL.radius
        names = ("white", "red", "black")[:n]
        times = np.arange(0, 40, 0.05)
        shot = Shot(names, places, velocity, spin, times)
        track = play(ANALYTIC, [shot])[0]
        rest = int(np.argmax(~np.any(track.velocity[:, 0], axis=-1)))
        if 1 <= len(track.events) <= most and rest > 0:
            shots.append(dataclasses.replace(shot, times=times[[0, rest]]))
    return shots, play(ANALYTIC, shots)


def _ends(tracks: Sequence[Track]) -> list[Array]:
    return [t.position[-1] for t in tracks]


def _apart(one: Sequence[Array], other: Sequence[Array]) -> Array:
    return np.array([np.linalg.norm(a - b, axis=-1).max() for a, b in zip(one, other, strict=True)])


def whole_shots(player: Player, count: int = 200, moved: float = 1e-6) -> list[Row]:
    """All balls' positions at the moment at which the analytic struck ball stops.

    Chaos, as the analytic figure: the same of the analytic model with every ball's place moved by a micrometre.
    """
    shots, tracks = random_shots(count)
    rng = np.random.default_rng(SEED)
    other = [
        dataclasses.replace(s, position=s.position + moved * rng.choice([-1.0, 1.0], s.position.shape)) for s in shots
    ]
    away = 1e3 * _apart(_ends(player(TABLE, shots)), _ends(tracks))
    chaos = 1e3 * _apart(_ends(play(ANALYTIC, other)), _ends(tracks))
    way = ", impulse" if player.name == "effects" and player.contacts == "clusters" else ""
    name, reach = f"whole shots{way}, {count}, 1 to 4 impacts", 5.0 if player.contacts == "always" else None
    return [
        Row(f"{name}: median", player.name, float(np.median(away)), "mm", reach, float(np.median(chaos))),
        Row(f"{name}: 9 in 10", player.name, float(np.quantile(away, 0.9)), "mm", None, float(np.quantile(chaos, 0.9))),
        Row(f"{name}: worst", player.name, float(away.max()), "mm", None, float(chaos.max())),
    ]


def roughness(player: Player, count: int = 200) -> list[Row]:
    """Largest second difference of end points over a sweep of sliding friction 0.2 % wide: a ball, then cushions."""
    way = np.array([np.cos(0.42), np.sin(0.42)])
    velocity, spin = np.array([1.8 * way, [0, 0]]), np.array([[5.0, 20.0, 25.0], [0, 0, 0]])
    places = np.array([[-0.6, -0.3], [-0.6, -0.3] + 0.5 * way + 0.02 * np.array([-way[1], way[0]])])
    shot = Shot(("white", "red"), places, velocity, spin, np.array([0.0, 20.0]))
    slides = np.linspace(0.999, 1.001, count)
    name = "native.slide" if player.name == "native" else "decoupled_cloth.slide"
    model = player.model.with_values({name: player.model.parameters()[name] * slides})
    ends = np.array(_ends(simulate(model, [shot] * count, contacts=player.contacts)))
    rough = np.abs(np.diff(ends, 2, axis=0)).max()
    reach = 1.0 if player.name == "effects" else None
    note = ", impulse" if player.name == "effects" and player.contacts == "clusters" else ""
    return [Row(f"roughness of end points over friction{note}", player.name, 1e6 * float(rough), "um", reach)]


def rebounds(player: Player | None, pairs: Sequence[tuple[float, float]]) -> Array:
    """Rebound speeds of a rolling ball straight at a cushion: (n,) [m/s]; without a player, by the analytic model."""
    after = SETTLED[player.name if player else "impulse"]
    shots = [impact_shot("cushion", v, 0.0, 1.0, 0.0, after) for v, _ in pairs]
    tracks = player(TABLE, shots) if player else play(ANALYTIC, shots)
    return np.array([-t.velocity[-1, 0, 0] for t in tracks])


def obliques(player: Player | None) -> Array:
    """Speeds of both balls once they roll, and deflection of the cue ball, at the published cuts: (n, 3) [m/s, deg]."""
    after = SETTLED[player.name if player else "impulse"]
    shots = [impact_shot("ball", v, np.radians(cut), 1.0, 0.0, after) for v, cut, *_ in OBLIQUE_2009]
    tracks = player(TABLE, shots) if player else play(ANALYTIC, shots)
    rolling = np.array([cloth.rolling_velocity(t.velocity[-1], t.spin[-1], BALL.radius) for t in tracks])
    speed = np.linalg.norm(rolling, axis=-1)
    into = np.array([np.radians(cut) for _, cut, *_ in OBLIQUE_2009])
    deflection = np.degrees(np.arctan2(rolling[:, 0, 1], rolling[:, 0, 0]) - into)
    return np.column_stack([speed, deflection])


def published(player: Player) -> list[Row]:
    """Against measurements: rms misses of rebound speeds, of speeds after oblique collisions and of deflections."""
    found = []
    for title, pairs in (("2010, 19", CUSHION_2010), ("2009, 8", CUSHION_2009)):
        for part, top in (("all", 9.0), ("below 2.5 m/s", 2.5)):
            few = [p for p in pairs if p[0] < top]
            miss = [rebounds(who, few) - np.array(few)[:, 1] for who in (player, None)]
            rms = [float(np.sqrt(np.mean(m**2))) for m in miss]
            found.append(Row(f"rebounds of Mathavan {title}, {part}", player.name, rms[0], "m/s", None, rms[1]))
    measured = np.array(OBLIQUE_2009)[:, 2:]
    miss = [obliques(who) - measured for who in (player, None)]
    speeds = [100 * float(np.sqrt(np.mean((m[:, :2] / measured[:, :2]) ** 2))) for m in miss]
    angles = [float(np.sqrt(np.mean(m[:, 2] ** 2))) for m in miss]
    name = "oblique collisions of Mathavan 2009"
    return [
        *found,
        Row(f"{name}, 10 speeds", player.name, speeds[0], "%", None, speeds[1]),
        Row(f"{name}, 5 deflections", player.name, angles[0], "deg", None, angles[1]),
    ]


def cueing(player: Player, few: bool = False) -> list[Row]:
    """The launcher's strokes in MuJoCo against the cueing model: rms over the grid of speeds and offsets.

    Native: the ball on the slate of the MJCF; effects: on one that only carries it, as the effects' cloth does.
    """
    scene = build_scene(
        SNOOKER_TABLE, SNOOKER_BALL, ("white",), stroke.CUE_BALL_SPOT, 0.0, slate=player.name == "native"
    )
    shots = stroke.SMALL_GRID if few else stroke.PAPER_GRID
    wrong = stroke.errors(scene, shots, strike_all(scene, shots))
    on = "native on the slate, effects afloat"
    parts = (("ball speed", "%"), ("R omega over speed", "%"), ("squirt", "deg"))
    return [
        Row(f"cueing, {len(shots)} strokes, {on}: {what}, rms", player.name, float(rms), unit)
        for (what, unit), rms in zip(parts, np.sqrt(np.mean(wrong**2, axis=0)), strict=True)
    ]


def two_ball_shots(count: int) -> list[Shot]:
    """Shots of 0.5 to 3.5 m/s with spin, most of them at another ball, over 4 s on a snooker table without pockets."""
    rng = np.random.default_rng(SEED)
    shots: list[Shot] = []
    half = WIDE.centre_limits(BALL) - 0.05
    while len(shots) < count:
        places = rng.uniform(-half, half, (2, 2))
        to = places[1] - places[0]
        if np.hypot(*to) < 0.1:
            continue
        heading = np.arctan2(to[1], to[0]) + rng.normal(0, 0.03) if rng.random() < 0.7 else rng.uniform(-np.pi, np.pi)
        speed, velocity, spin = rng.uniform(0.5, 3.5), np.zeros((2, 2)), np.zeros((2, 3))
        velocity[0] = speed * np.array([np.cos(heading), np.sin(heading)])
        spin[0] = rng.normal(0, 0.5, 3) * speed / BALL.radius
        times = np.linspace(0, 4, 241)
        shots.append(Shot(("white", "red"), places, velocity, spin, times, order=float(rng.random())))
    return shots


def effects_of(names: Sequence[str] | None = None) -> list[str]:
    """The catalogue's effects beyond the base, or those named, that the event engine plays; "" stands for none."""
    base = full_model(WIDE, BALL)
    found = [n for n in names or catalogue() if n not in {e.name() for e in base.effects}]
    return ["", *(n for n in found if not lacking(base.add(catalogue()[n]())))]


def effect(name: str, count: int = 40) -> list[Row]:
    """An effect at its usual size, or with "" the base: how far the camera sees balls in MuJoCo from the engine's."""
    model, shots = full_model(WIDE, BALL), two_ball_shots(count)
    if name:
        model = model.add(catalogue()[name]())
    early, whole = np.zeros(count), np.zeros(count)
    for k, (a, b) in enumerate(zip(observed(in_mujoco(model), shots), observed(model, shots), strict=True)):
        away = np.linalg.norm(a.position - b.position, axis=-1).max(axis=1)
        second = min((t.events[1].time for t in (a, b) if len(t.events) > 1), default=np.inf)
        early[k], whole[k] = away[a.times < second].max(), away.max()
    case = f"effect {name or 'none'}, {count} shots of two balls"
    return [
        Row(f"{case}: before the second impact, worst", "effects", 1e3 * float(early.max()), "mm", 0.01),
        Row(f"{case}: median", "effects", 1e3 * float(np.median(whole)), "mm", 0.05),
    ]


def rows(count: int = 500, shots: int = 200, few: bool = False) -> Iterator[Row]:
    """Every row, as it is measured: `count` states and impacts, `shots` whole shots; `few` strokes of the launcher."""
    native, effects = players()
    alone = dataclasses.replace(effects, contacts="clusters")
    parts: list[Callable[[], list[Row]]] = []
    for p in (native, effects):
        parts.append(partial(motion, p, count))
        parts += [partial(impacts, p, kind, count) for kind in ("ball", "cushion")]
        parts += [partial(cueing, p, few), partial(whole_shots, p, shots), partial(roughness, p)]
        parts.append(partial(published, p))
    parts += [partial(impacts, alone, kind, count) for kind in ("ball", "cushion")]
    parts += [partial(whole_shots, alone, shots), partial(roughness, alone)]
    parts += [partial(effect, name, min(shots, 40)) for name in effects_of()]
    for part in parts:
        yield from part()


def line(row: Row) -> str:
    """A row as text."""
    reach = "" if row.reach is None else f"  reach {row.reach:g} {row.unit}{'' if row.ok else ': MISSED'}"
    analytic = "" if row.analytic is None else f"  (analytic {row.analytic:.3g})"
    return f"{row.case:79} {row.model:8} {row.error:9.3g} {row.unit:3}{analytic}{reach}"


def to_json(row: Row) -> dict[str, object]:
    """A row as its file has it."""
    return {**dataclasses.asdict(row), "ok": row.ok}
