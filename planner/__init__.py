"""Planning of shots in a fitted model: scenes, strokes and their errors, search, plans, reports and studies.

Read a scene and plan its shot:

    from planner import plan, read_scene

    made = plan(read_scene("scene.toml"), model)        # prints; billiard-plan/1: made["stroke"]; .plot(), .report(...)
"""

from typing import TYPE_CHECKING

from models.lazy import lazy

if TYPE_CHECKING:
    from planner.evaluation.value import UtilityWeights
    from planner.interface import plan
    from planner.launcher.execution import Execution
    from planner.scene import Goal, Scene, read_scene

__all__ = ["Execution", "Goal", "Scene", "UtilityWeights", "plan", "read_scene"]
__getattr__, __dir__ = lazy(
    __name__,
    {
        "Execution": "planner.launcher.execution:Execution",
        "Goal": "planner.scene:Goal",
        "Scene": "planner.scene:Scene",
        "UtilityWeights": "planner.evaluation.value:UtilityWeights",
        "plan": "planner.interface:plan",
        "read_scene": "planner.scene:read_scene",
    },
)
