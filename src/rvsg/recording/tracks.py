"""A recording: the tracks of a robot and of people on one clock, and notes on what was found, missing and mended.

Readers (entry point `rvsg.recordings`) give a recording as it was measured. `clean` makes one pass over it: what it
changes is a note with a count, and nothing is left out without one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rvsg.core import plugins
from rvsg.core.errors import FileError
from rvsg.core.records import Record
from rvsg.evaluation.sampled import wrap
from rvsg.simulation.archive import RunHeader
from rvsg.simulation.events import Contact
from rvsg.simulation.run import Trajectory
from rvsg.world.world import OccupancyMap, World

Floats = NDArray[np.float64]

FASTEST_M_S = 4.0
"""No person moves faster: a step beyond it is a jump, or another person under the same name."""
STEP_M = 0.5
"""Steps up to this are never jumps: trackers are noisy."""
GAP_S = 0.5
"""Longer times without a sample are gaps."""
LONGEST_GAP_S = 4.0
"""A gap up to this is crossed in a straight line; after a longer one the person counts as another."""
LINK_S, LINK_M = 2.0, 0.7
"""A track that begins this soon after another has ended, and this near to where that one leads, goes on with it."""
OVERLAP_S = 0.3
"""Trackers keep a lost track for a moment after the new one has begun."""
LEAST_S = 1.0
"""People who are seen for less than this are left out."""
STARTS_M, STARTS_S = 0.15, 1.0
"""A robot that is this far (m, rad) from where it stands has driven for up to a second, or will for one."""
PERIOD_S = 0.2
"""Cleaned tracks have a place every so often."""
VISIBLE_M = 0.01
"""Smoothing that moves places by less, as a root mean square, is not worth a note."""


class Note(Record):
    """What was found, missing or mended in a recording."""

    kind: str
    """What it is about, such as `gap`, `jump` or `identity`. Programs decide by it, never by the text."""
    text: str
    count: int = 1
    person: str = ""

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, kw_only=True, eq=False)
class PersonTrack:
    """A person: rows of time s, x m, y m, yaw rad, speed m/s in the world frame, (N, 5); NaN for an unknown speed."""

    name: str
    rows: Floats
    radius_m: float | None = None
    group: int | None = None
    spread_m: float = 0.0
    """Standard error of the places: what the source tells, or, if that is more, what smoothing moves."""

    @property
    def begin_s(self) -> float:
        """When the person is seen first."""
        return float(self.rows[0, 0])

    @property
    def end_s(self) -> float:
        """When the person is seen last."""
        return float(self.rows[-1, 0])

    def at(self, times: Floats, slack_s: float = 1e-9) -> Floats:
        """Return the places at times, (N, 2); NaN where the person is not seen within `slack_s`."""
        t = self.rows[:, 0]
        inside = (times >= t[0] - slack_s) & (times <= t[-1] + slack_s)
        places = np.column_stack([np.interp(times, t, self.rows[:, k]) for k in (1, 2)])
        return np.where(inside[:, None], places, np.nan)


class Stream(Record):
    """A topic or a column of a recording, for `rvsg recording inspect`."""

    name: str
    kind: str
    messages: int
    rate_hz: float | None = None
    used_for: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """Tracks of a robot and of people, world frame, on one clock in seconds.

    `robot` (N, 7): time s, x m, y m, yaw rad, speed m/s, turning rad/s, speed to the left m/s; no rows where the robot
    was not recorded. `acceleration` (N, 2): time s, m/s². `commands` (N, 3): time s, speed m/s, turning rad/s.
    """

    source: str
    people: tuple[PersonTrack, ...]
    robot: Floats = field(default_factory=lambda: np.empty((0, 7)))
    odometry: bool = False
    """Whether the robot measured its speeds; else they are the change of its places."""
    acceleration: Floats = field(default_factory=lambda: np.empty((0, 2)))
    commands: Floats = field(default_factory=lambda: np.empty((0, 3)))
    spread_m: float = 0.0
    """Standard error of the robot's places, by what smoothing moves."""
    goal: tuple[float, float, float] | None = None
    goal_s: float | None = None
    """When the goal was given."""
    occupancy: OccupancyMap | None = None
    """The map of the recording, in its map frame."""
    streams: tuple[Stream, ...] = ()
    notes: tuple[Note, ...] = ()
    header: RunHeader | None = None
    """The run that RVSG wrote as this recording."""
    contacts: tuple[Contact, ...] = ()
    """Contacts that the recording holds; others show in the tracks alone."""
    log: Trajectory | None = None
    imu: Floats = field(default_factory=lambda: np.empty(0))

    @property
    def begin_s(self) -> float:
        """When the drive begins: with its goal, or when the robot moves. Without a robot: with the first person."""
        if not len(self.robot):
            return min((person.begin_s for person in self.people), default=0.0)
        t, first = self.robot[:, 0], float(self.robot[0, 0])
        moved = np.flatnonzero(np.hypot(*(self.robot[:, 1:3] - np.median(self.robot[:5, 1:3], axis=0)).T) > STARTS_M)
        starts = max(first, float(t[moved[0]]) - STARTS_S) if len(moved) else first
        if self.goal_s is not None and self.goal_s <= starts:
            return max(first, self.goal_s)
        return starts

    @property
    def end_s(self) -> float:
        """When the robot comes to rest, or without a robot, when the last person is seen."""
        if not len(self.robot):
            return max((person.end_s for person in self.people), default=0.0)
        rest = self.robot[-1]
        turned = np.abs(wrap(self.robot[:, 3] - rest[3]))
        away = np.flatnonzero((np.hypot(*(self.robot[:, 1:3] - rest[1:3]).T) > STARTS_M) | (turned > STARTS_M))
        return min(float(rest[0]), float(self.robot[away[-1], 0]) + STARTS_S) if len(away) else float(rest[0])


