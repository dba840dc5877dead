from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.strategies import integers
from tests.campaign.parts import (
    REQUIREMENT,
    Counted,
    Distance,
    MemoryLedger,
    Stops,
    WalkGenerator,
    measure,
    parts,
    plan,
    searched,
    warehouse,
)
from tests.coded import coded

from rvsg.core.errors import BudgetSpent, NothingJudged, SimulationError
from rvsg.core.seeds import fresh_seeds, seed_for
from rvsg.evaluation.verdict import Status, judge, violated
from rvsg.findings.ranking import best_attempt, confirmations, ranking, rule
from rvsg.generation.generator import Proposal
from rvsg.generation.heuristic import HeuristicGenerator
from rvsg.runs import runner
from rvsg.runs.attempt import Attempt, Measurement, Plan
from rvsg.runs.ledger import CachedLedger, Ledger
from rvsg.runs.runner import Runner
from rvsg.scenario.brief import Brief
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.search.confirmation import Confirmations
from rvsg.search.execution import AttemptFinished, account
from rvsg.search.hybrid import HybridStrategy
from rvsg.search.strategies import Ask, RandomStrategy, StudyStrategy, UnguidedStrategy
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Run
from rvsg.store.sqlite import SqliteLedger
from rvsg.world.world import World

STRATEGIES = [StudyStrategy, UnguidedStrategy, RandomStrategy]


def run(ledger, the_plan=None, strategy=StudyStrategy, **how):
    return searched(strategy, the_plan, ledger, **how)


def measuring(value_of: Callable[[Run], float]) -> Callable[[Run, object], Measurement]:
    def measured(made: Run, _place: object) -> Measurement:
        value = value_of(made)
        return Measurement(run_id=made.id, seed=made.seed, outcome="goal", values={"dto": value}, objective=value)

    return measured


def confirming(value_of: Callable[[Run], float], the_plan: Plan, strategy: type = StudyStrategy, ledger=None, **how):
    """Run a campaign whose runs measure these values; return its attempts."""
    return searched(strategy, the_plan, ledger, measure=measuring(value_of), **how)


def fresh(the_plan: Plan, strategy: type = StudyStrategy) -> tuple[list[Attempt], tuple[int, ...]]:
    """The search alone, and the seeds that its confirmations will have."""
    first = run(MemoryLedger(), the_plan.replace(confirmations=0), strategy)
    used = {m.seed for a in first for m in a.measurements}
    return first, fresh_seeds(the_plan.seed, "confirmation", the_plan.confirmations, used=used)


def confirmations_of(attempts: list[Attempt]) -> list[Attempt]:
    return [attempt for attempt in attempts if attempt.purpose == "confirmation"]


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_every_strategy_spends_the_same_number_of_runs(strategy: type) -> None:
    generator = WalkGenerator()
    attempts = run(MemoryLedger(), strategy=strategy, generator=generator)
    search = [a for a in attempts if a.purpose == "search"]
    assert len(search) == plan().attempts
    assert sum(len(a.measurements) for a in search) == plan().attempts * plan().repeats
    if strategy is UnguidedStrategy:
        assert {(b.requirement, b.feedback, b.memory) for b in generator.briefs} == {(None, None, ())}
    decisive = [a for a in attempts if a.purpose in ("search", "confirmation")]
    assert sum(len(a.measurements) for a in decisive) == plan().runs


def test_the_study_refines_from_feedback_and_remembers_earlier_scenarios() -> None:
    generator = WalkGenerator()
    attempts = run(MemoryLedger(), generator=generator)
    kinds = [brief.kind for brief in generator.briefs]
    assert kinds == ["new", "refine", "refine", "new", "refine", "refine"]
    second = generator.briefs[1]
    assert second.feedback is not None
    assert second.feedback.scenario == attempts[0].proposal.scenario
    assert second.feedback.mean == attempts[0].mean
    assert second.feedback.previous_mean is None
    third = generator.briefs[2]
    assert third.feedback is not None and third.feedback.previous_mean == attempts[0].mean
    fourth = generator.briefs[3]
    best = max(attempts[:3], key=lambda a: REQUIREMENT.badness(a.mean or 0.0))
    assert best.proposal.scenario is not None
    assert [m.scenario for m in fourth.memory] == [best.proposal.scenario]


def test_the_confirmation_uses_seeds_that_took_no_part_in_the_selection() -> None:
    attempts = run(MemoryLedger())
    confirmation = confirmations_of(attempts)[0]
    selected = {m.seed for a in attempts if a.purpose == "search" for m in a.measurements}
    fresh = {m.seed for m in confirmation.measurements}
    assert len(fresh) == 5
    assert not fresh & selected
    ranked = ranking(attempts, REQUIREMENT)
    assert confirmation.confirms == ranked[0].index and all(a.purpose == "search" for a in ranked)


