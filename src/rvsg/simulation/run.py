"""The Run: what happened in one simulation of a scenario, with the events that its simulator recorded.

Recorded events are measurements that the trajectory does not show exactly. From them, the trajectory and the outcome,
`rvsg.evaluation.detection` makes the full list of a run's events (`rvsg.evaluation.run_events`). They are separate
records: a stored run stays readable while the list grows, the list names waypoints and tasks, which no simulator knows,
and a simulator that records nothing still gets the list.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from rvsg.core.records import Record, content_id
from rvsg.scenario.scenario import Behaviour

Floats = NDArray[np.float64]


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


def run_id(scenario_id: str, simulator: str, options: Mapping[str, object], seed: int) -> str:
    """The content id of a run, known before it is simulated: what is known already is not simulated again."""
    return content_id("run", {"scenario": scenario_id, "simulator": simulator, "options": dict(options), "seed": seed})


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """Robot and humans over time. N samples, H humans; SI units, world frame.

    `t` (N,) s since the start; `x`, `y`, `yaw` (N,) robot pose; `v`, `omega` (N,) robot forward speed and yaw
    rate; `acceleration` (N,) horizontal acceleration magnitude as an inertial sensor shows it;
    `human_x`, `human_y`, `human_yaw`, `human_speed` (N, H); `lateral` (N,) the robot's speed to its left, empty where
    its base does not move sideways.
    """

    t: Floats
    x: Floats
    y: Floats
    yaw: Floats
    v: Floats
    omega: Floats
    acceleration: Floats
    human_x: Floats
    human_y: Floats
    human_yaw: Floats
    human_speed: Floats
    lateral: Floats = field(default_factory=lambda: np.empty(0))

    def __len__(self) -> int:
        return len(self.t)

    @property
    def speed(self) -> Floats:
        """(N,) the robot's speed, whichever way it moves."""
        return np.hypot(self.v, self.lateral) if self.lateral.size else np.abs(self.v)

    @property
    def signed_speed(self) -> Floats:
        """(N,) the robot's speed, negative where it drives backwards."""
        return np.copysign(self.speed, self.v) if self.lateral.size else self.v

    def at(self, rows: Any) -> Trajectory:
        """Return the samples of these rows: a slice, indices or a mask."""
        arrays = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return Trajectory(**{name: array[rows] if len(array) else array for name, array in arrays.items()})


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """One simulated (or imported) episode.

    `trajectory` is recorded at every control tick (20 Hz); `log` are the rows the published study's client would
    have written (about 2 Hz, wall time: see `clock_ratio` = simulated over wall seconds); an imported run has
    only the log, and its `trajectory` is the log. `imu` (K,) is the acceleration magnitude at 100 Hz, empty where
    unknown. `options` are the simulator's effective options, enough to repeat the run with `seed`. `human_groups`
    names the group of each human (None: alone); it is empty where groups are not known. `events`: what the simulator
    recorded besides, in order of time.
    """

    scenario_id: str
    simulator: str
    options: dict[str, object]
    seed: int
    outcome: Outcome
    trajectory: Trajectory
    log: Trajectory
    imu: Floats = field(default_factory=lambda: np.empty(0))
    clock_ratio: float = 1.0
    human_names: tuple[str, ...]
    robot_radius_m: float = 0.35
    human_radius_m: tuple[float, ...]
    goal: tuple[float, float, float]
    time_limit_s: float
    recoveries: int = 0
    details: dict[str, object] = field(default_factory=dict)
    human_groups: tuple[int | None, ...] = ()
    events: tuple[RecordedEvent, ...] = ()
    robot_outline: tuple[tuple[float, float], ...] = ()
    """Corners of the robot's body in its frame, metres, where the simulator keeps bodies apart and records their
    contacts in `events`; empty: the body is the disc of `robot_radius_m`, and bodies may overlap."""
    human_outlines: tuple[tuple[tuple[float, float], ...], ...] = ()
    """Corners of what each person sits in or pushes, in the person's frame, metres; empty: nobody does."""
    robot_latency_s: float = 0.0
    robot_deceleration_m_s2: float = 2.5

    @cached_property
    def id(self) -> str:
        """Content id of what determines the run: scenario, simulator with options, seed."""
        return run_id(self.scenario_id, self.simulator, self.options, self.seed)

    @property
    def stack_fault(self) -> str:
        """Why the stack under test failed; empty where it did not."""
        told = self.details.get("stack")
        return str(told.get("fault", "")) if isinstance(told, dict) else ""

    @property
    def stack_warnings(self) -> tuple[str, ...]:
        """What the stack under test did not do as it should, such as control periods that it missed."""
        told = self.details.get("stack")
        return tuple(map(str, told.get("warnings", ()))) if isinstance(told, dict) else ()

    @property
    def absent_at(self) -> dict[str, tuple[float, float]]:
        """Where people stand, far outside of the map, while they are absent; the others are always there."""
        told = self.details.get("absent_at")
        return {name: (x, y) for name, (x, y) in told.items()} if isinstance(told, dict) else {}

    @property
    def completed(self) -> bool:
        """Whether the goal was reached in time."""
        return self.outcome is Outcome.REACHED
