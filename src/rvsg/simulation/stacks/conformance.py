"""What every navigation stack promises, as one check to run in the tests of yours."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from typing import Any

from rvsg.core.records import Pose
from rvsg.scenario.scenario import HumanAgent
from rvsg.simulation.conformance import same_run
from rvsg.simulation.embedded.rehearsal import empty_room
from rvsg.simulation.embedded.simulator import simulate_agents
from rvsg.simulation.run import Outcome, Run
from rvsg.simulation.stacks.registry import StackChoice, StackLike
from rvsg.world.world import Route

WAYS = (
    (Pose(x=-2.0, y=0.0), Pose(x=1.8, y=0.0)),
    (Pose(x=1.5, y=-1.5, yaw=3.0), Pose(x=-1.5, y=1.5, yaw=1.5)),
)


def check_stack(stack: StackLike, options: Mapping[str, Any] | None = None, *, time_limit_s: float = 40.0) -> list[Run]:
    """Examine a navigation stack in a small room with one person; return its runs.

    Raises:
        AssertionError: with the first promise that is broken.
        InputError: the stack cannot be made.
    """
    choice = StackChoice.of(stack, options)
    name = choice.record.name
    assert choice.record.version, f"{name} has no version"
    assert StackChoice.of(stack, options).record == choice.record, (
        f"{name}: its options or version change by themselves"
    )
    driver = choice.driver
    driver.prepare(lambda _: None)
    driver.prepare(lambda _: None)
    pickle.loads(pickle.dumps(driver))  # noqa: S301  (our own bytes)
    first, between = (_drive(choice, way, time_limit_s) for way in WAYS)
    again = _drive(choice, WAYS[0], time_limit_s)
    for run in (first, between):
        told: Any = run.details["stack"]
        assert "fault" not in told, f"{name} failed after {told['fault_t']} s: {told['fault']}"
        assert told["calls"] > 0, f"{name} was never asked"
        assert told["not_finite"] == 0, f"{name} answered with numbers that are not finite"
    assert same_run(first, again), f"{name}: equal seeds give different runs; does `reset` forget everything?"
    assert first.outcome is Outcome.REACHED, f"{name} does not cross an empty room: {first.outcome.value}"
    driver.close()
    driver.close()
    driver.prepare(lambda _: None)
    assert same_run(first, _drive(choice, WAYS[0], time_limit_s)), f"{name} drives differently after `close`"
    driver.close()
    return [first, between]


def _drive(choice: StackChoice, way: tuple[Pose, Pose], time_limit_s: float) -> Run:
    route = Route(name="exam", start=way[0], goal=way[1], time_limit_s=time_limit_s)
    human = HumanAgent(name="human", start=(2.0, 2.0), goals=((2.0, 2.0), (1.0, 2.0)), pauses_s=(0.0, 0.0))
    return simulate_agents(empty_room(), route, [human], seed=1, scenario_id="exam", stack=choice)
