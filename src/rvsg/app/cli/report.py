"""`rvsg report`: what a stored campaign found."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.app.cli.console import console, print_json, say
from rvsg.app.cli.frame import verb

app = verb()


@app.command()
def report(
    store: Annotated[Path, typer.Argument(help="The folder of a campaign, or its ledger.")],
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
    """Write the page of a campaign, finished or not, and print its ranked scenarios."""
    from rvsg.app.cli.tables import confirmation_line, ranked_table
    from rvsg.app.config import CampaignConfig
    from rvsg.app.folder import LEDGER, REPORT
    from rvsg.app.wiring import command_for
    from rvsg.campaign.plan import Plan
    from rvsg.errors import InputError
    from rvsg.report.files import write_whole
    from rvsg.report.junit import junit_xml
    from rvsg.report.page import write_page
    from rvsg.report.summary import summarise
    from rvsg.store.sqlite import SqliteLedger
    from rvsg.world.load import load_world

    path = store / LEDGER if store.is_dir() else store
    if tables is not None:
        _write_tables([path, *(other / LEDGER if other.is_dir() else other for other in also or ())], tables)
    with SqliteLedger(path, create=False) as ledger:
        planned = [s for name in ledger.campaigns() if (s := ledger.settings(name)) and "plan" in s]
        if not planned and tables is not None:
            return
        if not planned:
            raise InputError(f"{path}: this store holds no campaign of `rvsg run`.")
        settings = planned[0]
        plan = Plan.model_validate(settings["plan"])
        config = CampaignConfig.model_validate(settings["config"])
        attempts = list(ledger.attempts(plan.name))
        summary = summarise(plan, attempts)
        page = html or path.parent / REPORT
        write_page(
            page,
            plan,
            attempts,
            world=load_world(world or plan.mission.world),
            run_of=ledger.run,
            command=command_for(config),
            simulator=settings["simulator"]["name"],
        )
    if junit:
        write_whole(junit, junit_xml(plan, summary))
    if json:
        print_json(summary.model_dump(mode="json", exclude={"confirmed": {"brief", "proposal"}}))
    say(ranked_table(plan, summary, width=console().width))
    say(confirmation_line(plan, summary))
    say(f"Report: {page}")
    if fail_on_violation and summary.violated:
        raise typer.Exit(1)


def _write_tables(stores: list[Path], out: Path) -> None:
    from contextlib import ExitStack

    from rvsg.report.table_files import write_tables
    from rvsg.store.sqlite import SqliteLedger

    with ExitStack() as stack:
        ledgers = [stack.enter_context(SqliteLedger(store, create=False)) for store in stores]
        for note in write_tables(*ledgers, out=out):
            say(f"  {note}")
    say(f"Tables: {out}/published and {out}/honest (rq1, rq2, rq3 as csv, md, tex; with matplotlib rq3 drawn too)")
