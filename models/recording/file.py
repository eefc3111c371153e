"""Recordings as files: whole or absent, and the same content whenever they are written.

Not the same bytes: Rerun stamps files, chunks, rows and views with identifiers from the clock and from chance, those of
a file and of its layout even where a reader's chunks are given others and written anew.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from models.errors import BadInput


def silent_stream(application: str, digest: str | None) -> Any:
    """A recording without the clock's timelines; `digest` names it, None: anew each time."""
    import rerun as rr

    stream = rr.RecordingStream(application, recording_id=digest, send_properties=False)
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    return stream


@contextmanager
def whole_recording(path: Path | str, application: str, digest: str, title: str, blueprint: Any) -> Iterator[Any]:
    """A stream into a file that appears whole or not at all; BadInput where it cannot be written."""
    from rerun.chunk import RrdReader

    target = Path(path)
    stream = silent_stream(application, digest)
    try:
        with tempfile.TemporaryDirectory(prefix=f".{target.name}.", dir=target.parent) as folder:
            part = Path(folder) / target.name
            stream.save(part, default_blueprint=blueprint)
            stream.send_recording_name(title)
            yield stream
            stream.flush()
            stream.disconnect()
            RrdReader(part).store()  # refuses a file that was cut short
            part.replace(target)
    except (OSError, RuntimeError) as error:  # Rerun raises the latter for a full disk
        text = f"{path}: cannot be written ({error}); choose another place"
        raise BadInput(" ".join(text.split())) from error
    finally:
        stream.disconnect()
