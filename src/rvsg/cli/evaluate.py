"""`rvsg evaluate`: measure runs and judge them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb

app = verb()


@app.command()
def evaluate(
    runs: Annotated[
        list[Path],
        typer.Argument(help="Files of runs, as `rvsg simulate` writes them (- is stdin), or recordings (rosbag2)."),
    ],
    requirement: Annotated[str, typer.Option(help="A shipped requirement, or FILE.yaml#NAME.")] = "R1",
    scenario: Annotated[
        Path | None, typer.Option(help="The scenario of the runs; metrics of obstacles and --feedback need it.")
    ] = None,
    world: Annotated[str | None, typer.Option(help="The world of the runs, where the scenario is not given.")] = None,
    route: Annotated[str | None, typer.Option(help="The route of the world that a recorded robot drove.")] = None,
    people_topic: Annotated[str | None, typer.Option(help="The topic with the people of a recording.")] = None,
    robot_topic: Annotated[str | None, typer.Option(help="The odometry topic of a recording.")] = None,
    feedback: Annotated[
        Path | None, typer.Option(help="Write what a generator learns from the runs, for `rvsg propose --feedback`.")
    ] = None,
    fail_on_violation: Annotated[
        bool, typer.Option("--fail-on-violation", help="Exit code 1 if the requirement is violated.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")] = False,
) -> None:
    """Measure runs of one scenario by every metric, and judge them by a requirement.

    A recording of your robot is judged like a simulated run: a rosbag2 folder, an .mcap or a .db3 file. What it lacks
    is printed, and stands in `notes` of --json.
    """
    import rvsg
    from rvsg.api import evaluating
    from rvsg.api.exchange import load_any
    from rvsg.api.records import write_text
    from rvsg.api.scenarios import load_scenario_in
    from rvsg.api.words import describe_judgement

    if feedback is not None:
        evaluating.check_feedback_file(feedback, scenario)
    asked = rvsg.load_requirement(requirement)
    loaded = load_any(runs, world=world, route=route, people_topic=people_topic, robot_topic=robot_topic)
    for note in loaded.notes:
        say(note)
    known, place = load_scenario_in(scenario, world) if scenario is not None else (None, world)
    judged = rvsg.judge(loaded.runs, asked, scenario=known, world=place)
    if feedback is not None and known is not None:
        write_text(feedback, evaluating.feedback(judged, loaded.runs, known).to_json())
    if json:
        print_json(judged.to_dict() | {"notes": list(loaded.notes)})
    for line in describe_judgement(judged):
        say(line)
    if fail_on_violation and judged.violated:
        raise typer.Exit(1)
