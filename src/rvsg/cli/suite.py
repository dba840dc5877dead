"""`rvsg suite`: keep scenarios and run them against every version."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.arguments import AsJson, Jobs, Junit, OtherWorld, Simulator, SimulatorOption, Stack, StackOption
from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb

app = verb()

Folder = Annotated[Path, typer.Argument(help="The folder of the suite.")]


@app.command()
def add(
    scenario: Annotated[
        Path, typer.Argument(help="A scenario, proposal or attempt as JSON, e.g. runs/first/best_scenario.json.")
    ],
    suite: Annotated[Path, typer.Option(help="The folder of the suite; created if missing.")],
    requirement: Annotated[str, typer.Option(help="A shipped requirement, or FILE.yaml#NAME beside the suite.")] = "R1",
    name: Annotated[str | None, typer.Option(help="Name of the case, and of its file.")] = None,
    title: Annotated[str | None, typer.Option(help="Title of the case.")] = None,
    expect: Annotated[str, typer.Option(help="`violation` for a known failure, or `pass`.")] = "violation",
    reason: Annotated[str, typer.Option(help="Why the failure is known.")] = "",
    world: OtherWorld = None,
) -> None:
    """Add a scenario to a suite, or one more requirement to a case that holds the same scenario."""
    from rvsg import Suite
    from rvsg.evaluation.wording import counted

    made = Suite.create(suite).add(
        scenario, requirement, name=name, title=title, expected=expect, reason=reason, world=world
    )
    say(f"{suite} holds {counted(len(made.cases), 'case')}. Run it with: rvsg suite run {suite}")


@app.command()
def run(
    suite: Folder,
    simulator: Simulator = "embedded",
    simulator_option: SimulatorOption = None,
    stack: Stack = None,
    stack_option: StackOption = None,
    version: Annotated[str, typer.Option(help="A label for the results, e.g. a commit.")] = "",
    only: Annotated[
        list[str] | None, typer.Option(metavar="CASE", help="Only this case; repeat it for several.")
    ] = None,
    robot: Annotated[
        str | None, typer.Option(help="Drive every case with this robot: a shipped one or a robot file.")
    ] = None,
    runs: Annotated[int | None, typer.Option(min=1, help="Runs of every case. [as few as decide each verdict]")] = None,
    jobs: Jobs = 1,
    junit: Junit = None,
    pictures: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Draw the worst run of each violating case; the JUnit file names the pictures."
        ),
    ] = None,
    json: AsJson = False,
) -> None:
    """Run a suite. The exit code is 1 where a case that should pass violates its requirement, 2 where no run is judged.

    Each case stops as soon as its verdict is certain. A known failure does not fail the build. A fixed one is reported,
    and `rvsg suite update` writes it into the suite.
    """
    from rvsg import Suite
    from rvsg.app.suites import describe_result
    from rvsg.cli.options import spec, stack_spec
    from rvsg.core.outputs import check_writable, write_text
    from rvsg.report.suites import suite_junit

    if junit is not None:
        check_writable(junit)
    chosen = spec("simulator", simulator, simulator_option)
    result = Suite.open(suite).run(
        simulator=chosen,
        stack=stack_spec(stack, stack_option),
        version=version,
        jobs=jobs,
        runs=runs,
        only=only or (),
        robot=robot,
        pictures=pictures,
        on_result=lambda case: say(describe_result(case)),
        on_message=say,
    )
    if junit is not None:
        write_text(junit, suite_junit(result))
    if json:
        print_json(result.model_dump(mode="json"))
    result.check_judged()
    if result.broken:
        raise typer.Exit(1)


@app.command()
def update(
    suite: Folder,
    results: Annotated[Path, typer.Argument(help="Results of `rvsg suite run --json`.")],
) -> None:
    """Write fixed and broken cases of a run into the suite as the new expectations. Unclear results change nothing."""
    from rvsg import Suite
    from rvsg.app.suites import read_results

    for case in Suite.open(suite).update(read_results(results)):
        say(f"{case.case}, {case.requirement}: {case.state.value}; the suite expects this from now on.")
