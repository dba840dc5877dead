"""`rvsg scenario`: adapt a saved scenario to a world that has changed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.console import say
from rvsg.cli.frame import verb

app = verb(no_args_is_help=True, help="Adapt a saved scenario to a world that has changed.")


@app.callback()
def _several() -> None:
    """Adapt a saved scenario to a world that has changed."""


@app.command()
def migrate(
    scenario: Annotated[Path, typer.Argument(metavar="FILE", help="A scenario or a proposal as JSON.")],
    world: Annotated[str, typer.Option(help="The world to adapt it to: a shipped world or a world folder.")],
    route: Annotated[str | None, typer.Option(help="Use this route of the world instead of the saved one.")] = None,
    reach: Annotated[float, typer.Option(min=0.0, help="How far a waypoint may move, metres.")] = 1.0,
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="Write the new scenario here; - is standard output.")
    ] = Path("-"),
) -> None:
    """Adapt a scenario to a world that has changed since the scenario was saved.

    Each waypoint becomes the one nearest to its old position. RVSG checks the result before it writes it.
    """
    from rvsg.core.outputs import check_writable, write_text
    from rvsg.scenario.builder import migrate_scenario, scenario_json

    check_writable(out)
    migrated, changes = migrate_scenario(scenario, world, route=route, reach_m=reach)
    for change in changes:
        say(change)
    if not changes:
        say("No waypoint had to be changed.")
    write_text(out, scenario_json(migrated))
