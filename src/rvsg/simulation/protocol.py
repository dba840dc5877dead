"""The Simulator protocol: a Scenario, a World and a seed become a Run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

from rvsg.robots.robot import Robot
from rvsg.scenario.scenario import ROBOT, Scenario
from rvsg.simulation.run import Run
from rvsg.world.world import World


class Simulator(Protocol):
    """Anything that runs scenarios. Equal scenario, world, seed and options give an equal run, bit for bit.

    Derive a simulator from this class: `robots`, `any_robot`, `prepare` and `close` have defaults. A simulator
    reaches worker processes by pickling, before or after `prepare`.
    """

    @property
    def name(self) -> str:
        """The registered name, e.g. `embedded`."""
        ...

    @property
    def options(self) -> Mapping[str, object]:
        """The effective options as JSON-able data (a version among them), equal to `options` of every Run.

        With the scenario and the seed they are the run's content id, so that a known run is not simulated again.
        """
        ...

    @property
    def robots(self) -> tuple[str, ...]:
        """The names of the robots it simulates."""
        return (ROBOT,)

    @property
    def any_robot(self) -> bool:
        """Whether it also simulates every robot that a scenario holds as a record."""
        return False

    def notes(self, robot: Robot) -> tuple[str, ...]:
        """Return what a user has to know who simulates this robot."""
        return ()

    def prepare(self, tell: Callable[[str], None]) -> None:
        """Do once what takes long, e.g. compile or connect; `tell` takes messages for people. May be called again."""
        return

    def run(self, scenario: Scenario, world: World, *, seed: int) -> Run:
        """Simulate one episode. Bad starts and unreachable goals are an Outcome, never an exception or a hang."""
        ...

    def close(self) -> None:
        """Release what `prepare` or `run` acquired. May be called again.

        Who makes a simulator or a stack closes it: functions of RVSG leave open what they are given as an instance.
        """
        return
