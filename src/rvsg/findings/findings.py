"""Findings: what the confirmations of a campaign say, how often, what happened, and whether it was the people."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Annotated, Literal

from pydantic import Field

from rvsg.core.records import Record
from rvsg.evaluation.realism import PEOPLE_REALISM, RARE_PERCENT, Motion, is_left_out, motions, rarest, summary
from rvsg.evaluation.statistics import fisher, holm, share_difference
from rvsg.evaluation.story import story_of
from rvsg.evaluation.verdict import (
    Arrivals,
    Contacts,
    Procedure,
    Status,
    Verdict,
    how_sure,
    summarise_safety,
    violated,
)
from rvsg.findings.ranking import confirmations
from rvsg.runs.attempt import Attempt, Measurement, Plan
from rvsg.runs.observation import FailureMode, mode_of, usual
from rvsg.scenario.brief import Remembered
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission, Scenario
from rvsg.scenario.variation import waypoints_used
from rvsg.simulation.run import Run
from rvsg.suites.suite import CaseResult
from rvsg.world.world import World

RunOf = Callable[[str], Run]


class Share(Record):
    """Runs that violate the requirement, of how many."""

    violated: int
    of: int
    unmeasured: Annotated[int, Field(exclude_if=lambda runs: runs == 0)] = 0
    """Of these runs, those that the requirement cannot measure, e.g. a distance to people where there are none."""

    @property
    def measures_nothing(self) -> bool:
        """Whether the requirement measures none of the runs."""
        return self.of > 0 and self.unmeasured == self.of

    @property
    def probability(self) -> float:
        """The share; 0 of no runs is 0."""
        return self.violated / self.of if self.of else 0.0


class Removal(Record):
    """The scenario without one of its people, on the same seeds."""

    without: str
    """The person left out."""
    violated: int
    of: int
    before: int
    """Violations with everybody, in the same number of runs."""
    p: float = 1.0
    """One-sided p value of Fisher's exact test against all confirmation runs, corrected by Holm over all people."""


class Smallest(Record):
    """The smallest form of a failure."""

    attempt: int
    """The attempt that holds it."""
    scenario_id: str
    taken_away: tuple[str, ...]
    """What of the confirmed scenario does not matter."""
    violated: int
    of: int
    before: int
    """Violations of the confirmed scenario on the same seeds."""
    judged_by: Annotated[Procedure, Field(exclude=True)]
    """The procedure that judged the confirmed scenario."""

    @property
    def rarer(self) -> float:
        """The one-sided p value of Fisher's exact test that it violates no more rarely than the confirmed scenario."""
        return fisher(self.before, self.of, self.violated, self.of)

    @property
    def holds(self) -> bool:
        """Whether it still shows the failure: it violates more than rarely, and not more rarely than before.

        Both with the error rate of a verdict; 1 of 10 runs against 1 of 10 tells nothing.
        """
        told_apart = self.rarer <= self.judged_by.error_rate
        violates = self.judged_by.violated(self.violated, self.of)
        return violates and not told_apart and 2 * self.violated >= self.before


AboutPeople = Literal["yes", "no", "open", "not violated"]
RECURS_WITHIN = 0.2
"""A violation recurs without people where it is at most this much rarer then, as a share of the runs."""


class Finding(Record):
    """A confirmed scenario. Whether it is a finding about people is `about_people`."""

    scenario: int
    """The scenario's number, from 0."""
    configuration: int = 0
    """The number of its configuration, from 0."""
    attempt: int
    """The attempt of the search that is confirmed."""
    confirmation: int
    """The attempt that confirms it."""
    scenario_id: str
    description: str
    verdict: Verdict
    violated: bool
    """Whether the requirement is violated more than rarely, with the error rate of the procedure."""
    violation_probability: float | None
    interval: tuple[float, float] | None
    """The two-sided Clopper-Pearson interval of the violation probability."""
    how_sure: str = ""
    """How sure the verdict is: the share with its interval, and what the tests of the verdict rule out."""
    contacts: Contacts
    arrived: Arrivals
    least_clearance_m: float | None
    without_people: Share | None
    """The mission without people on the same seeds; None if it was not run."""
    difference: float | None = None
    """Violation probability with these people less that without them."""
    difference_interval: tuple[float, float] | None = None
    about_people: AboutPeople = "open"
    """`yes`: the difference is above 0 beyond chance. `no`: it is not, it is at most `RECURS_WITHIN`, and the mission
    alone violates more than rarely. `open`: the runs do not tell."""
    cause: tuple[Removal, ...] = ()
    """What removing each person does."""
    smallest: Smallest | None = None
    """Its smallest form; None if it was not shrunk."""
    failure: FailureMode | None = None
    """How most of the violating runs fail; None if none violates."""
    story: tuple[str, ...] = ()
    """What happens in the run that is worst for the robot."""
    story_run: str | None = None
    """The id of that run."""
    realism: str = ""
    """Whether anybody in the violating runs does what fewer than 1 in 100 recorded people did; without violating runs,
    in all."""
    rare: Annotated[bool, Field(exclude_if=lambda rare: not rare)] = False
    """Whether somebody in the run that is worst for the robot does."""

    @property
    def number(self) -> str:
        """Scenario and configuration, from 1, e.g. `3.2`."""
        return f"{self.scenario + 1}.{self.configuration + 1}"

    @property
    def blamed(self) -> tuple[Removal, ...]:
        """The people whose removal makes violations rarer, with the error rate of the verdict; the clearest first."""
        told = (each for each in self.cause if each.p <= self.verdict.judged_by.error_rate)
        return tuple(sorted(told, key=lambda each: each.p))

    @property
    def also_alone(self) -> bool:
        """Whether it also happens without people, and the runs do not tell whether they make it more frequent."""
        return self.about_people == "open" and self.without_people is not None and self.without_people.violated > 0


