"""Run the same scenarios and seeds with several navigation stacks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from rvsg.api.campaign import Campaign
from rvsg.api.folder import store_of
from rvsg.api.index import campaigns_in
from rvsg.api.matrix import folders_in
from rvsg.api.scenarios import as_robot, check_robot
from rvsg.api.simulating import ignore, make_simulator
from rvsg.api.suites import HEAD, Suite, requirement_of
from rvsg.campaign.attempt import Failure
from rvsg.campaign.measuring import Measuring
from rvsg.campaign.parallel import Simulations
from rvsg.campaign.ranking import candidates, search_attempts
from rvsg.campaign.stack_scores import ScoredRun, StackScore, StackScores, score_stacks
from rvsg.core.errors import InputError, SimulationError
from rvsg.core.files import write_whole
from rvsg.core.plugins import Spec
from rvsg.report.facts import run_facts
from rvsg.report.stacks import stacks_figure, stacks_markdown, stacks_page
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.protocol import Simulator
from rvsg.simulation.run import Outcome, Run
from rvsg.simulation.stacks.registry import StackChoice
from rvsg.world.world import World


@dataclass(frozen=True)
class Tested:
    """A scenario with the requirement that judges it."""

    name: str
    scenario: Scenario
    requirement: Requirement
    world: World


def compare_stacks(
    source: str | Path | None,
    stacks: Sequence[str | Spec],
    *,
    robots: Sequence[str] = (),
    runs: int = 10,
    scenarios: int = 10,
    jobs: int = 1,
    on_score: Callable[[StackScore], None] = ignore,
    on_message: Callable[[str], None] = ignore,
) -> StackScores:
    """Compare navigation stacks on the same scenarios and seeds.

    Args:
        source: a suite, a campaign's folder, or a folder of several campaigns.
        stacks: names, files, classes or commands, as for `--stack`.
        robots: robots to drive instead of those of the scenarios; every stack drives every one of them.
        runs: seeds of each scenario.
        scenarios: how many scenarios of the campaigns, the worst of each first; a suite is run as a whole.
        jobs: worker processes; the results are the same.

    Raises:
        InputError: there is nothing to compare, or a stack cannot be used.
        SimulationError: a run could not be made.
    """
    if len({str(stack) for stack in stacks}) < len(stacks):
        raise InputError("Two of the stacks are the same. Name each of them once.")
    if not stacks:
        raise InputError("Name the stacks to compare: --stack nav2-dwb --stack nav2-rpp.", code="no-stack")
    if source is None:
        message = "Name the suite or the campaign whose scenarios are driven: rvsg stacks DIR --stack ..."
        raise InputError(message, code="no-source")
    cases = tested_in(Path(source), scenarios)
    chosen = [(str(stack), stack, StackChoice.of(stack)) for stack in stacks]
    scores = []
    for label, stack, choice in chosen:
        for robot in robots or ("",):
            simulator = make_simulator("embedded", stack)
            name = f"{label} on {robot}" if robot else label
            with closing(simulator):
                simulator.prepare(on_message)
                score = _score(name, choice, simulator, cases, robot, runs, jobs, on_message)
            scores.append(score)
            on_score(score)
    return score_stacks(str(source), [case.name for case in cases], runs, scores)


def write_comparison(found: StackScores, source: str | Path, folder: str | Path) -> list[Path]:
    """Write a comparison as `index.html`, `stacks.svg`, `stacks.md` and `stacks.json`; return their paths."""
    worlds = {case.name: case.world for case in tested_in(Path(source), len(found.cases))}
    contents = {
        "index.html": stacks_page(found, worlds),
        "stacks.svg": stacks_figure(found),
        "stacks.md": stacks_markdown(found),
        "stacks.json": found.to_json(),
    }
    for name, text in contents.items():
        write_whole(Path(folder) / name, text)
    return [Path(folder) / name for name in contents]


def tested_in(source: Path, scenarios: int) -> list[Tested]:
    """Return the cases of a suite, or the worst scenarios of one or more campaigns, taken in turn."""
    if (source / HEAD).is_file():
        suite = Suite.open(source)
        return [
            Tested(
                f"{case.name}, {each.requirement}", case.scenario,
                requirement_of(each, source, case.scenario.mission.route), suite.worlds[case.name],
            )
            for case in suite.cases
            for each in case.expectations
        ]  # fmt: skip
    if not source.is_dir():
        raise InputError(f"{source}: there is no such folder. Give a suite, or the folder of one or more campaigns.")
    folders = [source] if store_of(source) else folders_in(source)
    campaigns = [campaign for folder in folders for campaign in campaigns_in(folder, optional=True)]
    found = [_worst(campaign) for campaign in campaigns]
    turns = [case for k in range(max(map(len, found), default=0)) for each in found for case in each[k : k + 1]]
    if not turns:
        raise InputError(f"{source}: there is neither a suite nor a campaign with scenarios. Make one: rvsg run")
    return turns[:scenarios]


def _worst(campaign: Campaign) -> list[Tested]:
    plan = campaign.plan
    attempts = candidates(search_attempts(campaign.attempts()), plan.requirement)
    return [
        Tested(f"{campaign.name} #{attempt.index}", attempt.proposal.scenario, plan.requirement, campaign.world)
        for attempt in attempts
        if attempt.proposal.scenario is not None
    ]


def _score(
    label: str, choice: StackChoice, simulator: Simulator, cases: Sequence[Tested], robot: str, runs: int, jobs: int,
    tell: Callable[[str], None],
) -> StackScore:  # fmt: skip
    scored: list[ScoredRun] = []
    worlds = {case.world.id: case.world for case in cases}
    for key, world in worlds.items():
        with Simulations(simulator, world, jobs=jobs, notify=tell) as simulations:
            pending = [
                (case, simulations.submit(_driven_by(case, robot, simulator), seed))
                for case in cases
                if case.world.id == key
                for seed in range(runs)
            ]
            for case, each in pending:
                result = each.result()
                if isinstance(result, Failure):
                    raise SimulationError(f"{label}, {case.name}, seed {result.seed}: {result.reason}")
                scored.append(_scored(case, result.unpack()))
    failed = sum(run.outcome == Outcome.STACK_FAILED.name for run in scored)
    record = choice.record
    return StackScore(label=label, name=record.name, version=record.version, runs=tuple(scored), failed=failed)


def _driven_by(case: Tested, robot: str, simulator: Simulator) -> Scenario:
    """Return the scenario of a case with another robot, where there is one."""
    scenario = case.scenario
    if robot:
        scenario = scenario.replace(mission=scenario.mission.replace(robot=as_robot(robot, simulator)))
    check_robot(scenario, simulator)
    return scenario


def _scored(case: Tested, run: Run) -> ScoredRun:
    measured = Measuring(case.requirement, case.world).measure(run)
    violated = None if measured.objective is None else case.requirement.violated_by(measured.objective)
    at = None
    if violated:
        decisive = run_facts(run, measured, case.requirement, case.world, case.scenario).decisive_at
        at = (float(decisive.x), float(decisive.y))
    contact = (measured.values.get("contacts") or 0.0) > 0.0
    return ScoredRun(case=case.name, seed=run.seed, violated=violated, outcome=run.outcome.name, contact=contact, at=at)
