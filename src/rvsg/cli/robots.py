"""Systems to test: `rvsg robots` and `rvsg stacks`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli import console
from rvsg.cli.frame import verb
from rvsg.cli.options import AsJson, Jobs

robots_app = verb()


@robots_app.command()
def robots(
    robot: Annotated[str | None, typer.Argument(help="A shipped robot or a robot file. [all shipped ones]")] = None,
    draw: Annotated[Path | None, typer.Option(metavar="DIR", help="Write a plan view of each as DIR/NAME.svg.")] = None,
    from_urdf: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Print a URDF file as a robot file, and what it lacks (extra `exchange`)."),
    ] = None,
    json: AsJson = False,
) -> None:
    """List robots with size, drive, limits and sensors; check a robot file, draw robots, or read a URDF file."""
    from rvsg.core.files import write_whole
    from rvsg.robots.robot import draw_robot, load_robot, shipped_robots

    if from_urdf is not None:
        _print_urdf(from_urdf)
        return

    chosen = list(shipped_robots().values()) if robot is None else [load_robot(robot)]
    if draw is not None:
        for record in chosen:
            write_whole(draw / f"{record.name}.svg", draw_robot(record))
            console.say(f"wrote {draw / record.name}.svg")
    if json:
        console.print_json([record.model_dump(mode="json") | {"id": record.id} for record in chosen])
        return
    for record in chosen:
        limits, lidars = (
            record.limits,
            ", ".join(f"{q.name} {q.rays} rays to {q.max_range_m:g} m" for q in record.lidars),
        )
        base = "" if limits.speed_m_s == record.driving_speed_m_s else f" (base: {limits.speed_m_s:g} m/s)"
        compared = "calibrated against published runs" if record.calibrated else "not calibrated"
        print(
            f"{record.name:20} {record.title}\n"
            f"{'':20} {record.length_m:.2f} x {record.width_m:.2f} m, {record.drive.kind}, "
            f"{record.driving_speed_m_s:g} m/s{base}, {limits.acceleration_m_s2:g} m/s2; {compared}\n"
            f"{'':20} lidars: {lidars}; safety zones: {len(record.safety_zones)}; bumper: "
            f"{'yes' if record.bumper else 'no'}" + (f"\n{'':20} Source: {record.source}" if record.source else "")
        )
        for doubt in record.doubts:
            console.say(f"warning: {doubt}")


def _print_urdf(path: Path) -> None:
    import yaml

    from rvsg.core.plugins import find_format

    values, missing = find_format("robot", "urdf")(path)
    print(yaml.safe_dump(values, sort_keys=False, default_flow_style=None, width=120), end="")
    for sentence in missing:
        print(f"# {sentence}")
        console.say(f"missing: {sentence}")


stacks_app = verb()


@stacks_app.command()
def stacks(
    source: Annotated[
        Path | None,
        typer.Argument(
            metavar="[SUITE|CAMPAIGN|FILE]",
            help="With --stack, the suite or the campaigns whose scenarios are driven. Of a nav2_params.yaml, say "
            "what is not supported.",
        ),
    ] = None,
    stack: Annotated[
        list[str] | None, typer.Option(help="A stack to compare, as for `rvsg run --stack`; repeat it for each.")
    ] = None,
    robot: Annotated[
        list[str] | None, typer.Option(help="Use this robot instead of that of the scenarios; repeatable.")
    ] = None,
    runs: Annotated[int, typer.Option(min=1, help="Seeds of every scenario.")] = 10,
    scenarios: Annotated[int, typer.Option(min=1, help="How many scenarios of campaigns, the worst first.")] = 10,
    jobs: Jobs = 1,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the comparison as a page, a figure, Markdown and JSON.")
    ] = None,
    write_clients: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Write the clients of exec: stacks, in Python and C++, and exit."),
    ] = None,
    verbose: Annotated[bool, typer.Option("--verbose", help="For a nav2_params.yaml, list every key.")] = False,
    json: AsJson = False,
) -> None:
    """List the navigation stacks, or compare several on the same scenarios and seeds.

    Without an argument, list the stacks with their options; --stack of `run`, `simulate` and `suite run` takes one.
    Name your own as module:Class, file.py:Class or exec:COMMAND; --write-clients writes examples.
    """
    from rvsg.simulation.stacks.external_process import write_clients_to
    from rvsg.simulation.stacks.stack_choice import listed_stacks

    if write_clients is not None:
        for path in write_clients_to(write_clients):
            console.say(f"wrote {path}")
        return
    if stack or (source is not None and source.is_dir()):
        _compare(source, stack or [], robot or [], runs, scenarios, jobs, out, as_json=json)
        return
    if source is not None:
        _print_params(source, verbose=verbose, as_json=json)
        return
    listed = listed_stacks()
    if json:
        console.print_json(listed)
        return
    for entry in listed:
        print(f"{entry['name']:14} {entry['title']} (version {entry['version']})")
        if options := entry["options"]:
            print(f"{'':14} options: {', '.join(f'{key}={value}' for key, value in options.items())}")


def _compare(
    source: Path | None,
    stacks: list[str],
    robots: list[str],
    runs: int,
    scenarios: int,
    jobs: int,
    out: Path | None,
    *,
    as_json: bool,
) -> None:
    """Compare stacks, print the ranking, and write the files."""
    from rvsg.app.comparison import compare_stacks, write_comparison
    from rvsg.report.comparison_page import ranking_markdown
    from rvsg.suites.suite import SuiteResult

    def scored(result: SuiteResult) -> None:
        console.say(f"{result.version}: {result.violated} of {result.judged} runs violate")

    compared = compare_stacks(
        source, stacks, robots=robots, runs=runs, scenarios=scenarios, jobs=jobs, on_result=scored,
        on_message=console.say,
    )  # fmt: skip
    if out is not None and source is not None:
        for path in write_comparison(compared, source, out):
            console.say(f"wrote {path}")
    if as_json:
        console.print_json(compared.model_dump(mode="json"))
    else:
        print(ranking_markdown(compared), end="")
    for variant in compared.variants:
        variant.check_judged()


def _print_params(path: Path, *, verbose: bool, as_json: bool) -> None:
    """Print what of a parameter file is not supported, and what every key does."""
    from rvsg.simulation.stacks.nav2_params import read_nav2_params
    from rvsg.simulation.stacks.stack_choice import StackChoice

    read, chosen = read_nav2_params(path), StackChoice.of(path)
    if as_json:
        keys = [asdict(entry) for entry in read.entries]
        console.print_json({"stack": chosen.record.model_dump(mode="json"), "counts": read.counts(), "keys": keys})
        return
    for message in chosen.messages:
        print(message)
    for entry in read.entries if verbose else ():
        note = f"  ({entry.note})" if entry.note else ""
        print(f"{entry.state:14} line {entry.line}: {entry.key} = {entry.value}{note}")
