"""What a model is told of the configurations of a scenario: one order, all runs, and nothing that is no change."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from tests.campaign.parts import REQUIREMENT, Distance, MemoryLedger, WalkGenerator, parts, plan, searched, warehouse
from tests.campaign.test_hybrid import Dear, hybrid

from rvsg.findings.feedback import FeedbackSource, StoredFeedback, rehearsing
from rvsg.findings.ranking import REHEARSAL, badness_of
from rvsg.generation.conversation import VlmGenerator
from rvsg.generation.generator import Proposal, Rehearsal
from rvsg.generation.heuristic import HeuristicGenerator
from rvsg.generation.people_sampler import box
from rvsg.generation.prompts import Prompts, number
from rvsg.generation.result_facts import configuration_object, feedback_facts
from rvsg.generation.vlm.model import Answer, Request
from rvsg.runs.attempt import Attempt, Measurement
from rvsg.runs.ledger import CachedLedger
from rvsg.runs.observation import acting, observe
from rvsg.runs.runner import Runner
from rvsg.scenario.brief import Brief, Feedback
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Pause, Scenario, Task
from rvsg.search.candidates import Candidate, last_written, tried, with_others
from rvsg.search.hybrid import LEAST_FORMS, HybridStrategy
from rvsg.search.loop import run_campaign
from rvsg.search.mutation import Change
from rvsg.search.strategies import Batches, StudyStrategy
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Run
from rvsg.simulation.simulators import make_simulator
from rvsg.world.world import World
from rvsg.world.world_folder import load_world

TIME = Requirement(name="R3", title="Time", text="Arrive.", metric="trg", worse="larger", limit=50.0, unit="s")


def configured(
    index: int,
    values: Sequence[float],
    estimate: float,
    parent: Candidate | None = None,
    *,
    operator: str = "tune",
    requirement: Requirement = REQUIREMENT,
    rehearsals: tuple[tuple[Scenario, float], ...] = (),
) -> Candidate:
    """A candidate whose people walk at a speed of its own."""
    task = Task(name="to", path=("G12", "G13"))
    people = HumanConfiguration(humans=(Human(name="Human 1", tasks=(task,), speed_m_s=1.0 + index / 100),))
    scenario = Scenario(mission=plan().mission, people=people)
    proposal = Proposal(generator="x", scenario=scenario, rehearsals=rehearsals)
    made = Candidate(Attempt.model_construct(index=index, proposal=proposal), parent, operator)
    made.badness = {k: requirement.badness(value) for k, value in enumerate(values)}
    made.estimate, made.deviation = requirement.badness(estimate), 0.02
    return made


def prompt(candidate: Candidate, own: Sequence[Candidate], requirement: Requirement = REQUIREMENT) -> str:
    """The refinement that a model is asked for, as `hybrid` asks for it."""

    def told(c: Candidate) -> Feedback:
        values = tuple(requirement.badness(b) for b in c.badness.values())
        mean = sum(values) / len(values)
        return Feedback(scenario=c.scenario, objectives=values, mean=mean, interval=(mean, mean))

    feedback, last = with_others(told(candidate), candidate, own, requirement), last_written(own)
    if last is not candidate and last is not None:
        feedback = feedback.replace(weaker=told(last).replace(standing=tried(last, own, requirement)))
    facts = {"feedback": feedback_facts(feedback, requirement, {}), "lessons": [], "memory": [], "drive": None}
    given = {"unit": requirement.unit, "worse": requirement.worse, "limit": requirement.threshold}
    return Prompts().render("compact-refine", {**facts, "requirement": given})


def contradictions(text: str, requirement: Requirement = REQUIREMENT) -> list[str]:
    """What a prompt says against its own list."""
    lines = re.findall(r"^- #(\d+) \(.*?; estimate ([\d.]+) ± ", text, re.MULTILINE)
    badness = {number: requirement.badness(float(estimate)) for number, estimate in lines}
    worst = max(badness.values())
    found = [] if list(badness.values()) == sorted(badness.values(), reverse=True) else ["the list is not in order"]
    found += [f"#{n} is not listed" for n in set(re.findall(r"#(\d+)", text)) - badness.keys()]
    for n, estimate in re.findall(r"#(\d+):? ?\(?[^()]*?estimate ([\d.]+)", text):
        if badness.get(n) != requirement.badness(float(estimate)):
            found.append(f"#{n} has two estimates")
    first = re.search(r"Measured #(\d+)", text)
    assert first is not None
    base = badness[first[1]]
    if base < worst and "The first in the order is" not in text:
        found.append("it goes on from another than the first")
    if (last := re.search(r"Your last answer #(\d+) .* stands behind", text)) and badness[last[1]] > base:
        found.append("the last answer stands before the base")
    if ("stands before yours" in text or "The first of them is" in text) and base < worst:
        found.append("another stands before it")
    return found


def test_the_weaker_configuration_is_the_one_with_the_weaker_estimate() -> None:
    """It was told "1.11 m, less bad than the configuration above", which had 1.18 m, where smaller is worse."""
    base = configured(0, [1.18, 1.11, 1.1], 1.13, operator="new")
    last = configured(1, [1.11], 1.16, base, operator="refine")
    text = prompt(base, [base, last])
    assert contradictions(text) == []
    assert "Measured #0: 3 runs: 1.18, 1.11, 1.1 m; mean 1.13; estimate 1.13 ± 0.0329" in text
    assert "Your last answer #1 (1 run: 1.11 m; estimate 1.16 ± 0.0329) stands behind" in text
    assert "chance may explain the difference" in text
    certain = prompt(base, [base, configured(1, [1.4], 1.38, base, operator="refine")])
    assert "chance may explain" not in certain


def test_nothing_is_the_best_beside_a_better_one() -> None:
    """It was told "this is the best of them" beside a better one."""
    first = configured(0, [1.13, 1.18], 1.16, operator="new")
    form, better = configured(1, [1.15], 1.14, first), configured(2, [1.12], 1.12, first)
    assert "The first of them is the configuration above" in prompt(better, [first, form, better])
    text = prompt(form, [first, form, better])
    assert contradictions(text) == []
    assert "One of them is the configuration above" in text and "The first in the order is #2" in text


def test_none_stands_before_yours_where_the_list_says_so() -> None:
    """It was told "none was better than yours (53.9)" beside 56.9 and 57.2."""
    own = [configured(0, [53.9, 65.0], 57.5, operator="new", requirement=TIME)]
    own += [configured(k, [v], v - 1.0, own[0], requirement=TIME) for k, v in ((1, 56.9), (2, 57.2))]
    text = prompt(own[0], own, TIME)
    assert contradictions(text, TIME) == []
    assert "None of them stands before yours." in text and "2 runs: 53.9, 65 s; mean 59.5; estimate 57.5" in text
    assert "above the limit, a violation" in text


def test_every_configuration_is_listed_or_counted() -> None:
    """A configuration of 1.12 m was missing from the list."""
    own = [configured(0, [1.3], 1.3, operator="new")]
    own += [configured(k, [1.12 + k / 50], 1.2 + k / 50, own[0]) for k in range(1, 9)]
    own.append(configured(9, [1.12], 1.21, own[0]))
    text = prompt(own[1], own)
    assert "- #9 (1 run: 1.12 m; estimate 1.21" in text
    listed, rest = len(re.findall("^- #", text, re.MULTILINE)), re.search(r"And (\d+) more, all behind the first", text)
    assert rest is not None and listed + int(rest[1]) == len(own)
    assert contradictions(text) == []


@pytest.mark.parametrize("seed", [7, 8])
def test_no_prompt_of_a_campaign_contradicts_itself(seed: int) -> None:
    generator = Dear()
    hybrid(generator=generator, scenarios=1, refinements=4, proposals=5, budget_runs=50, seed=seed)
    facts = {"lessons": [], "memory": [], "drive": None}
    given = {"unit": "m", "worse": "smaller", "limit": 1.0}
    for brief in generator.briefs[1:]:
        assert brief.feedback is not None
        result = feedback_facts(brief.feedback, REQUIREMENT, {})
        text = Prompts().render("compact-refine", {**facts, "feedback": result, "requirement": given})
        assert contradictions(text) == []


@pytest.mark.parametrize("seed", [2, 4])
def test_a_new_scenario_remembers_the_configuration_that_all_else_calls_the_best(seed: int) -> None:
    """The memory showed the one with the worst mean beside feedback on the one with the worst estimate."""
    generator = Dear()
    hybrid(generator=generator, scenarios=3, refinements=0, proposals=3, budget_runs=30, seed=seed)
    told = [brief for brief in generator.briefs if brief.untold is not None]
    assert len(told) == 2
    for brief in told:
        assert brief.untold is not None and brief.memory[-1].scenario == brief.untold.scenario
        met = brief.untold.encounter
        assert met is not None and brief.memory[-1].mechanism == f"{met.kind}, at {met.place}"


def test_a_rehearsal_is_a_run_of_its_configuration_and_is_told_of_the_one_before() -> None:
    before = configured(1, [50.0], 50.0).scenario
    now = configured(0, [53.9], 53.9).scenario
    pallet = box("pallet", (1.0, -4.0), (1.2, 0.8, 0.2), 0.0, 0.2)
    moved = now.replace(mission=now.mission.replace(moved=(pallet,)))
    values = ((before, 65.0), (now, 60.0), (moved, 40.0))
    made = configured(0, [53.9], 57.0, operator="new", requirement=TIME, rehearsals=values)
    proposal = made.attempt.proposal
    attempt = Attempt.model_construct(proposal=proposal, measurements=(measurement(0, 53.9),))
    made.badness = badness_of(attempt, TIME)
    assert made.badness == {REHEARSAL: 60.0, 0: 53.9} and made.runs == 1
    text = prompt(made, [made, configured(2, [50.0], 50.0, made, requirement=TIME)], TIME)
    assert "2 runs: 60, 53.9 s; mean 57" in text
    assert 'rehearsed with 65 where "Human 1 walks at 1 m/s (was 1.01)"' in text
    assert 'rehearsed with 40 where "without pallet"' in text


def measurement(seed: int, value: float) -> Measurement:
    return Measurement(run_id=f"r{seed}", seed=seed, outcome="reached", values={}, objective=value)


class Silent(FeedbackSource):
    """Knows only that the person reached the second goal."""

    def __call__(self, attempt: Attempt, previous: Attempt | None) -> Feedback:
        raise AssertionError("not asked for")

    def encounter(self, attempt: Attempt) -> None:
        return None

    def reached(self, attempt: Attempt, *, before_closest: bool = False) -> dict[str, int]:
        return {"Human 1": 0 if before_closest else 1}


def walking(pauses: dict[str, float]) -> HumanConfiguration:
    """Somebody who walks six waypoints to and fro, and pauses at some."""
    path = ("G12", "G13", "G14", "G15", "G16", "G17")
    held = tuple(Pause(at=at, duration_s=seconds) for at, seconds in pauses.items())
    tasks = (Task(name="to", path=path, pauses=held), Task(name="fro", path=path[::-1]))
    return HumanConfiguration(humans=(Human(name="Human 1", tasks=tasks),))


def add(strategy: HybridStrategy, index: int, seed: int, pauses: dict[str, float]) -> None:
    """Add a configuration with one run to a search."""
    attempt = Attempt(
        campaign="c",
        index=index,
        strategy="hybrid",
        brief=Brief(mission=plan().mission, requirement=REQUIREMENT, seed=index),
        proposal=Proposal(generator="x", scenario=Scenario(mission=plan().mission, people=walking(pauses))),
        measurements=(measurement(seed, 1.0 + index),),
    )
    strategy._add(attempt, None, "refine")


@pytest.mark.parametrize(
    ("metric", "limit", "kept"), [("min_distance", 1.5, False), ("min_distance", 0.5, True), ("dto", 1.5, True)]
)
def test_what_acts_after_the_moment_that_decides_a_run_is_not_changed(metric: str, limit: float, kept: bool) -> None:
    """The closest approach decides where it fails, and everything of the drive where it does not or a mean counts."""
    requirement = REQUIREMENT.replace(metric=metric, limit=limit)
    strategy = HybridStrategy(plan(requirement=requirement), Silent(), warehouse())
    add(strategy, 0, 0, {})
    (parent,) = strategy.candidates
    for pauses, worth in (({"G13": 3.0}, True), ({"G14": 3.0}, kept)):
        assert strategy._operators._acts(Change(walking(pauses), ""), parent) == worth


def test_an_answer_that_differs_only_after_the_end_of_the_drive_is_a_repeat() -> None:
    strategy = HybridStrategy(plan(), Silent(), warehouse())
    add(strategy, 0, 0, {})
    add(strategy, 1, 1, {"G16": 3.0})  # two goals after the one that is reached
    add(strategy, 2, 0, {"G13": 3.0})
    first, other = strategy.candidates
    assert first.repeats == [1] and first.badness == {0: -1.0, 1: -2.0}
    assert other.index == 2 and last_written([first, other]) is other
    other.repeats, first.repeats = [], [3]
    first.estimate, other.estimate, first.deviation, other.deviation = -1.0, -2.0, 0.1, 0.1
    assert last_written([first, other]) is first
    assert "differs from it only in what acts after the end of the drive" in prompt(first, [first, other])


def test_what_acts_after_the_end_of_a_run_changes_no_bit_of_it() -> None:
    """The runs themselves: a pause that nobody reached before the end, and one that somebody did."""
    simulator, place = make_simulator("embedded"), warehouse()

    def run(pauses: dict[str, float]):
        scenario = Scenario(mission=plan().mission, people=people(pauses))
        return simulator.run(scenario, place, seed=5)

    def people(pauses: dict[str, float]) -> HumanConfiguration:
        slow = walking(pauses).humans[0].replace(speed_m_s=0.35, start_delay_s=2.0)
        path = ("M2", "M3", "M4", "M5", "M6", "M7", "M8", "M9", "M10", "M11", "M12", "M13", "M14")
        held = tuple(Pause(at=at, duration_s=seconds) for at, seconds in pauses.items())
        return HumanConfiguration(humans=(slow.replace(tasks=(Task(name="to", path=path, pauses=held),)),))

    before = run({})
    (person,) = observe(before, place).people
    assert person.reached is not None and 2 <= person.reached <= 8
    assert person.reached_before is not None and person.reached_before < person.reached  # they meet early
    reached = {person.name: person.reached}
    late, early = {"M13": 3.0}, {"M4": 3.0}
    assert acting(people(late), place.grid, reached) == acting(people({}), place.grid, reached)
    assert acting(people(early), place.grid, reached) != acting(people({}), place.grid, reached)
    same = (before.trajectory.human_x == run(late).trajectory.human_x).all()
    assert same and (before.trajectory.x == run(late).trajectory.x).all()
    changed = run(early).trajectory.human_x
    assert len(changed) != len(before.trajectory.human_x) or (changed != before.trajectory.human_x).any()


class Planner:
    """A model that answers each request with the configuration of the offline generator."""

    name = "planner"

    def __init__(self) -> None:
        self.brief, self.world, self.asked = Brief(mission=plan().mission, requirement=None, seed=0), warehouse(), []

    def ask(self, request: Request) -> Answer:
        self.asked.append((self.brief, request))
        scenario = HeuristicGenerator().propose(self.brief, self.world).scenario
        assert scenario is not None
        answer = configuration_object(scenario.people, "Somebody does the ordinary work of this place. " * 8)
        for human in answer["humans"]:  # nobody is there so early
            human["plan"] = [{"at": human["tasks"][0]["path"][-1], "time_s": 0.2}]
            human["tuning"] = {"speed_m_s": "0.9 to 1.3", "pause_s": "fixed"}
        said = {"analysis": "They meet on the way. " * 30, "lesson": "It waits for nobody, and people pass it. " * 4}
        return Answer(text=json.dumps({**said, **answer}), model="planner")


class Planned(VlmGenerator):
    """Tells its model what it is asked for."""

    def __init__(self) -> None:
        self.made = Planner()
        super().__init__(self.made)

    def propose(self, brief: Brief, world: World) -> Proposal:
        self.made.brief, self.made.world = brief, world
        return super().propose(brief, world)


@pytest.fixture(scope="module")
def hospital() -> tuple[Planner, list[Attempt], MemoryLedger]:
    """A campaign with three people, what its model was asked, and its runs."""
    world, ledger = load_world("hospital"), MemoryLedger()
    mission = Mission(world=world.name, world_id=world.id, route=world.route("route_1"))
    given = {"mission": mission, "requirement": REQUIREMENT, "humans": 3, "proposals": 5, "budget_runs": 60}
    the_plan = plan(scenarios=2, refinements=2, confirmations=0, **given)
    simulator, generator, cached = KinematicSimulator(), Planned(), CachedLedger(ledger)
    simulated = rehearsing(simulator, world, seed=1, requirement=REQUIREMENT)

    def rehearse(mission: Mission, people: HumanConfiguration) -> Rehearsal:
        """Rehearse, and say that nobody meets the robot, so that what is planned counts."""
        found = simulated(mission, people)
        return found.replace(people={name: walked.replace(met_s=None) for name, walked in found.people.items()})

    generator.allow_rehearsals(rehearse)
    runner = Runner(simulator, world, measuring=Distance(), jobs=1, ledger=cached)
    made = replace(parts(ledger), generator=generator, runner=runner, ledger=cached)
    strategy = HybridStrategy(the_plan, StoredFeedback(cached, the_plan, world), world)
    with runner:
        return generator.made, run_campaign(the_plan, strategy, made), ledger


def test_no_request_has_more_than_three_thousand_words(hospital: tuple[Planner, list[Attempt], MemoryLedger]) -> None:
    asked = [request for _, request in hospital[0].asked]
    assert {request.purpose for request in asked} == {"new", "refine", "rehearse"}
    assert max(sum(len(message.text.split()) for message in request.messages) for request in asked) <= 3000
    assert all(len(table(request.messages[-1].text)) >= 4 for request in asked if request.purpose == "refine")


def table(text: str) -> list[str]:
    """The lines of the first table of a prompt."""
    return re.findall(r"^\|\d.*$", text.split("Your last answer")[0], re.MULTILINE)


def test_tables_tell_where_everybody_is_in_a_run(hospital: tuple[Planner, list[Attempt], MemoryLedger]) -> None:
    planner, attempts, ledger = hospital
    refined = [(brief, request) for brief, request in planner.asked if request.purpose == "refine"]
    for brief, request in refined:
        text = request.messages[-1].text
        ids = {m.run_id for a in attempts for m in a.measurements if a.scenario_id == brief.feedback.scenario.id}
        shown = re.search(r"^\|s\|robot\|value\|(.*)\|$", text, re.MULTILINE)
        names = [name.strip('"') for name in shown[1].split("|")]
        assert any(all(tells(line, names, ledger.run(run_id)) for line in table(text)) for run_id in ids)
        assert contradictions(text) == []
        (others,) = re.findall(r"^The other scenarios, at their best:\n- ([\d.]+) m: ", text, re.MULTILINE)
        assert others == number(brief.memory[0].mean) and len(brief.memory) == 1
        assert brief.memory[0].scenario.id != brief.feedback.scenario.id


def tells(line: str, names: Sequence[str], run: Run) -> bool:
    """Whether a line of a table is true of a run."""
    time, robot, value, *people = line.strip("|").split("|")
    path = run.trajectory
    k = int(path.t.searchsorted(float(time.split(" to ")[0]) - 1e-6))
    near = np.hypot(path.human_x[k] - path.x[k], path.human_y[k] - path.y[k])
    true = [abs(float(value) - near.min()) < 0.02, at(robot) == pytest.approx((path.x[k], path.y[k]), abs=0.06)]
    for name, told in zip(names, people, strict=True):
        h = run.human_names.index(name)
        true.append((told == "-") == (near[h] > 6.0))
        if told != "-":
            true.append(abs(float(told.rsplit(", ", 1)[1].split()[0]) - near[h]) < 0.02)
            true.append(("(" in told) == (near[h] <= 5.0))
        if "(" in told:
            true.append(at(told) == pytest.approx((path.human_x[k, h], path.human_y[k, h]), abs=0.06))
    return all(true)


def at(told: str) -> tuple[float, ...]:
    """The position in a cell of a table."""
    return tuple(float(each) for each in told.split("(")[1].split(")")[0].split(","))


@pytest.mark.parametrize("seed", [7, 9])
def test_what_a_model_wrote_gets_five_other_forms_while_it_may_be_the_best(seed: int) -> None:
    attempts = hybrid(generator=Dear(), scenarios=2, refinements=1, proposals=4, budget_runs=60, seed=seed)
    first, second, *_ = [a.index for a in attempts if a.brief.kind != "tune"]
    assert len({a.scenario_id for a in attempts[first + 1 : second]}) >= LEAST_FORMS


class Idle(HybridStrategy):
    """Finds nothing to do for its second batch."""

    def search(self) -> Batches:
        yield from self._draft(1)
        yield []
        yield from self._draft(1)


def test_a_batch_for_which_nothing_is_found_ends_no_search() -> None:
    """A campaign ended after one of sixty runs, without a word, where the numbers of a proposal could not change."""
    made = [attempt for attempt in searched(Idle) if attempt.purpose == "search"]
    assert [attempt.brief.scenario_index for attempt in made] == [0, 1]


class Learner(WalkGenerator):
    """A model whose every answer holds a lesson of its own."""

    def propose(self, brief: Brief, world: World) -> Proposal:
        return super().propose(brief, world).replace(lesson=f"Lesson {len(self.briefs) - 1}.")


def test_a_refinement_is_told_the_lesson_that_the_first_answer_of_its_scenario_drew() -> None:
    generator = Learner()
    searched(StudyStrategy, plan(scenarios=3, refinements=2, repeats=2, confirmations=0), generator=generator)
    lessons = {index: brief.lessons for index, brief in enumerate(generator.briefs) if brief.kind == "refine"}
    assert lessons[4] == lessons[5] == ("Lesson 3.",)  # drawn when all of the first scenario was known
    assert lessons[7] == ("Lesson 3.", "Lesson 6.")


def test_objects_are_told_with_a_configuration_and_with_a_change() -> None:
    base = configured(0, [1.3, 1.2], 1.25, operator="new")
    carts = [box("cart", (x, 2.0), (1.0, 0.5, 1.0), 0.0, 0.2) for x in (3.0, 3.4)]
    own = [base]
    for k, cart in enumerate(carts, start=1):
        made = configured(k, [1.0 + 0.1 * k], 1.0 + 0.1 * k, own[-1], operator="refine")
        moved = made.scenario.replace(mission=made.scenario.mission.replace(moved=(cart,)))
        record = made.attempt.model_copy(update={"proposal": Proposal(generator="x", scenario=moved)})
        own.append(Candidate(record, made.parent, made.operator, made.badness, made.estimate, made.deviation))
    assert tried(own[1], own, REQUIREMENT).change.startswith("cart stands at (3, 2), 1 x 0.5 m")
    assert tried(own[2], own, REQUIREMENT).change.startswith("cart stands at (3.4, 2)")
    feedback = Feedback(scenario=own[2].scenario, objectives=(1.2,), mean=1.2, interval=(1.2, 1.2), previous_mean=9.0)
    found = with_others(feedback, own[2], own, REQUIREMENT)
    assert found.previous_mean == pytest.approx(1.1), "the mean that the list gives"
    told = feedback_facts(found, REQUIREMENT, {}, mission=plan().mission)
    assert [thing["x"] for thing in told["best"]["moved"]] == [3.0]
    assert [thing["x"] for thing in told["configuration"]["moved"]] == [3.4]


def test_how_runs_end_is_told() -> None:
    base = configured(0, [1.3, 1.2, 1.1], 1.2, operator="new")
    limit = base.scenario.mission.route.time_limit_s
    ends = ((18.2, True), (5.1, False), (limit, False))
    feedback = Feedback(scenario=base.scenario, objectives=(1.3, 1.2, 1.1), mean=1.2, interval=(1.2, 1.2), ends=ends)
    facts = {"feedback": feedback_facts(feedback, REQUIREMENT, {}), "lessons": [], "memory": [], "drive": None}
    text = Prompts().render("compact-refine", {**facts, "requirement": {"unit": "m", "worse": "smaller", "limit": 1.0}})
    ended = "arrived at 18.2 s; its navigation gave up, which ends the run, at 5.1 s; the time limit ended 1."
    assert f"The robot {ended}" in text
