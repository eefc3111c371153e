"""The ranges from which the hidden constants of an emulated launcher are drawn.

In: a generator of random numbers. Out: values by name. The ranges follow from published properties of launchers
(models/mjcf/launcher.md, Alciatore).
"""

from __future__ import annotations

import numpy as np

HIDDEN_RANGES = {
    "tip_restitution": (0.68, 0.80),  # [1]
    "cue_mass": (0.45, 0.58),  # [kg]
    "end_mass": (0.0050, 0.0105),  # [kg]
    "slate_friction": (0.18, 0.25),  # [1]
    "tip_friction": (0.58, 0.65),  # [1]
    "side_zero": (-4e-4, 4e-4),  # true minus commanded [m]
    "height_zero": (-4e-4, 4e-4),  # [m]
    "aim_zero": (-3e-3, 3e-3),  # [rad]
}


def draw_values(rng: np.random.Generator, *omitted: str) -> dict[str, float]:
    """Draw a value from each range, in order, except the omitted ones."""
    return {name: float(rng.uniform(*ends)) for name, ends in HIDDEN_RANGES.items() if name not in omitted}
