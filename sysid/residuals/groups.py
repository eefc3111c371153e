"""Position errors of whole shots by group: sizes, not causes, since errors accumulate from the first event on.

In: samples of whole shots, figures of segments and clips. Out: `Group`s: rms error of each, by phase, event and so on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.clips import ClipSet
from sysid.estimation.open_cloth import UNSEEN_EVENT_RATIO
from sysid.residuals.bins import SPEED_EDGES_M_S, Variable, span, variables
from sysid.residuals.comparison import ClipRow, Group, SegmentRow
from sysid.residuals.samples import Samples

MIN_GROUP_SAMPLES = 12  # fewest samples of a listed group
ABS_SIDESPIN_EDGES_RAD_S = (0.0, 5.0, 20.0, 50.0, np.inf)
PHASE_WORDS = {"slide": "while sliding", "roll": "while rolling", "spin": "spinning in place", "rest": "at rest"}
EVENT_WORDS = {
    "strike": "before the first event", "start": "before the first event that is seen",
    "ball": "after one ball-ball impact", "cushion": "after one cushion impact",
    "ball again": "after several, the last with a ball", "cushion again": "after several, the last with a cushion",
    "pocket": "after a pocket", "pocket again": "after several, the last a pocket",
}  # fmt: skip
SHOWN_VARIABLES = {  # name of a variable: the name of its groups
    "heading": "heading", "time": "time", "time since event": "since event", "place": "place", "rail before": "rail",
    "clip order": "order",
}  # fmt: skip


def groups(
    samples: Samples, segments: Sequence[SegmentRow], rows: Sequence[ClipRow], clip_set: ClipSet, sigma: float,
    sd_theta: float,
) -> tuple[Group, ...]:  # fmt: skip
    """Groups of samples by phase, last event, speed and other variables, the worst of each kind first."""
    square = np.sum(samples.residual**2, axis=1)
    found: list[Group] = []

    def group(by: str, labels: Sequence[str]) -> None:
        known = {label: k for k, label in enumerate(sorted(set(labels) - {""}))}
        number = np.array([known.get(label, -1) for label in labels], dtype=np.int64)
        listed = []
        for label, k in known.items():
            pick = number == k
            if pick.sum() >= MIN_GROUP_SAMPLES:
                mean = float(square[pick].mean())
                listed.append(Group(by, label, float(np.sqrt(mean)), float(np.sqrt(mean / 2) / sigma), int(pick.sum())))
        found.extend(sorted(listed, key=lambda d: -d.ratio))

    group("phase", [PHASE_WORDS[m] for m in samples.motion])
    again = samples.events > 1
    group(
        "event",
        [EVENT_WORDS[f"{last} again" if more else last] for last, more in zip(samples.last, again, strict=True)],
    )
    speeds = [f"at {span(SPEED_EDGES_M_S, k)} m/s" for k in range(len(SPEED_EDGES_M_S) - 1)]
    group("speed", [speeds[k] for k in np.digitize(samples.speed, SPEED_EDGES_M_S) - 1])
    spins = [f"at {span(ABS_SIDESPIN_EDGES_RAD_S, k)} rad/s" for k in range(len(ABS_SIDESPIN_EDGES_RAD_S) - 1)]
    group("sidespin", [spins[k] for k in np.digitize(np.abs(samples.spin), ABS_SIDESPIN_EDGES_RAD_S) - 1])
    group("ball", ["the struck ball" if s else "the object ball" for s in samples.struck])
    names = {name: f"ball {name}" for name in samples.ball}
    if len(names) > 2:
        group("ball", [names[name] for name in samples.ball])
    for v in variables(samples, clip_set.table, len(clip_set.clips)):
        if v.name in SHOWN_VARIABLES:
            group(SHOWN_VARIABLES[v.name], _words(v))
    found += _marks(samples, clip_set.ball.radius, sd_theta)
    by_start: dict[str, list[float]] = {}
    for s in segments:
        if s.ratio < UNSEEN_EVENT_RATIO:
            by_start.setdefault(f"segments from {s.before}", []).append(s.ratio)
    for words, ratios in sorted(by_start.items(), key=lambda item: -float(np.median(item[1]))):
        middle = float(np.median(ratios))
        found.append(Group("segment", words, middle * sigma * np.sqrt(2), middle, len(ratios)))
    counts = {c.file: sum(len(o.time) for o in c.balls.values()) for c in clip_set.clips}
    for row in sorted(rows, key=lambda r: -r.rms_m)[:5]:
        found.append(Group("clip", row.file, row.rms_m, row.rms_m / np.sqrt(2) / sigma, counts[row.file]))
    return tuple(found)


def _words(variable: Variable) -> list[str]:
    return [variable.words[k] if k >= 0 else "" for k in variable.group]


def _marks(samples: Samples, radius: float, sd_theta: float) -> list[Group]:
    """Errors of the marks' angles, as a distance on the ball's surface, by sidespin."""
    found = []
    seen = np.isfinite(samples.angle)
    band = np.digitize(np.abs(samples.spin), ABS_SIDESPIN_EDGES_RAD_S) - 1
    for k in sorted(set(band[seen].tolist())):
        pick = seen & (band == k)
        if pick.sum() >= MIN_GROUP_SAMPLES:
            rms = float(np.sqrt(np.mean(samples.angle[pick] ** 2)))
            words = f"the mark's angle at {span(ABS_SIDESPIN_EDGES_RAD_S, k)} rad/s"
            found.append(Group("mark", words, rms * radius, rms / sd_theta, int(pick.sum())))
    return sorted(found, key=lambda d: -d.ratio)
