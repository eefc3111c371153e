"""A clip set of every family of hidden causes: `python -m tests.examination FOLDER [--seed N] [--only NAME]`.

Beside each set lies NAME.truth.json: what is hidden, and the constants.
"""

from __future__ import annotations

import argparse
import json
import math
import random
from collections.abc import Callable
from pathlib import Path

from tests.examination.motion import Ball, Law, Seen, World

CLIPS, FPS, SIGMA_M, SECONDS = 30, 120.0, 0.0005, 4.0
Change = Callable[[World], None]


def _times(law: Law, factor: Law) -> Law:
    return lambda seen: law(seen) * factor(seen)


def _plus(law: Law, more: Law) -> Law:
    return lambda seen: law(seen) + more(seen)


def _heading(seen: Seen) -> float:
    return math.atan2(seen.ball[3], seen.ball[2])


def worn_lane(world: World) -> None:
    """Rolling friction 1.4 times where |y| is below 0.25 m."""
    world.roll = _times(world.roll, lambda seen: 1.4 if abs(seen.ball[1]) < 0.25 else 1.0)


def slippery_at_speed(world: World) -> None:
    """Sliding friction falls to three quarters as slip grows: 0.75 + 0.25 exp(-slip / 0.8)."""
    world.slide = _times(world.slide, lambda seen: 0.75 + 0.25 * math.exp(-seen.slip / 0.8))


def sidespin_on_rubber(world: World) -> None:
    """A cushion returns less by 0.0012 for every radian a second of sidespin."""
    world.cushion_e = _plus(world.cushion_e, lambda seen: -0.0012 * abs(seen.ball[6]))


def warm_middle(world: World) -> None:
    """The long cushions return 0.08 less beyond 0.9 m from their middle."""
    world.cushion_e = _plus(
        world.cushion_e, lambda seen: -0.08 if seen.rail[1] == "y" and abs(seen.ball[0]) > 0.9 else 0.0
    )


def chalk_gathers(world: World) -> None:
    """Friction between balls grows from clip to clip, by 0.10 in all."""
    world.ball_mu = _plus(world.ball_mu, lambda seen: 0.10 * seen.order)


def soft_ball(world: World) -> None:
    """Balls return 0.15 exp(-approach / 0.5) less: slow collisions lose most."""
    world.ball_e = _plus(world.ball_e, lambda seen: -0.15 * math.exp(-seen.approach / 0.5))


def warm_room(world: World) -> None:
    """Cushions return 0.006 more for every degree that the room is warmer, of which the clips tell."""
    world.cushion_e = _plus(world.cushion_e, lambda seen: 0.006 * (seen.celsius - 20.0))


