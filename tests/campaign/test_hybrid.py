from __future__ import annotations

import itertools
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from tests.campaign.parts import (
    REQUIREMENT,
    Distance,
    MemoryLedger,
    Noted,
    Stops,
    WalkGenerator,
    measure,
    parts,
    plan,
    searched,
    warehouse,
)
from tests.campaign.test_failures import run_of

from rvsg.core.errors import BudgetSpent, NotRecorded
from rvsg.evaluation.metrics import measure as measure_all
from rvsg.findings.feedback import StoredFeedback, failure_map
from rvsg.findings.ranking import best_attempt, front_of, hypervolume, measured, seeds_of, share_of, undominated
from rvsg.generation.generator import Call, Proposal
from rvsg.generation.reply_json import TUNABLE
from rvsg.runs.attempt import Attempt, Measurement, Plan
from rvsg.runs.ledger import CachedLedger
from rvsg.runs.observation import encounter_of
from rvsg.scenario.brief import Brief
from rvsg.scenario.requirement import Aim, Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.scenario.variation import differences
from rvsg.search.candidates import Candidate
from rvsg.search.execution import Limits, account
from rvsg.search.hybrid import HybridStrategy, MultiStrategy
from rvsg.search.loop import run_campaign
from rvsg.search.race import FIT, estimate, fit, in_the_race
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Run

PLAN = {"scenarios": 5, "refinements": 3, "repeats": 3, "confirmations": 0, "budget_runs": 60}


def hybrid(ledger: MemoryLedger | None = None, changes: dict[str, object] | None = None, **how: Any) -> list[Attempt]:
    wanted = {key: how.pop(key) for key in list(how) if key in Plan.model_fields}
    return searched(HybridStrategy, plan(**{**PLAN, **wanted}), ledger, changes=changes, **how)


@pytest.fixture(scope="module")
def whole() -> list[Attempt]:
    return hybrid()


def test_it_spends_its_runs_and_tells_what_the_people_should_bring_about(whole: list[Attempt]) -> None:
    runs = {m.run_id for a in whole for m in a.measurements}
    assert 55 <= len(runs) <= 60
    assert {a.brief.aim for a in whole} == {Aim.SHARE}
    assert {a.brief.kind for a in whole} == {"new", "refine", "tune"}
    tuned = [a.proposal for a in whole if a.brief.kind == "tune"]
    assert all(proposal.generator == "hybrid" and proposal.scenario is not None for proposal in tuned)


def test_configurations_share_the_seeds_of_the_race_and_changed_ones_begin_with_another(whole: list[Attempt]) -> None:
    pool = {m.seed for a in whole for m in a.measurements}
    assert len(pool) <= 12
    assert max(len(seeds_of(a)) for a in whole) >= len(pool) / 2
    first = {a.proposal.scenario.id: a for a in reversed(whole) if a.proposal.scenario}.values()
    drafts = {a.measurements[0].seed for a in first if a.brief.kind == "new"}
    changes = {a.measurements[0].seed for a in first if a.brief.kind != "new"}
    assert len(drafts) == 1 < len(changes) and not drafts & changes


@pytest.mark.exhaustive
def test_the_kinds_of_encounter_lend_configurations_to_change(whole: list[Attempt]) -> None:
    the_plan, made = plan(**PLAN), parts(MemoryLedger())
    feedback = StoredFeedback(made.ledger, the_plan, warehouse())
    strategy = HybridStrategy(the_plan, feedback, warehouse(), explore=1.0)
    with made.runner:
        run_campaign(the_plan, strategy, made)
    assert len(strategy.elites()) > 1
    changed = {c.parent.index for c in strategy.candidates if c.parent is not None}
    ranked = sorted(strategy.candidates, key=lambda c: -c.estimate)
    assert len(changed - {c.index for c in ranked[:3]}) > 1


def test_what_has_lost_gets_no_further_run_and_the_best_is_worse_than_the_drafts(whole: list[Attempt]) -> None:
    runs = sorted(len(seeds_of(a)) for a in measured(whole))
    assert runs[0] == 1 and runs[-1] >= 4
    assert sum(count >= 4 for count in runs) <= 8
    best, drafts = best_attempt(whole, plan().requirement), [a for a in whole if a.brief.kind == "new"]
    assert best is not None and best.mean is not None and len(seeds_of(best)) >= runs[-1] / 2
    assert best.mean < min(a.mean for a in measured(drafts) if a.mean is not None)


def test_the_runs_of_a_batch_begin_before_their_turn_and_no_others() -> None:
    ledger = MemoryLedger()
    runner = Noted(KinematicSimulator(), warehouse(), measuring=Distance(measure), ledger=CachedLedger(ledger))
    hybrid(ledger, {"runner": runner})
    assert {run for run, _ in runner.made} == runner.begun
    ahead = [begun - k for k, (_, begun) in enumerate(runner.made)]
    assert max(ahead) >= 4  # half a batch