def findings(
    plan: Plan,
    attempts: Sequence[Attempt],
    *,
    run_of: RunOf,
    world: World,
    mode_of_run: Callable[[str], FailureMode | None] | None = None,
) -> tuple[Finding, ...]:
    """Return every confirmation with what it means, the worst first.

    Args:
        run_of: finds a run by its id.
        mode_of_run: tells how the run of an id fails; by default `run_of` finds it.
    """
    modes = mode_of_run or (lambda run_id: mode_of(run_of(run_id), world))
    confirmed = [a for a in confirmations(attempts) if a.verdict is not None]
    confirmed.sort(key=lambda attempt: severity_of(attempt, plan.requirement), reverse=True)
    return tuple(_finding(plan, attempt, attempts, run_of, modes, world) for attempt in confirmed)


def rarest_motion(measurements: Iterable[Measurement], run_of: RunOf) -> tuple[Run, Motion] | None:
    """Return what the fewest recorded people do as far, of all people in simulated runs, and the run that shows it."""
    shares = {m.run_id: share for m in measurements if (share := m.values.get(PEOPLE_REALISM)) is not None}
    if not shares:
        return None
    run = run_of(min(shares, key=lambda run_id: shares[run_id]))
    motion = rarest(motions(run))
    return (run, motion) if motion is not None and run.simulator != "recording" else None


def realism_in_words(found: tuple[Run, Motion] | None) -> str:
    """Return the rarest motion as a sentence, empty where there is none."""
    if found is None:
        return ""
    run, motion = found
    return f"With seed {run.seed}, {motion.sentence}" if motion.is_rare else summary([motion])


class DistinctFailure(Record):
    """A way in which the robot fails, with the confirmed scenarios that show it."""

    mode: FailureMode
    words: str
    attempts: tuple[int, ...]
    """The attempts of the search that were confirmed, the worst first."""
    violation_probability: float
    """Of the worst of them."""
    about_people: AboutPeople
    """Of the worst of them."""
    without_people: Share | None = None
    cause: tuple[Removal, ...] = ()
    """What removing each person from the worst of them does."""
    smallest: Smallest | None = None
    """The worst of them, shrunk; None if it was not."""


def distinct_failures(found: Sequence[Finding]) -> tuple[DistinctFailure, ...]:
    """Group the confirmed violations by where and how the robot fails; the worst group first."""
    groups: dict[FailureMode, list[Finding]] = {}
    for finding in found:
        if finding.violated and finding.failure is not None:
            groups.setdefault(finding.failure, []).append(finding)
    return tuple(
        DistinctFailure(
            mode=mode,
            words=mode.words,
            attempts=tuple(finding.attempt for finding in group),
            violation_probability=group[0].violation_probability or 0.0,
            about_people=group[0].about_people,
            without_people=group[0].without_people,
            cause=group[0].cause,
            smallest=group[0].smallest,
        )
        for mode, group in groups.items()
    )


Severity = tuple[bool, bool, int, float, float, float]


def severity(verdict: Verdict | None, contacts: Contacts, requirement: Requirement, *, rare: bool = False) -> Severity:
    """Return how severe runs are for the robot, as a key that sorts as pages show them; larger is worse.

    A failure whose worst run shows what is `rare` among recorded people comes behind those that do not. Contact with a
    person comes next, whatever the requirement judges. Then: violated always, sometimes (or surely, but how often is
    open), open, not violated; then the share of runs with contact, the share of violating runs, of which the lower end
    of the interval counts, and the mean.
    """
    bad, always, at_least = badness(verdict)
    level = 3 if always else 2 if bad else 1 if verdict is None or verdict.status is Status.INCONCLUSIVE else 0
    mean = -math.inf if verdict is None or verdict.mean is None else requirement.badness(verdict.mean)
    touches = contacts.runs > 0
    return not rare and (bad or touches), touches, level, contacts.runs / max(1, contacts.of), at_least, mean


def severity_of(attempt: Attempt, requirement: Requirement) -> Severity:
    """Return the severity of the runs of an attempt."""
    safety = summarise_safety([measured.values for measured in attempt.measurements])
    return severity(attempt.verdict, safety.contacts, requirement, rare=is_rare(attempt, requirement))


