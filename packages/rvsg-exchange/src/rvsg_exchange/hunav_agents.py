"""HuNavSim agent files (`agents.yaml`): read and write its three dialects, and convert agents to humans and back.

* `flat`: HuNavSim 1.x of the first releases; `behavior` is an integer.
* `block`: HuNavSim 1.x with a `behavior` block of type, configuration, reaction and force factors.
* `v2`: HuNavSim 2.0; goals are integer ids of one `global_goals` table, the behaviour type is a word.

Source: hunav_loader of https://github.com/robotics-upo/hunav_sim and the agent files of its wrappers.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import Field, ValidationError

from rvsg.core.documents import Document, DocumentError, Problem, read_yaml
from rvsg.core.errors import FileError, InputError
from rvsg.core.files import write_whole
from rvsg.core.records import Record
from rvsg.scenario.scenario import FOREVER_S, GOAL_RADIUS_M, Behaviour, ForceFactors, HumanAgent, Reaction, reaction_of

Dialect = Literal["flat", "block", "v2"]

TYPES: dict[int, Behaviour] = {
    1: Behaviour.REGULAR,
    2: Behaviour.IMPASSIVE,
    3: Behaviour.SURPRISED,
    4: Behaviour.SCARED,
    5: Behaviour.CURIOUS,
    6: Behaviour.THREATENING,
}
CODES: dict[Behaviour, int] = {behaviour: code for code, behaviour in TYPES.items()}

DEFAULT_CONFIGURATION, CUSTOM_CONFIGURATION = 0, 1
DRAWN: dict[int, Literal["random_normal", "random_uniform"]] = {2: "random_normal", 3: "random_uniform"}


class GoalPoint(Record):
    """A goal: x and y in metres, `h` the heading in radians, which HuNavSim carries and does not use."""

    x: float
    y: float
    h: float | None = None


class InitialPose(Record):
    """The pose an agent starts from; `z` places the actor's origin, `h` is its yaw in radians."""

    x: float = 0.0
    y: float = 0.0
    z: float | None = None
    h: float = 0.0


class BehaviourBlock(Record):
    """The `behavior` block. None stands for a key that the file leaves out; HuNavSim then uses its own default."""

    type: int | str = 1
    configuration: int = DEFAULT_CONFIGURATION
    duration: float | None = None
    once: bool | None = None
    vel: float | None = None
    dist: float | None = None
    goal_force_factor: float | None = None
    obstacle_force_factor: float | None = None
    social_force_factor: float | None = None
    other_force_factor: float | None = None
    extra: dict[str, Any] = Field(default_factory=dict)


class AgentBlock(Record):
    """One agent as its file states it; None stands for a key that the file leaves out.

    `goals` are names (or ids) in visiting order, `points` what they stand for.
    """

    name: str
    agent_id: int = -1
    skin: int | None = None
    group_id: int | None = None
    max_vel: float | None = None
    radius: float | None = None
    behavior: int | BehaviourBlock | None = None
    init_pose: InitialPose = InitialPose()
    goal_radius: float | None = None
    cyclic_goals: bool | None = None
    goals: tuple[str | int, ...]
    points: dict[str, GoalPoint] = Field(default_factory=dict)
    extra: dict[str, Any] = Field(default_factory=dict)

    @property
    def behaviour(self) -> Behaviour:
        """The behaviour that the type stands for; HuNavSim treats an unknown type as regular."""
        kind = self.behavior.type if isinstance(self.behavior, BehaviourBlock) else self.behavior
        if kind is None or isinstance(kind, int):
            return TYPES.get(kind or 0, Behaviour.REGULAR)
        words = {behaviour.value: behaviour for behaviour in Behaviour}
        return words.get(kind.lower(), Behaviour.REGULAR)

    @property
    def speed_m_s(self) -> float:
        """The desired speed and cap; hunav_loader's default where the file has none."""
        return 1.0 if self.max_vel is None else self.max_vel


class AgentsFile(Record):
    """A whole agents file. `header` holds the keys beside the agents (`map`, `publish_people`, ...), in their order.

    `other_nodes` keeps the parameters of other ROS nodes in the same file as they are.
    """

    dialect: Dialect
    header: dict[str, Any] = Field(default_factory=dict)
    other_nodes: dict[str, Any] = Field(default_factory=dict)
    global_goals: dict[str, GoalPoint] = Field(default_factory=dict)
    agents: tuple[AgentBlock, ...]


class Converted(Record):
    """Agents in our terms, and a note for each thing of the file that the simulators here do not reproduce."""

    agents: tuple[HumanAgent, ...]
    notes: tuple[str, ...] = ()


