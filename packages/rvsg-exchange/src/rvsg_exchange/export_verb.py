"""`rvsg export`: a scenario or its runs in the format of another tool."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from rvsg.app.settings import effective
from rvsg.cli.console import say
from rvsg.cli.frame import verb
from rvsg.cli.options import OtherWorld, setting_options

app = verb()


@app.command()
@setting_options("simulator", "simulator_options")
def export(
    settings: dict[str, Any],
    to: Annotated[
        str,
        typer.Option(help="csv, parquet, mcap (runs); hunav, nav2-goals, initial-pose, osc, sdf; foxglove-layout."),
    ],
    out: Annotated[Path, typer.Option(help="The file to write.")],
    source: Annotated[Path | None, typer.Argument(help="A scenario or runs, as JSON.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the run that a scenario is simulated with.")] = 0,
    world: OtherWorld = None,
    dialect: Annotated[str, typer.Option(help="Of hunav: flat, block or v2.")] = "block",
    release: Annotated[str, typer.Option(help="Of nav2-goals: humble, jazzy or kilted.")] = "jazzy",
    trace: Annotated[bool, typer.Option("--trace", help="For mcap: record scans, costmaps and plans, too.")] = False,
) -> None:
    """Write a scenario or its runs for another tool: Foxglove, HuNavSim, Nav2, Gazebo, OpenSCENARIO, pandas.

    A format of runs simulates a scenario first, with --seed. What the format cannot hold is printed.
    """
    from rvsg.core.outputs import check_writable
    from rvsg_exchange import formats as exchange

    check_writable(out)
    notes = exchange.export(
        source,
        out,
        to,
        seed=seed,
        simulator=effective(None, {}, settings).simulator_spec,
        world=world,
        dialect=dialect,
        release=release,
        trace=trace,
        on_message=say,
    )
    for note in notes:
        say(note)
