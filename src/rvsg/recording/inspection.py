"""What a recording holds and lacks, what cleaning would mend, and whether it fits a world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rvsg.core.errors import FileError
from rvsg.recording.tracks import Note, PersonTrack, Recording, clean, gaps_of
from rvsg.world.space import human_space, robot_space
from rvsg.world.world import World

OUTSIDE, PEOPLE_OUTSIDE = 0.02, 0.1
"""A robot, or people, in obstacles or off the map for more than this share of their places were on another map."""


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
            "contacts": [{"person": each.person, "time_s": each.time_s} for each in found.contacts],
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
        said += [f"contact with {each.person} at {each.time_s:.1f} s" for each in found.contacts]
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
    """Return notes where the robot or the people were in obstacles of a world or off its map."""
    notes = []
    everybody = [each.rows[:, :3] for each in recording.people]
    for who, rows, space, most in (
        ("The robot is", recording.robot[:, :3], robot_space(world), OUTSIDE),
        ("People are", np.concatenate(everybody or [np.empty((0, 3))]), human_space(world), PEOPLE_OUTSIDE),
    ):
        wrong = np.flatnonzero(space.clearances(rows[:, 1:3]) <= 0.0)
        if len(wrong) <= most * len(rows):
            continue
        t, x, y = rows[wrong[0]]
        text = (
            f"{who} in obstacles of {world.name} or off its map for {len(wrong) / len(rows):.0%} of the recorded "
            f"places, first at ({x:.1f}, {y:.1f}) after {t:.1f} s. Name the world whose map the robot drove with: "
            "--world."
        )
        notes.append(Note(kind="world", text=text, count=len(wrong)))
    return tuple(notes)


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
