"""Motion that is in no clip and that no message names yet, so that nothing is lost unsaid.

In: the tracked scene, its clips, and the messages so far. Out: more messages, with frames. A move is accounted for by a
clip that shows it, or by a message that names its ball while it lasts. A ball that is not seen for long, or lies
elsewhere when it is seen again, may have moved meanwhile.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from sysid.vision.tracks.following.follow import BallTrack
from sysid.vision.tracks.moves import MAX_BRIDGED_S, Move, TrackedScene
from sysid.vision.tracks.shots.strikes import MAX_LOST_S, TrackedShot


def unsaid(
    scene: TrackedScene, shots: Sequence[TrackedShot], said: Sequence[tuple[float, str]]
) -> list[tuple[float, str]]:  # fmt: skip
    """Times [s] and messages of motion that neither clips nor the messages `said`, with their times, account for."""
    found = list[tuple[float, str]]()
    for move in (m for m in scene.moves if not _held(m, shots)):
        first, last = scene.time_of(move.before) if move.before >= 0 else scene.times[0], scene.time_of(move.ended)
        if not any(first <= time <= last and move.name in text.split() for time, text in said):
            during = [m.name for m in scene.moves if m.name != move.name and m.began <= move.began <= m.ended]
            others = f" while {' and '.join(dict.fromkeys(during))} moved" if during else ""
            found.append((scene.time_of(move.began), f"{move.name} moved until frame {move.ended}{others}"))
    for track in scene.tracks:
        found += _unseen(scene, track, shots)
    return [(time, f"{text}: in no clip") for time, text in sorted(found)]


def _held(move: Move, shots: Sequence[TrackedShot]) -> bool:
    """Whether a clip shows a move, or part of it."""
    return any(
        move.name in shot.balls and shot.first <= move.ended and move.began <= shot.potted.get(move.name, shot.last) + 1
        for shot in shots
    )


def _unseen(scene: TrackedScene, track: BallTrack, shots: Sequence[TrackedShot]) -> Iterator[tuple[float, str]]:
    """Times [s] from which a ball is not seen where it may have moved, and until when."""
    drops = [scene.time_of(shot.potted[track.name]) for shot in shots if track.name in shot.potted]
    whole = np.append(track.time, scene.times[-1])
    spans = [(m.first - 1, m.stop) for m in scene.moves if m.name == track.name] + scene.resting[track.name]
    if track.time[0] - scene.times[0] > MAX_LOST_S:
        yield float(scene.times[0]), f"{track.name} is not seen before frame {track.frame[0]}"
    for k in np.flatnonzero(np.diff(whole) > MAX_BRIDGED_S):
        time, last = float(whole[k]), k + 1 == len(track.time)
        potted = any(0 <= time - drop < MAX_BRIDGED_S for drop in drops)
        if potted or any(begin <= k < end for begin, end in spans) or (last and whole[-1] - time < MAX_LOST_S):
            continue
        until = "any more" if last else f"until frame {track.frame[k + 1]}, when it is elsewhere"
        yield time, f"{track.name} is not seen {until}"
