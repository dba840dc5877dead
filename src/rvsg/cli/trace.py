"""`rvsg trace`: simulate a run again with everything recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.console import say
from rvsg.cli.frame import verb

app = verb()


@app.command()
def trace(
    source: Annotated[Path, typer.Argument(help="The folder of a campaign, a file of runs, or a scenario.")],
    out: Annotated[
        list[Path] | None,
        typer.Option(help="The file to write: .mcap or .json (repeatable). [traces/RUN.trace.json in the folder]"),
    ] = None,
    run: Annotated[
        str | None, typer.Option(help="The id of a run. [the worst run of the worst finding; the first of a file]")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="The seed with which a scenario is simulated.")] = 0,
    scenario: Annotated[Path | None, typer.Option(help="The scenario of a file of runs.")] = None,
    world: Annotated[str | None, typer.Option(help="Where the world is now, if it was moved.")] = None,
    simulator_option: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="For a scenario.")] = None,
    stack: Annotated[str | None, typer.Option(help="For a scenario: the stack under test. [nav2-dwb]")] = None,
    stack_option: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="For the stack.")] = None,
) -> None:
    """Simulate a run again with everything recorded: scans, costmaps, plans, trajectories tried, behaviour tree.

    Runs are deterministic, so this is the run that was stored; one that cannot be repeated is refused. A .json file
    is shown by the report: in the folder of a campaign, the page is written again with it.
    """
    from rvsg.api.tracing import check_trace_files, trace_file_beside, trace_source
    from rvsg.cli.options import spec, stack_spec

    check_trace_files(source, out or [])
    traced = trace_source(
        source,
        run=run,
        seed=seed,
        scenario=scenario,
        world=world,
        simulator=spec("simulator", "embedded", simulator_option),
        stack=stack_spec(stack, stack_option),
        on_message=say,
    )
    written = list(out or [trace_file_beside(source, traced.run.id)])
    for path in written:
        traced.write(path)
    say(f"Trace of {traced.run.id}, seed {traced.run.seed}: {', '.join(str(path) for path in written)}")
    if not out:
        import rvsg

        page = rvsg.Campaign.open(source).report(world=world)
        say(f"Report: {page}")
