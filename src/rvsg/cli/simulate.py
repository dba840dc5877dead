"""`rvsg simulate`: a scenario becomes runs, as a file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.console import say
from rvsg.cli.frame import verb

app = verb()


@app.command()
def simulate(
    scenario: Annotated[Path, typer.Argument(help="A scenario or a proposal as JSON; - is standard input.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first run; the next have the next.")] = 0,
    repeats: Annotated[int, typer.Option(min=1, help="Number of runs.")] = 1,
    world: Annotated[str | None, typer.Option(help="Instead of the world the scenario names.")] = None,
    simulator: Annotated[str, typer.Option(help="embedded; kinematic: no physics.")] = "embedded",
    simulator_option: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="For the simulator.")] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Worker processes.")] = 1,
    out: Annotated[Path, typer.Option(help="Where the runs are written; - is standard output.")] = Path("-"),
) -> None:
    """Simulate a scenario and write its runs, one JSON object per line.

    The scenario is checked first: an unknown waypoint or a path through an obstacle never reaches a simulator.
    """
    from rvsg.api.record_files import check_writable, read_scenario, runs_text, write_text
    from rvsg.api.wiring import check_robot, check_scenario, world_of
    from rvsg.campaign.parallel import Simulations
    from rvsg.cli.options import pairs
    from rvsg.core import plugins
    from rvsg.core.errors import SimulationError
    from rvsg.simulation.run import Run

    check_writable(out)
    asked = read_scenario(scenario)
    place = world_of(asked, world)
    for doubtful in check_scenario(asked, place):
        say(doubtful)
    made = plugins.make("simulator", simulator, pairs("simulator", simulator_option))
    check_robot(scenario, asked, made)
    prepare = getattr(made, "prepare", None)
    if prepare is not None:
        prepare(say)
    runs = []
    with Simulations(made, place, jobs=jobs) as simulations:
        for ordered in [simulations.order(asked, seed + repeat) for repeat in range(repeats)]:
            found = ordered.result()
            if not isinstance(found, Run):
                raise SimulationError(f"seed {found.seed}: {found.reason}")
            runs.append(found)
            say(f"seed {found.seed}: {found.outcome.value}, after {found.trajectory.t[-1]:.1f} s")
    write_text(out, runs_text(runs))
