"""`planner view`: a fitted table in MuJoCo's viewer, with strokes played there by keys; or pictures of a stroke.

The balls' positions are those of a scene, a plan, or the beginning of a clip; without any, all balls are on their
spots. The stroke is a plan's, or the cue's of a clip; otherwise it is aimed at the second ball.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from models.commands.console import Progress, Status
from models.commands.options import ANY_NUMBER, FILE_PATH, Number, effects_option, gathered, given, out_folder_option
from models.errors import BadInput
from planner.cli.common import model_option

if TYPE_CHECKING:
    from models.model_file import Model
    from models.shot import Array, Ball, Table
    from planner.viewer import Setup

DEFAULT_SPEED_M_S = 2.0  # default speed of the ball
MAX_SPEED_M_S = 15.0  # largest speed of the ball
CAMERA_NAMES = ("corner", "overhead", "baulk")


@dataclass(frozen=True)
class Shown:
    """Options of the view: a scene, plan or clip, and the model that plays it."""

    source: Path | None = given(click.argument("source", metavar="[SOURCE]", type=FILE_PATH, required=False))
    clip: str | None = given("--clip", "CLIP", "Of a clip set: a file or its number; by default the first.")
    model_file: Path | None = given(model_option)


@dataclass(frozen=True)
class GivenStroke:
    """Options of the stroke: speed of the ball [m/s], angles [rad], contact point [m]."""

    speed: float | None = given(
        "--speed",
        "V",
        f"Speed of the ball [m/s]; by default SOURCE's, or {DEFAULT_SPEED_M_S}.",
        Number(0.01, MAX_SPEED_M_S),
    )
    azimuth: float | None = given(
        "--azimuth", "A", "Direction of the aim [rad]; by default SOURCE's, or at the second ball.", Number(-100, 100)
    )
    side: float | None = given("--side", "B", "Contact point to the player's right [m].", ANY_NUMBER)
    height: float | None = given("--height", "H", "Contact point above the centre [m].", ANY_NUMBER)
    elevation: float | None = given("--elevation", "E", "Elevation of the cue [rad].", Number(0, 1.5))


@dataclass(frozen=True)
class PictureOptions:
    """Options of pictures instead of the viewer."""

    frames: int | None = given("--frames", "N", "Write N pictures into --out instead.", Number(1, 100_000, whole=True))
    out: Path | None = given(out_folder_option("Folder for the pictures.", "*.png", required=False))
    fps: float = given("--fps", "F", "Pictures per second.", Number(0.1, 10_000), 25.0)
    camera: str = given("--camera", "", "Viewpoint.", click.Choice(CAMERA_NAMES), "corner")
    width: int = given(
        "--width", "W", "Width of the pictures; the height is 9/16 of it.", Number(160, 2560, whole=True), 960
    )


@click.command()
@gathered("shown", Shown)
@gathered("stroke", GivenStroke)
@click.option(
    "--pace",
    metavar="P",
    type=Number(0.001, 100),
    default=1.0,
    show_default=True,
    help="Pace of playback; 0.2 is five times slower.",
)
@gathered("pictures", PictureOptions)
@effects_option()
@click.pass_obj
def view(progress: Progress, shown: Shown, stroke: GivenStroke, pace: float, pictures: PictureOptions) -> int:
    """View a table in MuJoCo's viewer, and play strokes there by keys.

    SOURCE is a scene file, a plan file or a clip set; without it all balls of snooker are on their spots. With --frames
    and --out it writes pictures of the stroke instead, and opens no window.

    Example: planner view plan.json --model fitted.toml
    """
    if (pictures.frames is None) != (pictures.out is None):
        raise BadInput("--frames and --out go together: --frames 50 --out DIR")
    from planner.viewer import KEYS_TEXT, ViewedWorld, open_viewer, require_display, write_frames

    if pictures.out is None:
        require_display()
    model, made = setup(shown, stroke)
    session = ViewedWorld(model, made)
    speed, azimuth, side, height = made.stroke
    print(f"{made.names[0]} at {speed:.2f} m/s, azimuth {azimuth:.4f} rad, "
          f"side {1e3 * side:+.1f} mm, height {1e3 * height:+.1f} mm")  # fmt: skip
    if pictures.out is None or pictures.frames is None:
        print(KEYS_TEXT, flush=True)
        open_viewer(session, pace)
        return Status.DONE
    progress("drawing")
    size = pictures.width, pictures.width * 9 // 16
    written = write_frames(session, pictures.out, pictures.frames, pictures.fps, pictures.camera, size)
    progress.close()
    print(f"pictures: {len(written)} in {pictures.out}")
    return Status.DONE


def setup(shown: Shown, given: GivenStroke) -> tuple[Model, Setup]:
    """The model, and balls and stroke to play on it."""
    import numpy as np

    from models.model_file import full_model, read_model
    from planner.viewer import Setup

    table, ball, places, known = _source(shown)
    model = read_model(shown.model_file) if shown.model_file else full_model(table, ball)
    if shown.source and (model.table, model.ball) != (table, ball):
        raise BadInput(
            f"{shown.model_file}: its table and ball differ from those of {shown.source}; fit a model to that table"
        )
    if not shown.source and shown.model_file:
        places = _racked(model.table, model.ball)
    names = tuple(places)
    stroke = {"speed": DEFAULT_SPEED_M_S, "azimuth": 0.0, "side": 0.0, "height": 0.0, "elevation": 0.0}
    if len(names) > 1:
        line = places[names[1]] - places[names[0]]
        stroke["azimuth"] = math.atan2(line[1], line[0])
    asked = {k: value for k, value in asdict(given).items() if value is not None}
    stroke |= known | asked
    offset = math.hypot(stroke["side"], stroke["height"])
    if not offset < model.ball.radius:
        raise BadInput(
            f"--side, --height: {1e3 * offset:.1f} mm off the centre misses a ball of {1e3 * model.ball.radius:.1f} mm"
        )
    q = stroke["speed"], stroke["azimuth"], stroke["side"], stroke["height"]
    swerve = stroke["side"] * math.sin(stroke["elevation"])
    if not asked.keys() & {"side", "height", "elevation"}:
        swerve = stroke.get("swerve", swerve)
    return model, Setup(names, np.array([places[n] for n in names]), q, swerve)


def _racked(table: Table, ball: Ball) -> dict[str, Array]:
    """All balls on their spots, the white first, then the red at the top of the pack."""
    from models.table.snooker import racked

    spots = racked(table, ball)
    return {"white": spots["white"], "red 1": spots["red 1"]} | spots


def _source(shown: Shown) -> tuple[Table, Ball, dict[str, Array], dict[str, float]]:
    """Table, ball, positions by name (the ball to be struck first), and known parts of the stroke."""
    from models.files import entries_of
    from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE
    from planner.scene import read_scene, scene_from
    from sysid.clips.trust import tell_doubts

    source = shown.source
    if source is None:
        return SNOOKER_TABLE, SNOOKER_BALL, _racked(SNOOKER_TABLE, SNOOKER_BALL), {}
    if (source / "clips.toml").is_file():
        return _clip(source, shown.clip or "1")
    if shown.clip:
        raise BadInput(f"--clip {shown.clip}: {source} is not a clip set; omit it")
    known: dict[str, float] = {}
    if source.suffix == ".json":
        from planner.planning import read_plan

        plan = read_plan(source)
        scene = scene_from(plan.get("scene"), str(source))
        if plan.get("stroke") is None:
            raise BadInput(f"{source}: holds no stroke; name its scene file, and give --speed and --azimuth")
        with entries_of(source, "make it again with: planner plan"):
            known = {k: float(plan["stroke"][k]) for k in GivenStroke.__annotations__}
            if "swerve" in plan.get("launcher", {}):
                known["swerve"] = float(plan["launcher"]["swerve"])
    else:
        scene = read_scene(source)
    tell_doubts(source, scene.camera_doubts)
    return scene.table, scene.ball, dict(zip(scene.names, scene.position, strict=True)), known


def _clip(source: Path, wanted: str) -> tuple[Table, Ball, dict[str, Array], dict[str, float]]:
    """The beginning of a clip, and its cue's stroke if known."""
    from sysid.clips import read_clip_set
    from sysid.clips.choose import chosen_clip
    from sysid.clips.trust import camera_doubts, tell_doubts

    clips = read_clip_set(source)
    tell_doubts(source, camera_doubts(clips))
    clip = chosen_clip(clips, wanted, source)
    if clip.running:
        raise BadInput(f"--clip {wanted}: begins in mid-motion, without a stroke to play; name another clip")
    names = (clip.struck, *[n for n in clip.balls if n != clip.struck])
    places = {name: clip.balls[name].xy[0] for name in names}
    known = {k: float(getattr(clip.cue, k)) for k in GivenStroke.__annotations__} if clip.cue is not None else {}
    return clips.table, clips.ball, places, known
