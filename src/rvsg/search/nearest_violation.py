"""How near a scenario is to a violation: the smallest change of one person that violates the requirement.

A person does everything earlier or later, or nearer to where the robot is when the two are closest. Sizes double until
most runs violate, and are then halved. All sizes meet the same seeds.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rvsg.core.errors import InputError
from rvsg.core.plugins import Spec, ignore
from rvsg.core.records import Record
from rvsg.evaluation.sampled import sampled
from rvsg.evaluation.verdict import arrivals_in_words, load_requirement
from rvsg.runs.runner import Evaluator, Runner, RunRequest
from rvsg.scenario.builder import check_valid
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import HumanConfiguration, Scenario
from rvsg.scenario.validity import check
from rvsg.scenario.variation import shifted
from rvsg.scenario.world_lookup import world_of
from rvsg.simulation.run import Outcome
from rvsg.simulation.simulators import Simulator, simulator_of
from rvsg.world.world import World

FIRST, FINEST = 0.1, 0.05
"""Size of the first change, and the precision of the smallest, m or s."""
NEAR_M = 4.0
"""Who never comes nearer to the robot than this is not changed."""


class NearChange(Record):
    """The smallest change of one kind that violates."""

    person: str
    kind: str
    """`earlier`, `later` or `towards the robot`."""
    size: float
    unit: str
    violations: int
    runs: int
    arrived: int
    scenario: Scenario

    def __str__(self) -> str:
        came = arrivals_in_words(self.arrived, self.runs)
        size = f"{self.person} {self.size:.2f} {self.unit} {self.kind}"
        return f"{size}: {came}{self.violations} of {self.runs} runs violate"


class Nearness(Record):
    """The smallest changes that violate a requirement, the smallest first."""

    requirement: Requirement
    violations: int
    """Of the scenario as it is."""
    runs: int
    arrived: int
    """Of these runs."""
    changes: tuple[NearChange, ...]
    most: float
    """Larger changes were not tried, m or s."""

    def __str__(self) -> str:
        name, came = self.requirement.name, arrivals_in_words(self.arrived, self.runs)
        if 2 * self.violations >= self.runs:
            return f"{came}It violates {name} as it is, in {self.violations} of {self.runs} runs."
        if not self.changes:
            return f"{came}No change of one person by up to {self.most:g} m or s violates {name} in most runs."
        return f"{came}The smallest change that violates {name}: {self.changes[0]}."


Tried = tuple[float, tuple[int, int], Scenario]
"""Size of a change, how many runs violate and arrive with it, and the scenario."""


@dataclass(frozen=True)
class _Search:
    scenario: Scenario
    requirement: Requirement
    runner: Runner
    seeds: range
    most: float

    def counts(self, scenario: Scenario) -> tuple[int, int]:
        """Return how many runs violate the requirement, and how many arrive."""
        runs = self.runner.measured(scenario, self.seeds)
        bad = sum(run.objective is not None and self.requirement.violated_by(run.objective) for run in runs)
        return bad, sum(run.outcome == Outcome.REACHED.value for run in runs)

    def changes(self) -> list[NearChange]:
        """Return the smallest change of each kind and person, the smallest first."""
        run = self.runner.submit(RunRequest(self.scenario, self.seeds[0])).finished().unpack()
        gap, path, found = sampled(run).gap, run.trajectory, []
        for k, human in enumerate(self.scenario.people.humans):
            at = int(gap[:, k].argmin())
            if gap[at, k] > NEAR_M:
                continue
            dx, dy = path.x[at] - path.human_x[at, k], path.y[at] - path.human_y[at, k]
            length = max(1e-6, math.hypot(dx, dy))
            kinds = (("earlier", "s", -1.0, 0.0), ("later", "s", 1.0, 0.0), ("towards the robot", "m", 0.0, 1.0))
            for kind, unit, time, way in kinds:
                direction = (way * dx / length, way * dy / length)
                if (change := self._smallest(k, time, direction)) is not None:
                    size, (violations, arrived), scenario = change
                    found.append(
                        NearChange(
                            person=human.name, kind=kind, size=size, unit=unit, violations=violations,
                            runs=len(self.seeds), arrived=arrived, scenario=scenario,
                        )
                    )  # fmt: skip
        return sorted(found, key=lambda each: each.size)

    def _smallest(self, k: int, time: float, way: tuple[float, float]) -> Tried | None:
        low, best = 0.0, None
        for size in [*FIRST * 2.0 ** np.arange(math.floor(math.log2(self.most / FIRST)) + 1)]:
            best = self._violating(k, time, way, float(size))
            if best is not None:
                break
            low = float(size)
        while best is not None and best[0] - low > FINEST + 1e-9:
            middle = round((best[0] + low) / 2.0, 3)
            better = self._violating(k, time, way, middle)
            low, best = (low, better) if better is not None else (middle, best)
        return best

    def _violating(self, k: int, time: float, way: tuple[float, float], size: float) -> Tried | None:
        """Return the size, how often it violates and its scenario; None where it is not valid or most runs do not."""
        humans = self.scenario.people.humans
        human = shifted(humans[k], self.runner.world.grid, time * size, (way[0] * size, way[1] * size))
        if human is None:
            return None
        scenario = self.scenario.replace(people=HumanConfiguration(humans=(*humans[:k], human, *humans[k + 1 :])))
        if check(scenario.people, scenario.mission, self.runner.world):
            return None
        counts = self.counts(scenario)
        return (size, counts, scenario) if 2 * counts[0] >= len(self.seeds) else None


def nearest_violation(
    scenario: Scenario,
    requirement: str | Path | Requirement = "R1",
    *,
    most: float = 1.6,
    repeats: int = 4,
    seed: int = 0,
    jobs: int = 1,
    simulator: str | Spec | Simulator = "embedded",
    world: World | str | Path | None = None,
    on_message: Callable[[str], None] = ignore,
) -> Nearness:
    """Return the smallest changes of one person with which at least half of the runs violate a requirement.

    Args:
        most: the largest change that is tried, metres or seconds.
        repeats: runs of each change.

    Raises:
        InputError: the requirement has no limit.
    """
    place = world_of(scenario.mission, world)
    check_valid(scenario, place)
    asked = load_requirement(requirement, scenario.mission.route)
    if asked.threshold is None:
        raise InputError(f"{asked.name} has no limit, so nothing violates it. Choose a requirement with a limit.")
    with (
        simulator_of(simulator, scenario=scenario, on_message=on_message) as made,
        Runner(made, place, measuring=Evaluator(asked, place), jobs=jobs, notify=on_message) as runner,
    ):
        search = _Search(scenario, asked, runner, range(seed, seed + repeats), most)
        violations, arrived = search.counts(scenario)
        changes = [] if 2 * violations >= repeats else search.changes()
    return Nearness(
        requirement=asked, violations=violations, runs=repeats, arrived=arrived, changes=tuple(changes), most=most
    )