def load_recording(
    path: str | Path,
    *,
    world: World | None = None,
    people_topic: str | None = None,
    robot_topic: str | None = None,
    people_frames: str | None = None,
) -> Recording:
    """Load a recording as it was measured: a rosbag2, or tracks as CSV, Parquet, JSON, ETH/UCY or TrajNet++ text.

    Args:
        world: its map offset turns map coordinates into world coordinates; its map tells people from walls in scans.
        people_topic: the topic with the people of a bag, where there are several.
        robot_topic: the odometry topic of a bag, where there are several.
        people_frames: a pattern of transform frames that are people, such as `person_*`.

    Raises:
        FileError: the file is damaged, is none of these, or lacks what is needed.
    """
    read: Callable[..., Recording] = plugins.find_format("recording", "rosbag2", "bag")
    topics = {"people_topic": people_topic, "robot_topic": robot_topic, "people_frames": people_frames}
    return read(Path(path), world=world, **topics)


def between(recording: Recording, begin_s: float, end_s: float) -> Recording:
    """Return a part of a recording; its goal is where the robot is at the end, where the whole goes on."""
    t = recording.robot[:, 0]
    robot = recording.robot[(t >= begin_s) & (t <= end_s)]
    people = [
        replace(person, rows=person.rows[(person.rows[:, 0] >= begin_s) & (person.rows[:, 0] <= end_s)])
        for person in recording.people
    ]
    x, y, yaw = map(float, robot[-1, 1:4])
    return replace(
        recording,
        robot=robot,
        people=tuple(person for person in people if len(person.rows)),
        goal=recording.goal if t[-1] <= end_s else (x, y, yaw),
        goal_s=None,
        header=None,
    )


@dataclass
class Mending:
    """What one pass over the people of a recording changes."""

    notes: list[Note] = field(default_factory=list)

    def note(self, kind: str, count: int, text: str, person: str = "") -> None:
        """Add a note where something was changed; `{}` in the text stands for the count."""
        if count:
            self.notes.append(Note(kind=kind, text=text.format(count), count=count, person=person))


