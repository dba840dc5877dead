"""`rvsg run`: the main job."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rvsg.cli.console import as_started, console, print_json, say
from rvsg.cli.frame import verb
from rvsg.core.errors import InputError

if TYPE_CHECKING:
    from rvsg.api.config import CampaignConfig
    from rvsg.api.wiring import Wired
    from rvsg.campaign.attempt import Attempt, Ledger
    from rvsg.campaign.plan import Plan
    from rvsg.report.summary import Summary

app = verb()

Text = Annotated[str | None, typer.Option()]


@app.command()
def run(
    campaign: Annotated[Path | None, typer.Argument(help="A campaign file; every option is a key of it.")] = None,
    world: Annotated[str | None, typer.Option(help="A shipped world or a world folder. [warehouse]")] = None,
    route: Annotated[
        list[str] | None, typer.Option(help="A route of the world; repeat it for several, or `all`. [route_1]")
    ] = None,
    requirement: Annotated[
        list[str] | None, typer.Option(help="A shipped requirement, or FILE.yaml#NAME; repeat it for several. [R1]")
    ] = None,
    generator: Annotated[
        str | None, typer.Option(help="Who writes scenarios: heuristic, random, vlm, or a plug-in.")
    ] = None,
    strategy: Annotated[
        str | None, typer.Option(help="study, climb, elite, unguided, random, or a plug-in. [study]")
    ] = None,
    simulator: Annotated[
        str | None, typer.Option(help="embedded; kinematic: no physics; or a plug-in. [embedded]")
    ] = None,
    humans: Annotated[int | None, typer.Option(min=1, max=100, help="People in a scenario. [2]")] = None,
    scenarios: Annotated[int | None, typer.Option(min=1, help="Scenarios to find. [10]")] = None,
    refinements: Annotated[int | None, typer.Option(min=0, help="Refinements of each scenario. [4]")] = None,
    repeats: Annotated[int | None, typer.Option(min=1, help="Runs of each configuration. [5]")] = None,
    confirmations: Annotated[
        int | None, typer.Option(min=0, help="At most so many fresh runs of the best. [30]")
    ] = None,
    memory: Annotated[int | None, typer.Option(min=0, help="Earlier scenarios a new one is told of. [10]")] = None,
    abreast: Annotated[
        int | None,
        typer.Option(min=1, help="Attempts under way at a time; more of them keep more cores busy. [1]"),
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Everything random follows from it. [0]")] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Worker processes. [one per core]")] = None,
    executor: Annotated[
        str | None, typer.Option(help="Where runs are made: processes (of --jobs), cluster, or a plug-in. [processes]")
    ] = None,
    store: Annotated[str | None, typer.Option(help="What keeps the campaign: sqlite, or a plug-in. [sqlite]")] = None,
    out: Annotated[str | None, typer.Option(help="Folder of the campaign; an existing one is resumed.")] = None,
    model: Annotated[str | None, typer.Option(help="VLM, e.g. openai-chat:gpt-4.1.")] = None,
    base_url: Annotated[str | None, typer.Option(help="Address of an OpenAI-compatible server.")] = None,
    conversation: Annotated[str | None, typer.Option(help="compact or study. [compact]")] = None,
    prompts: Annotated[str | None, typer.Option(help="Folder of prompt templates that replace ours.")] = None,
    replay: Annotated[str | None, typer.Option(help="Answer from these recordings, without a model.")] = None,
    budget_usd: Annotated[float | None, typer.Option(help="Stop before the model's calls cost more.")] = None,
    budget_calls: Annotated[int | None, typer.Option(help="Stop before more calls of the model.")] = None,
    budget_tokens: Annotated[int | None, typer.Option(help="Stop before more tokens.")] = None,
    generator_option: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="For the generator.")] = None,
    simulator_option: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="For the simulator.")] = None,
    executor_option: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="For the executor.")] = None,
    store_option: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="For the store.")] = None,
    fail_on_violation: Annotated[
        bool | None, typer.Option("--fail-on-violation", help="Exit code 1 if the requirement is violated.")
    ] = None,
    junit: Annotated[str | None, typer.Option(metavar="FILE", help="Write the verdicts as JUnit XML.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")] = False,
) -> None:
    """Find, confirm and report scenarios that make the robot violate a requirement.

    Searches `scenarios` x (1 + `refinements`) configurations, each in `repeats` runs, and ranks them: by the share of
    runs that violate the limit, then by the mean objective. The first is confirmed in fresh runs until the verdict is
    sure (wrong in at most 5 % of cases) or `confirmations` are spent; without a limit in exactly so many. Everything
    is kept in the folder --out; the same command on an existing folder resumes.

    A plug-in that is installed beside RVSG is given by its name, like what ships with RVSG.

    Several routes or requirements are a campaign for each pair, side by side, each in a folder of its own in --out.
    """
    given = {k: v for k, v in locals().items() if v is not None and k not in ("campaign", "json")}
    from rvsg.api.config import read_campaign_file
    from rvsg.cli.cells import cells_of, run_cells
    from rvsg.cli.options import pairs

    for kind in ("generator", "simulator", "executor", "store"):
        if options := given.pop(f"{kind}_option", None):
            given[f"{kind}_options"] = pairs(kind, options)
    from_file = read_campaign_file(campaign) if campaign else {}
    cells = cells_of(from_file, given)
    if cells is not None:
        raise typer.Exit(run_cells(cells, as_json=json))
    single = [{key: v[0] if isinstance(v, list) else v for key, v in values.items()} for values in (from_file, given)]
    raise typer.Exit(run_campaign_of(*single, as_json=json))


def run_campaign_of(
    from_file: dict[str, Any],
    given: dict[str, Any],
    *,
    as_json: bool,
    remark: Callable[[Plan, Summary], str] | None = None,
) -> int:
    """Run or resume the campaign of a file's keys and of options; show and write what was found; the exit code."""
    begin = time.monotonic()
    wired, summary = find(from_file, given)
    _show(wired, summary, wired.config.folder, time.monotonic() - begin, as_json=as_json)
    if remark is not None:
        say(remark(wired.plan, summary))
    return 1 if wired.config.fail_on_violation and summary.violated else 0


