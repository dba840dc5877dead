"""Test doubles and conformance checks for those who write plug-ins.

Run `check_generator`, `check_simulator`, `check_stack`, `check_strategy` or `check_ledger` in the tests of your
plug-in; each raises AssertionError with the first promise that is broken. The doubles are deterministic and need no
model and no files.
"""

from __future__ import annotations

import json
import pickle
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from rvsg.core.errors import GenerationError
from rvsg.core.records import Pose
from rvsg.generation.generator import Generator, Proposal
from rvsg.runs.ledger import MemoryLedger
from rvsg.scenario.brief import Brief
from rvsg.scenario.scenario import Human, HumanAgent, HumanConfiguration, Scenario, Task
from rvsg.scenario.validity import check
from rvsg.search.strategies import check_ledger, check_strategy
from rvsg.simulation.archive import arrays_of, run_from_json, run_to_json
from rvsg.simulation.embedded.simulator import empty_room, simulate_agents
from rvsg.simulation.run import Outcome, Run, run_id
from rvsg.simulation.simulators import Simulator
from rvsg.simulation.stacks.stack_choice import StackChoice, StackLike
from rvsg.world.world import Route, World

__all__ = [
    "MemoryLedger",
    "ScriptedGenerator",
    "WalkingGenerator",
    "check_generator",
    "check_ledger",
    "check_simulator",
    "check_stack",
    "check_strategy",
]

SHORTEST_PATH = 3
"""Waypoints of a walk, at least."""


class ScriptedGenerator(Generator):
    """Answers with prepared people, one configuration after the other, and remembers the briefs.

    Args:
        people: what the briefs are answered with, in order.
        repeat: begin again after the last; otherwise a further brief raises GenerationError.
    """

    name = "scripted"

    def __init__(self, people: Iterable[HumanConfiguration], *, repeat: bool = False) -> None:
        self.people = tuple(people)
        self.repeat = repeat
        self.briefs: list[Brief] = []

    def propose(self, brief: Brief, world: World) -> Proposal:
        """Return the next configuration, checked: an invalid one is a proposal with problems."""
        count = len(self.briefs)
        if not self.people or (count >= len(self.people) and not self.repeat):
            raise GenerationError(f"The script has {len(self.people)} configurations; this is brief {count + 1}.")
        self.briefs.append(brief)
        people = self.people[count % len(self.people)]
        problems = check(people, brief.mission, world)
        scenario = None if problems else Scenario(mission=brief.mission, people=people)
        return Proposal(generator=self.name, scenario=scenario, first_findings=problems, problems=problems)


class WalkingGenerator(Generator):
    """Everybody walks to and fro on a shortest path between two waypoints drawn from the brief's seed."""

    name = "walk"

    def __init__(self) -> None:
        self.briefs: list[Brief] = []

    def propose(self, brief: Brief, world: World) -> Proposal:
        """Return a scenario whose people walk between random waypoints."""
        self.briefs.append(brief)
        chance = np.random.default_rng(brief.seed)
        names = sorted(world.grid.valid)
        humans = []
        for number in range(1, brief.humans + 1):
            path: tuple[str, ...] | None = None
            while path is None or len(path) < SHORTEST_PATH:
                a, b = chance.choice(names, size=2, replace=False)
                path = world.grid.shortest_path(str(a), str(b))
            there = Task.between(path[0], path[-1], path)
            back = Task.between(path[-1], path[0], path[::-1])
            humans.append(Human(name=f"human {number}", tasks=(there, back)))
        people = HumanConfiguration(humans=tuple(humans))
        scenario = Scenario(mission=brief.mission, people=people, description=f"walk {brief.scenario_index}")
        return Proposal(generator=self.name, scenario=scenario)


def check_generator(generator: Generator, briefs: Iterable[Brief], world: World, *, repeatable: bool = True) -> None:
    """Raises AssertionError naming the first thing a generator does that none may do.

    Equal briefs give equal proposals (unless not `repeatable`: an outside model answers); a proposal is valid or
    says why it is not; it is of the mission that was asked; a brief is not changed; only a GenerationError may be
    raised, and a repeatable generator raises none.
    """
    assert generator.name and generator.name == generator.name.strip(), "a generator has a name"
    for brief in briefs:
        before = brief.to_json()
        proposal = _proposed(generator, brief, world, repeatable)
        if proposal is None:
            continue
        assert brief.to_json() == before, f"{generator.name} changed the brief it was given"
        if repeatable:
            again = generator.propose(brief, world)
            assert again.id == proposal.id, f"{generator.name} answered an equal brief differently: seed {brief.seed}"
        for complaint in complaints(proposal, brief, world):
            raise AssertionError(f"{generator.name}, brief {brief.kind} with seed {brief.seed}: {complaint}")


