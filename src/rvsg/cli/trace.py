"""`rvsg trace`: repeat a run and record everything."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.arguments import OtherWorld, SimulatorOption, Stack, StackOption
from rvsg.cli.console import say
from rvsg.cli.frame import verb

app = verb()


@app.command()
def trace(
    source: Annotated[Path, typer.Argument(help="The folder of a campaign, a file of runs, or a scenario.")],
    out: Annotated[
        list[Path] | None,
        typer.Option(help="The file to write, .mcap or .json; repeatable. [traces/RUN.trace.json in the folder]"),
    ] = None,
    run: Annotated[
        str | None, typer.Option(help="The id of a run. [the worst run of the worst finding; the first of a file]")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the run of a scenario.")] = 0,
    scenario: Annotated[Path | None, typer.Option(help="The scenario of a file of runs.")] = None,
    world: OtherWorld = None,
    simulator_option: SimulatorOption = None,
    stack: Stack = None,
    stack_option: StackOption = None,
) -> None:
    """Repeat a run and record everything: scans, costmaps, plans, candidate trajectories, behaviour tree.

    Runs are deterministic, so this is the stored run; a run that cannot be repeated is refused. The report shows a
    .json trace: in the folder of a campaign, RVSG writes the page again with it.
    """
    from rvsg.app.playback import check_trace_files, trace_source
    from rvsg.cli.options import spec, stack_spec
    from rvsg.report.trace_view import trace_file_beside

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
