"""Contents of the report page: attempts, tables, facts of runs and the conversation with the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from rvsg.evaluation.verdict import metres, number, outcome_in_words, percent, value_in_words
from rvsg.findings.ranking import best_attempt, confirmed_candidate, search_attempts
from rvsg.generation.generator import Call
from rvsg.generation.vlm.call_log import CallLog, RecordedCall
from rvsg.report.answer_row import status_of
from rvsg.report.replay_data import distinct_colours, people_colours
from rvsg.report.result import Answer, Result
from rvsg.report.run_facts import AttemptFacts, facts_of, footprint_of
from rvsg.report.stills import Look, Turn
from rvsg.report.terminal import describe_calls
from rvsg.report.words import in_short, shown_at
from rvsg.runs.attempt import Attempt
from rvsg.scenario.brief import Feedback
from rvsg.scenario.scenario import Attention, Behaviour, Human
from rvsg.world.drawing.svg import FloorPlan, floor_plan


@dataclass(frozen=True, eq=False)
class PageContents:
    """What the parts of a page share."""

    result: Result
    answer: Answer

    @cached_property
    def facts(self) -> list[AttemptFacts]:
        """The runs of every attempt that was simulated."""
        result = self.result
        return facts_of(result.attempts, result.requirement, result.world, result.run_of)

    @cached_property
    def floor(self) -> FloorPlan:
        """The floor plan without tooltips."""
        return floor_plan(self.result.world, tooltips=False)

    @property
    def confirmed(self) -> AttemptFacts | None:
        """The confirmation runs of the first finding."""
        wanted = self.result.confirmed
        return next((f for f in self.facts if wanted is not None and f.attempt.index == wanted.index), None)

    @property
    def candidate(self) -> Attempt | None:
        """The configuration of the search that the first finding confirms."""
        confirmed = self.result.confirmed
        return confirmed_candidate(confirmed, self.result.attempts) if confirmed is not None else None

    @property
    def subject(self) -> AttemptFacts | None:
        """What the page tells of: the confirmed finding, else the worst candidate."""
        best = best_attempt(self.result.attempts, self.result.requirement)
        return self.confirmed or next((f for f in self.facts if best and f.attempt.index == best.index), None)


def look_of(shown: PageContents, facts: AttemptFacts) -> Look:
    """Return how still pictures of these runs are drawn."""
    runs = [each.run for each in facts.runs]
    return Look(
        turn=Turn.of(shown.floor.matrix),
        view_box=shown.floor.view_box,
        outline=footprint_of(runs[0], shown.result.plan.mission.robot_record),
        colours=people_colours(runs),
    )


def in_order(shown: PageContents) -> list[AttemptFacts]:
    """Sort: the subject first, then other confirmations, then the search by rank, then the rest.

    A configuration that the search measured several times, each time in more runs, is shown with all of them.
    """
    rank = {entry.attempt: entry.rank for entry in shown.result.ranking}
    subject = shown.subject
    return sorted(
        _fullest(shown.facts, shown.subject),
        key=lambda f: (
            f is not subject,
            f.attempt.purpose != "confirmation",
            rank.get(f.attempt.index, len(rank) + 1),
            f.attempt.index,
        ),
    )


def _fullest(facts: Sequence[AttemptFacts], subject: AttemptFacts | None) -> list[AttemptFacts]:
    """Leave out attempts whose runs a later one of the same purpose holds, with more.

    A search may measure a configuration several times, and a confirmation may be continued.
    """
    runs = {each.attempt.index: {run.id for run in each.runs} for each in facts}
    held: dict[tuple[str, str], list[AttemptFacts]] = {}
    for each in facts:
        if each.attempt.purpose in ("search", "confirmation"):
            held.setdefault(_kind(each), []).append(each)

    def superseded(each: AttemptFacts) -> bool:
        mine, index = runs[each.attempt.index], each.attempt.index
        others = ((runs[other.attempt.index], other.attempt.index) for other in held.get(_kind(each), []))
        return any(mine < theirs or (mine == theirs and other < index) for theirs, other in others)

    return [each for each in facts if each is subject or not superseded(each)]


def _kind(facts: AttemptFacts) -> tuple[str, str]:
    scenario = facts.attempt.proposal.scenario
    return facts.attempt.purpose, scenario.id if scenario is not None else ""


def group_label(facts: AttemptFacts) -> str:
    """Return what a set of runs is called in menus and tables."""
    attempt = facts.attempt
    verdict = attempt.verdict
    scenario = attempt.number
    match attempt.purpose:
        case "baseline":
            return "Mission without people"
        case "removal":
            return f"{scenario}, without {', '.join(attempt.without)}"
        case "shrinking":
            return f"{scenario}, shrunk"
        case "confirmation":
            return f"{scenario}, confirmation{f', {status_of(verdict)}' if verdict else ''}"
        case _:
            return f"{scenario}, search"


REACTS = {
    Behaviour.REGULAR: "treats the robot as a person (regular)",
    Behaviour.IMPASSIVE: "ignores the robot (impassive)",
    Behaviour.SURPRISED: "stops and looks at the robot (surprised)",
    Behaviour.SCARED: "shies away from the robot (scared)",
    Behaviour.CURIOUS: "approaches the robot (curious)",
    Behaviour.THREATENING: "blocks the robot's way (threatening)",
}
"""How a person reacts to the robot, with the name of the behaviour in HuNavSim."""
LOOKS = {Attention.DISTRACTED: "notices others late (distracted)", Attention.UNSEEING: "does not see others (unseeing)"}


def tasks_of(human: Human) -> list[str]:
    """Return what a person is asked to do, a line for each task."""
    return [
        f"{task.name}: {' '.join(task.path)}"
        + "".join(f"; stands {number(pause.duration_s, 's')} at {pause.at}" for pause in task.pauses)
        for task in human.tasks
    ]


def manner(human: Human) -> str:
    """Return how a person walks and reacts, in a few words."""
    ways = [f"{REACTS[human.behaviour]}, {number(human.speed_m_s, 'm/s')}"]
    if human.attention is not Attention.ATTENTIVE:
        ways.append(LOOKS[human.attention])
    if human.start_delay_s:
        ways.append(f"starts after {number(human.start_delay_s, 's')}")
    if human.group is not None:
        ways.append(f"group {human.group}")
    return ", ".join(ways)


def at(run_id: str, t_s: float | None = None) -> str:
    """Return the part of the page's address that opens a run, at a time."""
    return f"#run={run_id}" + (f"&t={shown_at(t_s)}" if t_s is not None else "")


