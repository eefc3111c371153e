"""Length and width of the table and diameter of the balls as constants of a fit, with their accuracy as prior.

A table that is a few millimetres longer than stated differs from a scaled picture: cushions move, paths of balls do
not. If its size were held, the error would appear as effects of camera, slope or nap. So sizes are constants like
others, with the stated value as prior; clips with impacts at cushions and between balls determine them ten times
better.
"""

from __future__ import annotations

from models.model_file import Model
from models.table.sizes import BALL_DIAMETER, SIZE_NAMES, TABLE_LENGTH, TABLE_WIDTH, stated_size
from sysid.estimation.problem import by_events

TAPE_SD = 0.003  # sd of a length: noses yield, and a tape sags and is held by hand: 5 to 10 mm on 3.5 m
CALIPER_SD = 0.005  # sd of a diameter, relative: jaws off the widest place, and balls of a set differ by 0.1 to 0.3 mm
SIZE_SDS = {TABLE_LENGTH: TAPE_SD, TABLE_WIDTH: TAPE_SD, BALL_DIAMETER: CALIPER_SD}


def with_free_sizes(model: Model) -> Model:
    """The model with its sizes among its constants; unchanged if MuJoCo plays it, which needs a world for each size."""
    if not by_events(model):
        return model
    stated = {name: stated_size(name, model.table, model.ball) for name in SIZE_NAMES}
    return model.with_values(stated | dict(model.sizes))


def known_sizes(model: Model) -> dict[str, tuple[float, float]]:
    """Prior of the sizes that are constants: the stated value and its standard deviation [m]."""
    stated = {name: stated_size(name, model.table, model.ball) for name in model.sizes}
    return {name: (size, SIZE_SDS[name] * size) for name, size in stated.items()}
