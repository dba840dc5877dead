"""The planner that the stack under test has."""

from __future__ import annotations

from rvsg.core.compiled import inner
from rvsg.simulation.embedded.navigation.planners.navfn import plan
from rvsg.simulation.embedded.navigation.planners.smac_2d import plan_smac
from rvsg.simulation.embedded.navigation.planners.theta_star import plan_theta
from rvsg.simulation.embedded.scene import Scene
from rvsg.simulation.embedded.stack import PLANNERS
from rvsg.simulation.embedded.state import State

SMAC_2D, THETA_STAR = PLANNERS.index("smac_2d"), PLANNERS.index("theta_star")


@inner
def plan_with(scene: Scene, state: State, x: float, y: float, goal_x: float, goal_y: float) -> int:
    """Plan from start to goal (map frame) into the first layer of `state.path`; return the number of points."""
    stack, path = state.stack, state.path[0]
    if stack.planner == SMAC_2D:
        return plan_smac(
            path, x, y, goal_x, goal_y, state.global_master, scene.origin_x, scene.origin_y, scene.resolution,
            stack.smac_cost, stack.smac_tolerance,
        )  # fmt: skip
    if stack.planner == THETA_STAR:
        return plan_theta(
            path, x, y, goal_x, goal_y, state.global_master, scene.origin_x, scene.origin_y, scene.resolution,
            stack.theta_length, stack.theta_cost,
        )  # fmt: skip
    return plan(
        path, 0, x, y, goal_x, goal_y, state.global_master, state.costs, scene.reach, state.rest, state.potential,
        state.waiting, state.buffers, state.cells, scene.origin_x, scene.origin_y, scene.resolution,
        stack.plan_tolerance,
    )  # fmt: skip
