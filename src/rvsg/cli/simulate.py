"""The runs of a scenario: `rvsg simulate`, `evaluate`, `trace`, `replay` and `metrics`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli import console
from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb
from rvsg.cli.options import (
    AsJson,
    Doors,
    FailOnViolation,
    Jobs,
    OtherWorld,
    Requirement,
    Simulator,
    SimulatorOption,
    Stack,
    StackOption,
)

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
    from rvsg.simulation.archive import runs_text

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


evaluate_app = verb()


@evaluate_app.command()
def evaluate(
    runs: Annotated[
        list[Path],
        typer.Argument(help="Files of runs, as `rvsg simulate` writes them (- is stdin), or recordings (rosbag2)."),
    ],
    requirement: Requirement = "R1",
    scenario: Annotated[
        Path | None, typer.Option(help="The scenario of the runs; obstacle metrics and --feedback need it.")
    ] = None,
    world: Annotated[str | None, typer.Option(help="The world of the runs, if you give no --scenario.")] = None,
    route: Annotated[str | None, typer.Option(help="The route that the recorded robot drove.")] = None,
    people_topic: Annotated[str | None, typer.Option(help="The topic with the people of a recording.")] = None,
    robot_topic: Annotated[str | None, typer.Option(help="The odometry topic of a recording.")] = None,
    feedback: Annotated[
        Path | None, typer.Option(help="Write the feedback for a generator, for `rvsg propose --feedback`.")
    ] = None,
    html: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a page with verdict, story, replay.")] = None,
    fail_on_violation: FailOnViolation = False,
    json: AsJson = False,
) -> None:
    """Measure runs of one scenario by every metric, and judge them by a requirement.

    A recording of your robot is judged like a simulated run: a rosbag2 folder, an .mcap or a .db3 file. RVSG prints
    what the recording lacks; with --json it is in `notes`.
    """
    import rvsg
    from rvsg.app import judgement
    from rvsg.app.judgement import describe_judgement
    from rvsg.app.runs import load_any
    from rvsg.core.outputs import write_text
    from rvsg.scenario.builder import load_scenario_in

    if feedback is not None:
        judgement.check_feedback_file(feedback, scenario)
    asked = rvsg.load_requirement(requirement)
    loaded = load_any(runs, world=world, route=route, people_topic=people_topic, robot_topic=robot_topic)
    for note in loaded.notes:
        say(note)
    known, place = load_scenario_in(scenario, world) if scenario is not None else (None, world)
    judged = rvsg.judge(loaded.runs, asked, scenario=known, world=place)
    if feedback is not None and known is not None:
        write_text(feedback, judgement.feedback(judged, loaded.runs, known).to_json())
    if html is not None:
        judgement.write_page(html, judged, loaded.runs, scenario=known, world=place, notes=loaded.notes)
        say(f"Page: {html}")
    if json:
        print_json(judged.to_dict() | {"notes": list(loaded.notes)})
    for line in describe_judgement(judged):
        say(line)
    if fail_on_violation and judged.violated:
        raise typer.Exit(1)


trace_app = verb()


@trace_app.command()
def trace(
    source: Annotated[Path, typer.Argument(help="The folder of a campaign, a file of runs, or a scenario.")],
    out: Annotated[
        list[Path] | None,
        typer.Option(help="The file to write, .mcap or .json; repeatable. [traces/RUN.trace.json in the folder]"),
    ] = None,
    run: Annotated[
        str | None, typer.Option(help="The id of a run. [the worst run of the worst finding; the first of a file]")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the run of a scenario.")] = 0,
    scenario: Annotated[Path | None, typer.Option(help="The scenario of a file of runs.")] = None,
    world: OtherWorld = None,
    simulator_option: SimulatorOption = None,
    stack: Stack = None,
    stack_option: StackOption = None,
) -> None:
    """Repeat a run and record everything: scans, costmaps, plans, candidate trajectories, behaviour tree.

    Runs are deterministic, so this is the stored run; a run that cannot be repeated is refused. The report shows a
    .json trace: in the folder of a campaign, RVSG writes the page again with it.
    """
    from rvsg.app.playback import check_trace_files, trace_source
    from rvsg.cli.options import spec, stack_spec
    from rvsg.report.replay_data import trace_file_beside

    check_trace_files(source, out or [])
    traced = trace_source(
        source,
        run=run,
        seed=seed,
        scenario=scenario,
        world=world,
        simulator=spec("simulator", "embedded", simulator_option),
        stack=stack_spec(stack, stack_option),
        on_message=say,
    )
    written = list(out or [trace_file_beside(source, traced.run.id)])
    for path in written:
        traced.write(path)
    say(f"Trace of {traced.run.id}, seed {traced.run.seed}: {', '.join(str(path) for path in written)}")
    if not out:
        import rvsg

        page = rvsg.Campaign.open(source).report(world=world)
        say(f"Report: {page}")


replay_app = verb()


@replay_app.command()
def replay(
    source: Annotated[Path, typer.Argument(help="The folder of a campaign, a file of runs, or a scenario.")],
    out: Annotated[Path, typer.Option(help="The file to write: .mp4, .webm, .gif, .webp or .png.")],
    run: Annotated[
        str | None, typer.Option(help="The id of a run. [the worst run of the worst finding; the first of a file]")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the run of a scenario.")] = 0,
    speed: Annotated[float, typer.Option(min=0.1, max=20, help="Simulated seconds per second of the film.")] = 2.0,
    width: Annotated[int, typer.Option(min=480, max=3840, help="Width of the film in pixels.")] = 960,
    world: OtherWorld = None,
    simulator: Simulator = "embedded",
    simulator_option: SimulatorOption = None,
) -> None:
    """Write a run as a film, or as a PNG strip of its decisive moments.

    A run of a campaign is shown with the judged quantity and its limit. MP4 and WebM need the extra `video`.
    """
    from rvsg.app.playback import shot_of
    from rvsg.cli.options import spec
    from rvsg.core.outputs import check_writable
    from rvsg.report.film import check_film, write_film

    check_film(out)
    check_writable(out)
    chosen = spec("simulator", simulator, simulator_option)
    shot = shot_of(source, run=run, seed=seed, world=world, simulator=chosen)
    write_film(out, shot, speed=speed, width_px=width)
    say(f"Replay of {shot.run.id}, seed {shot.run.seed}: {out}")


metrics_app = verb()


@metrics_app.command()
def metrics(
    name: Annotated[str | None, typer.Argument(help="A metric. [all]")] = None,
    run: Annotated[
        Path | None, typer.Option(help="Measure the runs of this file, which `rvsg simulate` wrote.")
    ] = None,
    json: AsJson = False,
) -> None:
    """List the metrics with formula, unit, direction and source, or measure a run by them."""
    from rvsg.evaluation.metrics import metric
    from rvsg.evaluation.metrics.registry import METRICS, measure

    chosen = list(METRICS.values()) if name is None else [metric(name)]
    if run is not None:
        from rvsg.simulation.archive import read_runs

        measured = [measure(read, [info.id for info in chosen]) for read in read_runs([run])]
        console.print_json(measured[0] if len(measured) == 1 else measured)
        return
    if json:
        keys = ("id", "title", "unit", "worse", "formula", "source", "series")
        console.print_json([{key: getattr(info, key) for key in keys} for info in chosen])
        return
    for info in chosen:
        worse = "" if info.worse == "neither" else f", worse {info.worse}"
        print(f"{info.id:26} {info.title} [{info.unit}{worse}]\n{'':26} {info.formula}\n{'':26} Source: {info.source}.")
