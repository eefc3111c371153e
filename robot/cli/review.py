"""`robot review`: a series of shots, or a campaign of strokes, in the Rerun viewer."""

from __future__ import annotations

from pathlib import Path

import click

from models.command_line import FILE_PATH, gathered, input_option
from models.console import Progress
from models.errors import BadInput
from sysid.cli.viewing import Viewing


@click.command()
@click.argument("played", metavar="DIR|SHOTS.csv", type=FILE_PATH)
@input_option("map", "MAP.toml", "Cueing map that a campaign is held against; by default a regular cue's.")
@gathered("viewing", Viewing)
@click.pass_obj
def review(progress: Progress, played: Path, map_file: Path | None, viewing: Viewing) -> int:
    """Review in the Rerun viewer what was played: planned and played shots, predicted and measured strokes.

    DIR is a series of robot learn, also one that is not finished; SHOTS.csv a campaign of robot campaign. The viewer
    listens to this machine alone.

    Example: robot review out/series
    """
    viewing.check()
    if played.is_dir():
        from robot.learning.history import read_history
        from robot.learning.report import write_recording

        if map_file:
            raise BadInput(f"--map {map_file}: belongs to a campaign; {played} is a series, leave it out")
        story = read_history(played)
        return viewing.show(lambda path: write_recording(path, story, f"The series {played.name}"), progress)
    from planner.launcher.cueing_map import read_map
    from robot.cueing.campaign import read_campaign
    from robot.cueing.recording import write_recording as write_campaign

    shots, known = read_campaign(played), read_map(map_file) if map_file else None
    return viewing.show(lambda path: write_campaign(path, shots, known, f"The campaign {played.name}"), progress)
