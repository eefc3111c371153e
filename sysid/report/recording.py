"""Comparisons as a Rerun recording: measured balls, and those of every model of a ladder, shot after shot.

The most instructive shot comes first: the one whose miss changes most from the first model to the last, or for a
single model the largest. The others keep the order of the clip set.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from models.errors import BadInput
from models.recording.clips import Review
from models.recording.film import Film
from models.recording.shots import write_review
from models.shot import Track
from sysid.clips import Clip, ClipSet
from sysid.residuals.comparison import Comparison

Ladder = Sequence[tuple[str, Mapping[str, Track]]]  # a model's label, and its whole shots by clip


def write_rrd(
    path: str | Path, compared: Sequence[tuple[str, Comparison]], between: Ladder = (),
    films: Sequence[Film] | None = None,
) -> str:  # fmt: skip
    """Write the recording, whole or not at all; returns in words which films it includes, "" for none.

    Args:
        path: the recording.
        compared: comparisons of the same clips with their labels; the last is the model that is shown.
        between: further models, between the first and the last of `compared`.
        films: of the clips; by default those found where they were tracked, or beside the clip set.
    """
    tracks = [
        (name, {clip.file: track for clip, track in zip(one.shots, one.tracks, strict=True)}) for name, one in compared
    ]
    ladder = [*tracks[:1], *between, *tracks[1:]]
    last = compared[-1][1]
    reviews = [
        Review(
            name=clip.file,
            measured={name: (seen.time, seen.xy) for name, seen in clip.balls.items()},
            models={name: tracks[clip.file] for name, tracks in ladder if clip.file in tracks},
            note=clip.note,
        )
        for clip in _ordered([one for _, one in compared])
    ]
    title = "model: " + (", ".join(e.name() for e in last.model.stack()[1:]) or "native MuJoCo contact")
    filmed = found_films(last.clip_set) if films is None else films
    return write_review(path, last.clip_set.table, last.clip_set.ball, reviews, title=title, films=filmed)


def write_measured(path: str | Path, clip_set: ClipSet, films: Sequence[Film]) -> str:
    """Write the recording of clips without a model, in their order."""
    reviews = [
        Review(clip.file, {name: (seen.time, seen.xy) for name, seen in clip.balls.items()}, note=clip.note)
        for clip in clip_set.clips
    ]
    return write_review(path, clip_set.table, clip_set.ball, reviews, title="Shots as measured", films=films)


def found_films(clip_set: ClipSet) -> Sequence[Film]:
    """The films of a clip set, at the stated place or beside it; none if one is not the film that was tracked."""
    if not clip_set.extra.get("videos"):
        return ()
    from sysid.vision import films_of

    try:
        return films_of(clip_set)[0]
    except BadInput:
        return ()


def _ordered(compared: Sequence[Comparison]) -> list[Clip]:
    """The clips of the last comparison, the most instructive first."""
    misses = [{row.file: row.rms_m for row in one.clips} for one in compared]

    def shown(clip: Clip) -> float:
        last = misses[-1].get(clip.file, math.nan)
        size = abs(misses[0].get(clip.file, math.nan) - last) if len(misses) > 1 else last
        return size if math.isfinite(size) else -1.0

    clips = list(compared[-1].shots)
    first = max(range(len(clips)), key=lambda k: shown(clips[k]), default=0)
    return [*clips[first : first + 1], *clips[:first], *clips[first + 1 :]]
