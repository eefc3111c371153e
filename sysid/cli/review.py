"""`sysid review`: shots in the Rerun viewer, with their films; the viewer listens to this machine alone."""

from __future__ import annotations

from pathlib import Path

import click

from models.commands.console import Progress
from models.commands.options import FILE_PATH, effects_option, gathered
from models.errors import BadInput
from sysid.cli.common import Start
from sysid.cli.viewing import Viewing

RECORDING_FILES = ("review.rrd", "found/review.rrd")  # recordings inside the folders of sysid discover and sysid doctor


models_option = click.option(
    "--model", "model_files", metavar="M.toml", type=FILE_PATH, multiple=True,
    help="Model whose shots are shown beside those of CLIPS; of several the best goes last.",
)  # fmt: skip
video_option = click.option(
    "--video", metavar="DIR", type=FILE_PATH,
    help="Folder of the films; by default they are looked for where they were tracked, and beside the clips.",
)  # fmt: skip


@click.command()
@click.argument("shots", metavar="CLIPS|DIR|FILE.rrd", type=FILE_PATH)
@models_option
@video_option
@effects_option()
@gathered("viewing", Viewing)
@click.pass_obj
def review(
    progress: Progress, shots: Path, model_files: tuple[Path, ...], video: Path | None, viewing: Viewing
) -> int:  # fmt: skip
    """Review shots in the Rerun viewer: measured and modelled, beside their film.

    CLIPS is a clip set: its shots, and with --model those of the models, are shown beside their films. DIR is a folder
    that sysid discover or doctor wrote, FILE.rrd a recording. The viewer listens to this machine alone.

    Example: sysid review out/mine
    """
    viewing.check()
    if (shots / "clips.toml").is_file():
        return _review_clips(shots, model_files, video, viewing, progress)
    file = next((shots / name for name in RECORDING_FILES if (shots / name).is_file()), shots)
    if not file.is_file():
        file = shots / RECORDING_FILES[0] if shots.is_dir() else shots
        raise BadInput(f"{file}: no such recording; write one with: sysid discover, or with --rrd of another verb")
    for name, value in (("model", model_files), ("video", video)):
        if value:
            raise BadInput(f"--{name}: {file} is finished; for a new one give the clip set: sysid review CLIPS")
    return viewing.show(lambda path: _copy(file, path), progress)


def _copy(file: Path, path: Path) -> None:
    """Copy a recording to another file."""
    from models.files import write_whole

    if path.resolve() != file.resolve():
        write_whole(path, file.read_bytes())


def _review_clips(
    shots: Path, model_files: tuple[Path, ...], video: Path | None, viewing: Viewing, progress: Progress
) -> int:  # fmt: skip
    """Record a clip set: its films, the measured shots, and those of each model named."""
    from sysid.cli.identification.compare import labels_of
    from sysid.clips import read_clip_set
    from sysid.clips.choose import with_shots
    from sysid.clips.trust import camera_doubts, tell_doubts
    from sysid.interface import compare
    from sysid.report.recording import write_measured, write_rrd
    from sysid.vision import films_of, missing_line

    if model_files:
        clip_set, models = Start(shots, model_files).load_several()
    else:
        clip_set, models = with_shots(read_clip_set(shots), shots), []
        tell_doubts(shots, camera_doubts(clip_set))
    progress("looking at the films")
    films, missing = films_of(clip_set, video)
    progress.close()
    if missing:
        print(missing_line(missing, video))
    if not model_files:
        return viewing.show(lambda path: film_said(write_measured(path, clip_set, films)), progress)
    labels = labels_of(model_files)
    compared = [(label, compare(clip_set, model)) for label, model in zip(labels, models, strict=True)]
    return viewing.show(lambda path: film_said(write_rrd(path, compared, films=films)), progress)


def film_said(filmed: str) -> None:
    """Print which films went into a recording, if any."""
    if filmed:
        print(f"film: {filmed}")
