"""A scenario while it is edited: its trial with repairs and violations, and the data of its replay."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pydantic
from pydantic import Field

from rvsg.app.campaign import Campaign
from rvsg.core.documents import mistakes_of
from rvsg.core.errors import InputError
from rvsg.core.plugins import Spec
from rvsg.core.records import Record
from rvsg.report.page import data_of
from rvsg.report.run_facts import AttemptFacts, facts_of
from rvsg.report.stills import area_colours, floor_svg
from rvsg.runs.attempt import Attempt
from rvsg.runs.runner import Evaluator
from rvsg.scenario.builder import check_route, walk
from rvsg.scenario.repair import repair
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Behaviour, HumanConfiguration, Mission, Scenario
from rvsg.scenario.validity import check
from rvsg.search.run_set import RunSet, simulate
from rvsg.simulation.run import Run
from rvsg.simulation.simulators import Simulator, check_robot, make_simulator
from rvsg.world.drawing.svg import floor_plan
from rvsg.world.world import Route, World

BEHAVIOURS = tuple(behaviour.value for behaviour in Behaviour)
"""How a person may react to the robot."""
PERIOD_S = 0.2
"""Seconds between the points of the lines that are drawn."""
_made: dict[str, Simulator] = {}
_making = threading.RLock()


class TriedScenario(Record):
    """What a scenario does as it stands."""

    scenario: Scenario
    """With what a change made necessary: paths joined, loops closed."""
    repairs: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()
    """Why it cannot be simulated; then nothing below is known."""
    runs: int = 0
    violations: int = 0
    objectives: tuple[float | None, ...] = ()
    """The value of each run, in the order of the seeds."""
    violated: tuple[bool, ...] = ()
    """Whether each run violates the requirement."""
    robot: tuple[tuple[float, float], ...] = ()
    """Where the robot is in the first run, every 0.2 s, metres."""
    people: dict[str, tuple[tuple[float, float], ...]] = Field(default_factory=dict)
    duration_s: float = 0.0
    outcome: str = ""


def scenario_of(value: Mapping[str, Any]) -> Scenario:
    """Return a scenario of plain data; InputError names everything that is wrong."""
    try:
        return Scenario.model_validate_json(pydantic.TypeAdapter(dict[str, Any]).dump_json(dict(value)))
    except (pydantic.ValidationError, ValueError, TypeError) as error:
        if isinstance(error, pydantic.ValidationError):
            raise InputError("; ".join(mistakes_of(error, Scenario)[:8])) from None
        raise InputError(f"This is no scenario: {error}") from None


def empty_scenario(world: World, route: Route | str) -> Scenario:
    """Return a mission without people, to put some into."""
    taken = world.route(route) if isinstance(route, str) else route
    check_route(taken, world)
    return Scenario(mission=Mission.of(world, taken), people=HumanConfiguration(humans=()))


def with_person(scenario: Scenario, world: World, stops: Sequence[str]) -> Scenario:
    """Return the scenario with one more person, who goes round some waypoints by the shortest ways."""
    taken = {human.name for human in scenario.people.humans}
    name = next(candidate for k in range(1, len(taken) + 2) if (candidate := f"Human {k}") not in taken)
    human = walk(name, *stops, speed_m_s=1.0).human(world)
    return scenario.replace(people=HumanConfiguration(humans=(*scenario.people.humans, human)))


def try_out(
    scenario: Scenario,
    world: World,
    requirement: Requirement,
    *,
    seeds: Sequence[int] = (0,),
    simulator: str | Spec = "embedded",
    as_is: bool = False,
) -> TriedScenario:
    """Repair a scenario as its generator would, unless it is tried as it is; check and simulate it for each seed."""
    world = scenario.mission.place(world)
    people, repairs = (scenario.people, ()) if as_is else repair(scenario.people, scenario.mission, world)
    scenario = scenario.replace(people=people)
    said = tuple(dict.fromkeys(f"{fix.human}: {fix.what}" for fix in repairs))
    problems = tuple(str(finding) for finding in check(people, scenario.mission, world))
    if problems:
        return TriedScenario(scenario=scenario, repairs=said, problems=problems)
    prepared = _simulator(simulator)
    check_robot(scenario, prepared)
    with _making:  # one at a time: a simulator is not shared between threads
        runs = simulate(scenario, seeds, simulator=prepared, world=world)
    measuring = Evaluator(requirement, world)
    values = tuple(measuring.measure(run).objective for run in runs)
    violated = tuple(value is not None and requirement.violated_by(value) for value in values)
    first = runs[0]
    return TriedScenario(
        scenario=scenario,
        repairs=said,
        runs=len(runs),
        violations=sum(violated),
        objectives=values,
        violated=violated,
        robot=_line(first, first.trajectory.x, first.trajectory.y),
        people={
            name: _line(first, first.trajectory.human_x[:, k], first.trajectory.human_y[:, k])
            for k, name in enumerate(first.human_names)
        },
        duration_s=float(first.trajectory.t[-1]),
        outcome=first.outcome.value,
    )


def simulated(scenario: Scenario, world: World, seeds: Sequence[int], simulator: str | Spec = "embedded") -> RunSet:
    """Return the runs of a valid scenario, to be replayed."""
    with _making:
        return simulate(scenario, seeds, simulator=_simulator(simulator), world=world)


def _simulator(asked: str | Spec) -> Simulator:
    """Return a simulator that is made and prepared once in this process."""
    key = repr(Spec.of(asked))
    with _making:
        if key not in _made:
            _made[key] = make_simulator(asked)
            _made[key].prepare(lambda _: None)
        return _made[key]


def _line(run: Run, x: Any, y: Any) -> tuple[tuple[float, float], ...]:
    t = run.trajectory.t
    rows = np.clip(np.searchsorted(t, np.arange(t[0], t[-1] + PERIOD_S, PERIOD_S)), 0, len(t) - 1)
    return tuple((round(float(a), 2), round(float(b), 2)) for a, b in zip(x[rows], y[rows], strict=True))


def floor_of(world: World, *, areas: bool = True) -> dict[str, Any]:
    """Return the floor plan for an editor that draws over it: SVG parts, in which everything is escaped.

    Returns:
        `view_box`, `shapes`, `names` and the `style` of the areas as SVG; `matrix` from world metres to its units.
    """
    plan = floor_plan(world, areas=areas, tooltips=False)
    return {
        "view_box": plan.view_box,
        "matrix": [*plan.transform],
        "shapes": plan.shapes,
        "names": plan.names,
        "style": area_colours(world, plan if areas else floor_plan(world, tooltips=False)),
    }


def related(attempts: Sequence[Attempt], index: int) -> list[Attempt]:
    """Return an attempt with those that tell more of it: its confirmation or candidate, and runs with fewer people.

    Raises:
        InputError: there is no such attempt, or it has no runs.
    """
    chosen = next((a for a in attempts if a.index == index and a.measurements), None)
    if chosen is None:
        raise InputError(f"There is no attempt {index} with runs in this campaign.")
    tied = {chosen.confirms} if chosen.confirms is not None else set()
    others = [
        a
        for a in attempts
        if a is not chosen
        and a.measurements
        and (a.index in tied or a.confirms == index or (a.purpose == "baseline" and chosen.purpose == "confirmation"))
    ]
    return [chosen, *others]


def replay_of_attempts(campaign: Campaign, attempts: Iterable[Attempt]) -> dict[str, Any]:
    """Return the data of the replay component for stored attempts of a campaign, in this order."""
    world = campaign.shown_world
    with campaign.reading() as ledger:
        facts = facts_of(attempts, campaign.requirement, world, ledger.run)
    return _data(facts, campaign.plan.mission, campaign.requirement, world, by_hand=False)


def replay_of_runs(runs: RunSet, requirement: Requirement) -> dict[str, Any]:
    """Return the data of the replay component for runs that belong to no campaign, the worst first.

    Raises:
        InputError: the scenario or the world of the runs is not known.
    """
    scenario, world = runs.scenario, runs.world
    if scenario is None or world is None:
        raise InputError("A replay needs the scenario and the world of the runs.")
    measuring = Evaluator(requirement, world)
    measured = tuple(measuring.measure(run) for run in runs)
    attempt = Attempt.by_hand(
        scenario.mission,
        requirement,
        scenario,
        people=len(scenario.people.humans),
        measurements=measured,
        verdict=measuring.judge(measured),
    )
    facts = facts_of([attempt], requirement, world, {run.id: run for run in runs}.__getitem__)
    return _data(facts, scenario.mission, requirement, world, by_hand=True)


def _data(
    facts: Iterable[AttemptFacts], mission: Mission, requirement: Requirement, world: World, *, by_hand: bool
) -> dict[str, Any]:
    """Return the data of the replay component, with the floor plan as SVG that `mount` reads."""
    data = data_of(facts, mission=mission, requirement=requirement, world=world, by_hand=by_hand)
    return data | {"floor": floor_svg(world)}
