"""HuNavSim agents files (`agents.yaml`) in three dialects.

* `flat`: HuNavSim 1.x of the first releases; `behavior` is an integer.
* `block`: HuNavSim 1.x with a `behavior` block of type, configuration, reaction and force factors.
* `v2`: HuNavSim 2.0; goals are integer ids of one `global_goals` table, the behaviour type is a word.

Source: hunav_loader of https://github.com/robotics-upo/hunav_sim and the agent files of its wrappers.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import Field, ValidationError

from rvsg.core.documents import Document, DocumentError, Key, Problem, read_yaml
from rvsg.core.errors import FileError, InputError
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
KEY = ("hunav_loader", "ros__parameters")


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


class BehaviourBlock(Record, extra="allow"):
    """The `behavior` block with the defaults of hunav_loader."""

    type: int | str = 1
    configuration: int = DEFAULT_CONFIGURATION
    duration: float = 40.0
    once: bool = True
    vel: float = 1.0
    dist: float = 0.0
    goal_force_factor: float = 2.0
    obstacle_force_factor: float = 10.0
    social_force_factor: float = 5.0
    other_force_factor: float = 20.0

    def custom(self) -> tuple[ForceFactors, Reaction]:
        """Return the values of configuration 1, clamped as hunav_loader clamps them."""
        factors = ForceFactors(
            goal=min(max(self.goal_force_factor, 2.0), 8.0),
            obstacle=min(max(self.obstacle_force_factor, 2.0), 30.0),
            social=min(max(self.social_force_factor, 2.1), 20.0),
        )
        reaction = Reaction(
            duration_s=max(0.0, self.duration),
            once=self.once,
            speed_m_s=min(max(self.vel, 0.0), 1.8),
            distance_m=max(0.0, self.dist),
            force=max(0.0, self.other_force_factor),
        )
        return factors, reaction


class AgentBlock(Record, extra="ignore"):
    """One agent of a file; `max_vel` is both the desired speed and the cap."""

    agent_id: int = Field(default=-1, alias="id")
    skin: int = 0
    group_id: int = -1
    max_vel: float = 1.0
    radius: float = 0.35
    behavior: int | BehaviourBlock = 1
    init_pose: InitialPose = InitialPose()
    goal_radius: float = GOAL_RADIUS_M
    cyclic_goals: bool = True

    @property
    def behaviour(self) -> Behaviour:
        """The behaviour that the type stands for; HuNavSim treats an unknown type as regular."""
        kind = self.behavior.type if isinstance(self.behavior, BehaviourBlock) else self.behavior
        if isinstance(kind, int):
            return TYPES.get(kind, Behaviour.REGULAR)
        return next((each for each in Behaviour if each.value == kind.lower()), Behaviour.REGULAR)


def read_agents(path: Path) -> tuple[tuple[HumanAgent, ...], tuple[str, ...]]:
    """Read the agents of a file of any dialect; return them, and one sentence for each setting without a counterpart.

    HuNavSim starts an agent at `init_pose` and walks the goals in order, then from the first again. Raises FileError
    (DocumentError: every mistake with its line), InputError for a value out of range.
    """
    document = read_yaml(path)
    inner = document.value.get(KEY[0]) if isinstance(document.value, dict) else None
    parameters = inner.get(KEY[1]) if isinstance(inner, dict) else None
    if not isinstance(parameters, dict):
        reason = "this is no HuNavSim agents file: it has no `hunav_loader: ros__parameters:` block"
        raise FileError(path, reason, line=1)
    names = parameters.get("agents")
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        line = document.line(*KEY, "agents")
        raise FileError(path, "`agents` must list the names of the agents, at least one", line=line)
    problems: list[Problem] = []
    shared = parameters.get("global_goals")
    table = _points(document, shared, (*KEY, "global_goals"), problems) if shared else None
    blocks = [_block(document, name, parameters.get(name), table, problems) for name in names]
    if problems:
        raise DocumentError(problems)
    notes: list[str] = []
    found = zip(names, [each for each in blocks if each is not None], strict=True)
    return tuple(_human(name, block, goals, notes) for name, (block, goals) in found), tuple(notes)


def _block(
    document: Document,
    name: str,
    block: object,
    table: Mapping[str, GoalPoint] | None,
    problems: list[Problem],
) -> tuple[AgentBlock, list[GoalPoint]] | None:
    """Return an agent's settings and goals; None, and a problem, where something is wrong."""
    key = (*KEY, name)
    if not isinstance(block, dict):
        problems.append(document.problem(f'the agent "{name}" is listed, but has no block', *KEY, "agents"))
        return None
    goals = block.get("goals")
    if not isinstance(goals, list) or not all(isinstance(goal, str | int) for goal in goals):
        problems.append(document.problem(f"{name}: `goals` must list the goals of the agent", *key, "goals"))
        return None
    known = block if table is None else table
    where = "the block of the agent" if table is None else "global_goals"
    missing = [goal for goal in goals if known.get(str(goal)) is None]
    problems += [document.problem(f'{name}: the goal "{goal}" is not in {where}', *key, "goals") for goal in missing]
    if missing:
        return None
    if table is None:
        table = _points(document, {str(goal): block[str(goal)] for goal in goals}, key, problems)
    values = {k: v for k, v in block.items() if v is not None}
    if isinstance(values.get("behavior"), dict):
        values["behavior"] = {k: v for k, v in values["behavior"].items() if v is not None}
    try:
        return AgentBlock.model_validate(values), [table[str(goal)] for goal in goals if str(goal) in table]
    except ValidationError as error:
        for each in error.errors():
            path = [str(part) for part in each["loc"] if part != "BehaviourBlock"]
            problems.append(document.problem(f"{name}: {'.'.join(path)}: {each['msg'].lower()}", *key, *path[:1]))
        return None


