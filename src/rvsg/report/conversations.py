"""How the configurations of a search came to be: feedback, reasoning, checks, calls of a model, planned paths."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from markupsafe import Markup

from rvsg.evaluation.verdict import metres, number, percent, value_in_words
from rvsg.findings.ranking import search_attempts
from rvsg.generation.generator import Call
from rvsg.generation.vlm.call_log import CallLog
from rvsg.report.renderer import render
from rvsg.report.replay_data import distinct_colours
from rvsg.report.stills import plan_markup
from rvsg.report.terminal import describe_calls
from rvsg.runs.attempt import Attempt
from rvsg.scenario.brief import Feedback
from rvsg.scenario.scenario import Human
from rvsg.world.drawing.svg import floor_plan
from rvsg.world.world import World

MOST_CHARACTERS = 600_000
"""Characters of conversations that a page holds; the record beside the campaign holds all."""


class Transcript:
    """What was said in the calls of a campaign. Every message is given once, where it is said first.

    Args:
        picture: returns the address of a kept picture by its digest, empty where it is not kept; None: show none.
        most: characters of it in all.
    """

    def __init__(
        self, recording: CallLog | None, *, picture: Callable[[str], str] | None = None, most: int = MOST_CHARACTERS
    ) -> None:
        self._recording, self._picture, self._left = recording, picture, most
        answered_last = sorted(recording or (), key=lambda call: call.answer is not None)
        self._calls = {call.key: call for call in answered_last}
        self._said: set[str] = set()
        self._answers: set[str] = set()

    def of(self, calls: Sequence[Call]) -> list[dict[str, Any]]:
        """Return what each call took, and new messages and answer where it is on record."""
        return [self._call(call) for call in calls]

    def _call(self, call: Call) -> dict[str, Any]:
        cost = "" if call.cost_usd is None else f", {call.cost_usd:.4f} USD"
        took = f"{call.input_tokens} tokens in, {call.output_tokens} out{cost}, {call.latency_s:.1f} s"
        shown = {"purpose": call.purpose, "model": call.model, "took": took, "said": [], "answer": call.error or ""}
        record = self._calls.get(call.recording or "")
        if record is None or self._recording is None:
            return shown
        messages = []
        for message_id in record.messages:
            if message_id in self._said:
                continue
            self._said.add(message_id)
            message = self._recording.message(message_id)
            if message.role == "assistant" and message.text in self._answers:
                continue
            digests = dict.fromkeys(picture.digest for picture in message.pictures) if self._picture else ()
            images = [address for digest in digests if self._picture and (address := self._picture(digest))]
            said = {"role": message.role, "text": self._room(message.text), "pictures": len(message.pictures)}
            messages.append(said | {"images": images, "lost": len(digests) - len(images)})
        self._answers |= {record.answer.text} if record.answer is not None else set()
        answer = record.answer.text if record.answer is not None else f"No answer: {record.error}"
        return shown | {"said": messages, "answer": self._room(answer)}

    def _room(self, text: str) -> str:
        """Return the text, cut where the page has no room left for it."""
        fitting = text[: max(0, self._left)]
        self._left -= len(fitting)
        more = len(text) - len(fitting)
        return f"{fitting} … ({more} more characters in the record)" if more else text


WIDTH_M, WIDEST = 0.12, 3
"""Width of a planned path; those drawn under others are wider, up to so many times more, so that all are seen."""


def thinking(attempts: Iterable[Attempt], unit: str, world: World, transcript: Transcript) -> list[dict[str, Any]]:
    """Return one entry for each scenario of the search, with its configurations in their order."""
    searched = search_attempts(attempts)
    people = [len(scenario.people.humans) for attempt in searched if (scenario := attempt.proposal.scenario)]
    colours = distinct_colours(max(people, default=0))
    entries: dict[int, dict[str, Any]] = {}
    before: dict[int, Sequence[Human]] = {}
    for attempt in searched:
        index, proposal, scenario = attempt.brief.scenario_index, attempt.proposal, attempt.proposal.scenario
        humans = scenario.people.humans if scenario else ()
        entry = entries.setdefault(index, {"scenario": index, "description": "", "configurations": []})
        entry["description"] = entry["description"] or (scenario.description if scenario else "")
        step = {
            "attempt": attempt.index,
            "valid": scenario is not None,
            "number": attempt.brief.configuration_index + 1,
            "result": value_in_words(attempt.verdict, unit) if attempt.verdict else "not simulated",
            "reasoning": proposal.reasoning,
            "feedback": _feedback(attempt.brief.feedback, unit),
            "memory": len(attempt.brief.memory),
            "findings": [finding.reason for finding in proposal.first_findings],
            "repairs": [f"{repair.human}: {repair.what}" for repair in proposal.repairs],
            "problems": [finding.reason for finding in proposal.problems],
            "corrections": proposal.corrections,
            "calls": _calls(proposal.calls),
            "paths": _paths(humans, before.get(index, ()), world, colours),
            "changed": index in before,
            "people": [{"name": human.name, "colour": css} for human, css in zip(humans, colours, strict=False)],
            "talk": transcript.of(proposal.calls),
        }
        entry["configurations"].append(step)
        if scenario is not None:
            before[index] = humans
    return list(entries.values())


def conversation_markup(
    attempts: Iterable[Attempt], unit: str, world: World, transcript: Transcript, *, finding: Callable[[int], str]
) -> Markup:
    """Return how the configurations came to be, as a part of another page.

    Args:
        finding: returns the address of the page of an attempt.
    """
    thoughts = thinking(attempts, unit, world, transcript)
    plan = plan_markup(world, floor_plan(world, tooltips=False))
    return render("conversation.html", thoughts=thoughts, finding=finding, **plan)


def _feedback(feedback: Feedback | None, unit: str) -> list[str]:
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
    lines += [feedback.unusual] if feedback.unusual else []
    lines += [
        f"{person.name}: closest gap {metres(person.closest_gap_m)}, within 2 m for "
        f"{percent(person.share_within_2_m)} of the time."
        for person in feedback.influences
    ]
    return lines


def _calls(calls: Sequence[Call]) -> str:
    took, purposes = sum(call.latency_s for call in calls), ", ".join(call.purpose for call in calls)
    return f"{describe_calls(calls)} {took:.1f} s ({purposes})" if calls else ""


def _paths(
    humans: Sequence[Human], before: Sequence[Human], world: World, colours: Sequence[str]
) -> list[dict[str, Any]]:
    """Return the planned paths on the floor plan, and those of the configuration before that differ."""
    at = {w.name: (w.x, w.y) for w in world.grid.waypoints}
    transform = floor_plan(world, tooltips=False).transform

    def names(human: Human) -> list[str]:
        return [name for task in human.tasks for name in task.path]

    now = {human.name: names(human) for human in humans}
    drawn = [
        ("planned", place, WIDTH_M * (1 + min(WIDEST, len(humans) - 1 - place)), human)
        for place, human in enumerate(humans)
    ]
    drawn += [
        ("planned before", place, WIDTH_M, human)
        for place, human in enumerate(before if humans else ())
        if now.get(human.name) != names(human)
    ]
    paths = []
    for kind, place, width, human in drawn:
        points = [transform.point(*at[name]) for name in names(human) if name in at]
        if points:
            paths.append({"kind": kind, "colour": colours[place % len(colours)], "width": width, "points": points})
    return paths
