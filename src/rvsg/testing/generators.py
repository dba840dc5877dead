"""Generators for tests, and the promises that every generator keeps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from rvsg.core.errors import GenerationError
from rvsg.generation.generator import Generator, Proposal
from rvsg.scenario.brief import Brief
from rvsg.scenario.scenario import Human, HumanConfiguration, Scenario, Task
from rvsg.scenario.validity import check
from rvsg.world.world import World

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
