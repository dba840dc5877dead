"""Events that a simulator records because the trajectory does not show them, or not exactly.

They are measurements, stored with the run: coordinates, indices of goals, the speed of each body. From these, the
trajectory and the outcome, `rvsg.evaluation.detection` makes the full list of a run's events
(`rvsg.evaluation.events`), and every story is told from that list. `rvsg.campaign.observation` counts legs of a
person's way by the indices of goals, which only the measurements hold.

The two are separate records for three reasons. A stored run must stay readable while the list that is told grows. The
list names waypoints and tasks, for which it needs the world and the scenario; a simulator knows neither. And a
simulator that records nothing, or a recording of a real robot, leaves `Run.events` empty and still gets the list.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rvsg.core.records import Record
from rvsg.scenario.scenario import Behaviour


class _Recorded(Record):
    """The fields that all recorded events share."""

    time_s: float
    """Seconds since the start of the run."""
    x: float
    """Metres, world frame."""
    y: float
    """Metres, world frame."""


class _OfPerson(_Recorded):
    person: str
    """The name of the person."""


class RobotContact(_OfPerson):
    """The robot's body and a person touch; the place is where they touch first."""

    kind: Literal["robot_contact"] = "robot_contact"
    until_s: float
    """When they part; contacts less than 0.5 s apart count as one."""
    closing_speed_m_s: float
    """Relative speed along the normal just before the contact; 0 where the two do not approach."""
    robot_part_m_s: float
    """The robot's part of it: speed of its surface at the place, towards the person."""
    person_part_m_s: float
    """The person's part of it: speed towards the robot."""
    bearing_rad: float
    """Direction of the person off the robot's heading; 0 ahead, positive to the left."""
    part: Annotated[Literal["body", "trolley", "wheelchair"], Field(exclude_if=lambda part: part == "body")] = "body"
    """What of the person is touched."""
    overlap_m: float
    """How far the bodies overlap at most, after the contact is resolved."""

    @property
    def moved_by(self) -> Literal["robot", "person", "both", "neither"]:
        """Who moved into whom; `both` where each contributes at least a third of the approach."""
        if self.closing_speed_m_s <= 0.02:
            return "neither"
        third = self.closing_speed_m_s / 3
        if self.robot_part_m_s >= third and self.person_part_m_s >= third:
            return "both"
        return "robot" if self.robot_part_m_s > self.person_part_m_s else "person"


class ObstacleContact(_Recorded):
    """The robot's body touches a wall or an object and is held back; the place is where they touch first."""

    kind: Literal["obstacle_contact"] = "obstacle_contact"
    until_s: float
    """When the robot was held back last; contacts less than 0.5 s apart count as one."""
    speed_m_s: float
    """The robot's speed when they touch first."""


class PersonStuck(_OfPerson):
    """A person who walks comes no nearer to the next waypoint for at least 5 s."""

    kind: Literal["person_stuck"] = "person_stuck"
    until_s: float
    goal: int
    """Index of the waypoint in the person's goals."""


class PersonPaused(_OfPerson):
    """A person stands at a waypoint as the task says."""

    kind: Literal["person_paused"] = "person_paused"
    until_s: float
    goal: int
    """Index of the waypoint in the person's goals."""


class PersonReacted(_OfPerson):
    """A person reacts to the robot as its behaviour says; the place is where the person is when it starts."""

    kind: Literal["person_reacted"] = "person_reacted"
    until_s: float
    behaviour: Behaviour


class PersonReached(_OfPerson):
    """A person reaches a waypoint for the first time in a run."""

    kind: Literal["person_reached"] = "person_reached"
    goal: int
    """Index of the waypoint in the person's goals."""


class Replan(_Recorded):
    """The global planner returns a path to the same goal that differs clearly from the one before.

    The place is the robot's.
    """

    kind: Literal["replan"] = "replan"
    length_m: float
    """Length of the new path."""
    deviation_m: float
    """Largest distance of the new path from the one before."""


class Recovery(_Recorded):
    """The navigation runs a recovery behaviour; the place is the robot's when it begins."""

    kind: Literal["recovery"] = "recovery"
    until_s: float
    action: Literal["clear_costmaps", "spin", "wait", "back_up", "other"]


class DoorMoved(_Recorded):
    """An automatic door begins to open or close; the place is the middle of its closed leaf."""

    kind: Literal["door_moved"] = "door_moved"
    door: str
    """The name of the door."""
    opens: bool
    share: float
    """How far it is open when it begins, 0 to 1."""
    until_s: float
    """When it stops."""


RecordedEvent = Annotated[
    RobotContact
    | ObstacleContact
    | PersonStuck
    | PersonPaused
    | PersonReacted
    | PersonReached
    | Replan
    | Recovery
    | DoorMoved,
    Field(discriminator="kind"),
]


def in_order(*events: RecordedEvent) -> tuple[RecordedEvent, ...]:
    """Return events in order of time."""
    return tuple(sorted(events, key=lambda event: event.time_s))
