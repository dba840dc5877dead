"""`rvsg explore`: a scenario with ranges, and where in them it violates a requirement."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb

app = verb()


@app.command()
def explore(
    scenario: Annotated[Path, typer.Argument(help='A scenario as JSON; a number of a person may be "0.8 to 1.4".')],
    requirement: Annotated[str, typer.Option(help="A shipped requirement, or FILE.yaml#NAME.")] = "R1",
    vary: Annotated[
        list[str] | None,
        typer.Option(metavar="PERSON.KEY=LOW to HIGH", help="A range, e.g. 'Human 1.speed_m_s=0.8 to 1.4'."),
    ] = None,
    runs: Annotated[int, typer.Option(min=1, max=100_000, help="Points of the Latin hypercube, one run each.")] = 60,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the points and the runs.")] = 0,
    world: Annotated[str | None, typer.Option(help="Instead of the world the scenario names.")] = None,
    simulator: Annotated[str, typer.Option(help="What runs the scenario.")] = "embedded",
    simulator_option: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="For the simulator.")] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Worker processes.")] = 1,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a page (.html), the picture (.svg) or .json.")
    ] = None,
    worst: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the worst point as a scenario.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print everything as JSON on standard output.")] = False,
) -> None:
    """Run a scenario with ranges, and show where in them it violates a requirement and which range matters.

    The points are a Latin hypercube over the ranges. A logistic surface through the runs gives the violation
    probability, its boundary, and the sensitivity to each range.
    """
    from rvsg.api.exploring import check_outputs, describe_exploration, write_outputs
    from rvsg.api.exploring import explore as run_points
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
