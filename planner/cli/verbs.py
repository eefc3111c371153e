"""The `planner` command: a scene from a picture or a file, a shot for it, statistics over many."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from models.console import DONE, FOUND, Progress, Run, check_outputs, run_verb, table, write_json
from models.errors import BadInput
from planner.cli import study, view
from planner.cli.common import load_execution, load_model

if TYPE_CHECKING:
    pass


def scene(args: argparse.Namespace, progress: Progress) -> int:
    """Write a scene file from a photo, a video's last frame, or the end of a tracked clip."""
    from planner.from_picture import scene_from_clips, scene_from_picture
    from planner.scene import write_scene

    check_outputs(args.out)
    rests = {"rest": args.rest, "rest_region": args.rest_region, "rest_for": args.rest_for}
    goal: dict[str, Any] = {"cue": args.cue, "object": args.object, "pocket": _pocket(args.pocket), **rests}
    goal["avoid"] = args.avoid or None
    if (Path(args.source) / "clips.toml").is_file():
        if args.camera:
            raise BadInput(f"--camera {args.camera}: {args.source} is a clip set, whose places are known; leave it out")
        made, found = scene_from_clips(args.source, goal, args.clip)
    else:
        if not args.camera:
            raise BadInput(f"{args.source}: a picture needs --camera CAM.toml (made with: sysid calibrate)")
        import cv2

        cv2.setNumThreads(1)  # pictures are small: threads only wait for each other
        made, found = scene_from_picture(
            args.source, args.camera, goal, palette_path=args.palette, mass=args.mass, progress=progress
        )
    progress.close()
    rows = [("ball", "x [m]", "y [m]")]
    rows += [(n, f"{x:.4f}", f"{y:.4f}") for n, (x, y) in zip(made.names, made.position, strict=True)]
    print(table(rows))
    for line in found.notes:
        print(line)
    write_scene(made, args.out)
    print(f"scene: {args.out}")
    return DONE


def _pocket(text: str) -> list[int] | str:
    """A pocket as the scene file has it, from "any" or "+x-y", "-y"."""
    if text == "any":
        return text
    sides = {"+x": (1, 0), "-x": (-1, 0), "+y": (0, 1), "-y": (0, -1)}
    parts = [text[k : k + 2] for k in range(0, len(text), 2)]
    axes = [part[1:] for part in parts]
    if not all(part in sides for part in parts) or "y" not in axes or len(set(axes)) < len(axes):
        raise BadInput(f"--pocket {text}: give any, a corner such as --pocket=+x-y, or a middle one, --pocket=-y")
    return [sum(sides[part][k] for part in parts) for k in range(2)]


def plan(args: argparse.Namespace, progress: Progress) -> int:
    """Plan a shot, and write it."""
    from planner.evaluation.value import UtilityWeights
    from planner.launcher.stroke import LauncherModel, with_speeds
    from planner.plan import make_plan
    from planner.scene import read_scene

    check_outputs(args.out, args.report, args.rrd, args.picture)
    if args.seed < 0:
        raise BadInput(f"--seed {args.seed}: give a number of 0 or more")
    for name, low, high in (("rest_weight", 0.0, 1.0), ("far", 1e-3, 10.0), ("foul_cost", 0.0, 100.0)):
        if not low <= getattr(args, name) <= high:
            raise BadInput(
                f"--{name.replace('_', '-')} {getattr(args, name):g}: give a number from {low:g} to {high:g}"
            )
    launcher = LauncherModel()
    if args.cue_speed:
        slow, fast = args.cue_speed
        if not launcher.last <= slow < fast <= launcher.first:
            raise BadInput(
                f"--cue-speed {slow:g} {fast:g}: give two within {launcher.last:g} to {launcher.first:g} m/s"
            )
        launcher = with_speeds(launcher, slow, fast)
    asked = read_scene(args.scene)
    model = load_model(args.model, asked)
    if args.map:
        from planner.launcher.cueing_map import read_map
        from planner.launcher.mapped import execution_of, with_map

        cueing_map = read_map(args.map)
        launcher = with_map(launcher, cueing_map, asked.ball)
    execution = execution_of(cueing_map) if args.map and not args.execution else load_execution(args.execution, model)
    began = time.monotonic()
    weights = UtilityWeights(args.rest_weight, args.far, args.foul_cost)
    made = make_plan(
        asked, model, execution, weights, method=args.method, seed=args.seed, launcher=launcher, report=progress,
    )  # fmt: skip
    progress.close()
    made["model"]["file"] = Path(args.model).name if args.model else None
    write_json(args.out, made)
    tell(made)
    print(f"plan: {args.out} ({time.monotonic() - began:.1f} s)")
    title = f"A shot for {Path(args.scene).name}"
    if args.report:
        from planner.report import write_report

        write_report(args.report, made, title)
        print(f"report: {args.report}")
    if args.picture:
        from planner.report import write_picture

        write_picture(args.picture, made)
        print(f"picture: {args.picture}")
    if args.rrd:
        from models.recording.plan import write_plan

        write_plan(args.rrd, made, title=title)
        print(f"recording: {args.rrd} (open it with: rerun {args.rrd})")
    return DONE if made["stroke"] else FOUND


