"""Brief and Feedback: what a generator is asked for, and what the last attempt measured."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rvsg.core.records import Record
from rvsg.scenario.requirement import Aim, Requirement
from rvsg.scenario.scenario import Mission, Scenario


class Moment(Record):
    """A decisive moment of a run: when, where the robot was, who was how near, what the measure did."""

    time_s: float
    robot_at: str
    humans_at: dict[str, str]
    closest_human: str
    gap_m: float
    robot_speed_m_s: float
    note: str = ""


class HumanInfluence(Record):
    """What one human contributed: closest gap, share of the time within 2 m, waypoints that never met the robot."""

    name: str
    closest_gap_m: float
    share_within_2_m: float
    idle_waypoints: tuple[str, ...] = ()


class Sample(Record):
    """One row of the time series of a run: time, waypoints of robot and humans, the measured value."""

    time_s: float
    robot_at: str
    humans_at: dict[str, str]
    value: float | None = None


TuningLimits = Annotated[dict[str, dict[str, tuple[float, float] | None]], Field(exclude_if=lambda limits: not limits)]
"""What an optimiser may change of people: name, number, range; None: it is fixed. What is not named is free."""

Coordinate = Annotated[float | None, Field(exclude_if=lambda value: value is None)]
"""Metres in the world's frame; None: not known."""


class PersonAt(Record):
    """One person at one moment, as seen from the robot."""

    at: str
    """Nearest waypoint."""
    doing: str
    """`waiting to start`, `walking leg 3 of 12`, `pausing`, `reacting to the robot`, `standing still` or `stuck`."""
    side: str
    """`ahead`, `left`, `right` or `behind` of the robot."""
    distance_m: float
    """Distance of the centres."""
    x: Coordinate = None
    y: Coordinate = None


class Row(Record):
    """One line of the table of a run: robot, everybody, and the value that is judged."""

    time_s: float
    robot_at: str
    people: dict[str, PersonAt]
    value: float | None = None
    x: Coordinate = None
    y: Coordinate = None


class Arrival(Record):
    """When a person reaches a waypoint for the first time, and when free walking at full speed would get there."""

    at: str
    time_s: float
    unhindered_s: float


class Touched(Record):
    """A touch of the robot and a person."""

    who: str
    at: str
    """The waypoint nearest to the place."""
    time_s: float
    until_s: float
    moved_by: Literal["robot", "person", "both", "neither"]
    """Who moved into whom."""
    responsible: Annotated[str, Field(exclude_if=lambda words: not words)] = ""
    """Who is responsible, in words; empty in old recordings."""


class Stop(Record):
    """The robot stands on its way."""

    time_s: float
    until_s: float
    at: str
    """The nearest waypoint."""
    reason: Literal[
        "contact",
        "obstacle_contact",
        "person_ahead",
        "person_close",
        "person_near",
        "goal_taken",
        "obstacle",
        "recovery",
        "unknown",
    ]
    """What holds it up for most of the time. `goal_taken`: somebody stands on its goal. `person_near` is in old
    recordings only."""
    who: str = ""
    """The person of the reason; else empty."""
    because: Annotated[str, Field(exclude_if=lambda words: not words)] = ""
    """The reason in words; empty in old recordings."""


class Reacted(Record):
    """A person begins to react to the robot."""

    who: str
    behaviour: str
    time_s: float
    until_s: float
    x: float
    """Of the person, metres in the world's frame."""
    y: float
    distance_m: float
    """To the robot, of the centres."""


class Passing(Record):
    """A person near the robot: how they come, and on which side of it they are at the smallest gap."""

    time_s: float
    """When the gap is smallest."""
    at: str
    """The waypoint nearest to the robot."""
    who: str
    how: str
    """`head-on`, `crossing from the left`, `person stands`, ..."""
    left: bool
    """On the robot's left; else on its right."""
    gap_m: float
    """The smallest gap between the bodies."""


class Part(Record):
    """A part of the drive and the mean of the judged value in it."""

    start_s: float
    end_s: float
    mean: float


