"""The rig of a series on the emulator: table and launcher with hidden constants, balls placed with errors.

In: the hidden model and cueing constants, and a seed. Out: a `robot.learning.loop.Rig`. `draw_hidden_table` draws a
table that differs from the textbook as real ones do: by the spread of published constants, and by one effect of the
catalogue at its natural size. The launcher's constants are drawn by robot/cueing/hidden.py.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from models.analytic.cue_impulse import Constants
from models.effect_catalogue import effect_class
from models.model_file import Model
from models.shot import Array
from planner.scene import Scene
from robot.cueing.hidden import draw_values
from robot.device.settings import Settings
from robot.emulator.table import EmulatedOptions, EmulatedTable, emulated_launcher
from robot.learning.loop import SceneSetup
from robot.order import read_order

HAND_PLACING_SD_M = 2e-3  # error of a ball put by hand on its marked place, each axis
PLACING_STREAM, FIRMWARE_STREAM, TABLE_STREAM = range(3)  # independent streams of random numbers
# Ranges of constants, relative to the textbook's: rolling friction 0.005 to 0.015, sliding friction 0.15 to 0.4,
# restitution of cushions 0.7 to 0.98, of balls 0.87 to 0.98 (Alciatore, Mathavan 2010, 2014).
TABLE_OFFSET_RANGE = {
    "decoupled_cloth.slide": 0.25, "decoupled_cloth.roll": 0.3, "decoupled_cloth.spin": 0.4,
    "ball_impact.restitution": 0.04, "ball_impact.friction": 0.4,
    "cushion_impact.restitution": 0.08, "cushion_impact.friction": 0.4,
}  # fmt: skip
HIDDEN_EFFECTS = (
    "table_tilt",
    "cloth_nap",
    "speed_drag",
    "side_curve",
    "slide_friction_speed",
    "cushion_restitution_speed",
)


def draw_hidden_table(start: Model, rng: np.random.Generator, effect: str | None = None) -> Model:
    """A hidden table with the size of `start`, other constants, and an effect at its natural size.

    Every constant deviates by half to all of its range, in either direction, as on a table that was never measured.
    """
    values = {}
    for name, width in TABLE_OFFSET_RANGE.items():
        least, most = start.meta(name)["bounds"]
        off = width * rng.uniform(0.5, 1.0) * rng.choice([-1.0, 1.0])
        values[name] = float(np.clip(start.parameters()[name] * (1.0 + off), least, most))
    kind = effect_class(effect or HIDDEN_EFFECTS[int(rng.integers(len(HIDDEN_EFFECTS)))])
    return start.with_values(values).add(kind())


def draw_hidden_cue(rng: np.random.Generator) -> Constants:
    """Hidden constants of an emulated launcher."""
    return Constants(**draw_values(rng, "tip_friction"))


@dataclass
class EmulatedRig:
    """An automatic rig that sets up, turns, strikes and films; every shot has its own random numbers."""

    model: Model  # hidden
    cue: Constants  # hidden
    settings: Settings = field(default_factory=Settings)
    seed: int = 0
    repeats: int = 20  # repeats of every stroke, to measure the launcher's scatter
    make: Callable[..., EmulatedTable] = EmulatedTable  # called with the arguments of EmulatedTable
    table: EmulatedTable | None = None

    def set_up(self, scene: Scene, number: int) -> SceneSetup:
        """Set up the balls of a shot."""
        rng = np.random.default_rng([self.seed, number, PLACING_STREAM])
        limit = scene.table.centre_limits(scene.ball)
        placed = np.clip(scene.position + HAND_PLACING_SD_M * rng.standard_normal(scene.position.shape), -limit, limit)
        self.table = self._table(scene, placed, number, 0)
        launcher, _ = emulated_launcher(self.settings, self.table.hit, self._rng(number, 0), say=lambda line: None)
        return SceneSetup(self.table, launcher, self.table.turn_to)

    def repeat(self, plan: Path, number: int) -> Array | None:
        """Repeat the stroke from the same positions; returns the end points of the cue ball (n, 2) [m]."""
        if not self.repeats:
            return None
        order = read_order(plan, self.settings)
        ends = []
        for k in range(1, self.repeats + 1):
            table = self._table(order.scene, order.scene.position, number, k)
            table.turn_to(np.radians(order.yaw_deg))
            launcher, _ = emulated_launcher(self.settings, table.hit, self._rng(number, k), say=lambda line: None)
            with launcher:
                launcher.home()
                launcher.move_tip(order.x0_mm, order.y0_mm)
                launcher.strike(order.string)
            seen = table.look()
            if order.scene.names[0] in seen:
                ends.append(seen[order.scene.names[0]])
        return np.array(ends).reshape(-1, 2)

    def _table(self, scene: Scene, position: Array, number: int, repeat: int) -> EmulatedTable:
        places = {n: (float(x), float(y)) for n, (x, y) in zip(scene.names, position, strict=True)}
        seed = int(np.random.SeedSequence([self.seed, number, TABLE_STREAM, repeat]).generate_state(1)[0])
        return self.make(self.model, places, 0.0, seed, EmulatedOptions(constants=self.cue))

    def _rng(self, number: int, repeat: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, number, FIRMWARE_STREAM, repeat])
