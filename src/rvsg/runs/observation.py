"""Observation of one run: what people do, where the robot stands and whom it passes, and how it fails.

Two configurations show the same failure where the closest approach happens at the same place, the person stands or
walks in the same way as seen from the robot, and the robot does the same.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rvsg.core.records import Record
from rvsg.evaluation.detection import contacts, encounters_of, standstills
from rvsg.evaluation.realism import Motion, motions, rarest
from rvsg.evaluation.sampled import sampled, stretches
from rvsg.evaluation.story import standing_because
from rvsg.scenario.brief import Arrival, Encounter, Passing, Stop, Touched
from rvsg.scenario.scenario import Human, HumanAgent, HumanConfiguration, decode, goal_names
from rvsg.simulation.events import PersonPaused, PersonReached, PersonReacted, Side, in_order, responsible_in_words
from rvsg.simulation.run import Outcome, Run
from rvsg.world.grid import Grid
from rvsg.world.world import World

WINDOW_S = 1.5
"""What the robot does is looked at this long before and after the closest approach."""
STANDS_M_S, STOPS_M_S = 0.15, 0.05
"""A person slower than this stands; a robot slower than this has stopped."""
ALONG, AGAINST = math.radians(45.0), math.radians(135.0)
"""Below the first angle a person is ahead of the robot, or walks along; above the second behind it, or towards it."""
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
SHORT = {
    "stands": "Standing {side} the robot",
    "walks the same way": "Walking along {side} the robot",
    "comes towards it": "Oncoming {side} the robot",
    "crosses its way": "Crossing {side} the robot",
}
"""The same as the beginning of a name."""
TOUCHES = "touches the person"
INTO: dict[Side | None, str] = {
    "robot": "drives into the person",
    "person": "is walked into",
    "shared": "collides with the person",
    None: TOUCHES,
}
"""How the name of a failure with contact says who is responsible."""


class FailureMode(Record):
    """A way in which the robot fails."""

    place: str
    """Where the robot is at the closest approach, as `place_name` names it."""
    person: str
    """Where the person is and how they move, as seen from the robot."""
    robot: str
    """What the robot does."""

    @property
    def words(self) -> str:
        """The failure in one sentence."""
        return f"At the closest approach, near {self.place}, a person {met(self.person)}; the robot {self.robot}."

    def name(self, responsible: Side | None = None) -> str:
        """Return a name, e.g. "Standing beside the robot at Shelf 5, it stops".

        Args:
            responsible: Who is where robot and person touch; two runs in which that differs show the same failure.
        """
        return f"{met(self.person, SHORT)} at {self.place}, it {self.robot.replace(TOUCHES, INTO[responsible])}"


def met(kind: str, words: Mapping[str, str] = MOVES) -> str:
    """Return how a person is met in words that name the robot, e.g. "crosses the robot's way, ahead of it"."""
    for side in SIDES:
        if kind.endswith(f" {side} it"):
            return words.get(kind.removesuffix(f" {side} it"), kind).format(side=side)
    return kind


def mode_of(run: Run, world: World) -> FailureMode | None:
    """Return how a run fails, from its closest approach; None for a run without people."""
    path = run.trajectory
    s = sampled(run, world)
    if s.closest_approach is None:
        return None
    index, human = s.closest_approach
    touch = next((t for t in s.contacts if t.person == human and t.first <= index <= t.last), None)
    return FailureMode(
        place=world.place_name(float(path.x[index]), float(path.y[index])),
        person=_person(run, index, human),
        robot=_robot(run, index if touch is None else touch.first, touched=touch is not None),
    )


def usual(modes: Iterable[FailureMode | None]) -> FailureMode | None:
    """Return the most frequent of some failures, the first of equals; None where there is none."""
    counted = Counter(mode for mode in modes if mode is not None)
    return counted.most_common(1)[0][0] if counted else None


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
    bearing, heading = (abs(math.remainder(math.atan2(y, x) - yaw, 2.0 * math.pi)) for x, y in (apart, velocity))
    side = "ahead of it" if bearing < ALONG else "behind it" if bearing > AGAINST else "beside it"
    if math.hypot(*velocity) < STANDS_M_S:
        return f"stands {side}"
    if heading < ALONG:
        return f"walks the same way {side}"
    return f"comes towards it {side}" if heading > AGAINST else f"crosses its way {side}"


def _robot(run: Run, index: int, *, touched: bool) -> str:
    """Return what the robot does then, or before it touches somebody; to set off or arrive is no stop."""
    path, arrived = run.trajectory, run.outcome is Outcome.REACHED
    moving = path.speed[path.speed > STOPS_M_S]
    usual = float(np.median(moving)) if len(moving) else 0.0
    going = np.flatnonzero(path.speed > SLOWS_TO * usual)
    first, last = (going[0], going[-1] if arrived else len(path) - 1) if len(going) else (0, len(path) - 1)
    until = path.t[index] + (0.0 if touched else WINDOW_S)  # contact stops it
    near = (path.t >= path.t[index] - WINDOW_S) & (path.t <= until)
    slowest = float(path.speed[first : last + 1][near[first : last + 1]].min(initial=np.inf))
    if index < first or index > last:
        did = ["sets off" if index < first else "arrives"]
    else:
        did = ["stops" if slowest < STOPS_M_S else "slows down" if slowest < SLOWS_TO * usual else "drives on"]
    if touched:
        did = [what for what in did if what != "drives on"] + [TOUCHES]
    if not arrived:
        did.append("does not arrive")
    return " and ".join([", ".join(did[:-1]), did[-1]] if len(did) > 1 else did)


OfWalk = PersonReached | PersonPaused | PersonReacted
NEAR_M = 2.0
"""A person nearer than this may influence how the robot drives (the inflation and the social zone end before it)."""
REACHED_M = 0.6
"""Somebody who is farther than this from the place of the start has left it."""
MARGIN_M, PASSED_M = 0.1, 0.8
"""A waypoint counts as reached from the goal radius plus the first, or beyond it within the second."""
STILL_M_S, STOOD_S, STUCK_S = 0.1, 2.0, 5.0
"""Somebody who should walk and is slower than the first for longer than the second stands still.