def find(from_file: dict[str, Any], given: dict[str, Any]) -> tuple[Wired, Summary]:
    """Run or resume a campaign and write what was found."""
    from rvsg.api.config import effective
    from rvsg.api.folder import CONFIG, alone_in, check_out, make_folder, opened
    from rvsg.api.paths import FROM, as_kept
    from rvsg.api.paths import places as places_of
    from rvsg.api.record_files import check_writable
    from rvsg.api.wiring import wire
    from rvsg.core.files import write_whole

    begun_in: object = str(Path.cwd())
    places: dict[str, str] = {}
    config = effective(None, from_file, given)
    if config.junit:
        check_writable(Path(config.junit))
    folder = config.folder
    check_out(folder)
    kept_by = _same_store(folder, config)
    stored = _stored(folder)
    if stored is not None:
        begun_in = stored.pop(FROM, None)
        places = places_of(stored["config"], begun_in)
        config = effective(stored["config"] | kept_by, as_kept(from_file, places), as_kept(given, places))
    wired = wire(config, places)
    if stored is not None:
        wired = wired.in_words_of(stored, say)
    _no_model_options_in_vain(config, given)
    make_folder(folder)
    with alone_in(folder), opened(folder, config.store, config.store_options) as ledger:
        if stored is not None:
            _same_or_empty(stored, wired.settings, ledger, folder)
        if ledger.settings(wired.plan.name) is None:
            ledger.begin(wired.plan.name, wired.settings | {FROM: begun_in or str(Path.cwd())})
        write_whole(folder / CONFIG, wired.file)
        attempts = _work(wired, ledger, folder, resumed=stored is not None)
        summary = _write(wired, ledger, attempts, folder)
    _show_lost(attempts)
    return wired, summary


def _same_store(folder: Path, config: CampaignConfig) -> dict[str, Any]:
    """The store that keeps the folder's campaign, as settings; empty without one. InputError where another is asked."""
    from rvsg.api.folder import store_of

    known = store_of(folder)
    if known is None:
        return {}
    if config.store not in ("sqlite", known[0]):
        raise InputError(f"{folder}: its campaign is kept by the store {known[0]!r}, not {config.store!r}.")
    return {"store": known[0], "store_options": known[1]}


