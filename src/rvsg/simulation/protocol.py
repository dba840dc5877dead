"""The Simulator protocol: a Scenario, a World and a seed become a Run."""

from __future__ import annotations

from collections.abc import Mapping
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

    @property
    def options(self) -> Mapping[str, object]:
        """The effective options as JSON-able data (its version among them), equal to `options` of every Run it makes.

        With the scenario and the seed they are the run's content id, so that a known run is not simulated again.
        """
        ...

    def run(self, scenario: Scenario, world: World, *, seed: int) -> Run:
        """Simulate one episode. Bad starts and unreachable goals are an Outcome, never an exception or a hang."""
        ...
