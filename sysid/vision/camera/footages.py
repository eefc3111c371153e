"""The table without what moves on it, from one or several videos of one camera.

In: frames of each. Out: `TableView`, their median, and single frames in which balls rest. Videos in which the camera
stood elsewhere are left out: features of one median are followed to the other (Lucas and Kanade, pyramidal), and where
they have moved by more than a pixel, the camera has.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput

Picture = NDArray[np.uint8]
MAX_SHIFT_PX = 1.0  # of the middle one of the features, of one camera
MAX_FEATURES = 300  # followed, at most
FEATURE_QUALITY = 0.02  # of the least, of the best
FEATURE_DISTANCE_PX = 12.0
MIN_FEATURES = 12  # followed, below which nothing is known of the camera
MAX_RETURN_PX = 0.5  # of a feature that is followed there and back
MAX_STILLS = 6  # single frames kept


@dataclass(frozen=True)
class TableView:
    """What one camera sees of the table."""

    picture: NDArray[np.floating]  # (height, width, 3) median over all frames
    stills: tuple[Picture, ...]  # the first and last frames
    used: tuple[str, ...]  # names of the videos
    notes: tuple[str, ...]


def table_view(videos: Mapping[str, Sequence[Picture]]) -> TableView:
    """The view of the camera that most videos agree upon, or of several such the first.

    Args:
        videos: frames (height, width, 3) of each, by name.

    Raises:
        BadInput: sizes differ.
    """
    names = list(videos)
    first = videos[names[0]][0].shape
    for name in names:
        if videos[name][0].shape != first:
            size, other = (f"{s[1]}x{s[0]}" for s in (videos[name][0].shape, first))
            raise BadInput(f"{name}: is {size} pixels, {names[0]} {other}: calibrate them separately")
    medians = {name: _median(videos[name]).astype(np.uint8) for name in names}
    same = {a: [b for b in names if a == b or shift(medians[a], medians[b]) <= MAX_SHIFT_PX] for a in names}
    used = max(same.values(), key=len)
    left = [name for name in names if name not in used]
    notes = [f"{name}: the camera stood elsewhere; left out of the calibration" for name in left]
    notes += [
        f"{name}: the camera moves between the first frame and the last"
        for name in used
        if len(videos[name]) > 1 and shift(videos[name][0], videos[name][-1]) > MAX_SHIFT_PX
    ]
    frames = [frame for name in used for frame in videos[name]]
    ends = [frame for name in used for frame in (videos[name][0], videos[name][-1]) if len(videos[name]) > 1]
    stills = ends[:: max(1, -(-len(ends) // MAX_STILLS))]
    return TableView(_median(frames), tuple(stills), tuple(used), tuple(notes))


def _median(frames: Sequence[Picture]) -> NDArray[np.floating]:
    """The median of frames (height, width, 3)."""
    return np.asarray(np.median(np.stack(frames), axis=0) if len(frames) > 1 else frames[0].astype(float))


def shift(one: Picture, other: Picture) -> float:
    """How far the features of one picture have moved in the other: median [pixels]; 0 where too few are followed."""
    grey, there = (cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) for picture in (one, other))
    points = cv2.goodFeaturesToTrack(grey, MAX_FEATURES, FEATURE_QUALITY, FEATURE_DISTANCE_PX)
    if points is None:
        return 0.0
    moved, good, _ = cv2.calcOpticalFlowPyrLK(grey, there, points, None)
    back, again, _ = cv2.calcOpticalFlowPyrLK(there, grey, moved, None)
    returned = np.linalg.norm(back - points, axis=2).ravel() < MAX_RETURN_PX
    kept = returned & (good.ravel() == 1) & (again.ravel() == 1)
    if kept.sum() < MIN_FEATURES:
        return 0.0
    return float(np.median(np.linalg.norm(moved - points, axis=2).ravel()[kept]))