def candidate(index: int, *badness: float, parent: Candidate | None = None) -> Candidate:
    made = Candidate(Attempt.model_construct(index=index), parent)
    made.badness = dict(enumerate(badness))
    return made


def test_neither_one_lucky_run_of_a_noisy_objective_nor_an_easy_seed_makes_a_favourite() -> None:
    steady = candidate(0, 3.0, 5.0, 4.0, 4.0, 3.5, 4.5)
    lucky = candidate(1, 5.2)
    spread = [1.0 - 0.1 * k if k % 2 else 0.1 * k - 1.0 for k in range(2, 8)]
    others = [candidate(k, 3.0 + by, 3.0 - by) for k, by in enumerate(spread, 2)]
    estimate([steady, lucky, *others])
    assert lucky.estimate < steady.mean + 0.3
    assert lucky.deviation > steady.deviation

    # All configurations are 2 worse for the robot under seed 0, and one of them met no other.
    known = [candidate(k, 5.0 + 0.1 * k, 3.0 + 0.1 * k, 3.1 + 0.1 * k) for k in range(6)]
    lucky = candidate(6, 5.1)
    estimate([*known, lucky])
    assert lucky.mean > known[-1].mean + 0.5
    assert lucky.estimate < known[-1].estimate


def test_estimates_of_a_long_line_of_changes_and_of_a_quiet_objective_stay_near_what_was_measured() -> None:
    line = [candidate(0, 1.0)]
    for k in range(1, 12):
        line.append(candidate(k, 1.0 - 0.01 * (k % 3), parent=line[-1]))
    for _ in range(5):
        estimate(line)
        assert all(abs(each.estimate - 1.0) < 0.05 for each in line)

    quiet = [candidate(k, 1.0 + k, 1.001 + k) for k in range(5)]
    estimate(quiet)
    assert in_the_race(quiet) == [quiet[-1]]
    assert fit.signatures == [FIT], "what is compiled beforehand is what is called"


class Dear(WalkGenerator):
    """A generator whose every proposal costs a call of a model; its answers may be invalid or alike."""

    asks_a_model = True

    def __init__(self, *, fails: bool = False, repeats: bool = False) -> None:
        super().__init__()
        self.fails, self.repeats, self.answers = fails, repeats, list[Scenario]()

    def propose(self, brief: Brief, world: object) -> Proposal:
        asked = brief.replace(seed=3, scenario_index=0) if self.repeats else brief
        proposal = super().propose(asked, world)  # type: ignore[arg-type]
        assert proposal.scenario is not None
        self.answers.append(proposal.scenario)
        call = Call(purpose=brief.kind, model="walk", input_tokens=1000, output_tokens=200)
        proposal = proposal.replace(calls=(call,), lesson="Corners hold it up.", reasoning="They meet.")
        return proposal.replace(scenario=None) if self.fails else proposal


TURNS = {"scenarios": 2, "refinements": 1, "proposals": 4, "budget_runs": 32}


@pytest.fixture(scope="module")
def turns() -> tuple[list[Attempt], Dear]:
    generator = Dear()
    return hybrid(generator=generator, **TURNS), generator


def test_with_few_proposals_each_is_tuned_before_the_next(turns: tuple[list[Attempt], Dear]) -> None:
    attempts, generator = turns
    assert [brief.kind for brief in generator.briefs] == ["new", "new", "refine", "refine"]
    assert all(brief.tunes for brief in generator.briefs)
    kinds = [a.brief.kind for a in attempts]
    asked = [attempts.index(next(a for a in attempts if a.brief == brief)) for brief in generator.briefs]
    for before, after in pairwise([*asked, len(attempts)]):
        assert "tune" in kinds[before + 1 : after]
    runs = {m.run_id for a in attempts for m in a.measurements}
    assert 28 <= len(runs) <= 32


def test_the_generator_is_told_its_ideas_at_their_best(turns: tuple[list[Attempt], Dear]) -> None:
    attempts, generator = turns
    _, second, third, _ = generator.briefs
    assert second.untold is not None and second.untold.rows
    known = [a for a in attempts if a.brief.scenario_index == 0]
    first = next(a for a in known if a.brief.kind == "new")
    assert first.mean is not None
    assert plan().requirement.badness(second.untold.mean) >= plan().requirement.badness(first.mean)
    # The second proposal said what the first scenario had taught, which a refinement of the other one is told.
    assert third.feedback is not None and third.lessons == (("Corners hold it up.",) if third.scenario_index else ())
    assert [remembered.lesson for remembered in third.memory] == ["Corners hold it up." if third.scenario_index else ""]
    assert any(brief.feedback is not None and brief.feedback.tuned for brief in generator.briefs)


