"""Tuning a stack on a suite: parameters, the search, the checks, the files, and what is refused."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from tests.coded import coded

import rvsg
from rvsg.cli.tune import _Shown
from rvsg.core.documents import DocumentError
from rvsg.core.errors import FileError, InputError, UnknownName
from rvsg.core.plugins import Spec
from rvsg.core.records import Pose
from rvsg.evaluation.verdict import Procedure
from rvsg.robots.robot import load_robot
from rvsg.simulation.run import Outcome
from rvsg.simulation.stacks.parameter_file import (
    has_filters,
    has_place,
    skeleton,
    with_filters_in_file,
    with_values_in_file,
)
from rvsg.simulation.stacks.parameters import Parameter, value_at, with_values
from rvsg.simulation.stacks.stack_choice import StackChoice
from rvsg.suites.suite import compare
from rvsg.suites.suite_folder import SuiteCase
from rvsg.tune.parameter_search import SEEDS, ParameterSearch, TunedSetting, is_worse, score_of, unsolved
from rvsg.tune.setting_runs import SettingRun, SettingRuns, results_of
from rvsg.tune.tuner import ASKED, RUNS, Tuner
from rvsg.tune.tuning import Choice, ProposalCheck, Tuning, split
from rvsg.tune.tuning_page import headline, trade, tuning_page, unsolved_text
from rvsg.tune.zones import Zones, zones_around
from rvsg.world.occupancy import write_mask

EXAMPLES = Path(__file__).parents[2] / "examples" / "stacks"
PLANNER = '''
from follow_the_plan import FollowThePlan
from rvsg.stacks import Parameter

class Waits(FollowThePlan):
    """Follows the plan after `wait_s`."""

    def __init__(self, wait_s: float = 6.0, speed: float = 0.5, crash_over_s: float = 100.0) -> None:
        super().__init__(speed)
        self.wait_s, self.crash_over_s = wait_s, crash_over_s

    def tunable_parameters(self, robot):
        return (
            Parameter(name="wait_s", low=0.0, high=8.0, unit="s", source="a test"),
            Parameter(name="speed", low=0.2, high=1.0, unit="m/s", source="a test"),
        )

    def reset(self, task):
        super().reset(task)
        if self.wait_s > self.crash_over_s:
            raise RuntimeError("this planner cannot wait so long")

    def command(self, seen):
        return (0.0, 0.0) if seen.t < self.wait_s else super().command(seen)
'''
KEPT = r'''

class Kept(Waits):
    """Keeps its parameters in a file."""

    def parameter_file(self):
        return "wait.yaml", f"# of hall 4\nwait_s: {self.wait_s}\nspeed: {self.speed}\n"
'''
STILL = "still: {title: Moves on, text: Stand still for at most 3 s., metric: tnm, worse: larger, limit: 3.0}\n"
NAV2 = """\
# The robot of hall 4.
controller_server:
  ros__parameters:
    controller_frequency: 20.0   # Hz
    FollowPath:
      plugin: "dwb_core::DWBLocalPlanner"
      max_vel_x: 0.40            # the forks are up
      BaseObstacle.scale: 0.02
collision_monitor:
  ros__parameters:
    observation_sources: ["scan"]
    scan: {type: "scan", topic: "scan"}
    polygons: ["Ahead"]
    Ahead: {type: "polygon", action_type: "approach", time_before_collision: 1.2}
