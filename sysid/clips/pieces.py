"""Shots cut into windows of one impact each, or into segments without impacts.

In: a `ClipSet`. Out: a `ClipSet` whose clips are the windows, or the segments.

Every impact multiplies an error, so a shot of a dozen cushions says little about a model that does not yet follow the
cloth: its end is chance. A window begins with a motion between impacts and ends before the second impact. It has its
own initial state, and shows cloth, camera and one impact. An impact of two moving balls, or one that is not clear from
the tracks, ends a window. A segment is the motion between two impacts: it shows cloth and camera alone.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence

import numpy as np

from sysid.clips.clip_set import Clip, ClipSet, Observation
from sysid.clips.segments import Cut, cuts_of, free_from, moving_from, onsets

MIN_SAMPLES_BEFORE_IMPACT = 5  # of the first segment of a window
MIN_SAMPLES_AFTER_IMPACT = 3  # of the segment after its impact
MAX_CONTACT_OFFSET_FRAMES = 2.5  # between the impact of one ball and the first motion of the other


def cut_clips(clip_set: ClipSet, sigma: float, impacts: bool = True) -> ClipSet:
    """Cut all clips into windows or, without `impacts`, into segments, named `FILE#k`; `sigma` is the noise [m]."""
    found = [part for clip in clip_set.clips for part in _cut(clip, clip_set, sigma, impacts)]
    return dataclasses.replace(clip_set, clips=tuple(found))


def parent_clip(file: str) -> str:
    """The clip that a window or segment was cut from."""
    return re.sub(r"(#\d+)+$", "", file)


def _cut(clip: Clip, clip_set: ClipSet, sigma: float, impacts: bool) -> list[Clip]:
    table, ball = clip_set.table, clip_set.ball
    tracks = onsets(clip, sigma, clip_set.fps)
    events = {name: cuts_of(name, tracks, table, ball, sigma) for name in tracks}
    found: list[Clip] = []
    taken: dict[str, int] = {}  # by ball: its last sample in the window of the ball that hit it
    # The ball that hits comes before the one that is hit.
    for name in sorted(tracks, key=lambda b: (b != clip.struck, float(tracks[b].time[0]))):
        seen = tracks[name]
        cuts = [*events[name], Cut(len(seen.time), "end", "")]
        cuts = [cut for cut in cuts if cut.sample > taken.get(name, -1)]
        low = taken.get(name, 0) + 1
        if name in clip.running:
            low = 0
        elif name == clip.struck:
            low = free_from(seen, sigma)
        k = 0
        while k < len(cuts):
            cut, first, run = cuts[k], slice(low, cuts[k].sample), k
            k, low = k + 1, cut.sample + 1
            if first.stop - first.start < MIN_SAMPLES_BEFORE_IMPACT:
                continue
            balls = {name: _part(seen, first)}
            if impacts and k < len(cuts) and cuts[k].sample - low >= MIN_SAMPLES_AFTER_IMPACT:
                more = _other_balls(cut, float(seen.time[cut.sample]), clip, tracks, events, clip_set.fps, sigma)
                if more is not None:
                    balls = {name: _part(seen, slice(first.start, cuts[k].sample), cut.sample), **more}
                    taken |= {b: int(np.searchsorted(tracks[b].time, o.time[-1])) + 1 for b, o in more.items()}
                    k, low = k + 1, cuts[k].sample + 1
            struck = name == clip.struck and run == 0 and not clip.running
            found.append(
                Clip(
                    f"{clip.file}#{len(found) + 1}", name, _from_zero(balls, float(seen.time[first.start])),
                    clip.cue if struck else None, clip.note, order=clip.order, running=() if struck else (name,),
                )
            )  # fmt: skip
    return found


def _part(seen: Observation, part: slice, without: int | None = None) -> Observation:
    keep = np.zeros(len(seen.time), bool)
    keep[part] = True
    if without is not None:  # the sample next to an impact may be smeared
        keep[without] = False
    return Observation(seen.time[keep], seen.xy[keep], seen.theta[keep])


def _from_zero(balls: Mapping[str, Observation], start: float) -> dict[str, Observation]:
    return {b: Observation(np.maximum(o.time - start, 0.0), o.xy, o.theta) for b, o in balls.items()}


def _other_balls(
    cut: Cut,
    when: float,
    clip: Clip,
    tracks: Mapping[str, Observation],
    events: Mapping[str, Sequence[Cut]],
    fps: float,
    sigma: float,
) -> dict[str, Observation] | None:
    """Other balls of the window: none at a cushion; the one that was hit, if at rest before; None if unclear."""
    if cut.kind == "cushion":
        return {}
    if cut.kind == "end" or cut.with_ in clip.first:
        return None
    seen, moved = clip.balls[cut.with_], tracks[cut.with_]
    resting = moving_from(seen, sigma)
    if (
        len(moved.time) < MIN_SAMPLES_AFTER_IMPACT
        or abs(float(moved.time[0]) - when) > MAX_CONTACT_OFFSET_FRAMES / fps
        or resting == 0
    ):
        return None
    end = next((c.sample for c in events[cut.with_] if c.sample > 1), len(moved.time))
    rest = seen.xy[:resting].mean(axis=0)
    part = _part(moved, slice(1, end))
    if len(part.time) < MIN_SAMPLES_AFTER_IMPACT:
        return None
    still = Observation(np.array([0.0]), rest[None], np.full(1, np.nan))
    return {
        cut.with_: Observation(
            np.concatenate([still.time, part.time]), np.concatenate([still.xy, part.xy]),
            np.concatenate([still.theta, part.theta]),
        )
    }  # fmt: skip
