"""Which ball a track is of, where balls have several colours and so are followed without names.

In: the tracks, the footage, and a detector that knows the palette. Out: the tracks under the balls' names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sysid.vision.balls.colours.faces import face
from sysid.vision.balls.colours.names import names_by_faces
from sysid.vision.balls.view_geometry import Array
from sysid.vision.tracks.following.follow import BallTrack

if TYPE_CHECKING:
    from sysid.vision.balls.detect import Detector
    from sysid.vision.frames import Footage

NEW_VIEW_RADII = 1.0  # that a ball rolls, after which it shows another face
MAX_FACE_PICTURES = 24  # pictures in which faces are looked at


def named(
    tracks: Sequence[BallTrack], footage: Footage, detector: Detector
) -> tuple[tuple[BallTrack, ...], list[str]]:  # fmt: skip
    """The tracks under the names of their balls, those of none left out; and what to report of it."""
    if detector.palette is None:
        return tuple(tracks), []
    faces: dict[str, list[Array]] = {track.name: [] for track in tracks}
    place: dict[str, Array] = {}  # of a ball when its last view was taken: it shows another once it has rolled on
    for frame in footage.sample(MAX_FACE_PICTURES):
        view = detector.background.view(frame.picture)
        for track in tracks:
            for row in np.flatnonzero(track.frame == frame.index):
                at, radius = track.pixels[row], float(track.radius[row])
                shown = face(detector.background, view, at, radius)
                if track.name in place and np.hypot(*(at - place[track.name])) < NEW_VIEW_RADII * radius:
                    faces[track.name][-1] = np.concatenate([faces[track.name][-1], shown])
                else:
                    faces[track.name].append(shown)
                    place[track.name] = at
    found, naming = names_by_faces(faces, detector.palette, detector.background.bed_colour)
    kept, times = [], dict[str, int]()
    for track in tracks:
        if (name := found.get(track.name)) is not None:
            times[name] = times.get(name, 0) + 1
            kept.append(replace(track, name=name))
    alike = {name for name, count in times.items() if count > 1}
    numbered, number = [], dict.fromkeys(alike, 0)
    for track in kept:
        if track.name in alike:
            number[track.name] += 1
            track = replace(track, name=f"{track.name}_{number[track.name]}")
        numbered.append(track)
    left = len(tracks) - len(kept)
    notes = [f"{left} of {len(tracks)} tracked objects match no ball of the palette: left out"] if left else []
    return tuple(numbered), [*naming.doubts, *notes]