def confirmed_with(values: list[float], *, limit: float | None = 1.0, confirmations: int = 30, jobs: int = 1):
    """The confirmation of a campaign of one attempt, its runs measuring `values` in the order of their seeds."""
    requirement = REQUIREMENT.replace(limit=limit)
    the_plan = plan(scenarios=1, refinements=0, repeats=1, confirmations=confirmations, requirement=requirement)
    value_of = dict(zip(fresh(the_plan, RandomStrategy)[1], values, strict=False))
    attempts = confirming(lambda made: value_of.get(made.seed, 0.5), the_plan, RandomStrategy, jobs=jobs)
    return confirmations_of(attempts)[0]


LATE = [2.0] * 5 + [0.5] + [2.0] * 24
"""Values of which one violates, so that only many runs are sure."""


@pytest.mark.parametrize(
    ("values", "status", "runs"),
    [
        ([2.0] * 30, Status.PASS, 15),
        ([0.5] * 30, Status.FAIL, 15),
        ([0.5, 2.0] * 15, Status.FLAKY, 4),
        (LATE, Status.PASS, 28),
        ([2.0] * 10, Status.INCONCLUSIVE, 10),
        ([0.5, 2.0] * 5, Status.UNJUDGED, 10),
    ],
)
def test_a_confirmation_ends_when_the_verdict_is_sure_or_with_its_budget(
    values: list[float], status: Status, runs: int
) -> None:
    limit = None if status is Status.UNJUDGED else 1.0
    confirmation = confirmed_with(values, limit=limit, confirmations=len(values))
    assert confirmation.verdict is not None
    assert (confirmation.verdict.status, len(confirmation.measurements)) == (status, runs)
    spent = "the budget of 10 runs is spent" in confirmation.verdict.reason
    assert spent == (status is Status.INCONCLUSIVE)
    # Not one run earlier: the status is that of the counts, and the counts before were not enough.
    assert judge(REQUIREMENT, values[: runs - 1]).status is Status.INCONCLUSIVE or limit is None


def test_a_candidate_that_does_not_always_violate_leaves_runs_for_one_that_does() -> None:
    the_plan = plan(scenarios=2, refinements=0, repeats=1, confirmations=30, requirement=REQUIREMENT)
    first, seeds = fresh(the_plan, RandomStrategy)

    def value(made: Run) -> float:
        return (2.0 if made.seed == seeds[12] else 0.4) if made.scenario_id == first[0].scenario_id else 0.5

    one, two = confirmations_of(confirming(value, the_plan, RandomStrategy))
    assert (one.verdict.status, one.verdict.violations) == (Status.INCONCLUSIVE, one.verdict.runs - 1)
    assert violated(one.verdict)
    assert (two.verdict.status, two.verdict.runs) == (Status.FAIL, 15)


def test_every_scenario_is_confirmed_and_then_others_until_one_always_violates() -> None:
    the_plan = plan(scenarios=2, refinements=2, repeats=1, confirmations=100, requirement=REQUIREMENT)
    first, seeds = fresh(the_plan)
    assert [a.brief.scenario_index for a in first] == [0, 0, 0, 1, 1, 1]
    index_of = {a.scenario_id: a.index for a in first}

    def value(made: Run) -> float:
        """The worst of each scenario violate in every other run, the rest in all."""
        index = index_of.get(made.scenario_id, 9)
        return 0.5 + index / 100 if index not in (0, 3) else 2.0 if made.seed in seeds[::2] else 0.4

    confirmed = [(a.confirms, a.verdict.status, a.verdict.runs) for a in confirmations_of(confirming(value, the_plan))]
    assert confirmed == [(0, Status.FLAKY, 4), (3, Status.FLAKY, 4), (1, Status.FAIL, 15)]


def test_a_further_configuration_that_cannot_always_violate_is_dropped_early() -> None:
    the_plan = plan(scenarios=1, refinements=1, repeats=1, confirmations=100, requirement=REQUIREMENT)
    first, seeds = fresh(the_plan, RandomStrategy)

    measured = measuring(lambda made: 2.0 if made.seed in (seeds[10], seeds[12]) else 0.5)
    with (made := parts(MemoryLedger(), measure=measured)).runner:
        confirming = Confirmations(the_plan, first, made)
        *_, last = confirming.confirm(first[1], budget=30, only_fail=True)
    assert isinstance(last, AttemptFinished) and last.attempt.verdict is not None
    assert (last.attempt.verdict.violations, last.attempt.verdict.runs) == (11, 13)


