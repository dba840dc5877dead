"""`rvsg import agents`: people of HuNavSim as a scenario."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.console import say
from rvsg.cli.frame import verb

app = verb(no_args_is_help=True, help="Read people of HuNavSim, or results of the published study.")


@app.callback()
def _several() -> None:
    """Read people of HuNavSim, or results of the published study."""


@app.command("agents")
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
    from rvsg.core.outputs import check_writable, write_text
    from rvsg.scenario.builder import scenario_json
    from rvsg_exchange import formats as exchange

    check_writable(out)
    scenario, notes = exchange.import_agents(agents, world, route, description=description)
    for note in notes:
        say(note)
    write_text(out, scenario_json(scenario))
