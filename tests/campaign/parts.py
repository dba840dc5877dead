"""What the tests of the loop are made of: the everyday simulator, a generator that walks people about, a judge."""

from __future__ import annotations

import dataclasses
import os
import signal
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rvsg.campaign.attempt import Attempt, Failure, Measurement, Plan
from rvsg.campaign.execution import Parts
from rvsg.campaign.feedback import StoredFeedback
from rvsg.campaign.ledger import CachedLedger, Ledger
from rvsg.campaign.loop import run_campaign
from rvsg.campaign.runner import Evaluator, FinishedRun, PendingRun, Runner
from rvsg.campaign.strategies import Strategy, StudyStrategy
from rvsg.core.errors import GenerationError
from rvsg.evaluation.verdict import Status, Verdict
from rvsg.generation.generator import Proposal
from rvsg.scenario.brief import Brief
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission, Scenario
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Run
from rvsg.simulation.simulators import Simulator
from rvsg.store.memory import MemoryLedger as MemoryLedger
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


def distance(run: Run) -> float | None:
    path = run.trajectory
    if not run.human_names:
        return None
    away = np.hypot(path.human_x - path.x[:, None], path.human_y - path.y[:, None]).min(axis=1)
    return float(away.mean())


def measure(run: Run, _place: object = None) -> Measurement:
    value = distance(run)
    return Measurement(run_id=run.id, seed=run.seed, outcome=run.outcome.value, values={"dto": value}, objective=value)


class Distance(Evaluator):
    """Measures by `measure`, or by what is given."""

    def __init__(
        self, by: Callable[..., Measurement] = measure, judged: Callable[..., Measurement] | None = None
    ) -> None:
        super().__init__(REQUIREMENT)
        self.by, self.by_judged = by, judged or by

    def measure(self, run: Run, place: World | None = None) -> Measurement:
        return self.by(run, place)

    def judged(self, run: Run, place: World | None = None) -> Measurement:
        return self.by_judged(run, place)


def judge(measurements: Sequence[Measurement], *, budget: int | None = None) -> Verdict:
    values = tuple(m.objective for m in measurements if m.objective is not None)
    violations = sum(REQUIREMENT.violated_by(value) for value in values)
    mean = float(np.mean(values)) if values else None
    spread = float(np.std(values)) if values else 0.0
    status = Status.FAIL if violations == len(values) else Status.FLAKY if violations else Status.PASS
    return Verdict(
        requirement="R1",
        status=status if values else Status.INCONCLUSIVE,
        objectives=values,
        mean=mean,
        interval=(mean - spread, mean + spread) if mean is not None else None,
        violations=violations,
        runs=len(values),
        undefined=len(measurements) - len(values),
        violation_probability=violations / len(values) if values else None,
        violation_interval=(0.0, 1.0),
    )


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


class Deadly(KinematicSimulator):
    """Kills its process for one seed: once, or where `always` every time."""

    def __init__(self, mark: Path, seed: int, always: bool) -> None:
        super().__init__()
        self.mark, self.seed, self.always = mark, seed, always

    def run(self, scenario: Scenario, world: World, *, seed: int) -> Run:
        if seed == self.seed and (self.always or not self.mark.exists()):
            self.mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().run(scenario, world, seed=seed)


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
        judge=judge,
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
    made = dataclasses.replace(parts(MemoryLedger() if ledger is None else ledger, **how), **(changes or {}))
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

    def __init__(self, after: int, generator: WalkGenerator | None = None) -> None:
        super().__init__()
        self.after, self.inner = after, generator or WalkGenerator()

    def propose(self, brief: Brief, world: World) -> Proposal:
        if len(self.inner.briefs) >= self.after:
            raise GenerationError("the service does not answer")
        return self.inner.propose(brief, world)


class Noted(Runner):
    """Notes the ids of the runs that begin, and, for each that is waited for, how many had begun."""

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self.begun: set[str] = set()
        self.made: list[tuple[str, int]] = []

    def submit(self, scenario: Scenario, seed: int, *, trial: bool = False) -> PendingRun:
        pending = super().submit(scenario, seed, trial=trial)
        self.begun.add(pending.run_id)
        return pending

    def _collect(self, pending: PendingRun) -> FinishedRun | Measurement | Failure:
        self.made.append((pending.run_id, len(self.begun)))
        return super()._collect(pending)
