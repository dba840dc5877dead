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
    robot: Annotated[
        str | None, typer.Option(help="Instead of the scenario's robot: a shipped one (`rvsg robots`) or a robot file.")
    ] = None,
    moved: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Objects in the robot's way that its map does not show (objects.yaml)."),
    ] = None,
    door: Annotated[
        list[str] | None, typer.Option(metavar="NAME=STATE", help="A door that is open, closed or automatic.")
    ] = None,
    stack: Annotated[
        str | None, typer.Option(help="Navigation stack under test: a name (`rvsg stacks`) or file. [nav2-dwb]")
    ] = None,
    simulator: Annotated[str, typer.Option(help="embedded; kinematic: no physics.")] = "embedded",
    simulator_option: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="For the simulator.")] = None,
    stack_option: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="For the stack.")] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Worker processes.")] = 1,
    out: Annotated[Path, typer.Option(help="Where the runs are written; - is standard output.")] = Path("-"),
    bag: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write the run as a rosbag2 (MCAP) too, with all that the robot sees."),
    ] = None,
) -> None:
    """Simulate a scenario and write its runs, one JSON object per line.

    The scenario is checked first: an unknown waypoint or a path through an obstacle never reaches a simulator.
    """
    import rvsg
    from rvsg.api.exchange import check_bag, write_bag_of
    from rvsg.api.records import check_writable, runs_text, write_text
    from rvsg.api.scenarios import load_changed
    from rvsg.cli.options import spec, stack_spec, states

    check_writable(out)
    check_bag(bag, repeats)
    asked, place = load_changed(scenario, world, robot=robot, moved=moved, doors=states(door), on_message=say)

    def made(run: rvsg.Run) -> None:
        fault = run.stack_fault
        say(
            f"seed {run.seed}: {run.outcome.value}, after {run.trajectory.t[-1]:.1f} s"
            + (f": {fault}" if fault else "")
        )

    seeds = range(seed, seed + repeats)
    chosen = spec("simulator", simulator, simulator_option)
    driver = stack_spec(stack, stack_option)
    runs = rvsg.simulate(
        asked, seeds, jobs=jobs, simulator=chosen, stack=driver, world=place, on_run=made, on_message=say
    )
    write_text(out, runs_text(runs))
    if bag is not None:
        write_bag_of(runs, bag, asked, simulator=chosen, stack=driver, world=place)
