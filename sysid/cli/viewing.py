"""Shared by the `review` verbs: show a recording in a window, write it, or draw it; and the option `--live`."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from models.commands.console import Progress, Status
from models.commands.options import at_most_one, given, output_option
from models.errors import BadInput
from models.files import scratch_folder
from sysid.cli.common import print_recording

if TYPE_CHECKING:
    from models.recording.viewer import Feed

LIVE_HELP = "Show progress live in the Rerun viewer, on this machine alone."


@dataclass(frozen=True)
class Viewing:
    """Where to show a recording: by default in a window."""

    web: bool = given("--web", "", "Open the recording in a browser, if no window can be opened.", bool, False)
    save_file: Path | None = given(output_option("save", "FILE.rrd", "Write the recording instead, for Rerun."))
    picture_file: Path | None = given(
        output_option("picture", "FILE.png|FILE.mp4", "Draw the beginning, or film the first 12 s, without a window.")
    )

    def check(self) -> None:
        """Raise BadInput before the work starts, if its result could not be shown."""
        from models.recording.viewer import NO_DISPLAY, display_missing, is_film, viewer_program

        at_most_one(web=self.web, save=self.save_file)
        at_most_one(web=self.web, picture=self.picture_file)
        if self.picture_file:
            is_film(self.picture_file)
        if self.picture_file or self.save_file is None:
            viewer_program()
        if not (self.web or self.save_file or self.picture_file) and display_missing():
            raise BadInput(f"{NO_DISPLAY}; give --web for a browser, --picture FILE.png or --save FILE.rrd")

    def show(self, write: Callable[[Path], None], progress: Progress) -> int:
        """Write the recording into a file and show it; returns the exit status."""
        from models.recording.viewer import draw_recording, open_viewer

        with scratch_folder() as folder:
            recording = self.save_file or folder / "review.rrd"
            write(recording)
            progress.close()
            if self.save_file:
                print_recording(self.save_file)
            if self.picture_file:
                draw_recording(self.picture_file, recording, progress)
                progress.close()
                print(f"picture: {self.picture_file}")
            if self.save_file or self.picture_file:
                return Status.DONE
            return Status.DONE if open_viewer(recording, web=self.web) else Status.FINDING


@dataclass(frozen=True)
class Live:
    """Whether to show work in progress."""

    live: bool = given("--live", "", LIVE_HELP, bool, False)
    web: bool = given("--web", "", "With --live: use a browser, if no window can be opened.", bool, False)

    @contextlib.contextmanager
    def feed(self) -> Iterator[Feed | None]:
        """The live viewer, or None if not requested; BadInput if it cannot be opened."""
        if self.web and not self.live:
            raise BadInput("--web requires --live; give both, or neither")
        if not self.live:
            yield None
            return
        from models.recording.viewer import live_viewer

        with live_viewer(web=self.web) as feed:
            yield feed
