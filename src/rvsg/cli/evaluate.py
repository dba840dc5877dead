"""`rvsg evaluate`: measure runs and judge them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.arguments import AsJson, FailOnViolation, Requirement
from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb

app = verb()


@app.command()
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
