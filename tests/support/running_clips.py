"""Clip sets cut in mid-motion, as recordings are that begin too late."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np

from sysid.clips import Clip, ClipSet, Observation, read_clip_set, write_clip_set

SETTLED_M = 0.01  # from where it ends, of a ball that hardly moves any more
SILENT_S = 0.1  # for which a tracker writes nothing of a ball at rest
PARTS = ("time", "xy", "theta")


def cut_in_motion(clip_set: ClipSet, seed: int, latest: float = 0.6) -> ClipSet:
    """Every clip without what precedes a random moment of its motion, up to a share of it, struck ball unknown."""
    rng = np.random.default_rng(seed)
    shares = rng.uniform(0.02, latest, len(clip_set.clips))
    return dataclasses.replace(
        clip_set, clips=tuple(cut(clip, float(share)) for clip, share in zip(clip_set.clips, shares, strict=True))
    )


def cut(clip: Clip, share: float) -> Clip:
    """A clip from a share of the time on in which balls move."""
    ends = [
        float(seen.time[np.hypot(*(seen.xy - seen.xy[-1]).T) > SETTLED_M].max(initial=0.0))
        for seen in clip.balls.values()
    ]
    balls = {}
    at = share * max(ends)
    for name, seen in clip.balls.items():
        keep = seen.time >= at
        before = np.flatnonzero(~keep)
        # Of a ball at rest that a tracker does not write, its place is what a recording from here on would show.
        rests = before.size and (not keep.any() or np.hypot(*(seen.xy[keep][0] - seen.xy[before[-1]])) < SETTLED_M)
        if rests and (not keep.any() or seen.time[keep][0] > at + SILENT_S):
            place = Observation(np.array([at]), seen.xy[before[-1:]], np.full(1, np.nan))
            seen = Observation(*(np.concatenate([getattr(place, k), getattr(seen, k)[keep]]) for k in PARTS))
        else:
            seen = Observation(*(getattr(seen, k)[keep] for k in PARTS))
        if len(seen.time):
            balls[name] = seen
    first = next(iter(balls))
    return dataclasses.replace(clip, struck=first, balls=balls, cue=None, running=(first,), origin=0.0)


def written_running(clip_set: ClipSet, folder: Path) -> ClipSet:
    """A set of running clips as it is read from disk; its entries name no struck ball."""
    write_clip_set(clip_set, folder)
    settings = folder / "clips.toml"
    settings.write_text(re.sub(r"struck = .*\n", "", settings.read_text()))
    return read_clip_set(folder)