@pytest.mark.parametrize("calls", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_a_spent_budget_of_calls_leaves_the_rest_of_the_runs_to_the_optimiser_but_needs_one(calls: int) -> None:
    generator = Dear()
    attempts = hybrid(generator=generator, **TURNS, changes={"limits": Limits(calls=calls)})
    assert len(generator.briefs) == calls
    runs = {m.run_id for a in attempts for m in a.measurements}
    assert 28 <= len(runs) <= 32
    numbers = {(a.brief.scenario_index, a.brief.configuration_index) for a in attempts}
    for scenario in {number for number, _ in numbers}:
        own = sorted(configuration for at, configuration in numbers if at == scenario)
        assert own == list(range(len(own)))
    assert account(attempts).calls == calls
    with pytest.raises(BudgetSpent):
        hybrid(generator=Dear(), **TURNS, changes={"limits": Limits(calls=0)})


@pytest.mark.slow
@pytest.mark.parametrize(
    "cut", [pytest.param(3, marks=pytest.mark.exhaustive), 9, pytest.param(20, marks=pytest.mark.exhaustive)]
)
def test_turns_resume_to_the_same_records_after_the_budget_was_spent(cut: int) -> None:
    limits = {"limits": Limits(calls=2)}
    whole = hybrid(generator=Dear(), **TURNS, changes=limits)
    ledger = MemoryLedger()
    asked = itertools.count(1)
    stops = {**limits, "cancelled": lambda: next(asked) > cut * 3}
    hybrid(ledger, generator=Dear(), **TURNS, changes=stops)
    assert len(ledger.kept) < len(whole)
    assert hybrid(ledger, generator=Dear(), **TURNS, changes=limits) == whole


def test_a_model_that_never_answers_well_costs_its_proposals_and_one_that_repeats_itself_is_tuned() -> None:
    generator = Dear(fails=True)
    assert len(hybrid(generator=generator, **TURNS)) == len(generator.briefs) == 4
    generator = Dear(repeats=True)
    attempts = hybrid(generator=generator, **TURNS)
    assert len(generator.briefs) == 4
    assert len({m.run_id for a in attempts for m in a.measurements}) >= 28


def test_a_record_that_ends_leaves_the_rest_to_the_optimiser_as_the_budget_did() -> None:
    told = hybrid(generator=Dear(), **TURNS, changes={"limits": Limits(calls=2)})
    assert hybrid(generator=Stops(2, Dear(), NotRecorded), **TURNS) == told


def test_a_refinement_is_told_what_the_optimiser_changed(turns: tuple[list[Attempt], Dear]) -> None:
    """The model starts from the best form, which it sees in full, and is told what its own had measured."""
    attempts, generator = turns
    for brief in generator.briefs[1:]:
        told = brief.feedback or brief.untold
        assert told is not None and told.tuning is not None and told.best is None
        known = attempts[: next(k for k, a in enumerate(attempts) if a.brief == brief)]
        assert told.tuning.origin is not None and told.tuning.origin.number is not None
        origin = attempts[told.tuning.origin.number]
        assert origin.brief.kind != "tune"
        (own,) = (a for a in measured(known) if a.scenario_id == origin.scenario_id)
        assert own.mean is not None and told.tuning.mean == pytest.approx(own.mean)
        assert told.tuning.runs == len(own.measurements)
        assert told.tuning.forms > 0
        assert own.proposal.scenario is not None
        people = own.proposal.scenario.people
        assert told.tuned == bool(told.tuning.change)
        assert told.tuning.change == (differences(people, told.scenario.people) if told.tuned else "")


class Strict(Dear):
    """A generator that lets nothing change but one speed, within a range."""

    def propose(self, brief: Brief, world: object) -> Proposal:
        proposal = super().propose(brief, world)
        assert proposal.scenario is not None
        names = [human.name for human in proposal.scenario.people.humans]
        fixed = dict.fromkeys(TUNABLE)
        speed = proposal.scenario.people.humans[0].speed_m_s
        free = fixed | {"speed_m_s": (speed - 0.05, speed + 0.05)}
        return proposal.replace(limits={names[0]: free, **dict.fromkeys(names[1:], fixed)})


def test_the_optimiser_keeps_to_what_the_generator_left_free_and_passes_it_on() -> None:
    generator = Strict()
    attempts = hybrid(generator=generator, **TURNS)
    tuned = [a for a in attempts if a.brief.kind == "tune"]
    written = {a.brief.scenario_index: a for a in attempts if a.brief.kind == "new"}
    assert len(tuned) > 3
    for attempt in tuned:
        assert attempt.proposal.scenario is not None
        first, *others = attempt.proposal.scenario.people.humans
        origins = [a for a in attempts if a.brief.kind != "tune" and a.proposal.limits == attempt.proposal.limits]
        before = [a.proposal.scenario.people.humans for a in origins if a.proposal.scenario is not None]
        low, high = attempt.proposal.limits[first.name]["speed_m_s"] or (0.0, 0.0)
        assert low <= first.speed_m_s <= high
        assert any(tuple(others) == humans[1:] and first.tasks == humans[0].tasks for humans in before)
    told = [brief.feedback for brief in generator.briefs if brief.feedback is not None]
    assert told and all(f.limits for f in told) and written


def test_a_refinement_is_told_why_the_last_answer_was_weaker() -> None:
    """Where the model goes on from an earlier configuration, the table of its last answer stands beside that one's."""
    generator = Dear()
    hybrid(generator=generator, scenarios=1, refinements=4, proposals=5, budget_runs=50)
    first, *refining = (brief.feedback for brief in generator.briefs)
    assert first is None
    told = []
    for k, feedback in enumerate(refining):
        assert feedback is not None
        if feedback.weaker is not None:
            assert feedback.weaker.scenario.people == generator.answers[k].people
            assert feedback.weaker.rows
            told.append(k)
    assert told and told[0] > 0, "the first refinement goes on from the only answer"


def test_an_encounter_says_where_on_the_way_it_is_and_who_is_met() -> None:
    met = encounter_of(run_of((0.0, 1.0), (0.0, 0.0)), warehouse())
    assert met is not None
    assert (met.stretch, met.who, met.kind) == ("middle third", "Human 1", "stands beside it")


def test_the_map_holds_the_worst_configuration_of_every_kind() -> None:
    attempts = searched(HybridStrategy, plan(**PLAN), ledger := MemoryLedger())
    cells = failure_map(attempts, plan().requirement, run_of=ledger.run, world=warehouse())
    assert len({cell.encounter for cell in cells}) == len(cells) > 3
    assert sum(cell.configurations for cell in cells) == len(measured(attempts))
    shares = [cell.violations / cell.runs for cell in cells]
    assert shares == sorted(shares, reverse=True)
    assert len({m.run_id for a in attempts for m in a.measurements}) == 60
    assert max(len(a.measurements) for a in measured(attempts)) > 1


LATE = Requirement(name="R3", title="Time", text="Arrive.", metric="trg", worse="larger", limit=20.0, unit="s")
NEAR = REQUIREMENT.replace(limit=10.0)


def times(run: Run, _place: object = None) -> Measurement:
    return measure(run).replace(values=measure_all(run, ["trg"]))


def test_a_value_is_a_share_of_what_violates_and_the_front_holds_what_none_beats_and_one_of_equals() -> None:
    assert [share_of(NEAR, value) for value in (10.0, 5.0, 30.0)] == pytest.approx([1.0, 1.5, 0.0])
    assert share_of(LATE, 10.0) == pytest.approx(0.5)
    shares = np.array([[1.0, 1.0], [2.0, 0.5], [0.5, 0.5], [1.0, 1.0], [2.0, 0.4]])
    assert undominated(shares) == [0, 1]


@pytest.mark.parametrize(
    ("points", "volume"),
    [
        ([], 0.0),
        ([(1.0, 1.0)], 1.0),
        ([(2.0, 0.5), (1.0, 1.0)], 1.5),
        ([(2.0, 0.0)], 0.0),
        ([(1.0, 1.0, 1.0), (2.0, 1.0, 0.5), (0.5, 0.5, 2.0)], 1.75),
    ],
)
def test_the_hypervolume_is_what_the_front_dominates(points: list[tuple[float, ...]], volume: float) -> None:
    assert hypervolume(points) == pytest.approx(volume)


def test_multi_spends_its_runs_and_repeats_its_front() -> None:
    the_plan = plan(**PLAN | {"requirement": NEAR, "also": (LATE,), "repeats": 2, "budget_runs": 40})
    found = searched(MultiStrategy, the_plan, measure=times)
    assert len({m.run_id for a in found for m in a.measurements}) == 40
    front = front_of(the_plan, found)
    assert front.points and front.hypervolume > 0.0
    for point in front.points:
        assert [tried.requirement for tried in point.tried] == ["R1", "R3"]
        assert all(tried.runs > 1 for tried in point.tried)
    shares = [[tried.share for tried in point.tried] for point in front.points]
    assert undominated(np.array(shares)) == list(range(len(shares)))
    assert shares == sorted(shares, reverse=True)
