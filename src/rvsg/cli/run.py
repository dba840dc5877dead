"""`rvsg run`: a campaign, or one for each of several routes and requirements."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rvsg.app.settings import BUDGETS, LISTED, CampaignConfig, effective, option_of, read_campaign_file
from rvsg.cli.console import as_started, console, print_json, say
from rvsg.cli.frame import verb
from rvsg.cli.options import AsJson, Verbose, setting_options

if TYPE_CHECKING:
    from rvsg.app.campaign import Campaign
    from rvsg.app.matrix import Matrix
    from rvsg.report.result import Result
    from rvsg.runs.attempt import Attempt


app = verb()
WIDEST_MAP = 72
"""Characters of the map on a terminal."""


@app.command()
@setting_options(*CampaignConfig.model_fields, several=True)
def run(
    settings: dict[str, Any],
    campaign: Annotated[Path | None, typer.Argument(help="A campaign file; its keys are the options below.")] = None,
    verbose: Verbose = False,
    json: AsJson = False,
) -> None:
    """Find, confirm and report scenarios that make the robot violate a requirement.

    The search spends `scenarios` x (1 + `refinements`) x `repeats` runs, or --budget-runs. Scenarios that violated the
    limit are confirmed in runs with new seeds until each verdict is certain or --confirmations is spent; runs without
    some of the people show what these contribute, and the worst scenario of each distinct failure is shrunk.

    Everything is stored in the folder --out; run the same command to resume. Several routes or requirements make a
    campaign for each pair. `--help-all` lists every setting.
    """
    from rvsg.app.matrix import Matrix

    from_file = read_campaign_file(campaign) if campaign else {}
    matrix = Matrix.of(from_file, settings)
    if matrix is not None:
        raise typer.Exit(run_matrix(matrix, as_json=json))
    single = [
        {key: value[0] if isinstance(value, list) and key in LISTED else value for key, value in values.items()}
        for values in (from_file, settings)
    ]
    raise typer.Exit(run_campaign_of(*single, as_json=json, verbose=verbose))


def run_campaign_of(
    from_file: dict[str, Any],
    typed: dict[str, Any],
    *,
    as_json: bool,
    verbose: bool = False,
    remark: Callable[[Result], str] | None = None,
) -> int:
    """Run or resume the campaign of a campaign file and options, show its results, and return the exit code."""
    from rvsg.app.matrix import write_junit

    started = time.monotonic()
    campaign = run_one(from_file, typed)
    with campaign.result() as result:
        campaign.report(result=result)
        if campaign.config.junit:
            write_junit(campaign.config.junit, [result])
        _show_lost(result.attempts)
        _show(campaign, result, time.monotonic() - started, as_json=as_json, verbose=verbose)
        campaign.check_judged(result)
        if remark is not None:
            say(remark(result))
        return 1 if campaign.config.fail_on_violation and result.violated else 0


def run_one(from_file: dict[str, Any], typed: dict[str, Any]) -> Campaign:
    """Run or resume a campaign."""
    from rvsg.app.campaign import Campaign
    from rvsg.app.folder import store_of
    from rvsg.core.files import check_writable

    asked = effective(None, from_file, typed)
    if asked.junit:
        check_writable(Path(asked.junit))
    resumed = asked.folder.is_dir() and store_of(asked.folder) is not None
    campaign = Campaign.create(file=from_file, on_message=say, **typed)
    _run(campaign, resumed=resumed)
    return campaign


def _run(campaign: Campaign, *, resumed: bool) -> None:
    """Run the campaign with progress; on interruption, print how to resume."""
    from rvsg.app.commands import resume_command
    from rvsg.cli.interruption import interruptible
    from rvsg.cli.progress import CampaignProgress
    from rvsg.cli.tables import map_text
    from rvsg.core.errors import BudgetSpent, GenerationError, Interrupted, SimulationError
    from rvsg.evaluation.verdict import counted
    from rvsg.simulation.simulators import stack_name

    plan, folder = campaign.plan, campaign.folder
    attempts = campaign.attempts()
    say(_what_it_does(campaign))
    if console().is_terminal and console().encoding.startswith("utf") and not campaign.finished:
        mission, generator = plan.mission, campaign.config.generator_name
        driven = ", ".join(filter(None, (mission.robot_name, stack_name(campaign.record.simulator))))
        say(f"{driven}; scenarios by {generator}, seed {plan.seed}. S is the start, G the goal:")
        say(map_text(campaign.shown_world, mission.route, min(WIDEST_MAP, console().width - 1)))
    if resumed:
        there = counted(len(attempts), "attempt is", "attempts are")
        say(f"Resuming {folder}: {there} stored." if attempts else f"Starting again in {folder}.")
    how = f"Resume with: {as_started(resume_command(campaign.config))}"

    def ending() -> str:
        return f"{counted(len(campaign.attempts()), 'finished attempt is', 'finished attempts are')} kept."

    try:
        with interruptible() as interruption, CampaignProgress(plan, attempts, check=interruption.check) as progress:
            if not campaign.finished:
                with interruption.at_once(f"Interrupted before a run was made. {how}"):
                    campaign.prepare(say)
            for _ in campaign.run(observe=progress):
                interruption.check()
    except KeyboardInterrupt:
        so_far = as_started(shlex.join(["rvsg", "report", str(folder)]))
        raise Interrupted(f"Interrupted; {ending()} {how}\nResults so far: {so_far}") from None
    except BudgetSpent as spent:
        larger = as_started(resume_command(campaign.config, without=BUDGETS))
        raise BudgetSpent(f"{spent} {ending()} Resume with: {larger} --budget-...") from None
    except (GenerationError, SimulationError):
        say(f"{ending()} {how}")
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
    confirmed = f"at most {plan.confirmations}" if plan.requirement.threshold is not None else plan.confirmations
    then = f", then {confirmed} to confirm, and more to name causes" if plan.confirmations else ""
    title = f"{plan.requirement.name}, {plan.requirement.title[:1].lower()}{plan.requirement.title[1:]}"
    return f"{title}, on {plan.mission.world}, {plan.mission.route.name}: {search}{then}."


def _show_lost(attempts: Sequence[Attempt]) -> None:
    """Print how many attempts have no scenario and why, and which replies of a model were unusable."""
    from rvsg.evaluation.verdict import counted
    from rvsg.report.terminal import describe_unusable
    from rvsg.search.execution import calls_of

    search = [attempt for attempt in attempts if attempt.purpose == "search"]
    lost = [attempt for attempt in search if attempt.proposal.scenario is None]
    if lost and len(lost) < len(search):  # where all are lost, that is the error at the end
        problems = lost[0].proposal.problems
        why = f"the first reason: {problems[0]}" if problems else "the generator gave no reason."
        say(f"{counted(len(lost), 'attempt')} of {len(search)} brought no scenario; {why}")
    if unusable := describe_unusable(calls_of(search)):
        say(unusable)


def _show(campaign: Campaign, result: Result, spent_s: float, *, as_json: bool, verbose: bool) -> None:
    """Print the answer with the path of the report and the command that repeats the campaign."""
    from rvsg.app.folder import REPORT
    from rvsg.cli.tables import show_answer, show_findings
    from rvsg.evaluation.verdict import counted

    folder, account = campaign.folder, result.accounting
    if as_json:
        print_json(campaign.data(result))
    if verbose:
        show_findings(result)
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
    show_answer(result.answer, page=str(folder / REPORT), again=campaign.command)


def run_matrix(matrix: Matrix, *, as_json: bool) -> int:
    """Run or resume the campaigns of a matrix, show what they found, and return the exit code."""
    from rvsg.cli.interruption import interruptible
    from rvsg.core.errors import Interrupted
    from rvsg.core.files import check_writable

    started = time.monotonic()
    resume = as_started(matrix.resume_command)
    if junit := matrix.settings.get("junit"):
        check_writable(Path(junit))
    campaigns = matrix.create(say)
    count = len(campaigns)
    say(f"Campaigns in {matrix.folder}: {count}; {min(matrix.jobs, count)} run at a time.")
    if others := len(matrix.all_pairs) - count:
        say(f"{others} more in this folder are not part of this command; resume them with: {resume}")
    if share := matrix.budget:
        listed = ", ".join(f"{option_of(key)} {value:g}" for key, value in share.items())
        say(f"The campaigns share the budget equally; each may spend: {listed}.")
    try:
        with interruptible() as interruption:
            with interruption.at_once(f"Interrupted. Resume with: {resume}"):
                campaigns[0].prepare(say)
            failed = _run_all(matrix, campaigns, interruption.check)
    except KeyboardInterrupt:
        raise Interrupted(f"Interrupted. Resume with: {resume}") from None
    matrix.report()
    done = [campaign for campaign in campaigns if str(campaign.folder) not in failed]
    with ExitStack() as stack:
        results = [(campaign, stack.enter_context(campaign.result())) for campaign in done]
        _show_all(matrix, results, len(campaigns), time.monotonic() - started, as_json=as_json)
        for folder, (message, _) in failed.items():
            say(f"{Path(folder).name}: not finished. {message}")
        if failed:
            say(f"Resume the others with: {resume}")
            return max(code for _, code in failed.values())
        for campaign, result in results:
            campaign.check_judged(result)
    violated = any(result.violated for _, result in results)
    return 1 if matrix.settings.get("fail_on_violation") and violated else 0


def _run_all(matrix: Matrix, campaigns: Sequence[Campaign], check: Callable[[], None]) -> dict[str, tuple[str, int]]:
    """Run the campaigns; return message and exit code of those that failed, by their folder."""
    from rvsg.app.matrix import CampaignEnded
    from rvsg.cli.progress import CampaignProgress
    from rvsg.core.errors import RvsgError

    failed: dict[str, tuple[str, int]] = {}
    lines = {
        str(campaign.folder): CampaignProgress(
            campaign.plan, campaign.attempts(), check=check, name=campaign.folder.name
        )
        for campaign in campaigns
    }
    ended = 0
    for campaign, event in matrix.run(campaigns):
        check()
        if not isinstance(event, CampaignEnded):
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
    matrix: Matrix, results: Sequence[tuple[Campaign, Result]], count: int, spent_s: float, *, as_json: bool
) -> None:
    from rvsg.app.folder import REPORT
    from rvsg.app.matrix import write_junit
    from rvsg.cli.tables import matrix_table

    if junit := matrix.settings.get("junit"):
        write_junit(junit, [result for _, result in results])
    if as_json:
        listed = [
            campaign.data(result) | {"route": result.plan.mission.route.name, "requirement": result.requirement.name}
            for campaign, result in results
        ]
        overview = {"out": str(matrix.folder), "report": str(matrix.folder / REPORT), "command": matrix.commands()}
        print_json({"campaigns": listed, **overview})
    say(matrix_table([(result.plan, result.answer) for _, result in results]))
    say(f"{len(results)} of {count} campaigns done in {spent_s:.0f} s; stored in {matrix.folder}")
    say(f"Reports: {matrix.folder / REPORT}")
    say(f"Repeat it with: {matrix.commands(as_started)}")
