"""Tables of the published study, computed from stores.

The tables: RQ1 effectiveness, RQ2 best against worst, RQ3 the same per route; published and honest.

Published way: the best of five configurations against single baseline runs, all repeats of the selected scenarios,
uncorrected p values. Honest way: equal numbers of simulated runs and no selection in the means; the run by which a
scenario was selected left out of its repeats; p values corrected by Holm, all tests of a table for one requirement
and one comparison being a family.

Rows are in long form: requirement, route, method, metric, value. `dto`, `jerk`, `trg`, `rpc`, `tnm` (and the others)
are the as-logged variants. Pooled rows carry the route `all`. `<id>_p` and `<id>_a12` stand with method `best` for
best against worst; in the honest RQ1 with the name of the baseline, for the guided method against it. `<id>_best5`
there is the value of the worst of five runs for the robot, guided and baseline alike.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import InputError
from rvsg.evaluation.diversity import description_diversity, positions, simulation_diversity, task_diversity
from rvsg.evaluation.metrics import measure
from rvsg.evaluation.statistics import compare, holm
from rvsg.runs.attempt import Attempt, Measurement
from rvsg.runs.ledger import Ledger
from rvsg.scenario.requirement import Requirement
from rvsg.search.drive_alone import campaigns_of
from rvsg.simulation.run import Run
from rvsg_study.study_folder import FOREIGN

TABLED = ("dto", "jerk", "trg", "rpc", "por", "chc", "pl", "tnm")
"""The metrics of the tables by their short ids; the values are those of the `_logged` variants."""

METHODS = {"study": "rvsg", "unguided": "unguided", "random": "random"}
Key = tuple[str, str]


@dataclass(frozen=True)
class Sample:
    """One run: its id, its table values by short id, the objective of the requirement it was measured by."""

    run_id: str
    values: dict[str, float]
    objective: float | None
    selection: bool = False


@dataclass(frozen=True)
class Trial:
    """One configuration of a scenario with its runs.

    `doubtful` is the reason why its runs may belong to another configuration; empty if there is none.
    """

    scenario: tuple[str, int]
    configuration: int
    description: str
    tasks: tuple[tuple[str, ...], ...]
    samples: tuple[Sample, ...]
    doubtful: str = ""

    def mean(self, metric: str) -> float | None:
        """Return the mean of a metric over the runs; None if no run has it."""
        values = [sample.values[metric] for sample in self.samples if metric in sample.values]
        return math.fsum(values) / len(values) if values else None

    @property
    def objective(self) -> float | None:
        """The mean objective over the runs."""
        values = [sample.objective for sample in self.samples if sample.objective is not None]
        return math.fsum(values) / len(values) if values else None


@dataclass
class Material:
    """The data of the tables.

    `trials[requirement, route][method]` for rvsg, unguided and random; `repeats[requirement, route][method]` the runs
    of the best and the worst scenario. `notes` say what is left out of all tables, `honest_notes` what else is left
    out of the honest ones.
    """

    ledgers: tuple[Ledger, ...]
    requirements: dict[str, Requirement] = field(default_factory=dict)
    trials: dict[Key, dict[str, list[Trial]]] = field(default_factory=dict)
    repeats: dict[Key, dict[str, list[Sample]]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    honest_notes: list[str] = field(default_factory=list)
    _positions: dict[str, NDArray[np.float64]] = field(default_factory=dict)

    def positions(self, run_id: str) -> NDArray[np.float64]:
        """Return the positions of robot and people in a run, at 2 Hz."""
        if run_id not in self._positions:
            self._positions[run_id] = positions(self.run(run_id))
        return self._positions[run_id]

    def run(self, run_id: str) -> Run:
        """Return the run of that id from any of the stores; StoreError if none holds it."""
        for ledger in self.ledgers:
            found = ledger.find(run_id)
            if found is not None:
                return found
        return self.ledgers[0].run(run_id)

    def cells(self) -> list[Key]:
        """Return the requirements and routes that have data, sorted."""
        return sorted({*self.trials, *self.repeats})


def gather(*ledgers: Ledger) -> Material:
    """Read whole stores. Baselines that name no requirement serve every requirement of their route."""
    material = Material(ledgers)
    baselines: dict[str, dict[str, list[Trial]]] = {}
    for ledger in ledgers:
        for campaign in campaigns_of(ledger):
            for attempt in ledger.attempts(campaign):
                _place(attempt, material, baselines)
    for requirement, route in material.cells():
        here = material.trials.setdefault((requirement, route), {})
        for method, trials in baselines.get(route, {}).items():
            # A baseline has no requirement, so it may have been run for another one and serves this one too.
            here.setdefault(method, trials)
    if not material.requirements:
        for route, methods in baselines.items():
            material.notes.append(f"{route}: {', '.join(methods)} without a guided method to compare with: left out")
    return material


def _place(attempt: Attempt, material: Material, baselines: dict[str, dict[str, list[Trial]]]) -> None:
    if attempt.purpose not in ("search", "confirmation"):
        return  # runs with fewer people explain a failure; they are no runs of a method
    route = attempt.brief.mission.route.name
    where = f"{attempt.campaign}: scenario {attempt.brief.scenario_index}, "
    where += f"configuration {attempt.brief.configuration_index}"
    material.notes += [f"{where}: run {failure.seed} left out: {failure.reason}" for failure in attempt.failures]
    requirement = attempt.brief.requirement
    if requirement is not None:
        material.requirements.setdefault(requirement.name, requirement)
    if attempt.purpose == "confirmation":
        if requirement is None:
            return
        which = str(attempt.proposal.extra.get("selection", "best"))
        selected = set(attempt.proposal.extra.get("selected_by", ()))
        runs = material.repeats.setdefault((requirement.name, route), {}).setdefault(which, [])
        runs.extend(_samples(attempt.measurements, material, selected))
        return
    method = METHODS.get(attempt.strategy, attempt.strategy)
    trial = _trial(attempt, material)
    if not trial.samples:
        if not attempt.failures:
            material.notes.append(f"{where}: no run, left out")
        return
    if requirement is None:
        judged_by = attempt.verdict.requirement if attempt.verdict else None
        if judged_by is not None:
            material.trials.setdefault((judged_by, route), {}).setdefault(method, []).append(trial)
        baselines.setdefault(route, {}).setdefault(method, []).append(trial)
    else:
        material.trials.setdefault((requirement.name, route), {}).setdefault(method, []).append(trial)


def _trial(attempt: Attempt, material: Material) -> Trial:
    scenario, extra = attempt.proposal.scenario, attempt.proposal.extra
    if scenario is not None:
        tasks = tuple(tuple(task.name for task in human.tasks) for human in scenario.people.humans)
        description = scenario.description
    else:
        tasks = tuple(tuple(listed) for listed in dict(extra.get("tasks", {})).values())
        description = str(extra.get("description", ""))
    doubts = [f.reason for f in attempt.proposal.first_findings if f.rule == f"import.{FOREIGN}"]
    return Trial(
        scenario=(attempt.campaign, attempt.brief.scenario_index),
        configuration=attempt.brief.configuration_index,
        description=description,
        tasks=tasks,
        samples=tuple(_samples(attempt.measurements, material, set())),
        doubtful=doubts[0] if doubts else "",
    )


def _samples(measurements: Sequence[Measurement], material: Material, selected: Iterable[str]) -> list[Sample]:
    chosen = set(selected)
    return [
        Sample(
            run_id=measurement.run_id,
            values=_values(measurement, material),
            objective=measurement.objective,
            selection=measurement.run_id in chosen,
        )
        for measurement in measurements
    ]


def _values(measurement: Measurement, material: Material) -> dict[str, float]:
    """Return the table values of a run: the stored ones, else measured now."""
    wanted = [f"{metric}_logged" for metric in TABLED]
    known = measurement.values
    if any(name not in known for name in wanted):
        known = measure(material.run(measurement.run_id), wanted)
    return {metric: value for metric in TABLED if (value := known[f"{metric}_logged"]) is not None}


POOLED = "all"
BASELINES = ("unguided", "random")


@dataclass(frozen=True)
class Row:
    """One value of a table."""

    requirement: str
    route: str
    method: str
    metric: str
    value: float


@dataclass(frozen=True)
class Tables:
    """The three tables, counted in one way."""

    rq1: list[Row]
    rq2: list[Row]
    rq3: list[Row]


def build(material: Material) -> tuple[Tables, Tables]:
    """Return the published and the honest tables of a store."""
    published = Tables(*(list(rows) for rows in (_rq1_published(material), *_repeated(material, False))))
    honest = Tables(*(list(rows) for rows in (_rq1_honest(material), *_repeated(material, True))))
    return published, Tables(*(corrected(rows) for rows in (honest.rq1, honest.rq2, honest.rq3)))


def corrected(rows: Sequence[Row]) -> list[Row]:
    """Return the rows with p values corrected by Holm; a family is one requirement and one comparison."""
    families: dict[tuple[str, str], dict[str, float]] = {}
    for at, row in enumerate(rows):
        if row.metric.endswith("_p"):
            families.setdefault((row.requirement, row.method), {})[str(at)] = row.value
    better = {at: p for family in families.values() for at, p in holm(family).items()}
    return [replace(row, value=better[str(at)]) if str(at) in better else row for at, row in enumerate(rows)]


# RQ1: how bad are the scenarios of each method, and how diverse?


def _rq1_published(material: Material) -> Iterable[Row]:
    for (name, route), methods in sorted(material.trials.items()):
        requirement = material.requirements.get(name)
        for method, trials in methods.items():
            if method == "rvsg" and requirement is not None:
                chosen = [t for t in (_best(group, requirement) for group in _by_scenario(trials)) if t is not None]
            else:
                chosen = list(trials)
            spent = sum(len(trial.samples) for trial in trials)
            yield from _described(material, (name, route), method, chosen, spent)


def _rq1_honest(material: Material) -> Iterable[Row]:
    for (name, route), methods in sorted(material.trials.items()):
        sound = {method: _sound(trials, material, route) for method, trials in methods.items()}
        sound = {method: trials for method, trials in sound.items() if trials}
        budget = min((sum(len(t.samples) for t in trials) for trials in sound.values()), default=0)
        equal = {method: _first_runs(trials, budget) for method, trials in sound.items()}
        for method, trials in equal.items():
            yield from _described(material, (name, route), method, trials, budget, per_run=True)
        requirement = material.requirements.get(name)
        if requirement is not None:
            yield from _best_of_equal(name, route, sound, requirement)
        for baseline in BASELINES:
            if "rvsg" in equal and baseline in equal:
                yield from _compared((name, route), baseline, _runs(equal["rvsg"]), _runs(equal[baseline]))


def _described(
    material: Material,
    key: Key,
    method: str,
    trials: Sequence[Trial],
    runs: int,
    *,
    per_run: bool = False,
) -> Iterable[Row]:
    """Yield means of the metrics over trials (over runs with `per_run`), diversities, and the number of runs."""
    for metric in TABLED:
        found = [s.values.get(metric) for s in _runs(trials)] if per_run else [t.mean(metric) for t in trials]
        values = [value for value in found if value is not None]
        if values:
            yield Row(*key, method, metric, _mean(values))
    apart = [group[0] for group in _by_scenario(trials)]
    texts = [trial.description for trial in apart if trial.description]
    if len(texts) > 1:
        yield from _sdd(material, key, method, texts)
    diversity = task_diversity([trial.tasks for trial in apart])
    if diversity is not None:
        yield Row(*key, method, "htd", diversity)
    spread = simulation_diversity([material.positions(trial.samples[0].run_id) for trial in apart])
    if spread is not None:
        yield Row(*key, method, "ssd", spread)
    yield Row(*key, method, "runs", float(runs))


def _sdd(material: Material, key: Key, method: str, texts: Sequence[str]) -> Iterable[Row]:
    try:
        diversity = description_diversity(texts)
    except InputError as absent:
        note = f"sdd is left out: {absent}"
        if note not in material.notes:
            material.notes.append(note)
        return
    if diversity is not None:
        yield Row(*key, method, "sdd", diversity)


def _by_scenario(trials: Iterable[Trial]) -> list[list[Trial]]:
    """Return the trials of each scenario, in the order of their configurations."""
    groups: dict[tuple[str, int], list[Trial]] = {}
    for trial in trials:
        groups.setdefault(trial.scenario, []).append(trial)
    return [sorted(group, key=lambda t: t.configuration) for group in groups.values()]


def _best(group: Sequence[Trial], requirement: Requirement) -> Trial | None:
    """Return the configuration with the worst mean objective for the robot; the earliest of equals."""
    known = [(t, t.objective) for t in group]
    rated = [(requirement.badness(value), t) for t, value in known if value is not None]
    return max(rated, key=lambda pair: pair[0])[1] if rated else None


def _sound(trials: Sequence[Trial], material: Material, route: str) -> list[Trial]:
    """Return the trials whose runs surely belong to their configuration."""
    for trial in trials:
        note = (
            f"{trial.scenario[0]}: scenario {trial.scenario[1]}, configuration {trial.configuration}: {trial.doubtful}"
        )
        if trial.doubtful and (note := f"{note}; left out of the honest tables") not in material.honest_notes:
            material.honest_notes.append(note)
    return [trial for trial in trials if not trial.doubtful]


def _first_runs(trials: Sequence[Trial], budget: int) -> list[Trial]:
    """Return the first `budget` runs: one of each scenario before a second of any, first configurations first."""
    ranked = [
        (repeat, rank, at, trial, sample)
        for at, group in enumerate(_by_scenario(trials))
        for rank, trial in enumerate(group)
        for repeat, sample in enumerate(trial.samples)
    ]
    ranked.sort(key=lambda entry: entry[:3])
    return [replace(trial, samples=(sample,)) for _, _, _, trial, sample in ranked[:budget]]


def _best_of_equal(name: str, route: str, sound: dict[str, list[Trial]], requirement: Requirement) -> Iterable[Row]:
    """Yield the worst of k runs for the robot, for guided and baseline alike: selection with an equal budget.

    k is the number of configurations per scenario. The guided method's k are those of a scenario; a baseline's
    value is the exact expectation over every choice of k of its runs. Of repeats only the first counts, or the guided
    method would select among k means where the baseline has k runs.
    """
    sound = {method: [replace(t, samples=t.samples[:1]) for t in trials] for method, trials in sound.items()}
    guided = _by_scenario(sound.get("rvsg", []))
    k = max((len(group) for group in guided), default=0)
    if k < 2:
        return
    best = [trial for trial in (_best(group, requirement) for group in guided) if trial is not None]
    for metric in TABLED:
        values = [value for trial in best if (value := trial.mean(metric)) is not None]
        if values:
            yield Row(name, route, "rvsg", f"{metric}_best{k}", _mean(values))
        for baseline in BASELINES:
            expected = expected_best(_runs(sound.get(baseline, [])), metric, requirement, k)
            if expected is not None:
                yield Row(name, route, baseline, f"{metric}_best{k}", expected)


def expected_best(samples: Sequence[Sample], metric: str, requirement: Requirement, k: int) -> float | None:
    """Return the mean of `metric` over the worst run of every choice of k runs; None with fewer than k runs."""
    objective = (requirement.metric or "").removesuffix("_logged")
    rated = []
    for sample in samples:
        # A baseline that serves several requirements was measured for one: only the tabled metrics hold for all.
        known = sample.values.get(objective) if objective in TABLED else sample.objective
        if known is not None and metric in sample.values:
            rated.append((requirement.badness(known), sample.values[metric]))
    n = len(rated)
    if n < k:
        return None
    rated.sort(key=lambda pair: -pair[0])
    # The run of rank i is the worst of a choice when the other k - 1 come from the n - 1 - i ranks after it.
    return sum(math.comb(n - 1 - i, k - 1) * value for i, (_, value) in enumerate(rated)) / math.comb(n, k)


def _runs(trials: Iterable[Trial]) -> list[Sample]:
    return [sample for trial in trials for sample in trial.samples]


# RQ2 and RQ3: does the best scenario differ from the worst when both are repeated?


def _repeated(material: Material, honest: bool) -> tuple[list[Row], list[Row]]:
    """Return RQ2 (pooled over routes) and RQ3 (per route) of the repeated best and worst scenarios."""
    pooled: dict[str, dict[str, list[list[Sample]]]] = {}
    spreads: dict[tuple[str, str], list[float]] = {}
    per_route: list[Row] = []
    for (name, route), methods in sorted(material.repeats.items()):
        kept = {m: [s for s in runs if not (honest and s.selection)] for m, runs in methods.items()}
        for method, runs in kept.items():
            pooled.setdefault(name, {}).setdefault(method, []).append(runs)
            per_route += _summed((name, route), method, [runs])
            spread = simulation_diversity([material.positions(sample.run_id) for sample in runs])
            if spread is not None:
                spreads.setdefault((name, method), []).append(spread)
                per_route.append(Row(name, route, method, "ssd", spread))
        per_route += _compared((name, route), "best", kept.get("best", []), kept.get("worst", []))
    overall: list[Row] = []
    for name, by_method in pooled.items():
        for method, sets in by_method.items():
            overall += _summed((name, POOLED), method, sets)
            if (name, method) in spreads:
                overall.append(Row(name, POOLED, method, "ssd", _mean(spreads[name, method])))
        best, worst = ([s for runs in by_method.get(method, []) for s in runs] for method in ("best", "worst"))
        overall += _compared((name, POOLED), "best", best, worst)
    return overall, per_route


def _summed(key: Key, method: str, sets: Sequence[Sequence[Sample]]) -> Iterable[Row]:
    """Yield the mean over all runs, the mean over routes of the standard deviation, and the number of runs."""
    for metric in TABLED:
        values = [[s.values[metric] for s in runs if metric in s.values] for runs in sets]
        together = [value for route in values for value in route]
        if together:
            yield Row(*key, method, metric, _mean(together))
        deviations = [float(np.std(route, ddof=1)) for route in values if len(route) > 1]
        if deviations:
            yield Row(*key, method, f"{metric}_std", _mean(deviations))
    yield Row(*key, method, "runs", float(sum(len(runs) for runs in sets)))


def _compared(key: Key, method: str, first: Sequence[Sample], second: Sequence[Sample]) -> Iterable[Row]:
    """Yield for each metric the two-sided Mann-Whitney p, and A12 of the first against the second."""
    for metric in TABLED:
        found = compare(*([s.values[metric] for s in samples if metric in s.values] for samples in (first, second)))
        if found is not None:
            yield Row(*key, method, f"{metric}_p", found.p)
            yield Row(*key, method, f"{metric}_a12", found.a12)


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)