def _stored(folder: Path) -> dict[str, Any] | None:
    """The settings of the campaign kept there; None where there is none."""
    from rvsg.api.folder import opened, store_of
    from rvsg.api.wiring import with_defaults

    known = store_of(folder)
    if known is None:
        return None
    with opened(folder, *known) as ledger:
        campaigns = ledger.campaigns()
        kept = ledger.settings(campaigns[0]) if campaigns else None
    if kept is not None and "config" not in kept:
        raise InputError(f"{folder}: this folder holds imported results, no campaign. Choose another --out.")
    return with_defaults(kept) if kept is not None else None


def _no_model_options_in_vain(config: CampaignConfig, given: dict[str, Any]) -> None:
    """Refuse options of a model on the command line where no model is asked; those of a file are only told."""
    from rvsg.api.wiring import VLM_OPTIONS

    if config.generator_name == "vlm":
        return
    if in_vain := [f"--{key.replace('_', '-')}" for key in VLM_OPTIONS if key in given]:
        raise InputError(
            f'{", ".join(in_vain)}: this campaign uses the generator "{config.generator_name}", and only "vlm" takes '
            "such options. Leave them out, or use --generator vlm."
        )
    if told := [key for key in VLM_OPTIONS if getattr(config, key) not in (None, "compact")]:
        say(f'The generator is "{config.generator_name}": {", ".join(told)} in the campaign file have no effect.')


def _same_or_empty(stored: dict[str, Any], asked: dict[str, Any], ledger: Ledger, folder: Path) -> None:
    """A resumed campaign keeps its settings: records of two settings must not mix. Without an attempt it begins anew.

    So a wrong name of a model, found out by the first call, can be mended in the same folder.
    """
    from rvsg.api.wiring import differences

    found = differences(stored, asked)
    forget = getattr(ledger, "forget_empty", None)
    if found and forget is not None and forget(ledger.campaigns()[0]):
        return
    if found:
        found = [line.removeprefix("config.") for line in found if line.startswith("config.")] or found
        listed = "\n".join(f"  - {line}" for line in found)
        raise InputError(
            f"{folder}: this folder holds a campaign with other settings:\n{listed}\n"
            "To resume it, leave these options out; for a new campaign choose another --out."
        )


def _work(wired: Wired, ledger: Any, folder: Path, *, resumed: bool) -> list[Attempt]:
    """The campaign itself; an interruption says how to go on."""
    from rvsg.api.config import BUDGETS
    from rvsg.api.wiring import resume_command
    from rvsg.campaign.loop import run_campaign
    from rvsg.cli.interruption import interruptible
    from rvsg.cli.progress import CampaignProgress
    from rvsg.core.errors import BudgetSpent, GenerationError, Interrupted, SimulationError
    from rvsg.report.summary import counted

    known = list(ledger.attempts(wired.plan.name))
    plan = wired.plan
    at_most = "at most " if plan.requirement.threshold is not None and plan.confirmations else ""
    say(
        f"{plan.requirement.name} ({plan.requirement.title}) on {plan.mission.world}, {plan.mission.route.name}: "
        f"{counted(plan.scenarios, 'scenario')} x {counted(plan.configurations, 'configuration')} x "
        f"{counted(plan.repeats, 'run')}, then "
        f"{at_most}{plan.confirmations or 'none'} to confirm."
    )
    if resumed:
        there = counted(len(known), "attempt is", "attempts are")
        say(f"Resuming {folder}: {there} there already." if known else f"Beginning again in {folder}.")
    how = f"Resume with: {as_started(resume_command(wired.config))}"
    try:
        with interruptible() as interruption:
            if len(known) < plan.attempts or not any(a.purpose == "confirmation" for a in known):
                with interruption.at_once(f"Interrupted before a run was made. {how}"):
                    wired.warm_up(say)
            with (
                CampaignProgress(plan, known, check=interruption.check) as progress,
                wired.simulations(ledger, say) as simulations,
            ):
                if watch := getattr(wired.generator, "watch", None):
                    watch(progress.calling)
                return run_campaign(plan, wired.strategy(ledger), wired.parts(ledger, simulations, progress))
    except KeyboardInterrupt:
        kept = counted(len(list(ledger.attempts(plan.name))), "finished attempt is", "finished attempts are")
        so_far = as_started(shlex.join(["rvsg", "report", str(folder)]))
        raise Interrupted(f"Interrupted; {kept} kept. {how}\nWhat there is so far: {so_far}") from None
    except BudgetSpent as spent:
        larger = as_started(resume_command(wired.config, without=BUDGETS))
        raise BudgetSpent(f"{spent} Everything so far is kept. Resume with: {larger} --budget-...") from None
    except (GenerationError, SimulationError):
        say(f"Everything so far is kept. {how}")
        raise


