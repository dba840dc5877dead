"""Recordings of a real robot among people: `rvsg recording`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb
from rvsg.cli.options import AsJson

app = verb(no_args_is_help=True, help="Make scenarios and suites of recordings of a real robot.")

File = Annotated[Path, typer.Argument(help="A rosbag2, or tracks as .csv, .parquet, .json, .txt or .ndjson.")]
World = Annotated[str | None, typer.Option(help="The world of the recording: a shipped world or a world folder.")]
PeopleTopic = Annotated[str | None, typer.Option(help="The topic with the people, or the laser scans to find them in.")]
PeopleFrames = Annotated[str | None, typer.Option(metavar="PATTERN", help="Transform frames of people: 'person_*'.")]
RobotTopic = Annotated[str | None, typer.Option(help="The odometry topic.")]


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
    from rvsg.core.errors import FileError
    from rvsg.recording.tracks import clean, load_recording
    from rvsg.scenario.world_lookup import as_world

    place = as_world(world) if world is not None else None
    topics = {"people_topic": people_topic, "robot_topic": robot_topic, "people_frames": people_frames}
    found = load_recording(file, world=place, **topics)
    shown: dict[str, Any] = {
        "robot": {"poses": len(found.robot), "begin_s": round(found.begin_s, 2), "end_s": round(found.end_s, 2)},
        "people": [_person(person) for person in found.people],
        "streams": [stream.model_dump(mode="json") for stream in found.streams],
    }
    notes, usable = list(found.notes), ""
    try:
        mended = clean(found)
        notes = list(mended.notes)
        shown["usable"] = [_person(person) for person in mended.people]
    except FileError as error:
        usable = str(error)
    shown["notes"] = [note.model_dump(mode="json") for note in notes]
    if json:
        print_json(shown)
        return
    for stream in found.streams:
        rate = f", {stream.rate_hz:g} Hz" if stream.rate_hz else ""
        read = f" ({stream.used_for})" if stream.used_for else ""
        say(f"{stream.name}  {stream.kind}  {stream.messages} messages{rate}{read}")
    say(f"robot: {len(found.robot)} poses; the drive is from {found.begin_s:.1f} to {found.end_s:.1f} s")
    for person in shown["people"]:
        say("{name}: {begin_s:.1f} to {end_s:.1f} s, {samples} places at {rate_hz:g} Hz, {gaps} gaps".format(**person))
    if usable:
        say(usable)
    else:
        said = ", ".join(f"{each['name']} {each['begin_s']:.1f} to {each['end_s']:.1f} s" for each in shown["usable"])
        say(f"After cleaning, seconds of the drive: {said}.")
    for note in notes:
        say(f"- {note}")


def _person(person: Any) -> dict[str, Any]:
    from rvsg.recording.tracks import gaps_of

    seconds = person.end_s - person.begin_s
    return {
        "name": person.name,
        "begin_s": round(person.begin_s, 2),
        "end_s": round(person.end_s, 2),
        "samples": len(person.rows),
        "rate_hz": round((len(person.rows) - 1) / seconds, 1) if seconds > 0 else 0.0,
        "gaps": len(gaps_of(person.rows[:, 0])),
        "standard_error_m": round(person.spread_m, 3) or None,
    }