def _proposed(generator: Generator, brief: Brief, world: World, repeatable: bool) -> Proposal | None:
    try:
        return generator.propose(brief, world)
    except GenerationError as error:
        assert not repeatable, f"{generator.name} could not answer: {error}"
        return None


def complaints(proposal: Proposal, brief: Brief, world: World) -> Iterator[str]:
    """What is wrong with a proposal."""
    if not proposal.generator:
        yield "the proposal does not name its generator"
    if proposal.scenario is None:
        if not proposal.problems:
            yield "there is no scenario, and nothing says why"
        return
    if proposal.problems:
        yield "there is a scenario, and problems are left"
    if proposal.scenario.mission != brief.mission:
        yield "the scenario is of another mission than was asked for"
    found = check(proposal.scenario.people, brief.mission, world)
    if found:
        yield f"the scenario is not valid: {found[0]}"
    if len(proposal.scenario.people.humans) != brief.humans:
        yield f"{brief.humans} humans were asked for, {len(proposal.scenario.people.humans)} came"
    if Proposal.from_json(proposal.to_json()).id != proposal.id:
        yield "the proposal does not survive being written and read"


def check_simulator(simulator: Simulator, scenario: Scenario, world: World, *, repeatable: bool = True) -> None:
    """Raises AssertionError naming the first promise that is broken.

    The id of a run is known before it is made; a run names scenario and seed, has a sample for every time and a
    column for every human, only finite numbers, times that increase from 0 to at most the limit, and survives being
    written and read. Equal seeds give equal runs, bit for bit (unless not `repeatable`: a simulator in wall time).
    """
    name = simulator.name
    before = scenario.to_json()
    json.dumps(dict(simulator.options), allow_nan=False)
    runs = [simulator.run(scenario, world, seed=seed) for seed in (0, 1, 2**32 - 1)]
    assert scenario.to_json() == before, f"{name} changed the scenario it was given"
    for run, seed in zip(runs, (0, 1, 2**32 - 1), strict=True):
        expected = run_id(scenario.id, name, simulator.options, seed)
        assert run.id == expected, f"{name}: a run's name, options, scenario or seed are not those that were asked for"
        _check_run(name, run, scenario)
    if repeatable:
        assert same_run(simulator.run(scenario, world, seed=1), runs[1]), f"{name}: equal seeds give different runs"


def same_run(one: Run, other: Run) -> bool:
    """Whether two runs are equal, bit for bit."""
    a, b = arrays_of(one), arrays_of(other)
    return one.id == other.id and one.outcome is other.outcome and all(np.array_equal(a[key], b[key]) for key in a)


def _check_run(name: str, run: Run, scenario: Scenario) -> None:
    humans = scenario.people.humans
    assert run.human_names == tuple(human.name for human in humans), f"{name}: the humans are not those of the scenario"
    for what, path in (("trajectory", run.trajectory), ("log", run.log)):
        assert len(path) > 0, f"{name}: the {what} is empty; a run that ends at once still has a sample"
        assert path.human_x.shape == (len(path), len(humans)), f"{name}: {what}.human_x has shape {path.human_x.shape}"
        assert path.t[0] >= 0.0 and (np.diff(path.t) > 0).all(), f"{name}: the times of the {what} do not increase"
    limit = scenario.mission.route.time_limit_s
    assert run.trajectory.t[-1] <= limit + 5.0, (
        f"{name}: the run lasts {run.trajectory.t[-1]} s, its limit is {limit} s"
    )
    for key, array in arrays_of(run).items():
        assert np.isfinite(array).all(), f"{name}: {key} holds numbers that are not finite"
    assert same_run(run_from_json(run_to_json(run)), run), f"{name}: the run does not survive being written and read"


WAYS = (
    (Pose(x=-2.0, y=0.0), Pose(x=1.8, y=0.0)),
    (Pose(x=1.5, y=-1.5, yaw=3.0), Pose(x=-1.5, y=1.5, yaw=1.5)),
)


def check_stack(stack: StackLike, options: Mapping[str, Any] | None = None, *, time_limit_s: float = 40.0) -> str:
    """Examine a navigation stack in a small room with one person; return the verdict in one sentence.

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
    told = first.details["stack"]
    return (
        f"{name} {choice.record.version} passes: it crosses an empty room in {first.trajectory.t[-1]:.1f} s with "
        f"{told['calls']} calls, of which {told['without_command']} without a command and {told['clipped']} beyond the "
        "robot's limits, and equal seeds give equal runs."
    )


def _drive(choice: StackChoice, way: tuple[Pose, Pose], time_limit_s: float) -> Run:
    route = Route(name="exam", start=way[0], goal=way[1], time_limit_s=time_limit_s)
    human = HumanAgent(name="human", start=(2.0, 2.0), goals=((2.0, 2.0), (1.0, 2.0)), pauses_s=(0.0, 0.0))
    return simulate_agents(empty_room(), route, [human], seed=1, scenario_id="exam", stack=choice)
