"""An effect of impacts that the catalogue does not have: `python -m tests.study.left_out OUT`.

Each file of models/effects/impact is hidden from the search in turn, while clips show its effect. What is found in its
place, a formula or another effect, is judged by what it says of impacts: how far velocities after them are from those
of the true model, over the changes of velocity there.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from models.commands.console import table, write_json
from models.effect_catalogue import catalogue
from models.model_file import Model, full_model
from models.shot import Shot
from models.simulation.simulate import simulate
from sysid.clips import read_clip_set
from sysid.selection.discover import discover
from tests.study.judge import BASE, EFFECT_TRUTH
from tests.study.plan import FIRST_SEED, PER_EFFECT, SIGMA, mix_of
from tests.truth.__main__ import jittered
from tests.truth.__main__ import main as generate
from tests.truth.effects import EFFECTS
from tests.truth.sizes import options, scaled

Array = NDArray[np.float64]
LEFT_OUT: Final = (  # of each file one, and of noses all together and one alone
    *("ball_friction_speed", "ball_restitution_speed", "cue_ball_mass", "cushion_compliance", "cushion_contact_time"),
    *("cushion_friction_py", "cushion_friction_speed", "cushion_restitution_py", "cushion_restitution_speed"),
    *("nose_height", "nose_height_py", "soft_bed"),
)
CLIPS: Final = 20
IMPACTS: Final = 200
GAP_M: Final = 1e-3  # before an impact
AFTER_S: Final = 2e-3  # from the start to where velocities are compared; the cloth changes them by 4 mm/s meanwhile


def _of_one_file(name: str) -> set[str]:
    """All effects of the file that an effect is in."""
    place = catalogue()[name].__module__
    return {one for one, kind in catalogue().items() if kind.__module__ == place}


def true_model(plain: Model, name: str, seed: int) -> Model:
    """The generator's table with its effect, as a model."""
    truth = jittered(seed)._replace(**scaled(name))._asdict()
    values = {f"{name}.{one.key}": one.true(truth) for one in EFFECT_TRUTH[name]}
    model = plain.add(catalogue()[name]())
    return model.with_values({key: truth[constant] for key, constant in BASE.items()} | values)


def impacts(model: Model, with_ball: bool, rng: np.random.Generator) -> list[Shot]:
    """Balls just before a cushion, or before a ball that rests."""
    found, radius = list[Shot](), model.ball.radius
    room = model.table.centre_limits(model.ball)
    for _ in range(IMPACTS):
        speed, way, side = rng.uniform(0.5, 2.5), rng.uniform(-1.1, 1.1), rng.uniform(-40.0, 40.0)
        roll, rail = rng.uniform(-0.2, 1.0), rng.integers(4)
        outward = (np.array([1.0, 0.0]), np.array([-1.0, 0.0]), np.array([0.0, 1.0]), np.array([0.0, -1.0]))[rail]
        along = np.array([-outward[1], outward[0]])
        v = speed * (math.cos(way) * outward + math.sin(way) * along)
        w = np.array([-roll * v[1] / radius, roll * v[0] / radius, side])
        place = [outward * (room - GAP_M) + along * rng.uniform(0.2, 0.6)]
        names = ["cue"]
        if with_ball:
            place = [np.zeros(2), outward * (2 * radius + GAP_M)]
            names.append("red")
        velocity, spin = np.zeros((len(names), 2)), np.zeros((len(names), 3))
        velocity[0], spin[0] = v, w
        found.append(Shot(names, np.array(place), velocity, spin, np.array([0.0, GAP_M / (speed * 0.4) + AFTER_S])))
    return found


def velocities(model: Model, shots: Sequence[Shot]) -> Array:
    """After the impacts: (n, 2 balls at most, 2) [m/s]."""
    return np.array([track.velocity[-1][:, :2] for track in simulate(model, shots)])


def tried(name: str, seed: int, folder: Path) -> dict[str, Any]:
    """What is found where an effect is hidden that the search does not know."""
    mix, hidden = mix_of([name]), _of_one_file(name)
    kinds = ("--kind", ",".join(mix.kinds)) if mix else ()
    words = ("--seed", str(seed), "--clips", str(CLIPS), "--sigma", repr(SIGMA), "--missing", "0.01", "--seconds", "4")
    if generate([str(folder), *words, *kinds, *options(name)]):
        raise SystemExit(f"{name}: no clips")
    clip_set = read_clip_set(folder)
    plain = full_model(clip_set.table, clip_set.ball)
    known = {key: kind for key, kind in catalogue().items() if key not in hidden}
    with patch("sysid.selection.screening.catalogue", lambda: known):
        found = discover(clip_set, plain)
    best, base = found.explained or found.last, found.ladder[0]
    shots = impacts(plain, name.startswith("ball") or name == "cue_ball_mass", np.random.default_rng(seed))
    true = velocities(true_model(plain, name, seed), shots)
    before = np.array([shot.velocity for shot in shots])
    impulse = math.sqrt(float(np.mean((true - before) ** 2)))
    error, without = (
        math.sqrt(float(np.mean((velocities(one.model, shots) - true) ** 2))) / impulse for one in (best, base)
    )
    form = (found.unexplained or {}).get("form")
    return {
        "effect": name, "seed": seed, "verdict": [*found.verdict], "form": form, "error": error, "base": without,
        "held_out": best.held_rms / SIGMA,
    }  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    """Try each, and print a table; results so far are in OUT."""
    parser = argparse.ArgumentParser(prog="python -m tests.study.left_out", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("out", type=Path, metavar="OUT", help="JSON file for the results")
    parser.add_argument("--effect", action="append", choices=LEFT_OUT, metavar="NAME", help="repeatable; otherwise all")
    args = parser.parse_args(argv)
    rows = [("effect left out", "found", "error of impulses", "without", "held out over the noise")]
    results: list[dict[str, Any]] = []
    for name in args.effect or LEFT_OUT:
        seed = FIRST_SEED["outside"] + PER_EFFECT * (100 + list(EFFECTS).index(name))
        with tempfile.TemporaryDirectory(prefix="left-out-") as folder:
            one = tried(name, seed, Path(folder) / "set")
        results.append(one)
        what = ", ".join([*one["verdict"], *([one["form"]] if one["form"] else [])]) or "nothing"
        rows.append((name, what, f"{one['error']:.1%}", f"{one['base']:.1%}", f"{one['held_out']:.2f}"))
        print(*rows[-1], sep="; ", flush=True)
        write_json(args.out, {"format": "billiard-left-out/1", "sets": results})
    print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