class Tried(Record):
    """A configuration of the scenario that was measured, and what it changed in one line."""

    mean: float
    change: str
    runs: int = 0
    """Runs that the mean is of; 0: not known."""
    violations: int | None = None
    """How many of them violate the requirement; None: not known, or there is no limit."""
    best_of: int = 0
    """0: written by the generator. Else tuned, the best of so many forms."""
    number: Annotated[int | None, Field(exclude_if=lambda number: number is None)] = None
    """The attempt that measured it first; None: not known."""
    made_from: Annotated[int | None, Field(exclude_if=lambda number: number is None)] = None
    """The number of the configuration that `change` compares with; None: nothing."""
    objectives: Annotated[tuple[float, ...], Field(exclude_if=lambda values: not values)] = ()
    """The value of each run."""
    estimate: Annotated[float | None, Field(exclude_if=lambda estimate: estimate is None)] = None
    """What the race expects of further runs, by which configurations are ordered; None: the mean orders them."""
    margin: Annotated[float | None, Field(exclude_if=lambda margin: margin is None)] = None
    """Half-width of the 90 % interval of the estimate."""
    repeats: Annotated[int, Field(exclude_if=lambda count: count == 0)] = 0
    """So many later answers differ only in what acts after the end of the drive; their runs count here."""
    rehearsed: Annotated[tuple[tuple[float, str], ...], Field(exclude_if=lambda values: not values)] = ()
    """The values of its rehearsals before the generator changed it, and what changed then."""


class Tuning(Record):
    """What a strategy made of a configuration that the generator wrote, by trying other numbers."""

    forms: int
    """How many forms of it with other numbers were run."""
    mean: float
    """The mean of the configuration as written."""
    runs: int
    """Runs that it is of."""
    change: str = ""
    """What differs in the best of the forms, in one line; empty where none is better than what was written."""
    origin: Annotated[Tried | None, Field(exclude_if=lambda origin: origin is None)] = None
    """The configuration as written; None: not known."""


class Encounter(Record):
    """How a person and the robot meet at the closest approach of a run.

    Attributes:
        stretch: The third of the robot's way: `first third`, `middle third` or `last third`.
        place: The labelled area nearest to the robot.
        who: The person.
        kind: Where the person is and how they move, as seen from the robot.
    """

    stretch: str
    place: str
    who: str
    kind: str


def mechanism_of(met: Encounter) -> str:
    """Return how and where a person and the robot meet, in words."""
    return f"{met.kind}, at {met.place}"


