"""`sysid review`: a recording opened in the Rerun viewer, which listens to this machine alone."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import click

from models.command_line import FILE_PATH
from models.console import Status
from models.errors import BadInput

VIEWER = "rerun"
RECORDING_FILE = "review.rrd"  # of a folder that sysid discover wrote
THIS_MACHINE = "127.0.0.1"  # by default the viewer listens to every network


@click.command()
@click.argument("recording", metavar="DIR|FILE.rrd", type=FILE_PATH)
@click.option("--web", is_flag=True, help="Open it in a browser, where no window can be opened.")
def review(recording: Path, web: bool) -> int:
    """Open a recording of shots in the Rerun viewer.

    DIR is what sysid discover wrote. The viewer is that of this installation, and listens to this machine alone.

    Example: sysid review out/mine
    """
    file = recording / RECORDING_FILE if recording.is_dir() else recording
    if not file.is_file():
        raise BadInput(f"{file}: no such recording; write one with: sysid discover, or with --rrd of another verb")
    beside = Path(sys.executable).with_name(VIEWER)
    viewer = str(beside) if beside.is_file() else shutil.which(VIEWER)
    if viewer is None:
        raise BadInput(f"{VIEWER}: the viewer is not installed; pip install rerun-sdk")
    words = [viewer, str(file), "--bind", THIS_MACHINE, *(["--web-viewer"] if web else [])]
    return Status.DONE if subprocess.run(words, check=False).returncode == 0 else Status.FINDING
