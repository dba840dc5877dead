"""Facts about the navigation stack under test besides its driving: pace, missed periods, refused commands."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from rvsg.evaluation.wording import counted
from rvsg.simulation.run import Run


@dataclass(frozen=True)
class UnderTest:
    """The stack under test in the runs of a campaign."""

    repeatable: bool
    """Whether equal seeds give equal runs."""
    rows: tuple[tuple[str, str], ...]
    """What there is to tell, each with its label."""


def under_test(runs: Iterable[Run]) -> UnderTest:
    """Return what the runs tell of their stack; no rows where it is the built-in one and nothing went wrong."""
    made = {run.id: run for run in runs}.values()  # attempts share runs
    told = [(run, facts) for run in made if isinstance(facts := run.details.get("stack"), Mapping)]
    rows = [
        *_start([run for run, _ in told]),
        *_pace([facts for _, facts in told]),
        *_refused([facts for _, facts in told]),
        *_warnings([run for run, _ in told]),
    ]
    return UnderTest(all(facts.get("repeatable", True) for _, facts in told), tuple(rows))


def _start(runs: list[Run]) -> Iterable[tuple[str, str]]:
    """Yield how the stack was started."""
    for name, label in (("launch", "Launch command"), ("params", "Parameter file")):
        given = {str(value) for run in runs if (value := _options(run).get(name))}
        if given:
            yield label, ", ".join(sorted(given))


def _options(run: Run) -> Mapping[str, Any]:
    """Return the options of the stack under test."""
    stack = run.options.get("stack")
    options = stack.get("options") if isinstance(stack, Mapping) else None
    return options if isinstance(options, Mapping) else {}


def _pace(told: list[Mapping[str, Any]]) -> Iterable[tuple[str, str]]:
    """Yield how fast the runs went, and how many control periods were missed."""
    releases = sorted({str(facts["release"]) for facts in told if "release" in facts})
    if releases:
        yield "ROS 2", ", ".join(releases)
    kept = [facts for facts in told if "speed" in facts and "speed_asked" in facts]
    if kept:
        asked = _range([float(facts["speed_asked"]) for facts in kept], "g")
        reached = _range([float(facts["speed"]) for facts in kept], ".2f")
        yield "Speed, in times of real time", f"{asked} asked, {reached} reached"
    counts = [(facts["missed_periods"], facts["missed_periods"] + facts["commands"]) for facts in kept]
    due = sum(every for _, every in counts)
    if due:
        missed, worst = sum(some for some, _ in counts), max(some / every for some, every in counts if every)
        most = f" ({100.0 * missed / due:.2g} %), at most {100.0 * worst:.2g} % in one run" if missed else ""
        yield "Control periods missed", f"{missed:,} of {due:,}{most}"


def _refused(told: list[Mapping[str, Any]]) -> Iterable[tuple[str, str]]:
    """Yield the velocities that the robot could not take as they came."""
    for name, label in (
        ("clipped", "Velocities beyond the limits of the robot, cut"),
        ("not_finite", "Velocities that are no numbers, left out"),
    ):
        found = [facts[name] for facts in told if facts.get(name)]
        if found:
            yield label, f"{sum(found):,} in {counted(len(found), 'run')}"


def _warnings(runs: list[Run]) -> Iterable[tuple[str, str]]:
    """Yield how many runs have warnings of the stack, and the first of each run until there are a few."""
    warned = [run for run in runs if run.stack_warnings]
    if warned:
        first = list(dict.fromkeys(text for run in warned for text in run.stack_warnings))[:3]
        yield "Runs with warnings of the stack", f"{len(warned)} of {len(runs)}; for instance: {'; '.join(first)}"


def _range(values: list[float], form: str) -> str:
    """Return the least and the largest of some numbers in words."""
    low, high = format(min(values), form), format(max(values), form)
    return low if low == high else f"{low} to {high}"