class Feedback(Record):
    """What the last attempt of a scenario measured.

    `objectives` are the values of every repeat; `mean` and `interval` (95 % bootstrap) sum them up; `separable`
    says whether the change against the attempt before stands out of the noise (None: nothing to compare).
    `series_of` says in words what the values of `series` are.
    """

    scenario: Scenario
    objectives: tuple[float, ...]
    mean: float
    interval: tuple[float, float]
    violation_share: float | None = None
    previous_mean: float | None = None
    separable: bool | None = None
    moments: tuple[Moment, ...] = ()
    influences: tuple[HumanInfluence, ...] = ()
    series: tuple[Sample, ...] = ()
    series_of: str = "measured value"
    rows: tuple[Row, ...] = ()
    """The run that is worst for the robot, every two seconds."""
    parts: tuple[Part, ...] = ()
    least_room: Annotated[tuple[float, dict[str, float]] | None, Field(exclude_if=lambda room: room is None)] = None
    """When a formula has least room in that run, s, and the room of each of its parts there."""
    stops: tuple[Stop, ...] = ()
    """Where the robot stands in that run, and why."""
    reactions: Annotated[tuple[Reacted, ...], Field(exclude_if=lambda reactions: not reactions)] = ()
    """The reactions in that run."""
    passings: tuple[Passing, ...] = ()
    """The closest encounters of that run."""
    mildest: float | None = None
    """The value of the run that is least bad for the robot; None with a single run."""
    mildest_parts: tuple[Part, ...] = ()
    """The parts of that run."""
    mildest_rows: Annotated[tuple[Row, ...], Field(exclude_if=lambda rows: not rows)] = ()
    """That run every two seconds, where it does not violate the requirement and others do."""
    arrivals: dict[str, tuple[Arrival, ...]] = Field(default_factory=dict)
    arrival_s: float | None = None
    """When the robot arrives on average; None if it never does."""
    arrived: int = 0
    """Runs in which the robot arrives."""
    ends: Annotated[tuple[tuple[float, bool], ...], Field(exclude_if=lambda ends: not ends)] = ()
    """When each run ends, s, and whether the robot has arrived, in the order of the runs."""
    touched: int = 0
    """Runs in which the robot and a person touch."""
    touches: tuple[Touched, ...] = ()
    """All touches in the run that is worst for the robot."""
    touches_elsewhere: tuple[Touched, ...] = ()
    """The first touch of each other run that has one."""
    unusual: Annotated[str, Field(exclude_if=lambda words: not words)] = ""
    """What somebody does and the fewest recorded people do as far, if it is fewer than 1 in 100."""
    unusual_runs: Annotated[int, Field(exclude_if=lambda runs: runs == 0)] = 0
    """Runs in which somebody does what fewer than 1 in 100 recorded people did."""
    capped: int = 0
    """Runs whose value is only a bound: it is what the time limit leaves of it."""
    analysis: str = ""
    """What the generator thought when it wrote the configuration; empty if it said nothing, or the numbers were
    tuned since."""
    planned: dict[str, dict[str, float]] = Field(default_factory=dict)
    """When the generator meant each person to reach which waypoint, in seconds: name, waypoint, time."""
    limits: TuningLimits = Field(default_factory=dict)
    """What the generator lets an optimiser change."""
    tuned: bool = False
    """Whether a strategy tuned the numbers of the configuration after the generator wrote it."""
    tuning: Tuning | None = None
    """What was tuned, and what the configuration measured as it was written; None where it is not known."""
    best: Scenario | None = None
    """The configuration of the scenario that is worst for the robot so far, where `scenario` is not as bad for it."""
    best_mean: float | None = None
    """The mean of the configuration that is worst for the robot so far, of all that `tried` lists."""
    best_runs: int = 0
    """Runs that it is of; 0: not known."""
    standing: Annotated[Tried | None, Field(exclude_if=lambda standing: standing is None)] = None
    """Where the configuration stands in the order of its scenario; None: not known."""
    untried: Annotated[tuple[float, ...], Field(exclude_if=lambda values: not values)] = ()
    """The means of the configurations of the scenario that `tried` leaves out."""
    weaker: Annotated[Feedback | None, Field(exclude_if=lambda weaker: weaker is None)] = None
    """What the last configuration that a model wrote for the scenario measured, where `scenario` is another one that is
    worse for the robot; else None."""
    encounter: Encounter | None = None
    """Of the run that is worst for the robot; None without people, or where it was not looked at."""
    tried: tuple[Tried, ...] = ()
    """Measured configurations of the scenario in their order, the worst for the robot first."""


class Remembered(Record):
    """An earlier scenario of the campaign: its description, best configuration and how that did."""

    description: str
    tasks: dict[str, tuple[str, ...]]
    mean: float
    interval: tuple[float, float]
    scenario: Scenario
    lesson: str = ""
    """What its generator learnt from it, in its own words; empty if it said nothing."""
    capped: int = 0
    """Runs of the best configuration whose value is only a bound, as the time limit cuts it off."""
    runs: int = 0
    """Runs of the best configuration; 0: not known."""
    mechanism: Annotated[str, Field(exclude_if=lambda words: not words)] = ""
    """How and where its closest approach is, in words; empty where it is not known."""


class Brief(Record):
    """What a generator is asked for: one configuration.

    `kind` is "new" (a new scenario that differs from `memory`) or "refine" (better tasks and paths for the
    scenario of `feedback`, whose idea stays). Kind "tune" never reaches a generator: it labels a configuration whose
    numbers a strategy chose itself. An unguided brief has no requirement, feedback or memory.
    `seed` feeds every random choice of the generator. `scenario_index` and `configuration_index` count from 0.
    """

    mission: Mission
    requirement: Requirement | None
    aim: Aim | None = None
    """What people should bring about; None: not declared."""
    moved_by: str = ""
    """One sentence on what makes the requirement worse; empty: not declared."""
    kind: Literal["new", "refine", "tune"] = "new"
    humans: Annotated[int, Field(ge=1, le=100)] = 2
    seed: Annotated[int, Field(ge=0)]
    scenario_index: Annotated[int, Field(ge=0)] = 0
    configuration_index: Annotated[int, Field(ge=0)] = 0
    feedback: Feedback | None = None
    memory: tuple[Remembered, ...] = ()
    untold: Feedback | None = None
    """What the last configuration before a new scenario measured, where no refinement was told of it."""
    lessons: tuple[str, ...] = ()
    """What the generator learnt from the other scenarios, for a refinement."""
    tunes: bool = False
    """Whether the strategy tunes the numbers of the configuration afterwards."""
