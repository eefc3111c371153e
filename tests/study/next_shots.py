"""Clips until a hidden effect is named, by how their shots are chosen: `python -m tests.study.next_shots OUT`.

A set begins with a few usual shots. Then `discover` says what to film, and the generator plays it: all of the sequence,
its first shot alone, or, whatever it says, the generator's usual shots. A verdict is right when it names what is hidden
and nothing else; it counts from the clip after which it stays right to the end.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any, Final

import numpy as np

from models.commands.console import table, write_json
from models.model_file import full_model
from sysid.clips import read_clip_set
from sysid.selection.discover import discover
from sysid.selection.next_shot import NextShot
from sysid.selection.result import DiscoveryResult
from tests.study.plan import FIRST_SEED, PER_EFFECT, SIGMA, mix_of
from tests.truth.__main__ import jittered
from tests.truth.camera import Camera, rolled
from tests.truth.cloth import Constants
from tests.truth.effects import EFFECTS
from tests.truth.physics import Cue, Start, Table, simulate, strike
from tests.truth.shots import USUAL, Scene, Shot, film, play
from tests.truth.sizes import scaled
from tests.truth.write import write

FIRST: Final = 2  # usual shots that a set begins with
MOST: Final = 16  # clips of a set
AT_ONCE: Final = 2  # shots that are filmed before the next verdict, of a sequence and of usual ones
SECONDS: Final = 4.0
CAMERA: Final = Camera(sigma=SIGMA, missing=0.01)
POLICIES: Final = ("sequence", "single", "usual")


def played(told: NextShot, c: Constants, stage: Table) -> Shot | None:
    """A shot that was asked for, as the generator plays it; None where its balls do not fit."""
    cue = Cue(told.cue.speed, told.cue.azimuth, told.cue.side, told.cue.height)
    balls = {"cue": strike(told.place, cue, c.radius, c.squirt)}
    if told.other is not None:
        balls["red"] = Start(told.other)
    room = stage.reach(c.radius)
    if any((np.abs(ball.xy) > room).any() for ball in balls.values()):
        return None
    times = np.arange(round(SECONDS * CAMERA.fps)) / CAMERA.fps
    motion = film(simulate(stage, c, balls, times), CAMERA.fps)
    return Shot("asked for", Scene(balls, cue), rolled(motion, stage, c, balls))


def clips_needed(effect: str, seed: int, scale: float, policy: str, say: Callable[[str], None]) -> dict[str, Any]:
    """The verdicts of one set that grows, and from how many clips on it is right (None: never)."""
    c, stage = jittered(seed)._replace(**scaled(effect, scale)), Table()
    mix = mix_of([effect])
    kinds = cycle(mix.kinds if mix else USUAL)
    shots: list[Shot] = []

    def usual() -> Shot:
        rng = np.random.default_rng([seed, len(shots) + 1])
        return play(next(kinds), rng, stage, c, SECONDS, CAMERA.fps)

    while len(shots) < FIRST:
        shots.append(usual())
    verdicts: list[tuple[int, list[str]]] = []
    while True:
        found = _verdict(shots, stage, c, seed)
        verdicts.append((len(shots), [*found.verdict, *(["(other)"] if found.explained else [])]))
        say(f"{effect} {policy}: {len(shots)} clips: {', '.join(verdicts[-1][1]) or 'nothing'}")
        if len(shots) >= MOST or _is_settled(verdicts, effect):
            break
        asked = found.next_shots[: {"sequence": AT_ONCE, "single": 1, "usual": 0}[policy]]
        new = [shot for one in asked if (shot := played(one, c, stage)) is not None]
        shots += new
        while not new or (policy == "usual" and len(new) < AT_ONCE):
            new.append(usual())
            shots.append(new[-1])
    right = [count for count, names in verdicts if names == [effect]]
    last_wrong = max((count for count, names in verdicts if names != [effect]), default=0)
    stays = [count for count in right if count > last_wrong]
    return {"effect": effect, "seed": seed, "policy": policy, "needed": min(stays, default=None), "verdicts": verdicts}


def _is_settled(verdicts: Sequence[tuple[int, list[str]]], effect: str) -> bool:
    """Whether the last two verdicts are right."""
    return len(verdicts) > 1 and all(names == [effect] for _, names in verdicts[-2:])


def _verdict(shots: Sequence[Shot], stage: Table, c: Constants, seed: int) -> DiscoveryResult:
    folder = Path(tempfile.mkdtemp(prefix="next-shots-"))
    try:
        write(folder / "set", shots, stage, c, CAMERA, seed)
        clip_set = read_clip_set(folder / "set")
        return discover(clip_set, full_model(clip_set.table, clip_set.ball))
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def main(argv: Sequence[str] | None = None) -> int:
    """Play sets by each policy and print a table; results so far are in OUT."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.study.next_shots", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("out", type=Path, metavar="OUT", help="JSON file for the results")
    parser.add_argument("--effect", action="append", choices=EFFECTS, metavar="NAME", help="repeatable; otherwise all")
    parser.add_argument("--scale", type=float, default=0.25, help="of the natural size, default 0.25")
    parser.add_argument("--seeds", type=int, default=1)
    args = parser.parse_args(argv)
    results: list[dict[str, Any]] = []
    for time in range(args.seeds):
        for effect in args.effect or list(EFFECTS):
            seed = FIRST_SEED["quarter"] + PER_EFFECT * list(EFFECTS).index(effect) + PER_EFFECT - 1 - time
            for policy in POLICIES:
                results.append(clips_needed(effect, seed, args.scale, policy, lambda line: print(line, flush=True)))
                write_json(args.out, {"format": "billiard-next-shots/1", "scale": args.scale, "sets": results})
    rows: list[tuple[str, ...]] = [
        ("shots", "right in the end", "clips needed, median", "mean, of those never right as most")
    ]
    for policy in POLICIES:
        needed = [one["needed"] for one in results if one["policy"] == policy]
        counts = [n or MOST for n in needed]
        right = sum(n is not None for n in needed)
        rows.append((policy, f"{right} of {len(needed)}", f"{np.median(counts):g}", f"{np.mean(counts):.1f}"))
    print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
