"""`rvsg run`: a campaign, or one for each of several routes and requirements."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rvsg.cli.console import as_started, console, print_json, say
from rvsg.cli.frame import verb
from rvsg.cli.options import AsJson, Doors, JobsPerCore, SimulatorOption, Stack, StackOption

if TYPE_CHECKING:
    from rvsg.app.campaign import Campaign
    from rvsg.app.matrix import Matrix
    from rvsg.campaign.attempt import Attempt, Plan
    from rvsg.report.summary import Summary


app = verb()


@app.command()
def run(
    campaign: Annotated[Path | None, typer.Argument(help="A campaign file; its keys are the options below.")] = None,
    world: Annotated[str | None, typer.Option(help="A shipped world or a world folder. [warehouse]")] = None,
    route: Annotated[
        list[str] | None, typer.Option(help="A route of the world; repeat it for several, or `all`. [route_1]")
    ] = None,
    requirement: Annotated[
        list[str] | None, typer.Option(help="A shipped requirement, or FILE.yaml#NAME; repeat it for several. [R1]")
    ] = None,
    also: Annotated[
        list[str] | None, typer.Option(help="A further requirement for the strategy multi; repeatable.")
    ] = None,
    robot: Annotated[
        str | None, typer.Option(help="A shipped robot (`rvsg robots`) or a robot file. [tiago_omni]")
    ] = None,
    generator: Annotated[
        str | None, typer.Option(help="Writes the scenarios: heuristic, random, vlm, or a plug-in. [heuristic]")
    ] = None,
    knowledge: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Earlier scenarios that new ones must differ from (`rvsg knowledge search --out FILE`).",
        ),
    ] = None,
    strategy: Annotated[
        str | None,
        typer.Option(help="study hybrid map-elites multi unguided random, or a plug-in. [hybrid]"),
    ] = None,
    simulator: Annotated[
        str | None, typer.Option(help="embedded; kinematic: no physics; ros2-world: your own; or a plug-in. [embedded]")
    ] = None,
    moved: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Objects in the robot's way that its map does not show (objects.yaml)."),
    ] = None,
    door: Doors = None,
    stack: Stack = None,
    humans: Annotated[int | None, typer.Option(min=1, max=100, help="People in a scenario. [2]")] = None,
    scenarios: Annotated[int | None, typer.Option(min=1, help="Scenarios to find. [10]")] = None,
    refinements: Annotated[int | None, typer.Option(min=0, help="Refinements of each scenario. [4]")] = None,
    repeats: Annotated[int | None, typer.Option(min=1, help="Runs of each configuration. [5]")] = None,
    confirmations: Annotated[int | None, typer.Option(min=0, help="Confirmation runs in all, at most. [250]")] = None,
    shrink_runs: Annotated[
        int | None, typer.Option(min=0, help="Runs that shrink the distinct failures; 0: do not. [200]")
    ] = None,
    budget_runs: Annotated[
        int | None, typer.Option(min=1, help="Runs of the search. [scenarios x configurations x repeats]")
    ] = None,
    memory: Annotated[
        int | None, typer.Option(min=0, help="Earlier scenarios that a new one must differ from. [10]")
    ] = None,
    max_in_flight: Annotated[
        int | None, typer.Option(min=1, help="Attempts in progress at a time; more keep more cores busy. [1]")
    ] = None,
    error_rate: Annotated[
        float | None, typer.Option(help="Probability that a verdict is wrong, at most. [0.05]")
    ] = None,
    rare: Annotated[
        float | None, typer.Option(help="Violation rate up to which violations count as rare. [0.02]")
    ] = None,
    often: Annotated[float | None, typer.Option(help="Violation rate that a PASS excludes. [0.2]")] = None,
    confidence: Annotated[float | None, typer.Option(help="Confidence level of intervals. [0.95]")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of everything random. [0]")] = None,
    jobs: JobsPerCore = None,
    executor: Annotated[
        str | None, typer.Option(help="Makes the runs: processes (see --jobs), cluster, or a plug-in. [processes]")
    ] = None,
    store: Annotated[str | None, typer.Option(help="Store of the campaign: sqlite, or a plug-in. [sqlite]")] = None,
    out: Annotated[str | None, typer.Option(help="Folder of the campaign; an existing one is resumed.")] = None,
    model: Annotated[str | None, typer.Option(help="VLM, e.g. openai-chat:gpt-4.1.")] = None,
    base_url: Annotated[str | None, typer.Option(help="Address of an OpenAI-compatible server.")] = None,
    conversation: Annotated[str | None, typer.Option(help="compact or study. [compact]")] = None,
    prompts: Annotated[str | None, typer.Option(help="Folder of prompt templates that replace ours.")] = None,
    replay: Annotated[str | None, typer.Option(help="Answer from these recordings, without a model.")] = None,
    budget_usd: Annotated[float | None, typer.Option(help="Limit on the cost of the calls of a model.")] = None,
    budget_calls: Annotated[int | None, typer.Option(help="Limit on the calls of a model.")] = None,
    budget_tokens: Annotated[int | None, typer.Option(help="Limit on the tokens of a model.")] = None,
    generator_option: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="An option of the generator; repeatable.")
    ] = None,
    simulator_option: SimulatorOption = None,
    stack_option: StackOption = None,
    executor_option: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="An option of the executor; repeatable.")
    ] = None,
    store_option: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="An option of the store; repeatable.")
    ] = None,
    fail_on_violation: Annotated[
        bool | None, typer.Option("--fail-on-violation", help="Exit with code 1 if the requirement is violated.")
    ] = None,
    junit: Annotated[str | None, typer.Option(metavar="FILE", help="Write the verdicts as JUnit XML.")] = None,
    json: AsJson = False,
) -> None:
    """Find, confirm and report scenarios that make the robot violate a requirement.

    The search spends `scenarios` x (1 + `refinements`) x `repeats` runs, or --budget-runs, and ranks configurations by
    the share of runs that violate the limit, then by the mean objective. Strategies like `study` run each of
    `scenarios` x (1 + `refinements`) configurations `repeats` times; `hybrid` drops losing configurations early.

    Scenarios that violated the limit are confirmed in runs with new seeds, worst first, but one of every kind of
    failure before the second of one. Each confirmation ends when its verdict is certain (wrong in at most --error-rate
    of cases) or its part of --confirmations is spent. Other configurations follow until one is a FAIL; then those that
    ended without a verdict, in the runs that are left. Runs of the mission without people, and of each confirmed
    scenario without each of its people, show what the people contribute. Confirmed violations are grouped into distinct
    failures, and the worst scenario of each is shrunk in --shrink-runs.

    Everything is stored in the folder --out; run the same command to resume. Name an installed plug-in like a built-in
    one.

    Several routes or requirements make a campaign for each pair, in parallel, each in its own folder in --out.
    """
    given = {k: v for k, v in locals().items() if v is not None and k not in ("campaign", "json")}
    from rvsg.app.matrix import Matrix
    from rvsg.app.settings import read_campaign_file
    from rvsg.cli.options import pairs, states

    for kind in ("generator", "simulator", "stack", "executor", "store"):
        if options := given.pop(f"{kind}_option", None):
            given[f"{kind}_options"] = pairs(kind, options)
    if doors := given.pop("door", None):
        given["doors"] = states(doors)
    from_file = read_campaign_file(campaign) if campaign else {}
    matrix = Matrix.of(from_file, given)
    if matrix is not None:
        raise typer.Exit(run_matrix(matrix, as_json=json))
    single = [
        {key: v[0] if isinstance(v, list) and key != "also" else v for key, v in values.items()}
        for values in (from_file, given)
    ]
    raise typer.Exit(run_campaign_of(*single, as_json=json))


def run_campaign_of(
    from_file: dict[str, Any],
    given: dict[str, Any],
    *,
    as_json: bool,
    remark: Callable[[Plan, Summary], str] | None = None,
) -> int:
    """Run or resume the campaign of a campaign file and options, show its results, and return the exit code."""
    started = time.monotonic()
    campaign = run_one(from_file, given)
    summary = campaign.summary()
    _show(campaign, summary, time.monotonic() - started, as_json=as_json)
    campaign.check_judged()
    if remark is not None:
        say(remark(campaign.plan, summary))
    return 1 if campaign.config.fail_on_violation and summary.violated else 0


def run_one(from_file: dict[str, Any], given: dict[str, Any]) -> Campaign:
    """Run or resume a campaign and write its report."""
    from rvsg.app.campaign import Campaign
    from rvsg.app.folder import store_of
    from rvsg.app.settings import effective
    from rvsg.core.files import write_whole
    from rvsg.core.outputs import check_writable
    from rvsg.report.summary import junit_xml

    asked = effective(None, from_file, given)
    if asked.junit:
        check_writable(Path(asked.junit))
    resumed = asked.folder.is_dir() and store_of(asked.folder) is not None
    campaign = Campaign.create(file=from_file, on_message=say, **given)
    _run(campaign, resumed=resumed)
    campaign.report()
    if campaign.config.junit:
        write_whole(Path(campaign.config.junit), junit_xml(campaign.plan, campaign.summary()))
    _show_lost(campaign.attempts())
    return campaign


def _run(campaign: Campaign, *, resumed: bool) -> None:
    """Run the campaign with progress; on interruption, print how to resume."""
    from rvsg.app.commands import resume_command
    from rvsg.app.settings import BUDGETS
    from rvsg.cli.interruption import interruptible
    from rvsg.cli.progress import CampaignProgress
    from rvsg.core.errors import BudgetSpent, GenerationError, Interrupted, SimulationError
    from rvsg.evaluation.verdict import counted

    plan, folder = campaign.plan, campaign.folder
    known = campaign.attempts()
    say(_what_it_does(campaign))
    if resumed:
        there = counted(len(known), "attempt is", "attempts are")
        say(f"Resuming {folder}: {there} stored." if known else f"Starting again in {folder}.")
    how = f"Resume with: {as_started(resume_command(campaign.config))}"
    try:
        with interruptible() as interruption:
            if not campaign.finished:
                with interruption.at_once(f"Interrupted before a run was made. {how}"):
                    campaign.prepare(say)
            with CampaignProgress(plan, known, check=interruption.check) as progress:
                for _ in campaign.run(observe=progress):
                    interruption.check()
    except KeyboardInterrupt:
        kept = counted(len(campaign.attempts()), "finished attempt is", "finished attempts are")
        so_far = as_started(shlex.join(["rvsg", "report", str(folder)]))
        raise Interrupted(f"Interrupted; {kept} kept. {how}\nResults so far: {so_far}") from None
    except BudgetSpent as spent:
        larger = as_started(resume_command(campaign.config, without=BUDGETS))
        raise BudgetSpent(f"{spent} Finished work is kept. Resume with: {larger} --budget-...") from None
    except (GenerationError, SimulationError):
        say(f"Finished work is kept. {how}")
        raise


def _what_it_does(campaign: Campaign) -> str:
    from rvsg.evaluation.verdict import counted

    plan = campaign.plan
    search = (
        f"{counted(plan.search_runs, 'run')} of search"
        if campaign.spends_runs
        else f"{counted(plan.scenarios, 'scenario')} x {counted(plan.configurations, 'configuration')} x "
        f"{counted(plan.repeats, 'run')}"
    )
    at_most = "at most " if plan.requirement.threshold is not None and plan.confirmations else ""
    return (
        f"{plan.requirement.name} ({plan.requirement.title}) on {plan.mission.world}, {plan.mission.route.name}: "
        f"{search}, then {at_most}{plan.confirmations or 'none'} to confirm"
        f"{' and further ones without some of the people, to name the cause' if plan.confirmations else ''}."
    )


def _show_lost(attempts: list[Attempt]) -> None:
    """Print how many attempts have no scenario and why, and which replies of a model were unusable."""
    from rvsg.campaign.execution import calls_of
    from rvsg.evaluation.verdict import counted
    from rvsg.report.terminal import describe_unusable

    search = [attempt for attempt in attempts if attempt.purpose == "search"]
    lost = [attempt for attempt in search if attempt.proposal.scenario is None]
    if lost and len(lost) < len(search):  # where all are lost, that is the error at the end
        problems = lost[0].proposal.problems
        why = f"the first reason: {problems[0]}" if problems else "the generator gave no reason."
        say(f"{counted(len(lost), 'attempt')} of {len(search)} brought no scenario; {why}")
    if unusable := describe_unusable(calls_of(search)):
        say(unusable)


def _show(campaign: Campaign, summary: Summary, spent_s: float, *, as_json: bool) -> None:
    """Print the ranked table, the findings, the path of the report, and the command that repeats the campaign."""
    from rvsg.app.commands import command_for_more
    from rvsg.app.folder import REPORT
    from rvsg.cli.tables import ranked_table, show_findings
    from rvsg.evaluation.verdict import Status, counted

    plan, folder = campaign.plan, campaign.folder
    if as_json:
        print_json(campaign.result())
    if summary.ranking:
        say(ranked_table(plan, summary, width=console().width))
        show_findings(campaign, summary)
    verdict = summary.confirmed.verdict if summary.confirmed else None
    if verdict and verdict.status is Status.INCONCLUSIVE:
        scenarios = sum(entry.state == "confirmed" for entry in summary.ranking)
        each = max(summary.accounting.confirmation_runs, verdict.runs * scenarios)
        more = as_started(command_for_more(campaign.config, each))
        say(f"More confirmation runs can decide it: {more}")
    account = summary.accounting
    say(
        f"{counted(account.search_runs, 'run')} of search, {account.confirmation_runs} of confirmation, "
        f"{account.baseline_runs} without some of the people and {account.shrinking_runs} to shrink, in "
        f"{spent_s:.0f} s; stored in {folder}"
    )
    if account.calls:
        asked = "In the recording, the model" if campaign.config.replay else "The model"
        cost = f"{account.cost_usd:.4f} USD" if account.cost_usd is not None else "cost unknown"
        say(
            f"{asked} was asked {counted(account.calls, 'time')}: {account.input_tokens} input tokens "
            f"({account.cached_tokens} cached), {account.output_tokens} output tokens, {cost}."
        )
    for note in campaign.notes:
        say(note)
    say(f"Report: {folder / REPORT}")
    say(f"Repeat it with: {as_started(campaign.command)}")


def run_matrix(matrix: Matrix, *, as_json: bool) -> int:
    """Run or resume the campaigns of a matrix, show what they found, and return the exit code."""
    from rvsg.cli.interruption import interruptible
    from rvsg.core.errors import Interrupted
    from rvsg.core.outputs import check_writable

    started = time.monotonic()
    resume = as_started(matrix.resume_command)
    if junit := matrix.settings.get("junit"):
        check_writable(Path(junit))
    campaigns = matrix.create(say)
    _announce(matrix, campaigns, resume)
    try:
        with interruptible() as interruption:
            with interruption.at_once(f"Interrupted. Resume with: {resume}"):
                campaigns[0].prepare(say)
            failed = _run_all(matrix, campaigns, interruption.check)
    except KeyboardInterrupt:
        raise Interrupted(f"Interrupted; everything finished is stored. Resume with: {resume}") from None
    matrix.report()
    done = [each for each in campaigns if str(each.folder) not in failed]
    _show_all(matrix, campaigns, done, time.monotonic() - started, as_json=as_json)
    for folder, (message, _) in failed.items():
        say(f"{Path(folder).name}: not finished. {message}")
    if failed:
        say(f"Resume the others with: {resume}")
        return max(code for _, code in failed.values())
    for campaign in done:
        campaign.check_judged()
    violated = any(each.summary().violated for each in done)
    return 1 if matrix.settings.get("fail_on_violation") and violated else 0


def _announce(matrix: Matrix, campaigns: Sequence[Campaign], resume: str) -> None:
    count = len(campaigns)
    say(f"Campaigns in {matrix.folder}: {count}; {min(matrix.jobs, count)} run at a time.")
    if others := len(matrix.all_pairs) - count:
        say(f"{others} more in this folder are not part of this command; resume them with: {resume}")
    if share := matrix.budget:
        listed = ", ".join(f"--{key.replace('_', '-')} {value:g}" for key, value in share.items())
        say(f"The campaigns share the budget equally; each may spend: {listed}.")


def _run_all(matrix: Matrix, campaigns: Sequence[Campaign], check: Callable[[], None]) -> dict[str, tuple[str, int]]:
    """Run the campaigns; return message and exit code of those that failed, by their folder."""
    from rvsg.app.matrix import Ended
    from rvsg.cli.progress import CampaignProgress
    from rvsg.core.errors import RvsgError

    failed: dict[str, tuple[str, int]] = {}
    lines = {
        str(each.folder): CampaignProgress(each.plan, each.attempts(), check=check, name=each.folder.name)
        for each in campaigns
    }
    ended = 0
    for campaign, event in matrix.run(campaigns):
        check()
        if not isinstance(event, Ended):
            lines[str(campaign.folder)](event)
            continue
        ended += 1
        if event.error is None:
            campaign.report()
        elif isinstance(event.error, RvsgError):
            failed[str(campaign.folder)] = (str(event.error), event.error.exit_code)
        else:
            raise event.error
        state = "not finished" if event.error else "done"
        say(f"{campaign.folder.name}: {state} ({ended} of {len(campaigns)})")
    return failed


def _show_all(
    matrix: Matrix, campaigns: Sequence[Campaign], done: Sequence[Campaign], spent_s: float, *, as_json: bool
) -> None:
    from rvsg.app.folder import REPORT
    from rvsg.app.matrix import write_junit
    from rvsg.cli.tables import matrix_table

    if junit := matrix.settings.get("junit"):
        write_junit(Path(junit), done)
    if as_json:
        overview = {"out": str(matrix.folder), "report": str(matrix.folder / REPORT), "command": matrix.commands()}
        print_json({"campaigns": [result_in_matrix(each) for each in done], **overview})
    say(matrix_table([(each.plan, each.summary()) for each in done]))
    say(f"{len(done)} of {len(campaigns)} campaigns done in {spent_s:.0f} s; stored in {matrix.folder}")
    say(f"Reports: {matrix.folder / REPORT}")
    say(f"Repeat it with: {matrix.commands(as_started)}")


def result_in_matrix(campaign: Campaign) -> dict[str, object]:
    """Return what a campaign found, with its route and its requirement."""
    pair = {"route": campaign.plan.mission.route.name, "requirement": campaign.requirement.name}
    return campaign.result() | pair
