"""Generators for tests: one that gives prepared scenarios, one whose people walk to and fro."""

from __future__ import annotations

from collections.abc import Iterable

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
