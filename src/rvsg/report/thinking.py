"""Reasoning of the generator: per configuration its thoughts, its information, its changes and its cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rvsg.campaign.attempt import Attempt, Plan
from rvsg.campaign.ranking import search_attempts
from rvsg.evaluation.wording import counted, number, percent
from rvsg.generation.generator import Call
from rvsg.report.conversation import Conversations
from rvsg.report.frames import Look
from rvsg.report.summary import interval
from rvsg.report.words import metres
from rvsg.scenario.brief import Feedback
from rvsg.scenario.scenario import HumanConfiguration
from rvsg.world.world import World

WIDTH_M, WIDEST = 0.12, 3
"""Width of a planned path; those drawn under others are wider, up to so many times more, so that all are seen."""


def thinking(
    plan: Plan,
    attempts: Sequence[Attempt],
    world: World,
    look: Look,
    colours: Sequence[str],
    conversations: Conversations,
) -> list[dict[str, Any]]:
    """Return one entry for each scenario of the search, with its configurations in their order."""
    found: dict[int, dict[str, Any]] = {}
    before: dict[int, HumanConfiguration] = {}
    for attempt in search_attempts(attempts):
        index = attempt.brief.scenario_index
        scenario = attempt.proposal.scenario
        entry = found.setdefault(index, {"scenario": index, "description": "", "configurations": []})
        entry["description"] = entry["description"] or (scenario.description if scenario else "")
        made = _configuration(plan, attempt, world, look, before.get(index), colours)
        entry["configurations"].append(made | {"talk": conversations.of(attempt.proposal.calls)})
        if scenario is not None:
            before[index] = scenario.people
    return list(found.values())


def _configuration(
    plan: Plan,
    attempt: Attempt,
    world: World,
    look: Look,
    before: HumanConfiguration | None,
    colours: Sequence[str],
) -> dict[str, Any]:
    proposal, unit = attempt.proposal, plan.requirement.unit
    return {
        "number": attempt.brief.configuration_index + 1,
        "result": interval(attempt.verdict, unit) if attempt.verdict else "not simulated",
        "reasoning": proposal.reasoning,
        "told": _feedback(attempt.brief.feedback, unit),
        "memory": len(attempt.brief.memory),
        "findings": [finding.reason for finding in proposal.first_findings],
        "repairs": [f"{repair.human}: {repair.what}" for repair in proposal.repairs],
        "problems": [finding.reason for finding in proposal.problems],
        "corrections": proposal.corrections,
        "calls": _calls(proposal.calls),
        "map": _paths(proposal.scenario.people if proposal.scenario else None, before, world, look, colours),
        "changed": before is not None,
        "people": _who(proposal.scenario.people if proposal.scenario else None, colours),
    }


def _feedback(feedback: Feedback | None, unit: str) -> list[str]:
    """Return what the generator knew of the configuration before."""
    if feedback is None:
        return []
    low, high = feedback.interval
    lines = [f"Mean {number(feedback.mean, unit)} ({number(low)} to {number(high, unit)})."]
    if feedback.violation_share is not None:
        lines.append(f"Violated in {percent(feedback.violation_share)} of runs.")
    lines += [
        f"{moment.time_s:.1f} s: robot at {moment.robot_at}, {moment.closest_human} is {metres(moment.gap_m)} away"
        f"{'; ' + moment.note.replace('m/s2', 'm/s²') if moment.note else ''}."
        for moment in feedback.moments
    ]
    lines += [
        f"{each.name}: closest gap {metres(each.closest_gap_m)}, within 2 m for {percent(each.share_within_2_m)} of "
        "the time."
        for each in feedback.influences
    ]
    return lines


def _calls(calls: Sequence[Call]) -> str:
    """Return what the calls of a model took."""
    if not calls:
        return ""
    tokens = sum(call.input_tokens for call in calls)
    out = sum(call.output_tokens for call in calls)
    costs = [call.cost_usd for call in calls]
    price = f", {sum(c for c in costs if c is not None):.4f} USD" if None not in costs else ", cost unknown"
    seconds = sum(call.latency_s for call in calls)
    return (
        f"{counted(len(calls), 'call')} of {calls[0].model}: {tokens} tokens in, {out} out{price}, {seconds:.1f} s "
        f"({', '.join(call.purpose for call in calls)})"
    )


def _paths(
    people: HumanConfiguration | None,
    before: HumanConfiguration | None,
    world: World,
    look: Look,
    colours: Sequence[str],
) -> str:
    """Draw the planned paths on the floor plan; those of the configuration before are dashed."""
    if people is None:
        return ""
    at = {w.name: (w.x, w.y) for w in world.grid.waypoints}
    parts = [f'<svg class="still paths" viewBox="{look.view_box}" role="img" aria-label="Planned paths">']
    parts.append('<use href="#rvsg-floor"/>')
    for configuration, kind in ((people, "planned"), (before, "planned before")):
        for place, human in enumerate(configuration.humans if configuration else ()):
            if before is not None and kind == "planned before" and _same_path(human.name, before, people):
                continue
            under = min(WIDEST, len(configuration.humans) - 1 - place) if configuration else 0
            colour = colours[place % len(colours)]
            width = WIDTH_M * (1 + under) if kind == "planned" else WIDTH_M
            parts.append(_path(_waypoints(human), at, look, colour, kind, width))
    return "".join([*parts, "</svg>"])


def _who(people: HumanConfiguration | None, colours: Sequence[str]) -> list[dict[str, str]]:
    """Return the names of the people and the colours of their paths."""
    humans = people.humans if people else ()
    return [{"name": human.name, "colour": colours[k % len(colours)]} for k, human in enumerate(humans)]


def _waypoints(human: Any) -> list[str]:
    return [name for task in human.tasks for name in task.path]


def _same_path(name: str, before: HumanConfiguration, after: HumanConfiguration) -> bool:
    paths = [[_waypoints(h) for h in people.humans if h.name == name] for people in (before, after)]
    return paths[0] == paths[1]


def _path(
    names: Sequence[str], at: Mapping[str, tuple[float, float]], look: Look, colour: str, kind: str, width: float
) -> str:
    known = np.array([at[name] for name in names if name in at])
    if not len(known):
        return ""
    x, y = look.turn.points(known[:, 0], known[:, 1])
    points = " ".join(f"{a:.2f},{b:.2f}" for a, b in zip(x, y, strict=True))
    start = f'<circle r="0.2" cx="{x[0]:.2f}" cy="{y[0]:.2f}" fill="{colour}"/>' if kind == "planned" else ""
    return f'<polyline class="{kind}" stroke="{colour}" stroke-width="{width:.2f}" points="{points}"/>{start}'
