"""`python -m tests.truth OUT ...`: tracked clips with known truth; `python -m tests.truth example OUT`: the example."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from tests.truth.camera import Camera
from tests.truth.cloth import Constants
from tests.truth.effects import EFFECTS, HIDDEN, STRUCTURES
from tests.truth.physics import MOST_GRIP, Table
from tests.truth.shots import KINDS, USUAL, NoShot, clip_constants, play
from tests.truth.sizes import NATURAL
from tests.truth.soil import SOILED, Soil
from tests.truth.write import Refused, write

JITTER = {"mus": 0.06, "mur": 0.06, "spin": 0.06, "ebb": 0.02, "mubb": 0.1, "ec": 0.02, "muc": 0.08}
LOWER = {"clock": 0.5, "cue_mass": 0.1, "slow_v": 1e-3, "patch": -0.99, "wear": -0.99, "cling": -1.0, "slow": -0.99}
UPPER = {"ebb": 1.0, "ec": 1.0, "muc": MOST_GRIP, "nap": 1.0, "clock": 2.0, "cue_mass": 10.0}
UPPER |= {"compliance": 10.0, "bed": 1.0, "contact": 0.006, "cling_share": 1.0, "hop": 1.0}
UPPER |= {"image_scale": 0.5, "image_aspect": 0.5}
SIGNED = {"tilt_x", "tilt_y", "nap_phi", "swerve", "ec_v", "mubb_b", "mus_v", "spin_v", "muc_v", "ebb_v", "off_centre"}
SIGNED |= {"squirt", "lens", "camera_tilt", "image_scale", "shutter", "patch_x", "patch_y", "crown", "ripple"}
SIGNED |= {"ends", "shake", "image_aspect", "ripple_phi", "slide_swerve", "cue_mus", "cue_mur", "lens4"}
SIGNED |= {f"{name}_{rail}" for name in ("ec", "muc") for rail in ("px", "mx", "py", "my")}
LOWER |= {"nose": -0.25, **{f"nose_{rail}": -0.14 for rail in ("px", "mx", "py", "my")}}  # together above the centre
UPPER |= {"nose": 0.3, **{f"nose_{rail}": 0.2 for rail in ("px", "mx", "py", "my")}}
EXAMPLE_SEED = 20141
EXAMPLE = (
    *("stun", "side", "cushion", "draw", "roll", "follow"),
    *("cushion_side", "cut", "spin", "cut", "cut_side", "swerve"),
)
EXAMPLE_HIDES = "table_tilt"


class BadInput(Exception):
    """Something on the command line is wrong."""


def pick(name: str, choices: Sequence[str], what: str) -> str:
    """The name, if it is a choice."""
    if name in choices:
        return name
    near = get_close_matches(name, choices, 1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise BadInput(f"unknown {what} {name!r}; {hint}choices: {', '.join(choices)}")


def _numbers(text: str, option: str) -> tuple[str, list[float]]:
    """NAME=VALUE[,VALUE...], taken apart."""
    name, sign, values = text.partition("=")
    try:
        numbers = [float(v) for v in values.split(",")]
    except ValueError:
        numbers = []
    if not sign or not numbers or not np.all(np.isfinite(numbers)):
        raise BadInput(f"{option} {text!r}: expected NAME=VALUE with finite numbers, e.g. {option} {name}=0.1")
    return name, numbers


def jittered(seed: int, c: Constants = Constants()) -> Constants:  # noqa: B008 (a frozen value)
    """The constants moved a few percent by the seed, so that no reader of the defaults knows them."""
    rng = np.random.default_rng([seed, 0])
    return c._replace(**{k: getattr(c, k) * (1 + spread * rng.uniform(-1, 1)) for k, spread in JITTER.items()})


def constants(args: argparse.Namespace) -> Constants:
    """The constants that the options ask for."""
    if not (0.01 <= args.diameter <= 0.2):
        raise BadInput(f"--diameter {args.diameter:g}: expected a ball of 0.01 to 0.2 m")
    if not (0 < args.mass < np.inf):
        raise BadInput(f"--mass {args.mass:g}: expected more than 0 kg")
    c = Constants(radius=args.diameter / 2, mass=args.mass)
    if not args.no_jitter:
        c = jittered(args.seed, c)
    values: dict[str, float] = {}
    for text in args.effect:
        name, numbers = _numbers(text, "--effect")
        fields = HIDDEN[pick(name, tuple(HIDDEN), "effect")]
        if len(numbers) > len(fields):
            raise BadInput(f"--effect {text!r}: takes at most {len(fields)}: {', '.join(fields)}")
        values.update(zip(fields, numbers, strict=False))
    for text in args.constant:
        name, numbers = _numbers(text, "--constant")
        pick(name, Constants._fields[2:], "constant")
        if len(numbers) != 1:
            raise BadInput(f"--constant {text!r}: takes one value")
        values[name] = numbers[0]
    for name, value in values.items():
        low, high = (-np.inf if name in SIGNED else LOWER.get(name, 0.0)), UPPER.get(name, np.inf)
        if not low <= value <= high:
            raise BadInput(f"{name}={value:g}: expected {low:g} to {high:g}")
    return c._replace(**values)


def parser() -> argparse.ArgumentParser:
    """The command line of the generator; 'example' takes OUT alone."""
    p = argparse.ArgumentParser(prog="python -m tests.truth", description="Make tracked clips with known truth.")
    p.add_argument("out", type=Path, metavar="OUT", help="folder to make; its truth goes to OUT.truth.json")
    p.add_argument("--seed", type=int, default=0)
    p.add_argument("--clips", type=int, default=30, metavar="M")
    kinds = f"repeatable: {', '.join(KINDS)}; otherwise all that need not be filmed to their end"
    p.add_argument("--kind", action="append", default=[], metavar="KIND", help=kinds)
    form = "NAME=VALUE[,VALUE]"
    p.add_argument("--effect", action="append", default=[], metavar=form, help=", ".join(EFFECTS))
    outside = f"the same, for what no catalogue names: {', '.join(STRUCTURES)}"
    p.add_argument("--hidden", action="append", dest="effect", metavar=form, help=outside)
    p.add_argument("--constant", action="append", default=[], metavar="NAME=VALUE", help="e.g. mus=0.2")
    p.add_argument("--no-jitter", action="store_true", help="keep the default constants as they are")
    p.add_argument("--open", action="store_true", help="one-ball shots that need no cushion touch none while filmed")
    p.add_argument("--marked", action="store_true", help="the struck ball's turned angle is seen in every clip")
    p.add_argument("--no-sigma", action="store_true", help="leave the noise out of clips.toml")
    p.add_argument("--no-cue", action="store_true", help="leave out what was commanded")
    p.add_argument("--no-pockets", action="store_true")
    p.add_argument("--seconds", type=float, default=4.0, help="filmed at most [s]")
    for name, value, unit in (
        ("length", Table.length, "m"),
        ("width", Table.width, "m"),
        ("diameter", 0.0525, "m"),
        ("mass", 0.1406, "kg"),
        ("fps", Camera.fps, "1/s"),
        ("sigma", Camera.sigma, "m"),
        ("missing", Camera.missing, "fraction of the frames"),
        ("outliers", Camera.outliers, "fraction of the samples, displaced by some cm"),
    ):
        p.add_argument(f"--{name}", type=float, default=value, help=f"[{unit}], default {value:g}")
    dirt = "as cameras and users are: noise that hangs together, gaps, swaps, any clock, sizes measured wrong"
    p.add_argument(
        "--soiled", action="store_true", help=f"{dirt}; with it take also --outliers, --no-cue and --no-sigma"
    )
    p.add_argument("--force", action="store_true", help="replace the clip set that is there")
    return p


def make(args: argparse.Namespace) -> Path:
    """Make the clip set that the options ask for; the path of its truth."""
    c = constants(args)
    kinds = [pick(k, tuple(KINDS), "kind") for text in args.kind or [",".join(USUAL)] for k in text.split(",")]
    for name, low, high in (
        ("seed", 0, 2**63),
        ("clips", 1, 9999),
        ("fps", 1.0, 20000.0),
        ("seconds", 3 / max(args.fps, 1.0), 600.0),
        ("length", 16 * c.radius, 100.0),
        ("width", 16 * c.radius, 100.0),
        ("sigma", 0.0, 0.1),
        ("missing", 0.0, 0.9),
        ("outliers", 0.0, 0.5),
    ):
        value = getattr(args, name)
        if not low <= value <= high:
            raise BadInput(f"--{name} {value:g}: expected {low:g} to {high:g}")
    table = Table(args.length, args.width, not args.no_pockets)
    camera = Camera(
        args.fps, args.sigma, marked=args.marked, missing=args.missing, outliers=args.outliers, told=not args.no_sigma
    )
    shots = []
    for k in range(1, args.clips + 1):
        rng = np.random.default_rng([args.seed, k])
        of_clip = clip_constants(c, args.seed, k, args.clips)
        shots.append(play(kinds[(k - 1) % len(kinds)], rng, table, of_clip, args.seconds, args.fps, args.open))
    soil = SOILED if args.soiled else Soil()
    return write(args.out, shots, table, c, camera, args.seed, not args.no_cue, args.force, soil)


def make_example(out: Path, force: bool = False) -> Path:
    """Make the example that the project ships, with its hidden effect at natural size; the path of its truth."""
    table, camera, c = Table(), Camera(marked=True), jittered(EXAMPLE_SEED)._replace(**NATURAL[EXAMPLE_HIDES])
    shots = []
    for k, kind in enumerate(EXAMPLE, 1):
        rng = np.random.default_rng([EXAMPLE_SEED, k])
        shots.append(play(kind, rng, table, c, round(rng.uniform(1.4, 2.6), 2), camera.fps, open_cloth=True))
    return write(out, shots, table, c, camera, EXAMPLE_SEED, force=force)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; 0 done, 2 bad input."""
    words = list(sys.argv[1:] if argv is None else argv)
    try:
        if words[:1] == ["example"]:
            p = argparse.ArgumentParser(prog="python -m tests.truth example", description="Make the shipped example.")
            p.add_argument("out", type=Path, metavar="OUT")
            p.add_argument("--force", action="store_true", help="replace the clip set that is there")
            args = p.parse_args(words[1:])
            truth = make_example(args.out, args.force)
        else:
            args = parser().parse_args(words)
            truth = make(args)
    except (BadInput, NoShot, Refused, OSError) as e:
        print(f"error: {e}", file=sys.stderr)
        return 2
    print(f"{args.out}: clips.toml and clips; {truth}: what they were made with")
    return 0


if __name__ == "__main__":
    sys.exit(main())
