"""What the tests of the loop are made of: simulators, measurements, and a generator that walks people about."""

from __future__ import annotations

import dataclasses
import os
import signal
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from rvsg.core.errors import GenerationError
from rvsg.findings.feedback import StoredFeedback
from rvsg.generation.generator import Proposal
from rvsg.runs.attempt import Attempt, Failure, Measurement, Plan
from rvsg.runs.ledger import CachedLedger, Ledger
from rvsg.runs.ledger import MemoryLedger as MemoryLedger
from rvsg.runs.runner import Evaluator, FinishedRun, PendingRun, Runner, RunRequest
from rvsg.scenario.brief import Brief
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission, Scenario
from rvsg.search.execution import Parts
from rvsg.search.loop import run_campaign
from rvsg.search.strategies import Strategy, StudyStrategy
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Run
from rvsg.simulation.simulators import Simulator
from rvsg.testing import WalkingGenerator as WalkGenerator
from rvsg.world.world import World
from rvsg.world.world_folder import load_world

REQUIREMENT = Requirement(
    name="R1", title="Distance", text="Keep away from people.", metric="dto", worse="smaller", limit=1.0, unit="m"
)


@cache
def warehouse() -> World:
    return load_world("warehouse")


def plan(**changes: object) -> Plan:
    world = warehouse()
    given: dict[str, object] = {
        "name": "test",
        "mission": Mission(world=world.name, world_id=world.id, route=world.route("route_1")),
        "requirement": REQUIREMENT,
        "scenarios": 2,
        "refinements": 2,
        "repeats": 2,
        "confirmations": 5,
        "seed": 7,
    }
    return Plan(**{**given, **changes})


def measure(run: Run, _place: object = None) -> Measurement:
    measured = Evaluator(REQUIREMENT).judged(run)
    return measured.replace(values={"dto": measured.objective})


class Distance(Evaluator):
    """Measures by `measure`, or by what is given."""

    def __init__(
        self, by: Callable[..., Measurement] = measure, judged: Callable[..., Measurement] | None = None
    ) -> None:
        super().__init__(REQUIREMENT)
        self.by, self.by_judged = by, judged or by

    def measure_all(self, run: Run, place: World | None = None) -> tuple[Measurement, ...]:
        return (self.by(run, place),)

    def judged(self, run: Run, place: World | None = None) -> Measurement:
        return self.by_judged(run, place)


class Counted(Simulator):
    """A simulator that counts its runs."""

    name = "kinematic"

    def __init__(self, simulator: Simulator | None = None) -> None:
        self.inner = simulator or KinematicSimulator()
        self.runs = 0

    @property
    def options(self) -> object:
        return self.inner.options

    def run(self, scenario: Scenario, world: World, *, seed: int) -> Run:
        self.runs += 1
        return self.inner.run(scenario, world, seed=seed)


class Disturbed(KinematicSimulator):
    """Calls a function with the seed before every run, in the process that makes it."""

    def __init__(self, disturb: Callable[[int], object]) -> None:
        super().__init__()
        self.disturb = disturb

    def run(self, scenario: Scenario, world: World, *, seed: int) -> Run:
        self.disturb(seed)
        return super().run(scenario, world, seed=seed)


def die() -> None:
    """Kill this process."""
    os.kill(os.getpid(), signal.SIGKILL)


def parts(
    ledger: Ledger,
    *,
    simulator: object = None,
    generator: object = None,
    jobs: int = 1,
    measure: Callable[[Run], Measurement] = measure,
) -> Parts:
    cached = CachedLedger(ledger)
    runner = Runner(
        simulator or KinematicSimulator(),  # type: ignore[arg-type]
        warehouse(),
        measuring=Distance(measure),
        jobs=jobs,
        ledger=cached,
    )
    return Parts(
        generator=generator or WalkGenerator(),  # type: ignore[arg-type]
        runner=runner,
        judge=Evaluator(REQUIREMENT).judge,
        ledger=cached,
    )


def searched(
    strategy: Callable[..., Strategy] = StudyStrategy,
    the_plan: Plan | None = None,
    ledger: Ledger | None = None,
    *,
    options: Mapping[str, object] | None = None,
    changes: Mapping[str, object] | None = None,
    **how: Any,
) -> list[Attempt]:
    """Run a campaign and return its attempts.

    Args:
        options: Of the strategy.
        changes: Of the parts, whose other arguments are `how`.
    """
    the_plan = plan() if the_plan is None else the_plan
    changes = {"judge": Evaluator(the_plan.requirement).judge, **(changes or {})}
    made = dataclasses.replace(parts(MemoryLedger() if ledger is None else ledger, **how), **changes)
    feedback = StoredFeedback(made.ledger, the_plan, warehouse())
    with made.runner:
        return run_campaign(the_plan, strategy(the_plan, feedback, warehouse(), **(options or {})), made)


def a_scenario() -> Scenario:
    """A scenario that the walking generator proposes."""
    proposal = WalkGenerator().propose(Brief(mission=plan().mission, requirement=REQUIREMENT, seed=0), warehouse())
    assert proposal.scenario is not None
    return proposal.scenario


class Stops(WalkGenerator):
    """A service that fails from some proposal on, or another generator that does."""

    def __init__(self, after: int, generator: WalkGenerator | None = None, error: type = GenerationError) -> None:
        super().__init__()
        self.after, self.inner, self.error = after, generator or WalkGenerator(), error

    @property
    def asks_a_model(self) -> bool:
        return self.inner.asks_a_model

    def propose(self, brief: Brief, world: World) -> Proposal:
        if len(self.inner.briefs) >= self.after:
            raise self.error("the service does not answer")
        return self.inner.propose(brief, world)


class Noted(Runner):
    """Notes the ids of the runs that begin, and, for each that is waited for, how many had begun."""

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self.begun: set[str] = set()
        self.made: list[tuple[str, int]] = []

    def submit(self, job: RunRequest) -> PendingRun:
        pending = super().submit(job)
        self.begun.add(pending.run_id)
        return pending

    def _collect(self, pending: PendingRun) -> FinishedRun | Measurement | Failure:
        self.made.append((pending.run_id, len(self.begun)))
        return super()._collect(pending)
