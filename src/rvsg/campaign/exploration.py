"""Exploration of a scenario's ranges, and coverage of a world by scenarios and their runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from rvsg.core.records import Record
from rvsg.evaluation.detection import EncounterKind, encounters_of
from rvsg.evaluation.statistics import Sensitivity, Surface
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Behaviour, Scenario
from rvsg.scenario.variation import Range, waypoints_used
from rvsg.simulation.run import Run
from rvsg.world.world import World

FEWEST = 10
"""The least number of runs a surface is fitted to."""


class Point(Record):
    """One point of the ranges, and the run made there."""

    values: tuple[float, ...]
    """In the order of the ranges."""
    seed: int
    problems: tuple[str, ...] = ()
    """Why the scenario at this point is not valid; then it is not run."""
    objective: float | None = None
    violated: bool | None = None
    outcome: str = ""


class Exploration(Record):
    """How the violation probability depends on the ranges of a scenario."""

    scenario: Scenario
    """With every range at its middle."""
    ranges: tuple[Range, ...]
    requirement: Requirement
    simulator: str
    seed: int
    points: tuple[Point, ...]
    violations: int
    runs: int
    """Runs with a value of the objective."""
    interval: tuple[float, float]
    """95 % interval of the violation probability over all of the ranges (Clopper-Pearson)."""
    surface: Surface | None = None
    """None with fewer than `FEWEST` runs."""
    sensitivities: tuple[Sensitivity, ...] = ()

    @property
    def judged(self) -> tuple[Point, ...]:
        """The points whose run has a value."""
        return tuple(point for point in self.points if point.violated is not None)


def shares_of(ranges: Sequence[Range], points: Sequence[Point]) -> NDArray[np.float64]:
    """Return points (N, D) as shares of their ranges, 0 to 1."""
    low = np.array([each.low for each in ranges])
    size = np.array([each.high - each.low for each in ranges])
    shares: NDArray[np.float64] = (np.array([point.values for point in points]) - low) / size
    return shares


class Count(Record):
    """How often something was exercised."""

    name: str
    scenarios: int = 0
    """Different scenarios that ask for it."""
    runs: int = 0
    """Runs in which it happens; 0 if no run is known."""

    @property
    def tested(self) -> bool:
        """Return whether a scenario asks for it or a run shows it."""
        return bool(self.scenarios or self.runs)


class MetAt(Record):
    """Where the robot meets people: a waypoint and the number of encounters nearest to it."""

    waypoint: str
    encounters: int


class RouteCoverage(Record):
    """What was exercised on one route."""

    route: str
    scenarios: int
    runs: int
    requirements: dict[str, int]
    """Scenarios judged by each requirement."""
    encounters: dict[str, int]
    """Runs with an encounter of each kind."""


class Coverage(Record):
    """What was exercised of one world. Everything that exists is listed; what has no count is untested."""

    world: str
    world_id: str
    scenarios: int
    """Different scenarios."""
    runs: int
    """Different runs that were read for encounters."""
    areas: tuple[Count, ...]
    """Labelled areas; `scenarios` in which a person passes one of its waypoints."""
    routes: tuple[RouteCoverage, ...]
    behaviours: tuple[Count, ...]
    requirements: tuple[Count, ...]
    encounters: tuple[Count, ...]
    waypoints: dict[str, int]
    """Scenarios in which a person passes a waypoint."""
    met_at: tuple[MetAt, ...]

    @property
    def untested(self) -> dict[str, tuple[str, ...]]:
        """What nothing exercises, by its kind.

        A pair is a route with a scenario and a requirement in use elsewhere. Encounters are of routes with a run.
        """

        def names(counts: Sequence[Count]) -> tuple[str, ...]:
            return tuple(each.name for each in counts if not each.tested)

        used = {each.name for each in self.requirements if each.tested}
        found = {
            "routes": tuple(each.route for each in self.routes if not each.scenarios),
            "areas": names(self.areas),
            "behaviours": names(self.behaviours),
            "requirements": names(self.requirements),
            "pairs": tuple(
                f"{route.route} with {name}"
                for route in self.routes
                if route.scenarios
                for name, count in route.requirements.items()
                if not count and name in used
            ),
            "encounters": tuple(
                f"{kind} on {route.route}"
                for route in self.routes
                if route.runs
                for kind, count in route.encounters.items()
                if not count
            ),
        }
        return {kind: names for kind, names in found.items() if names}


class Exercise:
    """Collects what was exercised of one world. A scenario and a run count once, however often they are added.

    Args:
        requirements: Those that could be tested, besides those that are.
    """

    def __init__(self, world: World, requirements: Iterable[str] = ()) -> None:
        self.world, self.requirements = world, requirements
        self._scenarios: dict[str, Scenario] = {}
        self._asked: dict[str, set[str]] = {}
        self._runs: set[str] = set()
        self._met: Counter[str] = Counter()
        self._encounters: Counter[tuple[str, str]] = Counter()
        self._behaved: Counter[str] = Counter()
        self._route_runs: Counter[str] = Counter()

    def add(self, scenario: Scenario, requirements: Iterable[str]) -> None:
        """Add a scenario and the requirements it is judged by."""
        self._scenarios.setdefault(scenario.id, scenario)
        self._asked.setdefault(scenario.id, set()).update(requirements)

    def add_run(self, run: Run) -> None:
        """Add a run of a scenario that was added; a run of another one is ignored."""
        scenario = self._scenarios.get(run.scenario_id)
        if scenario is None or run.id in self._runs:
            return
        self._runs.add(run.id)
        route = scenario.mission.route.name
        self._route_runs[route] += 1
        self._behaved.update({human.behaviour.value for human in scenario.people.humans})
        met = encounters_of(run, world=self.world)
        self._met.update(each.place.waypoint for each in met)
        self._encounters.update({(route, each.kind.value) for each in met})

    def coverage(self) -> Coverage:
        """Return what was exercised so far."""
        scenarios, kinds = self._scenarios.values(), [kind.value for kind in EncounterKind]
        passed = Counter(name for each in scenarios for name in set(waypoints_used(each.people)))
        asked = sorted({*self.requirements, *(name for names in self._asked.values() for name in names)})
        used = {each.id: set(waypoints_used(each.people)) for each in scenarios}
        acted = Counter(b for each in scenarios for b in {h.behaviour.value for h in each.people.humans})
        judged = Counter(name for names in self._asked.values() for name in names)
        own = sorted(each.mission.route.name for each in scenarios)
        happened: Counter[str] = Counter()
        for (_, kind), count in self._encounters.items():
            happened[kind] += count
        return Coverage(
            world=self.world.name,
            world_id=self.world.id,
            scenarios=len(self._scenarios),
            runs=len(self._runs),
            areas=tuple(
                Count(name=area.name, scenarios=sum(bool(used[each] & set(area.waypoints)) for each in used))
                for area in self.world.areas
            ),
            routes=tuple(
                self._route(name, asked, kinds)
                for name in dict.fromkeys([*(route.name for route in self.world.routes), *own])
            ),
            behaviours=tuple(
                Count(name=b.value, scenarios=acted[b.value], runs=self._behaved[b.value]) for b in Behaviour
            ),
            requirements=tuple(Count(name=name, scenarios=judged[name]) for name in asked),
            encounters=tuple(Count(name=kind, runs=happened[kind]) for kind in kinds),
            waypoints={w.name: passed[w.name] for w in self.world.grid.waypoints if w.human},
            met_at=tuple(
                MetAt(waypoint=name, encounters=count)
                for name, count in sorted(self._met.items(), key=lambda pair: (-pair[1], pair[0]))
            ),
        )

    def _route(self, name: str, asked: Sequence[str], kinds: Sequence[str]) -> RouteCoverage:
        own = [key for key, each in self._scenarios.items() if each.mission.route.name == name]
        return RouteCoverage(
            route=name,
            scenarios=len(own),
            runs=self._route_runs[name],
            requirements={r: sum(r in self._asked[key] for key in own) for r in asked},
            encounters={kind: self._encounters[(name, kind)] for kind in kinds},
        )
