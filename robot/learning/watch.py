"""Live view of a series: each shot as planned, then as played, and the findings of refits.

Everything is read from the series' folder, which contains every result immediately.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

from models.recording.series import SeriesRecording
from models.recording.story import LiveStory
from models.shot import Ball, Table
from robot.learning.history import count_played, read_history
from robot.learning.report import planned_recording, recording_of

if TYPE_CHECKING:
    from models.recording.viewer import Feed


class SeriesWatch:
    """Shows a series; called with the number of a shot whenever there is news of it."""

    def __init__(self, folder: Path, feed: Feed, table: Table, ball: Ball) -> None:
        """Start with the shots played before; `folder` is that of a started series."""
        self._folder, self._live = folder, LiveStory(feed, f"The series {folder.name}", table, ball)
        self._lessons = 0
        if played := count_played(folder):
            self._show(recording_of(read_history(folder)), 1, played)

    def __call__(self, number: int) -> None:
        """Show the current state of a shot."""
        if number > count_played(self._folder):
            self._live.show(planned_recording(self._folder, number))
        else:
            self._show(recording_of(read_history(self._folder)), number, number)

    def _show(self, whole: SeriesRecording, first: int, last: int) -> None:
        """Send shots first to last, and new findings of refits."""
        shots = [one for one in whole.scenes if first <= one.number <= last]
        new = whole.lessons[self._lessons :]
        self._lessons = len(whole.lessons)
        self._live.show(dataclasses.replace(whole, scenes=shots, lessons=new))
