"""`sysid plot`: a picture of tracks, with the speeds of a shot and the error of models."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from models.commands.console import Progress, Status
from models.commands.options import effects_option, gathered, out_option
from models.messages import counted
from sysid.cli.common import Start
from sysid.cli.identification.compare import labels_of


@click.command()
@gathered("start", Start)
@click.option("--clip", "wanted", metavar="NAME|N", help="One shot, by file or by number from 1.")
@out_option("FILE.png", "File for the picture.")
@effects_option()
@click.pass_obj
def plot(progress: Progress, start: Start, wanted: str | None, out: Path) -> int:
    """Draw tracks over the table; for one shot also its speeds and the error of models.

    Without --clip all tracks are drawn, or, with --model, the shot that the last model misses most.

    Example: sysid plot CLIPS --clip 3 --model M.toml --out shot.png
    """
    from models.files import write_whole
    from sysid.clips.choose import chosen_clip
    from sysid.interface import compare
    from sysid.report.pictures.plot import shot_png, tracks_png

    clip_set, models = start.load_several()
    one = chosen_clip(clip_set, wanted, start.clips) if wanted is not None else None
    if one is None and not start.model_files:
        write_whole(out, tracks_png(clip_set, f"{counted(len(clip_set.clips), 'clip')} of {start.clips}"))
    elif not start.model_files and one is not None:
        write_whole(out, shot_png(one, clip_set.table, clip_set.ball))
    else:
        labels = labels_of(start.model_files) if len(models) > 1 else [start.model_files[0].stem]
        chosen = clip_set if one is None else replace(clip_set, clips=(one,))
        compared = [compare(chosen, model) for model in models]
        file = max(compared[-1].clips, key=lambda row: row.rms_m).file
        k = [shot.file for shot in compared[-1].shots].index(file)
        tracks = [(label, c.tracks[k]) for label, c in zip(labels, compared, strict=True)]
        write_whole(out, shot_png(compared[-1].shots[k], clip_set.table, clip_set.ball, tracks))
    progress.close()
    print(f"picture: {out}")
    return Status.DONE
