"""The models that are put to the test: MuJoCo's native terms, and MJCF with effects.

In: table and shots. Out: the tracks that MuJoCo makes of them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

from models.model_file import Model
from models.shot import Shot, Table, Track
from models.simulation.simulate import simulate
from models.table.snooker import SNOOKER_BALL
from sysid.validation.shots import (
    ANALYTIC_MODEL,
    MATHAVAN_TABLE,
)

SETTLING_TIME_S = {"native": 3e-3, "effects": 6e-4, "analytic": 1e-5}  # time from the touch until the contact is over


@dataclass(frozen=True)
class ModelUnderTest:
    """A model of the table in MuJoCo."""

    name: str
    model: Model

    def __call__(self, table: Table, shots: Sequence[Shot]) -> list[Track]:
        """Play shots; returns their tracks."""
        return simulate(dataclasses.replace(self.model, table=table), shots)


def in_mujoco(model: Model) -> Model:
    """The model, simulated by MuJoCo."""
    return dataclasses.replace(model, engine="mujoco")


def models_under_test() -> tuple[ModelUnderTest, ModelUnderTest]:
    """The tested models: native MJCF, and MJCF with effects."""
    native, effects = Model(MATHAVAN_TABLE, SNOOKER_BALL), ANALYTIC_MODEL
    return ModelUnderTest("native", in_mujoco(native)), ModelUnderTest("effects", in_mujoco(effects))
