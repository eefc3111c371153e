"""A clip set of every family of hidden causes: `python -m tests.examination FOLDER [--seed N] [--only NAME]`.

Beside each set lies NAME.truth.json: what is hidden, and the constants.
"""

from __future__ import annotations

import argparse
import json
import math
import random
from pathlib import Path

from tests.examination.families import FAMILIES, PHYSICS, PICTURES, WITH_TEMPERATURE
from tests.examination.motion import Ball, World

CLIPS, FPS, SIGMA_M, SECONDS = 30, 120.0, 0.0005, 4.0


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
    laws = {name: (lambda seen, value=value: value) for name, value in values.items()}
    for number in range(clips):
        order = number / (clips - 1)
        celsius = draw.uniform(17.0, 25.0) if family in WITH_TEMPERATURE else 20.0
        world = World(order=order, celsius=celsius, **laws)
        if family in PHYSICS:
            PHYSICS[family](world)
        balls = struck(world, draw, number % 3 < 2)
        times = [k / FPS for k in range(int(SECONDS * FPS) + 1)]  # as the clip states them
        file = f"clips/{number + 1:04d}.csv"
        rows = ["t,ball,x,y,theta"]
        tracks = list(zip(("cue", "red"), world.play(balls, [world.frame * time for time in times]), strict=False))
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
