"""Generators and strategies at an equal number of runs, over routes, requirements and seeds.

    python benchmarks/search_methods.py --methods heuristic:hybrid,random:random --routes route_1 --seeds 3

Every method searches with the same number of runs and is then confirmed the same way: its best configuration in fresh
runs that took no part in the search, and further candidates until the confirmation runs are spent. One row holds the
result of one campaign; a file of rows makes a comparison resumable.
"""

from __future__ import annotations

import contextlib
import html
import json
import math
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from rvsg.app.settings import CampaignConfig, effective
from rvsg.app.wiring import Wired, jobs_of, wire
from rvsg.cli.frame import guarded, verb
from rvsg.cli.options import setting_options
from rvsg.core.errors import BudgetSpent, InputError
from rvsg.core.files import write_whole
from rvsg.core.records import Record
from rvsg.core.seeds import fresh_seeds
from rvsg.evaluation.diversity import available, description_diversity, positions, simulation_diversity, task_diversity
from rvsg.evaluation.statistics import Comparison, compare, holm
from rvsg.evaluation.verdict import Verdict, violated
from rvsg.findings.feedback import failure_map
from rvsg.findings.ranking import best_attempt, in_full, measured, search_attempts, standing
from rvsg.report.charts import COLOURS, Scale, span, ticks
from rvsg.runs.attempt import Attempt, Measurement
from rvsg.runs.ledger import CachedLedger, MemoryLedger
from rvsg.runs.observation import FailureMode, mode_of, usual
from rvsg.runs.runner import FinishedRun, RunRequest
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.search.execution import Parts, calls_of
from rvsg.search.loop import run_campaign
from rvsg.simulation.run import Run

BEST_RUNS = 20
"""Confirmation runs of the best configuration: their mean is the value that methods are compared by."""
LATER_RUNS = 6
"""Confirmation runs of every further candidate, at most: one whose first two both violate, or neither, gets no more."""


class Row(Record):
    """The result of one campaign of a comparison.

    Attributes:
        confirmed_mean: Mean objective of the best configuration in confirmation runs; None if nothing was measured.
        search_mean: What the search measured of the same configuration.
        violation_probability: Share of those confirmation runs that violate the requirement.
        distinct_failures: Number of failure modes among the confirmed candidates.
        failures: These failure modes in words.
        runs: Runs of the search.
        budget_runs: Runs that the search might spend; None in files of earlier versions.
        confirmation_runs: Runs of the confirmations.
        sdd, htd, ssd: Diversity of the violating scenarios: their descriptions, their tasks, their runs; None for
            fewer than two. sdd needs the extra `embeddings` and its model, else it is None.
        cells, broken_cells: Kinds of encounter (where on the way, near which area, with whom, how) that the search
            showed, and those with a violation.
        curve: Search value of the best configuration so far, as (runs, value), where it changes.
    """

    method: str
    route: str
    requirement: str
    seed: int
    worse: str
    confirmed_mean: float | None
    search_mean: float | None
    violation_probability: float | None
    distinct_failures: int
    failures: tuple[str, ...] = ()
    runs: int
    budget_runs: int | None = None
    confirmation_runs: int
    configurations: int
    calls: int = 0
    tokens: int = 0
    usd: float = 0.0
    sdd: float | None = None
    htd: float | None = None
    ssd: float | None = None
    cells: int | None = None
    broken_cells: int | None = None
    curve: tuple[tuple[int, float], ...] = ()

    @property
    def key(self) -> tuple[str, str, str, int]:
        """What the row is the result of."""
        return (self.method, self.route, self.requirement, self.seed)


def read_rows(path: Path) -> list[Row]:
    """Return the rows of a file; none if there is no such file."""
    if not path.exists():
        return []
    try:
        return [Row.model_validate(row) for row in json.loads(path.read_text(encoding="utf-8"))]
    except ValueError as error:
        raise InputError(f"{path} holds no rows of a comparison: {error}. Give another file with --json.") from error


def write_rows(path: Path, rows: Iterable[Row]) -> None:
    """Write rows as a JSON list, all or nothing."""
    write_whole(path, json.dumps([row.model_dump(mode="json") for row in rows], indent=1) + "\n")


def split_method(method: str) -> tuple[str, str]:
    """Return generator and strategy of `generator:strategy`."""
    generator, _, strategy = method.partition(":")
    if not generator or not strategy:
        raise InputError(f'"{method}" is no method. Write generator:strategy, for example heuristic:hybrid.')
    return generator, strategy


