"""`rvsg compare-versions`: what a change of the robot fixed and broke."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.arguments import AsJson, Jobs
from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb

app = verb()


@app.command(name="compare-versions")
def compare_versions(
    first: Annotated[str, typer.Argument(help="Results of `rvsg suite run --json`, or a version: see --suite.")],
    second: Annotated[str, typer.Argument(help="The same, for the version after.")],
    suite: Annotated[
        Path | None,
        typer.Option(
            help="Run this suite now, with the versions SIMULATOR[:OPTION=VALUE,...], e.g. embedded:robot=slow.yaml."
        ),
    ] = None,
    runs: Annotated[int, typer.Option(min=1, help="Runs of every case and version, on the same seeds.")] = 20,
    jobs: Jobs = 1,
    error_rate: Annotated[
        float, typer.Option(min=0.0001, max=0.5, help="Probability of one false alarm in the whole comparison.")
    ] = 0.05,
    markdown: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a table for a pull request.")] = None,
    html: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write a page; with --suite it replays both on one clock."),
    ] = None,
    json: AsJson = False,
) -> None:
    """Compare two versions on the same scenarios and seeds: fixed, broken, unchanged, unclear.

    A change counts where the exact McNemar test over the paired runs, corrected by Holm over all cases, is below
    --error-rate. The exit code is 1 where a case is broken.
    """
    from rvsg.app.comparison import compare_versions as compare
    from rvsg.core.outputs import check_writable, write_text
    from rvsg.report.comparison import changes_markdown

    for file in (markdown, html):
        if file is not None:
            check_writable(file)
    comparison = compare(first, second, suite=suite, runs=runs, jobs=jobs, error_rate=error_rate, on_message=say)
    if markdown is not None:
        write_text(markdown, changes_markdown(comparison.found))
    if html is not None:
        write_text(html, comparison.page())
    if json:
        print_json(comparison.found.model_dump(mode="json"))
    else:
        say(changes_markdown(comparison.found))
    if comparison.found.broken:
        raise typer.Exit(1)
