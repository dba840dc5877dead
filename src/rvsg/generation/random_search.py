"""The random generator: the study's random search. It knows the map and the rules, and nothing of the requirement.

The number of tasks (2 to 20) is drawn uniformly, then areas, then a waypoint of each, joined by the shortest valid
path. In worlds that name `actors`, some people are children, sit in wheelchairs or push trolleys, and objects are left
beside the robot's way. Everything it draws is valid.
"""

from __future__ import annotations

import math

import numpy as np

from rvsg.generation.descriptions import answer, nowhere_to_walk
from rvsg.generation.generator import Generator, Proposal, rng_of
from rvsg.generation.people_sampler import cast, left_behind
from rvsg.generation.workplaces import Place, places_of, walking_graph
from rvsg.scenario.activity import Activity
from rvsg.scenario.brief import Brief
from rvsg.scenario.placement import robot_reach_m
from rvsg.scenario.rules import START_CLEARANCE_M
from rvsg.scenario.scenario import BODY_RADIUS_M, ForceFactors, Human, HumanConfiguration, Pause, Task
from rvsg.world.world import World


class RandomGenerator(Generator):
    """Random search: tasks between random areas. Refinements are drawn again like everything else.

    `tasks` is the smallest and largest number of tasks of a person. `individuals`: as in the study, everybody but
    the first draws the weights of their forces again at every launch; False gives everybody the default weights.
    `works`: people do something where a task ends and take the way with few turns; False: as in the study.
    """

    name = "random"

    def __init__(self, *, tasks: tuple[int, int] = (2, 20), individuals: bool = True, works: bool = True) -> None:
        if not 2 <= tasks[0] <= tasks[1]:
            raise ValueError(f"expected at least 2 tasks and the smaller number first, got {tasks}")
        self.tasks = tasks
        self.individuals, self.works = individuals, works

    def propose(self, brief: Brief, world: World) -> Proposal:
        """Draw a configuration from the brief's seed."""
        places = places_of(world, reachable_from=brief.mission.route.start)
        if len({name for place in places for name in place.waypoints}) < 2:
            return nowhere_to_walk(world, generator=self.name)
        rng = rng_of(brief, self.name)
        humans: list[Human] = []
        for _ in range(brief.humans):
            humans.append(self._human(humans, places, brief, world, rng))
        others = rng_of(brief, f"{self.name}/actors")
        if world.actors:
            humans = cast(humans, None, None, brief.mission, world, others, anybody=True)
        counts = ", ".join(f"{human.name} {len(human.tasks)}" for human in humans)
        return answer(
            HumanConfiguration(humans=tuple(humans)),
            brief,
            world,
            generator=self.name,
            described=None,
            reasoning=f"Drawn at random from {len(places)} places; tasks: {counts}. Nothing was aimed.",
            moved=left_behind(humans, brief.mission, world, others),
        )

    def _human(
        self, others: list[Human], places: tuple[Place, ...], brief: Brief, world: World, rng: np.random.Generator
    ) -> Human:
        """One person: a cyclic list of tasks between random places, from a start that is clear of everybody else."""
        number = int(rng.integers(self.tasks[0], self.tasks[1] + 1))
        robot, grid = brief.mission.route.start, world.grid
        taken = [((robot.x, robot.y), robot_reach_m(brief.mission) + BODY_RADIUS_M + START_CLEARANCE_M)]
        taken += [(grid.position(o.tasks[0].path[0]), o.body_radius_m + BODY_RADIUS_M) for o in others]
        for _ in range(100):  # then whatever came
            drawn = _draw(places, set(), set(), rng)
            assert drawn is not None
            place, begins = drawn
            if all(math.dist(grid.position(begins), at) >= apart for at, apart in taken):
                break
        stops = [(place, begins)]
        while len(stops) < number:
            (before, at), (first, start) = stops[-1], stops[0]
            # The last stop must differ from the first one too: from there the person goes back to the start.
            barred = {before.name, first.name} if len(stops) == number - 1 and len(places) > 2 else {before.name}
            stop = _draw(places, barred, {at, start}, rng)
            if stop is None:  # a world of a few waypoints, all visited
                break
            stops.append(stop)
        tasks = []
        ground = walking_graph(world, brief.mission.route)
        for (place, start), (goal, end) in zip(stops, [*stops[1:], stops[0]], strict=True):
            path = ground.path(start, end, straight=True) if self.works else None
            path = path or grid.shortest_path(start, end)
            assert path is not None
            tasks.append(Task.between(place.name, goal.name, path, self._work(end, rng)))
        return Human(
            name=f"Human {len(others) + 1}",
            tasks=tuple(tasks),
            factors="random_normal" if self.individuals and others else ForceFactors(),
        )

    def _work(self, at: str, rng: np.random.Generator) -> tuple[Pause, ...]:
        if not self.works:
            return ()
        doing = (*Activity,)[int(rng.integers(len(Activity)))]
        return (Pause(at=at, duration_s=doing.drawn_s(rng), doing=doing),)


def _draw(
    places: tuple[Place, ...], barred: set[str], waypoints: set[str], rng: np.random.Generator
) -> tuple[Place, str] | None:
    """A place, and one of its waypoints, each uniformly among those that are not barred; None where all are."""
    open_places = [p for p in places if p.name not in barred and set(p.waypoints) - waypoints]
    if not open_places:
        return None
    place = open_places[int(rng.integers(len(open_places)))]
    names = [name for name in place.waypoints if name not in waypoints]
    return place, names[int(rng.integers(len(names)))]