def scenario_rows(shown: PageContents) -> list[dict[str, Any]]:
    """Return every scenario and every further confirmed configuration: its row, and what belongs to its fold."""
    attempts = {attempt.index: attempt for attempt in shown.result.attempts}
    by_index = {each.attempt.index: each for each in shown.facts}
    rows = []
    for row in shown.answer.rows:
        attempt = attempts[row.attempt]
        facts = by_index[row.shown_attempt]
        scenario = attempt.proposal.scenario
        assert scenario is not None
        rows.append(
            {
                "row": row,
                "description": scenario.description or in_short(scenario),
                "address": "#runs=" + ",".join(run.id for run in facts.runs),
                "people": [(human.name, manner(human), tasks_of(human)) for human in scenario.people.humans],
                "repairs": [f"{repair.human}: {repair.what}" for repair in attempt.proposal.repairs],
            }
        )
    return rows


def run_rows(shown: PageContents) -> list[dict[str, Any]]:
    """Return every recorded run of the campaign, for the table at the end."""
    unit = shown.result.requirement.unit
    return [row | {"of": group_label(facts)} for facts in in_order(shown) for row in run_rows_of(facts, unit)]


def run_rows_of(facts: AttemptFacts, unit: str) -> list[dict[str, Any]]:
    """Return the runs of one configuration for a table."""
    return [
        {
            "id": run.id,
            "address": at(run.id),
            "seed": run.run.seed,
            "objective": number(run.measurement.objective, unit),
            "violated": run.violated,
            "outcome": outcome_in_words(run.run.outcome),
            "contacts": len(run.contacts),
            "gap": metres(run.closest_m) if run.closest_m is not None else "–",
            "late": not run.arrived,
        }
        for run in facts.runs
    ]


MOST_CHARACTERS = 600_000
"""Characters of conversations that a page holds; the record beside the campaign holds all."""


