"""`rvsg shrink`: a violating scenario becomes the smallest one that violates as often."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb

app = verb()


@app.command()
def shrink(
    scenario: Annotated[Path, typer.Argument(help="A scenario or a proposal as JSON; - is standard input.")],
    requirement: Annotated[str, typer.Option(help="A shipped requirement, or FILE.yaml#NAME.")] = "R1",
    repeats: Annotated[int, typer.Option(min=1, help="Runs of every simpler scenario.")] = 12,
    confirmations: Annotated[int, typer.Option(min=1, help="Fresh runs of the original and the smallest.")] = 20,
    keep: Annotated[float, typer.Option(min=0.01, max=1.0, help="Share of the violations that must stay.")] = 0.8,
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything.")] = 0,
    world: Annotated[str | None, typer.Option(help="Instead of the world the scenario names.")] = None,
    simulator: Annotated[str, typer.Option(help="embedded; kinematic: no physics.")] = "embedded",
    simulator_option: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="For the simulator.")] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Worker processes for the confirmation.")] = 1,
    out: Annotated[Path, typer.Option(help="Where the smallest scenario is written; - is standard output.")] = Path(
        "-"
    ),
    json: Annotated[
        bool, typer.Option("--json", help="Write everything that was tried, not only the scenario.")
    ] = False,
) -> None:
    """Find the smallest scenario that violates a requirement about as often.

    People, tasks, pauses and delays are taken away one by one as long as the violations stay. What is left explains
    the violation. Fresh runs at the end tell how often the original and the smallest scenario violate it.
    """
    from rvsg.api.record_files import check_writable, read_scenario, write_text
    from rvsg.api.wiring import check_robot, check_scenario, requirement_of, world_of
    from rvsg.campaign.measuring import Measuring
    from rvsg.campaign.parallel import Simulations
    from rvsg.campaign.shrink import Shrinking, Simplification
    from rvsg.cli.options import pairs
    from rvsg.core import plugins
    from rvsg.report.summary import counted

    check_writable(out)
    asked = read_scenario(scenario)
    place = world_of(asked, world)
    check_scenario(asked, place)
    wanted = requirement_of(requirement).for_time_limit(asked.mission.route.time_limit_s)
    made = plugins.make("simulator", simulator, pairs("simulator", simulator_option))
    check_robot(scenario, asked, made)
    prepare = getattr(made, "prepare", None)
    if prepare is not None:
        prepare(say)
    measuring = Measuring(wanted, place)

    def told(step: Simplification) -> None:
        violated = f"violated in {step.violations} of {counted(step.runs, 'run')}"
        say(f"{'kept' if step.kept else 'no  '}  {violated}: {step.what}")

    with Simulations(made, place, jobs=jobs) as simulations:
        found = Shrinking(
            requirement=wanted,
            simulations=simulations,
            measure=measuring.measure,
            judge=measuring.judge,
            seed=seed,
            repeats=repeats,
            confirmations=confirmations,
            keep=keep,
            watch=told,
        )(asked)
    for name, people, verdict in (
        ("original", found.original.people, found.before),
        ("smallest", found.smallest.people, found.after),
    ):
        tasks = sum(len(human.tasks) for human in people.humans)
        say(
            f"{name}: {counted(len(people.humans), 'human')}, {counted(tasks, 'task')}; "
            f"{wanted.name} violated in {verdict.violations} of {counted(verdict.runs, 'fresh run')}"
        )
    if json:
        print_json(found.model_dump(mode="json"))
    else:
        write_text(out, found.smallest.to_json())