def run_comparison(
    base: CampaignConfig,
    methods: Sequence[str],
    routes: Sequence[str],
    requirements: Sequence[str],
    seeds: Sequence[int],
    *,
    rows: Sequence[Row] = (),
    report: Callable[[Row], None] = lambda _: None,
) -> list[Row]:
    """Run every campaign that has no row yet, and return all rows in the order of the request.

    Raises:
        InputError: A method, route or requirement does not exist, or a row is from a search with another budget.
            Checked before the first run.
    """
    known = {row.key: row for row in rows}
    asked = [
        (method, route, requirement, seed)
        for seed in seeds
        for route in routes
        for requirement in requirements
        for method in methods
    ]
    for row in (known[key] for key in asked if key in known):
        if row.budget_runs not in (None, base.budget_runs):
            raise InputError(
                f"The rows of {row.method} were made with {row.budget_runs} runs for each search, not "
                f"{base.budget_runs}. Give another file, or the same --budget-runs."
            )
    wired = {key: _wired(base, *key) for key in asked if key not in known}
    for key in asked:
        if key in known:
            continue
        known[key] = _row(key, wired.pop(key))
        report(known[key])
    return [known[key] for key in asked]


def _wired(base: CampaignConfig, method: str, route: str, requirement: str, seed: int) -> Wired:
    generator, strategy = split_method(method)
    changes = {
        "generator": generator,
        "strategy": strategy,
        "route": route,
        "requirement": requirement,
        "seed": seed,
        "confirmations": 0,
    }
    return wire(CampaignConfig(**{**base.model_dump(), **changes}))


def _row(key: tuple[str, str, str, int], wired: Wired) -> Row:
    """Run one campaign and confirm what it found."""
    ledger = CachedLedger(MemoryLedger())
    config = wired.config
    with wired.runner(ledger, lambda _: None, jobs=jobs_of(config), executor=None) as runner:
        parts = wired.parts(wired.plan, config.judging, ledger, runner, lambda: False)
        attempts = _searched(wired, ledger, parts)
        confirmed = _Confirmed(wired, ledger, parts, attempts)
        best = best_attempt(attempts, wired.plan.requirement)
        verdict = confirmed.best(best) if best else None
        modes = confirmed.failure_modes()
    cells = failure_map(attempts, wired.plan.requirement, run_of=ledger.run, world=wired.world)
    calls = calls_of(search_attempts(attempts))
    found = [a.proposal.scenario for a in measured(attempts) if a.verdict and a.verdict.violations]
    scenarios = [scenario for scenario in found if scenario is not None]
    return Row(
        method=key[0],
        route=key[1],
        requirement=key[2],
        seed=key[3],
        worse=wired.plan.requirement.worse,
        confirmed_mean=verdict.mean if verdict else None,
        search_mean=best.mean if best else None,
        violation_probability=verdict.violation_probability if verdict else None,
        distinct_failures=len(modes),
        failures=tuple(mode.words for mode in modes),
        runs=len({m.run_id for a in search_attempts(attempts) for m in a.measurements}),
        budget_runs=wired.config.budget_runs,
        confirmation_runs=confirmed.runs,
        configurations=len({a.proposal.scenario.id for a in measured(attempts) if a.proposal.scenario}),
        calls=len(calls),
        tokens=sum(call.input_tokens + call.output_tokens for call in calls),
        usd=math.fsum(call.cost_usd or 0.0 for call in calls),
        sdd=description_diversity([s.description for s in scenarios[:30] if s.description]) if available() else None,
        htd=task_diversity([[[t.name for t in h.tasks] for h in s.people.humans] for s in scenarios[:30]]),
        ssd=simulation_diversity([positions(run) for run in confirmed.shown[:30]]),
        cells=len(cells),
        broken_cells=sum(cell.violations > 0 for cell in cells),
        curve=curve(attempts, wired),
    )


def _searched(wired: Wired, ledger: CachedLedger, parts: Parts) -> list[Attempt]:
    """Search until the runs, or what the calls may cost, are spent."""
    with contextlib.suppress(BudgetSpent):
        run_campaign(wired.plan, wired.strategy(ledger), parts)
    return list(ledger.attempts(wired.plan.name))


