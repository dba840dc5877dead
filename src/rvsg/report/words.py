"""Words of pages and terminal for requirements, robots and the stack under test."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from rvsg.evaluation.metrics import find_metric
from rvsg.evaluation.statistics import Sensitivity
from rvsg.evaluation.story import Sentence
from rvsg.evaluation.verdict import counted, number
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission, Scenario
from rvsg.scenario.variation import Range
from rvsg.simulation.run import Run


def quantity(requirement: Requirement) -> str:
    """Return the judged quantity in words, with the id of its metric."""
    if requirement.formula is not None:
        return "robustness of the formula"
    metric = find_metric(requirement.metric)
    if metric is None:
        return requirement.metric or "objective"
    title = metric.title[:1].lower() + metric.title[1:] if metric.title[1:2].islower() else metric.title
    return f"{title} ({requirement.metric})"


def direction(requirement: Requirement) -> str:
    """Return which values are worse, e.g. `lower is worse`."""
    return "lower is worse" if requirement.worse == "smaller" else "higher is worse"


def limit_in_words(requirement: Requirement) -> str:
    """Return what keeps the requirement, e.g. `at least 1.2 m`; empty without a limit."""
    side, share = "at least" if requirement.worse == "smaller" else "at most", requirement.limit_share
    if share is not None:
        return f"{side} {share:g} of the time limit"
    limit = requirement.threshold
    return "" if limit is None else f"{side} {number(limit, requirement.unit)}"


def shown_at(t_s: float) -> str:
    """Return the tenth of a second at which the replay shows what happens at a time: the first that is not before."""
    return f"{math.ceil(10 * t_s - 1e-6) / 10:.1f}"


def in_short(scenario: Scenario) -> str:
    """Return what everybody does first, for a scenario without a description."""
    return "; ".join(f"{human.name}: {human.tasks[0].name}" for human in scenario.people.humans)


def tried_of(tried: int, planned: int) -> str:
    """Return how many configurations were tried, of how many; a strategy that plans in runs may try more."""
    return f"{tried} of {planned}" if tried <= planned else str(tried)


def dependence(sensitivity: Sensitivity, of: Range, *, flat: bool) -> str:
    """Return how the violations depend on a range, as far as the runs tell it from chance.

    Args:
        flat: whether the fitted surface is flat.
    """
    if sensitivity.band is None:
        return "the same everywhere"
    (bad, runs), (others, rest), p = sensitivity.band.inside, sensitivity.band.outside, f"p {sensitivity.band.p:.2g}"
    low, high = (
        of.word(value) or f"{value:.2f}" for value in (of.at(sensitivity.band.low), of.at(sensitivity.band.high))
    )
    said = f"{bad}/{runs} violate from {low} to {high}"
    said += f", {others}/{rest} elsewhere ({p}{'' if sensitivity.band.told else ', not told apart from chance'})"
    ends = f"{100 * sensitivity.at_low:.0f} % at the low end, {100 * sensitivity.at_high:.0f} % at the high end"
    return said if flat else f"{said}; fitted: {ends}"


def trend(sensitivity: Sensitivity) -> str:
    """Return the trend of the objective over a range; empty where it is not known or not told apart."""
    if sensitivity.correlation is None or sensitivity.p is None or sensitivity.p >= 0.05:
        return ""
    way = "worse" if sensitivity.correlation > 0 else "better"
    return f"larger is {way} ({sensitivity.correlation:+.2f}, p {sensitivity.p:.2g})"


def untimed(sentence: Sentence) -> str:
    """Return the text of a sentence without its time, which stands beside it."""
    text = sentence.text.removeprefix(f"At {sentence.time_s:.1f} s ").removeprefix(f"From {sentence.time_s:.1f} s on ")
    return text[:1].upper() + text[1:]


def robot_words(mission: Mission) -> str:
    """Return the robot's name and whether it is calibrated; the name alone where only another simulator knows it."""
    robot = mission.robot_record
    if robot is None:
        return mission.robot_name
    return f"{robot.name} ({'' if robot.calibrated else 'not '}calibrated against published runs)"


