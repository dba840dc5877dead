"""`rvsg export` and `rvsg import agents`: scenarios and runs for other tools, and people of HuNavSim."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from rvsg.cli.console import say
from rvsg.cli.frame import verb
from rvsg.cli.options import RERUN, OtherWorld, setting_options

export_app = verb()
import_app = verb(no_args_is_help=True, help="Read people of HuNavSim, or results of the published study.")


@export_app.command()
@setting_options(*RERUN, as_found=True)
def export(
    settings: dict[str, Any],
    to: Annotated[
        str,
        typer.Option(
            help="view (a campaign or results of a suite), viewer; csv, parquet, mcap, rerun (runs); hunav, "
            "nav2-goals, initial-pose, osc, sdf; foxglove-layout."
        ),
    ],
    out: Annotated[Path, typer.Option(help="The file to write.")],
    source: Annotated[
        Path | None, typer.Argument(help="A scenario or runs, as JSON; for view the folder of a campaign.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the run that a scenario is simulated with.")] = 0,
    world: OtherWorld = None,
    dialect: Annotated[str, typer.Option(help="Of hunav: flat, block or v2.")] = "block",
    release: Annotated[str, typer.Option(help="Of nav2-goals: humble, jazzy or kilted.")] = "jazzy",
    trace: Annotated[bool, typer.Option("--trace", help="For mcap: record scans, costmaps and plans, too.")] = False,
) -> None:
    """Write a scenario or its runs for another tool, or a campaign as one .rvsg file that a browser opens.

    Tools: Foxglove, HuNavSim, Nav2, Gazebo, OpenSCENARIO, pandas. The viewer of .rvsg files is a page, `--to viewer`.

    A format of runs simulates a scenario first, with --seed. What the format cannot hold is printed.
    """
    from rvsg.core.files import check_writable
    from rvsg_exchange import formats as exchange

    check_writable(out)
    notes = exchange.export(
        source,
        out,
        to,
        seed=seed,
        settings=settings,
        world=world,
        dialect=dialect,
        release=release,
        trace=trace,
        on_message=say,
    )
    for note in notes:
        say(note)


@import_app.callback()
def _several() -> None:
    """Read people of HuNavSim, or results of the published study."""


@import_app.command("agents")
def import_agents(
    agents: Annotated[Path, typer.Argument(help="An agents file of HuNavSim 1.x or 2.0.")],
    world: Annotated[str, typer.Option(help="A shipped world or a world folder.")],
    route: Annotated[str, typer.Option(help="The route of the robot.")],
    out: Annotated[Path, typer.Option(help="Write the scenario here; - is standard output.")] = Path("-"),
    description: Annotated[str, typer.Option(help="What the scenario is about.")] = "",
) -> None:
    """Make a scenario from a HuNavSim agents file. People keep their coordinates, speeds, behaviours and reactions.

    RVSG prints each setting that it does not reproduce.
    """
    from rvsg.core.files import check_writable, write_text
    from rvsg.scenario.builder import scenario_json
    from rvsg_exchange import formats as exchange

    check_writable(out)
    scenario, notes = exchange.import_agents(agents, world, route, description=description)
    for note in notes:
        say(note)
    write_text(out, scenario_json(scenario))
