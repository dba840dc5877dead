"""Distinct failures: confirmed configurations grouped by where and how the robot fails, named in plain words.

Two configurations show the same failure where the closest approach happens at the same place, the person stands or
walks in the same way as seen from the robot, and the robot does the same.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from rvsg.campaign.attempt import Attempt, Ledger
from rvsg.campaign.ranking import in_full, measured, standing
from rvsg.core.records import Record
from rvsg.evaluation.naming import place_name
from rvsg.evaluation.sampled import sampled
from rvsg.scenario.requirement import Requirement
from rvsg.simulation.run import Outcome, Run
from rvsg.world.world import World

WINDOW_S = 1.5
"""What the robot does is looked at this long before and after the closest approach."""
STANDS_M_S, STOPS_M_S = 0.15, 0.05
"""A person slower than this stands; a robot slower than this has stopped."""
ALONG, AGAINST = math.radians(45.0), math.radians(135.0)
"""A person walks along with the robot below the first angle between the directions, towards it above the second."""
SLOWS_TO = 0.5
"""The robot slows down where it loses more than this share of its usual speed."""

SIDES = ("ahead of", "behind", "beside")
MOVES = {
    "stands": "stands {side} the robot",
    "walks the same way": "walks the same way as the robot, {side} it",
    "comes towards it": "walks the opposite way to the robot, {side} it",
    "crosses its way": "crosses the robot's way, {side} it",
}
"""What a person does, and how it reads with the side on which it happens."""


class FailureMode(Record):
    """A way in which the robot fails.

    Attributes:
        place: Where the robot is at the closest approach, as `place_name` names it.
        person: Where the person is and how they move, as seen from the robot.
        robot: What the robot does.
    """

    place: str
    person: str
    robot: str

    @property
    def words(self) -> str:
        """The failure in one sentence."""
        return f"At the closest approach, near {self.place}, a person {met(self.person)}; the robot {self.robot}."


def met(kind: str) -> str:
    """Return how a person is met in words that name the robot, e.g. "crosses the robot's way, ahead of it"."""
    for side in SIDES:
        if kind.endswith(f" {side} it"):
            return MOVES.get(kind.removesuffix(f" {side} it"), kind).format(side=side)
    return kind


def mode_of(run: Run, world: World) -> FailureMode | None:
    """Return how a run fails, from its closest approach; None for a run without people."""
    path = run.trajectory
    if len(path) == 0 or path.human_x.shape[1] == 0:
        return None
    seen = sampled(run, world)
    index, human = (int(i) for i in np.unravel_index(int(seen.gap.argmin()), seen.gap.shape))
    touched = any(touch.person == human and touch.first <= index <= touch.last for touch in seen.contacts)
    return FailureMode(
        place=place_name(world, float(path.x[index]), float(path.y[index])),
        person=_person(run, index, human),
        robot=_robot(run, index, touched=touched),
    )


def usual_mode(runs: Iterable[Run], world: World) -> FailureMode | None:
    """Return the failure that most of the runs show; the first of equals; None where there is none."""
    return usual(mode_of(run, world) for run in runs)


def usual(modes: Iterable[FailureMode | None]) -> FailureMode | None:
    """Return the most frequent of some failures, the first of equals; None where there is none."""
    counted = Counter(mode for mode in modes if mode is not None)
    return counted.most_common(1)[0][0] if counted else None


def modes_in(ledger: Ledger, world: World) -> Callable[[str], FailureMode | None]:
    """Return the function that tells how the run of an id fails: as it was seen when it was made, else as stored."""
    look: Callable[[str], Any] = getattr(ledger, "look", lambda _: None)

    def mode(run_id: str) -> FailureMode | None:
        seen = look(run_id)
        found: FailureMode | None = seen.mode if seen is not None else mode_of(ledger.run(run_id), world)
        return found

    return mode


def candidates(
    attempts: Sequence[Attempt], requirement: Requirement, kind_of: Callable[[Attempt], FailureMode | None]
) -> list[Attempt]:
    """Return the attempts worth confirming: those that violated the requirement, one of every kind of failure first.

    Within a kind, and among the first of each kind, those measured in full come first, then those that violate surely
    (2 of 2 runs say more than 1 of 1), then the worst for the robot.
    """
    full = {attempt.index for attempt in in_full(attempts)}
    violating = [a for a in measured(attempts) if a.verdict is not None and a.verdict.violations]
    violating.sort(key=lambda a: (a.index not in full, -_surely(a), -standing(a, requirement)[1], a.index))
    kinds: dict[FailureMode | None, int] = {}
    rank = []
    for attempt in violating:
        kind = kind_of(attempt)
        rank.append((kinds.get(kind, 0), attempt))
        kinds[kind] = kinds.get(kind, 0) + 1
    return [attempt for _, attempt in sorted(rank, key=lambda pair: pair[0])]


def _surely(attempt: Attempt) -> float:
    """The share of violations, pulled towards one half by one run of each kind."""
    assert attempt.verdict is not None
    return (attempt.verdict.violations + 1.0) / (attempt.verdict.runs + 2.0)


def _person(run: Run, index: int, human: int) -> str:
    """Return where the person is and how they move, as seen from the robot."""
    path = run.trajectory
    before = int(np.searchsorted(path.t, path.t[index] - 1.0))
    elapsed = max(float(path.t[index] - path.t[before]), 1e-6)
    vx = float(path.human_x[index, human] - path.human_x[before, human]) / elapsed
    vy = float(path.human_y[index, human] - path.human_y[before, human]) / elapsed
    apart = (float(path.human_x[index, human] - path.x[index]), float(path.human_y[index, human] - path.y[index]))
    return seen_as(apart, (vx, vy), float(path.yaw[index]))


def seen_as(apart: tuple[float, float], velocity: tuple[float, float], yaw: float) -> str:
    """Return where a person is and how they move, as seen from a robot with this yaw (rad).

    Args:
        apart: From the robot to the person, m.
        velocity: Of the person, m/s.
    """
    bearing = _angle(math.atan2(apart[1], apart[0]) - yaw)
    side = "ahead of it" if bearing < ALONG else "behind it" if bearing > AGAINST else "beside it"
    if math.hypot(*velocity) < STANDS_M_S:
        return f"stands {side}"
    heading = _angle(math.atan2(velocity[1], velocity[0]) - yaw)
    if heading < ALONG:
        return f"walks the same way {side}"
    return f"comes towards it {side}" if heading > AGAINST else f"crosses its way {side}"


def _robot(run: Run, index: int, *, touched: bool) -> str:
    """What the robot does around the closest approach."""
    path = run.trajectory
    window = (path.t >= path.t[index] - WINDOW_S) & (path.t <= path.t[index] + WINDOW_S)
    speed = path.speed
    slowest = float(speed[window].min())
    moving = speed[speed > STOPS_M_S]
    usual = float(np.median(moving)) if len(moving) else 0.0
    did = ["stops" if slowest < STOPS_M_S else "slows down" if slowest < SLOWS_TO * usual else "drives on"]
    if touched:
        did.append("touches the person")
    if run.outcome is not Outcome.REACHED:
        did.append("does not arrive")
    return " and ".join([", ".join(did[:-1]), did[-1]] if len(did) > 1 else did)


def _angle(angle: float) -> float:
    """The absolute value of an angle in (-pi, pi]."""
    return abs(math.remainder(angle, 2.0 * math.pi))
