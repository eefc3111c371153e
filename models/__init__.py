"""The physics of the table: effects, and the engines that play them; independent of measurements.

Read or make a model, and play shots in it:

    from models import Ball, Shot, Table, full_model, load_model, save_model, simulate

    model = load_model("model.toml")                      # or full_model(Table(2.84, 1.42), Ball(0.0615, 0.21))
    track = simulate(model, speed=2, azimuth=0.1)         # prints, .plot(), .frame()
    track = simulate(model, [Shot(("white",), places, velocity, spin, times)])[0]
"""

from typing import TYPE_CHECKING

from models.lazy import lazy

if TYPE_CHECKING:
    from models.effect_catalogue import add_folder as add_effects
    from models.effect_catalogue import catalogue
    from models.errors import BadInput
    from models.interface import simulate
    from models.model_file import Model, full_model
    from models.model_file import read_model as load_model
    from models.model_file import write_model as save_model
    from models.mujoco.world import World
    from models.shot import Ball, Shot, Table, Track

__all__ = [
    "BadInput", "Ball", "Model", "Shot", "Table", "Track", "World", "add_effects", "catalogue", "full_model",
    "load_model", "save_model", "simulate",
]  # fmt: skip
__getattr__, __dir__ = lazy(
    __name__,
    {
        "BadInput": "models.errors:BadInput",
        "Ball": "models.shot:Ball",
        "Model": "models.model_file:Model",
        "Shot": "models.shot:Shot",
        "Table": "models.shot:Table",
        "Track": "models.shot:Track",
        "World": "models.mujoco.world:World",
        "add_effects": "models.effect_catalogue:add_folder",
        "catalogue": "models.effect_catalogue:catalogue",
        "full_model": "models.model_file:full_model",
        "load_model": "models.model_file:read_model",
        "save_model": "models.model_file:write_model",
        "simulate": "models.interface:simulate",
    },
)