def _write(wired: Wired, ledger: Any, attempts: list[Attempt], folder: Path) -> Summary:
    """The files beside the ledger: the report, the best scenario, JUnit XML."""
    from rvsg.api.folder import BEST, REPORT
    from rvsg.api.wiring import command_for
    from rvsg.campaign.ranking import best_attempt
    from rvsg.core.files import write_whole
    from rvsg.report.junit import junit_xml
    from rvsg.report.page import write_page
    from rvsg.report.summary import summarise

    summary = summarise(wired.plan, attempts)
    write_page(
        folder / REPORT,
        wired.plan,
        attempts,
        world=wired.world,
        run_of=ledger.run,
        command=command_for(wired.config),
        simulator=wired.simulator.name,
    )
    best = best_attempt(attempts, wired.plan.requirement)
    if best is not None and best.proposal.scenario is not None:
        write_whole(folder / BEST, best.proposal.scenario.to_json())
    if wired.config.junit:
        write_whole(Path(wired.config.junit), junit_xml(wired.plan, summary))
    return summary


def _show_lost(attempts: list[Attempt]) -> None:
    """Say which answers of a model were no use, and why attempts came without a scenario."""
    from rvsg.cli.model_options import told_unusable
    from rvsg.report.summary import counted

    search = [attempt for attempt in attempts if attempt.purpose == "search"]
    lost = [attempt for attempt in search if attempt.proposal.scenario is None]
    if lost and (problems := lost[0].proposal.problems):
        say(f"{counted(len(lost), 'attempt')} of {len(search)} came without a scenario; the first: {problems[0]}")
    if unusable := told_unusable([call for attempt in search for call in attempt.proposal.calls]):
        say(unusable)


def _show(wired: Wired, summary: Summary, folder: Path, spent_s: float, *, as_json: bool) -> None:
    """The ranked table, the confirmation, where the report is, and the command that repeats it."""
    from rvsg.api.folder import REPORT
    from rvsg.api.wiring import command_for, command_for_more
    from rvsg.cli.tables import confirmation_line, ranked_table
    from rvsg.evaluation.verdict import Status
    from rvsg.report.summary import counted

    command = command_for(wired.config)
    if as_json:
        print_json(
            summary.model_dump(mode="json", exclude={"confirmed": {"brief", "proposal"}})
            | {"out": str(folder), "report": str(folder / REPORT), "command": command}
        )
    say(ranked_table(wired.plan, summary, width=console().width))
    say(confirmation_line(wired.plan, summary))
    verdict = summary.confirmed.verdict if summary.confirmed else None
    if verdict and verdict.status is Status.INCONCLUSIVE:
        more = as_started(command_for_more(wired.config, summary.accounting.confirmation_runs))
        say(f"More fresh runs can decide it; the same campaign with more: {more}")
    account = summary.accounting
    say(
        f"{counted(account.search_runs, 'run')} of search and {account.confirmation_runs} of confirmation in "
        f"{spent_s:.0f} s; kept in {folder}"
    )
    if account.calls:
        asked = "In the record the model" if wired.config.replay else "The model"
        cost = f"{account.cost_usd:.4f} USD" if account.cost_usd is not None else "cost unknown"
        say(
            f"{asked} was asked {counted(account.calls, 'time')}: {account.input_tokens} input tokens "
            f"({account.cached_tokens} cached), {account.output_tokens} output tokens, {cost}."
        )
    for note in getattr(wired.generator, "notes", ()):
        say(note)
    say(f"Report: {folder / REPORT}")
    say(f"Repeat it with: {as_started(command)}")
