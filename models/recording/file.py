"""Recordings as files: whole or absent, and the same content whenever they are written.

Not the same bytes: Rerun stamps files, chunks, rows and views with identifiers from the clock and from chance, those of
a file and of its layout even where a reader's chunks are given others and written anew.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from models.files import write_whole


def silent_stream(application: str, digest: str | None) -> Any:
    """A recording without the clock's timelines; `digest` names it, None: anew each time."""
    import rerun as rr

    stream = rr.RecordingStream(application, recording_id=digest, send_properties=False)
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    return stream


@contextmanager
def whole_recording(path: Path | str, application: str, digest: str, title: str, blueprint: Any) -> Iterator[Any]:
    """A stream into a file that appears whole or not at all; BadInput where it cannot be written.

    It is gathered in memory: where Rerun itself writes a file, a full disk makes it wait for ever, or speak for itself.
    """
    stream = silent_stream(application, digest)
    try:
        memory = stream.memory_recording()
        stream.send_blueprint(blueprint, make_active=False, make_default=True)
        stream.send_recording_name(title)
        yield stream
        stream.flush()
        content = memory.drain_as_bytes()
    finally:
        stream.disconnect()
    write_whole(path, content)
