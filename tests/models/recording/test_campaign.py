"""The recording of a campaign: its figures open on all strokes."""

from __future__ import annotations

import numpy as np

from models.recording.campaign import _blueprint
from models.shot import Ball


def test_figures_open_on_all_strokes_and_nothing_beside() -> None:
    """As many strokes before the first as after it would be shown, and the later ones not."""
    root = _blueprint(Ball(0.0525, 0.1406), np.arange(1.0, 2276.0)).root_container
    for view in root.contents[1].contents:
        [shown] = view.properties["TimeAxis"].view_range.as_arrow_array().to_pylist()
        assert (shown["start"], shown["end"]) == (1, 2276)
