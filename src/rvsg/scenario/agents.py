"""People in coordinates, as a simulator moves them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rvsg.core.records import Record
from rvsg.scenario.scenario import (
    GOAL_RADIUS_M,
    Behaviour,
    ForceFactors,
    Human,
    HumanConfiguration,
    Outline,
    Point,
    Reaction,
)
from rvsg.world.grid import Grid

FOREVER_S = 36_000.0
"""The pause of a person who stays; longer than any run."""


def reaction_of(behaviour: Behaviour, speed_m_s: float) -> Reaction:
    """HuNavSim's default reaction of a behaviour; `speed_m_s` is the human's walking speed."""
    if behaviour is Behaviour.SURPRISED:
        return Reaction(duration_s=30.0, distance_m=4.0)
    if behaviour is Behaviour.SCARED:
        return Reaction(duration_s=40.0, speed_m_s=0.6, distance_m=3.0, force=20.0)
    if behaviour is Behaviour.CURIOUS:
        return Reaction(duration_s=40.0, speed_m_s=speed_m_s, distance_m=1.5)
    if behaviour is Behaviour.THREATENING:
        return Reaction(duration_s=40.0, distance_m=1.4)
    return Reaction()


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
    radius_m: float = 0.4
    goal_radius_m: float = GOAL_RADIUS_M
    """A goal counts as reached from this near."""
    behaviour: Behaviour = Behaviour.REGULAR
    reaction: Reaction = Reaction()
    factors: ForceFactors | Literal["random_normal", "random_uniform"] = ForceFactors()
    group: int | None = None
    start_delay_s: float = 0.0
    outline: Annotated[Outline, Field(exclude_if=lambda outline: not outline)] = ()
    """Corners of what the person sits in or pushes, in the person's frame."""

    @property
    def stays(self) -> bool:
        """Return whether the person stays at the last goal; otherwise the goals are walked again from the first."""
        return self.pauses_s[-1] >= FOREVER_S


def decode(people: HumanConfiguration, grid: Grid) -> tuple[HumanAgent, ...]:
    """Return the people in coordinates; raises UnknownName for a waypoint that the grid does not know.

    The goals of a person are the waypoints of all tasks in order. Where a task starts at the waypoint at which the one
    before ended, that waypoint is one goal, not two, and its pause is held once: the sum of what both tasks ask for.
    A person pauses at the start of the run only if the first task asks for a pause at its first waypoint. The pause
    at the end of the last task is held when the person comes back there. A person whose tasks are
    not cyclic stays at the last goal.
    """
    return tuple(_agent(human, grid) for human in people.humans)


def goal_names(human: Human) -> tuple[str, ...]:
    """Return the names of a person's goals, in the order in which `decode` numbers them."""
    return tuple(_goals(human)[0])


def task_ends(human: Human) -> dict[int, str]:
    """Return the names of the tasks by the index of the goal at which each ends, as `decode` numbers the goals."""
    return _goals(human)[1]


def _goals(human: Human) -> tuple[list[str], dict[int, str]]:
    names: list[str] = []
    ends: dict[int, str] = {}
    for task in human.tasks:
        for name in task.path:
            if not names or names[-1] != name:
                names.append(name)
        ends[len(names) - 1] = task.name
    if human.cyclic and len(names) > 1 and names[-1] == names[0]:
        names.pop()
        ends = {index % len(names): name for index, name in ends.items()}
    return names, ends


def _agent(human: Human, grid: Grid) -> HumanAgent:
    names: list[str] = []
    pauses: list[float] = []
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
    if not human.cyclic:
        pauses[-1] = FOREVER_S
    elif len(names) > 1 and names[-1] == names[0]:
        pauses[0] += pauses.pop()
        names.pop()
    goals = tuple(human.points[name] if name in human.points else grid.position(name) for name in names)
    return HumanAgent(
        name=human.name,
        start=human.start or goals[0],
        goals=goals,
        pauses_s=tuple(pauses),
        start_pause_s=at_start,
        speed_m_s=human.speed_m_s,
        radius_m=human.radius_m,
        goal_radius_m=human.goal_radius_m,
        behaviour=human.behaviour,
        reaction=human.reaction or reaction_of(human.behaviour, human.speed_m_s),
        factors=human.factors,
        group=human.group,
        start_delay_s=human.start_delay_s,
        outline=human.outline,
    )