def test_what_ended_without_a_verdict_goes_on_with_the_runs_that_are_left() -> None:
    the_plan = plan(scenarios=2, refinements=2, repeats=1, confirmations=100, requirement=REQUIREMENT)
    first, seeds = fresh(the_plan)
    index_of = {a.scenario_id: a.index for a in first}
    clean = {0: seeds[::2], 3: seeds[::2], 1: seeds[1:]}  # the rest violates in every run

    def value(made: Run) -> float:
        index = index_of.get(made.scenario_id, 9)
        return 2.0 if made.seed in clean.get(index, ()) else 0.4 if index in (0, 3) else 0.5 + index / 100

    attempts = confirming(value, the_plan, ledger=(ledger := MemoryLedger()))
    ended = [(a.confirms, a.verdict.status, a.verdict.runs) for a in confirmations_of(attempts) if a.verdict]
    assert ended[:3] == [(0, Status.FLAKY, 4), (3, Status.FLAKY, 4), (1, Status.INCONCLUSIVE, 4)]
    assert ended[3:] == [(2, Status.FAIL, 15), (1, Status.PASS, 28)]
    assert [a.confirms for a in confirmations(attempts)] == [0, 3, 2, 1]
    early, late = (a for a in attempts if a.purpose == "confirmation" and a.confirms == 1)
    assert late.measurements[:4] == early.measurements
    assert account(attempts).confirmation_runs == 4 + 4 + 15 + 28
    for kept in (len(first), len(attempts) - 1):  # after an interruption the same records follow
        cut = MemoryLedger()
        cut.runs, cut.kept = dict(ledger.runs), list(attempts[:kept])
        assert confirming(value, the_plan, ledger=cut) == attempts


@pytest.mark.slow
def test_a_confirmation_ends_at_the_same_run_in_any_number_of_processes() -> None:
    assert confirmed_with(LATE, jobs=2) == confirmed_with(LATE)


def of_values(index: int, values: list[float], requirement: Requirement) -> Attempt:
    """A scenario whose runs measured these values."""
    brief = Brief(mission=plan().mission, requirement=requirement, seed=0, scenario_index=index)
    proposal = WalkGenerator().propose(brief, warehouse())
    verdict = judge(requirement, values)
    return Attempt(campaign="test", index=index, strategy="study", brief=brief, proposal=proposal, verdict=verdict)


def test_what_violates_the_limit_more_often_ranks_first_and_without_one_the_mean_alone() -> None:
    never, often = [1.01, 1.01, 1.01], [0.9, 0.9, 3.0]
    tied = [0.8, 0.8, 3.0]
    attempts = [of_values(k, values, REQUIREMENT) for k, values in enumerate((never, often, tied, often))]
    assert [a.index for a in ranking(attempts, REQUIREMENT)] == [2, 1, 3, 0]
    best = best_attempt(attempts, REQUIREMENT)
    assert best is not None and best.index == 2
    assert "share of runs" in rule(REQUIREMENT)

    unlimited = REQUIREMENT.replace(limit=None)
    attempts = [of_values(k, values, unlimited) for k, values in enumerate(([0.9, 3.0], [1.5, 1.5], [1.5, 1.5]))]
    assert [a.index for a in ranking(attempts, unlimited)] == [1, 2, 0]
    assert "share of runs" not in rule(unlimited)


@pytest.mark.slow
@pytest.mark.parametrize("max_in_flight", [pytest.param(1, marks=pytest.mark.exhaustive), 3])
@pytest.mark.parametrize(
    "strategy",
    [StudyStrategy, pytest.param(RandomStrategy, marks=pytest.mark.exhaustive)],
)
def test_records_do_not_depend_on_the_number_of_jobs(strategy: type, max_in_flight: int) -> None:
    the_plan = plan(scenarios=4, max_in_flight=max_in_flight)
    one = run(MemoryLedger(), the_plan, strategy, jobs=1)
    two = run(MemoryLedger(), the_plan, strategy, jobs=2)
    assert [a.model_dump_json() for a in one] == [a.model_dump_json() for a in two]


class Ahead(Runner):
    """Begins so many attempts before the first is finished, as that many processes would."""

    begun = 0

    @property
    def lookahead(self) -> int:
        return Ahead.begun


