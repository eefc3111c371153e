"""A series ends where the launcher's own scatter is what is left of the miss."""

from __future__ import annotations

import dataclasses
import math

from robot.learning.ending import why_ended
from tests.support.series_samples import story


def test_a_series_goes_on_while_the_miss_is_more_than_the_launcher_s_scatter() -> None:
    """Plans of a model that is known badly predict a large miss, which is no reason to leave it at that."""
    poor = story((0.5, 0.23, 0.22))
    shots = tuple(dataclasses.replace(s, spread=0.2, floor=0.04) for s in poor.shots)
    assert why_ended(dataclasses.replace(poor, shots=shots), 4) == ""
    unknown = tuple(dataclasses.replace(s, floor=math.nan) for s in shots)
    assert "predicted 200 mm: nothing is left to learn" in why_ended(dataclasses.replace(poor, shots=unknown), 4)