def clean(recording: Recording) -> Recording:
    """Return the recording from its begin to its end, mended: tracks of people at even times, free of noise and jumps.

    Raises:
        FileError: nobody is left.
    """
    mending = Mending()
    begin, end = recording.begin_s, recording.end_s
    parts = [part for person in recording.people for part in _split(person, mending)]
    people = [part for person in _link(parts, mending) for part in _without_gaps(person, mending)]
    inside = [_between(person, begin, end) for person in people]
    seen = [person for person in inside if person is not None and person.end_s - person.begin_s >= LEAST_S]
    mending.note(
        "short", len(people) - len(seen),
        f"{{}} of {len(people)} tracks are seen for less than {LEAST_S:g} s of the drive and are left out.",
    )  # fmt: skip
    if not seen:
        said = "nobody is seen for a second of the drive. Name the people: in a table by their id, in a bag with"
        raise FileError(Path(recording.source), f"{said} --people-topic.")
    seen = [replace(person, name=name) for person, name in zip(seen, _names(seen), strict=True)]
    smooth = [_smooth(person, begin, mending) for person in seen]
    robot = recording.robot[(recording.robot[:, 0] >= begin - 1e-9) & (recording.robot[:, 0] <= end + 1e-9)].copy()
    moved = 0.0
    if len(robot) > 5:
        robot, moved = _smooth_rows(robot, _driven(robot) if recording.odometry else 0.0)
        if moved >= VISIBLE_M:
            mending.note("smooth", 1, f"Smoothing moves the robot's path by {moved:.3f} m (root mean square).")
    robot[:, 0] -= begin
    return replace(
        recording,
        people=tuple(smooth),
        robot=robot,
        spread_m=moved,
        acceleration=recording.acceleration - np.array([begin, 0.0]),
        commands=recording.commands - np.array([begin, 0.0, 0.0]),
        contacts=tuple(
            contact.replace(time_s=contact.time_s - begin, until_s=contact.until_s - begin)
            for contact in recording.contacts
            if begin <= contact.time_s <= end
        ),
        goal_s=None,
        notes=(*recording.notes, *mending.notes),
    )


def _split(person: PersonTrack, mending: Mending) -> Iterator[PersonTrack]:
    """Leave out single samples that jump away and back, and split a track where it goes on elsewhere."""
    rows = person.rows[np.diff(person.rows[:, 0], prepend=-math.inf) > 0.0]
    mending.note(
        "double",
        len(person.rows) - len(rows),
        f"{person.name}: samples with the stamp of another, left out: {{}}.",
        person.name,
    )
    far = _jumps(rows)
    alone = np.concatenate([far, [False]]) & np.concatenate([[False], far])
    rows = rows[~alone]
    mending.note("jump", int(alone.sum()), f"{person.name}: samples that jump, left out: {{}}.", person.name)
    cuts = np.flatnonzero(_jumps(rows)) + 1
    for part in np.split(rows, cuts):
        if len(part):
            yield replace(person, rows=part)


def _jumps(rows: Floats) -> NDArray[np.bool_]:
    """Return for each step whether nobody can make it, (N - 1,)."""
    step = np.diff(rows[:, :3], axis=0)
    return np.asarray(np.hypot(step[:, 1], step[:, 2]) > STEP_M + FASTEST_M_S * step[:, 0])


def _link(parts: Sequence[PersonTrack], mending: Mending) -> list[PersonTrack]:
    """Join parts that go on with each other, the nearest first: trackers lose people and exchange their names."""
    links = []
    for a, before in enumerate(parts):
        heading = _velocity(before.rows)
        for b, after in enumerate(parts):
            wait = after.begin_s - before.end_s
            if a != b and -OVERLAP_S < wait <= LINK_S and after.begin_s > before.begin_s:
                away = math.dist(after.rows[0, 1:3], before.rows[-1, 1:3] + wait * heading)
                if away <= LINK_M:
                    links.append((away, a, b))
    following: dict[int, int] = {}
    for _, a, b in sorted(links):
        if a not in following and b not in following.values():
            following[a] = b
    joined, renamed = [], 0
    for first in range(len(parts)):
        if first in following.values():
            continue
        chain = [first]
        while chain[-1] in following:
            chain.append(following[chain[-1]])
        renamed += sum(parts[a].name != parts[b].name for a, b in pairwise(chain))
        rows = parts[first].rows
        for k in chain[1:]:
            rows = np.concatenate([rows, parts[k].rows[parts[k].rows[:, 0] > rows[-1, 0]]])
        joined.append(replace(parts[first], rows=rows))
    mending.note("identity", renamed, "Tracks that go on under another name, both counted as one person: {}.")
    return joined


