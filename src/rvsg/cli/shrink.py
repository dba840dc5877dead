"""`rvsg shrink`: find the smallest scenario that violates a requirement about as often."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rvsg.cli.arguments import Jobs, OtherWorld, Requirement, Simulator, SimulatorOption
from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb

if TYPE_CHECKING:
    from rvsg.campaign.smallest_scenario import Shrunk, Simplification

app = verb()


@app.command()
def shrink(
    scenario: Annotated[Path, typer.Argument(help="A scenario or a proposal as JSON; - is standard input.")],
    requirement: Requirement = "R1",
    repeats: Annotated[int, typer.Option(min=1, help="Runs of every simpler scenario.")] = 12,
    confirmations: Annotated[int, typer.Option(min=1, help="Confirmation runs of the original and the smallest.")] = 20,
    keep: Annotated[float, typer.Option(min=0.01, max=1.0, help="Share of the violations that must stay.")] = 0.8,
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything random.")] = 0,
    world: OtherWorld = None,
    simulator: Simulator = "embedded",
    simulator_option: SimulatorOption = None,
    jobs: Jobs = 1,
    out: Annotated[Path, typer.Option(help="Write the smallest scenario here; - is standard output.")] = Path("-"),
    json: Annotated[bool, typer.Option("--json", help="Print every step as JSON on standard output.")] = False,
) -> None:
    """Find the smallest scenario that violates a requirement about as often.

    RVSG removes people, tasks, pauses and delays one by one as long as the violations stay. What is left explains the
    violation. Confirmation runs with new seeds show how often the original and the smallest scenario violate it.
    """
    import rvsg
    from rvsg.cli.options import spec
    from rvsg.core.outputs import check_writable, write_text
    from rvsg.scenario.builder import load_scenario_in, scenario_json

    check_writable(out)
    asked, place = load_scenario_in(scenario, world)

    shrunk = rvsg.shrink(
        asked,
        requirement,
        repeats=repeats,
        confirmations=confirmations,
        keep=keep,
        seed=seed,
        jobs=jobs,
        simulator=spec("simulator", simulator, simulator_option),
        world=place,
        on_step=_show_step,
        on_message=say,
    )
    _show(shrunk)
    if json:
        print_json(shrunk.model_dump(mode="json"))
    else:
        write_text(out, scenario_json(shrunk.smallest))


def _show_step(step: Simplification) -> None:
    from rvsg.evaluation.wording import counted

    violated = f"violated in {step.violations} of {counted(step.runs, 'run')}"
    say(f"{'kept' if step.kept else 'no  '}  {violated}: {step.what}")


def _show(shrunk: Shrunk) -> None:
    """Print the size of the original and of the smallest scenario, and how often each violates."""
    from rvsg.evaluation.wording import counted

    for name, people, verdict in (
        ("original", shrunk.original.people, shrunk.before),
        ("smallest", shrunk.smallest.people, shrunk.after),
    ):
        tasks = sum(len(human.tasks) for human in people.humans)
        say(
            f"{name}: {counted(len(people.humans), 'human')}, {counted(tasks, 'task')}; {verdict.requirement} violated "
            f"in {verdict.violations} of {counted(verdict.runs, 'confirmation run')}"
        )
