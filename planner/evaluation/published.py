"""Uncertainty of constants that were not measured: the spread of published values.

In: a model. Out: the same model, in which constants without their own standard deviation have that of the published
range: (high - low) / sqrt(12), for a value anywhere between. They are independent of each other and of fitted ones. So
a plan on an unfitted model predicts less success the more it relies on the least known constants: those of cushions
differ most between tables. Left out: constants without a published range, such as those of effects that were not
found, and other laws.
"""

from __future__ import annotations

import dataclasses
import math

from models.model_file import Estimate, Model


def unfitted_spread(model: Model) -> dict[str, float]:
    """Standard deviations of published values, by constant, for constants without their own."""
    found = {}
    for name in model.parameters():
        known = model.estimates.get(name)
        published = None if name in model.sizes else model.meta(name).get("published")
        if published is not None and not (known is not None and 0 < known.sd < math.inf):
            found[name] = (published[1] - published[0]) / math.sqrt(12)
    return found


def with_published_spread(model: Model) -> Model:
    """The model with these standard deviations among its estimates."""
    spread = unfitted_spread(model)
    if not spread:
        return model
    added = {name: Estimate(sd, f"published: {model.meta(name)['published_by']}") for name, sd in spread.items()}
    return dataclasses.replace(model, estimates={**model.estimates, **added})
