"""`rvsg confirm`: confirm one more candidate of a campaign."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.arguments import AsJson, JobsPerCore
from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb

app = verb()


@app.command()
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
    made = opened.confirm(candidate, runs=runs, jobs=jobs)
    finding = next(each for each in opened.findings if each.confirmation == made.index)
    page = opened.report()
    if json:
        print_json(finding.model_dump(mode="json"))
    for line in describe_finding(finding, opened.requirement):
        say(line)
    say(f"Report: {page}")