def _points(document: Document, values: object, key: Key, problems: list[Problem]) -> dict[str, GoalPoint]:
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


def _human(name: str, agent: AgentBlock, points: list[GoalPoint], notes: list[str]) -> HumanAgent:
    reaction = reaction_of(agent.behaviour, agent.max_vel)
    factors: ForceFactors | Literal["random_normal", "random_uniform"] = ForceFactors()
    block = agent.behavior
    if isinstance(block, BehaviourBlock):
        if block.configuration == CUSTOM_CONFIGURATION:
            factors, reaction = block.custom()
        else:
            factors = DRAWN.get(block.configuration, factors)
        unknown = sorted(block.model_extra or {})
        notes += [f"{name}: the behaviour setting `{key}` has no effect here." for key in unknown]
    start = (agent.init_pose.x, agent.init_pose.y)
    goals = tuple((point.x, point.y) for point in points)
    if not goals:
        goals = (start,)
        notes.append(f"{name}: no goals; the person stands at the start.")
    try:
        return HumanAgent(
            name=name,
            start=start,
            yaw=agent.init_pose.h,
            goals=goals,
            pauses_s=(*(0.0 for _ in goals[1:]), 0.0 if agent.cyclic_goals else FOREVER_S),
            speed_m_s=agent.max_vel,
            radius_m=agent.radius,
            goal_radius_m=agent.goal_radius,
            behaviour=agent.behaviour,
            reaction=reaction,
            factors=factors,
            group=None if agent.group_id < 0 else agent.group_id,
        )
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(f"{name}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None


def agents_yaml(
    agents: Iterable[HumanAgent], *, map_name: str, dialect: Dialect = "block"
) -> tuple[str, tuple[str, ...]]:
    """Return the text of an agents file in a dialect, and one sentence per setting that it cannot hold."""
    notes: list[str] = []
    ids: dict[tuple[float, float], int] = {}
    blocks: dict[str, Any] = {}
    for number, agent in enumerate(agents, start=1):
        if any(agent.pauses_s[:-1] if agent.stays else agent.pauses_s):
            notes.append(f"{agent.name}: HuNavSim has no pauses; the person walks on at once.")
        if agent.start_delay_s:
            notes.append(f"{agent.name}: HuNavSim has no start delay; the person starts at once.")
        if agent.track is not None:
            notes.append(f"{agent.name}: HuNavSim knows no recorded tracks; the person walks the goals of the tasks.")
        default = reaction_of(agent.behaviour, agent.speed_m_s)
        if dialect == "flat" and (agent.factors != ForceFactors() or agent.reaction != default):
            notes.append(f"{agent.name}: the flat dialect holds no force factors and reactions; it uses the defaults.")
        own = {} if dialect == "v2" else {f"g{k}": {"x": x, "y": y, "h": 0.0} for k, (x, y) in enumerate(agent.goals)}
        blocks[f"agent{number}"] = {
            "id": number,
            "skin": number % 5,
            "group_id": -1 if agent.group is None else agent.group,
            "max_vel": agent.speed_m_s,
            "radius": agent.radius_m,
            "behavior": _behaviour_of(agent, dialect),
            "init_pose": {"x": agent.start[0], "y": agent.start[1], "z": 1.25, "h": agent.yaw},
            "goal_radius": agent.goal_radius_m,
            "cyclic_goals": not agent.stays,
            "goals": [*own] if own else [ids.setdefault(goal, len(ids) + 1) for goal in agent.goals],
            **own,
        }
    parameters: dict[str, Any] = {"map": map_name, "publish_people": True}
    if dialect == "v2":
        parameters = {"yaml_base_name": map_name, "simulator": "Gazebo", **parameters}
        parameters["global_goals"] = {number: {"x": x, "y": y} for (x, y), number in ids.items()}
    document = {KEY[0]: {KEY[1]: parameters | {"agents": list(blocks)} | blocks}}
    return yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=1000), tuple(notes)


def _behaviour_of(agent: HumanAgent, dialect: Dialect) -> int | dict[str, Any]:
    code = CODES[agent.behaviour]
    if dialect == "flat":
        return code
    kind: int | str = agent.behaviour.value.capitalize() if dialect == "v2" else code
    reaction, factors = agent.reaction, agent.factors
    if not isinstance(factors, ForceFactors):
        configuration = next((number for number, name in DRAWN.items() if name == factors), DEFAULT_CONFIGURATION)
        return {"type": kind, "configuration": configuration, "once": reaction.once}
    return {
        "type": kind,
        "configuration": CUSTOM_CONFIGURATION,
        "duration": reaction.duration_s,
        "once": reaction.once,
        "vel": reaction.speed_m_s,
        "dist": reaction.distance_m,
        "goal_force_factor": factors.goal,
        "obstacle_force_factor": factors.obstacle,
        "social_force_factor": factors.social,
        "other_force_factor": reaction.force,
    }
