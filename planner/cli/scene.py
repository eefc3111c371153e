"""`planner scene`: a scene file from a picture, a video or a clip set."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from models.commands.console import Progress, Status, table
from models.commands.options import FILE_PATH, at_most_one, effects_option, gathered, given, out_option
from models.errors import BadInput
from sysid.cli.common import accept_camera_option, camera_option, mass_option, palette_option


@dataclass(frozen=True)
class Wanted:
    """Options of the wanted shot: balls by name, positions [m]."""

    cue: str | None = given("--cue", "BALL", "Ball to strike; by default white, or cue.")
    object_ball: str = given("--object", "BALL", "Ball to pot.", required=True)
    pocket: str = given("--pocket", "P", "any, a corner (--pocket=+x-y) or a middle one (--pocket=-y).", default="any")
    rest: tuple[float, float] | None = given("--rest", "X Y", "Wanted place of the cue ball [m].", float, nargs=2)
    rest_region: tuple[float, float, float] | None = given(
        "--rest-region", "X Y R", "Circle of wanted places [m].", float, nargs=3
    )
    rest_for: str | None = given("--rest-for", "BALL", "Any place from which this ball can be potted.")
    avoid: tuple[str, ...] = given("--avoid", "BALL", "Ball not to touch; may be given more than once.", multiple=True)

    def goal(self) -> dict[str, Any]:
        """The goal as entries of a scene file."""
        at_most_one(rest=self.rest, rest_region=self.rest_region, rest_for=self.rest_for)
        rest = {"rest": self.rest and list(self.rest), "rest_region": self.rest_region and list(self.rest_region)}
        rest_for, pocket, avoid = self.rest_for, _pocket(self.pocket), list(self.avoid) or None
        return {
            "cue": self.cue,
            "object": self.object_ball,
            "pocket": pocket,
            **rest,
            "rest_for": rest_for,
            "avoid": avoid,
        }


@dataclass(frozen=True)
class SceneSource:
    """The source of the balls' positions, with options of a picture or the clip of a set."""

    source: Path = given(click.argument("source", metavar="SOURCE", type=FILE_PATH))
    camera_file: Path | None = given(camera_option())
    clip: str | None = given("--clip", "CLIP", "Of a clip set: a file or its number; by default the last.")
    palette_file: Path | None = given(palette_option)
    mass: float | None = given(mass_option)
    accept_camera: bool = given(accept_camera_option, default=False)


@click.command()
@gathered("source", SceneSource)
@gathered("wanted", Wanted)
@out_option("SCENE.toml", "File for the scene.")
@effects_option()
@click.pass_obj
def scene(progress: Progress, source: SceneSource, wanted: Wanted, out: Path) -> int:
    """Write a scene: the positions of the balls, and the wanted shot.

    SOURCE is a picture, a folder of pictures, a video (its last frame), or a clip set (the end of a clip). A picture or
    video needs --camera. Writes a scene file.

    Example: planner scene table.png --camera cam.toml --object red --pocket=+x+y --out scene.toml
    """
    from planner.from_picture import scene_from_clips, scene_from_picture
    from planner.scene import write_scene
    from sysid.clips.trust import heed_doubts

    goal, path, camera = wanted.goal(), source.source, source.camera_file
    if (path / "clips.toml").is_file():
        if camera:
            raise BadInput(f"--camera {camera}: {path} is a clip set, which has positions; omit it")
        made, found = scene_from_clips(path, goal, source.clip)
        heed_doubts(path, made.camera_doubts, source.accept_camera)
    else:
        if not camera:
            raise BadInput(f"{path}: a picture needs --camera CAM.toml (made with: sysid calibrate)")
        import cv2

        from sysid.vision import read_camera

        heed_doubts(camera, read_camera(camera).doubts, source.accept_camera)
        cv2.setNumThreads(1)  # threads only slow down small pictures
        made, found = scene_from_picture(
            path, camera, goal, palette_path=source.palette_file, mass=source.mass, progress=progress
        )
    progress.close()
    rows = [("ball", "x [m]", "y [m]")]
    rows += [(n, f"{x:.4f}", f"{y:.4f}") for n, (x, y) in zip(made.names, made.position, strict=True)]
    print(table(rows))
    for line in found.notes:
        print(line)
    write_scene(made, out)
    print(f"scene: {out}")
    return Status.DONE


def _pocket(text: str) -> list[int] | str:
    """A pocket as an entry of a scene file, from "any" or "+x-y", "-y"."""
    if text == "any":
        return text
    sides = {"+x": (1, 0), "-x": (-1, 0), "+y": (0, 1), "-y": (0, -1)}
    parts = [text[k : k + 2] for k in range(0, len(text), 2)]
    axes = [part[1:] for part in parts]
    if not all(part in sides for part in parts) or "y" not in axes or len(set(axes)) < len(axes):
        raise BadInput(f"--pocket {text}: give any, a corner such as --pocket=+x-y, or a middle one, --pocket=-y")
    return [sum(sides[part][k] for part in parts) for k in range(2)]
