"""The results of stored campaigns: `rvsg report`, and `rvsg confirm` for one more candidate."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rvsg.cli.console import as_started, print_json, say
from rvsg.cli.frame import verb
from rvsg.cli.options import AsJson, FailOnViolation, JobsPerCore, Junit, Verbose

if TYPE_CHECKING:
    from rvsg.app.campaign import Campaign
    from rvsg.report.result import Result


app = verb()


@app.command()
def report(
    store: Annotated[
        Path,
        typer.Argument(
            help="The folder of a campaign or of several, a ledger, or a .rvsg file, which is unpacked beside it."
        ),
    ],
    html: Annotated[Path | None, typer.Option(help="Write the page here. [report.html in the folder]")] = None,
    junit: Junit = None,
    tables: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the study's tables: DIR/published and DIR/honest.")
    ] = None,
    also: Annotated[
        list[Path] | None, typer.Option(metavar="STORE", help="For --tables, read this store too; repeatable.")
    ] = None,
    world: Annotated[str | None, typer.Option(help="Folder of the world, if it was moved.")] = None,
    fail_on_violation: FailOnViolation = False,
    verbose: Verbose = False,
    json: AsJson = False,
) -> None:
    """Write the page of a campaign, finished or not, and print its ranked scenarios.

    For a folder of several campaigns, write the page of each and an overview with links.
    """
    from rvsg.app.folder import holds_several
    from rvsg.app.matrix import campaigns_of, folders_of, write_junit, write_study_tables
    from rvsg.app.view import SUFFIX, unpack_campaign

    store = unpack_campaign(store) if store.suffix == SUFFIX and store.is_file() else store
    several, reported = holds_several(store), list[dict[str, Any]]()
    paths = folders_of(store, begin=as_started(shlex.join(["rvsg", "run", "--out", str(store)])))
    if tables is not None:
        for note in write_study_tables([*paths, *(also or ())], tables):
            say(f"  {note}")
        say(f"Tables: {tables}/published and {tables}/honest (rq1, rq2, rq3 as csv, md, tex; a figure with matplotlib)")
    pages = campaigns_of(paths, html=html, optional=tables is not None)
    shown: list[tuple[Campaign, Result]] = []
    for campaign, page in pages.items():
        with campaign.result(world=world) as result:
            campaign.report(page, overview=len(paths) > 1, result=result)
            shown.append((campaign, result))
            if json:
                reported.append(campaign.data(result))
            if fail_on_violation:
                campaign.check_judged(result)
            if not several:
                _show(campaign, result, page, verbose=verbose)
    if junit:
        write_junit(junit, [result for _, result in shown])
    if reported:
        print_json({"campaigns": reported} if several or len(reported) > 1 else reported[0])
    if several:
        _show_all(store, shown)
    if fail_on_violation and any(result.violated for _, result in shown):
        raise typer.Exit(1)


def _show(campaign: Campaign, result: Result, page: Path, *, verbose: bool) -> None:
    """Print the answer of one campaign; for an unfinished one, its progress and how to resume it."""
    from rvsg.cli.tables import how_far, show_answer, show_findings

    if verbose:
        show_findings(result)
    if not result.complete:
        resume = _resume(campaign.folder) if campaign.resumable else ""
        say(f"The campaign is not finished: {how_far(result)}.{resume}")
    show_answer(result.answer, page=str(page), again=campaign.command)


def _show_all(folder: Path, shown: Sequence[tuple[Campaign, Result]]) -> None:
    """Write the overview of several campaigns; print their table and which of them are unfinished."""
    from rvsg.app.matrix import overview
    from rvsg.cli.tables import how_far, matrix_table

    page, matrix = overview(folder, [campaign for campaign, _ in shown])
    say(matrix_table([(result.plan, result.answer) for _, result in shown]))
    unfinished = [(campaign, result) for campaign, result in shown if not result.complete]
    for campaign, result in unfinished:
        resume = _resume(campaign.folder) if matrix is None and campaign.resumable else ""
        say(f"{result.plan.mission.route.name} {result.requirement.name} is not finished: {how_far(result)}.{resume}")
    if missing := len(matrix.all_pairs) - len(shown) if matrix is not None else 0:
        say(f"{missing} more {'has' if missing == 1 else 'have'} not started.")
    if matrix is not None and (unfinished or missing):
        say(_resume(matrix.folder).lstrip())
    say(f"Reports: {page}")


def _resume(folder: Path) -> str:
    """Return the sentence with the command that resumes a folder."""
    return f" Resume with: {as_started(shlex.join(['rvsg', 'run', '--out', str(folder)]))}"


confirm_app = verb()


@confirm_app.command()
def confirm(
    campaign: Annotated[Path, typer.Argument(help="The folder of a campaign.")],
    candidate: Annotated[int, typer.Argument(help="The attempt to confirm, as `rvsg run` and `rvsg report` list it.")],
    runs: Annotated[int | None, typer.Option(min=1, help="Confirmation runs, at most. [30]")] = None,
    jobs: JobsPerCore = None,
    json: AsJson = False,
) -> None:
    """Confirm a candidate of a finished search in runs with new seeds, and write the report again.

    A candidate is a configuration that violated the requirement in the search. The campaign itself confirms the worst
    configuration of every scenario, until its budget of confirmation runs is spent.
    """
    import rvsg
    from rvsg.report.terminal import describe_finding

    opened = rvsg.Campaign.open(campaign)
    attempt = opened.confirm(candidate, runs=runs, jobs=jobs)
    with opened.result() as result:
        finding = next(finding for finding in result.findings if finding.confirmation == attempt.index)
        page = opened.report(result=result)
    if json:
        print_json(finding.model_dump(mode="json"))
    for line in describe_finding(finding, opened.requirement):
        say(line)
    say(f"Report: {page}")
