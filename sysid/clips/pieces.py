"""Shots cut into pieces of one impact each, or into runs of none.

Every impact multiplies an error, so a shot of a dozen cushions says little of a model that does not yet follow the
cloth: its end is chance, and what bends its beginning least looks best. A piece begins on a free run, with unknowns of
its own, and ends before the second impact. It tells of the cloth, of the camera and of the impact in it; nothing is
carried from one piece to the next. Impacts of two balls on their way, and those that nobody saw, end a piece.
A run has no impact at all: nothing but cloth and camera.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence

import numpy as np

from sysid.clips.clip_set import Clip, ClipSet, Observation
from sysid.clips.segments import Cut, cuts_of, free_from, moving_from, onset

MIN_SAMPLES_BEFORE_IMPACT = 5  # samples of a piece's first run
MIN_SAMPLES_AFTER_IMPACT = 3  # and of the run after its impact
MAX_CONTACT_OFFSET_FRAMES = 2.5  # frames by which a ball may seem to be set moving before or after it was hit


def cut_clips(clip_set: ClipSet, sigma: float, impacts: bool = True) -> ClipSet:
    """The pieces of all clips, or the runs, as clips of their own named `FILE#k`; `sigma` is the noise [m]."""
    found = [piece for clip in clip_set.clips for piece in _pieces(clip, clip_set, sigma, impacts)]
    return dataclasses.replace(clip_set, clips=tuple(found))


def parent_clip(file: str) -> str:
    """The clip that a piece is of."""
    return re.sub(r"(#\d+)+$", "", file)


def _pieces(clip: Clip, clip_set: ClipSet, sigma: float, impacts: bool) -> list[Clip]:
    table, ball = clip_set.table, clip_set.ball
    tracks = {
        name: seen if clip.running and name == clip.struck else onset(seen, sigma, clip_set.fps)
        for name, seen in clip.balls.items()
    }
    events = {name: cuts_of(name, tracks, table, ball, sigma) for name in tracks}
    found: list[Clip] = []
    taken: dict[str, int] = {}  # sample after the first run of a ball that is in the piece of the one that hit it
    # Who hits before who is hit.
    for name in sorted(tracks, key=lambda b: (b != clip.struck, float(tracks[b].time[0]))):
        seen = tracks[name]
        cuts = [*events[name], Cut(len(seen.time), "end", "")]
        cuts = [cut for cut in cuts if cut.sample > taken.get(name, -1)]
        low = taken.get(name, 0) + 1
        if name == clip.struck:
            low = 0 if clip.running else free_from(seen, sigma)
        k = 0
        while k < len(cuts):
            cut, first, run = cuts[k], slice(low, cuts[k].sample), k
            k, low = k + 1, cut.sample + 1
            if first.stop - first.start < MIN_SAMPLES_BEFORE_IMPACT:
                continue
            balls = {name: _part(seen, first)}
            if impacts and k < len(cuts) and cuts[k].sample - low >= MIN_SAMPLES_AFTER_IMPACT:
                more = _other(cut, float(seen.time[cut.sample]), clip, tracks, events, clip_set.fps, sigma)
                if more is not None:
                    balls = {name: _part(seen, slice(first.start, cuts[k].sample), cut.sample), **more}
                    taken |= {b: int(np.searchsorted(tracks[b].time, o.time[-1])) + 1 for b, o in more.items()}
                    k, low = k + 1, cuts[k].sample + 1
            struck = name == clip.struck and run == 0 and not clip.running
            found.append(
                Clip(
                    f"{clip.file}#{len(found) + 1}", name, _from_zero(balls, float(seen.time[first.start])),
                    clip.cue if struck else None, clip.note, order=clip.order, running=not struck,
                )
            )  # fmt: skip
    return found


def _part(seen: Observation, part: slice, without: int | None = None) -> Observation:
    keep = np.zeros(len(seen.time), bool)
    keep[part] = True
    if without is not None:  # the sample next to an impact is not to be trusted
        keep[without] = False
    return Observation(seen.time[keep], seen.xy[keep], seen.theta[keep])


def _from_zero(balls: Mapping[str, Observation], start: float) -> dict[str, Observation]:
    return {b: Observation(np.maximum(o.time - start, 0.0), o.xy, o.theta) for b, o in balls.items()}


def _other(
    cut: Cut,
    when: float,
    clip: Clip,
    tracks: Mapping[str, Observation],
    events: Mapping[str, Sequence[Cut]],
    fps: float,
    sigma: float,
) -> dict[str, Observation] | None:
    """What else is in the piece: nothing at a cushion; the ball that was hit, if it lay until then; None if unclear."""
    if cut.kind == "cushion":
        return {}
    if cut.kind == "end" or cut.with_ == clip.struck:
        return None
    seen, moved = clip.balls[cut.with_], tracks[cut.with_]
    lying = moving_from(seen, sigma)
    if (
        len(moved.time) < MIN_SAMPLES_AFTER_IMPACT
        or abs(float(moved.time[0]) - when) > MAX_CONTACT_OFFSET_FRAMES / fps
        or lying == 0
    ):
        return None
    end = next((c.sample for c in events[cut.with_] if c.sample > 1), len(moved.time))
    rest = seen.xy[:lying].mean(axis=0)
    part = _part(moved, slice(1, end))
    if len(part.time) < MIN_SAMPLES_AFTER_IMPACT:
        return None
    lay = Observation(np.array([0.0]), rest[None], np.full(1, np.nan))
    return {
        cut.with_: Observation(
            np.concatenate([lay.time, part.time]), np.concatenate([lay.xy, part.xy]),
            np.concatenate([lay.theta, part.theta]),
        )
    }  # fmt: skip