def candidates(
    attempts: Sequence[Attempt], requirement: Requirement, kind_of: Callable[[Attempt], FailureMode | None]
) -> list[Attempt]:
    """Return the attempts worth confirming: those that violated the requirement, one of every kind of failure first.

    Within a kind, and among the first of each kind, those measured in full come first, then those that violate surely
    (2 of 2 runs say more than 1 of 1), then the worst for the robot.
    """
    full = {attempt.index for attempt in in_full(attempts)}
    violating = [a for a in measured(attempts) if a.verdict is not None and a.verdict.violations]
    violating.sort(key=lambda a: (a.index not in full, -_surely(a), -standing(a, requirement)[1], a.index))
    kinds: dict[FailureMode | None, int] = {}
    rank = []
    for attempt in violating:
        kind = kind_of(attempt)
        rank.append((kinds.get(kind, 0), attempt))
        kinds[kind] = kinds.get(kind, 0) + 1
    return [attempt for _, attempt in sorted(rank, key=lambda pair: pair[0])]


def _surely(attempt: Attempt) -> float:
    """The share of violations, pulled towards one half by one run of each kind."""
    assert attempt.verdict is not None
    return (attempt.verdict.violations + 1.0) / (attempt.verdict.runs + 2.0)


class _Confirmed:
    """Confirmation runs of what a search found: the best in full, then other candidates until the runs are spent."""

    def __init__(self, wired: Wired, ledger: CachedLedger, parts: Parts, attempts: Sequence[Attempt]) -> None:
        self.wired, self.ledger, self.parts, self.attempts = wired, ledger, parts, attempts
        used = {m.seed for attempt in attempts for m in attempt.measurements}
        self.seeds = fresh_seeds(wired.plan.seed, "confirmation", BEST_RUNS, used=used)
        self.runs = 0
        self.shown: list[Run] = []
        self._best: tuple[Attempt, FailureMode | None] | None = None

    def best(self, attempt: Attempt) -> Verdict:
        """Return the verdict on the best configuration."""
        scenario = attempt.proposal.scenario
        assert scenario is not None
        runs, measurements = self._run(scenario, self.seeds)
        verdict = self.parts.judge(measurements, budget=BEST_RUNS)
        if violated(verdict):
            self._best = (attempt, self._mode(runs, measurements))
        return verdict

    def failure_modes(self) -> list[FailureMode]:
        """Return the failure modes that are confirmed, in order, with at most `confirmations` further runs."""
        requirement = self.wired.plan.requirement
        modes = [self._best[1]] if self._best and self._best[1] else []
        begun = self.runs
        for attempt in candidates(self.attempts, requirement, self._kind):
            if self.runs - begun + LATER_RUNS > 3 * BEST_RUNS:
                break
            scenario = attempt.proposal.scenario
            if scenario is None or (self._best and attempt is self._best[0]):
                continue
            runs, measurements = self._run(scenario, self.seeds[:2])
            bad = sum(self._violates(m) for m in measurements)
            if bad and not self.parts.procedure.violated(bad, len(measurements)):
                more, others = self._run(scenario, self.seeds[2:LATER_RUNS])
                runs, measurements = [*runs, *more], [*measurements, *others]
            verdict = self.parts.judge(measurements, budget=LATER_RUNS) if measurements else None
            mode = self._mode(runs, measurements) if verdict and violated(verdict) else None
            if mode is not None and mode not in modes:
                modes.append(mode)
        return modes

    def _violates(self, measurement: Measurement) -> bool:
        objective = measurement.objective
        return objective is not None and self.wired.plan.requirement.violated_by(objective)

    def _kind(self, attempt: Attempt) -> FailureMode | None:
        runs = [self.ledger.run(m.run_id) for m in attempt.measurements if self._violates(m)]
        return usual(mode_of(run, self.wired.world) for run in runs)

    def _mode(self, runs: Sequence[Run], measurements: Sequence[Measurement]) -> FailureMode | None:
        """Return the mode that most of the violating runs show."""
        bad = {m.run_id for m in measurements if self._violates(m)}
        shown = [run for run in runs if run.id in bad]
        self.shown += shown[:1]
        return usual(mode_of(run, self.wired.world) for run in shown)

    def _run(self, scenario: Scenario, seeds: Sequence[int]) -> tuple[list[Run], list[Measurement]]:
        submitted = [self.parts.runner.submit(RunRequest(scenario, seed)) for seed in seeds]
        results = [run.result() for run in submitted]
        self.runs += len(results)
        done = [result for result in results if isinstance(result, FinishedRun)]
        for result in done:
            self.ledger.keep(result.packed)
        return [result.packed.unpack() for result in done], [result.measurement for result in done]


