"""A comparison as a Rerun recording: measured and modelled balls, shot after shot."""

from __future__ import annotations

from pathlib import Path

from models.recording.shots import Review, write_review
from sysid.residuals.comparison import Comparison


def write_rrd(path: str | Path, comparison: Comparison) -> None:
    """Write the recording, whole or not at all."""
    reviews = [
        Review(
            name=clip.file,
            measured={name: (seen.time, seen.xy) for name, seen in clip.balls.items()},
            modelled=track,
            note=clip.note,
        )
        for clip, track in zip(comparison.shots, comparison.tracks, strict=True)
    ]
    title = "model: " + (", ".join(e.name() for e in comparison.model.stack()[1:]) or "native MuJoCo contact")
    write_review(path, comparison.clip_set.table, comparison.clip_set.ball, reviews, title=title)
