"""Shared by the `planner` verbs: the model and the launcher's repeatability."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from models.commands.options import input_option

if TYPE_CHECKING:
    from models.model_file import Model
    from planner.launcher.execution import Execution
    from planner.scene import Scene


model_option = input_option("model", "M.toml", "Fitted model; by default the base with its usual constants.")
execution_option = input_option("execution", "E.toml", "Repeatability of the launcher; by default the model file's.")


def load_model(path: Path | None, asked: Scene) -> Model:
    """The model from a file, or the base with the usual constants for the scene's table."""
    from models.model_file import full_model, read_model

    if not path:
        print("no --model: using the base with its usual constants; fit your own with: sysid discover CLIPS")
        return full_model(asked.table, asked.ball)
    return read_model(path)


def load_execution(path: Path | None, model: Model) -> Execution:
    """The launcher's repeatability from a file, else from the model file, else the usual one."""
    from planner.launcher.execution import Execution, execution_from, read_execution

    if path:
        return read_execution(path)
    if model.execution:
        return execution_from(model.execution, "model file")
    usual = Execution()
    print(
        f"no --execution, and none in the model: assuming {100 * usual.speed_sd:g} % of the speed, "
        f"{1e3 * usual.azimuth_sd:g} mrad of azimuth, {1e3 * usual.side_sd:g} mm of the tip (standard deviations)"
    )
    return usual
