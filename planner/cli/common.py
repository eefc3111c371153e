"""What the verbs of the `planner` command share: the model and the launcher's repeatability, as named or as usual."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from models.model_file import Model
    from planner.launcher.execution import Execution
    from planner.scene import Scene


def load_model(path: str | None, asked: Scene) -> Model:
    """The model named, or the base with the constants of its catalogue; BadInput where it is of another table."""
    from models.model_file import full_model, read_model

    if not path:
        print("no --model: the base with its usual constants, taken for exact; fit yours with: sysid discover CLIPS")
        return full_model(asked.table, asked.ball)
    return read_model(path)


def load_execution(path: str | None, model: Model) -> Execution:
    """The launcher's repeatability: as given, as the model file has it, or the usual one."""
    from planner.launcher.execution import Execution, execution_from, read_execution

    if path:
        return read_execution(path)
    if model.execution:
        return execution_from(model.execution, "model file")
    usual = Execution()
    print(
        f"no --execution, and none in the model: {100 * usual.speed_sd:g} % of the speed, "
        f"{1e3 * usual.azimuth_sd:g} mrad of azimuth, {1e3 * usual.side_sd:g} mm of the tip (standard deviations)"
    )
    return usual