@pytest.mark.exhaustive
@pytest.mark.parametrize("strategy", STRATEGIES)
@settings(max_examples=8, deadline=None)
@given(scenarios=integers(1, 7), refinements=integers(0, 3), max_in_flight=integers(1, 5), ahead=integers(0, 6))
def test_how_far_processes_are_ahead_changes_nothing(
    strategy: type, scenarios: int, refinements: int, max_in_flight: int, ahead: int
) -> None:
    the_plan = plan(
        scenarios=scenarios, refinements=refinements, max_in_flight=max_in_flight, repeats=1, confirmations=0
    )
    one = run(MemoryLedger(), the_plan, strategy)
    Ahead.begun = ahead
    ledger = MemoryLedger()
    runner = Ahead(KinematicSimulator(), warehouse(), measuring=Distance(measure), ledger=CachedLedger(ledger))
    assert searched(strategy, the_plan, ledger, changes={"runner": runner}) == one


def test_a_strategy_keeps_as_many_attempts_under_way_as_the_plan_says() -> None:
    the_plan = plan(scenarios=4, refinements=3, repeats=1, confirmations=0, max_in_flight=4)
    counts: list[int] = []

    class Counting(StudyStrategy):
        def ask(self) -> tuple[Ask, ...]:
            counts.append(len(super().ask()))
            return super().ask()

    run(MemoryLedger(), the_plan, Counting)
    first, *rest = counts
    assert first == 4
    assert sum(count == 4 for count in rest) >= len(rest) - 2 * 4  # fewer at the end


def test_scenarios_side_by_side_are_refined_from_their_own_last_configuration() -> None:
    attempts = run(MemoryLedger(), plan(scenarios=5, refinements=2, repeats=1, confirmations=0, max_in_flight=2))
    by_place = {(a.brief.scenario_index, a.brief.configuration_index): a for a in attempts}
    assert list(by_place)[:6] == [(0, 0), (1, 0), (0, 1), (1, 1), (0, 2), (1, 2)]
    assert list(by_place)[12:] == [(4, 0), (4, 1), (4, 2)]
    for (scenario, configuration), attempt in by_place.items():
        if configuration:
            assert attempt.brief.feedback is not None
            assert attempt.brief.feedback.mean == by_place[scenario, configuration - 1].mean
        else:
            assert len(attempt.brief.memory) == scenario - scenario % 2


@cache
def whole_campaign(strategy: type, max_in_flight: int) -> list[Attempt]:
    return run(MemoryLedger(), plan(max_in_flight=max_in_flight), strategy)


STOPS = [
    (strategy, stop, most) for strategy in [*STRATEGIES, HybridStrategy] for stop in (1, 5, 11, 14) for most in (1, 2)
]


@pytest.mark.parametrize(
    ("strategy", "stop_after", "max_in_flight"),
    [each if each[1:] in ((5, 1), (14, 2)) else pytest.param(*each, marks=pytest.mark.exhaustive) for each in STOPS],
)
def test_a_stopped_campaign_resumes_to_the_same_records(strategy: type, stop_after: int, max_in_flight: int) -> None:
    the_plan = plan(max_in_flight=max_in_flight)
    whole, ledger = whole_campaign(strategy, max_in_flight), MemoryLedger()
    with pytest.raises(KeyboardInterrupt):
        run(ledger, the_plan, strategy, simulator=Fails(KeyboardInterrupt(), lambda number: number > stop_after))
    rest = Counted()
    resumed = run(ledger, the_plan, strategy, simulator=rest)
    assert resumed == whole
    made = len({m.run_id for attempt in whole for m in attempt.measurements})
    assert rest.runs == made - stop_after  # no finished run is made again
    assert run(ledger, the_plan, strategy, simulator=(again := Counted())) == whole and again.runs == 0


@pytest.mark.slow
def test_a_spent_budget_stops_the_campaign_and_what_was_proposed_is_kept() -> None:
    ledger = MemoryLedger()
    with pytest.raises(BudgetSpent):
        run(ledger, strategy=RandomStrategy, generator=Stops(3, error=BudgetSpent), jobs=2)
    assert [a.index for a in ledger.kept] == [0, 1, 2]


def test_an_invalid_proposal_is_kept_without_runs_and_the_scenario_is_asked_for_anew() -> None:
    class Clumsy(WalkGenerator):
        def propose(self, brief: Brief, world: World) -> Proposal:
            proposal = super().propose(brief, world)
            return proposal.replace(scenario=None) if len(self.briefs) == 1 else proposal

    generator = Clumsy()
    attempts = run(MemoryLedger(), generator=generator)
    assert attempts[0].measurements == () and attempts[0].verdict is None
    assert [b.kind for b in generator.briefs][:3] == ["new", "new", "refine"]


