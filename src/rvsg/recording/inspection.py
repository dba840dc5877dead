"""What a recording holds and lacks, what cleaning would mend, and whether it fits a world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rvsg.core.errors import FileError
from rvsg.recording.tracks import Note, PersonTrack, Recording, clean, gaps_of
from rvsg.world.space import robot_space
from rvsg.world.world import World

OUTSIDE = 0.02
"""A robot that is in obstacles or off the map for more than this share of its poses drove with another map."""


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """A recording, its cleaned people, and notes on both; `problem` says why it makes no scenario."""

    recording: Recording
    usable: tuple[PersonTrack, ...]
    notes: tuple[Note, ...]
    problem: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain data."""
        found = self.recording
        return {
            "robot": {"poses": len(found.robot), "begin_s": round(found.begin_s, 2), "end_s": round(found.end_s, 2)},
            "people": [_person(person) for person in found.people],
            "streams": [stream.model_dump(mode="json") for stream in found.streams],
            "notes": [note.model_dump(mode="json") for note in self.notes],
        } | ({} if self.problem else {"usable": [_person(person) for person in self.usable]})

    @property
    def lines(self) -> list[str]:
        """What was found, a line each; the notes are apart."""
        found, said = self.recording, []
        for stream in found.streams:
            rate = f", {stream.rate_hz:g} Hz" if stream.rate_hz else ""
            read = f" ({stream.used_for})" if stream.used_for else ""
            said.append(f"{stream.name}  {stream.kind}  {stream.messages} messages{rate}{read}")
        poses, begin, end = len(found.robot), found.begin_s, found.end_s
        said.append(f"robot: {poses} poses; the drive is from {begin:.1f} to {end:.1f} s")
        form = "{name}: {begin_s:.1f} to {end_s:.1f} s, {samples} places at {rate_hz:g} Hz, {gaps} gaps"
        said += [form.format(**_person(person)) for person in found.people]
        seen = ", ".join(f"{each.name} {each.begin_s:.1f} to {each.end_s:.1f} s" for each in self.usable)
        return [*said, self.problem or f"After cleaning, seconds of the drive: {seen}."]


def inspect(recording: Recording, world: World | None = None) -> Inspection:
    """Return what a recording holds; with a world, also whether the robot drove on its map."""
    usable: tuple[PersonTrack, ...] = ()
    notes, problem = recording.notes, ""
    try:
        mended = clean(recording)
        usable, notes = mended.people, mended.notes
    except FileError as error:
        problem = str(error)
    if world is not None:
        notes = (*notes, *outside(recording, world))
    return Inspection(recording=recording, usable=usable, notes=notes, problem=problem)


def outside(recording: Recording, world: World) -> tuple[Note, ...]:
    """Return a note where the robot was in obstacles of a world or off its map."""
    wrong = np.flatnonzero(robot_space(world).clearances(recording.robot[:, 1:3]) <= 0.0)
    if len(wrong) <= OUTSIDE * len(recording.robot):
        return ()
    t, x, y = recording.robot[wrong[0], :3]
    text = (
        f"The robot is in obstacles of {world.name} or off its map for {len(wrong) / len(recording.robot):.0%} of its "
        f"poses, first at ({x:.1f}, {y:.1f}) after {t:.1f} s. Name the world whose map it drove with: --world."
    )
    return (Note(kind="world", text=text, count=len(wrong)),)


def _person(person: PersonTrack) -> dict[str, Any]:
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