Who does so for longer than the third, until the run ends, is stuck.
"""


@dataclass(frozen=True)
class Walk:
    """The walk of one person along the waypoints of their tasks."""

    begins_at: str
    """The waypoint of the start."""
    doing: tuple[str, ...]
    """What the person does at every sample; a reaction only where the simulator records it."""
    arrivals: tuple[Arrival, ...]
    """When the person reaches each waypoint for the first time, and when unhindered walking would."""
    stuck_at: tuple[float, str] | None
    """Since when and where the person stands still until the run ends; None for who walks on."""
    left_s: float | None
    """When the person leaves the place of the start; None if never."""
    stood: tuple[tuple[float, float, str], ...]
    """From when to when and where somebody who should walk stands still, and then walks on."""


def walks_of(run: Run, people: HumanConfiguration, grid: Grid) -> tuple[Walk, ...]:
    """Follow everybody of a run, in the order of the configuration."""
    return tuple(_walk_of(run, h, human, grid) for h, human in enumerate(people.humans))


def _walk_of(run: Run, h: int, human: Human, grid: Grid) -> Walk:
    (agent,) = decode(HumanConfiguration(humans=(human,)), grid)
    times, xs, ys = run.trajectory.t, run.trajectory.human_x[:, h], run.trajectory.human_y[:, h]
    reached, doing = _followed(times, xs, ys, agent, [e for e in run.events if isinstance(e, OfWalk)], human.name)
    still = np.array([what.startswith("walking") for what in doing], np.bool_) & (_speed(times, xs, ys) < STILL_M_S)
    stood, stuck_at = [], None
    for first, last in stretches(still):
        if times[last] - times[first] < STOOD_S or len(agent.goals) < 2:
            continue
        place = grid.nearest(float(xs[first]), float(ys[first]))
        stuck = last == len(times) - 1 and times[last] - times[first] >= STUCK_S
        doing[first : last + 1] = ["stuck" if stuck else "standing still"] * (last + 1 - first)
        if stuck:
            stuck_at = (float(times[first]), place)
        else:
            stood.append((float(times[first]), float(times[last]), place))
    away = np.flatnonzero(np.hypot(xs - agent.start[0], ys - agent.start[1]) > REACHED_M)
    names, n, clock, arrivals = goal_names(human), len(agent.goals), human.start_delay_s, []
    for k, time in enumerate(reached[:n]):
        k_next = (k + 1) % n
        clock += math.dist(agent.goals[k], agent.goals[k_next]) / human.speed_m_s
        arrivals.append(Arrival(at=names[k_next], time_s=round(time, 1), unhindered_s=round(clock, 1)))
        clock += agent.pauses_s[k_next]
    return Walk(
        begins_at=names[0],
        doing=tuple(doing),
        arrivals=tuple(arrivals),
        stuck_at=stuck_at,
        left_s=float(times[int(away[0])]) if away.size else None,
        stood=tuple(stood),
    )


def _followed(
    times: NDArray[np.float64],
    xs: NDArray[np.float64],
    ys: NDArray[np.float64],
    agent: HumanAgent,
    events: Sequence[OfWalk],
    name: str,
) -> tuple[list[float], list[str]]:
    """Return the times at which goals are reached, and what the person does at every sample, though perhaps held up.

    A simulator that records what people do knows the arrivals of the first round and all pauses. What it does not
    record is read off the trajectory.
    """
    n = len(agent.goals)
    own = [event for event in events if event.person == name]
    seen = {e.goal: e.time_s for e in own if isinstance(e, PersonReached)}
    pauses = [e for e in own if isinstance(e, PersonPaused)]
    reactions = [e for e in own if isinstance(e, PersonReacted)]
    ahead = deque(pauses)
    reached: list[float] = []
    doing: list[str] = []
    for t, x, y in zip(times.tolist(), xs.tolist(), ys.tolist(), strict=True):  # plain numbers make the loop faster
        while (arrival_s := seen.get(len(reached) + 1)) is not None and arrival_s <= t:
            reached.append(arrival_s)
        while ahead and ahead[0].time_s <= t:
            pause = ahead.popleft()
            while len(reached) % n != pause.goal:
                reached.append(pause.time_s)
        free = t >= _since(agent, reached) + _held(agent, reached)
        if n > 1 and (not seen or len(reached) + 1 >= n) and free and _arrives((x, y), agent, len(reached)):
            reached.append(t)
        since, held = _since(agent, reached), _held(agent, reached)
        unrecorded = not seen and not pauses and held and t <= since + held + 1.5
        if any(e.time_s <= t <= e.until_s for e in reactions):
            doing.append("reacting to the robot")
        elif t < agent.start_delay_s:
            doing.append("waiting to start")
        elif unrecorded or any(e.time_s <= t <= e.until_s for e in pauses):
            doing.append("pausing")
        else:
            doing.append(f"walking leg {len(reached) % n + 1} of {n}")
    return reached, doing


def _since(agent: HumanAgent, reached: Sequence[float]) -> float:
    return reached[-1] if reached else agent.start_delay_s


def _held(agent: HumanAgent, reached: Sequence[float]) -> float:
    return agent.pauses_s[len(reached) % len(agent.goals)] if reached else agent.start_pause_s


def _arrives(at: tuple[float, float], agent: HumanAgent, count: int) -> bool:
    """Return whether somebody who has reached `count` goals turns to the one after the next, as simulated people do."""
    n = len(agent.goals)
    before, goal = agent.goals[count % n], agent.goals[(count + 1) % n]
    away = math.dist(at, goal)
    if away <= agent.goal_radius_m + MARGIN_M:
        return True
    beyond = (at[0] - goal[0]) * (goal[0] - before[0]) + (at[1] - goal[1]) * (goal[1] - before[1]) > 0.0
    return beyond and away <= PASSED_M and not agent.pauses_s[(count + 1) % n]


def side_of(run: Run, k: int, h: int) -> str:
    """Return on which side of the robot person `h` is at sample `k`."""
    bearing = bearing_of(run, k, h)
    if abs(bearing) < ALONG:
        return "ahead"
    return "behind" if abs(bearing) > AGAINST else "left" if bearing > 0.0 else "right"


def bearing_of(run: Run, k: int, h: int) -> float:
    """Return the direction of person `h` off the robot's heading at sample `k`, rad; positive to the left."""
    path = run.trajectory
    towards = math.atan2(float(path.human_y[k, h] - path.y[k]), float(path.human_x[k, h] - path.x[k]))
    return math.remainder(towards - float(path.yaw[k]), 2.0 * math.pi)


