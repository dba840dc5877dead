"""Events of a run: what happened, to whom, where and when.

Simulators record what the trajectory does not show exactly (`RecordedEvent`). From it and the trajectory,
`rvsg.evaluation.detection.events_of` makes the full list, with what needs the world and the scenario: the names of
waypoints and tasks. Both lists consist of the same records, and all of them are JSON-able.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field, TypeAdapter

from rvsg.core.records import Record
from rvsg.scenario.scenario import Behaviour

ABSENT: Any = Field(exclude_if=lambda value: value is None or value == "")
"""A field that only the full list has."""


Side = Literal["robot", "person", "shared"]
Responsible = Annotated[Side | None, ABSENT]
"""Who is responsible, by the rule of `rvsg.evaluation.responsibility`."""


def responsible_in_words(side: Side, person: str = "the person") -> str:
    """Return who is responsible, in the words of stories, titles, prompts and test reports."""
    return {"robot": "the robot is", "person": f"{person} is", "shared": "both are"}[side] + " responsible"


class Outcome(str, Enum):
    """How a run ended, in the words a person reads."""

    REACHED = "the goal was reached"
    TIMED_OUT = "the time limit passed before the goal was reached"
    ABORTED = "navigation gave up before the goal was reached"
    NO_PATH = "no path to the goal was found"
    STUCK = "the robot is stuck in contact with an obstacle"
    STACK_FAILED = "the navigation stack under test failed"
    BLOCKED_START = "there is no room for the robot at the start"

    @classmethod
    def _missing_(cls, value: object) -> Outcome | None:
        """Read the words of 0.2."""
        return cls.BLOCKED_START if value == "the robot stands in an obstacle or a person at the start" else None


class TimedEvent(Record):
    """The fields that all events share. The place is the robot's, or the person's for an event of a person."""

    time_s: float
    """Seconds since the start of the run."""
    x: float
    """Metres, world frame."""
    y: float
    """Metres, world frame."""
    waypoint: Annotated[str, ABSENT] = ""
    """The nearest waypoint of the world's grid; empty if the world is not given."""

    @property
    def at(self) -> str:
        """Where it happens: the waypoint, or `(1.2, 3.4)` where the world is not known."""
        return self.waypoint or f"({self.x:.1f}, {self.y:.1f})"


class Spell(TimedEvent):
    """An event with a duration."""

    until_s: float
    """When it ended, seconds since the start of the run; the end of the run where it did not end."""

    @property
    def duration_s(self) -> float:
        """Return how long it lasted, seconds."""
        return self.until_s - self.time_s


class Contact(Spell):
    """The bodies of the robot and a person touch; contacts with one person less than 0.5 s apart are one.

    The place is where they touch first; where the simulator does not record contacts, the robot's.
    """

    kind: Literal["robot_contact"] = "robot_contact"
    person: str
    part: Annotated[Literal["body", "trolley", "wheelchair"], Field(exclude_if=lambda part: part == "body")] = "body"
    """What of the person is touched."""
    closing_speed_m_s: float
    """Speed of approach along the line between the two when they first touch; 0 if they do not approach."""
    robot_part_m_s: float
    """The robot's part of it, towards the person; recorded: the speed of its surface at the place."""
    person_part_m_s: float
    """The person's part of it, towards the robot."""
    robot_speed_m_s: Annotated[float | None, ABSENT] = None
    """Largest speed of the robot while they touch."""
    person_speed_m_s: Annotated[float | None, ABSENT] = None
    """Largest speed of the person while they touch."""
    bearing_rad: float
    """Direction of the person off the robot's heading at first touch; 0 ahead, positive to the left."""
    overlap_m: float
    """How far the bodies overlap at most, the smallest gap negated; 0 if the simulator keeps them apart."""
    responsible: Responsible = None

    @property
    def moved_by(self) -> Literal["robot", "person", "both", "neither"]:
        """Who moved into whom; `both` where each contributes at least a third of the approach."""
        if self.closing_speed_m_s <= 0.02:
            return "neither"
        if min(self.robot_part_m_s, self.person_part_m_s) >= self.closing_speed_m_s / 3:
            return "both"
        return "robot" if self.robot_part_m_s > self.person_part_m_s else "person"


class ObstacleContact(Spell):
    """The robot's body touches a wall, an object or the leaf of a door and is held back; the place is that of the
    first touch, and contacts less than 0.5 s apart are one."""

    kind: Literal["obstacle_contact"] = "obstacle_contact"
    speed_m_s: float
    """The robot's speed at first touch."""
    door: Annotated[str, ABSENT] = ""
    """The name of the door whose leaf it touches first; empty for anything else, or if the world is not given."""


