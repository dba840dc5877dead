"""The result of a campaign: what its attempts say, computed once with the error rates of its own verdicts.

Page, overview, terminal, JSON, JUnit and studio render one `Result`. Its `answer` says in finished words and formatted
numbers what happened, to whom, where, how often, why, how sure, and what to do next.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from rvsg.core.records import Record
from rvsg.evaluation.metrics import find_metric
from rvsg.evaluation.verdict import (
    Status,
    Verdict,
    counted,
    percent,
    summarise_safety,
    value_in_words,
    violated,
)
from rvsg.findings.feedback import MapCell, failure_map
from rvsg.findings.findings import (
    DistinctFailure,
    Finding,
    distinct_failures,
    findings,
    severity_of,
    worst_confirmation,
)
from rvsg.findings.ranking import Front, candidates, confirmations, front_of, measured, search_attempts, standing
from rvsg.report.answer_row import (
    AnswerRow,
    Often,
    Ranked,
    Tone,
    Violated,
    how_often,
    is_violated,
    ranked_scenarios,
    row_of,
    share_of,
    status_of,
    tone_of,
)
from rvsg.report.words import limit_in_words
from rvsg.runs.attempt import Attempt, Plan
from rvsg.runs.observation import FailureMode, mode_of
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission
from rvsg.search.drive_alone import DroveAlone, drove_alone
from rvsg.search.execution import Accounting, account, runs_of
from rvsg.simulation.run import Run
from rvsg.world.world import World


class Figure(Record):
    """A number of the answer with its label and a note."""

    label: str
    value: str
    note: str = ""


class Elsewhere(Record):
    """Contact in configurations other than the first row's."""

    text: str
    number: str
    """The configuration that has most of it."""
    attempt: int
    """Its attempt of the search, where it is not confirmed; else -1."""
    runs: tuple[str, ...]
    """Its runs with contact."""


class NextStep(Record):
    """What to do next, with its command."""

    text: str
    command: str


class CampaignAnswer(Record):
    """What a campaign says."""

    status: str
    """The strongest verdict of a confirmation, as `AnswerRow.status`; else `not confirmed`, `nothing found`,
    `no limit` or `no result`."""
    violated: Violated
    often: Often
    tone: Tone
    """`good` only where nothing violates and no run of the campaign touches a person."""
    title: str
    """The requirement, by what it measures."""
    setup: tuple[str, ...]
    """World, route, robot and stack."""
    headline: str
    """The most severe failure in a sentence, or what was found instead."""
    counts: str
    """How many configurations violate the requirement, and how often."""
    figures: tuple[Figure, ...]
    changes: str = ""
    """What has changed since, so that maps and places are not as they were."""
    alone: DroveAlone | None
    """The robot without people; None where an older version ran the campaign."""
    elsewhere: Elsewhere | None
    """Contact in the rest of the campaign; None where there is none."""
    next: tuple[NextStep, ...]
    rows: tuple[AnswerRow, ...]
    """Every scenario by its most severe configuration, and further confirmed ones, as `Ranked.place` orders them."""
    rest: str
    """How many scenarios did not violate in the search and are not confirmed."""

    @property
    def failures(self) -> tuple[AnswerRow, ...]:
        """The rows that are failures or contacts of confirmed configurations."""
        return tuple(row for row in self.rows if row.counts)

    @property
    def shown(self) -> tuple[AnswerRow, ...]:
        """The rows of confirmed configurations and of candidates."""
        return tuple(row for row in self.rows if row.state != "not violated")

    def row(self, confirmation: int) -> AnswerRow:
        """Return the row of a confirmation, by the index of its attempt."""
        return next(row for row in self.rows if row.confirmation == confirmation)


