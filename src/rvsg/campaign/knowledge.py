"""What is known of a place: attempts, findings, lessons and rejected plans, as entries that stand for themselves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.finding import Finding
from rvsg.campaign.suite import CaseResult
from rvsg.core.records import Record
from rvsg.evaluation.judge import violated
from rvsg.evaluation.verdict import Status, Verdict
from rvsg.scenario.brief import Remembered
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission, Scenario
from rvsg.scenario.variation import waypoints_used

Kind = Literal["attempt", "finding", "rejected", "watched"]


class Entry(Record):
    """One thing that is known. Equal content has an equal id, so it is kept once."""

    kind: Kind
    """`attempt`: a configuration of a search. `finding`: a confirmed scenario, or a case of a suite. `rejected`: a plan
    that broke a rule. `watched`: what a recording of the robot shows."""
    world: str
    place: str
    """Content id of everything solid in the world, so that a new label is no new place."""
    route: str
    requirement: str
    description: str
    scenario: Scenario | None = None
    simulator: str = ""
    """What made the runs; empty if there is none."""
    verdict: Verdict | None = None
    lessons: tuple[str, ...] = ()
    """What to learn from it: who causes it, why it was rejected."""
    story: tuple[str, ...] = ()

    @property
    def violates(self) -> bool | None:
        """Return whether the requirement is violated more than rarely; None if the runs do not tell."""
        if self.verdict is None:
            return None
        return True if violated(self.verdict) else False if self.verdict.status is Status.PASS else None

    @property
    def waypoints(self) -> tuple[str, ...]:
        """Return where its people walk."""
        return () if self.scenario is None else waypoints_used(self.scenario.people)


def entries_of_campaign(
    attempts: Sequence[Attempt],
    findings: Sequence[Finding],
    mission: Mission,
    requirement: Requirement,
    place: str,
    simulator: str,
) -> Iterator[Entry]:
    """Yield what a campaign teaches: its attempts, its confirmations with their causes, its rejected proposals."""
    base = {"world": mission.world, "place": place, "route": mission.route.name, "requirement": requirement.name}
    found = {finding.confirmation: finding for finding in findings}
    for attempt in attempts:
        scenario = attempt.proposal.scenario
        if attempt.purpose == "search" and scenario is None and attempt.proposal.problems:
            lessons = tuple(str(problem) for problem in attempt.proposal.problems)
            yield Entry(kind="rejected", description=attempt.proposal.reasoning[:500], lessons=lessons, **base)
        if scenario is None or attempt.verdict is None or not scenario.people.humans:
            continue
        of_it = {"scenario": scenario, "description": scenario.description, "simulator": simulator}
        if attempt.purpose == "search":
            yield Entry(kind="attempt", verdict=attempt.verdict, **of_it, **base)
        elif attempt.index in found:
            finding = found[attempt.index]
            lessons = tuple(_lessons(finding))
            yield Entry(kind="finding", verdict=attempt.verdict, lessons=lessons, story=finding.story, **of_it, **base)


def entry_of_case(scenario: Scenario, result: CaseResult, place: str, simulator: str) -> Entry:
    """Return what the result of a suite's case teaches."""
    return Entry(
        kind="finding",
        world=scenario.mission.world,
        place=place,
        route=scenario.mission.route.name,
        requirement=result.verdict.requirement,
        description=scenario.description or result.title,
        scenario=scenario,
        simulator=simulator,
        verdict=result.verdict,
        lessons=(f"Case {result.case} of a suite: {result.state.value}.",),
        story=result.story,
    )


def remembered(entries: Sequence[Entry]) -> tuple[Remembered, ...]:
    """Return entries as earlier scenarios for a generator; leave out those without a mean objective."""
    return tuple(
        Remembered(
            description=entry.description,
            tasks={human.name: tuple(task.name for task in human.tasks) for human in entry.scenario.people.humans},
            mean=entry.verdict.mean,
            interval=entry.verdict.interval or (entry.verdict.mean, entry.verdict.mean),
            scenario=entry.scenario,
        )
        for entry in entries
        if entry.scenario is not None and entry.verdict is not None and entry.verdict.mean is not None
    )


def _lessons(finding: Finding) -> Iterator[str]:
    if finding.about_people == "no":
        yield "It is not about the people: without them the requirement is violated, too."
    elif finding.about_people == "yes" and finding.without_people is not None:
        alone = finding.without_people
        yield f"The people cause it: without them {alone.violated} of {alone.of} runs violate the requirement."
    for each in finding.cause:
        yield f"Without {each.without} {each.violated} of {each.of} runs violate it, with everybody {each.before}."
    if not finding.violated:
        yield "Confirmation runs did not show what the search had shown."
