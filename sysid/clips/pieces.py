"""Shots cut into segments: the motion between two impacts, which shows cloth and camera alone.

In: a `ClipSet`. Out: a `ClipSet` whose clips are the segments, named `FILE#k`.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from sysid.clips.clip_set import Clip, ClipSet
from sysid.clips.segments import Cut, cuts_of, free_from, onsets

MIN_SAMPLES = 5  # of a segment


def cut_clips(clip_set: ClipSet, sigma: float) -> ClipSet:
    """Cut all clips into segments; `sigma` is the noise [m]."""
    found = [part for clip in clip_set.clips for part in _cut(clip, clip_set, sigma)]
    return dataclasses.replace(clip_set, clips=tuple(found))


def _cut(clip: Clip, clip_set: ClipSet, sigma: float) -> list[Clip]:
    table, ball = clip_set.table, clip_set.ball
    tracks = onsets(clip, sigma, clip_set.fps)
    events = {name: cuts_of(name, tracks, table, ball, sigma) for name in tracks}
    found: list[Clip] = []
    # The ball that hits comes before the one that is hit.
    for name in sorted(tracks, key=lambda b: (b != clip.struck, float(tracks[b].time[0]))):
        seen, low = tracks[name], 1
        if name in clip.running:
            low = 0
        elif name == clip.struck:
            low = free_from(seen, sigma)
        for k, cut in enumerate([*events[name], Cut(len(seen.time), "end", "")]):
            rows, low = np.arange(low, cut.sample), cut.sample + 1
            if rows.size < MIN_SAMPLES:
                continue
            struck = name == clip.struck and k == 0 and not clip.running
            part = seen.at(rows)
            begun = dataclasses.replace(part, time=np.maximum(part.time - part.time[0], 0.0))
            found.append(
                Clip(
                    f"{clip.file}#{len(found) + 1}", name, {name: begun}, clip.cue if struck else None, clip.note,
                    order=clip.order, running=() if struck else (name,),
                )
            )  # fmt: skip
    return found
