"""People as arrays: their state, how it begins, and the buffer of events that compiled code fills."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import chain
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from rvsg.core.errors import InputError
from rvsg.core.kernels import inner
from rvsg.core.records import Record
from rvsg.core.seeds import stream
from rvsg.robots.polygons import reach, rectangle
from rvsg.robots.robot import DEFAULT_ROBOT, Robot, load_robot
from rvsg.scenario.scenario import Attention, Behaviour, ForceFactors, HumanAgent, Reaction
from rvsg.simulation.embedded.people.obstacles import Surfaces, boxes_of
from rvsg.simulation.embedded.people.ways import SPARE_M, find_ends
from rvsg.world.world import World

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


PERIOD_S = 0.1
"""People move every 0.1 s of simulated time (the study's HuNavSim ran at 10 Hz)."""
LEG_PERIOD_M = 1.2
EARLY_S = 0.2
PUBLISHED_START_S = (-0.115, -0.105)
PUBLISHED_EARLY_START = 0.21
"""When the study's people began: their first tick, which moves nobody but turns to the second waypoint. Read off the
positions of human 1, which follow from the number of ticks to within a millimetre as long as it is far from the
robot, in 515 published runs. The tick that first moves somebody comes 0 to 0.01 s before the first row, in the early
runs 0.2 s sooner; where a human stands on the robot, it decides on which side the human leaves."""
KINDS = 5
COLUMNS = 12
MOST_EVENTS = 50_000
REGULAR, IMPASSIVE, SURPRISED, SCARED, CURIOUS, THREATENING = range(1, 7)
CODES = {behaviour: code for code, behaviour in enumerate(Behaviour, start=1)}
"""How a behaviour is named in `Crowd.behaviour`: as above."""


KEEP_RIGHT_M = 0.05


class Anticipation(Record):
    """How people of the default profile anticipate, fitted to recorded people by `benchmarks/people.py`.

    Each person draws a clearance (between centres, log-normal), a horizon (log-normal), a speed (a share of the
    scenario's, normal), the period of the sway and a patience (log-normal). `first_s`: time to the closest approach at
    which a person has turned off in full. Where ways cross at a right angle, the clearance is larger by `crossing` of
    itself per cubic metre of it, and both times are longer by the share `earlier`. `headway_m`, `headway_s`,
    `headway_ahead_s`: the gap to who is ahead is `headway_m` and `headway_s` of walking, less `headway_ahead_s` of
    their walking.
    """

    clearance_m: float = 0.76
    clearance_spread: float = 0.45
    crossing: float = 9.5
    earlier: float = 0.45
    least_clearance_m: float = 0.6
    horizon_s: float = 3.2
    horizon_spread: float = 0.3
    first_s: float = 2.1
    relaxation_s: float = 0.42
    acceleration_m_s2: float = 1.5
    speed_share: float = 0.893
    speed_spread: float = 0.173
    speed_shares: tuple[float, float] = (0.5, 1.2)
    company_m_s: float = 0.04
    sway_rad: float = 0.05
    sway_s: float = 2.7
    keep_right_m: float = KEEP_RIGHT_M
    headway_m: float = 0.3
    headway_s: float = 0.5
    headway_ahead_s: float = 0.35
    formation_m: float = 0.7
    ahead_m: float = 3.0
    patience_s: float = 6.0
    patience_spread: float = 0.4


ATTENTION = {Attention.ATTENTIVE: 1.0, Attention.DISTRACTED: 0.35, Attention.UNSEEING: 0.0}
"""How far ahead people look, as a share of the horizon of somebody attentive."""


class PeopleOptions(Record):
    """How people are simulated.

    `anticipation`: people anticipate; None: they follow HuNavSim's social force.

    `published_defects` replicates HuNavSim as the published study ran it (docs/explanation/people.md lists the
    defects one by one). `factor_noise` scales the spread of drawn force factors (0: everybody has the mean).
    `start_jitter_s` bounds the uniform time at which people may begin to walk, the same for all of them in one run,
    measured from the run's first row; with the chance `early_start` they begin `EARLY_S` sooner (`beginning`).
    `leg_phase_noise` says whether people begin at a random point of their gait. A social force below
    `neglect_m_s2` per pair is left out; the published profile leaves out none.
    """

    published_defects: bool = False
    anticipation: Anticipation | None = None
    factor_noise: Annotated[float, Field(ge=0)] = 1.0
    start_jitter_s: tuple[float, float] = (0.0, 0.0)
    early_start: Annotated[float, Field(ge=0, le=1)] = 0.0
    leg_phase_noise: bool = True
    neglect_m_s2: Annotated[float, Field(ge=0)] = 1e-3

    @classmethod
    def published(cls) -> PeopleOptions:
        """HuNavSim as the published study ran it."""
        return cls(published_defects=True, start_jitter_s=PUBLISHED_START_S, early_start=PUBLISHED_EARLY_START)


class RobotState(NamedTuple):
    """The robot as people meet it: pose and velocity of its base frame in the world."""

    x: float
    y: float
    yaw: float
    vx: float
    vy: float


class Crowd(NamedTuple):
    """N people as arrays; a compiled loop reads and changes them in place. Metres, seconds, radians, world frame.

    x, y, vx, vy, yaw (N,): what a sensor sees now; `yaw` is the shown one. `walked` (N,): metres walked, with the
    gait's random phase, for the legs a lidar sees. `logged_*` (N,): what HuNavSim publishes, the state before the
    last tick. The other fields are parameters, goals, timers, obstacles and scratch space.
    """

    x: Floats
    y: Floats
    vx: Floats
    vy: Floats
    yaw: Floats
    walked: Floats
    logged_x: Floats
    logged_y: Floats
    logged_yaw: Floats
    logged_speed: Floats
    goals: Floats  # (N, G, 2), padded
    pauses: Floats  # (N, G) seconds
    goal_count: Ints
    goal_index: Ints
    ends: Ints  # (N, G) the goal at which the straight way to each ends
    pause_left: Floats
    start_time: Floats
    speed: Floats
    radius: Floats
    goal_radius: Floats  # a goal is reached from this near
    height: Floats  # of the point from which the obstacle search looks
    factor_goal: Floats
    factor_obstacle: Floats
    factor_social: Floats
    behaviour: Ints
    duration: Floats
    once: Ints
    react_speed: Floats
    react_distance: Floats
    react_force: Floats
    reacted: Floats  # accumulated reaction time
    expired: Ints
    group: Ints  # index of the group, -1 none
    group_sum: Floats  # (groups, 3): sum of x, sum of y, members
    old_x: Floats  # snapshot of the tick
    old_y: Floats
    old_vx: Floats
    old_vy: Floats
    push_x: Floats  # the sum of the other people's social forces in this tick
    push_y: Floats
    near_x: Floats  # ... and of members of the own group who stand too near
    near_y: Floats
    reach: Floats  # the exponent beyond which others do not push
    beyond: NDArray[np.bool_]  # scratch space: whose push is surely zero
    slow: Ints  # who is slower than people walk around, from the front; their number is `slow_count`
    slow_count: Ints
    pairs: Ints  # (N (N - 1) / 2, 2) people so near each other that they may touch, from the front
    paired_x: Floats  # where everybody was when the pairs were found
    paired_y: Floats
    obstacle_x: Floats
    obstacle_y: Floats
    obstacle_near: Ints  # 0 none, 1 outside it, -1 inside it
    cart: Floats  # (N, 4) from the nearest trolley or wheelchair to the body, and its velocity; zeros: none
    boxes: Floats  # (M, 6)
    origins: Floats  # (M, 3)
    segments: Floats  # (S, 4)
    nearest: NDArray[np.int32]  # (rows, columns)
    inside: NDArray[np.uint8]  # (rows, columns)
    raster_x: float
    raster_y: float
    published: bool
    anticipates: bool
    manner: Anticipation  # what all share; zeros where nobody anticipates
    clearance: Floats  # between centres, that the person likes
    horizon: Floats  # s, how far ahead the person looks
    sway: Floats  # phase, rad
    sway_rate: Floats  # rad/s
    patience: Floats  # s, for which a person waits for the robot before turning back
    back: Ints  # whether a person walks back to the waypoint before
    neglect: float
    robot_box: Floats  # (4,) rear, front, right, left side of the robot's body in its base frame
    robot_height: float
    robot_radius: float  # of the disc that people keep away from
    outline: Floats  # (K, 2) corners of the robot's body in its frame
    outline_reach: float  # of the farthest corner
    free: Floats  # (1,) how far the robot can go before it can touch somebody
    start_pause: Floats  # pause at the start, s; negative: it is over
    place_x: Floats  # where to stand
    place_y: Floats
    from_x: Floats  # where the line to the goal starts
    from_y: Floats
    best: Floats  # least distance from the goal so far
    idle: Floats  # seconds without progress
    squeeze: Floats  # 0 to 1: how far a person has turned sideways
    stands: Ints  # whether a person stands in this tick
    reacting: Ints
    cap: Floats  # speed limit of this tick
    reached: Floats  # (N, G) when a goal is reached first, NaN before
    events: Floats  # (E, COLUMNS), see `log`
    event_count: Ints  # rows that are used, events that found none
    open: Ints  # (N, KINDS) row of the present event, -1 none


def begins_early(chance: float, seed: int) -> bool:
    """Whether this is one of the runs in which people begin `EARLY_S` sooner than usual, before the first row."""
    return chance > 0.0 and bool(stream(seed, "people/early").random() < chance)


def beginning(options: PeopleOptions, seed: int) -> float:
    """When people may begin to walk in a run, seconds from the first row."""
    low, high = options.start_jitter_s
    time = float(stream(seed, "people/start").uniform(low, high)) if high > low else low
    return time - EARLY_S if begins_early(options.early_start, seed) else time


def initial(
    agents: Sequence[HumanAgent],
    world: World,
    *,
    options: PeopleOptions | None = None,
    seed: int,
    robot: Robot | None = None,
    time_limit_s: float = 120.0,
) -> Crowd:
    """Return everybody at the start.

    Draws factors, start jitter and gait phase from named streams of the run's seed.

    Args:
        robot: The robot they meet; None: the default robot.
        time_limit_s: Length of the run; it sets the room for events.

    Raises:
        InputError: A number is not finite. People standing in each other or in an obstacle are allowed.
    """
    options = options or PeopleOptions()
    robot = robot or load_robot(DEFAULT_ROBOT)
    (left, low), (right, high) = rectangle(robot.outline)
    n = len(agents)
    published = options.published_defects
    for agent in agents:
        if not all(map(math.isfinite, chain(agent.start, *agent.goals, agent.pauses_s))):
            raise InputError(
                f"human {agent.name!r} has a start, goal or pause that is not a finite number", code="agent-not-finite"
            )
    longest = max((len(agent.goals) for agent in agents), default=1)
    goals = np.zeros((n, longest, 2))
    pauses = np.zeros((n, longest))
    for i, agent in enumerate(agents):
        goals[i, : len(agent.goals)] = agent.goals
        pauses[i, : len(agent.goals)] = agent.pauses_s
    x, y = np.array([agent.start for agent in agents], dtype=np.float64).reshape(-1, 2).T
    drawn = [_drawn(agent, i if options.anticipation is None else agent.name, options, seed)
             for i, agent in enumerate(agents)]  # fmt: skip
    groups = sorted({agent.group for agent in agents if agent.group is not None})
    begin = beginning(options, seed)
    phase = _uniform(agents, options, seed, "people/gait", LEG_PERIOD_M) if options.leg_phase_noise else np.zeros(n)
    boxes, origins = boxes_of(world.solids) if published else (np.zeros((0, 6)), np.zeros((0, 3)))
    surfaces = None if published else _surfaces(world)
    ends = np.tile(np.arange(longest), (n, 1))
    if surfaces is not None and options.anticipation is not None:
        for i, agent in enumerate(agents):
            way = slice(len(agent.goals))
            find_ends(goals[i, way], pauses[i, way], surfaces.segments, surfaces.nearest, surfaces.inside, surfaces.x,
                      surfaces.y, agent.radius_m + SPARE_M, ends[i])  # fmt: skip
    yaw = np.array([_first_yaw(agent, published) for agent in agents], dtype=np.float64)

    def column(values: Iterable[float]) -> Floats:
        return np.array(list(values), dtype=np.float64)

    def codes(values: Iterable[int]) -> Ints:
        return np.array(list(values), dtype=np.int64)

    zeros: dict[str, Any] = {name: np.zeros(n) for name in ZEROS}
    zeros |= {name: np.zeros(n, np.int64) for name in INTEGER_ZEROS}
    places: dict[str, Any] = {f"{part}{axis}": values.copy() for part in ("", "logged_", "place_", "from_")
                              for axis, values in (("x", x), ("y", y))}  # fmt: skip
    return Crowd(
        **zeros,
        **places,
        yaw=yaw,
        walked=phase,
        logged_yaw=yaw.copy(),
        goals=goals,
        pauses=pauses,
        ends=ends,
        goal_count=codes(len(agent.goals) for agent in agents),
        start_time=column(agent.start_delay_s + begin for agent in agents),
        **_individuals(agents, drawn, options, seed),
        radius=column(agent.radius_m for agent in agents),
        goal_radius=column(agent.goal_radius_m for agent in agents),
        height=column(_HEIGHTS[i % len(_HEIGHTS)] for i in range(n)),
        factor_goal=column(factors.goal for factors, _ in drawn),
        factor_obstacle=column(factors.obstacle for factors, _ in drawn),
        factor_social=column(factors.social for factors, _ in drawn),
        behaviour=codes(CODES[agent.behaviour] for agent in agents),
        duration=column(reaction.duration_s for _, reaction in drawn),
        once=codes(int(reaction.once) for _, reaction in drawn),
        react_speed=column(reaction.speed_m_s for _, reaction in drawn),
        react_distance=column(reaction.distance_m for _, reaction in drawn),
        react_force=column(reaction.force for _, reaction in drawn),
        reacted=np.full(n, -1.0),
        group=codes(-1 if agent.group is None else groups.index(agent.group) for agent in agents),
        group_sum=np.zeros((max(1, len(groups)), 3)),
        beyond=np.zeros(n, np.bool_),
        slow_count=np.zeros(1, np.int64),
        pairs=np.zeros((n * (n - 1) // 2, 2), np.int64),
        cart=np.zeros((n, 4)),
        boxes=boxes,
        origins=origins,
        segments=surfaces.segments if surfaces else np.zeros((0, 4)),
        nearest=surfaces.nearest if surfaces else np.full((1, 1), -1, np.int32),
        inside=surfaces.inside if surfaces else np.zeros((1, 1), np.uint8),
        raster_x=surfaces.x if surfaces else 0.0,
        raster_y=surfaces.y if surfaces else 0.0,
        published=published,
        anticipates=options.anticipation is not None,
        neglect=0.0 if published else options.neglect_m_s2,
        robot_box=np.array([left, right, low, high]),
        robot_height=robot.body_height_m,
        robot_radius=robot.radius_m,
        outline=np.array(robot.outline, dtype=np.float64),
        outline_reach=reach(robot.outline),
        free=np.zeros(1),
        start_pause=column(agent.start_pause_s if agent.start == agent.goals[0] else -1.0 for agent in agents),
        best=np.full(n, np.inf),
        stands=np.ones(n, np.int64),
        reached=np.full((n, longest), np.nan),
        events=np.zeros((min(MOST_EVENTS, n * (2 * math.ceil(time_limit_s) + longest + 8)), COLUMNS)),
        event_count=np.zeros(2, np.int64),
        open=np.full((n, KINDS), -1, np.int64),
    )


def _individuals(
    agents: Sequence[HumanAgent], drawn: Sequence[tuple[ForceFactors, Reaction]], options: PeopleOptions, seed: int
) -> dict[str, Any]:
    """Draw what differs from person to person who anticipate; others walk at the scenario's speed."""
    manner = options.anticipation
    n = len(agents)
    speed = np.array([agent.speed_m_s for agent in agents], np.float64)
    if manner is None:
        none = {name: np.zeros(n) for name in ("clearance", "horizon", "sway", "sway_rate", "patience")}
        zeros: dict[str, Any] = dict.fromkeys(Anticipation.model_fields, 0.0)
        unused = Anticipation.model_construct(**zeros)
        return {"speed": speed, "manner": unused, **none}
    normal = np.array([stream(seed, f"people/individual/{a.name}").standard_normal(5) for a in agents]).reshape(-1, 5)
    normal *= options.factor_noise
    company = np.array([sum(a.group == b.group for b in agents) - 1 if a.group is not None else 0 for a in agents])
    share = np.clip(manner.speed_share + manner.speed_spread * normal[:, 0], *manner.speed_shares)
    social = np.array([factors.social for factors, _ in drawn], np.float64)
    clearance = manner.clearance_m * np.exp(manner.clearance_spread * normal[:, 1]) * np.sqrt(social / 5.0)
    attention = np.array([ATTENTION[agent.attention] for agent in agents], np.float64)
    swaying = options.leg_phase_noise and options.factor_noise > 0.0
    phase = _uniform(agents, options, seed, "people/sway", 2.0 * math.pi)
    return {
        "speed": np.maximum(share * speed - manner.company_m_s * company, 0.2 * speed),
        "manner": manner.model_copy(update={"sway_rad": manner.sway_rad * math.sqrt(2.0) * swaying}),
        "clearance": np.maximum(clearance, manner.least_clearance_m),
        "horizon": attention * manner.horizon_s * np.exp(manner.horizon_spread * normal[:, 2]),
        "sway": phase,
        "patience": manner.patience_s * np.exp(manner.patience_spread * normal[:, 4]),
        "sway_rate": 2.0 * math.pi / (manner.sway_s * np.clip(1.0 + 0.2 * normal[:, 3], 0.5, 1.5)),
    }  # fmt: skip


ZEROS = (
    "vx", "vy", "logged_speed", "pause_left", "old_x", "old_y", "old_vx", "old_vy", "push_x", "push_y", "near_x",
    "near_y", "reach", "paired_x", "paired_y", "obstacle_x", "obstacle_y", "idle", "squeeze", "cap",
)  # fmt: skip
INTEGER_ZEROS = ("goal_index", "expired", "slow", "obstacle_near", "reacting", "back")
"""Fields of `Crowd` that are zero for everybody at the start."""
_HEIGHTS = (0.96, 0.97, 0.93, 0.93, 0.97)
"""Height of the actors of HuNavSim by skin (metres)."""

_SURFACES: dict[str, Surfaces] = {}


def _surfaces(world: World) -> Surfaces:
    """Return the surfaces of a world, computed once per process."""
    if world.place_id not in _SURFACES:
        if len(_SURFACES) > 8:
            _SURFACES.clear()
        _SURFACES[world.place_id] = Surfaces(world)
    return _SURFACES[world.place_id]


def _first_yaw(agent: HumanAgent, published: bool) -> float:
    if published or len(agent.goals) < 2:
        return agent.yaw
    dx = agent.goals[1][0] - agent.start[0]
    dy = agent.goals[1][1] - agent.start[1]
    return math.atan2(dy, dx) if dx or dy else agent.yaw


def _uniform(agents: Sequence[HumanAgent], options: PeopleOptions, seed: int, source: str, most: float) -> Floats:
    """Draw a number from 0 to `most` for each person: from a stream of their name's if they anticipate."""
    if options.anticipation is None:
        return stream(seed, source).uniform(0.0, most, len(agents))
    return np.array([stream(seed, f"{source}/{agent.name}").uniform(0.0, most) for agent in agents], np.float64)


def _drawn(agent: HumanAgent, key: int | str, options: PeopleOptions, seed: int) -> tuple[ForceFactors, Reaction]:
    """The factors and the reaction of one human: as given, or drawn from HuNavSim's distributions of a launch.

    `key` names the stream of the person's draws: the place in the list, or the name of somebody who anticipates.

    `random_normal` and `random_uniform` are its configurations 2 and 3, with its floors, drawn in its order.
    """
    if isinstance(agent.factors, ForceFactors):
        return agent.factors, agent.reaction
    rng = stream(seed, f"people/factors/{key}")
    normal = agent.factors == "random_normal"
    kind = agent.behaviour

    def draw(mean: float, sd: float, low: float, high: float, floor: float = -math.inf) -> float:
        middle = mean if normal else 0.5 * (low + high)
        value = float(rng.normal(mean, sd)) if normal else float(rng.uniform(low, high))
        value = middle + options.factor_noise * (value - middle)
        return max(floor, value) if normal else value

    lowest = -math.inf if options.published_defects else 0.1
    goal = draw(2.0, 1.5, 2.0, 5.0, 0.5)
    obstacle = draw(10.0, 4.0, 8.0, 15.0, 0.5)
    social = draw(4.0, 3.5, 2.1, 15.0, 2.0)
    reaction = agent.reaction.model_dump()
    if kind not in (Behaviour.REGULAR, Behaviour.IMPASSIVE):
        reaction["duration_s"] = max(0.0, draw(40.0, 15.0, 25.0, 60.0))
    if kind is Behaviour.CURIOUS:
        reaction["speed_m_s"] = draw(0.8, 0.35, 0.6, 1.2, 0.4)
        reaction["distance_m"] = max(0.0, draw(1.5, 0.3, 1.0, 2.5))
    elif kind is Behaviour.SCARED:
        reaction["speed_m_s"] = draw(0.8, 0.35, 0.6, 1.2, lowest)
        reaction["distance_m"] = draw(4.5, 2.5, 2.0, 6.0, 1.5)
        reaction["force"] = max(0.0, draw(20.0, 6.0, 10.0, 25.0))
    elif kind is Behaviour.SURPRISED:
        reaction["distance_m"] = draw(4.5, 2.5, 2.0, 6.0, 1.5)
    elif kind is Behaviour.THREATENING:
        reaction["distance_m"] = max(0.0, draw(1.4, 0.3, 0.8, 1.9))
    return ForceFactors.model_construct(goal=goal, obstacle=obstacle, social=social), Reaction(**reaction)


TOUCHED, STUCK, PAUSED, REACTED, REACHED = range(5)
# Columns: kind, person, first and last time (s), place (m), and numbers that depend on the kind.
KIND, PERSON, FROM, UNTIL, X, Y, FIRST = range(7)
AGAIN_S = 0.5
"""What happens again after less than this is the same event."""


@inner
def note_until(crowd: Crowd, kind: int, i: int, start: float, t: float, x: float, y: float, value: float) -> int:
    """Extend the person's present event of this kind to `t`, or start one; return its row, -1 where none is free."""
    row = crowd.open[i, kind]
    if row >= 0 and start - crowd.events[row, UNTIL] < AGAIN_S and crowd.events[row, FIRST] == value:
        crowd.events[row, UNTIL] = t
        return row
    row = crowd.event_count[0]
    if row >= crowd.events.shape[0]:
        crowd.event_count[1] += 1
        return -1
    crowd.event_count[0] = row + 1
    crowd.open[i, kind] = row
    crowd.events[row, :] = 0.0
    crowd.events[row, KIND] = kind
    crowd.events[row, PERSON] = i
    crowd.events[row, FROM] = start
    crowd.events[row, UNTIL] = t
    crowd.events[row, X] = x
    crowd.events[row, Y] = y
    crowd.events[row, FIRST] = value
    return row