def _speed(t: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    before = np.searchsorted(t, t - 0.25)
    after = np.minimum(len(t) - 1, np.searchsorted(t, t + 0.25))
    moved = np.hypot(x[after] - x[before], y[after] - y[before])
    return np.asarray(moved / np.maximum(t[after] - t[before], 1e-6))


MOST_PASSINGS = 6


def stops_of(run: Run, world: World) -> tuple[Stop, ...]:
    """Return where the robot stands on its way for at least a second, and why, in order."""
    return tuple(
        Stop(
            time_s=round(stand.time_s, 1),
            until_s=round(stand.until_s, 1),
            at=stand.waypoint,
            reason=stand.reason,
            who=stand.person,
            because=standing_because(stand),
        )
        for stand in standstills(sampled(run, world))
    )


def passings_of(run: Run, world: World) -> tuple[Passing, ...]:
    """Return the closest encounters of a run in order of time, each with the side of the robot the person is on."""
    closest = sorted(encounters_of(run, world=world), key=lambda encounter: encounter.gap_m)[:MOST_PASSINGS]
    times, names = run.trajectory.t, run.human_names
    return tuple(
        Passing(
            time_s=round(met.time_s, 1),
            at=met.waypoint,
            who=met.person,
            how=met.kind.value,
            left=bearing_of(run, int(times.searchsorted(met.time_s - 1e-3)), names.index(met.person)) > 0.0,
            gap_m=round(met.gap_m, 2),
        )
        for met in in_order(closest)
    )


STRETCHES = ("first third", "middle third", "last third")


@dataclass(frozen=True)
class PersonObservation:
    """One person in a run."""

    name: str
    closest_gap_m: float
    share_near: float
    """Share of the time within `NEAR_M`."""
    met: Mapping[str, float]
    """The smallest gap at each waypoint that the person was nearest to, m."""
    reached: int | None
    """Index of the last goal that the person reached in their first round; None: not recorded, or the round is over."""
    reached_before: int | None
    """The same before the closest approach of anybody and the robot."""


@dataclass(frozen=True)
class RunObservation:
    """What a search asks of a run besides its metrics.

    It is made where the run is made: a worker has all of the run at hand, the campaign would have to unpack it.
    """

    run_id: str
    completed: bool
    ended_s: float
    mode: FailureMode | None
    """How it fails if it does."""
    encounter: Encounter | None
    """What it shows at the closest approach; None without people."""
    people: tuple[PersonObservation, ...]
    touches: tuple[Touched, ...]
    rarest: Motion | None
    """What the fewest recorded people do as far; None without people."""


def observe(run: Run, world: World) -> RunObservation:
    """Return what a search asks of a run."""
    path, s = run.trajectory, sampled(run, world)
    gap, step = s.gap, max(1, len(path) // 400)
    closest_s = float(path.t[s.closest_approach[0]]) if s.closest_approach is not None else math.inf
    reached, before, people = _reached(run), _reached(run, closest_s), []
    for h, name in enumerate(run.human_names):
        met: dict[str, float] = {}
        at = world.nearest_waypoints(path.human_x[::step, h], path.human_y[::step, h])
        for place, distance in zip(at, gap[::step, h].tolist(), strict=True):
            met[place] = min(met.get(place, math.inf), distance)
        closest, near = (float(gap[:, h].min()), float((gap[:, h] < NEAR_M).mean())) if len(path) else (math.inf, 0.0)
        people.append(PersonObservation(name, closest, near, met, reached[name], before[name]))
    mode = mode_of(run, world)
    return RunObservation(
        run_id=run.id,
        completed=run.completed,
        ended_s=float(path.t[-1]) if len(path) else 0.0,
        mode=mode,
        encounter=_encounter(run, mode),
        people=tuple(people),
        touches=touches_of(run, world),
        rarest=rarest(motions(run)),
    )


def _reached(run: Run, until_s: float = math.inf) -> dict[str, int | None]:
    """Return the goal that each person reached last until then; None in a run that records no arrival of anybody."""
    events = [event for event in run.events if isinstance(event, PersonReached)]
    timely = [event for event in events if event.time_s <= until_s]
    goals = {name: [event.goal for event in timely if event.person == name] for name in run.human_names}
    return {name: None if 0 in own or not events else max(own, default=0) for name, own in goals.items()}


def acting(people: HumanConfiguration, grid: Grid, reached: Mapping[str, int]) -> tuple[HumanAgent, ...]:
    """Return what of a configuration acts until a run ends in which people reach these goals and no later one.

    On the way to the next goal a person slows down for a turn or a pause there, of any length. People who are missing
    in `reached` may do all of it.
    """
    agents = []
    for agent in decode(people, grid):
        last = reached.get(agent.name)
        if last is not None and last + 2 < len(agent.goals):
            pauses = (0.0, *agent.pauses_s[1 : last + 1], float(agent.pauses_s[last + 1] > 0.0))
            agent = agent.model_copy(update={"goals": agent.goals[: last + 3], "pauses_s": pauses})
        agents.append(agent)
    return tuple(agents)


def encounter_of(run: Run, world: World) -> Encounter | None:
    """Return the encounter at the closest approach of a run; None for a run without people."""
    return _encounter(run, mode_of(run, world))


def _encounter(run: Run, mode: FailureMode | None) -> Encounter | None:
    if mode is None:
        return None
    path = run.trajectory
    gap = sampled(run).disc_gap  # by discs, as in the archives and recorded conversations of earlier campaigns
    index, human = (int(k) for k in np.unravel_index(int(gap.argmin()), gap.shape))
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(path.x), np.diff(path.y)))])
    share = float(driven[index] / driven[-1]) if driven[-1] > 0.0 else 0.0
    return Encounter(
        stretch=STRETCHES[min(2, int(3.0 * share))], place=mode.place, who=run.human_names[human], kind=mode.person
    )


def touches_of(run: Run, world: World) -> tuple[Touched, ...]:
    """Return the touches of the robot and a person in a run, as events tell them, in order."""
    return tuple(
        Touched(
            who=contact.person,
            at=contact.waypoint,
            time_s=round(contact.time_s, 1),
            until_s=round(contact.until_s, 1),
            moved_by=contact.moved_by,
            responsible="" if contact.responsible is None else responsible_in_words(contact.responsible),
        )
        for contact in in_order(contacts(sampled(run, world)))
    )