def _velocity(rows: Floats) -> Floats:
    """Return the velocity of the last half second."""
    last = rows[rows[:, 0] >= rows[-1, 0] - 0.5]
    return (last[-1, 1:3] - last[0, 1:3]) / max(1e-9, last[-1, 0] - last[0, 0]) if len(last) > 1 else np.zeros(2)


def gaps_of(times: Floats) -> Floats:
    """Return the lengths of the gaps between samples, s."""
    steps = np.diff(times)
    return np.asarray(steps[steps > GAP_S])


def _without_gaps(person: PersonTrack, mending: Mending) -> Iterator[PersonTrack]:
    gaps = np.diff(person.rows[:, 0])
    short = gaps_of(person.rows[:, 0])
    short = short[short <= LONGEST_GAP_S]
    longest = f"the longest of {short.max():.1f} s" if len(short) else ""
    mending.note("gap", len(short), f"{person.name}: gaps crossed in a straight line: {{}}, {longest}.", person.name)
    cuts = np.flatnonzero(gaps > LONGEST_GAP_S) + 1
    mending.note(
        "long-gap", len(cuts),
        f"{person.name}: gaps of more than {LONGEST_GAP_S:g} s, after which the person counts as another: {{}}.",
        person.name,
    )  # fmt: skip
    for part in np.split(person.rows, cuts):
        yield replace(person, rows=part)


def _between(person: PersonTrack, begin: float, end: float) -> PersonTrack | None:
    rows = person.rows[(person.rows[:, 0] >= begin - 1e-9) & (person.rows[:, 0] <= end + 1e-9)]
    return replace(person, rows=rows) if len(rows) > 1 else None


def _names(people: Sequence[PersonTrack]) -> list[str]:
    """Return names that differ: `Person 3`, then `Person 3 (2)`."""
    names: list[str] = []
    for person in people:
        name, number = person.name, 1
        while name in names:
            number += 1
            name = f"{person.name} ({number})"
        names.append(name)
    return names


def _smooth(person: PersonTrack, begin: float, mending: Mending) -> PersonTrack:
    """Return a person at even times since the begin of the drive, without the noise of the measurement."""
    rows, moved = _smooth_rows(person.rows) if len(person.rows) > 5 else (person.rows, 0.0)
    if moved >= VISIBLE_M:
        mending.note(
            "smooth", 1, f"{person.name}: smoothing moves places by {moved:.3f} m (root mean square).", person.name
        )
    count = int((rows[-1, 0] - rows[0, 0]) / PERIOD_S + 1e-6) + 1
    times = rows[0, 0] + PERIOD_S * np.arange(count)
    x, y = (np.interp(times, rows[:, 0], rows[:, k]) for k in (1, 2))
    vx, vy = (np.gradient(values, PERIOD_S) if count > 1 else np.zeros(1) for values in (x, y))
    even = np.column_stack([times - begin, x, y, np.arctan2(vy, vx), np.hypot(vx, vy)])
    return replace(person, rows=even, spread_m=max(person.spread_m, moved))


def _driven(robot: Floats) -> Floats:
    """Return the way that the measured speeds make, (N, 2)."""
    t, yaw, ahead, left = robot[:, 0], robot[:, 3], robot[:, 4], robot[:, 6]
    speeds = np.column_stack([ahead * np.cos(yaw) - left * np.sin(yaw), ahead * np.sin(yaw) + left * np.cos(yaw)])
    steps = np.diff(t)[:, None] * (speeds[1:] + speeds[:-1]) / 2.0
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def _smooth_rows(rows: Floats, way: Floats | float = 0.0) -> tuple[Floats, float]:
    """Return rows with smooth places, by a spline whose stiffness leaves out what its neighbours do not tell.

    The spline is that of what the places differ from a known `way`, (N, 2); generalised cross-validation gives its
    stiffness. The second value is the root mean square of the changes, m.
    """
    from scipy.interpolate import make_smoothing_spline

    t = rows[:, 0] - rows[0, 0]
    smooth, rest = rows.copy(), rows[:, 1:3] - way
    for k in (0, 1):
        smooth[:, k + 1] += make_smoothing_spline(t, rest[:, k])(t) - rest[:, k]
    changed = smooth[:, 1:3] - rows[:, 1:3]
    return smooth, float(np.sqrt((changed**2).sum(axis=1).mean()))