"""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("planner.py").write_text(PLANNER)
    shutil.copy(EXAMPLES / "follow_the_plan.py", tmp_path)
    Path("still.yaml").write_text(STILL)
    return tmp_path


def suite_of(folder: str = "suite", *, cases: int = 3) -> rvsg.Suite:
    """A suite in which people cross the aisle that the robot drives along."""
    suite = rvsg.Suite.create(folder)
    ends = [("E15", "H15"), ("H16", "E16"), ("E14", "H14")]
    for k, (begin, end) in enumerate(ends[:cases]):
        walk = rvsg.walk("Anna", begin, end, speed_m_s=1.0 + 0.2 * k)
        scenario = rvsg.scenario(rvsg.load_world("warehouse"), "route_1", [walk])
        suite = suite.add(scenario, "../still.yaml#still", name=f"case-{k}", expected="pass")
    return suite


def tuner(**changes: Any) -> Tuner:
    given = {
        "suite": Path("suite"), "stack": "planner.py:Waits", "out": Path("out"), "budget_runs": 60, "check_runs": 2,
        "attack_runs": 0,
    }  # fmt: skip
    return Tuner(**{**given, **changes})


def run(case: str, seed: int, *, violated: bool = False, contact: bool = False, time_s: float = 10.0) -> SettingRun:
    return SettingRun(
        case=case, seed=seed, run_id=f"{case}-{seed}", outcome=Outcome.REACHED.value,
        objectives=(4.0 if violated else 0.0,),
        violations=(violated,), contact=contact, time_s=time_s, jerk=1.0, kind="stands ahead of it" if violated else "",
    )  # fmt: skip


# Parameters


@pytest.mark.parametrize("name", ["nav2-dwb", "nav2-rpp", "nav2-mppi", "social", "stop-and-go"])
def test_every_declared_parameter_is_read_by_its_stack(name: str) -> None:
    robot = load_robot("tiago_omni")
    choice = StackChoice.of(name)
    declared = choice.driver.tunable_parameters(robot)
    assert declared and len({each.name for each in declared}) == len(declared)
    for each in declared:
        assert each.source and each.present is not None and each.low <= each.present <= each.high
        assert each.at(each.share(each.present)) == pytest.approx(each.present)
        for share in (0.0, 0.5, 1.0):
            value = each.value(each.at(share))
            options = with_values(choice.record.options, {each.name: value})
            changed = StackChoice.of(Spec(name, options))
            assert value_at(changed.record.options, each.name) == value
            changed.driver.adapt(robot)


def test_a_range_may_not_be_empty() -> None:
    for low, high, log in ((1.0, 1.0, False), (2.0, 1.0, False), (-1.0, 1.0, True)):
        with pytest.raises(ValueError):
            Parameter(name="x", low=low, high=high, log=log)


def test_only_changed_lines_of_a_parameter_file_change() -> None:
    values = {"max_vel_x": 0.35, "BaseObstacle.scale": 0.1, "sim_time": 2.0,
              "collision_monitor.0.time_before_collision": 2.5}  # fmt: skip
    after = with_values_in_file(NAV2, Path("nav2.yaml"), values)
    old, new = NAV2.splitlines(), after.splitlines()
    assert [line for line in old if line not in new] == [
        "      max_vel_x: 0.40            # the forks are up",
        "      BaseObstacle.scale: 0.02",
        '    Ahead: {type: "polygon", action_type: "approach", time_before_collision: 1.2}',
    ]
    assert [line for line in new if line not in old] == [
        "      max_vel_x: 0.35            # the forks are up",
        "      BaseObstacle.scale: 0.1",
        "      sim_time: 2.0",
        '    Ahead: {type: "polygon", action_type: "approach", time_before_collision: 2.5}',
    ]
    assert not has_place(NAV2, Path("nav2.yaml"), "costmaps.local_inflation_m", 0.7)
    with pytest.raises(FileError, check=coded("no-place")):
        with_values_in_file(NAV2, Path("nav2.yaml"), {"behaviours.wait_s": 1.0})


@pytest.mark.parametrize("stack", ["nav2-dwb", "nav2-rpp", "nav2-mppi"])
def test_a_built_in_stack_gets_a_file_that_drives_the_same(stack: str) -> None:
    robot, text = load_robot("tiago_omni"), skeleton(stack)
    assert text is not None and skeleton("social") is None
    choice = StackChoice.of(stack)
    values = {each.name: each.value(each.at(0.6)) for each in choice.driver.tunable_parameters(robot)}
    after = with_values_in_file(text, Path("nav2_params.yaml"), values)
    from rvsg.simulation.stacks.nav2_params import read_nav2_text

    read = read_nav2_text(after, Path("nav2_params.yaml"))
    mine = StackChoice.of(Spec(stack, with_values(choice.record.options, values)))
    theirs = StackChoice.of(Spec(read.stack, read.options))
    assert mine.driver.adapt(robot).navigation.costmaps == theirs.driver.adapt(robot).navigation.costmaps
    assert mine.driver.adapt(robot).navigation.dwb == theirs.driver.adapt(robot).navigation.dwb
    for name, value in values.items():
        assert value_at(theirs.record.options, name) == value


# The race


def test_a_loser_is_stopped_by_the_test_of_a_verdict_and_a_faster_one_is_not() -> None:
    keys = [(f"case-{k}", seed) for k in range(5) for seed in range(3)]
    best = {key: run(*key) for key in keys}
    for lost in range(len(keys) + 1):
        worse = {key: run(*key, violated=k < lost) for k, key in enumerate(keys)}
        assert is_worse(worse, best) == (lost >= 7)
    faster = {key: run(*key, violated=True, time_s=9.0) for key in keys}
    assert not is_worse(faster, best)


def test_the_score_names_what_breaks() -> None:
    keys = [(case, seed) for case in ("fails", "passes") for seed in range(SEEDS)]
    before = {key: run(*key, violated=key[0] == "fails") for key in keys}
    after = {key: run(*key, violated=key[0] == "passes", contact=key[0] == "passes", time_s=12.0) for key in keys}
    found = score_of(after, before)
    assert found.broken_cases == ("passes",) and found.new_contacts == ("passes",)
    assert found.time == pytest.approx(1.2) and (found.violated, found.contacts, found.runs) == (3, 3, 6)
    once = {key: run(*key, violated=key == ("passes", 0)) for key in keys}
    assert score_of(once, before).broken_cases == (), "one violation in three runs breaks nothing"
    assert score_of(after, before, Procedure(error_rate=0.0001)).broken_cases == (), "nor do three for a strict suite"
    assert trade(found, score_of(before, before)) == (
        "as many violations, contact in 3 of 6 runs, 20 % longer, passes breaks"
    )


def test_no_kind_of_failure_is_in_both_parts(here: Path) -> None:
    suite = suite_of()
    cases = [suite.tested(case.name) for case in suite.cases]
    apart = [run("case-0", 0, violated=True), run("case-1", 0, violated=True).replace(kind="crosses"), run("case-2", 0)]
    found = split(cases, apart)
    assert not found.note and {found.kinds[name] for name in found.tuned} == {"crosses", "passes"}
    assert found.held_out == ("case-0",)
    same = split(cases, [run(case.name, 0, violated=True) for case in cases])
    assert same.note and same.held_out == ("case-1",)


# A whole tuning


@pytest.mark.slow
def test_a_tuning_proposes_a_setting_and_resumes_with_the_same_result(here: Path) -> None:
    suite_of()
    said: list[str] = []
    asked = tuner(budget_runs=40, attack_runs=10, out=here / "out", on_message=said.append)
    found = asked.run()
    assert found.proposal and found.changes and found.score is not None
    assert found.score.cost < found.before.cost and found.settings > 4
    most = len(found.split.tuned) * SEEDS
    assert 40 - most < found.runs <= 40, "the budget holds, and no other setting fits"
    assert {part.name for part in found.parts} >= {"tuned", "ordinary", "empty", "attacked"}
    (note,) = rvsg.Suite.open("suite").head.tunings
    assert (note.stack, note.folder) == ("planner.py:Waits", "../out")
    assert any("suite.yaml now notes" in text for text in said)
    tuned = len(found.split.tuned)
    (checked,) = (text for text in said if text.startswith("Checking tuned"))
    assert checked.endswith(f"before and after: {4 * tuned} runs.")
    assert any("at most" in text and "beside the search" in text for text in said)
    assert Tuning.from_json(Path("out/tuning.json").read_text()) == found
    assert headline(found) in Path("out/index.html").read_text().replace("\N{NO-BREAK SPACE}", " ")
    stored = json.loads(Path("out/stack.json").read_text())
    assert stored["options"] == {**found.stack.options, **{c.name: c.after for c in found.changes}}

    lines = Path("out", RUNS).read_text().splitlines(keepends=True)
    Path("out", RUNS).write_text("".join(lines[: len(lines) // 2]) + lines[-1][:30])  # as a kill leaves it
    assert asked.run() == found
    assert sorted(Path("out", RUNS).read_text().splitlines(keepends=True)) == sorted(lines)

    elsewhere = replace(asked, out=Path("two"), jobs=2).run()
    assert elsewhere.replace(commands=()) == found.replace(commands=())
    assert sorted(Path("two", RUNS).read_text().splitlines(keepends=True)) == sorted(lines)

    other = next((each.number for each in found.front if each.number not in (0, found.proposal)), None)
    if other is not None:
        assert replace(asked, choose=other).run().proposal == other
    with pytest.raises(InputError, check=coded("not-on-front")):
        replace(asked, choose=10_000).run()


@pytest.mark.slow
def test_settings_in_which_the_stack_crashes_are_counted_and_never_proposed(here: Path) -> None:
    suite_of(cases=2)
    found = tuner(stack_options={"crash_over_s": 6.5}).run()
    assert found.failed and all("failed" in each for each in found.failed)
    assert all(each.values.get("wait_s", 0.0) <= 6.5 for each in found.front)
    assert "refused" in tuning_page(found) or "fail" in tuning_page(found)


@pytest.mark.slow
def test_a_stack_that_keeps_its_parameters_in_a_file_gets_the_changed_file(here: Path) -> None:
    Path("planner.py").write_text(PLANNER + KEPT)
    suite_of(cases=1)
    found = tuner(stack="planner.py:Kept", budget_runs=40).run()
    assert found.file == "wait.yaml" and found.changes
    text = Path("out/wait.yaml").read_text()
    assert all(f"{each.name}: {each.after}" in text for each in found.changes)
    assert [line for line in found.diff if line.startswith("-w")] == ["-wait_s: 6.0"]
    assert all("--stack planner.py:Kept" in each and "--stack-option wait_s=" in each for each in found.commands)


def test_the_progress_of_a_search_names_what_it_ran(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    suite = suite_of(cases=1)
    cases = [suite.tested(case.name) for case in suite.cases]
    parameter = Parameter(name="wait_s", low=0.0, high=8.0, present=6.0)
    with SettingRuns(Spec("x"), {"wait_s": 6.0}, Path("runs.jsonl")) as runs:
        search = ParameterSearch([parameter], cases, runs)
        made = {("case-0", seed): run("case-0", seed, violated=True) for seed in search.seeds}
        search.candidates.append(TunedSetting(0, {"wait_s": 6.0}, made, score=score_of(made, made)))
        search.spent = 30
        _Shown(60).show(search)
        said = " ".join(capsys.readouterr().err.split())
        assert said.startswith("search: 30 of 60 runs, about 0 min of it left; 1 settings, violations 3 to 3 of 3")


# What is refused


def test_a_suite_in_which_nothing_fails_is_refused(here: Path) -> None:
    Path("still.yaml").write_text(STILL.replace("limit: 3.0", "limit: 1000.0"))
    suite_of(cases=1)
    with pytest.raises(InputError, check=coded("nothing-to-tune")) as refused:
        tuner(stack="nav2-dwb").run()
    assert "rvsg run --stack nav2-dwb" in str(refused.value)


@pytest.mark.parametrize(
    ("text", "kind", "code"),
    [
        ("parameters: [{name: wait_s, low: 3, high: 3}]", DocumentError, "document"),
        ("parameters: [{name: nothing, low: 1, high: 3}]", InputError, "nothing-reads"),
        ("fixed: {nothing: 1}", InputError, "nothing-reads"),
        ("only: [wait]", UnknownName, "unknown-name"),
        ("fixed: {wait_s: 1, speed: 0.5}", InputError, "no-parameters"),
        ("ranges: {}", DocumentError, "document"),
    ],
)
def test_a_file_of_parameters_that_cannot_be_used_is_one_error(
    here: Path, text: str, kind: type[InputError], code: str
) -> None:
    suite_of(cases=1)
    Path("mine.yaml").write_text(text)
    with pytest.raises(kind, check=coded(code)) as refused:
        tuner(narrowing=Path("mine.yaml")).run()
    assert "mine.yaml" in str(refused.value) or code == "no-parameters"


def test_a_stack_that_fails_as_it_is_and_other_bad_input_is_one_error(here: Path) -> None:
    suite_of(cases=1)
    with pytest.raises(InputError, check=coded("stack-fails")):
        tuner(stack_options={"crash_over_s": 4.0}).run()
    with pytest.raises(UnknownName):
        tuner(optimiser="best").run()
    with pytest.raises(InputError, check=coded("budget-too-small")):
        tuner(budget_runs=5).run()
    Path("out").mkdir(exist_ok=True)
    Path("out", RUNS).write_text("{}\n")
    with pytest.raises(FileError) as damaged:
        tuner().run()
    assert damaged.value.line == 1


def test_another_stack_or_seed_does_not_resume_a_tuning(here: Path) -> None:
    suite_of(cases=1)
    tuner(budget_runs=6, budget_minutes=1e-9).run()
    known = Path("out", ASKED).read_bytes(), Path("out", RUNS).read_bytes()
    for changes, named in (({"seed": 3}, "seed: 0, now 3"), ({"stack": "nav2-dwb"}, "stack.name: 'planner.py:Waits'")):
        with pytest.raises(InputError, check=coded("other-settings")) as refused:
            tuner(**changes).run()
        assert named in str(refused.value)
    assert known == (Path("out", ASKED).read_bytes(), Path("out", RUNS).read_bytes())
    Path("out", ASKED).write_text("[")
    with pytest.raises(FileError):
        tuner().run()


def test_a_file_without_an_inflation_layer_says_what_stays(here: Path) -> None:
    Path("still.yaml").write_text(STILL.replace("limit: 3.0", "limit: 1000.0"))
    suite_of(cases=1)
    Path("nav2.yaml").write_text(NAV2)
    said: list[str] = []
    with pytest.raises(InputError, check=coded("nothing-to-tune")):
        tuner(stack="nav2.yaml", on_message=said.append).run()
    assert any("costmaps.local_inflation_m" in text for text in said)
    assert yaml.safe_load(NAV2)["controller_server"]["ros__parameters"]["FollowPath"]["max_vel_x"] == 0.4


def test_a_setting_is_judged_with_the_error_rates_of_the_suite(here: Path) -> None:
    suite = suite_of(cases=1)
    suite = replace(suite, head=suite.head.replace(judging=Procedure(error_rate=0.001)))
    case = tuner()._case(suite, suite.cases[0])
    (judged,) = results_of("before", "suite", [case], [run("case-0", k) for k in range(4)], Spec("x")).cases
    assert judged.verdict.judged_by.error_rate == case.judging.error_rate == 0.001


def test_an_attack_is_not_paired_and_says_what_it_found(here: Path) -> None:
    suite = suite_of()
    cases = [suite.tested(case.name) for case in suite.cases]
    before = [run(case.name, seed, violated=True) for case in cases for seed in range(4)]
    after = [run(case.name, seed, time_s=11.0) for case in cases for seed in range(4)]
    results = [
        results_of(name, "suite", cases, runs, Spec("x")) for name, runs in (("before", before), ("after", after))
    ]
    paired, attacked = (
        ProposalCheck(name="held out", comparison=compare(results)),
        ProposalCheck(name="attacked", comparison=compare(results), failures=(3, 0)),
    )
    assert paired.difference and paired.difference.paired and paired.difference.difference == -1.0
    assert attacked.difference and not attacked.difference.paired
    assert paired.more_time == pytest.approx(0.1)


def test_a_setting_that_gains_less_than_half_a_violating_run_is_not_proposed(here: Path) -> None:
    suite = suite_of()
    cases = [suite.tested(case.name) for case in suite.cases]
    parameter = Parameter(name="wait_s", low=0.0, high=8.0, present=6.0)
    with SettingRuns(Spec("x"), {"wait_s": 6.0}, Path("runs.jsonl")) as runs:
        search = ParameterSearch([parameter], cases, runs)
        keys = [(case.name, seed) for case in cases for seed in search.seeds]
        before = {key: run(*key, violated=True) for key in keys}
        for number, better in enumerate((0, 0, 1)):
            made = {key: run(*key, violated=k >= better, time_s=9.9 if number else 10.0) for k, key in enumerate(keys)}
            search.candidates.append(TunedSetting(number, {"wait_s": 6.0 - number}, made, score=score_of(made, before)))
    first, faster, fewer = search.candidates
    assert [search.gains(each) for each in search.candidates] == [False, False, True]
    assert search.best is fewer and search.front() == (fewer,) and search.holds(first) and search.holds(faster)


def test_a_candidate_without_every_run_is_not_complete() -> None:
    assert not TunedSetting(1, {}).is_complete


def made_tuning(cases: list[SuiteCase], **changes: Any) -> Tuning:
    """A tuning whose 5 settings solve nothing."""
    keys = {(case.name, seed): run(case.name, seed, violated=True) for case in cases for seed in range(SEEDS)}
    parameter = Parameter(name="wait_s", low=0.0, high=8.0, present=6.0, unit="s")
    given = {
        "suite": "suite", "stack": Spec("x"), "by": "rvsg", "seed": 0, "runs": 45, "settings": 5, "stopped": 0,
        "failed": (), "parameters": (parameter,), "split": split(cases, keys.values()), "before": score_of(keys, keys),
        "front": (), "unsolved": (), "importances": {},
    }  # fmt: skip
    return Tuning(**{**given, **changes})


@pytest.mark.parametrize("settings", [5, 10])
def test_a_limit_is_named_only_where_enough_settings_were_tried(here: Path, settings: int) -> None:
    suite = suite_of(cases=1)
    cases = [suite.tested(case.name) for case in suite.cases]
    parameter = Parameter(name="wait_s", low=0.0, high=8.0, present=6.0, unit="s")
    with SettingRuns(Spec("x"), {"wait_s": 6.0}, Path("runs.jsonl")) as runs:
        search = ParameterSearch([parameter], cases, runs)
        made = {("case-0", seed): run("case-0", seed, violated=True) for seed in search.seeds}
        search.candidates += [TunedSetting(k, {"wait_s": 0.0}, made) for k in range(settings)]
        (found,) = unsolved(search)
    text = unsolved_text(found, made_tuning(cases))
    assert text.startswith(f"case-0: none of the {settings} settings tried")
    assert ("end of its range" in text) == (found.limited_by == "wait_s") == (settings == 10)
    assert settings == 10 or "from 10 settings on" in text
    assert headline(made_tuning(cases)) == "None of the 5 settings tried fails less and holds the limits."


@pytest.mark.parametrize(("before", "after", "helps"), [(9, 0, True), (9, 8, False), (6, 9, False)])
def test_a_proposal_that_the_check_does_not_show_to_help_says_so(
    here: Path, before: int, after: int, helps: bool
) -> None:
    suite = suite_of(cases=1)
    cases = [suite.tested(case.name) for case in suite.cases]
    results = [
        results_of(name, "suite", cases, [run("case-0", k, violated=k < count) for k in range(12)], Spec("x"))
        for name, count in (("before", before), ("after", after))
    ]
    part = ProposalCheck(name="tuned", comparison=compare(results))
    worse = ProposalCheck(name="held out", comparison=compare([results[1], results[0]]))
    found = made_tuning(cases, proposal=3, parts=(part,))
    assert found.helps == helps and headline(found).startswith("Shown to help." if helps else "Not shown to help.")
    assert f"tuned {100 * before // 12} % to" in headline(found).replace("\N{NO-BREAK SPACE}", " ")
    assert "Attacks are" not in tuning_page(found)
    assert "Attacks are" in tuning_page(found.replace(parts=(part, part.replace(name="attacked", failures=(3, 0)))))
    assert not helps or not found.replace(parts=(part, worse)).helps, "held-out cases fail clearly more"


def test_a_page_offers_another_setting_only_where_there_is_one(here: Path) -> None:
    suite = suite_of(cases=1)
    found = made_tuning([suite.tested(case.name) for case in suite.cases])
    as_it_is, other = (Choice(number=k, values={}, score=found.before) for k in (0, 4))
    assert "--choose" not in tuning_page(found)
    assert "--choose" not in tuning_page(found.replace(front=(as_it_is,)))
    assert "--choose" not in tuning_page(found.replace(front=(as_it_is, other), proposal=4))
    assert "--choose" in tuning_page(found.replace(front=(as_it_is, other)))


# Zones

NEAR = """still:
  title: Slow near people
  text: Be slow near people.
  formula: always (distance_to_person > 0.75 or speed < 0.3)