def is_rare(attempt: Attempt, requirement: Requirement) -> bool:
    """Return whether somebody in the worst run of an attempt does what fewer than 1 in 100 recorded people did."""
    valued = any(measured.objective is not None for measured in attempt.measurements)
    return valued and is_left_out(attempt.worst(requirement).values, RARE_PERCENT)


def worst_confirmation(attempts: Sequence[Attempt], requirement: Requirement) -> Attempt | None:
    """Return the most severe confirmation; the earliest of equals, None without one."""
    return max(confirmations(attempts), key=lambda a: (severity_of(a, requirement), -a.index), default=None)


def badness(verdict: Verdict | None) -> tuple[bool, bool, float]:
    """Return how much a verdict says against the robot: violated at all, always (FAIL), and how often at least.

    The lower end of the interval counts: 2 of 2 runs say less than 14 of 15.
    """
    if verdict is None:
        return (False, False, 0.0)
    at_least = verdict.violation_interval[0] if verdict.violation_interval is not None else 0.0
    return (violated(verdict), verdict.status is Status.FAIL, at_least)


def _finding(
    plan: Plan,
    attempt: Attempt,
    attempts: Sequence[Attempt],
    run_of: RunOf,
    modes: Callable[[str], FailureMode | None],
    world: World,
) -> Finding:
    scenario, verdict, requirement = attempt.proposal.scenario, attempt.verdict, plan.requirement
    assert scenario is not None and verdict is not None
    safety = summarise_safety([m.values for m in attempt.measurements])
    baseline = next((a for a in reversed(attempts) if a.purpose == "baseline"), None)
    without = _share(baseline, attempt, requirement) if baseline else None
    bad = violated(verdict)
    worst = run_of(attempt.worst(requirement).run_id)
    cause, smallest = [], None
    for other in attempts:
        if other.confirms != attempt.index or other.purpose not in ("removal", "shrinking"):
            continue
        share, before = _share(other, other, requirement), _share(attempt, other, requirement).violated
        if other.purpose == "removal":
            name = ", ".join(other.without)
            p = fisher(verdict.violations, verdict.runs, share.violated, share.of) if share.of else 1.0
            cause.append(Removal(without=name, violated=share.violated, of=share.of, before=before, p=p))
        elif smallest is None and other.scenario_id is not None:
            smallest = Smallest(
                attempt=other.index,
                scenario_id=other.scenario_id,
                taken_away=other.taken_away,
                violated=share.violated,
                of=share.of,
                before=before,
                judged_by=verdict.judged_by,
            )
    corrected = holm({each.without: each.p for each in cause})
    difference, difference_interval, about_people = _blame(verdict, without)
    return Finding(
        scenario=attempt.brief.scenario_index,
        configuration=attempt.brief.configuration_index,
        attempt=attempt.confirms if attempt.confirms is not None else attempt.index,
        confirmation=attempt.index,
        scenario_id=scenario.id,
        description=scenario.description,
        verdict=verdict,
        violated=bad,
        violation_probability=verdict.violation_probability,
        interval=verdict.violation_interval,
        how_sure=how_sure(verdict),
        contacts=safety.contacts,
        arrived=safety.arrived,
        least_clearance_m=safety.least_clearance_m,
        without_people=without,
        difference=difference,
        difference_interval=difference_interval,
        about_people=about_people,
        cause=tuple(each.replace(p=corrected[each.without]) for each in cause),
        smallest=smallest,
        failure=usual(modes(m.run_id) for m in attempt.violating(requirement)),
        story=tuple(sentence.text for sentence in story_of(worst, world=world, scenario=scenario)),
        story_run=worst.id,
        rare=is_rare(attempt, requirement),
        realism=realism_in_words(rarest_motion(attempt.violating(requirement) or attempt.measurements, run_of)),
    )


def _blame(verdict: Verdict, without: Share | None) -> tuple[float | None, tuple[float, float] | None, AboutPeople]:
    """Compare a verdict with the mission alone: the difference, its interval, and whether people cause it."""
    bad, procedure = violated(verdict), verdict.judged_by
    if without is None or verdict.violation_probability is None:
        return None, None, "open" if bad else "not violated"
    share = Share(violated=verdict.violations, of=verdict.runs)
    outcomes = ([True] * each.violated + [False] * (each.of - each.violated) for each in (share, without))
    found = share_difference(*outcomes, confidence=procedure.confidence)
    interval = found.interval if found else (-1.0, 1.0)
    difference = share.probability - without.probability
    recurs = difference <= RECURS_WITHIN and procedure.violated(without.violated, without.of)
    if not bad:
        return difference, interval, "not violated"
    return difference, interval, "yes" if interval[0] > 0.0 else "no" if recurs else "open"


def _share(attempt: Attempt, seeds_of: Attempt, requirement: Requirement) -> Share:
    """Return how many of an attempt's runs on another's seeds violate; a run without a value violates nothing."""
    seeds = {m.seed for m in seeds_of.measurements}
    counted = [m for m in attempt.measurements if m.seed in seeds]
    violated = sum(m.seed in seeds for m in attempt.violating(requirement))
    return Share(violated=violated, of=len(counted), unmeasured=sum(m.objective is None for m in counted))


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
