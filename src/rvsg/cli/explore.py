"""`rvsg explore`: find where in its ranges a scenario violates a requirement."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.arguments import AsJson, Jobs, OtherWorld, Requirement, Simulator, SimulatorOption
from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb

app = verb()


@app.command()
def explore(
    scenario: Annotated[Path, typer.Argument(help='A scenario as JSON; a number of a person may be "0.8 to 1.4".')],
    requirement: Requirement = "R1",
    vary: Annotated[
        list[str] | None,
        typer.Option(metavar="PERSON.KEY=LOW to HIGH", help="A range, e.g. 'Human 1.speed_m_s=0.8 to 1.4'."),
    ] = None,
    runs: Annotated[int, typer.Option(min=1, max=100_000, help="Points of the Latin hypercube, one run each.")] = 60,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the points and the runs.")] = 0,
    world: OtherWorld = None,
    simulator: Simulator = "embedded",
    simulator_option: SimulatorOption = None,
    jobs: Jobs = 1,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a page (.html), the picture (.svg) or .json.")
    ] = None,
    worst: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the worst point as a scenario.")] = None,
    json: AsJson = False,
) -> None:
    """Run a scenario with ranges, and show where in them it violates a requirement and which range matters.

    The points are a Latin hypercube over the ranges. A logistic surface through the runs gives the violation
    probability, its boundary, and the sensitivity to each range.
    """
    from rvsg.app.exploration import check_outputs, describe_exploration, write_outputs
    from rvsg.app.exploration import explore as run_points
    from rvsg.cli.options import spec

    check_outputs(out, worst)
    found = run_points(
        scenario,
        requirement,
        vary=vary or (),
        runs=runs,
        seed=seed,
        jobs=jobs,
        simulator=spec("simulator", simulator, simulator_option),
        world=world,
        on_message=say,
    )
    write_outputs(found, out, worst)
    if json:
        print_json(found.model_dump(mode="json"))
    else:
        say(describe_exploration(found))
