"""`rvsg coverage`: what suites and campaigns exercise, and what is untested."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.arguments import AsJson, Jobs, Simulator, SimulatorOption
from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb

app = verb()


@app.command()
def coverage(
    sources: Annotated[list[Path], typer.Argument(help="Folders of suites and campaigns.")],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a page (.html), a map (.png) or .json.")
    ] = None,
    runs: Annotated[
        int, typer.Option(min=0, help="Runs of each scenario of a suite, to detect encounters; campaigns store theirs.")
    ] = 1,
    simulator: Simulator = "embedded",
    simulator_option: SimulatorOption = None,
    jobs: Jobs = 1,
    json: AsJson = False,
) -> None:
    """Show which places, routes, encounters, behaviours and requirements are exercised, and which are not.

    Places, behaviours and requirements come from the scenarios. Encounters come from the runs: a person within 1.5 m of
    the robot, and the side the person comes from.
    """
    from rvsg.app.coverage import check_format, write_coverage
    from rvsg.app.coverage import coverage as measure
    from rvsg.cli.options import spec
    from rvsg.core.outputs import check_writable

    if out is not None:
        check_format(out)
        check_writable(out)
    chosen = spec("simulator", simulator, simulator_option)
    found = measure(*sources, runs=runs, jobs=jobs, simulator=chosen, on_message=say)
    if out is not None:
        write_coverage(out, found)
    if json:
        print_json([each.coverage.model_dump(mode="json") for each in found])
        return
    for each in found:
        say(each.text)
