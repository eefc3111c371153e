"""An unknown function without the mean that a constant of the model can hold.

In: a `FitView` with a free form. Out: the same fit, the mean of the function in the constant.

A friction and a function that is added to it share a mean, which the clips do not divide. Wherever the fit has put it,
a shape that takes the place of the function starts at the constants of that fit: these must be the usual ones of the
clips, and not those of a function that happens to be zero somewhere else.
"""

from __future__ import annotations

import numpy as np

from models.shot import GRAVITY
from sysid.selection.formulas.free_forms import Block
from sysid.selection.judgement import V

CONSTANTS = {  # slot and parameter of the constant of each quantity, and the quantity that one of the parameter makes
    "drag": ("cloth", "roll", GRAVITY), "cushion_e": ("cushion_impact", "restitution", 1.0),
    "cushion_mu": ("cushion_impact", "friction", 1.0), "ball_e": ("ball_impact", "restitution", 1.0),
    "ball_mu": ("ball_impact", "friction", 1.0),
}  # fmt: skip


def centred(view: V, name: str, block: Block) -> V:
    """The fit with the mean of a free form of this name, as the clips weigh its coefficients, in the model's constant.

    Free forms are sums of splines or steps, whose coefficients are all one where the function is. A mean of the sliding
    friction is none of the model's constant, which acts at cushions as well.
    """
    if block.quantity not in CONSTANTS:
        return view
    slot, key, unit = CONSTANTS[block.quantity]
    owner = next((one.name() for one in view.model.effects if one.slot == slot), None)
    if f"{owner}.{key}" not in view.names:
        return view
    constant = view.names.index(f"{owner}.{key}")
    rows = np.array([k for k, one in enumerate(view.names) if one.startswith(f"{name}.")])
    c, weight = view.point.constants.copy(), view.shots[0].sum(axis=0)[np.ix_(rows, rows)].sum(axis=0)
    if not weight.sum() > 0.0:
        return view
    mean, before = float(weight @ c[rows] / weight.sum()), c[constant]
    low, high = view.model.meta(view.names[constant])["bounds"]
    c[constant] = np.clip(before + mean / unit, low, high)
    c[rows] -= unit * (c[constant] - before)
    return view.at_constants(c)