class Conversations:
    """What was said in the calls of a campaign. Every message is given once, where it is said first."""

    def __init__(self, recording: CallLog | None) -> None:
        self._recording = recording
        answered_last = sorted(recording or (), key=lambda call: call.answer is not None)
        self._calls = {call.key: call for call in answered_last}
        self._said: set[str] = set()
        self._answers: set[str] = set()
        self._left = MOST_CHARACTERS

    def of(self, calls: Sequence[Call]) -> list[dict[str, Any]]:
        """Return purpose, new messages and answer of each call that is on record."""
        found = []
        for call in calls:
            kept = self._calls.get(call.recording or "")
            if kept is not None and self._recording is not None:
                found.append(self._one(kept, self._recording))
        return found

    def _one(self, call: RecordedCall, recording: CallLog) -> dict[str, Any]:
        said = []
        for message_id in call.messages:
            if message_id in self._said:
                continue
            self._said.add(message_id)
            message = recording.message(message_id)
            if message.role == "assistant" and message.text in self._answers:
                continue
            said.append({"role": message.role, "text": self._room(message.text), "pictures": len(message.pictures)})
        self._answers |= {call.answer.text} if call.answer is not None else set()
        answer = call.answer.text if call.answer is not None else f"No answer: {call.error}"
        return {"purpose": call.purpose, "said": said, "answer": self._room(answer)}

    def _room(self, text: str) -> str:
        """Return the text, cut where the page has no room left for it."""
        kept = text[: max(0, self._left)]
        self._left -= len(kept)
        return kept if len(kept) == len(text) else f"{kept} … ({len(text) - len(kept)} more characters in the record)"


WIDTH_M, WIDEST = 0.12, 3
"""Width of a planned path; those drawn under others are wider, up to so many times more, so that all are seen."""


def thinking(shown: PageContents, recording: CallLog | None) -> list[dict[str, Any]]:
    """Return one entry for each scenario of the search, with its configurations in their order."""
    conversations = Conversations(recording)
    unit = shown.result.requirement.unit
    made = [attempt.proposal.scenario for attempt in shown.result.attempts if attempt.proposal.scenario]
    colours = distinct_colours(max((len(scenario.people.humans) for scenario in made), default=0))
    found: dict[int, dict[str, Any]] = {}
    before: dict[int, Sequence[Human]] = {}
    for attempt in search_attempts(shown.result.attempts):
        index, proposal, scenario = attempt.brief.scenario_index, attempt.proposal, attempt.proposal.scenario
        humans = scenario.people.humans if scenario else ()
        entry = found.setdefault(index, {"scenario": index, "description": "", "configurations": []})
        entry["description"] = entry["description"] or (scenario.description if scenario else "")
        step = {
            "number": attempt.brief.configuration_index + 1,
            "result": value_in_words(attempt.verdict, unit) if attempt.verdict else "not simulated",
            "reasoning": proposal.reasoning,
            "told": _feedback(attempt.brief.feedback, unit),
            "memory": len(attempt.brief.memory),
            "findings": [finding.reason for finding in proposal.first_findings],
            "repairs": [f"{repair.human}: {repair.what}" for repair in proposal.repairs],
            "problems": [finding.reason for finding in proposal.problems],
            "corrections": proposal.corrections,
            "calls": _calls(proposal.calls),
            "paths": _paths(humans, before.get(index, ()), shown, colours),
            "changed": index in before,
            "people": [{"name": each.name, "colour": css} for each, css in zip(humans, colours, strict=False)],
            "talk": conversations.of(proposal.calls),
        }
        entry["configurations"].append(step)
        if scenario is not None:
            before[index] = humans
    return list(found.values())


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
        f"{each.name}: closest gap {metres(each.closest_gap_m)}, within 2 m for {percent(each.share_within_2_m)} of "
        "the time."
        for each in feedback.influences
    ]
    return lines


def _calls(calls: Sequence[Call]) -> str:
    took, purposes = sum(call.latency_s for call in calls), ", ".join(call.purpose for call in calls)
    return f"{describe_calls(calls)} {took:.1f} s ({purposes})" if calls else ""


def _paths(
    humans: Sequence[Human], before: Sequence[Human], shown: PageContents, colours: Sequence[str]
) -> list[dict[str, Any]]:
    """Return the planned paths on the floor plan, and those of the configuration before that differ."""
    at = {w.name: (w.x, w.y) for w in shown.result.world.grid.waypoints}
    turn = Turn.of(shown.floor.matrix)

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
    found = []
    for kind, place, width, human in drawn:
        points = [turn.point(*at[name]) for name in names(human) if name in at]
        if points:
            found.append({"kind": kind, "colour": colours[place % len(colours)], "width": width, "points": points})
    return found
