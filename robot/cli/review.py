"""`robot review`: a series of shots, or a campaign of strokes, in the Rerun viewer."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from models.commands.console import Progress
from models.commands.options import FILE_PATH, gathered, input_option
from models.errors import BadInput
from sysid.cli.review import film_said, video_option
from sysid.cli.viewing import Viewing

if TYPE_CHECKING:
    from models.recording.film import Film


@click.command()
@click.argument("played", metavar="DIR|SHOTS.csv", type=FILE_PATH)
@input_option("map", "MAP.toml", "Cueing map to compare a campaign with; by default a regular cue's.")
@video_option
@gathered("viewing", Viewing)
@click.pass_obj
def review(progress: Progress, played: Path, map_file: Path | None, video: Path | None, viewing: Viewing) -> int:
    """Review played shots in the Rerun viewer: planned and played shots, predicted and measured strokes.

    DIR is a series of robot learn, finished or not: its shots are shown with their films, if a camera took any;
    SHOTS.csv is a campaign of robot campaign. The viewer listens to this machine alone.

    Example: robot review out/series
    """
    viewing.check()
    if played.is_dir():
        from robot.learning.history import read_history
        from robot.learning.report import write_recording

        if map_file:
            raise BadInput(f"--map {map_file}: applies to a campaign, but {played} is a series; omit it")
        story, title = read_history(played), f"The series {played.name}"
        films = _films(played, video, progress)
        return viewing.show(lambda path: film_said(write_recording(path, story, title, films)), progress)
    if video:
        raise BadInput(f"--video {video}: applies to a series, but {played} is a campaign; omit it")
    from planner.launcher.cueing_map import read_map
    from robot.cueing.campaign import read_campaign
    from robot.cueing.recording import write_recording as write_campaign

    shots, known = read_campaign(played), read_map(map_file) if map_file else None
    return viewing.show(lambda path: write_campaign(path, shots, known, f"The campaign {played.name}"), progress)


def _films(folder: Path, video: Path | None, progress: Progress) -> Sequence[Film]:
    """The films of a series, if a camera took any."""
    from sysid.clips import read_clip_set
    from sysid.clips.trust import camera_doubts, tell_doubts
    from sysid.vision import films_of, missing_line

    if not (folder / "clips" / "clips.toml").is_file():
        return ()
    progress("looking at the films")
    clip_set = read_clip_set(folder / "clips")
    tell_doubts(folder / "clips", camera_doubts(clip_set))
    found, missing = films_of(clip_set, video)
    progress.close()
    if missing:
        print(missing_line(missing, video))
    return found
