"""The built-in Nav2 with DWB as local planner; it runs within the compiled loop."""

from __future__ import annotations

from typing import Any, ClassVar

from pydantic import Field

from rvsg.simulation.stacks.configured import Configured, Nav2Settings
from rvsg.simulation.stacks.protocol import LocalObservation, Task


class DwbSettings(Nav2Settings):
    """The options of `nav2-dwb`."""

    dwb: dict[str, Any] = Field(default_factory=dict)
    """Keys of the robot's `navigation.dwb`."""


class Nav2Dwb(Configured):
    """Nav2 with DWB, NavFn and the default behaviour tree, by default with the parameters of the robot."""

    name: ClassVar[str] = "nav2-dwb"
    title: ClassVar[str] = "Nav2 (Humble) with DWB, NavFn and the default behaviour tree"
    Settings: ClassVar[type[Nav2Settings]] = DwbSettings

    @property
    def options(self) -> dict[str, Any]:
        """The options that differ from the robot's own parameters."""
        return {key: value for key, value in super().options.items() if key in self.settings.model_fields_set}

    def reset(self, task: Task) -> None:
        """Do nothing: the compiled loop holds the planner."""

    def command(self, seen: LocalObservation) -> tuple[float, float] | None:
        """Never called."""
        raise NotImplementedError("nav2-dwb runs within the compiled loop")
