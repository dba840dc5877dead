"""`rvsg simulate`: simulate a scenario and write its runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.arguments import Doors, Jobs, OtherWorld, Simulator, SimulatorOption, Stack, StackOption
from rvsg.cli.console import say
from rvsg.cli.frame import verb

app = verb()


@app.command()
def simulate(
    scenario: Annotated[Path, typer.Argument(help="A scenario or a proposal as JSON; - is standard input.")],
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the first run; each further run takes the next integer.")
    ] = 0,
    repeats: Annotated[int, typer.Option(min=1, help="Number of runs.")] = 1,
    world: OtherWorld = None,
    robot: Annotated[
        str | None, typer.Option(help="Instead of the scenario's robot: a shipped one (`rvsg robots`) or a robot file.")
    ] = None,
    moved: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Objects in the robot's way that its map does not show (objects.yaml)."),
    ] = None,
    door: Doors = None,
    stack: Stack = None,
    simulator: Simulator = "embedded",
    simulator_option: SimulatorOption = None,
    stack_option: StackOption = None,
    jobs: Jobs = 1,
    out: Annotated[Path, typer.Option(help="Write the runs here; - is standard output.")] = Path("-"),
    bag: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Also write the run as a rosbag2 (MCAP), with everything the robot senses."),
    ] = None,
) -> None:
    """Simulate a scenario and write its runs, one JSON object per line.

    RVSG checks the scenario first: it simulates no unknown waypoint and no path through an obstacle.
    """
    import rvsg
    from rvsg.app.playback import check_bag, write_bag_of
    from rvsg.cli.options import spec, stack_spec, states
    from rvsg.core.outputs import check_writable, write_text
    from rvsg.scenario.builder import load_changed
    from rvsg.simulation.run_files import runs_text

    check_writable(out)
    check_bag(bag, repeats)
    asked, place = load_changed(scenario, world, robot=robot, moved=moved, doors=states(door), on_message=say)

    def made(run: rvsg.Run) -> None:
        fault = run.stack_fault
        say(
            f"seed {run.seed}: {run.outcome.value}, after {run.trajectory.t[-1]:.1f} s"
            + (f": {fault}" if fault else "")
            + "".join(f"\n  warning: {warning}" for warning in run.stack_warnings)
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
