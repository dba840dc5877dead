"""Recordings of a real robot among people: `rvsg recording`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from rvsg.app.settings import effective
from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb
from rvsg.cli.options import AsJson, Jobs, Requirement, setting_options

app = verb(no_args_is_help=True, help="Make scenarios and suites of recordings of a real robot.")

File = Annotated[Path, typer.Argument(help="A rosbag2, or tracks as .csv, .parquet, .json, .txt or .ndjson.")]
World = Annotated[str | None, typer.Option(help="The world of the recording: a shipped world or a world folder.")]
PeopleTopic = Annotated[
    str | None, typer.Option(help="The topic with the people; one of laser scans finds them in all.")
]
PeopleFrames = Annotated[
    str | None, typer.Option(metavar="PATTERN", hidden=True, help="Transform frames of people: 'person_*'.")
]
Robot = Annotated[str | None, typer.Option(help="A shipped robot (`rvsg robots`) or a robot file.")]
People = Annotated[
    str, typer.Option(help="as-recorded, intent, or blended: recorded until the robot differs, then with intent.")
]
RobotTopic = Annotated[str | None, typer.Option(hidden=True, help="The odometry topic.")]
OpenFloor = Annotated[bool, typer.Option("--open-floor", help="Without a map: no obstacle was near.")]


@app.command()
def inspect(
    file: File,
    world: World = None,
    people_topic: PeopleTopic = None,
    people_frames: PeopleFrames = None,
    robot_topic: RobotTopic = None,
    json: AsJson = False,
) -> None:
    """List what a recording holds: topics, rates, people, gaps, what is missing, and what cleaning would mend."""
    from rvsg.recording import inspection
    from rvsg.recording.tracks import load_recording
    from rvsg.scenario.world_lookup import as_world

    place = as_world(world) if world is not None else None
    topics = {"people_topic": people_topic, "robot_topic": robot_topic, "people_frames": people_frames}
    inspected = inspection.inspect(load_recording(file, world=place, **topics), place)
    if json:
        print_json(inspected.to_dict())
        return
    for line in (*inspected.lines, *(f"- {note}" for note in inspected.notes)):
        say(line)


@app.command()
@setting_options("simulator", "simulator_options", "stack", "stack_options")
def scenario(
    settings: dict[str, Any],
    file: File,
    world: World = None,
    route: Annotated[str | None, typer.Option(help="The route that the robot drove. [its poses and its goal]")] = None,
    robot: Robot = None,
    people: People = "blended",
    limit: Annotated[
        float, typer.Option(min=0.05, hidden=True, help="How far the robot may differ for blended people, m.")
    ] = 0.5,
    requirement: Requirement = "R1",
    runs: Annotated[int, typer.Option(min=1, hidden=True, help="Runs that are compared with the recording.")] = 5,
    people_topic: PeopleTopic = None,
    people_frames: PeopleFrames = None,
    robot_topic: RobotTopic = None,
    open_floor: OpenFloor = False,
    jobs: Jobs = 1,
    out: Annotated[Path, typer.Option(metavar="FILE", help="Write the scenario here.")] = Path("scenario.json"),
    html: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a page with both drives.")] = None,
    json: AsJson = False,
) -> None:
    """Make a scenario of a recording, run it, and say whether it repeats what happened.

    Without --world, the map of the recording becomes a world beside the scenario. Names of people are left out. The
    scenario is one like any other: simulate it, shrink it, explore ranges around it, keep it in a suite.
    """
    from rvsg.app.reconstruction import rebuild, world_of_recording
    from rvsg.core.files import check_writable, write_text
    from rvsg.recording.tracks import load_recording
    from rvsg.scenario.builder import scenario_json
    from rvsg.scenario.world_lookup import as_world

    for path in (out, html):
        if path is not None:
            check_writable(path)
    chosen = effective(None, {}, settings)
    place = as_world(world) if world is not None else None
    topics = {"people_topic": people_topic, "robot_topic": robot_topic, "people_frames": people_frames}
    recording = load_recording(file, world=place, **topics)
    folder = out.with_suffix("").with_name(f"{out.stem}-world")
    place = world_of_recording(recording, place, folder, open_floor=open_floor)
    rebuilt = rebuild(
        recording,
        place,
        requirement,
        runs=runs,
        route=route,
        jobs=jobs,
        simulator=chosen.simulator_spec,
        stack=chosen.stack_spec(),
        on_message=say,
        people=people,
        limit_m=limit,
        robot=robot,
    )
    write_text(out, scenario_json(rebuilt.made.scenario, rebuilt.found))
    if html is not None:
        write_text(html, rebuilt.page())
    if json:
        print_json(rebuilt.to_dict())
    for line in (*rebuilt.lines, rebuilt.verdict):
        say(line)
    made_world = f"; world: {folder}" if world is None else ""
    say(f"Scenario: {out}{made_world}" + (f"; page: {html}" if html is not None else ""))


@app.command()
@setting_options("simulator", "simulator_options", "stack", "stack_options")
def suite(
    settings: dict[str, Any],
    folder: Annotated[Path, typer.Argument(help="A folder of recordings.")],
    suite: Annotated[Path, typer.Option(help="The folder of the suite; created if missing.")],
    world: Annotated[
        str | None, typer.Option(help="The world of the recordings. [of each its map, as a world in the suite]")
    ] = None,
    route: Annotated[str | None, typer.Option(help="The route that the robot drove. [its poses and its goal]")] = None,
    robot: Robot = None,
    people: People = "blended",
    requirement: Requirement = "R1",
    runs: Annotated[int, typer.Option(min=1, help="Runs that are compared with each recording.")] = 5,
    open_floor: OpenFloor = False,
    jobs: Jobs = 1,
) -> None:
    """Keep the encounters of a folder of recordings as cases of a suite; the rare kinds and the nearest come first.

    Drives of more than a minute are cut into their encounters. A case is expected to do what most of today's runs do.
    """
    from rvsg.app.reconstruction import recorded_cases, suite_of_recordings
    from rvsg.core.errors import FileError
    from rvsg.evaluation.verdict import counted
    from rvsg.scenario.world_lookup import as_world

    chosen, place = effective(None, {}, settings), as_world(world) if world is not None else None
    options: dict[str, Any] = {"people": people, "robot": robot, "route": route, "runs": runs, "jobs": jobs}
    options |= {"worlds": suite / "worlds", "open_floor": open_floor}
    options |= {"simulator": chosen.simulator_spec, "stack": chosen.stack_spec(), "on_message": say}
    cases = recorded_cases(folder, place, requirement, on_case=say, **options)
    for case in cases:
        verdict = "" if case.rebuilt is None else case.rebuilt.verdict
        say(f"- {case.title}. {verdict or case.problem}" if verdict else f"- {case.source}: {case.problem}")
    if not any(case.rebuilt for case in cases):
        raise FileError(folder, "no recording became a case. The lines above say why, and what to do.")
    added = suite_of_recordings(cases, suite, requirement)
    say(f"{suite} holds {counted(len(added.cases), 'case')}. Run it with: rvsg suite run {suite}")