class Fails(Counted):
    """Cannot make some of its runs, which it counts from 1."""

    def __init__(self, error: BaseException, fails: Callable[[int], bool]) -> None:
        super().__init__()
        self.error, self.fails = error, fails

    def run(self, scenario: Scenario, world: World, *, seed: int) -> Run:
        made = super().run(scenario, world, seed=seed)
        if self.fails(self.runs):
            raise self.error
        return made


def test_a_run_that_fails_is_recorded_and_the_others_count_if_there_are_any() -> None:
    attempts = run(MemoryLedger(), simulator=Fails(SimulationError("no luck"), lambda number: number == 2))
    assert [f.reason for f in attempts[0].failures] == ["no luck"]
    assert len(attempts[0].measurements) == 1
    ledger = MemoryLedger()
    with pytest.raises(SimulationError, check=coded("no-run")):
        run(ledger, simulator=Fails(SimulationError("no luck"), lambda _: True))
    assert ledger.kept == []


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks at processes in /proc")
def test_workers_end_when_their_parent_is_killed(tmp_path: Path) -> None:
    code = (
        "import sys, time, os, signal\n"
        "from tests.campaign.parts import MemoryLedger, parts, plan\n"
        "from rvsg.search.loop import run_campaign\n"
        "from rvsg.search.strategies import RandomStrategy\n"
        "the_plan = plan(scenarios=1, refinements=0)\n"
        "made = parts(MemoryLedger(), jobs=2)\n"
        "run_campaign(the_plan, RandomStrategy(the_plan), made)\n"
        "print(*(worker.process.pid for worker in made.runner._executor.workers), flush=True)\n"
        "time.sleep(1000)\n"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2]
    )
    assert parent.stdout is not None
    workers = [int(word) for word in parent.stdout.readline().split()]
    assert len(workers) == 2
    parent.kill()
    parent.wait()
    parent.stdout.close()
    deadline = time.monotonic() + 300
    while time.monotonic() < deadline and any(_runs(worker) for worker in workers):
        time.sleep(0.1)
    assert not any(_runs(worker) for worker in workers)


def _runs(process: int) -> bool:
    """Whether a process of that id is there and is more than a remainder nobody waited for."""
    try:
        state = Path(f"/proc/{process}/stat").read_text().rsplit(") ", 1)[1][0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


SEEDS = st.integers(0, 2**63)


@given(SEEDS, st.integers(0, 10_000), st.integers(0, 100))
def test_a_seed_follows_from_purpose_and_index_alone(seed: int, attempt: int, repeat: int) -> None:
    assert seed_for(seed, "search", attempt, repeat) == seed_for(seed, "search", attempt, repeat)
    assert 0 <= seed_for(seed, "search", attempt, repeat) < 2**32


@given(SEEDS, st.integers(1, 40), st.integers(0, 40))
def test_fresh_seeds_are_different_and_none_is_used(seed: int, count: int, taken: int) -> None:
    used = set(fresh_seeds(seed, "confirmation", taken, used=()))  # the very seeds that would come first
    fresh = fresh_seeds(seed, "confirmation", count, used=used)
    assert len(set(fresh)) == count
    assert not used & set(fresh)


def test_purposes_do_not_share_seeds() -> None:
    seeds = {seed_for(0, purpose, index) for purpose in ("brief", "search", "confirmation") for index in range(300)}
    assert len(seeds) == 900


@pytest.mark.parametrize("strategy", [StudyStrategy, HybridStrategy])
def test_a_search_that_forgets_its_runs_and_stores_its_attempts_makes_the_same_records(
    strategy: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runner, "RECENT", 3)

    def made(ledger: Ledger) -> list[Attempt]:
        return searched(strategy, plan(scenarios=3), ledger, generator=HeuristicGenerator())

    kept = made(MemoryLedger())
    with SqliteLedger(tmp_path / "ledger.sqlite") as ledger:
        assert [a.to_json() for a in made(ledger)] == [a.to_json() for a in kept]


def test_where_the_robot_alone_never_arrives_there_is_no_search_unless_asked_for() -> None:
    the_plan, ledger = plan(scenarios=1, refinements=0, repeats=1, confirmations=0), MemoryLedger()
    route = the_plan.mission.route.model_copy(update={"time_limit_s": 0.5})
    the_plan = the_plan.replace(mission=the_plan.mission.replace(route=route))
    for _ in range(2):  # also where its drives are stored
        with pytest.raises(NothingJudged, check=coded("never-arrives")):
            searched(RandomStrategy, the_plan, ledger, changes={"alone": True})
    assert len(searched(RandomStrategy, the_plan, ledger, changes={"alone": True, "search_anyway": True})) == 1
