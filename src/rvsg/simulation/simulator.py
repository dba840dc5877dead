"""The Simulator protocol: a Scenario, a World and a seed become a Run."""

from __future__ import annotations

from typing import Protocol

from rvsg.scenario.scenario import Scenario
from rvsg.simulation.run import Run
from rvsg.world.world import World


class Simulator(Protocol):
    """Anything that runs scenarios. Equal scenario, world, seed and version give an equal run, bit for bit."""

    @property
    def name(self) -> str:
        """The name it is chosen by, e.g. `embedded`."""
        ...

    def run(self, scenario: Scenario, world: World, *, seed: int) -> Run:
        """Simulate one episode. Bad starts and unreachable goals are an Outcome, never an exception or a hang."""
        ...