def skewed_picture(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image is sheared: x + 0.004 y."""
    return seen[0] + 0.004 * seen[1], seen[1]


def sagging_camera(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image slides along x in the session, by 8 mm in all."""
    return seen[0] + 0.008 * order, seen[1]


def uneven_stretch(world: World) -> None:
    """Rolling friction grows along the table: times 1 + 0.12 x."""
    world.roll = _times(world.roll, lambda seen: 1.0 + 0.12 * seen.ball[0])


def two_pieces(world: World) -> None:
    """Sliding friction 1.25 times where y is above 0.1 m."""
    world.slide = _times(world.slide, lambda seen: 1.25 if seen.ball[1] > 0.1 else 1.0)


def chalky_stretch(world: World) -> None:
    """The cushion at +y has 0.10 more friction between x = -0.9 and 0.3 m."""
    world.cushion_mu = _plus(
        world.cushion_mu, lambda seen: 0.10 if seen.rail == "+y" and -0.9 < seen.ball[0] < 0.3 else 0.0
    )


def tired_rubber(world: World) -> None:
    """A cushion returns less by 0.06 for every m/s of approach beyond 1.2 m/s."""
    world.cushion_e = _plus(world.cushion_e, lambda seen: -0.06 * max(0.0, seen.approach - 1.2))


def soft_red(world: World) -> None:
    """The red ball comes back from cushions with 0.06 less restitution."""
    world.cushion_e = _plus(world.cushion_e, lambda seen: -0.06 if seen.number == 1 else 0.0)


def gripping_spin(world: World) -> None:
    """Friction of balls grows by 0.0015 for every radian a second of the striking ball's sidespin."""
    world.ball_mu = _plus(world.ball_mu, lambda seen: 0.0015 * abs(seen.ball[6]))


def bent_picture(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image is bent: x + 0.008 y^2."""
    return seen[0] + 0.008 * seen[1] ** 2, seen[1]


def slow_zoom(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image grows along x in the session, by 0.4 % in all."""
    return seen[0] * (1.0 + 0.004 * order), seen[1]


def damp_end(world: World) -> None:
    """Rolling friction is higher by 0.35 of itself for every metre beyond x = 0.6 m."""
    world.roll = _times(world.roll, lambda seen: 1.0 + 0.35 * max(0.0, seen.ball[0] - 0.6))


def brushed_one_way(world: World) -> None:
    """Sliding friction is 1 + 0.15 cos(heading) times as high: the cloth is brushed along x."""
    world.slide = _times(world.slide, lambda seen: 1.0 + 0.15 * math.cos(_heading(seen)))


def dead_end(world: World) -> None:
    """The cushion at -x returns 0.07 less where y is above 0.2 m."""
    world.cushion_e = _plus(world.cushion_e, lambda seen: -0.07 if seen.rail == "-x" and seen.ball[1] > 0.2 else 0.0)


def sticky_when_new(world: World) -> None:
    """Friction of cushions is higher by 0.08 in the first third of the session."""
    world.cushion_mu = _plus(world.cushion_mu, lambda seen: 0.08 if seen.order < 1 / 3 else 0.0)


def dust_on_balls(world: World) -> None:
    """Friction of balls is higher by 0.06 exp(-approach / 0.8)."""
    world.ball_mu = _plus(world.ball_mu, lambda seen: 0.06 * math.exp(-seen.approach / 0.8))


def chipped_balls(world: World) -> None:
    """Balls return 0.05 less beyond 1.1 m/s of approach."""
    world.ball_e = _plus(world.ball_e, lambda seen: -0.05 if seen.approach > 1.1 else 0.0)


def evening_cloth(world: World) -> None:
    """Rolling friction grows by 0.03 of itself for every degree that the room is warmer, of which the clips tell."""
    world.roll = _times(world.roll, lambda seen: 1.0 + 0.03 * (seen.celsius - 20.0))


def turning_camera(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image turns in the session, by 4 mrad in all."""
    return seen[0] - 0.004 * order * seen[1], seen[1] + 0.004 * order * seen[0]


def pressed_seam(world: World) -> None:
    """Rolling friction is 1 + 0.8 exp(-(x / 0.15)^2) times as high: something lies below the middle of the cloth."""
    world.roll = _times(world.roll, lambda seen: 1.0 + 0.8 * math.exp(-((seen.ball[0] / 0.15) ** 2)))


def damp_edges(world: World) -> None:
    """Sliding friction is 1.3 times as high within 0.25 m of a long cushion."""
    world.slide = _times(
        world.slide, lambda seen: 1.3 if world.width / 2 - world.radius - abs(seen.ball[1]) < 0.25 else 1.0
    )


def bolted_rubber(world: World) -> None:
    """Long cushions return 0.04 cos(4 x) more, x in metres: they are bolted here and there."""
    world.cushion_e = _plus(
        world.cushion_e, lambda seen: 0.04 * math.cos(4.0 * seen.ball[0]) if seen.rail[1] == "y" else 0.0
    )


def greasy_cushions(world: World) -> None:
    """Friction of cushions is lower by 0.10 exp(-slip / 0.6)."""
    world.cushion_mu = _plus(world.cushion_mu, lambda seen: -0.10 * math.exp(-seen.slip / 0.6))


def warm_balls(world: World) -> None:
    """Friction of balls falls by 0.006 for every degree that the room is warmer, of which the clips tell."""
    world.ball_mu = _plus(world.ball_mu, lambda seen: -0.006 * (seen.celsius - 20.0))


def other_balls(world: World) -> None:
    """Balls return 0.05 less after three fifths of the session: others are played with."""
    world.ball_e = _plus(world.ball_e, lambda seen: -0.05 if seen.order > 0.6 else 0.0)


def folded_picture(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image is stretched by 1 % along x beyond x = 0.5 m."""
    return seen[0] + 0.01 * max(0.0, seen[0] - 0.5), seen[1]


def bumped_camera(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image lies 3 mm farther along y in the last 45 % of the session."""
    return seen[0], seen[1] + (0.003 if order > 0.55 else 0.0)


def sticky_crawl(world: World) -> None:
    """Rolling friction is 1 + 0.30 exp(-speed / 0.25) times as high: slow balls stop early."""
    world.roll = _times(world.roll, lambda seen: 1.0 + 0.30 * math.exp(-math.hypot(seen.ball[2], seen.ball[3]) / 0.25))


def worn_centre(world: World) -> None:
    """Sliding friction is 0.85 + 0.12 r^2 times as high, r in metres from the middle of the table."""
    world.slide = _times(world.slide, lambda seen: 0.85 + 0.12 * (seen.ball[0] ** 2 + seen.ball[1] ** 2))


def warming_rail(world: World) -> None:
    """The cushion at +x returns less from clip to clip, by 0.08 in all."""
    world.cushion_e = _plus(world.cushion_e, lambda seen: -0.08 * seen.order if seen.rail == "+x" else 0.0)


def biting_rubber(world: World) -> None:
    """Friction of cushions is higher by 0.10 (1 - exp(-approach / 0.8))."""
    world.cushion_mu = _plus(world.cushion_mu, lambda seen: 0.10 * (1.0 - math.exp(-seen.approach / 0.8)))


def saturating_throw(world: World) -> None:
    """Friction of balls is higher by 0.08 slip / (slip + 0.5)."""
    world.ball_mu = _plus(world.ball_mu, lambda seen: 0.08 * seen.slip / (seen.slip + 0.5))


def clinging_touch(world: World) -> None:
    """Friction of balls is higher by 0.08 below 0.7 m/s of approach."""
    world.ball_mu = _plus(world.ball_mu, lambda seen: 0.08 if seen.approach < 0.7 else 0.0)


def drying_cloth(world: World) -> None:
    """Rolling friction is 1 - 0.12 exp(-order / 0.25) times as high: the cloth dries in the session."""
    world.roll = _times(world.roll, lambda seen: 1.0 - 0.12 * math.exp(-seen.order / 0.25))


def wavy_picture(seen: tuple[float, float], order: float) -> tuple[float, float]:
    """The image is wavy: y + 0.003 sin(3 x)."""
    return seen[0], seen[1] + 0.003 * math.sin(3.0 * seen[0])


PHYSICS: dict[str, Change] = {
    one.__name__: one
    for one in (
        *(worn_lane, slippery_at_speed, sidespin_on_rubber, warm_middle, chalk_gathers, soft_ball, warm_room),
        *(uneven_stretch, two_pieces, chalky_stretch, tired_rubber, soft_red, gripping_spin),
        *(damp_end, brushed_one_way, dead_end, sticky_when_new, dust_on_balls, chipped_balls, evening_cloth),
        *(pressed_seam, damp_edges, bolted_rubber, greasy_cushions, warm_balls, other_balls),
        *(sticky_crawl, worn_centre, warming_rail, biting_rubber, saturating_throw, clinging_touch, drying_cloth),
    )
}
PICTURES = {
    one.__name__: one
    for one in (
        *(skewed_picture, sagging_camera, bent_picture, slow_zoom, turning_camera),
        *(folded_picture, bumped_camera, wavy_picture),
    )
}
WITH_TEMPERATURE = (warm_room.__name__, evening_cloth.__name__, warm_balls.__name__)
FAMILIES = (*PHYSICS, *PICTURES, "nothing")


def struck(world: World, draw: random.Random, with_ball: bool) -> list[Ball]:
    """A struck ball, and another one on its way."""
    reach = world.radius + 0.05
    x = draw.uniform(-world.length / 2 + reach, world.length / 2 - reach)
    y = draw.uniform(-world.width / 2 + reach, world.width / 2 - reach)
    speed, heading = draw.uniform(0.8, 2.8), draw.uniform(-math.pi, math.pi)
    side, height = draw.choice((0.0, draw.uniform(-0.5, 0.5))), draw.uniform(-0.3, 0.4)
    turn = 2.5 * speed / world.radius
    balls = [[
        x, y, speed * math.cos(heading), speed * math.sin(heading),
        -turn * height * math.sin(heading), turn * height * math.cos(heading), turn * side,
    ]]  # fmt: skip
    if with_ball:
        for _ in range(200):
            far, aside = draw.uniform(0.25, 0.7), draw.uniform(-0.8, 0.8) * 2 * world.radius
            at = (x + far * math.cos(heading) - aside * math.sin(heading),
                  y + far * math.sin(heading) + aside * math.cos(heading))  # fmt: skip
            if abs(at[0]) < world.length / 2 - reach and abs(at[1]) < world.width / 2 - reach:
                balls.append([*at, 0.0, 0.0, 0.0, 0.0, 0.0])
                break
    return balls


def make(folder: Path, family: str, seed: int, clips: int = CLIPS) -> None:
    """One clip set."""
    draw = random.Random(f"{family} {seed}")
    values = {
        "slide": draw.uniform(0.17, 0.24), "roll": draw.uniform(0.0115, 0.0135), "spin": draw.uniform(18.0, 26.0),
        "cushion_e": draw.uniform(0.84, 0.92), "cushion_mu": draw.uniform(0.13, 0.19),
        "ball_e": draw.uniform(0.91, 0.95), "ball_mu": draw.uniform(0.04, 0.07),
    }  # fmt: skip
    (folder / "clips").mkdir(parents=True)
    lines = [
        'format = "billiard-clips/1"', "", "[table]", "length = 3.569", "width = 1.778", "pockets = false", "",
        "[ball]", "diameter = 0.0525", "mass = 0.1406", "", "[camera]", f"fps = {FPS:g}", f"sigma = {SIGMA_M:g}",
    ]  # fmt: skip
    laws = {name: (lambda seen, value=value: value) for name, value in values.items() if name != "spin"}
    for number in range(clips):
        order = number / (clips - 1)
        celsius = draw.uniform(17.0, 25.0) if family in WITH_TEMPERATURE else 20.0
        world = World(order=order, celsius=celsius, spin=values["spin"], **laws)
        if family in PHYSICS:
            PHYSICS[family](world)
        balls = struck(world, draw, number % 3 < 2)
        times = [k / FPS for k in range(int(SECONDS * FPS) + 1)]
        file = f"clips/{number + 1:04d}.csv"
        rows = ["t,ball,x,y,theta"]
        tracks = list(zip(("cue", "red"), world.play(balls, times), strict=False))
        for k, time in enumerate(times):
            for name, track in tracks:
                x, y = PICTURES[family](track[k], order) if family in PICTURES else track[k]
                rows.append(f"{time:.6f},{name},{x + draw.gauss(0, SIGMA_M):.6f},{y + draw.gauss(0, SIGMA_M):.6f},")
        (folder / file).write_text("\n".join(rows) + "\n", encoding="utf-8")
        lines += ["", "[[clip]]", f'file = "{file}"', 'struck = "cue"']
        lines += [f"session = {{ temperature = {celsius:.2f} }}"] if family in WITH_TEMPERATURE else []
    (folder / "clips.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    hidden = (PHYSICS | PICTURES).get(family)
    truth = {"family": family, "hidden": hidden.__doc__ if hidden else "nothing", "constants": values}
    folder.with_name(f"{folder.name}.truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    """Make the sets."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=FAMILIES)
    given = parser.parse_args()
    for family in (given.only,) if given.only else FAMILIES:
        make(given.folder / f"{family}-{given.seed}", family, given.seed)


if __name__ == "__main__":
    main()