def curve(attempts: Sequence[Attempt], wired: Wired) -> tuple[tuple[int, float], ...]:
    """Return the search value of the best configuration against the runs spent, at every change."""
    points: list[tuple[int, float]] = []
    seen: set[str] = set()
    known: list[Attempt] = []
    for attempt in search_attempts(attempts):
        seen.update(m.run_id for m in attempt.measurements)
        known.append(attempt)
        best = best_attempt(known, wired.plan.requirement)
        if best is not None and best.mean is not None and (not points or points[-1][1] != best.mean):
            points.append((len(seen), best.mean))
    return tuple(points)


class Contrast(Record):
    """One method against another on one route with one requirement.

    `a12` > 0.5: the scenarios of the first method are worse for the robot, so the method is better.
    """

    method: str
    against: str
    route: str
    requirement: str
    value: Comparison
    failures: float | None


def contrasts(rows: Sequence[Row], method: str) -> list[Contrast]:
    """Compare one method with every other on each route and requirement, with Holm's correction over all tests."""
    pairs: dict[tuple[str, str], dict[str, list[Row]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        pairs[row.route, row.requirement][row.method].append(row)
    found: list[Contrast] = []
    for (route, requirement), by_method in pairs.items():
        first = _values(by_method.get(method, []))
        for other, others in by_method.items():
            result = compare(first, _values(others)) if other != method else None
            if result is not None:
                ratio = _ratio(by_method[method], others)
                found.append(
                    Contrast(
                        method=method,
                        against=other,
                        route=route,
                        requirement=requirement,
                        value=result,
                        failures=ratio,
                    )
                )
    corrected = holm({str(k): contrast.value.p for k, contrast in enumerate(found)})
    return [c.replace(value=c.value.replace(p_holm=corrected[str(k)])) for k, c in enumerate(found)]


def table(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the means over seeds, one line for each route, requirement and method."""
    groups: dict[tuple[str, str, str], list[Row]] = defaultdict(list)
    for row in rows:
        groups[row.route, row.requirement, row.method].append(row)
    return [
        {
            "route": route,
            "requirement": requirement,
            "method": method,
            "seeds": len(group),
            "confirmed": _mean([row.confirmed_mean for row in group]),
            "violation": _mean([row.violation_probability for row in group]),
            "failures": _mean([float(row.distinct_failures) for row in group]),
            "cells": _mean([None if row.cells is None else float(row.cells) for row in group]),
            "sdd": _mean([row.sdd for row in group]),
            "htd": _mean([row.htd for row in group]),
            "ssd": _mean([row.ssd for row in group]),
            "runs": _mean([float(row.runs) for row in group]),
            "calls": _mean([float(row.calls) for row in group]),
            "usd": _mean([row.usd for row in group]),
        }
        for (route, requirement, method), group in groups.items()
    ]


def _values(rows: Iterable[Row]) -> list[float]:
    """Return the confirmed means, with the sign turned so that larger is worse for the robot."""
    known = [(row.worse, row.confirmed_mean) for row in rows]
    return [-mean if worse == "smaller" else mean for worse, mean in known if mean is not None]


def write_figure(path: Path, rows: Sequence[Row]) -> None:
    """Write the figure of a comparison as SVG."""
    groups: dict[tuple[str, str], list[Row]] = defaultdict(list)
    for row in rows:
        groups[f"{row.route}, {row.requirement}", row.method].append(row)
    lines = [
        Line(
            panel,
            method,
            tuple(row.curve for row in group),
            tuple(row.confirmed_mean for row in group if row.confirmed_mean is not None),
        )
        for (panel, method), group in groups.items()
    ]
    write_whole(path, draw(lines))


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return math.fsum(known) / len(known) if known else None


def _ratio(first: Sequence[Row], second: Sequence[Row]) -> float | None:
    """Return how many times as many distinct failures per campaign; None if the second finds none."""
    a, b = (_mean([float(row.distinct_failures) for row in rows]) for rows in (first, second))
    return a / b if a is not None and b else None


PANEL_W, PANEL_H, LEGEND_H = 300, 220, 28
LEFT, RIGHT, TOP, BOTTOM = 44, PANEL_W - 16, 22, PANEL_H - 34
"""The edges of the plot in a panel, pixels."""


@dataclass(frozen=True)
class Line:
    """One method in one panel: for each seed the steps (runs, best value so far), and the confirmed values."""

    panel: str
    method: str
    steps: tuple[tuple[tuple[int, float], ...], ...]
    confirmed: tuple[float, ...]


COLUMNS = 3


def draw(lines: Sequence[Line]) -> str:
    """Return an SVG with a panel for each route and requirement.

    A curve is the mean over seeds of the best value so far; a dot is the mean confirmed value.
    """
    panels: dict[str, list[Line]] = defaultdict(list)
    for line in lines:
        panels[line.panel].append(line)
    methods = list(dict.fromkeys(line.method for line in lines))
    colours = {method: COLOURS[k % len(COLOURS)] for k, method in enumerate(methods)}
    rows = math.ceil(len(panels) / COLUMNS)
    width, height = PANEL_W * min(COLUMNS, max(1, len(panels))), PANEL_H * rows + LEGEND_H
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" '
        f'font-size="11"><rect width="{width}" height="{height}" fill="white"/>'
    ]
    for k, method in enumerate(methods):
        x = 10 + k * max(90, (width - 20) // max(1, len(methods)))
        parts.append(f'<line x1="{x}" x2="{x + 18}" y1="14" y2="14" stroke="{colours[method]}" stroke-width="2"/>')
        parts.append(f'<text x="{x + 23}" y="18">{html.escape(method)}</text>')
    for k, (name, drawn) in enumerate(panels.items()):
        left, top = PANEL_W * (k % COLUMNS), LEGEND_H + PANEL_H * (k // COLUMNS)
        parts.append(f'<g transform="translate({left},{top})">{_panel(name, drawn, colours)}</g>')
    return "".join([*parts, "</svg>\n"])


def _panel(name: str, lines: Sequence[Line], colours: dict[str, str]) -> str:
    values = [v for line in lines for steps in line.steps for _, v in steps[1:] or steps]
    values += [v for line in lines for v in line.confirmed]
    most = max((steps[-1][0] for line in lines for steps in line.steps if steps), default=1)
    if not values:
        return f'<text x="{LEFT}" y="14">{html.escape(name)}: nothing measured</text>'
    x, y = Scale(0.0, 1.05 * most, LEFT, RIGHT), Scale(*span(values), BOTTOM, TOP)
    parts = [f'<text x="{LEFT}" y="14" font-weight="bold">{html.escape(name)}</text>']
    for tick in ticks(y.low, y.high, 5):
        parts.append(f'<line x1="{LEFT}" x2="{RIGHT}" y1="{y(tick):.1f}" y2="{y(tick):.1f}" stroke="#ddd"/>')
        parts.append(f'<text x="{LEFT - 5}" y="{y(tick) + 4:.1f}" text-anchor="end">{tick:g}</text>')
    parts += [
        f'<text x="{x(tick):.1f}" y="{PANEL_H - 19}" text-anchor="middle">{tick:g}</text>'
        for tick in ticks(0.0, 1.05 * most, 5)
    ]
    parts.append(
        f'<text x="{(LEFT + PANEL_W) / 2:.0f}" y="{PANEL_H - 5}" text-anchor="middle">runs of the search</text>'
    )
    for line in lines:
        points = _mean_steps(line.steps, most)
        path = " ".join(f"{x(runs):.1f},{min(max(y(value), 20), PANEL_H - 32):.1f}" for runs, value in points)
        colour = colours[line.method]
        parts.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="1.6"/>')
        if line.confirmed:
            mean = math.fsum(line.confirmed) / len(line.confirmed)
            parts.append(f'<circle cx="{x(1.02 * most):.1f}" cy="{y(mean):.1f}" r="4" fill="{colour}"/>')
    return "".join(parts)


def _mean_steps(steps: Sequence[Sequence[tuple[int, float]]], most: int) -> list[tuple[int, float]]:
    """Return the mean over seeds of step functions, at every run at which one changes and all are known."""
    known = [s for s in steps if s]
    if not known:
        return []
    first = max(s[0][0] for s in known)
    marks = sorted({first, most, *(runs for s in known for runs, _ in s if runs > first)})
    return [
        (mark, math.fsum(next(v for r, v in reversed(s) if r <= mark) for s in known) / len(known)) for mark in marks
    ]


def compare_methods(
    base: CampaignConfig,
    methods: Sequence[str],
    routes: Sequence[str],
    requirements: Sequence[str],
    seeds: Sequence[int],
    *,
    json: Path | None = None,
    figure: Path | None = None,
) -> None:
    """Run a comparison and print its tables; keep the rows in a file, from which it resumes, and draw the curves."""
    from rvsg.cli import console

    rows = read_rows(json) if json else []

    def report(row: Row) -> None:
        rows.append(row)
        if json:
            write_rows(json, rows)
        console.say(_line(row))

    found = run_comparison(base, methods, routes, requirements, seeds, rows=tuple(rows), report=report)
    _print_tables(found, methods[0])
    if figure:
        write_figure(figure, found)
        console.say(f"Wrote {figure}")
    if json is None:
        console.print_json([row.model_dump(mode="json") for row in found])


def _line(row: Row) -> str:
    return (
        f"{row.method} {row.route} {row.requirement} seed {row.seed}: confirmed {_text(row.confirmed_mean)}, "
        f"violated in {_text(row.violation_probability)} of the confirmation runs, "
        f"{row.distinct_failures} distinct failures"
    )


def _print_tables(rows: Sequence[Row], first: str) -> None:
    """Print the means of every method, and the first method against each other one."""
    from rich.table import Table

    from rvsg.cli import console

    means = table(rows)
    for title, left_out in (("Means over seeds", DIVERSITY), ("Diversity of what was found", RESULTS)):
        keys = [key for key in means[0] if key not in left_out]
        shown = Table(title=title, title_justify="left", pad_edge=False)
        for key in keys:
            shown.add_column(key, justify="left" if key in CELL else "right")
        for line in means:
            shown.add_row(*(line[key] if key in CELL else _text(line[key]) for key in keys))
        console.say(shown)
    found = contrasts(rows, first)
    if not found:
        return
    shown = Table(title=f"{first} against the others", title_justify="left", pad_edge=False)
    for key in ("route", "requirement", "against", "A12", "p (Holm)", "failures ratio"):
        shown.add_column(key, justify="left" if key in ("route", "requirement", "against") else "right")
    for contrast in found:
        numbers = (contrast.value.a12, contrast.value.p_holm, contrast.failures)
        shown.add_row(contrast.route, contrast.requirement, contrast.against, *map(_text, numbers))
    console.say(shown)


CELL = ("route", "requirement", "method")
RESULTS = ("seeds", "confirmed", "violation", "failures", "runs", "calls", "usd")
DIVERSITY = ("cells", "sdd", "htd", "ssd")


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


app = verb()


@app.command()
@setting_options(
    "world",
    "simulator",
    "humans",
    "budget_runs",
    "budget_calls",
    "budget_tokens",
    "budget_usd",
    "model",
    "base_url",
    "jobs",
    budget_runs=250,
)
def main(
    settings: dict[str, Any],
    methods: Annotated[
        str, typer.Option(help="Methods as generator:strategy, separated by commas. The first is compared with all.")
    ] = "heuristic:hybrid,heuristic:study,heuristic:unguided,random:random",
    routes: Annotated[str, typer.Option(help="Routes, separated by commas.")] = "route_1",
    requirements: Annotated[str, typer.Option(help="Requirements by name or file, separated by commas.")] = "R1",
    seeds: Annotated[int, typer.Option(min=1, max=1000, help="Campaigns for each method, route and requirement.")] = 3,
    first_seed: Annotated[int, typer.Option(min=0, help="Seed of the first campaign.")] = 0,
    json: Annotated[
        Path | None, typer.Option(help="File for the rows. Give the same file again to resume or to add more.")
    ] = None,
    figure: Annotated[Path | None, typer.Option(help="SVG file of the curves.")] = None,
) -> None:
    """Compare methods at an equal number of runs, over routes, requirements and seeds.

    Every search gets the same number of runs. Its best configuration then gets 20 confirmation runs, other
    candidates up to 60 more; failures are grouped. The table shows means over seeds; A12 is the
    probability that a campaign of the first method confirms a worse value for the robot than one of the other (0.5: no
    difference), with p values of the Mann-Whitney test after Holm's correction.
    """
    seeds_asked = range(first_seed, first_seed + seeds)
    lists = (names.split(",") for names in (methods, routes, requirements))
    compare_methods(effective(None, {}, settings), *lists, seeds_asked, json=json, figure=figure)


if __name__ == "__main__":
    sys.exit(guarded(lambda: app(prog_name="search_methods.py"), sys.argv[1:]))