@dataclass(frozen=True, eq=False)
class Result:
    """What a campaign says, finished or not. Every part is computed when it is asked for first, and kept.

    Args:
        run_of: finds a run by its id; parts that need runs are asked for while it can.
        alone: the runs of the robot without people.
        stack: the stack under test.
        commands: gives the commands of next steps by name: `contact`, `confirm`, `keep`, `planner`, `more`, `resume`.
        changes: what has changed since it ran.
    """

    plan: Plan
    attempts: Sequence[Attempt]
    world: World
    run_of: Callable[[str], Run]
    alone: Attempt | None = None
    stack: str = ""
    commands: Callable[[Result], Mapping[str, str]] = lambda _: {}
    changes: str = ""

    @property
    def requirement(self) -> Requirement:
        """The requirement, with its limit worked out for the route."""
        return self.plan.requirement

    @cached_property
    def _modes(self) -> dict[str, FailureMode | None]:
        return {}

    def mode_of(self, run_id: str) -> FailureMode | None:
        """Return how a run fails if it does."""
        if run_id not in self._modes:
            self._modes[run_id] = mode_of(self.run_of(run_id), self.world)
        return self._modes[run_id]

    @property
    def complete(self) -> bool:
        """Whether everything planned is done."""
        return is_complete(self.plan, self.attempts)

    @cached_property
    def accounting(self) -> Accounting:
        """Runs, calls of a model and what they cost."""
        return account(self.attempts)

    @cached_property
    def entries(self) -> tuple[Ranked, ...]:
        """Every scenario by its most severe configuration in its place, then other confirmed configurations."""
        ranked, further = ranked_scenarios(self.plan, self.attempts)
        return (*ranked, *further)

    @property
    def ranking(self) -> tuple[Ranked, ...]:
        """One entry for each scenario, as `Ranked.place` orders them."""
        return tuple(entry for entry in self.entries if entry.rank)

    @property
    def further(self) -> tuple[Ranked, ...]:
        """Other confirmed configurations of the same scenarios."""
        return tuple(entry for entry in self.entries if not entry.rank)

    @cached_property
    def confirmed(self) -> Attempt | None:
        """The most severe confirmation."""
        return worst_confirmation(self.attempts, self.requirement)

    @property
    def violated(self) -> bool:
        """Whether any confirmation violates the requirement, or without a confirmation any verdict of the search."""
        decided = [a.verdict for a in confirmations(self.attempts) if a.verdict]
        return any(violated(verdict) for verdict in decided or [entry.verdict for entry in self.ranking])

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Every confirmation with what it means, the worst first."""
        return findings(self.plan, self.attempts, run_of=self.run_of, world=self.world, mode_of_run=self.mode_of)

    @property
    def distinct_failures(self) -> tuple[DistinctFailure, ...]:
        """The confirmed violations, grouped by where and how the robot fails; the worst group first."""
        return distinct_failures(self.findings)

    @property
    def candidates(self) -> list[Attempt]:
        """The configurations that violated in the search and are not confirmed yet, worst first."""
        confirmed = {a.scenario_id for a in self.attempts if a.purpose == "confirmation"}
        violating = [a for a in candidates(self.attempts, self.requirement) if standing(a, self.requirement)[0] > 0.0]
        return [a for a in violating if a.scenario_id not in confirmed]

    @cached_property
    def failure_map(self) -> tuple[MapCell, ...]:
        """The worst configuration of the search for every kind of encounter, the worst first."""
        return failure_map(self.attempts, self.requirement, run_of=self.run_of, world=self.world)

    @property
    def front(self) -> Front | None:
        """The Pareto front of its requirements and its hypervolume; None if it has only one requirement."""
        return front_of(self.plan, self.attempts) if self.plan.also else None

    @cached_property
    def answer(self) -> CampaignAnswer:
        """What the campaign says, in finished text."""
        requirement, by_index = self.requirement, {attempt.index: attempt for attempt in self.attempts}
        by_scenario = {attempt.scenario_id: attempt for attempt in confirmations(self.attempts)}
        meanings = {finding.confirmation: finding for finding in self.findings}
        rows = []
        for entry in sorted(self.entries, key=lambda entry: entry.place, reverse=True):
            shown = by_scenario[entry.scenario_id] if entry.state == "confirmed" else by_index[entry.attempt]
            rows.append(
                row_of(entry, shown, requirement, self.world, self.run_of, self.mode_of, meanings.get(shown.index))
            )
        elsewhere = _elsewhere(rows, self.attempts, requirement)
        drove = drove_alone(self.plan, self.alone) if self.alone is not None else None
        verdicts = (entry.verdict for entry in self.entries if entry.state == "confirmed")
        strongest = max(verdicts, key=_strength, default=None)
        status, is_, often = _status(self, strongest)
        touched = sum(row.contacts for row in rows) + (elsewhere is not None)
        return CampaignAnswer(
            status=status,
            violated=is_,
            often=often,
            tone=tone_of(strongest, touched) if strongest is not None else "warn" if touched else "quiet",
            title=f"{requirement.name}: {requirement.title}",
            setup=_setup(self.plan.mission, self.plan.mission.world, self.stack),
            headline=_headline(self, rows, strongest, drove),
            counts=_counts(rows),
            figures=_figures(rows[0], requirement) if rows else (),
            changes=self.changes,
            alone=drove,
            elsewhere=elsewhere,
            next=_next_steps(self, rows, elsewhere, strongest),
            rows=tuple(rows),
            rest=_rest(self.ranking),
        )

    def data(self) -> dict[str, Any]:
        """Return it as JSON-able data."""
        front = self.front
        return {
            "campaign": self.plan.name,
            "complete": self.complete,
            "ranking": [entry.model_dump(mode="json") for entry in self.ranking],
            "further": [entry.model_dump(mode="json") for entry in self.further],
            "violated": self.violated,
            "accounting": self.accounting.model_dump(mode="json"),
            "confirmed": [finding.model_dump(mode="json") for finding in self.findings],
            "distinct_failures": [failure.model_dump(mode="json") for failure in self.distinct_failures],
            "candidates": [{"attempt": a.index, "scenario": a.brief.scenario_index} for a in self.candidates],
            "failure_map": [cell.model_dump(mode="json") for cell in self.failure_map],
            "answer": self.answer.model_dump(mode="json"),
            "front": front.model_dump(mode="json") if front is not None else None,
        }


def is_complete(plan: Plan, attempts: Sequence[Attempt]) -> bool:
    """Return whether everything planned is done: the search, and its confirmation with the mission without people."""
    if plan.confirmations and measured(attempts):
        return any(a.purpose == "baseline" for a in attempts)
    searched = search_attempts(attempts)
    if all(a.runs in (0, plan.repeats) for a in searched):
        return len(searched) >= plan.attempts
    return runs_of(searched) >= plan.search_runs


def answer_of_runs(plan: Plan, attempt: Attempt, *, world: World, run_of: Callable[[str], Run]) -> CampaignAnswer:
    """Return the answer of judged runs that belong to no campaign."""
    requirement, verdict = plan.requirement, attempt.verdict
    assert verdict is not None
    seen = summarise_safety([measured.values for measured in attempt.measurements])
    entry = Ranked(
        rank=1,
        scenario=0,
        configuration=0,
        configurations=1,
        attempt=0,
        scenario_id="",
        description="",
        state="confirmed",
        verdict=verdict,
        seen=seen,
        severity=severity_of(attempt, requirement),
    )
    row = row_of(entry, attempt, requirement, world, run_of, lambda run_id: mode_of(run_of(run_id), world)).replace(
        cause="–", caused="not tried"
    )
    often = f"{row.share} runs violate {requirement.name}" if row.bounds else f"There is no limit of {requirement.name}"
    touch = f"; {row.contact} touch a person" if row.contacts else ""
    return CampaignAnswer(
        status=row.status,
        violated=row.violated,
        often=row.often,
        tone=row.tone,
        title=f"{requirement.name}: {requirement.title}",
        setup=_setup(plan.mission, world.title),
        headline=f"{row.name}. {often}{touch}.",
        counts="",
        figures=_figures(row, requirement),
        alone=None,
        elsewhere=None,
        next=(),
        rows=(row,),
        rest="",
    )


def _setup(mission: Mission, *more: str) -> tuple[str, ...]:
    world, *stack = (Path(path).name for path in more)
    return tuple(dict.fromkeys(part for part in (world, mission.route.name, mission.robot_name, *stack) if part))


def _strength(verdict: Verdict) -> tuple[bool, bool, bool, float]:
    often = verdict.violation_probability or 0.0
    return violated(verdict), verdict.status is Status.FAIL, verdict.status is not Status.PASS, often


def _status(result: Result, strongest: Verdict | None) -> tuple[str, Violated, Often]:
    if not result.ranking:
        return "no result", "open", "not settled"
    if result.requirement.threshold is None:
        return "no limit", "no limit", "not settled"
    if strongest is None:
        candidate = any(entry.state == "candidate" for entry in result.ranking)
        return "not confirmed" if candidate else "nothing found", "open", "not settled"
    return status_of(strongest), is_violated(strongest), how_often(strongest)


def _headline(result: Result, rows: Sequence[AnswerRow], strongest: Verdict | None, alone: DroveAlone | None) -> str:
    """Return the most severe failure in a sentence, or what was found instead."""
    requirement, account = result.requirement, result.accounting
    if not result.ranking:
        tried = counted(account.search_attempts, "configuration")
        problems = Counter(problem.reason for attempt in result.attempts for problem in attempt.proposal.problems)
        why = "".join(f" Most often: {reason}" for reason, _ in problems.most_common(1))
        return f"No valid scenario was simulated in {tried}, so nothing is known of the robot.{why}"
    if requirement.threshold is None:
        worst = result.ranking[0]
        said = value_in_words(worst.verdict, requirement.unit)
        return f"{requirement.name} has no limit, so nothing violates it; the worst scenario measures {said}."
    if strongest is None:
        runs = counted(account.search_runs, "run")
        done = "" if result.complete else f"The campaign is not finished ({runs} so far). "
        if candidates := sum(row.state == "candidate" for row in rows):
            many = f"{counted(candidates, 'candidate')}, none confirmed; the first"
            touch = f"; {rows[0].contact} touch a person" if rows[0].contacts else ""
            return f"{done}{many}: {rows[0].name}. {rows[0].share} runs violate {requirement.name}{touch}."
        return f"{done}No run of the search violates {requirement.name} ({runs})."
    first = rows[0]
    if first.contacts and first.violated != "yes":
        return f"{first.name}. {first.contact} runs touch a person; {first.share} violate {requirement.name}."
    if first.violated == "yes":
        more = f", {share_of(alone.violations, alone.judged)} without people" if alone and alone.violations else ""
        more += "; how often is open" if first.often == "not settled" else ""
        more += f"; {first.contact} touch a person" if first.contacts else ""
        always = next((row for row in rows if row.state == "confirmed" and row.often == "always"), first)
        also = f" Always violated: {always.number}, {always.share}." if first.often != always.often else ""
        return f"{first.name}. {first.share} runs violate {requirement.name}{more}.{also}"
    if first.violated == "no" and first.bounds is not None:
        most = percent(first.bounds[1])
        return (
            f"No violation confirmed: the worst scenario found violates {requirement.name} in at most {most} of runs."
        )
    return f"Open: {first.share} confirmation runs of the worst scenario violate {requirement.name}."


def _counts(rows: Sequence[AnswerRow]) -> str:
    """Return how many confirmed configurations violate the requirement, how often, and touch a person."""
    confirmed = [row for row in rows if row.state == "confirmed"]
    bad = Counter(row.often for row in confirmed if row.violated == "yes")
    words: dict[Often, str] = {
        "always": "always violated",
        "sometimes": "sometimes violated",
        "not settled": "violated (how often is open)",
    }
    parts = [f"{bad[key]} {text}" for key, text in words.items() if bad[key]]
    passed, undecided = (sum(row.violated == answer for row in confirmed) for answer in ("no", "open"))
    parts += [f"{passed} not violated"] if passed else []
    parts += [f"{undecided} open"] if undecided else []
    parts += [f"{touched} with contact"] if (touched := sum(row.contacts > 0 for row in confirmed)) else []
    return f"{counted(len(confirmed), 'confirmed configuration')}: {', '.join(parts)}." if confirmed else ""


def _figures(row: AnswerRow, requirement: Requirement) -> tuple[Figure, ...]:
    """Return the four figures of the most severe configuration."""
    limit = limit_in_words(requirement)
    limit = f"limit: {limit}{' in each run' if row.runs > 1 else ''}" if limit else ""
    often = f"likely {row.interval} of runs" if row.interval else "no limit"
    metric = find_metric(requirement.metric)
    touch = f"contact {row.contact} runs" + (f", {row.touch}" if row.touch else "")
    return (
        Figure(label="Violated", value=row.share, note="; ".join(part for part in (often, row.others) if part)),
        Figure(label=metric.title if metric else requirement.title, value=row.measured, note=limit),
        Figure(label="Closest gap", value=row.closest, note=touch),
        Figure(label="Cause", value=row.cause, note=row.caused),
    )


def _elsewhere(rows: Sequence[AnswerRow], attempts: Sequence[Attempt], requirement: Requirement) -> Elsewhere | None:
    """Return in how many runs of the other configurations robot and person touch, and in which most."""
    touches: dict[str, dict[str, bool]] = {}
    searched, confirmed = dict[str, int](), set[str]()
    for attempt in attempts:
        number = attempt.number
        if attempt.purpose not in ("search", "confirmation") or (rows and number == rows[0].number):
            continue
        met = {m.run_id: m.touches for m in attempt.measurements}
        touches.setdefault(number, {}).update(met)
        if attempt.purpose == "search":
            searched.setdefault(number, attempt.index)
        else:
            confirmed.add(number)
    total, touched = sum(map(len, touches.values())), sum(sum(met.values()) for met in touches.values())
    if not touched:
        return None
    most, met = max(touches.items(), key=lambda pair: (sum(pair[1].values()), pair[0]))
    which = "other runs" if rows else "runs"
    judged = requirement.metric in ("contacts", "robot_contacts", "contact_speed", "contact_longest")
    text = f"Contact in {touched} of {total} {which}; most: {most}, {share_of(sum(met.values()), len(met))}"
    text += "." if judged else f"; {requirement.name} does not judge contact."
    return Elsewhere(
        text=text,
        number=most,
        attempt=-1 if most in confirmed else searched[most],
        runs=tuple(run_id for run_id, touch in met.items() if touch),
    )


FEW_RUNS = 10
"""After fewer runs the rate of a failure is hardly known: their interval spans half of all rates."""


def _next_steps(
    result: Result, rows: Sequence[AnswerRow], elsewhere: Elsewhere | None, strongest: Verdict | None
) -> tuple[NextStep, ...]:
    """Return up to three steps that fit what was found, the most urgent first."""
    commands = result.commands(result)
    candidate = next((row for row in rows if row.state == "candidate"), None)
    shown = any(row.counts for row in rows)
    touched = elsewhere is not None or any(row.contacts for row in rows)
    steps = [("resume", "Finish the campaign", "")] if not result.complete else []
    if touched and result.requirement.metric not in ("contacts", "robot_contacts"):
        steps.append(("contact", "Judge contact itself", ""))
    if elsewhere is not None and elsewhere.attempt >= 0:
        steps.append(("confirm", f"Confirm the contact in {elsewhere.number}", f" {elsewhere.attempt}"))
    elif candidate is not None and not shown:
        steps.append(("confirm", f"Confirm candidate {candidate.number}", f" {candidate.attempt}"))
    few = shown and rows[0].runs < FEW_RUNS
    if strongest is not None and (few or strongest.status is Status.INCONCLUSIVE):
        steps.append(("more", "Make more runs", ""))
    steps.append(("keep", "Keep it as a regression test", "") if shown else ("repeat", "Search with another seed", ""))
    if rows:
        steps.append(("planner", "See what the planner does", f" --run {rows[0].run}"))
    usable = (NextStep(text=text, command=commands[key] + rest) for key, text, rest in steps if key in commands)
    return tuple(usable)[:3]


def _rest(ranking: Sequence[Ranked]) -> str:
    left = sum(entry.state == "not violated" for entry in ranking)
    return (
        f"{counted(left, 'more scenario')} {'was' if left == 1 else 'were'} not violated in the search." if left else ""
    )
