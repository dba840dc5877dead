"""Exploration of a scenario's ranges, and coverage of a world by scenarios and their runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import InputError
from rvsg.core.plugins import Spec, ignore
from rvsg.core.records import Record
from rvsg.core.seeds import seed_for
from rvsg.evaluation.detection import EncounterKind, encounters_of
from rvsg.evaluation.statistics import Sensitivity, Surface, clopper_pearson, fit_surface, sensitivities
from rvsg.evaluation.verdict import load_requirement
from rvsg.runs.runner import Evaluator, PendingRun, Runner, RunRequest
from rvsg.scenario import validity
from rvsg.scenario.builder import FoundWith, load_family
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Behaviour, Scenario
from rvsg.scenario.variation import Range, ScenarioFamily, waypoints_used
from rvsg.scenario.world_lookup import world_of
from rvsg.simulation.run import Outcome, Run
from rvsg.simulation.simulators import Simulator, as_found, simulator_of
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
    arrived: int
    """Of these runs, those that reach the goal: who never comes to a crossing violates nothing there."""
    interval: tuple[float, float]
    """95 % interval of the violation probability over all of the ranges (Clopper-Pearson)."""
    surface: Surface | None = None
    """None with fewer than `FEWEST` runs."""
    sensitivities: tuple[Sensitivity, ...] = ()

    @property
    def worst_scenario(self) -> Scenario:
        """The scenario at the point with the worst objective."""
        worst = max(self.judged, key=lambda point: self.requirement.badness(point.objective or 0.0))
        return ScenarioFamily(middle=self.scenario, ranges=self.ranges).at(worst.values)

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
        self._met.update(each.waypoint for each in met)
        self._encounters.update({(route, each.kind.value) for each in met})

    def coverage(self) -> Coverage:
        """Return what was exercised so far."""
        scenarios, kinds = self._scenarios.values(), [kind.value for kind in EncounterKind]
        passed = Counter(name for each in scenarios for name in set(waypoints_used(each.people)))
        asked = sorted({*self.requirements, *(name for names in self._asked.values() for name in names)})
        used = {each.id: set(waypoints_used(each.people)) for each in scenarios}
        acted = Counter(b for each in scenarios for b in {h.behaviour.value for h in each.people.humans})
        judged = Counter(name for names in self._asked.values() for name in names)
        routes = []
        driven = sorted(each.mission.route.name for each in scenarios)
        for name in dict.fromkeys([*(route.name for route in self.world.routes), *driven]):
            own = [key for key, each in self._scenarios.items() if each.mission.route.name == name]
            met = {kind: self._encounters[(name, kind)] for kind in kinds}
            tested = {r: sum(r in self._asked[key] for key in own) for r in asked}
            runs = self._route_runs[name]
            routes.append(RouteCoverage(route=name, scenarios=len(own), runs=runs, requirements=tested, encounters=met))
        happened = {kind: sum(count for (_, each), count in self._encounters.items() if each == kind) for kind in kinds}
        return Coverage(
            world=self.world.name,
            world_id=self.world.id,
            scenarios=len(self._scenarios),
            runs=len(self._runs),
            areas=tuple(
                Count(name=area.name, scenarios=sum(bool(used[each] & set(area.waypoints)) for each in used))
                for area in self.world.areas
            ),
            routes=tuple(routes),
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


def explore(
    family: ScenarioFamily | str | Path,
    requirement: Requirement | str | None = None,
    *,
    vary: Sequence[str] = (),
    runs: int = 60,
    seed: int = 0,
    jobs: int = 1,
    simulator: str | Spec | Simulator | None = None,
    world: World | str | Path | None = None,
    on_point: Callable[[Point], None] = ignore,
    on_message: Callable[[str], None] = ignore,
) -> Exploration:
    """Run a scenario at points of its ranges and fit how often it violates a requirement.

    The points are a Latin hypercube. Each is run once, with a seed of its own: for a surface, more points say more
    than repeated ones.

    Args:
        runs: points of the Latin hypercube.
        seed: of the points and of the runs.
        requirement, simulator: by default those that the scenario of a file was found with, else R1 and `embedded`.
            A simulator is a name, a Spec, or an instance, which stays open.

    Raises:
        InputError: no range, a requirement without a limit, or no point that is valid.
    """
    kept = FoundWith()
    if not isinstance(family, ScenarioFamily):
        family, world, kept = load_family(family, vary, world)
    place = world_of(family.middle.mission, world)
    asked = load_requirement(requirement or kept.requirement or "R1", family.middle.mission.route)
    if asked.threshold is None:
        raise InputError(f"{asked.name} has no limit, so no run violates it. Choose a requirement with a limit.")
    measuring = Evaluator(asked, place)
    with (
        simulator_of(as_found(kept.simulator, simulator), scenario=family.middle, on_message=on_message) as made,
        Runner(made, place, measuring=measuring, jobs=jobs, notify=on_message) as runner,
    ):
        points = _run_points(family, runs, seed, asked, runner, on_point)
    return _explored(family, asked, points, seed=seed, simulator=made.name)


def _run_points(
    family: ScenarioFamily,
    count: int,
    seed: int,
    requirement: Requirement,
    runner: Runner,
    on_point: Callable[[Point], None],
) -> list[Point]:
    """Draw points of a Latin hypercube, and run the scenario at each where it is valid."""
    from scipy.stats import qmc

    sampler = qmc.LatinHypercube(len(family.ranges), rng=np.random.default_rng(seed_for(seed, "explore")))
    submitted: list[tuple[Point, PendingRun | None]] = []
    for k, row in enumerate(sampler.random(count)):
        values = tuple(round(r.at(float(s)), 6) for r, s in zip(family.ranges, row, strict=True))
        scenario, own = family.at(values), seed_for(seed, "run", k)
        problems = tuple(str(each) for each in validity.check(scenario.people, scenario.mission, runner.world))
        pending = None if problems else runner.submit(RunRequest(scenario, own))
        submitted.append((Point(values=values, seed=own, problems=problems), pending))
    points = []
    for point, pending in submitted:
        if pending is not None:
            run = pending.finished()
            value = run.measurement.objective
            violated = None if value is None else requirement.violated_by(value)
            point = point.replace(objective=value, violated=violated, outcome=run.outcome.value)
        on_point(point)
        points.append(point)
    return points


def _explored(
    family: ScenarioFamily, requirement: Requirement, points: Sequence[Point], *, seed: int, simulator: str
) -> Exploration:
    judged = [point for point in points if point.violated is not None]
    if not judged:
        raise InputError(f"No point of the ranges can be judged: {'; '.join(points[0].problems) or 'no value'}.")
    violations = sum(bool(point.violated) for point in judged)
    surface: Surface | None = None
    sensitive: tuple[Sensitivity, ...] = ()
    if len(judged) >= FEWEST:
        shares = shares_of(family.ranges, judged)
        bad = [bool(point.violated) for point in judged]
        surface = fit_surface(shares, bad)
        badness = [None if p.objective is None else requirement.badness(p.objective) for p in judged]
        sensitive = sensitivities(surface, [each.name for each in family.ranges], shares, badness, bad, seed=seed)
    return Exploration(
        scenario=family.middle,
        ranges=family.ranges,
        requirement=requirement,
        simulator=simulator,
        seed=seed,
        points=tuple(points),
        violations=violations,
        runs=len(judged),
        arrived=sum(point.outcome == Outcome.REACHED.value for point in judged),
        interval=clopper_pearson(violations, len(judged)),
        surface=surface,
        sensitivities=sensitive,
    )
