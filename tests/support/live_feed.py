"""A stand-in for the viewer that is fed while work goes on: a folder of recordings, one for each stream."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from models.recording.file import silent_stream


class FileFeed:
    """Streams into files of a folder."""

    url = ""

    def __init__(self, folder: Path) -> None:
        self.folder, self.streams = folder, list[Any]()

    def stream(self, application: str, title: str, blueprint: Any) -> Any:
        made = silent_stream(application, f"{application}{len(self.streams)}")
        made.save(self.folder / f"{len(self.streams)}.rrd", default_blueprint=blueprint)
        made.send_recording_name(title)
        self.streams.append(made)
        return made

    def files(self) -> list[Path]:
        """All recordings so far, whole."""
        for stream in self.streams:
            stream.flush()
            stream.disconnect()
        return [self.folder / f"{k}.rrd" for k in range(len(self.streams))]
