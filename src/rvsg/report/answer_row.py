"""The row of a configuration: what its runs show, in finished words and numbers, and what causes it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Annotated, Literal

from pydantic import Field

from rvsg.core.records import Record
from rvsg.evaluation.detection import contacts
from rvsg.evaluation.sampled import sampled
from rvsg.evaluation.verdict import (
    OPEN_STATUS,
    SafetySummary,
    Status,
    Verdict,
    counted,
    metres,
    number,
    percent,
    still_open,
    summarise_safety,
    violated,
)
from rvsg.findings.findings import Finding, Severity, Smallest, severity_of
from rvsg.findings.ranking import confirmations, confirmed_candidate, ranking, search_attempts
from rvsg.report.words import in_short
from rvsg.runs.attempt import Attempt, Measurement, Plan
from rvsg.runs.observation import FailureMode, usual
from rvsg.scenario.requirement import Requirement
from rvsg.simulation.events import in_order, responsible_in_words
from rvsg.simulation.run import Run
from rvsg.world.world import World

Violated = Literal["yes", "no", "open", "no limit"]
Often = Literal["always", "sometimes", "rarely", "not settled"]
Tone = Literal["bad", "warn", "good", "quiet"]
LISTED = 3
"""People that are named as a cause; of more, their number."""
MANY = 4
"""Of more people than this, none may explain a violation alone."""


Standing = Literal["confirmed", "candidate", "not violated"]


class Ranked(Record):
    """A scenario in its place: one of its configurations and how that did. Indices count from 0.

    Where configurations of the scenario are confirmed it is the worst of these, by its confirmation runs; else the
    worst of the search.
    """

    rank: int
    """From 1, the most severe first; of a further configuration of a scenario 0."""
    scenario: int
    configuration: int
    configurations: int
    attempt: int
    scenario_id: str
    description: str
    state: Standing
    """A candidate violated the requirement in the search and is not confirmed."""
    verdict: Verdict
    """Of the confirmation runs where it is confirmed, else of the runs of the search."""
    seen: SafetySummary
    """What these runs show beside the requirement."""
    severity: Annotated[Severity, Field(exclude=True)]

    @property
    def number(self) -> str:
        """Scenario and configuration, from 1, e.g. `3.2`."""
        return f"{self.scenario + 1}.{self.configuration + 1}"

    @property
    def place(self) -> tuple[int, Severity]:
        """Where it stands, larger first: confirmed violations and contacts, candidates, other confirmed ones, the rest.

        What is not confirmed comes later, however severe: the search selected it for being extreme.
        """
        bad = violated(self.verdict) or self.seen.contacts.runs > 0
        confirmed = 3 if bad else 1
        return {"confirmed": confirmed, "candidate": 2, "not violated": 0}[self.state], self.severity


def ranked_scenarios(plan: Plan, attempts: Sequence[Attempt]) -> tuple[tuple[Ranked, ...], tuple[Ranked, ...]]:
    """Return an entry for each scenario in order, and the other confirmed configurations."""
    searched = search_attempts(attempts)
    by_scenario: dict[int, list[tuple[Attempt, Attempt]]] = {}
    for attempt in confirmations(attempts):
        candidate = confirmed_candidate(attempt, attempts)
        if candidate is not None and attempt.verdict is not None:
            by_scenario.setdefault(candidate.brief.scenario_index, []).append((candidate, attempt))
    shown: list[Ranked] = []
    further: list[Ranked] = []
    for best in ranking(attempts, plan.requirement):
        confirmed = by_scenario.get(best.brief.scenario_index, [])
        entries = [_ranked(*pair, searched, plan) for pair in confirmed] or [_ranked(best, None, searched, plan)]
        entries.sort(key=lambda entry: entry.place, reverse=True)
        shown.append(entries[0])
        further += entries[1:]
    shown.sort(key=lambda entry: entry.place, reverse=True)
    return tuple(entry.replace(rank=place) for place, entry in enumerate(shown, 1)), tuple(further)


def _ranked(candidate: Attempt, confirmation: Attempt | None, searched: Sequence[Attempt], plan: Plan) -> Ranked:
    scenario, shown = candidate.proposal.scenario, confirmation or candidate
    assert scenario is not None and shown.verdict is not None
    tried = sum(other.brief.scenario_index == candidate.brief.scenario_index for other in searched)
    state: Standing = "confirmed" if confirmation else "candidate" if shown.verdict.violations else "not violated"
    return Ranked(
        rank=0,
        scenario=candidate.brief.scenario_index,
        configuration=candidate.brief.configuration_index,
        configurations=tried,
        attempt=candidate.index,
        scenario_id=scenario.id,
        description=scenario.description or in_short(scenario),
        state=state,
        verdict=shown.verdict,
        seen=summarise_safety([measured.values for measured in shown.measurements]),
        severity=severity_of(shown, plan.requirement),
    )


class AnswerRow(Record):
    """A configuration, by its confirmation runs; without these by those of the search."""

    number: str
    """Scenario and configuration, from 1, e.g. `3.2`."""
    attempt: int
    """The attempt of the search."""
    confirmation: int | None
    """The attempt that confirms it."""
    state: Standing
    name: str
    """What happens, where and to whom."""
    who: str
    """The person nearest to the robot in the run that is shown; empty without people."""
    place: str
    status: str
    """The code of the verdict, VIOLATED where FAIL or FLAKY is open, `candidate` or `not violated`."""
    tone: Tone
    violated: Violated
    often: Often
    violations: int
    runs: int
    share: str
    """E.g. `15/15`."""
    interval: str
    """The interval of the share, e.g. `78 to 100 %`; empty without a limit."""
    bounds: tuple[float, float] | None
    """The same as numbers from 0 to 1, for a bar."""
    measured: str
    """The judged quantity over the runs."""
    contacts: int
    contact: str
    """Runs with contact, e.g. `1/15`."""
    touch: str
    """How fast and who moves where they touch; empty without contact."""
    closest: str
    """The smallest gap."""
    arrived: str
    others: str
    """Runs that end before the goal or touch an obstacle; empty where none does."""
    cause: str
    """The people who cause it, in short."""
    caused: str
    """The runs that show it."""
    shrunk: str
    """What of the scenario does not matter, or why that is not known."""
    run: str
    """The id of the run that shows it: of those that fail as most do, with the longest contact, else the worst."""
    moment_s: float
    """When in that run it happens."""

    @property
    def shown_attempt(self) -> int:
        """The attempt whose runs it shows."""
        return self.attempt if self.confirmation is None else self.confirmation

    @property
    def counts(self) -> bool:
        """Whether confirmation runs violate the requirement or touch a person."""
        return self.state == "confirmed" and (self.violated == "yes" or self.contacts > 0)


def share_of(runs: int, of: int) -> str:
    """Return runs of a number of runs as `8/65`."""
    return f"{runs}/{of}"


def between(verdict: Verdict) -> str:
    """Return the interval of the share of violating runs, e.g. `78 to 100 %`."""
    if verdict.violation_interval is None:
        return ""
    low, high = verdict.violation_interval
    return f"{100 * low:.0f} to {percent(high)}"


def is_violated(verdict: Verdict) -> Violated:
    """Return whether runs violate the requirement; `open` where they do not tell."""
    if verdict.status is Status.UNJUDGED:
        return "no limit"
    return "yes" if violated(verdict) else "no" if verdict.status is Status.PASS else "open"


def status_of(verdict: Verdict) -> str:
    """Return the code of a verdict; VIOLATED where it surely is and only how often is open."""
    return OPEN_STATUS if still_open(verdict) else verdict.status.value


def how_often(verdict: Verdict) -> Often:
    """Return how often runs violate the requirement."""
    words: dict[Status, Often] = {Status.FAIL: "always", Status.FLAKY: "sometimes", Status.PASS: "rarely"}
    return words.get(verdict.status, "not settled")


def tone_of(verdict: Verdict, touched: int) -> Tone:
    """Return the tone of a verdict: bad where it is violated, good where it passed and nobody is touched."""
    return "bad" if violated(verdict) else "warn" if touched else "good" if verdict.status is Status.PASS else "quiet"


class _ShownRun:
    """The run that shows a configuration best, and what it shows."""

    def __init__(
        self,
        shown: Attempt,
        requirement: Requirement,
        world: World,
        run_of: Callable[[str], Run],
        mode_of: Callable[[str], FailureMode | None],
    ) -> None:
        touched, bad = [m for m in shown.measurements if m.touches], shown.violating(requirement)
        chosen = touched if touched and 2 * len(touched) >= len(bad) else bad or list(shown.measurements)
        runs = {m.run_id: run_of(m.run_id) for m in chosen}
        modes = {run_id: mode_of(run_id) for run_id in runs}
        self.mode = usual(modes.values())
        usual_ones = [m for m in chosen if modes[m.run_id] == self.mode] or chosen
        met = {
            m.run_id: touching[0] for m in touched if (touching := in_order(contacts(sampled(run_of(m.run_id), world))))
        }
        sides = Counter(met[m.run_id].responsible for m in usual_ones if m.run_id in met)
        sides = sides or Counter(contact.responsible for contact in met.values())
        self.side = max(sides, key=sides.__getitem__, default=None)
        usual_ones = [m for m in usual_ones if m.run_id in met and met[m.run_id].responsible == self.side] or usual_ones

        def worst(m: Measurement) -> tuple[float, float]:
            badness = float("-inf") if m.objective is None else requirement.badness(m.objective)
            return (m.values.get("contact_longest") or 0.0, badness)

        self.run = runs[max(usual_ones, key=worst).run_id]
        self.who, self.moment_s = _nearest(self.run)
        self.touch = ""
        if touched:
            speed = max((m.values.get("contact_speed") or 0.0) for m in touched)
            self.touch = ", ".join(
                [f"up to {number(speed, 'm/s')}", *([responsible_in_words(self.side)] if self.side else [])]
            )
        if self.run.id in met:
            self.who, self.moment_s = met[self.run.id].person, met[self.run.id].time_s

    def name(self, world: World) -> str:
        """Return what happens, where and to whom."""
        if self.mode is not None:
            return f"{self.mode.name(self.side)}: {self.who}"
        path = self.run.trajectory
        at = world.place_name(float(path.x[-1]), float(path.y[-1])) if len(path) else "the start"
        return f"Ends at {at}, {self.run.outcome.value}"


def _nearest(run: Run) -> tuple[str, float]:
    """Return who comes nearest to the robot, and when (s)."""
    closest = sampled(run).closest_approach
    if closest is None:
        return "", 0.0
    row, person = closest
    return run.human_names[person], float(run.trajectory.t[row])


def row_of(
    entry: Ranked,
    shown: Attempt,
    requirement: Requirement,
    world: World,
    run_of: Callable[[str], Run],
    mode_of: Callable[[str], FailureMode | None],
    finding: Finding | None = None,
) -> AnswerRow:
    """Return the row of a configuration.

    Args:
        shown: The attempt whose runs are shown.
        mode_of: Returns how the run of an id fails.
        finding: What its confirmation means; None without one.
    """
    verdict, seen = entry.verdict, entry.seen
    best = _ShownRun(shown, requirement, world, run_of, mode_of)
    cause, caused = cause_of(finding) if finding is not None else ("–", "not confirmed")
    bounds = verdict.violation_interval
    gap = metres(seen.least_clearance_m) if seen.least_clearance_m is not None else "–"
    return AnswerRow(
        number=entry.number,
        attempt=entry.attempt,
        confirmation=shown.index if shown.purpose == "confirmation" else None,
        state=entry.state,
        name=best.name(world),
        who=best.who,
        place=best.mode.place if best.mode is not None else "",
        status=status_of(verdict) if entry.state == "confirmed" else entry.state,
        tone=tone_of(verdict, seen.contacts.runs) if entry.state == "confirmed" else "quiet",
        violated=is_violated(verdict),
        often=how_often(verdict),
        violations=verdict.violations,
        runs=verdict.runs,
        share=share_of(verdict.violations, verdict.runs) if bounds is not None else "–",
        interval=between(verdict),
        bounds=bounds,
        measured=_measured(verdict, requirement),
        contacts=seen.contacts.runs,
        contact=share_of(seen.contacts.runs, seen.contacts.of) if seen.contacts.of else "–",
        touch=best.touch,
        closest=metres(0.0) if seen.contacts.runs else gap,
        arrived=share_of(seen.arrived.runs, seen.arrived.of) if seen.arrived.of else "–",
        others=_others(shown, seen.arrived.runs, seen.arrived.of),
        cause=cause,
        caused=caused,
        shrunk=_shrunk(finding.smallest) if finding is not None and finding.smallest is not None else "",
        run=best.run.id,
        moment_s=round(best.moment_s, 2),
    )


def _others(shown: Attempt, arrived: int, of: int) -> str:
    gaps = [gap for m in shown.measurements if (gap := m.values.get("obstacle_distance")) is not None]
    hits, late = sum(gap <= 0.0 for gap in gaps), of - arrived
    said = [f"{share_of(late, of)} do not arrive"] if late else []
    return ", ".join([*said, f"{share_of(hits, len(gaps))} touch an obstacle"] if hits else said)


def _measured(verdict: Verdict, requirement: Requirement) -> str:
    """Return the mean of the judged quantity; where runs did not arrive, the median and their number."""
    if not verdict.censored:
        return f"{'mean ' if verdict.runs > 1 else ''}{number(verdict.mean, requirement.unit)}"
    late = f"{share_of(verdict.censored, verdict.runs)} late"
    return late if verdict.median is None else f"{number(verdict.median, requirement.unit)}, {late}"


def cause_of(finding: Finding) -> tuple[str, str]:
    """Return who causes a violation, as far as runs with fewer people tell it from chance, and which runs show it."""
    alone, blamed = finding.without_people, finding.blamed
    if not finding.violated:
        return "–", "not violated"
    if finding.about_people == "no" and alone is not None:
        return "not the people", f"without people: {share_of(alone.violated, alone.of)}"
    if blamed:
        names = ", ".join(cause.without for cause in blamed)
        first = blamed[0]
        return (
            names if len(blamed) <= LISTED else counted(len(blamed), "person", "people"),
            f"without {first.without}: {share_of(first.violated, first.of)}",
        )
    if len(finding.cause) > MANY:
        return "no single person", f"none explains it ({len(finding.cause)} tried)"
    if finding.cause:
        least = min(finding.cause, key=lambda cause: cause.p)
        return "open", f"without {least.without} {share_of(least.violated, least.of)} violate: not told apart"
    if finding.about_people == "yes" and alone is not None:
        return "the people", f"without people: {share_of(alone.violated, alone.of)}"
    return "open", "too few runs to tell" if alone is not None else "not tried"


def _shrunk(smallest: Smallest) -> str:
    """Return what of a scenario does not matter, where its rate is not told apart from that of the original."""
    left = f"{share_of(smallest.violated, smallest.of)} runs violate, {share_of(smallest.before, smallest.of)} before"
    if not smallest.holds:
        return f"Could not be shrunk: {left}; that is too few, or fewer than before."
    taken = "; ".join(smallest.taken_away)
    same = f"{left}, not told apart (p {smallest.rarer:.2g})"
    return f"Does not matter: {taken} ({same})." if taken else f"Everything in it matters ({same})."
