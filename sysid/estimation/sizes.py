"""Length and width of the table and diameter of the balls as constants of a fit, known as well as they are measured.

A table that is a few millimetres longer than stated is no stretched picture: cushions stand elsewhere, and lines of
balls do not. Left as stated it shows as camera, slope or nap that are not there. So sizes are constants like others,
whose prior is what was stated; clips in which balls meet cushions and each other determine them ten times better.
"""

from __future__ import annotations

from models.model_file import Model
from models.sizes import BALL_DIAMETER, SIZE_NAMES, TABLE_LENGTH, TABLE_WIDTH, stated_size
from sysid.estimation.problem import by_events

TAPE_SD = 0.003  # of a length: noses give way, and a tape sags and is held by hand: 5 to 10 mm on 3.5 m
CALIPER_SD = 0.005  # of a diameter: jaws beside the widest place, and balls of a set differ by 0.1 to 0.3 mm
SIZE_SDS = {TABLE_LENGTH: TAPE_SD, TABLE_WIDTH: TAPE_SD, BALL_DIAMETER: CALIPER_SD}


def with_free_sizes(model: Model) -> Model:
    """The model with its sizes among its constants; as it is where MuJoCo plays it, which builds a world for each."""
    if not by_events(model):
        return model
    stated = {name: stated_size(name, model.table, model.ball) for name in SIZE_NAMES}
    return model.with_values(stated | dict(model.sizes))


def known_sizes(model: Model) -> dict[str, tuple[float, float]]:
    """What is known of the sizes that are constants beside the clips: as stated, and its standard deviation [m]."""
    stated = {name: stated_size(name, model.table, model.ball) for name in model.sizes}
    return {name: (size, SIZE_SDS[name] * size) for name, size in stated.items()}