_AGENT_KEYS = {
    *("id", "skin", "group_id", "max_vel", "radius", "behavior"),
    *("init_pose", "goal_radius", "cyclic_goals", "goals"),
}
_BEHAVIOUR_KEYS = set(BehaviourBlock.model_fields) - {"extra"}


def read_agents(path: Path) -> AgentsFile:
    """Read an agents file of any dialect.

    Raises:
        FileError: the file is not an agents file; DocumentError lists every mistake with its line.
    """
    document = read_yaml(path)
    parameters = _parameters(document)
    names = parameters.get("agents")
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        line = document.line("hunav_loader", "ros__parameters", "agents")
        raise FileError(path, "`agents` must list the names of the agents, at least one", line=line)
    problems: list[Problem] = []
    agents: list[AgentBlock] = []
    shared = parameters.get("global_goals")
    table = _points(document, shared, ("hunav_loader", "ros__parameters", "global_goals"), problems) if shared else {}
    for name in names:
        agent = _agent(document, name, parameters.get(name), bool(shared), table, problems)
        if agent is not None:
            agents.append(agent)
    if problems:
        raise DocumentError(problems)
    header = {key: value for key, value in parameters.items() if key not in {"agents", "global_goals", *names}}
    return AgentsFile(
        dialect=_dialect(agents, bool(shared)),
        header=header,
        other_nodes={key: value for key, value in document.value.items() if key != "hunav_loader"},
        global_goals=table,
        agents=tuple(agents),
    )


def agents_yaml(file: AgentsFile) -> str:
    """Return the text of an agents file. Reading it gives an equal record."""
    parameters: dict[str, Any] = dict(file.header)
    if file.dialect == "v2":
        parameters["global_goals"] = {_key(name): _point(point) for name, point in file.global_goals.items()}
    parameters["agents"] = [agent.name for agent in file.agents]
    for agent in file.agents:
        parameters[agent.name] = _agent_block(agent, file.dialect)
    return yaml.safe_dump(
        {"hunav_loader": {"ros__parameters": parameters}, **file.other_nodes},
        sort_keys=False,
        allow_unicode=True,
        width=1000,
    )


def write_agents(file: AgentsFile, path: Path) -> None:
    """Write an agents file whole; FileError where it cannot be written."""
    write_whole(path, agents_yaml(file))


def to_humans(file: AgentsFile) -> Converted:
    """Convert the agents of a file to the agents that our simulators move.

    HuNavSim starts an agent at `init_pose` and walks the goals in order, then from the first again. `max_vel` is both
    the desired speed and the cap. Settings without a counterpart are returned as notes, one sentence each.
    """
    notes: list[str] = []
    return Converted(agents=tuple(_human(agent, file, notes) for agent in file.agents), notes=tuple(notes))


def export_agents(
    agents: tuple[HumanAgent, ...], *, map_name: str, dialect: Dialect = "block"
) -> tuple[AgentsFile, tuple[str, ...]]:
    """Convert agents to an agents file, and list what the file cannot hold.

    Args:
        agents: the people, in the world frame.
        map_name: what HuNavSim names the map (it does not use it).
        dialect: `flat` holds no reactions and force factors, `block` and `v2` hold all.

    Returns:
        The file, and one sentence per lost setting: pauses, start delays, and in `flat` the factors and reactions.
    """
    notes: list[str] = []
    table: dict[str, GoalPoint] = {}
    blocks = []
    for index, agent in enumerate(agents, start=1):
        points = [GoalPoint(x=x, y=y, h=None if dialect == "v2" else 0.0) for x, y in agent.goals]
        if dialect == "v2":
            names: list[str | int] = []
            for point in points:
                known = next((key for key, there in table.items() if there == point), None)
                key = known or str(len(table) + 1)
                table[key] = point
                names.append(int(key))
            own: dict[str, GoalPoint] = {}
        else:
            names = [f"g{k}" for k in range(len(points))]
            own = {f"g{k}": point for k, point in enumerate(points)}
        if any(agent.pauses_s[:-1] if agent.stays else agent.pauses_s):
            notes.append(f"{agent.name}: HuNavSim has no pauses; the person walks on at once.")
        if agent.start_delay_s:
            notes.append(f"{agent.name}: HuNavSim has no start delay; the person starts at once.")
        default = reaction_of(agent.behaviour, agent.speed_m_s)
        if dialect == "flat" and (agent.factors != ForceFactors() or agent.reaction != default):
            notes.append(f"{agent.name}: the flat dialect holds no force factors and reactions; it uses the defaults.")
        blocks.append(
            AgentBlock(
                name=f"agent{index}",
                agent_id=index,
                skin=index % 5,
                group_id=-1 if agent.group is None else agent.group,
                max_vel=agent.speed_m_s,
                radius=agent.radius_m,
                behavior=_behaviour_of(agent, dialect),
                init_pose=InitialPose(x=agent.start[0], y=agent.start[1], z=1.25, h=agent.yaw),
                goal_radius=agent.goal_radius_m,
                cyclic_goals=not agent.stays,
                goals=tuple(names),
                points=own,
            )
        )
    header: dict[str, Any] = {"map": map_name, "publish_people": True}
    if dialect == "v2":
        header = {"yaml_base_name": map_name, "simulator": "Gazebo", **header}
    return AgentsFile(dialect=dialect, header=header, global_goals=table, agents=tuple(blocks)), tuple(notes)