class NearMiss(TimedEvent):
    """The robot passes a person closely without touching; the time is that of the smallest gap."""

    kind: Literal["near_miss"] = "near_miss"
    person: str
    gap_m: float
    """Smallest gap between the bodies."""
    relative_speed_m_s: float
    """Speed of the robot relative to the person at that time."""
    bearing_rad: float
    """Direction of the person off the robot's heading; 0 ahead, positive to the left."""
    responsible: Responsible = None


class HardBrake(Spell):
    """The robot brakes hard before it arrives."""

    kind: Literal["hard_brake"] = "hard_brake"
    deceleration_m_s2: float
    """Largest mean deceleration over half a second."""
    from_speed_m_s: float
    to_speed_m_s: float
    person: str = ""
    """The nearest person if within 2 m; else empty."""


Reason = Literal[
    "contact", "obstacle_contact", "person_ahead", "person_close", "goal_taken", "obstacle", "recovery", "unknown"
]


class StandStill(Spell):
    """The robot neither drives nor turns for at least a second on its way."""

    kind: Literal["standstill"] = "standstill"
    reason: Reason
    """What holds it up for most of the standstill; `goal_taken`: a person stands on its goal."""
    person: str = ""
    """The person of the reason; else empty."""
    responsible: Responsible = None


class Replan(TimedEvent):
    """The global planner returns a path to the same goal that differs clearly from the one before."""

    kind: Literal["replan"] = "replan"
    length_m: float
    """Length of the new path."""
    deviation_m: float
    """Largest distance of the new path from the one before."""


class Recovery(Spell):
    """The navigation runs a recovery behaviour."""

    kind: Literal["recovery"] = "recovery"
    action: Literal["clear_costmaps", "spin", "wait", "back_up", "other"]


class BlockedGoal(Spell):
    """A person stands so near the goal that the robot cannot take its place there, while the robot is near."""

    kind: Literal["blocked_goal"] = "blocked_goal"
    person: str


class PersonStuck(Spell):
    """A person who has somewhere to go comes no nearer to the next waypoint for at least 5 s."""

    kind: Literal["person_stuck"] = "person_stuck"
    person: str
    goal: Annotated[int | None, ABSENT] = None
    """Index of the waypoint in the person's goals; None where it is not recorded."""
    reason: Annotated[Literal["robot", "person", "unknown"] | None, ABSENT] = None
    """Who stands next to the person when it begins."""


class PersonReached(TimedEvent):
    """A person reaches a waypoint for the first time; the full list has the ends of tasks alone."""

    kind: Literal["person_reached"] = "person_reached"
    person: str
    goal: int
    """Index of the waypoint in the person's goals."""
    task: Annotated[str, ABSENT] = ""
    """Name of the task that ends there."""


class PersonPaused(Spell):
    """A person stands at a waypoint as the task says."""

    kind: Literal["person_paused"] = "person_paused"
    person: str
    goal: int
    """Index of the waypoint in the person's goals."""


class PersonReacted(Spell):
    """A person reacts to the robot as its behaviour says."""

    kind: Literal["person_reacted"] = "person_reacted"
    person: str
    behaviour: Behaviour


class DoorMoved(Spell):
    """An automatic door begins to open or close; the place is the middle of its closed leaf."""

    kind: Literal["door_moved"] = "door_moved"
    door: str
    """The name of the door."""
    opens: bool
    share: float
    """How far it is open when it begins, 0 to 1."""


class TimeOut(TimedEvent):
    """The time limit passes before the robot reaches its goal."""

    kind: Literal["time_out"] = "time_out"
    remaining_m: float
    """Straight distance from the robot to its goal."""


class Abort(TimedEvent):
    """The run ends before the goal and before the time limit."""

    kind: Literal["abort"] = "abort"
    outcome: Outcome
    """Why: navigation gave up, no path was found, or the robot could not start."""
    remaining_m: float
    """Straight distance from the robot to its goal."""


class GoalReached(TimedEvent):
    """The robot reaches its goal."""

    kind: Literal["arrival"] = "arrival"


OfPerson = PersonStuck | PersonPaused | PersonReacted | PersonReached
RecordedEvent = Annotated[
    Contact | ObstacleContact | OfPerson | Replan | Recovery | DoorMoved, Field(discriminator="kind")
]
"""What a simulator records."""
RunEvent = Annotated[
    RecordedEvent | NearMiss | HardBrake | StandStill | BlockedGoal | TimeOut | Abort | GoalReached,
    Field(discriminator="kind"),
]
EVENTS: TypeAdapter[tuple[RunEvent, ...]] = TypeAdapter(tuple[RunEvent, ...])
"""Reads and writes a list of events: `EVENTS.dump_json(events)`, `EVENTS.validate_json(text)`."""
E = TypeVar("E", bound=TimedEvent)


def in_order(events: Iterable[E]) -> tuple[E, ...]:
    """Return events in order of time."""
    return tuple(sorted(events, key=lambda event: event.time_s))
