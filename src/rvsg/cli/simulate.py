"""The runs of a scenario: `rvsg simulate`, `evaluate` and `replay`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb
from rvsg.cli.options import RERUN, AsJson, FailOnViolation, Jobs, OtherWorld, Requirement, setting_options
from rvsg.core.errors import InputError

app = verb()


@app.command()
@setting_options("moved", "doors", *RERUN, as_found=True)
def simulate(
    settings: dict[str, Any],
    scenario: Annotated[Path, typer.Argument(help="A scenario or a proposal as JSON; - is standard input.")],
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the first run; each further run takes the next integer.")
    ] = 0,
    repeats: Annotated[int, typer.Option(min=1, help="Number of runs.")] = 1,
    world: OtherWorld = None,
    jobs: Jobs = 1,
    out: Annotated[
        Path | None, typer.Option(help="Write the runs here; - is standard output, the default without --bag.")
    ] = None,
    bag: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write a rosbag2 (MCAP) with all that the robot senses.")
    ] = None,
) -> None:
    """Simulate a scenario and write its runs, one JSON object per line.

    RVSG checks the scenario first: it simulates no unknown waypoint and no path through an obstacle. The exit code is 2
    if the navigation stack failed in a run, which then cannot be judged.
    """
    import rvsg
    from rvsg.app.playback import check_bag, write_bag_of
    from rvsg.app.saved_scenario import rerun
    from rvsg.core.files import check_writable, write_text
    from rvsg.simulation.archive import runs_text
    from rvsg.simulation.run import Outcome

    out = Path("-") if out is None and bag is None else out
    if out is not None:
        check_writable(out)
    check_bag(bag, repeats)
    again = rerun(scenario, settings, world=world, on_message=say)

    def report(run: rvsg.Run) -> None:
        fault = run.stack_fault
        say(
            f"seed {run.seed}: {run.outcome.value}, after {run.trajectory.t[-1]:.1f} s"
            + (f": {fault}" if fault else "")
            + "".join(f"\n  warning: {warning}" for warning in run.stack_warnings)
        )

    runs = rvsg.simulate(
        again.scenario,
        range(seed, seed + repeats),
        jobs=jobs,
        simulator=again.simulator,
        world=again.world,
        on_run=report,
        on_message=say,
    )
    if out is not None:
        write_text(out, runs_text(runs))
    if bag is not None:
        write_bag_of(runs, bag, again)
    if any(run.outcome is Outcome.STACK_FAILED for run in runs):
        raise typer.Exit(2)


evaluate_app = verb()


@evaluate_app.command()
def evaluate(
    runs: Annotated[
        list[Path] | None,
        typer.Argument(help="Files of runs, as `rvsg simulate` writes them (- is stdin), or recordings (rosbag2)."),
    ] = None,
    requirement: Requirement = "R1",
    scenario: Annotated[
        Path | None, typer.Option(help="The scenario of the runs; obstacle metrics and --feedback need it.")
    ] = None,
    world: Annotated[str | None, typer.Option(help="The world of the runs, if you give no --scenario.")] = None,
    route: Annotated[str | None, typer.Option(help="The route that the recorded robot drove.")] = None,
    people_topic: Annotated[str | None, typer.Option(help="The topic with the people of a recording.")] = None,
    robot_topic: Annotated[str | None, typer.Option(help="The odometry topic of a recording.")] = None,
    feedback: Annotated[
        Path | None, typer.Option(help="Write the feedback for a generator, for `rvsg scenario propose --feedback`.")
    ] = None,
    html: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a page with verdict, story, replay.")] = None,
    metric: Annotated[
        str | None, typer.Option(help="Only measure this metric, or `all`; without RUNS, list its formula and source.")
    ] = None,
    fail_on_violation: FailOnViolation = False,
    json: AsJson = False,
) -> None:
    """Measure runs of one scenario by every metric, and judge them by a requirement.

    A recording of your robot is judged like a simulated run: a rosbag2 folder, an .mcap or a .db3 file. RVSG prints
    what the recording lacks; with --json it is in `notes`.
    """
    if metric is not None:
        _measure(metric, runs or [], as_json=json)
        return
    if not runs:
        raise InputError("Give at least one file of runs, or --metric all for the list of the metrics.")
    import rvsg
    from rvsg.core.files import check_writable, write_text
    from rvsg.report.page import write_runs_page
    from rvsg.report.terminal import describe_judgement
    from rvsg.scenario.builder import load_scenario_in
    from rvsg.search.run_set import feedback as feedback_of
    from rvsg.search.run_set import load_any

    if feedback is not None:
        check_writable(feedback)
        if scenario is None:
            raise InputError("--feedback needs the scenario of the runs: add --scenario FILE.", code="no-scenario")
    asked = rvsg.load_requirement(requirement)
    loaded, notes = load_any(runs, world=world, route=route, people_topic=people_topic, robot_topic=robot_topic)
    for note in notes:
        say(note)
    wanted, place = load_scenario_in(scenario, world) if scenario is not None else (None, world)
    judged = rvsg.judge(loaded, asked, scenario=wanted, world=place)
    if feedback is not None and wanted is not None:
        write_text(feedback, feedback_of(judged, loaded, wanted).to_json())
    if html is not None:
        write_runs_page(html, judged, loaded, scenario=wanted, world=place, notes=notes)
        say(f"Page: {html}")
    if json:
        print_json(judged.to_dict() | {"notes": list(notes)})
    for line in describe_judgement(judged, loaded):
        say(line)
    if fail_on_violation and judged.violated:
        raise typer.Exit(1)


def _measure(name: str, files: list[Path], *, as_json: bool) -> None:
    """Print the values of one or all metrics in runs; without runs, what the metrics are."""
    from rvsg.evaluation.metrics import METRICS, measure, metric
    from rvsg.simulation.archive import read_runs

    chosen = list(METRICS.values()) if name == "all" else [metric(name)]
    if files:
        measured = [measure(run, [info.id for info in chosen]) for run in read_runs(files)]
        print_json(measured[0] if len(measured) == 1 else measured)
    elif as_json:
        keys = ("id", "title", "unit", "worse", "formula", "source", "series")
        print_json([{key: getattr(info, key) for key in keys} for info in chosen])
    else:
        for info in chosen:
            worse = "" if info.worse == "neither" else f", worse {info.worse}"
            print(f"{info.id:26} {info.title} [{info.unit}{worse}]")
            print(f"{'':26} {info.formula}\n{'':26} Source: {info.source}.")


replay_app = verb()


@replay_app.command()
@setting_options(*RERUN, as_found=True)
def replay(
    settings: dict[str, Any],
    source: Annotated[Path, typer.Argument(help="The folder of a campaign, a file of runs, or a scenario.")],
    out: Annotated[
        list[Path] | None,
        typer.Option(
            help="The file to write: .webp or .png. With --trace: .mcap or .json, repeatable. "
            "[--trace: traces/RUN.trace.json in the folder]"
        ),
    ] = None,
    trace: Annotated[
        bool, typer.Option("--trace", help="Repeat the run and record scans, costmaps, plans, trajectories, decisions.")
    ] = False,
    run: Annotated[
        str | None, typer.Option(help="The id of a run. [the worst run of the worst finding; the first of a file]")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the run of a scenario.")] = 0,
    scenario: Annotated[Path | None, typer.Option(help="With --trace: the scenario of a file of runs.")] = None,
    speed: Annotated[float, typer.Option(min=0.1, max=20, help="Simulated seconds per second of the film.")] = 2.0,
    width: Annotated[int, typer.Option(min=480, max=3840, help="Width of the film in pixels.")] = 960,
    world: OtherWorld = None,
) -> None:
    """Write a run as a film, as a PNG strip of its decisive moments, or as a trace of everything.

    A run of a campaign is shown with the judged quantity and its limit.

    A trace repeats the stored run exactly; a run that cannot be repeated is refused. The report shows a .json trace: in
    the folder of a campaign, RVSG writes the page again with it.
    """
    from rvsg.app.playback import shot_of
    from rvsg.core.files import check_writable
    from rvsg.report.film import check_film, write_film

    if trace:
        _trace(source, out or [], settings, run=run, seed=seed, scenario=scenario, world=world)
        return
    if out is None or len(out) != 1:
        raise InputError("Give one --out FILE for a film or a strip of pictures, or --trace.")
    check_film(out[0])
    check_writable(out[0])
    shot = shot_of(source, run=run, seed=seed, world=world, given=settings, on_message=say)
    write_film(out[0], shot, speed=speed, width_px=width)
    say(f"Replay of {shot.run.id}, seed {shot.run.seed}: {out[0]}")


def _trace(
    source: Path,
    out: list[Path],
    settings: dict[str, Any],
    *,
    run: str | None,
    seed: int,
    scenario: Path | None,
    world: str | None,
) -> None:
    """Write the trace of a run; where no file is named, into the folder of its campaign and that campaign's page."""
    import rvsg
    from rvsg.app.playback import check_trace_files, trace_source
    from rvsg.report.replay_data import trace_file_beside

    check_trace_files(source, out)
    traced = trace_source(
        source,
        run=run,
        seed=seed,
        scenario=scenario,
        world=world,
        given=settings,
        on_message=say,
    )
    written = out or [trace_file_beside(source, traced.run.id)]
    for path in written:
        traced.write(path)
    say(f"Trace of {traced.run.id}, seed {traced.run.seed}: {', '.join(str(path) for path in written)}")
    if not out:
        page = rvsg.Campaign.open(source).report(world=world)
        say(f"Report: {page}")
