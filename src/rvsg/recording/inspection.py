"""What a recording holds and lacks, what cleaning would mend, and whether it fits a world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rvsg.core.errors import FileError
from rvsg.recording.tracks import Floats, Note, PersonTrack, Recording, clean, gaps_of
from rvsg.world.space import frame_of, human_space, robot_space, world_map
from rvsg.world.world import OCCUPIED, OccupancyMap, World

OUTSIDE, PEOPLE_OUTSIDE = 0.02, 0.1
"""A robot, or people, in obstacles or off the map for more than this share of their places were on another map."""
LISTED = 30
"""People beyond these are counted."""
ALONG_M, BESIDE_M, SAME_MAP = 5.0, 0.3, 0.7
"""Of the obstacles this near to the drive on the map of a recording, this share is this near to one of the same map.

Of shipped worlds it is below 0.4 with another one, and 0.4 to 0.65 with the same one 0.6 m aside.
"""


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """A recording, its cleaned people, and notes on both; `problem` says why it makes no scenario."""

    recording: Recording
    usable: tuple[PersonTrack, ...]
    notes: tuple[Note, ...]
    problem: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain data."""
        recording = self.recording
        begin_s, end_s = round(recording.begin_s, 2), round(recording.end_s, 2)
        return {
            "robot": {"poses": len(recording.robot), "begin_s": begin_s, "end_s": end_s},
            "people": [_person(person) for person in recording.people],
            "contacts": [{"person": contact.person, "time_s": contact.time_s} for contact in recording.contacts],
            "streams": [stream.model_dump(mode="json") for stream in recording.streams],
            "notes": [note.model_dump(mode="json") for note in self.notes],
        } | ({} if self.problem else {"usable": [_person(person) for person in self.usable]})

    @property
    def lines(self) -> list[str]:
        """What was found, a line each; the notes are apart."""
        recording, said = self.recording, []
        for stream in recording.streams:
            rate = f", {stream.rate_hz:g} Hz" if stream.rate_hz else ""
            read = f" ({stream.used_for})" if stream.used_for else ""
            said.append(f"{stream.name}  {stream.kind}  {stream.messages} messages{rate}{read}")
        poses, begin, end = len(recording.robot), recording.begin_s, recording.end_s
        said.append(f"robot: {poses} poses; the drive is from {begin:.1f} to {end:.1f} s")
        form = "{name}: {begin_s:.1f} to {end_s:.1f} s, {samples} places at {rate_hz:g} Hz, {gaps} gaps"
        said += [form.format(**_person(person)) for person in recording.people[:LISTED]]
        if (more := len(recording.people) - LISTED) > 0:
            said.append(f"{more} more people, whom --json lists")
        said += [f"contact with {contact.person} at {contact.time_s:.1f} s" for contact in recording.contacts]
        seen = ", ".join(f"{track.name} {track.begin_s:.1f} to {track.end_s:.1f} s" for track in self.usable[:LISTED])
        seen += f", and {more} more" if (more := len(self.usable) - LISTED) > 0 else ""
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
        notes = (*notes, *misfits(recording, world))
    return Inspection(recording=recording, usable=usable, notes=notes, problem=problem)


def misfits(recording: Recording, world: World) -> tuple[Note, ...]:
    """Return notes where the robot or people were in obstacles of a world or off its map, or the maps differ."""
    notes = []
    everybody = [person.rows[:, :3] for person in recording.people]
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
    if (share := map_share(recording, world)) < SAME_MAP:
        text = (
            f"The recording's own map is not that of {world.name}: {share:.0%} of its obstacles within {ALONG_M:g} m "
            f"of the drive are within {BESIDE_M:g} m of one there. Name the world with this map and its origin with "
            "--world, or leave --world out to use the recording's map."
        )
        notes.append(Note(kind="map", text=text))
    return tuple(notes)


def map_share(recording: Recording, world: World) -> float:
    """Return the share of obstacles along the drive on the map of a recording that a world's map has, too.

    Cells count by their places in metres, so the resolutions may differ; 1 where there is nothing to compare.
    """
    from scipy.spatial import KDTree

    if recording.occupancy is None or not len(recording.robot):
        return 1.0
    own, there = _obstacles(recording.occupancy) + world.map_offset, _obstacles(world_map(world))
    along = own[np.isfinite(KDTree(recording.robot[:, 1:3]).query(own, distance_upper_bound=ALONG_M)[0])]
    return float((KDTree(there).query(along)[0] <= BESIDE_M).mean()) if len(along) else 1.0


def _obstacles(occupancy: OccupancyMap) -> Floats:
    """Return the centres of the occupied cells, (N, 2)."""
    cells = np.argwhere(occupancy.cells == OCCUPIED)[:, ::-1].astype(np.float64) + 0.5
    return frame_of(occupancy).to_metres(cells)


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