@dataclass(frozen=True)
class UnderTest:
    """The stack under test in the runs of a campaign."""

    repeatable: bool
    """Whether equal seeds give equal runs."""
    rows: tuple[tuple[str, str], ...]
    """What there is to tell, each with its label."""


def under_test(runs: Iterable[Run]) -> UnderTest:
    """Return what the runs tell of their people and their stack; of the built-in stack only what went wrong."""
    distinct = {run.id: run for run in runs}.values()  # attempts share runs
    described = [(run, facts) for run in distinct if isinstance(facts := run.details.get("stack"), Mapping)]
    facts_of_stacks, runs = [facts for _, facts in described], [run for run, _ in described]
    rows = (*_people(distinct), *_start(runs), *_pace(facts_of_stacks), *_trouble(facts_of_stacks, runs))
    return UnderTest(all(facts.get("repeatable", True) for facts in facts_of_stacks), rows)


def _people(runs: Iterable[Run]) -> Iterable[tuple[str, str]]:
    """Yield the profile of the people of the embedded simulator; what 0.2 stored as `default` is `hunavsim` today."""
    people = set()
    for options in (run.options for run in runs if run.simulator == "embedded"):
        old = "published-study" if options.get("profile") == "published-study" else "hunavsim"
        people.add("default profile" if options.get("human_model") == "anticipation" else old)
    if people:
        yield "People", ", ".join(sorted(people))


def _start(runs: list[Run]) -> Iterable[tuple[str, str]]:
    for name, label in (("launch", "Launch command"), ("params", "Parameter file")):
        values = {str(value) for run in runs if (value := _options(run).get(name))}
        if values:
            yield label, ", ".join(sorted(values))


def _options(run: Run) -> Mapping[str, Any]:
    stack = run.options.get("stack")
    options = stack.get("options") if isinstance(stack, Mapping) else None
    return options if isinstance(options, Mapping) else {}


def _pace(details: list[Mapping[str, Any]]) -> Iterable[tuple[str, str]]:
    """Yield how fast the runs went, and how many control periods were missed."""
    releases = sorted({str(facts["release"]) for facts in details if "release" in facts})
    if releases:
        yield "ROS 2", ", ".join(releases)
    timed = [facts for facts in details if "speed" in facts and "speed_asked" in facts]
    if timed:
        asked = _range([float(facts["speed_asked"]) for facts in timed], "g")
        reached = _range([float(facts["speed"]) for facts in timed], ".2f")
        yield "Speed, in times of real time", f"{asked} asked, {reached} reached"
    counts = [(facts["missed_periods"], facts["missed_periods"] + facts["commands"]) for facts in timed]
    due = sum(every for _, every in counts)
    if due:
        missed, worst = sum(some for some, _ in counts), max(some / every for some, every in counts if every)
        most = f" ({100.0 * missed / due:.2g} %), at most {100.0 * worst:.2g} % in one run" if missed else ""
        yield "Control periods missed", f"{missed:,} of {due:,}{most}"


def _trouble(details: list[Mapping[str, Any]], runs: list[Run]) -> Iterable[tuple[str, str]]:
    """Yield the velocities that the robot could not take as they came, and the first warnings of the stack."""
    for name, label in (
        ("clipped", "Velocities beyond the limits of the robot, cut"),
        ("not_finite", "Velocities that are no numbers, left out"),
    ):
        troubles = [facts[name] for facts in details if facts.get(name)]
        if troubles:
            yield label, f"{sum(troubles):,} in {counted(len(troubles), 'run')}"
    warned = [run for run in runs if run.stack_warnings]
    if warned:
        first = list(dict.fromkeys(text for run in warned for text in run.stack_warnings))[:3]
        yield "Runs with warnings of the stack", f"{len(warned)} of {len(runs)}; for instance: {'; '.join(first)}"


def _range(values: list[float], form: str) -> str:
    low, high = format(min(values), form), format(max(values), form)
    return low if low == high else f"{low} to {high}"
