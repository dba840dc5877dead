"""The built-in Nav2 with DWB as local planner; it runs within the compiled loop."""

from __future__ import annotations

from typing import ClassVar

from rvsg.simulation.stacks.protocol import LocalObservation, LocalPlanner, Task


class Nav2Dwb(LocalPlanner):
    """Nav2 with DWB, NavFn and the default behaviour tree, with the parameters of the robot."""

    name: ClassVar[str] = "nav2-dwb"
    title: ClassVar[str] = "Nav2 (Humble) with DWB, NavFn and the default behaviour tree"
    answer_time_s: ClassVar[float | None] = None

    def reset(self, task: Task) -> None:
        """Do nothing: the compiled loop holds the planner."""

    def command(self, seen: LocalObservation) -> tuple[float, float] | None:
        """Never called."""
        raise NotImplementedError("nav2-dwb runs within the compiled loop")
