"""Doubts about a clip set's camera: stored in its `[camera]`, and reported wherever they matter.

In: a clip set, or the doubts of a camera. Out: one line wherever they matter, a refusal where a robot would go by it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from models.errors import BadInput, one_line
from sysid.clips.clip_set import ClipSet

CAMERA_KEY, DOUBTS_KEY = "camera", "doubts"  # of clips.toml


def camera_doubts(clip_set: ClipSet) -> tuple[str, ...]:
    """The reasons why the clip set's camera is doubtful; empty if there are none."""
    camera = clip_set.extra.get(CAMERA_KEY)
    doubts = camera.get(DOUBTS_KEY) if isinstance(camera, dict) else None
    return tuple(text for text in doubts if isinstance(text, str)) if isinstance(doubts, list | tuple) else ()


def with_doubts(clip_set: ClipSet, doubts: Sequence[str]) -> ClipSet:
    """The clip set with these doubts added to its camera."""
    if not doubts:
        return clip_set
    camera = clip_set.extra.get(CAMERA_KEY)
    camera = dict(camera) if isinstance(camera, dict) else {}
    camera[DOUBTS_KEY] = list(dict.fromkeys((*camera_doubts(clip_set), *doubts)))
    return replace(clip_set, extra={**clip_set.extra, CAMERA_KEY: camera})


def doubt_line(name: Path | str, doubts: Sequence[str]) -> str:
    """A line on the doubts about a camera, named by its file or by what it saw; "" if there are none."""
    return one_line(f"{name}: the camera is not to be trusted: {'; '.join(doubts)}") if doubts else ""


def tell_doubts(name: Path | str, doubts: Sequence[str]) -> None:
    """That line as a warning, where there are doubts."""
    if doubts:
        print(f"warning: {doubt_line(name, doubts)}", file=sys.stderr, flush=True)


def heed_doubts(name: Path | str, doubts: Sequence[str], accepted: bool) -> None:
    """The same where a robot or its plan relies on the camera; BadInput unless the doubt was accepted."""
    if doubts and not accepted:
        raise BadInput(f"{doubt_line(name, doubts)}: calibrate it again, or continue with --accept-camera")
    tell_doubts(name, doubts)
