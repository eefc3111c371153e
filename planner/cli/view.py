"""`planner view`: a fitted table in MuJoCo's viewer, with strokes played there by keys; or pictures of a stroke.

What lies where comes from a scene, a plan, or the beginning of a clip; without any, all balls are on their spots. So
does the stroke: a plan's, or the cue's of a clip; otherwise it goes at the second ball.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from models.console import Progress
from models.errors import BadInput

if TYPE_CHECKING:
    from models.model_file import Model
    from models.shot import Array, Ball, Table
    from planner.viewer import Setup

DONE = 0
USUAL_SPEED = 2.0  # [m/s]
FASTEST = 15.0  # that a ball may be struck with [m/s]
CAMERAS = ("corner", "overhead", "baulk")
STROKE = ("speed", "azimuth", "side", "height", "elevation")


def add(one: argparse.ArgumentParser) -> None:
    """The options."""
    text = "scene file, plan file, or clip set (default: all balls of snooker on their spots)"
    one.add_argument("source", metavar="SOURCE", nargs="?", help=text)
    one.add_argument("--model", metavar="M.toml", help="fitted model (default: the base with its usual constants)")
    one.add_argument("--clip", metavar="CLIP", help="of a clip set: its file or its number (default: the first)")
    one.add_argument(
        "--speed", metavar="V", type=float, help=f"of the ball [m/s] (default: SOURCE's, or {USUAL_SPEED})"
    )
    text = "of the aim [rad] (default: SOURCE's, or at the second ball)"
    one.add_argument("--azimuth", metavar="A", type=float, help=text)
    text = "contact point, to the right as the player sees it [m] (default: SOURCE's, or 0)"
    one.add_argument("--side", metavar="B", type=float, help=text)
    one.add_argument("--height", metavar="H", type=float, help="contact point above the centre [m] (default: the same)")
    one.add_argument("--elevation", metavar="E", type=float, help="of the cue [rad] (default: the same)")
    one.add_argument("--pace", metavar="P", type=float, default=1.0, help="0.2 is five times slower (default: 1)")
    one.add_argument("--frames", metavar="N", type=int, help="no window: write so many pictures of the stroke to --out")
    one.add_argument("--out", metavar="DIR", help="folder for the pictures")
    one.add_argument("--fps", metavar="F", type=float, default=25.0, help="pictures a second (default: 25)")
    one.add_argument("--camera", choices=CAMERAS, default="corner", help="of the pictures (default: corner)")
    one.add_argument("--width", metavar="W", type=int, default=960, help="of the pictures; the height is 9/16 of it")


def run(args: argparse.Namespace, progress: Progress) -> int:
    """Open the viewer, or write pictures."""
    _check(args)
    from planner.viewer import KEYS, Session, open_viewer, require_display, write_frames

    if args.frames is None:
        require_display()
    model, setup = _setup(args)
    session = Session(model, setup)
    speed, azimuth, side, height = setup.stroke
    print(f"{setup.names[0]} at {speed:.2f} m/s, azimuth {azimuth:.4f} rad, "
          f"side {1e3 * side:+.1f} mm, height {1e3 * height:+.1f} mm")  # fmt: skip
    if args.frames is None:
        print(KEYS, flush=True)
        open_viewer(session, args.pace)
        return DONE
    progress("drawing")
    size = args.width, args.width * 9 // 16
    written = write_frames(session, Path(args.out), args.frames, args.fps, args.camera, size)
    progress.close()
    print(f"pictures: {len(written)} in {args.out}")
    return DONE


def _check(args: argparse.Namespace) -> None:
    """Refuse what nothing can be made of."""
    if (args.frames is None) != (args.out is None):
        raise BadInput("--frames and --out go together: --frames 50 --out DIR")
    bounds = {"frames": (1, 100_000), "fps": (0.1, 10_000.0), "pace": (0.001, 100.0), "width": (160, 2560)}
    bounds |= {"speed": (0.01, FASTEST), "azimuth": (-100.0, 100.0), "elevation": (0.0, 1.5)}
    for name, (low, high) in bounds.items():
        value = getattr(args, name)
        if value is not None and not low <= value <= high:
            raise BadInput(f"--{name} {value:g}: give a number from {low:g} to {high:g}")


def _setup(args: argparse.Namespace) -> tuple[Model, Setup]:
    """The model, and what is played on it."""
    from models.model_file import full_model, read_model
    from planner.viewer import Setup

    table, ball, places, known = _source(args)
    model = read_model(args.model) if args.model else full_model(table, ball)
    if args.source and (model.table, model.ball) != (table, ball):
        raise BadInput(f"{args.model}: its table and ball are not those of {args.source}; fit a model to that table")
    if not args.source and args.model:
        places = _racked(model.table, model.ball)
    names = tuple(places)
    stroke = {"speed": USUAL_SPEED, "azimuth": 0.0, "side": 0.0, "height": 0.0, "elevation": 0.0}
    if len(names) > 1:
        way = places[names[1]] - places[names[0]]
        stroke["azimuth"] = math.atan2(way[1], way[0])
    stroke |= known | {k: getattr(args, k) for k in STROKE if getattr(args, k) is not None}
    if not math.hypot(stroke["side"], stroke["height"]) < model.ball.radius:
        off = 1e3 * math.hypot(stroke["side"], stroke["height"])
        raise BadInput(
            f"--side, --height: {off:.1f} mm off the centre misses a ball of {1e3 * model.ball.radius:.1f} mm"
        )
    import numpy as np

    q = stroke["speed"], stroke["azimuth"], stroke["side"], stroke["height"]
    return model, Setup(names, np.array([places[n] for n in names]), q, stroke["elevation"])


def _racked(table: Table, ball: Ball) -> dict[str, Array]:
    """All balls on their spots, the white first, then the red at the top of the pack."""
    from models.mjcf.snooker import racked

    spots = racked(table, ball)
    return {"white": spots["white"], "red 1": spots["red 1"]} | spots


def _source(args: argparse.Namespace) -> tuple[Table, Ball, dict[str, Array], dict[str, float]]:
    """Table, ball, places by name, the ball to be struck first, and what is known of the stroke."""
    from models.mjcf.snooker import SNOOKER_BALL, SNOOKER_TABLE
    from planner.scene import read_scene, scene_from

    if args.source is None:
        return SNOOKER_TABLE, SNOOKER_BALL, _racked(SNOOKER_TABLE, SNOOKER_BALL), {}
    if (Path(args.source) / "clips.toml").is_file():
        return _clip(args)
    if args.clip:
        raise BadInput(f"--clip {args.clip}: {args.source} is no clip set; leave it out")
    known: dict[str, float] = {}
    if args.source.endswith(".json"):
        from planner.plan import read_plan

        plan = read_plan(args.source)
        scene = scene_from(plan.get("scene"), args.source)
        if plan.get("stroke") is None:
            raise BadInput(f"{args.source}: holds no stroke; name its scene file, and give --speed and --azimuth")
        known = {k: float(plan["stroke"][k]) for k in STROKE}
    else:
        scene = read_scene(args.source)
    return scene.table, scene.ball, dict(zip(scene.names, scene.position, strict=True)), known


def _clip(args: argparse.Namespace) -> tuple[Table, Ball, dict[str, Array], dict[str, float]]:
    """The beginning of a clip, and its cue's stroke where it is known."""
    from sysid.clips import read_clip_set

    clips = read_clip_set(args.source)
    wanted = args.clip or "1"
    found = [c for k, c in enumerate(clips.clips, 1) if wanted in (c.file, Path(c.file).stem, str(k))]
    if not found:
        raise BadInput(
            f"--clip {wanted}: {args.source} has {len(clips.clips)} clips; name one of its files or 1 to that"
        )
    clip = found[0]
    names = (clip.struck, *[n for n in clip.balls if n != clip.struck])
    places = {name: clip.balls[name].xy[0] for name in names}
    known = {k: float(getattr(clip.cue, k)) for k in STROKE} if clip.cue is not None else {}
    return clips.table, clips.ball, places, known