"""


def test_zones_lie_where_most_failures_are_near_one_another() -> None:
    places = [(0.0, 0.0), (1.0, 0.0), (0.5, 0.5), (9.0, 9.0), (9.0, 9.5), (30.0, 30.0)]
    first, second = zones_around(places)
    assert (first.x, first.y, first.runs, first.radius_m) == (0.5, 0.17, 3, 1.5)
    assert (second.x, second.y, second.runs) == (9.0, 9.25, 2)
    assert zones_around(places[-1:]) == zones_around([]) == ()


def test_masks_of_a_file_are_those_of_the_setting_and_nothing_else_changes(here: Path) -> None:
    zones = Zones(zones=zones_around([(2.0, 2.0)] * 2 + [(4.5, 2.0)] * 3), found=5, x=-1.0, y=-2.0, resolution_m=0.05,
                  rows=160, columns=140)  # fmt: skip
    values = {"zone_1.speed_percent": 30.0, "zone_2.speed_percent": 55.0, "zone_2.keepout": 1.0}
    filters, masks = zones.filters(values), zones.masks(values)
    assert zones.filters({}) == [] and {int(each) for each in np.unique(masks["speed_percent"])} == {0, 30, 55}
    for kind, mask in masks.items():
        write_mask(mask, Path(f"{kind.partition('_')[0]}_mask.yaml"), 0.05, Pose(x=-1.0, y=-2.0))
    after = with_filters_in_file(NAV2, Path("new.yaml"), filters)
    Path("new.yaml").write_text(after)
    read = StackChoice.of("new.yaml").record.options["costmap_filters"]
    assert read == StackChoice.of(Spec("nav2-dwb", {"costmap_filters": filters})).record.options["costmap_filters"]
    lines = iter(after.splitlines())
    assert all(line in lines for line in NAV2.splitlines()), "every line of the file stays, in its order"
    assert has_filters(after) and not has_filters(NAV2)
    with pytest.raises(FileError, check=coded("no-place")):
        with_filters_in_file(NAV2, Path("new.yaml"), zones.filters({"zone_1.speed_percent": 20.0}))


@pytest.mark.slow
def test_zones_that_help_are_proposed_and_written_as_nav2_reads_them(here: Path) -> None:
    Path("still.yaml").write_text(NEAR)
    suite = rvsg.Suite.create("suite")
    for delay_s in (15.0, 16.0, 17.0):  # who stands beside the aisle when the robot passes
        walk = rvsg.walk("Anna", "H15", "E15", start_delay_s=delay_s)
        scenario = rvsg.scenario(rvsg.load_world("warehouse"), "route_1", [walk])
        suite = suite.add(scenario, "../still.yaml#still", name=f"case-{delay_s:.0f}", expected="pass")
    zoned = {"stack": "nav2-rpp", "tries": "zones", "budget_runs": 200, "more_time": 2.0}
    found = tuner(**zoned).run()
    assert found.zones is not None and found.proposal and found.helps, headline(found)
    assert len(found.tried) == found.settings - 1 and not found.sweeps
    choice = StackChoice.of("out/nav2_params.yaml")
    (speed,) = choice.driver.adapt(load_robot("tiago_omni")).navigation.costmap_filters
    percent = {change.after for change in found.changes}
    assert speed.kind == "speed_percent" and {value for value, _ in speed.cells} == {0, *percent}
    assert "Zones that were tried" in Path("out/index.html").read_text()
    again = tuner(**zoned, out=Path("again"), jobs=2).run()
    assert again.tried == found.tried and again.changes == found.changes and again.parts == found.parts


def test_zones_are_refused_for_what_has_no_file_of_nav2(here: Path) -> None:
    suite_of(cases=1)
    zoned = "global_costmap: {global_costmap: {ros__parameters: {filters: [inflation_layer]}}}\n"
    Path("zoned.yaml").write_text(NAV2 + zoned)
    for changes in ({}, {"stack": "nav2-rpp", "stack_options": {"lookahead_dist": 0.7}}, {"stack": "zoned.yaml"}):
        with pytest.raises(InputError, check=coded("no-parameters")) as refused:
            tuner(tries="zones", **changes).run()
        assert "nav2-dwb" in str(refused.value)
