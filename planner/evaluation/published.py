"""How far constants that nobody measured on a table may be from their usual values: the spread of published ones.

In: a model. Out: the same model, in which constants without a standard deviation of their own have that of the values
that have been published, low to high: (high - low) / sqrt(12), of a value that lies anywhere between them. They are
independent of each other and of those that were fitted. So a plan on an unfitted model promises less the more it rests
on what is known least: values of cushions differ most from table to table. Left out are constants of which no range was
published, such as those of effects that a fit has not found, and what no constant expresses: that another law holds.
"""

from __future__ import annotations

import dataclasses
import math

from models.model_file import Estimate, Model


def unfitted_spread(model: Model) -> dict[str, float]:
    """Standard deviations of published values, by constant, of those for which the model has none of its own."""
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
