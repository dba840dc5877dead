"""Missions, people and scenarios, and the people in coordinates as a simulator moves them."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from functools import cached_property
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import Field, SerializerFunctionWrapHandler, field_validator, model_serializer, model_validator

from rvsg.core.records import Record, content_id
from rvsg.robots.robot import DEFAULT_ROBOT, Robot, shipped_robots
from rvsg.scenario.activity import Activity
from rvsg.world.grid import Grid
from rvsg.world.lattice import place_of
from rvsg.world.world import Route, SolidObject, State, World, WorldParts

Outline = tuple[tuple[float, float], ...]

TROLLEY_GAP_M = 0.1
"""Between the body of a person and the trolley in front: the handle."""
TROLLEY_SPEEDS_M_S = (0.3, 1.5)
TROLLEY_LENGTHS_M, TROLLEY_WIDTHS_M = (0.3, 2.4), (0.3, 1.2)
WHEELCHAIR: Outline = ((-0.45, -0.33), (0.65, -0.33), (0.65, 0.33), (-0.45, 0.33))
"""1.1 x 0.66 m with the feet of who sits in it: ISO 7176-5 allows up to 1.3 x 0.7 m."""


class PersonKind(str, Enum):
    """Who a person is."""

    ADULT = "adult"
    CHILD = "child"
    WHEELCHAIR = "wheelchair"


class Trolley(Record):
    """What a person pushes: a trolley, a cart or a bed, as a rectangle ahead of the person. Metres."""

    length_m: Annotated[float, Field(ge=TROLLEY_LENGTHS_M[0], le=TROLLEY_LENGTHS_M[1])] = 0.9
    width_m: Annotated[float, Field(ge=TROLLEY_WIDTHS_M[0], le=TROLLEY_WIDTHS_M[1])] = 0.55


class BodyLimits(NamedTuple):
    """Smallest and largest radius (m) and speed (m/s) of a kind of person, and what is taken where nothing is said."""

    radii_m: tuple[float, float]
    speeds_m_s: tuple[float, float]
    radius_m: float
    speed_m_s: float


LIMITS = {
    PersonKind.CHILD: BodyLimits((0.15, 0.35), (0.3, 2.0), 0.25, 1.1),
    PersonKind.WHEELCHAIR: BodyLimits((0.25, 0.4), (0.3, 1.7), 0.33, 0.9),
}
"""Of everybody but adults, who keep to the general limits."""


def outline_of(kind: PersonKind, trolley: Trolley | None, radius_m: float) -> Outline:
    """Return the corners of what a person sits in or pushes, in the person's frame (x ahead); empty for the body alone.

    The body itself is a disc of `radius_m` at the origin.
    """
    if kind is PersonKind.WHEELCHAIR:
        return WHEELCHAIR
    if trolley is None:
        return ()
    near, half = radius_m + TROLLEY_GAP_M, trolley.width_m / 2
    far = near + trolley.length_m
    return tuple((round(x, 4), round(y, 4)) for x, y in ((near, -half), (far, -half), (far, half), (near, half)))


FASTEST_M_S = 3.0
"""No person walks or rolls faster."""
Name = Annotated[str, Field(min_length=1, max_length=120)]
Point = tuple[float, float]


class Behaviour(str, Enum):
    """How a human reacts to the robot: the six behaviours of HuNavSim."""

    REGULAR = "regular"
    IMPASSIVE = "impassive"
    SURPRISED = "surprised"
    SCARED = "scared"
    CURIOUS = "curious"
    THREATENING = "threatening"


class Attention(str, Enum):
    """How far ahead a person looks: `unseeing` walks backwards or behind a load."""

    ATTENTIVE = "attentive"
    DISTRACTED = "distracted"
    UNSEEING = "unseeing"


LONGEST_PAUSE_S = 600.0
"""The pause of somebody who stays."""


class Pause(Record):
    """The human stands still at a waypoint of the task's path ("inspects for 5 s").

    It begins whenever the human arrives there. At the start of the run it is held only where the first task asks for
    it at its first waypoint; a pause at the end of the last task, the same place, is held after every round.
    """

    at: str
    duration_s: Annotated[float, Field(gt=0, le=LONGEST_PAUSE_S)]
    doing: Annotated[Activity | None, Field(exclude_if=lambda doing: doing is None)] = None
    """What the person does there; None: not said."""


class Task(Record):
    """One task of a cyclic list."""

    name: Name
    """For people to read, such as "Area 2 → Shelf 6". Nothing is decided by it."""
    path: tuple[str, ...]
    """Names of waypoints, in order."""
    start_area: str | None = None
    """The labelled area or waypoint where the task has to start; None: anywhere."""
    end_area: str | None = None
    """The labelled area or waypoint where the task has to end; None: anywhere."""
    pauses: tuple[Pause, ...] = ()

    @classmethod
    def between(cls, start: str, end: str, path: tuple[str, ...], pauses: tuple[Pause, ...] = ()) -> Self:
        """Return the task of walking from one area or waypoint to another, named after both."""
        return cls(name=f"{start} → {end}"[:120], path=path, start_area=start, end_area=end, pauses=pauses)

    @property
    def work(self) -> Pause | None:
        """What the person does where the task ends; None: nothing that is said."""
        ends = (pause for pause in self.pauses if pause.doing is not None and self.path[-1:] == (pause.at,))
        return next(ends, None)

    @property
    def stops(self) -> tuple[Pause, ...]:
        """The pauses other than the work at the end."""
        return tuple(pause for pause in self.pauses if pause is not self.work)

    def working(self, work: Pause | None) -> Self:
        """Return the task with other work where it ends."""
        own = () if work is None else (work.model_copy(update={"at": self.path[-1]}),)
        return self.model_copy(update={"pauses": (*self.stops, *own)})


class ForceFactors(Record):
    """Weights of the social force model (HuNavSim's goal, obstacle and social force factors)."""

    goal: Annotated[float, Field(gt=0, le=20)] = 2.0
    obstacle: Annotated[float, Field(ge=0, le=100)] = 10.0
    social: Annotated[float, Field(ge=0, le=50)] = 5.0


class Reaction(Record):
    """How a human reacts to the robot while its behaviour is active; what a behaviour does not use is ignored.

    `duration_s` is the time the reaction lasts, `once` whether it comes only once per run, `speed_m_s` the
    approach speed of the curious and the speed cap of the scared, `distance_m` the range at which the surprised
    and the scared notice the robot, the distance at which the curious stop, and how far in front of the robot the
    threatening stand; `force` weighs the scare force. Defaults per behaviour: HuNavSim's.
    """

    duration_s: Annotated[float, Field(ge=0)] = 40.0
    once: bool = True
    speed_m_s: float = 1.0
    distance_m: Annotated[float, Field(ge=0)] = 0.0
    force: Annotated[float, Field(ge=0)] = 20.0


GOAL_RADIUS_M = 0.3
"""HuNavSim's usual goal radius."""
BODY_RADIUS_M = 0.25
"""Half of the shoulder width of an adult. Personal space is a matter of the model, not of the body."""
HUNAVSIM_RADIUS_M = 0.4
"""Radius of HuNavSim's people."""


class Track(Record):
    """Where a person or the robot was in a recording: places at even times, with straight lines between them.

    A person is absent before `start_s` and moves along the track without regard to anybody, the robot included. At the
    end the person `leaves`, or goes on with the tasks.
    """

    start_s: Annotated[float, Field(ge=0, le=36_000)] = 0.0
    """When the first point holds, in seconds since the start of the run."""
    period_s: Annotated[float, Field(gt=0, le=10)] = 0.2
    points: Annotated[tuple[Point, ...], Field(min_length=1, max_length=20_000)]
    """Metres, world frame."""
    leaves: bool = True
    until_m: Annotated[float, Field(gt=0), Field(exclude_if=lambda limit: limit is None)] | None = None
    """The person turns to the tasks for good when the robot is farther than this from where it was recorded
    (`Mission.driven`); None: never."""

    @property
    def end_s(self) -> float:
        """When the last point holds."""
        return self.start_s + (len(self.points) - 1) * self.period_s


class Human(Record):
    """One person: a list of tasks and how they are walked.

    `factors` is either fixed or drawn from the run's seed: `random_normal` and `random_uniform` are HuNavSim's
    distributions of a person that differs at every launch.
    """

    name: Name
    tasks: Annotated[tuple[Task, ...], Field(min_length=1)]
    behaviour: Behaviour = Behaviour.REGULAR
    speed_m_s: Annotated[float, Field(gt=0, le=FASTEST_M_S)] = 1.5
    radius_m: Annotated[float, Field(gt=0, le=1.0, exclude_if=lambda radius: radius is None)] | None = None
    """Half of the width of the body; None: that of an adult in the simulator's profile (`BODY_RADIUS_M`)."""
    start_delay_s: Annotated[float, Field(ge=0, le=600)] = 0.0
    group: int | None = None
    factors: ForceFactors | Literal["random_normal", "random_uniform"] = ForceFactors()
    points: dict[str, Point] = Field(default_factory=dict)
    """Free points of this person's own by name, in metres (world frame). A path may name them beside waypoints."""
    start: Point | None = None
    """Where the person starts, if not at the first waypoint of the first path."""
    reaction: Reaction | None = None
    """How the person reacts to the robot; None: HuNavSim's default for the behaviour."""
    cyclic: bool = True
    """Whether the tasks come round again; if not, the person stays at the end of the last one."""
    goal_radius_m: Annotated[float, Field(gt=0, le=2.0, exclude_if=lambda radius: radius == GOAL_RADIUS_M)] = (
        GOAL_RADIUS_M
    )
    """How near the person comes to a waypoint before it counts as reached. The default is no part of the id."""
    kind: Annotated[PersonKind, Field(exclude_if=lambda kind: kind is PersonKind.ADULT)] = PersonKind.ADULT
    """Who the person is; a child or a wheelchair brings its own radius and speed where none are given."""
    trolley: Annotated[Trolley | None, Field(exclude_if=lambda trolley: trolley is None)] = None
    """What the person pushes."""
    attention: Annotated[Attention, Field(exclude_if=lambda value: value is Attention.ATTENTIVE)] = Attention.ATTENTIVE
    """How far ahead the person looks; people of the default profile only."""
    track: Annotated[Track | None, Field(exclude_if=lambda track: track is None)] = None
    """Where a recorded person was, whom the tasks describe; None: the tasks alone count."""

    @model_validator(mode="before")
    @classmethod
    def _sized(cls, values: Any) -> Any:
        kind = values.get("kind") if isinstance(values, dict) else None
        if kind not in (*LIMITS,):
            return values
        return {"radius_m": LIMITS[kind].radius_m, "speed_m_s": LIMITS[kind].speed_m_s, **values}

    @property
    def outline(self) -> Outline:
        """The corners of what the person sits in or pushes, in the person's frame; empty for the body alone."""
        return outline_of(self.kind, self.trolley, self.body_radius_m)

    @property
    def body_radius_m(self) -> float:
        """Half of the width of the body, where nothing is given that of an adult."""
        return BODY_RADIUS_M if self.radius_m is None else self.radius_m

    def starts_at(self, grid: Grid) -> Point | None:
        """Return where the person starts; None if the first path is empty or names no place."""
        if self.track is not None:
            return self.track.points[0]
        if self.start is not None:
            return self.start
        path = self.tasks[0].path
        return self.position(path[0], grid) if path else None

    def position(self, name: str, grid: Grid) -> Point | None:
        """Return where a waypoint or a free point of this person is; None if there is none of that name."""
        if name in self.points:
            return self.points[name]
        return grid.position(name) if name in grid.by_name else None


class HumanConfiguration(Record):
    """What all the people do. Without humans it is a baseline: the mission alone."""

    humans: tuple[Human, ...]


MOST_MOVED = 50
"""More moved objects than this in one mission are refused."""

ROBOT = DEFAULT_ROBOT
"""The robot of a mission that names none: the TIAGo OMNI base."""


class Mission(Record):
    """What the robot is to do, and where.

    `world` and `world_id` name the world by its declared name and content id, `parts` keeps what tells whether a later
    change of that world matters (None: saved by a version that did not keep it).

    A robot is a record, so that its content is part of the mission's id. The default robot and a robot that only
    another simulator knows are given by name; the name of any other shipped robot becomes its record.
    """

    world: str
    world_id: str
    route: Route
    robot: str | Robot = ROBOT
    parts: WorldParts | None = None
    moved: Annotated[tuple[SolidObject, ...], Field(max_length=MOST_MOVED)] = ()
    """Objects that stand in the way and that the robot's map does not show, such as a pallet left in an aisle."""
    doors: dict[Name, State] = Field(default_factory=dict)
    """The states of doors by name; the others are as the world has them."""
    driven: Track | None = None
    """Where the robot of a recording was, which people who follow a recorded track compare this one with."""

    @classmethod
    def of(
        cls,
        world: World,
        route: Route,
        *,
        robot: str | Robot = ROBOT,
        moved: tuple[SolidObject, ...] | None = None,
        doors: Mapping[str, State] | None = None,
        driven: Track | None = None,
    ) -> Self:
        """Return the mission of driving a route in a world, with moved objects and door states, else the world's."""
        return cls(
            world=world.name,
            world_id=world.id,
            route=route,
            robot=robot,
            parts=world.parts,
            moved=world.moved if moved is None else moved,
            doors=dict(world.door_states if doors is None else doors),
            driven=driven,
        )

    def place(self, world: World) -> World:
        """Return the mission's world as it finds it: with its moved objects, and its doors in their states."""
        return place_of(world, self.moved, self.doors)

    @model_serializer(mode="wrap")
    def _without_what_is_absent(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out absent parts, objects and doors, so that a mission saved by an earlier version keeps its id."""
        written: dict[str, Any] = handler(self)
        for name in ("parts", "moved", "doors", "driven"):
            if not written.get(name):
                written.pop(name, None)
        return written

    @field_validator("robot", mode="before")
    @classmethod
    def _shipped(cls, robot: object) -> object:
        return shipped_robots().get(robot, robot) if isinstance(robot, str) and robot != ROBOT else robot

    @property
    def robot_name(self) -> str:
        """The robot's name."""
        return self.robot if isinstance(self.robot, str) else self.robot.name

    @property
    def robot_record(self) -> Robot | None:
        """The robot as a record; None if only its name is known."""
        return shipped_robots().get(self.robot) if isinstance(self.robot, str) else self.robot


class Scenario(Record):
    """A mission among people. Equal content has equal id; the requirement is not part of it."""

    mission: Mission
    people: HumanConfiguration
    description: str = ""
    idea: Annotated[str, Field(exclude_if=lambda idea: not idea)] = ""
    """The part of the description that does not depend on the tasks, which a refinement keeps. Empty: all of it."""

    @cached_property
    def situation(self) -> str:
        """Id of what the robot meets: of the people, and of the objects that were moved, where there are any."""
        moved = self.mission.moved
        return content_id("situation", [self.people.id, *(thing.id for thing in moved)]) if moved else self.people.id


def begin_at(tasks: tuple[Task, ...], k: int, at: int) -> tuple[Task, ...]:
    """Return the cycle of tasks beginning at place `at` in the path of task `k`, and ending there."""
    if at == 0:
        return (*tasks[k:], *tasks[:k])
    task, here = tasks[k], tasks[k].path[at]
    start, end = ends_of(task)
    rest, begun = task.path[at:], task.path[: at + 1]
    first = Task.between(here, end, rest, tuple(p for p in task.pauses if p.at in rest[1:]))
    last = Task.between(start, here, begun, tuple(p for p in task.pauses if p.at in begun[1:]))
    return (first, *tasks[k + 1 :], *tasks[:k], last)


def at_places(tasks: tuple[Task, ...]) -> tuple[Task, ...]:
    """The cycle of tasks from place to place again, where it begins on the way through one of them."""
    first, last = tasks[0], tasks[-1]
    (begin, end), (start, close) = ends_of(first), ends_of(last)
    if len(tasks) < 3 or not begin == close == first.path[0]:
        return tasks
    path, pauses = (*last.path, *first.path[1:]), (*last.pauses, *first.pauses)
    return (Task.between(start, end, path, pauses), *tasks[1:-1])


def ends_of(task: Task) -> tuple[str, str]:
    """Return the areas, or else the waypoints, between which a task leads."""
    return task.start_area or task.path[0], task.end_area or task.path[-1]


FOREVER_S = 36_000.0
"""The pause of a person who stays; longer than any run."""


def reaction_of(behaviour: Behaviour, speed_m_s: float) -> Reaction:
    """HuNavSim's default reaction of a behaviour; `speed_m_s` is the human's walking speed."""
    defaults = {
        Behaviour.SURPRISED: {"duration_s": 30.0, "distance_m": 4.0},
        Behaviour.SCARED: {"speed_m_s": 0.6, "distance_m": 3.0},
        Behaviour.CURIOUS: {"speed_m_s": speed_m_s, "distance_m": 1.5},
        Behaviour.THREATENING: {"distance_m": 1.4},
    }
    return Reaction(**defaults.get(behaviour, {}))


class HumanAgent(Record):
    """One person in coordinates, as a simulator moves it. Metres, world frame.

    The person walks `goals` in a cycle; the first one lies at `start`. `factors` are fixed, or drawn from the run's
    seed.
    """

    name: str
    start: Point
    yaw: float = 0.0
    goals: Annotated[tuple[Point, ...], Field(min_length=1)]
    pauses_s: tuple[float, ...]
    """How long the person stands at each goal, every time it is reached; not at the start of the run."""
    start_pause_s: Annotated[float, Field(ge=0)] = 0.0
    """How long the person stands at the start, once."""
    speed_m_s: float = 1.5
    radius_m: float = BODY_RADIUS_M
    goal_radius_m: float = GOAL_RADIUS_M
    """A goal counts as reached from this near."""
    behaviour: Behaviour = Behaviour.REGULAR
    reaction: Reaction = Reaction()
    factors: ForceFactors | Literal["random_normal", "random_uniform"] = ForceFactors()
    group: int | None = None
    start_delay_s: float = 0.0
    outline: Annotated[Outline, Field(exclude_if=lambda outline: not outline)] = ()
    """Corners of what the person sits in or pushes, in the person's frame."""
    attention: Annotated[Attention, Field(exclude_if=lambda value: value is Attention.ATTENTIVE)] = Attention.ATTENTIVE
    track: Annotated[Track | None, Field(exclude_if=lambda track: track is None)] = None

    @property
    def stays(self) -> bool:
        """Return whether the person stays at the last goal; otherwise the goals are walked again from the first."""
        return self.pauses_s[-1] >= FOREVER_S


def decode(people: HumanConfiguration, grid: Grid, body_radius_m: float = BODY_RADIUS_M) -> tuple[HumanAgent, ...]:
    """Return the people in coordinates; raises UnknownName for a waypoint that the grid does not know.

    The goals of a person are the waypoints of all tasks in order. Where a task starts at the waypoint at which the one
    before ended, that waypoint is one goal, not two, and its pause is held once: the sum of what both tasks ask for.
    A person pauses at the start of the run only if the first task asks for a pause at its first waypoint. The pause
    at the end of the last task is held when the person comes back there. A person whose tasks are
    not cyclic stays at the last goal. `body_radius_m`: of people for whom the scenario gives none.
    """
    return tuple(_agent(human, grid, body_radius_m) for human in people.humans)


def goal_names(human: Human) -> tuple[str, ...]:
    """Return the names of a person's goals, in the order in which `decode` numbers them."""
    return tuple(_goals(human)[0])


def pauses_of(human: Human) -> list[tuple[int, str, float]]:
    """Return the pauses of a person: the leg at whose end each is held, from 1, the waypoint, and seconds."""
    names, pauses, _, _ = _goals(human)
    return [(k or len(names), name, pause) for k, (name, pause) in enumerate(zip(names, pauses, strict=True)) if pause]


def task_ends(human: Human) -> dict[int, str]:
    """Return the names of the tasks by the index of the goal at which each ends, as `decode` numbers the goals."""
    return _goals(human)[2]


def _goals(human: Human) -> tuple[list[str], list[float], dict[int, str], float]:
    """Return the goals, the pause at each, the tasks by the goal at which they end, and the pause at the start."""
    names: list[str] = []
    pauses: list[float] = []
    ends: dict[int, str] = {}
    at_start = 0.0
    for number, task in enumerate(human.tasks):
        waiting: dict[str, float] = {}
        for pause in task.pauses:
            waiting[pause.at] = waiting.get(pause.at, 0.0) + pause.duration_s
        for position, name in enumerate(task.path):
            if not names or names[-1] != name:
                names.append(name)
                pauses.append(0.0)
            held = waiting.pop(name, 0.0)
            pauses[-1] += held
            if number == position == 0:
                at_start = held
        ends[len(names) - 1] = task.name
    if human.cyclic and len(names) > 1 and names[-1] == names[0]:
        pauses[0] += pauses.pop()
        names.pop()
        ends = {index % len(names): name for index, name in ends.items()}
    return names, pauses, ends, at_start


def _agent(human: Human, grid: Grid, body_radius_m: float) -> HumanAgent:
    radius = body_radius_m if human.radius_m is None else human.radius_m
    names, pauses, _, at_start = _goals(human)
    if not human.cyclic:
        pauses[-1] = FOREVER_S
    goals = tuple(human.points[name] if name in human.points else grid.position(name) for name in names)
    return HumanAgent(
        name=human.name,
        start=human.track.points[0] if human.track is not None else human.start or goals[0],
        goals=goals,
        pauses_s=tuple(pauses),
        start_pause_s=at_start,
        speed_m_s=human.speed_m_s,
        radius_m=radius,
        goal_radius_m=human.goal_radius_m,
        behaviour=human.behaviour,
        reaction=human.reaction or reaction_of(human.behaviour, human.speed_m_s),
        factors=human.factors,
        group=human.group,
        start_delay_s=human.start_delay_s,
        outline=outline_of(human.kind, human.trolley, radius),
        attention=human.attention,
        track=human.track,
    )
