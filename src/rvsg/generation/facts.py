"""What a prompt may say of a world, a brief and a result: plain values under the names that templates declare."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from typing import Any

from rvsg.scenario.brief import Brief, Feedback, Remembered
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Behaviour, HumanConfiguration
from rvsg.world.grid import Grid
from rvsg.world.route_words import route_paragraph
from rvsg.world.world import Description, Route, World

SPEED_RANGE_M_S = (0.3, 2.0)
LONGEST_SERIES = 120

MEANINGS = {
    Behaviour.REGULAR: "gives way to the robot as to another person, and walks on",
    Behaviour.IMPASSIVE: "takes the robot for a thing and walks round it",
    Behaviour.SURPRISED: "stops and looks when the robot comes near",
    Behaviour.SCARED: "slows down and keeps well away from the robot",
    Behaviour.CURIOUS: "leaves the way for a while to come up to the robot",
    Behaviour.THREATENING: "steps in front of the robot for a while",
}


def human_names(count: int) -> tuple[str, ...]:
    """The names humans go by in every prompt: Human 1, Human 2, ..."""
    return tuple(f"Human {number}" for number in range(1, count + 1))


def world_facts(world: World, description: Description | None = None) -> dict[str, Any]:
    """Areas, grid and description of a world."""
    described = description or world.description
    grid = world.grid
    return {
        "world_title": world.title,
        "activities": list(world.activities),
        "layout": described.layout if described else "",
        "grid": described.grid if described else "",
        "areas": [
            {
                "name": area.name,
                "kind": area.kind,
                "region": area.region,
                "note": area.note,
                "waypoints": [name for name in area.waypoints if name in grid.valid],
            }
            for area in world.areas
        ],
        "rows": [{"name": name, "x": x} for name, x in _middles(grid, "row")],
        "columns": [{"name": name, "y": y} for name, y in _middles(grid, "column")],
        "neighbours": [{"name": name, "to": list(others)} for name, others in grid.neighbours.items()],
        "invalid": [waypoint.name for waypoint in grid.waypoints if not waypoint.human],
    }


def brief_facts(brief: Brief, world: World) -> dict[str, Any]:
    """Route, requirement, humans, memory and feedback of a brief."""
    requirement = brief.requirement
    return {
        "route": route_facts(brief.mission.route, world),
        "requirement": requirement_facts(requirement) if requirement else None,
        "humans": brief.humans,
        "names": list(human_names(brief.humans)),
        "behaviours": [{"name": b.value, "meaning": MEANINGS[b]} for b in Behaviour],
        "speed_range": list(SPEED_RANGE_M_S),
        "memory": [_remembered(earlier) for earlier in brief.memory],
        "feedback": feedback_facts(brief.feedback, requirement) if brief.feedback else None,
    }


def route_facts(route: Route, world: World) -> dict[str, Any]:
    """A route as prompts tell it; `start` and `goal` are the nearest waypoints, `length_m` follows `via`.

    `description` is the user's own, else the paragraph written from the route: areas, waypoints, turns, narrow places.
    The latter holds start, goal, purpose, way and time limit; a user's words (`described_by_user`) may not.
    """
    grid = world.grid
    inner = [grid.position(name) for name in route.via if name in grid.by_name]
    points = [(route.start.x, route.start.y), *inner, (route.goal.x, route.goal.y)]
    return {
        "name": route.name,
        "purpose": route.purpose,
        "start": grid.nearest(route.start.x, route.start.y),
        "goal": grid.nearest(route.goal.x, route.goal.y),
        "via": list(route.via),
        "description": route_paragraph(world, route),
        "described_by_user": bool(route.description),
        "time_limit_s": route.time_limit_s,
        "length_m": sum(math.dist(a, b) for a, b in itertools.pairwise(points)),
    }


def requirement_facts(requirement: Requirement) -> dict[str, Any]:
    """A requirement as prompts tell it."""
    return {
        "title": requirement.title,
        "text": requirement.text,
        "measure": _measured(requirement),
        "unit": requirement.unit,
        "worse": requirement.worse,
        "limit": requirement.threshold,
    }


def _measured(requirement: Requirement) -> str:
    if requirement.formula is not None and not requirement.measured_as:
        return f"how far the drive is from breaking the rule: {requirement.formula} (below 0 it is broken)"
    return requirement.measured_as or str(requirement.metric)


def feedback_facts(feedback: Feedback, requirement: Requirement | None) -> dict[str, Any]:
    """A result as prompts tell it; `better` says the last change moved the value where the test wants it."""
    worse = requirement.worse if requirement else "smaller"
    previous = feedback.previous_mean
    better = previous is not None and (feedback.mean < previous if worse == "smaller" else feedback.mean > previous)
    return {
        "runs": len(feedback.objectives),
        "objectives": list(feedback.objectives),
        "mean": feedback.mean,
        "low": feedback.interval[0],
        "high": feedback.interval[1],
        "violation_share": feedback.violation_share,
        "previous_mean": previous,
        "separable": bool(feedback.separable),
        "better": better,
        "influences": [influence.model_dump(mode="json") for influence in feedback.influences],
        "moments": [
            moment.model_dump(mode="json") | {"humans_at": [{"name": n, "at": a} for n, a in moment.humans_at.items()]}
            for moment in feedback.moments
        ],
        "series_of": feedback.series_of,
        "series": [sample.model_dump(mode="json") for sample in feedback.series[:LONGEST_SERIES]],
    }


def configuration_object(people: HumanConfiguration, description: str | None = None, *, rich: bool = True) -> Any:
    """A configuration in the form replies have; without `rich` only names, tasks and paths."""
    humans = []
    for human in people.humans:
        tasks = []
        for task in human.tasks:
            entry: dict[str, Any] = {"task": task.name, "path": list(task.path)}
            if rich and task.pauses:
                entry["pauses"] = [{"at": p.at, "duration_s": p.duration_s} for p in task.pauses]
            tasks.append(entry)
        chosen = {
            "behaviour": human.behaviour.value,
            "speed_m_s": human.speed_m_s,
            "start_delay_s": human.start_delay_s,
            "group": human.group,
        }
        humans.append({"name": human.name, **(chosen if rich else {}), "tasks": tasks})
    return ({"description": description} if description is not None else {}) | {"humans": humans}


def _remembered(earlier: Remembered) -> dict[str, Any]:
    return {
        "description": earlier.description,
        "tasks": [{"name": name, "tasks": list(tasks)} for name, tasks in earlier.tasks.items()],
        "mean": earlier.mean,
        "low": earlier.interval[0],
        "high": earlier.interval[1],
    }


def _middles(grid: Grid, axis: str) -> Iterable[tuple[str, float]]:
    """Every row with its middle x, or every column with its middle y, over the waypoints on it."""
    names = grid.rows if axis == "row" else grid.columns
    for index, name in enumerate(names):
        on_it = [w for w in grid.waypoints if getattr(w, axis) == index]
        values = sorted(w.x if axis == "row" else w.y for w in on_it)
        if values:
            yield name, values[len(values) // 2]
