"""Sentences that describe departures.

In: who departs, and in which quantity. Out: a function from a value and its standard deviation to the sentence.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

UNIT_WORDS = {"m/s": "m/s of speed", "rad/s": "rad/s of sidespin to the right"}
Sentence = Callable[[float, float], str]


def acceleration_sentence(who: str, quantity: str, per: str = "") -> Sentence:
    """Sentence on a missing acceleration [m/s^2], or on one for each unit of another quantity."""

    def sentence(value: float, sd: float) -> str:
        size = f"{_pair(1e3 * abs(value), 1e3 * sd)} mm/s^2" + (f" for each {UNIT_WORDS[per]}" if per else "")
        if quantity == "along":
            what = f"slow down by {size} {'less' if value > 0 else 'more'} than modelled"
        elif quantity == "across":
            what = f"are pulled by {size} to the {'left' if value > 0 else 'right'} of their path"
        else:
            what = f"are pulled by {size} towards {'+' if value > 0 else '-'}{quantity}"
        return f"{who} {what} (z {abs(value) / sd:.0f})"

    return sentence


def spin_decay_sentence(who: str) -> Sentence:
    """Sentence on a missing decay of sidespin [rad/s^2]."""
    return lambda value, sd: (
        f"{who} lose {_pair(abs(value), sd)} rad/s of sidespin a second {'less' if value > 0 else 'more'} "
        f"than modelled (z {abs(value) / sd:.0f})"
    )


def velocity_sentence(who: str, quantity: str, per: str = "") -> Sentence:
    """Sentence on a missing velocity after an impact, over the speed of approach."""

    def sentence(value: float, sd: float) -> str:
        size = f"{_pair(100 * abs(value), 100 * sd)} % of the approach" + per
        if quantity == "normal" and who.startswith("rebounds"):
            what = f"leave {'faster' if value > 0 else 'slower'} by {size}"
        elif quantity == "normal":
            what = f"continue {'faster' if value > 0 else 'slower'} along the line of centres by {size}"
        else:
            what = f"keep {size} {'more' if value > 0 else 'less'} of the speed along the tangent"
        return f"{who} {what} than modelled (z {abs(value) / sd:.0f})"

    return sentence


def _pair(value: float, sd: float) -> str:
    """Value and sd, to two digits of the sd."""
    digits = int(np.clip(1 - np.floor(np.log10(sd)), 0, 6)) if sd > 0 and np.isfinite(sd) else 3
    return f"{value:.{digits}f} +- {sd:.{digits}f}"
