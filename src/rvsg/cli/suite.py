"""Suites and comparisons: `rvsg suite`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from rvsg.app.settings import effective, option_of
from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb
from rvsg.cli.options import FOUND, RERUN, AsJson, Jobs, Junit, OtherWorld, setting_options
from rvsg.core.errors import InputError

app = verb(no_args_is_help=True)

Folder = Annotated[Path, typer.Argument(help="The folder of the suite.")]


@app.command()
@setting_options(*RERUN, as_found=True)
def add(
    settings: dict[str, Any],
    scenario: Annotated[
        Path,
        typer.Argument(
            help="A scenario, proposal or attempt as JSON, e.g. runs/first/best_scenario.json; or the folder of a "
            "campaign: all its confirmed failures."
        ),
    ],
    suite: Annotated[Path, typer.Option(help="The folder of the suite; created if missing.")],
    requirement: Annotated[
        str | None, typer.Option(help=f"A shipped requirement, or FILE.yaml#NAME. [{FOUND}, else R1]")
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name of the case, and of its file.")] = None,
    title: Annotated[str | None, typer.Option(help="Title of the case.")] = None,
    expect: Annotated[str | None, typer.Option(help="`violation` for a known failure, or `pass`. [violation]")] = None,
    reason: Annotated[str | None, typer.Option(help="Why the failure is known.")] = None,
    world: OtherWorld = None,
) -> None:
    """Add a scenario to a suite, or one more requirement to a case that holds the same scenario.

    The case keeps the requirement, the robot, the simulator and the stack by content. They are those of the options;
    without them those that the scenario's file names, as best_scenario.json of a campaign does.
    """
    from rvsg import Campaign, Suite
    from rvsg.app.saved_scenario import rerun
    from rvsg.app.suites import add_failures
    from rvsg.evaluation.verdict import counted

    if scenario.is_dir():
        own = {
            "requirement": requirement,
            "name": name,
            "title": title,
            "expect": expect,
            "reason": reason,
            "world": world,
        }
        named = [f"--{key}" for key, value in own.items() if value is not None] + [option_of(key) for key in settings]
        if named:
            raise InputError(
                f"{scenario}: failures of a campaign are kept as they were found. Leave {', '.join(named)} out, or add "
                "one scenario at a time.",
                code="campaign-as-found",
            )
        campaign = Campaign.open(scenario)
        if not (failures := campaign.answer.failures):
            raise InputError(
                f"{scenario}: no failure is confirmed in it, so there is nothing to keep.", code="no-failure"
            )
        grown = add_failures(Suite.create(suite), campaign, failures)
    else:
        source: dict[str, Any] = {"source": scenario, "requirement": requirement, "world": world}
        if settings:
            again = rerun(scenario, settings, world=world, on_message=say)
            source = {"source": again.scenario, "world": again.world, "found": again.found}
            source["requirement"] = requirement or again.requirement
        grown = Suite.create(suite).add(**source, name=name, title=title, expected=expect or "violation", reason=reason)
    say(f"{suite} holds {counted(len(grown.cases), 'case')}. Run it with: rvsg suite run {suite}")


@app.command()
@setting_options("simulator", "simulator_options", "stack", "stack_options", as_found=True)
def run(
    settings: dict[str, Any],
    suite: Folder,
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
    """Run a suite, each case with the simulator and stack it was found with unless you choose others.

    The exit code is 1 where a case that should pass violates its requirement, 2 where no run is judged.

    Each case stops as soon as its verdict is certain. A known failure does not fail the build. A fixed one is reported,
    and `rvsg suite update` writes it into the suite.
    """
    from rvsg import Suite
    from rvsg.core.files import check_writable, write_text
    from rvsg.report.junit import suite_junit
    from rvsg.report.terminal import describe_case

    if junit is not None:
        check_writable(junit)
    chosen = effective(None, {}, settings)
    named = "simulator" in settings or "simulator_options" in settings
    result = Suite.open(suite).run(
        simulator=chosen.simulator_spec if named else None,
        stack=chosen.stack_spec(),
        version=version,
        jobs=jobs,
        runs=runs,
        only=only or (),
        robot=robot,
        pictures=pictures,
        on_result=lambda case: say(describe_case(case)),
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
    from rvsg.suites.suite_folder import read_results

    changed = Suite.open(suite).update(read_results(results))
    for case in changed:
        say(f"{case.case}, {case.requirement}: {case.state.value}; the suite expects this from now on.")
    if not changed:
        say(f"{suite} stays as it is: no case of {results} is fixed or broken.")


@app.command("compare")
def compare_versions(
    first: Annotated[str, typer.Argument(help="Results of `rvsg suite run --json`, or a version: see --suite.")],
    second: Annotated[str, typer.Argument(help="The same, for the version after.")],
    suite: Annotated[
        Path | None,
        typer.Option(
            help="Run this suite now, with versions SIMULATOR[:OPTION=VALUE,...]: robot=FILE, stack=NAME or FILE, "
            "and the options of the simulator. What is left open is as each case was found."
        ),
    ] = None,
    runs: Annotated[int, typer.Option(min=1, help="Runs of every case and version, on the same seeds.")] = 20,
    jobs: Jobs = 1,
    error_rate: Annotated[
        float, typer.Option(min=0.0001, max=0.5, help="Probability of one false alarm in the whole comparison.")
    ] = 0.05,
    markdown: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a table for a pull request.")] = None,
    html: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write a page; with --suite it replays both on one clock."),
    ] = None,
    json: AsJson = False,
) -> None:
    """Compare two versions on the same scenarios and seeds: fixed, broken, unchanged, unclear.

    A change counts where the exact McNemar test over the paired runs, corrected by Holm over all cases, is below
    --error-rate. The exit code is 1 where a case is broken.
    """
    from rvsg.app.comparison import compare_versions as compare
    from rvsg.core.files import check_writable, write_text
    from rvsg.report.comparison_page import changes_markdown

    for file in (markdown, html):
        if file is not None:
            check_writable(file)
    comparison = compare(first, second, suite=suite, runs=runs, jobs=jobs, error_rate=error_rate, on_message=say)
    if markdown is not None:
        write_text(markdown, changes_markdown(comparison.found))
    if html is not None:
        write_text(html, comparison.page())
    if json:
        print_json(comparison.found.model_dump(mode="json"))
    else:
        say(changes_markdown(comparison.found))
    if comparison.found.broken:
        raise typer.Exit(1)


@app.command()
@setting_options("simulator", "simulator_options")
def coverage(
    settings: dict[str, Any],
    sources: Annotated[list[Path], typer.Argument(help="Folders of suites and campaigns.")],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a page (.html), a map (.png) or .json.")
    ] = None,
    runs: Annotated[
        int, typer.Option(min=0, help="Runs of each scenario of a suite, to detect encounters; campaigns store theirs.")
    ] = 1,
    jobs: Jobs = 1,
    json: AsJson = False,
) -> None:
    """Show which places, routes, encounters, behaviours and requirements are exercised, and which are not.

    Places, behaviours and requirements come from the scenarios. Encounters come from the runs: a person within 1.5 m of
    the robot, and the side the person comes from.
    """
    from rvsg.app.coverage import coverage as measure
    from rvsg.report.overview import check_coverage_file, write_coverage

    if out is not None:
        check_coverage_file(out)
    chosen = effective(None, {}, settings).simulator_spec
    covered = measure(*sources, runs=runs, jobs=jobs, simulator=chosen, on_message=say)
    if out is not None:
        write_coverage(out, covered)
    if json:
        print_json([entry.coverage.model_dump(mode="json") for entry in covered])
        return
    for entry in covered:
        say(entry.text)