# Reading


def _parameters(document: Document) -> Mapping[str, Any]:
    value = document.value
    inner = value.get("hunav_loader") if isinstance(value, dict) else None
    parameters = inner.get("ros__parameters") if isinstance(inner, dict) else None
    if not isinstance(parameters, dict):
        raise FileError(
            document.path,
            "this is no HuNavSim agents file: it has no `hunav_loader: ros__parameters:` block",
            line=1,
        )
    return parameters


def _agent(
    document: Document,
    name: str,
    block: object,
    shared: bool,
    table: Mapping[str, GoalPoint],
    problems: list[Problem],
) -> AgentBlock | None:
    key = ("hunav_loader", "ros__parameters", name)
    if not isinstance(block, dict):
        problems.append(document.problem(f'the agent "{name}" is listed, but has no block', *key[:2], "agents"))
        return None
    goals = block.get("goals")
    if not isinstance(goals, list) or not all(isinstance(goal, str | int) for goal in goals):
        problems.append(document.problem(f"{name}: `goals` must list the goals of the agent", *key, "goals"))
        return None
    own = {} if shared else {str(goal): block.get(str(goal)) for goal in goals}
    missing = [goal for goal in goals if (str(goal) not in table if shared else own[str(goal)] is None)]
    for goal in missing:
        where = "global_goals" if shared else "the block of the agent"
        problems.append(document.problem(f'{name}: the goal "{goal}" is not in {where}', *key, "goals"))
    if missing:
        return None
    points = {} if shared else _points(document, own, key, problems)
    behaviour = block.get("behavior")
    values: dict[str, Any] = {
        "name": name,
        "agent_id": block.get("id", -1),
        "behavior": _behaviour_block(behaviour) if isinstance(behaviour, dict) else behaviour,
        "goals": tuple(goals),
        "points": points,
        "extra": {k: v for k, v in block.items() if k not in _AGENT_KEYS and str(k) not in own},
    }
    values |= {k: block[k] for k in _AGENT_KEYS - {"id", "behavior", "goals"} if k in block}
    try:
        return AgentBlock(**values)
    except ValidationError as error:
        for each in error.errors():
            path = [str(part) for part in each["loc"] if part != "BehaviourBlock"]
            problems.append(document.problem(f"{name}: {'.'.join(path)}: {each['msg'].lower()}", *key, *path[:1]))
        return None


def _behaviour_block(block: Mapping[str, Any]) -> dict[str, Any]:
    known = {key: value for key, value in block.items() if key in _BEHAVIOUR_KEYS}
    return known | {"extra": {key: value for key, value in block.items() if key not in _BEHAVIOUR_KEYS}}


def _points(document: Document, values: object, key: tuple[str, ...], problems: list[Problem]) -> dict[str, GoalPoint]:
    if not isinstance(values, dict):
        problems.append(document.problem("`global_goals` must map ids to points with x and y", *key))
        return {}
    found = {}
    for name, value in values.items():
        try:
            found[str(name)] = GoalPoint.model_validate(value)
        except ValidationError:
            problems.append(document.problem(f'the goal "{name}" must have numbers x and y', *key, name))
    return found


def _dialect(agents: list[AgentBlock], shared: bool) -> Dialect:
    if shared:
        return "v2"
    return "block" if any(isinstance(agent.behavior, BehaviourBlock) for agent in agents) else "flat"


# Writing


