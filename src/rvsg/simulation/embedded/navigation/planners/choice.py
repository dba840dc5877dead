"""The planner that the stack under test has."""

from __future__ import annotations

from rvsg.core.kernels import inner
from rvsg.simulation.embedded import state as st
from rvsg.simulation.embedded.navigation.planners.navfn import plan
from rvsg.simulation.embedded.navigation.planners.smac_2d import plan_smac
from rvsg.simulation.embedded.navigation.planners.theta_star import plan_theta
from rvsg.simulation.embedded.scene import Scene
from rvsg.simulation.embedded.stack import PLANNERS
from rvsg.simulation.embedded.state import State

NAVFN, SMAC_2D = PLANNERS.index("navfn"), PLANNERS.index("smac_2d")


@inner
def plan_navfn(scene: Scene, state: State, x: float, y: float, goal_x: float, goal_y: float) -> int:
    """Plan from start to goal (map frame) into the first layer of `state.path`; return the number of points."""
    return plan(
        state.path[0], 0, x, y, goal_x, goal_y, state.global_master, state.costs, scene.reach, state.rest,
        state.potential, state.waiting, state.buffers, state.cells, scene.origin_x, scene.origin_y, scene.resolution,
        state.stack.plan_tolerance,
    )  # fmt: skip


def plan_outside(scene: Scene, state: State) -> None:
    """Plan with another planner, which is not part of the compiled loop: it is compiled only for runs that use it."""
    stack, (goal_x, goal_y, _) = state.stack, state.goals[state.nav[st.GOAL]].tolist()
    x, y = state.times[st.PLAN_X : st.PLAN_Y + 1].tolist()
    ends = (state.path[0], x, y, goal_x, goal_y)
    grid = (state.global_master, scene.origin_x, scene.origin_y, scene.resolution)
    if stack.planner == SMAC_2D:
        count = plan_smac(*ends, *grid, stack.smac_cost, stack.smac_tolerance)
    else:
        count = plan_theta(*ends, *grid, stack.theta_length, stack.theta_cost)
    state.nav[st.OUTSIDE_PLAN] = st.PLANNED_FROM + count
