"""Results as sentences, for the command line and the studio."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

from rvsg.evaluation.verdict import (
    arrivals_in_words,
    counted,
    difference_in_words,
    how_sure,
    metres,
    number,
    percent,
    status_in_words,
    value_in_words,
    why_ended,
)
from rvsg.findings.findings import Finding, rarest_motion, realism_in_words
from rvsg.generation.generator import Call, Proposal
from rvsg.generation.vlm.model import Spending
from rvsg.report.words import dependence, trend
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.validity import warnings
from rvsg.search.exploration import FEWEST, Exploration
from rvsg.search.run_set import Judgement
from rvsg.simulation.run import Run
from rvsg.suites.suite import CaseResult
from rvsg.world.world import World

NEXT_STEP = {
    "refused": "refused (by the model or a safety filter): try another model",
    "empty": "empty: try another model, or raise max_output_tokens if it spends them on thinking",
    "truncated": "cut off by the limit of tokens: raise max_output_tokens",
}


def describe_finding(finding: Finding, requirement: Requirement) -> Iterator[str]:
    """Yield what a confirmation says: how often, with and without people, what else was seen, what happened."""
    verdict = finding.verdict
    runs = counted(verdict.runs + verdict.undefined, "confirmation run")
    which = f"{finding.number} (attempt {finding.attempt})"
    rare = "; in the worst run somebody does what fewer than 1 in 100 recorded people did" if finding.rare else ""
    yield f"{which} in {runs}: {status_in_words(verdict)}; {value_in_words(verdict, requirement.unit)}{rare}"
    yield f"  {how_sure(verdict)}. {why_ended(verdict)}".rstrip()
    if (compared := describe_difference(finding)) is not None:
        yield f"  {compared}"
    contacts = finding.contacts
    if contacts.runs:
        longest, speed = number(contacts.longest_s, "s"), number(contacts.worst_speed_m_s, "m/s")
        touched = f"{contacts.in_words} touch a person (longest {longest}, up to {speed})"
        yield f"  Contact: {touched}{'' if finding.violated else f', which {requirement.name} does not judge'}."
    elif finding.least_clearance_m is not None:
        yield f"  No run touches a person; the smallest gap is {metres(finding.least_clearance_m)}."
    if finding.realism:
        yield f"  {finding.realism}"
    for cause in finding.cause:
        many = f"{cause.violated} of {counted(cause.of, 'run')}"
        yield f"  Without {cause.without}: {many} violate it; with everybody {cause.before}."
    if finding.violated and finding.story:
        yield f"  {' '.join(finding.story)}"


def describe_difference(finding: Finding) -> str | None:
    """Return how often the requirement is violated with and without people; None where that was not measured."""
    alone, probability = finding.without_people, finding.violation_probability
    if alone is None or finding.difference is None or finding.difference_interval is None or probability is None:
        return None
    if alone.measures_nothing:
        return "Without people the requirement measures nothing: it is about the people themselves."
    said = difference_in_words(finding.difference, finding.difference_interval, finding.verdict.confidence)
    meant = {
        "no": " The violation recurs without people, so it is not a finding about people.",
        "open": " These runs do not tell whether the people cause it.",
    }
    if finding.also_alone:
        meant["open"] = " It also happens without people; these runs do not tell whether people make it more frequent."
    without = percent(alone.probability)
    return f"{percent(probability)} with these people, {without} without ({said}).{meant.get(finding.about_people, '')}"


def describe_proposal(proposal: Proposal, world: World) -> Iterator[str]:
    """Yield what was proposed and what the checker said of it."""
    if proposal.scenario is not None:
        yield proposal.scenario.description or "(no description)"
    wrong = len(proposal.first_findings)
    checked = f"{counted(wrong, 'finding')} in the first reply, {counted(proposal.corrections, 'correction')} requested"
    yield f"{proposal.generator}: {checked if wrong else 'valid in the first reply'}"
    for finding in proposal.first_findings:
        yield f"  found: {finding}"
    for repair in proposal.repairs:
        yield f"  repaired: {repair.human}, {repair.task}: {repair.what}"
    for problem in proposal.problems:
        yield f"  left: {problem}"
    if proposal.scenario is not None:
        for doubtful in warnings(proposal.scenario.people, proposal.scenario.mission, world):
            yield f"  warning: {doubtful}"


def describe_spending(spent: Spending) -> str:
    """Return what was spent, in dollars where the price is known, else in tokens."""
    if spent.unpriced:
        return f"{spent.input_tokens} input and {spent.output_tokens} output tokens"
    return f"{spent.cost_usd:.4f} USD"


def describe_unusable(calls: Iterable[Call]) -> str | None:
    """Return how many replies of a model were unusable and what to do about it; None where all were usable."""
    kinds = Counter(call.error for call in calls if call.error in NEXT_STEP)
    said = [f"{count} {'was' if count == 1 else 'were'} {NEXT_STEP[str(kind)]}" for kind, count in kinds.items()]
    return f"Of the model's answers {'; '.join(said)}." if said else None


def describe_calls(calls: Sequence[Call]) -> str:
    """Return what calls of a model cost, as one line."""
    if not calls:
        return "No call was made."
    costs = [call.cost_usd for call in calls]
    cost = f"{sum(c for c in costs if c is not None):.4f} USD" if None not in costs else "cost unknown"
    about = "about " if any(call.estimated for call in calls) else ""
    tokens_in, written = sum(call.input_tokens for call in calls), sum(call.output_tokens for call in calls)
    tokens = f"{about}{tokens_in} input and {written} output tokens"
    return f"{counted(len(calls), 'call')} of {calls[0].model}: {tokens}, {cost}."


def describe_case(case: CaseResult) -> str:
    """Return one line on a case of a suite."""
    extra = f"; {counted(case.contacts, 'run touches', 'runs touch')} a person" if case.contacts else ""
    robot = case.robot.partition(" (")[0]  # its id tells versions apart, in results and comparisons
    return f"{case.state.value:14} {case.case}, {case.requirement} ({robot}): {case.verdict.reason}{extra}"


def describe_exploration(exploration: Exploration) -> str:
    """Return what was found as lines for a terminal."""
    low, high = exploration.interval
    lines = [
        f"{arrivals_in_words(exploration.arrived, exploration.runs)}{exploration.requirement.name} is violated in "
        f"{exploration.violations} of {exploration.runs} runs over the ranges "
        f"({100 * low:.0f} to {100 * high:.0f} %)."
    ]
    if invalid := sum(bool(point.problems) for point in exploration.points):
        lines.append(f"{invalid} of {len(exploration.points)} points are no valid scenario and were not run.")
    if exploration.surface is None:
        return "\n".join([*lines, f"A surface needs at least {FEWEST} runs."])
    ranges = {varied.name: varied for varied in exploration.ranges}
    for sensitivity in sorted(exploration.sensitivities, key=lambda s: (s.band.p if s.band else 1.0, -s.share)):
        where = dependence(sensitivity, ranges[sensitivity.name], flat=exploration.surface.degree == 0)
        lines.append(f"  {sensitivity.name}: {where}")
        if said := trend(sensitivity):
            lines.append(f"    {exploration.requirement.name}: {said}")
    return "\n".join(lines)


def describe_judgement(judged: Judgement, runs: Iterable[Run]) -> Iterator[str]:
    """Yield a line for each run, one for the verdict, one on the people, and one for what can decide it."""
    for measured in judged.measurements:
        yield f"seed {measured.seed}: {number(measured.objective, judged.requirement.unit)}, {measured.outcome}"
    yield str(judged)
    by_id, violated_by = {run.id: run for run in runs}, judged.requirement.violated_by
    bad = [m for m in judged.measurements if m.objective is not None and violated_by(m.objective)]
    if realism := realism_in_words(rarest_motion(bad or judged.measurements, by_id.__getitem__)):
        yield realism
    if judged.more_runs:
        procedure, verdict = judged.procedure, judged.verdict
        left = procedure.max_runs - len(judged.measurements)
        fewest = procedure.fewest_for(verdict.violations, verdict.runs).items()
        needed = ", ".join(f"{count} for {status.value}" for status, count in fewest if count <= left)
        can = f"More runs can decide it: at least {needed}" if needed else f"{left} more cannot decide it"
        yield f"{can} (budget: {procedure.max_runs} in all)."
