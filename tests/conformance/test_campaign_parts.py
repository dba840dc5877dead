"""Every registered strategy, store and simulator passes the exam that plug-in writers are given."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest
from tests.campaign.parts import WalkGenerator, plan, warehouse

from rvsg.core import plugins
from rvsg.generation.generator import Proposal
from rvsg.runs.attempt import Attempt
from rvsg.scenario.brief import Brief
from rvsg.scenario.scenario import Scenario
from rvsg.search.strategies import Ask, StudyStrategy, brief_of, check_ledger, check_strategy
from rvsg.simulation.archive import PackedRun
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Run
from rvsg.store.sqlite import SqliteLedger
from rvsg.testing import check_simulator
from rvsg.world.world import World


def answered(seed: int = 3) -> tuple[Brief, Proposal, Scenario]:
    brief = Brief(mission=plan().mission, requirement=plan().requirement, seed=seed)
    proposal = WalkGenerator().propose(brief, warehouse())
    assert proposal.scenario is not None
    return brief, proposal, proposal.scenario


NEEDS_A_SYSTEM = "ros2-world"
"""This simulator is somebody else's: tests/exchange/test_ros2_world.py plays one."""


@pytest.mark.parametrize("max_in_flight", [1, 3, 20])
@pytest.mark.parametrize("name", plugins.names("strategy"))
def test_a_strategy_keeps_its_promises(name: str, max_in_flight: int) -> None:
    check_strategy(
        plugins.find("strategy", name), plan(scenarios=4, max_in_flight=max_in_flight), answered()[2], warehouse()
    )


@pytest.mark.parametrize("name", [name for name in plugins.names("simulator") if name != NEEDS_A_SYSTEM])
def test_a_simulator_keeps_its_promises(name: str) -> None:
    check_simulator(plugins.make("simulator", name, {}), answered()[2], warehouse())


@pytest.mark.parametrize("name", plugins.names("store"))
def test_a_ledger_keeps_its_promises(name: str, tmp_path: Path) -> None:
    brief, proposal, scenario = answered()
    attempt = Attempt(campaign="exam", index=0, strategy="study", brief=brief, proposal=proposal)
    run = KinematicSimulator().run(scenario, warehouse(), seed=1)
    check_ledger(lambda: plugins.find("store", name)(tmp_path / "store"), attempt, run)


class Greedy(StudyStrategy):
    def ask(self) -> tuple[Ask, ...]:
        asks = super().ask()
        more = Ask(brief=brief_of(self.plan, "new", len(self.attempts), (0, 0)))
        return asks if asks or len(self.attempts) > self.plan.attempts else (more,)


class Forgetful(StudyStrategy):
    def tell(self, attempt: Attempt) -> None:
        self.attempts = [*self.attempts[1:], attempt] if len(self.attempts) == 4 else [*self.attempts, attempt]


@pytest.mark.parametrize("bad", [Greedy, Forgetful])
def test_the_exam_fails_a_strategy_that_asks_too_much_or_forgets(bad: type) -> None:
    with pytest.raises(AssertionError):
        check_strategy(bad, plan(), answered()[2], warehouse())


class Drifting(KinematicSimulator):
    calls = 0

    def run(self, scenario: Scenario, world: World, *, seed: int) -> Run:
        Drifting.calls += 1
        run = super().run(scenario, world, seed=seed)
        run.trajectory.x[:] += 1e-12 * Drifting.calls
        return run


def test_the_exam_fails_a_simulator_that_is_not_repeatable() -> None:
    with pytest.raises(AssertionError, match="equal seeds"):
        check_simulator(Drifting(), answered()[2], warehouse())


class Lenient(SqliteLedger):
    def append(self, attempt: Attempt, runs: Sequence[PackedRun]) -> None:
        if attempt.index not in [known.index for known in self.attempts(attempt.campaign)]:
            super().append(attempt, runs)


def test_the_exam_fails_a_ledger_that_drops_in_silence(tmp_path: Path) -> None:
    brief, proposal, scenario = answered()
    attempt = Attempt(campaign="exam", index=0, strategy="study", brief=brief, proposal=proposal)
    run = KinematicSimulator().run(scenario, warehouse(), seed=1)
    with pytest.raises(AssertionError, match="index that is taken"):
        check_ledger(lambda: Lenient(tmp_path / "store"), attempt, run)
