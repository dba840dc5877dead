"""`rvsg report`: what a stored campaign found."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rvsg.cli.console import as_started, console, print_json, say
from rvsg.cli.frame import verb

if TYPE_CHECKING:
    from rvsg.campaign.plan import Plan
    from rvsg.report.summary import Summary

app = verb()


@app.command()
def report(
    store: Annotated[Path, typer.Argument(help="The folder of a campaign or of several, or a ledger.")],
    html: Annotated[Path | None, typer.Option(help="Where the page is written. [report.html in the folder]")] = None,
    junit: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the verdicts as JUnit XML.")] = None,
    tables: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the study's tables: DIR/published and DIR/honest.")
    ] = None,
    also: Annotated[
        list[Path] | None, typer.Option(metavar="STORE", help="For --tables: read this store too (repeatable).")
    ] = None,
    world: Annotated[str | None, typer.Option(help="Where the world is now, if it was moved.")] = None,
    fail_on_violation: Annotated[
        bool, typer.Option("--fail-on-violation", help="Exit code 1 if the requirement is violated.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")] = False,
) -> None:
    """Write the page of a campaign, finished or not, and print its ranked scenarios.

    For the folder of several campaigns: the page of each, and an overview that leads to them.
    """
    from rvsg.api.folder import CELLS, REPORT
    from rvsg.cli.cells import folders_in, write_overview_in
    from rvsg.cli.tables import cells_table
    from rvsg.core.errors import InputError
    from rvsg.core.files import write_whole
    from rvsg.report.junit import junit_of

    several = store.is_dir() and (store / CELLS).exists()
    paths = folders_in(store) if several else [store]
    if not paths:
        begin = as_started(shlex.join(["rvsg", "run", "--out", str(store)]))
        raise InputError(f"{store}: none of its campaigns has begun. Begin them: {begin}")
    if tables is not None:
        _write_tables([*paths, *(also or ())], tables)
    if several and html is not None:
        raise InputError(f"{store}: {len(paths)} campaigns have a page each; --html names one. Report them one by one.")
    found = [each for path in paths for each in _report(path, html, world, optional=tables is not None)]
    if junit:
        write_whole(junit, junit_of([(plan, summary) for plan, summary, _ in found]))
    told = [summary.model_dump(mode="json", exclude={"confirmed": {"brief", "proposal"}}) for _, summary, _ in found]
    if json and found:
        print_json({"campaigns": told} if several or len(told) > 1 else told[0])
    if several:
        write_overview_in(store, {page.parent: (plan, summary) for plan, summary, page in found})
        say(cells_table([(plan, summary) for plan, summary, _ in found]))
        _say_unfinished(store, [(plan, summary) for plan, summary, _ in found])
        say(f"Reports: {store / REPORT}")
    else:
        for each in found:
            _say_found(store, *each)
    if fail_on_violation and any(summary.violated for _, summary, _ in found):
        raise typer.Exit(1)


def _say_found(store: Path, plan: Plan, summary: Summary, page: Path) -> None:
    """What one campaign found, and where it was cut off: how far it came, and how it goes on."""
    from rvsg.cli.tables import confirmation_line, how_far, ranked_table

    if summary.ranking:
        say(ranked_table(plan, summary, width=console().width))
    if summary.complete:
        say(confirmation_line(plan, summary))
    else:
        say(f"The campaign is not finished: {how_far(plan, summary)}.{_go_on(store)}")
    say(f"Report: {page}")


def _say_unfinished(folder: Path, found: list[tuple[Plan, Summary]]) -> None:
    """Which of several campaigns were cut off or never began, and how they go on."""
    from rvsg.cli.cells import cells_of
    from rvsg.cli.tables import how_far

    cut_off = [(plan, summary) for plan, summary in found if not summary.complete]
    for plan, summary in cut_off:
        say(f"{plan.mission.route.name} {plan.requirement.name} is not finished: {how_far(plan, summary)}.")
    cells = cells_of({}, {"out": str(folder)})
    not_begun = len(cells.pairs) - len(found) if cells else 0
    if not_begun:
        say(f"{not_begun} more {'has' if not_begun == 1 else 'have'} not begun.")
    if cut_off or not_begun:
        say(_go_on(folder).lstrip())


def _go_on(store: Path) -> str:
    """The command that goes on with what a folder keeps; empty for a ledger that is in no folder of a campaign."""
    from rvsg.api.folder import LEDGER

    folder = store if store.is_dir() else store.parent if store.name == LEDGER else None
    return f" Go on with: {as_started(shlex.join(['rvsg', 'run', '--out', str(folder)]))}" if folder else ""


def _report(path: Path, html: Path | None, world: str | None, *, optional: bool) -> list[tuple[Plan, Summary, Path]]:
    """Write the page of every campaign stored there; none where it is `optional` and there is no campaign."""
    from rvsg.api.index import campaigns_in

    found = campaigns_in(path, optional=optional)
    pages = []
    for campaign in found:
        page = html if html is not None and len(found) == 1 else campaign.page(several=len(found) > 1)
        campaign.report(page, world=world)
        pages.append((campaign.plan, campaign.summary(), page))
    return pages


def _write_tables(stores: list[Path], out: Path) -> None:
    from contextlib import ExitStack

    from rvsg.api.folder import make_folder, reading
    from rvsg.study.table_files import write_tables

    make_folder(out, option="--tables")
    with ExitStack() as stack:
        ledgers = [stack.enter_context(reading(store)) for store in stores]
        for note in write_tables(*ledgers, out=out):
            say(f"  {note}")
    say(f"Tables: {out}/published and {out}/honest (rq1, rq2, rq3 as csv, md, tex; with matplotlib rq3 drawn too)")