def tell(made: dict[str, Any]) -> None:
    """A plan in words and figures."""
    from models.recording.plan import percent, sentence

    if not made["stroke"]:
        print(f"no shot: {made['why']}")
        return
    print(sentence(made))
    print(made["why"])
    low, high = made["launcher"]["theta_tolerance_deg"]
    print(f"yaw: {made['launcher']['theta_deg']:.2f} degrees, {low:+.2f} to {high:+.2f} costs a tenth of the pots")
    rows = [("stroke", "string", "x'0 [mm]", "y'0 [mm]", "yaw [deg]", "potted", "fouls", "rest, median [mm]")]
    for one in (made, *made["alternatives"]):
        terms, median = one["launcher"], one["rest"]["distance_median"]
        numbers = [f"{terms[name]:.{digits}f}" for name, digits in (("x0_mm", 1), ("y0_mm", 1), ("theta_deg", 2))]
        chances = [percent(one[f"{name}_probability"]) for name in ("pot", "foul")]
        rows.append(
            (one["kind"], terms["string"], *numbers, *chances, "-" if median is None else f"{1e3 * median:.0f}")
        )
    print(table(rows))


def parser() -> argparse.ArgumentParser:
    """The command line."""
    top = argparse.ArgumentParser(
        prog="planner", description="Plan shots that survive the launcher's errors and the model's."
    )
    verbs = top.add_subparsers(dest="verb", required=True)

    def verb(name: str, run: Run, text: str) -> argparse.ArgumentParser:
        one = verbs.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
        one.set_defaults(run=run)
        one.add_argument("--effects", metavar="DIR", action="append", default=[], help="folder of effects of your own")
        return one

    one = verb("scene", scene, "a scene file from a photo, a video's last frame or the end of a tracked clip")
    one.add_argument("source", metavar="SOURCE", help="picture, folder of pictures, video, or clip set")
    one.add_argument("--camera", metavar="CAM.toml", help="camera file of a picture, made with: sysid calibrate")
    one.add_argument("--clip", metavar="CLIP", help="of a clip set: its file or its number (default: the last)")
    one.add_argument("--palette", metavar="P.toml", help="names and colours of the balls (default: those of snooker)")
    one.add_argument("--mass", metavar="M", type=float, help="of a ball [kg] (default: of a snooker ball of its size)")
    one.add_argument("--cue", metavar="BALL", help="ball to strike (default: white, or cue)")
    one.add_argument("--object", metavar="BALL", required=True, help="ball to pot")
    one.add_argument("--pocket", metavar="P", default="any", help="any, a corner (--pocket=+x-y) or a middle one (=-y)")
    rest = one.add_mutually_exclusive_group()
    rest.add_argument("--rest", metavar=("X", "Y"), nargs=2, type=float, help="wanted place of the cue ball [m]")
    rest.add_argument("--rest-region", metavar=("X", "Y", "R"), nargs=3, type=float, help="a circle of such places [m]")
    rest.add_argument("--rest-for", metavar="BALL", help="anywhere that leaves a shot on this ball")
    one.add_argument("--avoid", metavar="BALL", action="append", help="ball that nothing may touch; may be given again")
    one.add_argument("--out", metavar="SCENE.toml", required=True, help="scene file to write")
    one = verb("plan", plan, "the stroke for a scene, in physical terms and in the launcher's")
    one.add_argument("scene", metavar="SCENE.toml", help="scene file")
    one.add_argument("--model", metavar="M.toml", help="fitted model (default: the base with its usual constants)")
    one.add_argument("--out", metavar="PLAN.json", required=True, help="plan file to write")
    text = "launcher's repeatability (default: the map's, or the model file's)"
    one.add_argument("--execution", metavar="E.toml", help=text)
    text = "cueing map of the launcher, made with: robot map (default: Alciatore's formulas for a regular cue)"
    one.add_argument("--map", metavar="MAP.toml", help=text)
    text = "risk: over errors of launcher and model; ga: the paper's, on the nominal model"
    one.add_argument("--method", choices=("risk", "ga"), default="risk", help=text)
    one.add_argument("--seed", metavar="N", type=int, default=0, help="of everything drawn (default: 0)")
    text = "bounds on the cue's speed [m/s] (default: 0.3 2.2)"
    one.add_argument("--cue-speed", metavar=("LOW", "HIGH"), nargs=2, type=float, help=text)
    text = "part of a pot's utility that the cue ball's place decides (default: 0.2)"
    one.add_argument("--rest-weight", metavar="W", type=float, default=0.2, help=text)
    text = "distance from the wanted place at which that part is down to 1/e [m] (default: 0.35)"
    one.add_argument("--far", metavar="D", type=float, default=0.35, help=text)
    one.add_argument("--foul-cost", metavar="C", type=float, default=0.5, help="pots that a foul costs (default: 0.5)")
    one.add_argument("--report", metavar="FILE.html", help="the plan on paper")
    one.add_argument("--picture", metavar="FILE.png", help="the table from above")
    one.add_argument("--rrd", metavar="FILE.rrd", help="the shot, the fan of outcomes and the alternatives for Rerun")
    one = verb(
        "study", study.run, "statistics over many random scenes, judged by a truth that the planner does not know"
    )
    study.add(one)
    one = verb("view", view.run, "a fitted table in MuJoCo's viewer, strokes played by a key; or pictures of one")
    view.add(one)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run a verb: 0 done, 1 a finding to act on (no shot is reasonable), 2 bad input."""
    return run_verb("planner", parser().parse_args(argv), "; files already named above are complete")
