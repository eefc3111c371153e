"""Selection of clips by the user: all clips of a set that is not empty, or one by its file or number."""

from __future__ import annotations

from pathlib import Path

from models.errors import BadInput
from models.files.faults import closest, listed
from sysid.clips.clip_set import Clip, ClipSet


def with_shots(clip_set: ClipSet, folder: Path | str) -> ClipSet:
    """The clip set itself; BadInput if it holds no clip. `folder` is the name that the user gave."""
    if not clip_set.clips:
        raise BadInput(f"{folder}: holds no clip: add some with sysid track or sysid import, or write them by hand")
    return clip_set


def chosen_clip(clip_set: ClipSet, wanted: str | int | None, folder: Path | str) -> Clip:
    """The clip with this file name, with or without folder and suffix, or with this number, counted from 1.

    Raises:
        BadInput: there is none, or several are called so; `folder` is what the user named.
    """
    clips = with_shots(clip_set, folder).clips
    if wanted is None:
        return clips[-1]
    if isinstance(wanted, int) or wanted.isdecimal():
        if not 1 <= int(wanted) <= len(clips):
            raise BadInput(f"{folder}: there is no clip {wanted}: choose from 1 to {len(clips)}")
        return clips[int(wanted) - 1]
    same = [c for c in clips if wanted in (c.file, Path(c.file).name, Path(c.file).stem)]
    if len(same) != 1:
        files = [c.file for c in clips]
        meant = closest(wanted, files)
        remedy = f"did you mean {meant!r}?" if meant and not same else f"choose from {listed(files)}, or a number"
        raise BadInput(f"{folder}: {len(same) or 'no'} clips are called {wanted!r}: {remedy}")
    return same[0]