def _agent_block(agent: AgentBlock, dialect: Dialect) -> dict[str, Any]:
    block: dict[str, Any] = {"id": agent.agent_id}
    optional = {"skin": agent.skin, "group_id": agent.group_id, "max_vel": agent.max_vel, "radius": agent.radius}
    block |= {key: value for key, value in optional.items() if value is not None}
    if isinstance(agent.behavior, BehaviourBlock):
        behaviour = agent.behavior.model_dump(exclude={"extra"}, exclude_none=True)
        block["behavior"] = behaviour | agent.behavior.extra
    elif agent.behavior is not None:
        block["behavior"] = agent.behavior
    block["init_pose"] = agent.init_pose.model_dump(exclude_none=True)
    if agent.goal_radius is not None:
        block["goal_radius"] = agent.goal_radius
    if agent.cyclic_goals is not None:
        block["cyclic_goals"] = agent.cyclic_goals
    block |= agent.extra
    block["goals"] = list(agent.goals)
    if dialect != "v2":
        block |= {name: _point(point) for name, point in agent.points.items()}
    return block


def _point(point: GoalPoint) -> dict[str, float]:
    return point.model_dump(exclude_none=True)


def _key(name: str) -> str | int:
    return int(name) if name.isdecimal() and len(name) < 10 else name


# Between HuNavSim and us


def _human(agent: AgentBlock, file: AgentsFile, notes: list[str]) -> HumanAgent:
    behaviour = agent.behaviour
    reaction = reaction_of(behaviour, agent.speed_m_s)
    factors: ForceFactors | Literal["random_normal", "random_uniform"] = ForceFactors()
    block = agent.behavior
    if isinstance(block, BehaviourBlock):
        if block.configuration in DRAWN:
            factors = DRAWN[block.configuration]
        elif block.configuration == CUSTOM_CONFIGURATION:
            factors, reaction = _custom(block)
        notes += [f"{agent.name}: the behaviour setting `{key}` has no effect here." for key in sorted(block.extra)]
    points = file.global_goals if file.dialect == "v2" else agent.points
    goals = tuple((points[str(name)].x, points[str(name)].y) for name in agent.goals)
    start = (agent.init_pose.x, agent.init_pose.y)
    if not goals:
        goals = (start,)
        notes.append(f"{agent.name}: no goals; the person stands at the start.")
    try:
        return HumanAgent(
            name=agent.name,
            start=start,
            yaw=agent.init_pose.h,
            goals=goals,
            pauses_s=(*(0.0 for _ in goals[1:]), FOREVER_S if agent.cyclic_goals is False else 0.0),
            speed_m_s=agent.speed_m_s,
            radius_m=0.35 if agent.radius is None else agent.radius,
            goal_radius_m=GOAL_RADIUS_M if agent.goal_radius is None else agent.goal_radius,
            behaviour=behaviour,
            reaction=reaction,
            factors=factors,
            group=None if agent.group_id is None or agent.group_id < 0 else agent.group_id,
        )
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(f"{agent.name}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None


def _custom(block: BehaviourBlock) -> tuple[ForceFactors, Reaction]:
    """The values of configuration 1, clamped as hunav_loader clamps them; its defaults where a key is missing."""

    def within(value: float | None, default: float, low: float, high: float) -> float:
        return min(max(default if value is None else value, low), high)

    factors = ForceFactors(
        goal=within(block.goal_force_factor, 2.0, 2.0, 8.0),
        obstacle=within(block.obstacle_force_factor, 10.0, 2.0, 30.0),
        social=within(block.social_force_factor, 5.0, 2.1, 20.0),
    )
    reaction = Reaction(
        duration_s=max(0.0, 40.0 if block.duration is None else block.duration),
        once=True if block.once is None else block.once,
        speed_m_s=within(block.vel, 1.0, 0.0, 1.8),
        distance_m=max(0.0, 0.0 if block.dist is None else block.dist),
        force=max(0.0, 20.0 if block.other_force_factor is None else block.other_force_factor),
    )
    return factors, reaction


def _behaviour_of(agent: HumanAgent, dialect: Dialect) -> int | BehaviourBlock:
    code = CODES[agent.behaviour]
    if dialect == "flat":
        return code
    kind: int | str = agent.behaviour.value.capitalize() if dialect == "v2" else code
    drawn = next((number for number, name in DRAWN.items() if name == agent.factors), None)
    if drawn is not None or not isinstance(agent.factors, ForceFactors):
        return BehaviourBlock(type=kind, configuration=drawn or DEFAULT_CONFIGURATION, once=agent.reaction.once)
    return BehaviourBlock(
        type=kind,
        configuration=CUSTOM_CONFIGURATION,
        duration=agent.reaction.duration_s,
        once=agent.reaction.once,
        vel=agent.reaction.speed_m_s,
        dist=agent.reaction.distance_m,
        goal_force_factor=agent.factors.goal,
        obstacle_force_factor=agent.factors.obstacle,
        social_force_factor=agent.factors.social,
        other_force_factor=agent.reaction.force,
    )
