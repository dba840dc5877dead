"""Data of the tables from stores: the trials of each method, by requirement and route, and the repeats."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rvsg.campaign.attempt import Attempt, Measurement
from rvsg.campaign.ledger import Ledger
from rvsg.evaluation.diversity import positions
from rvsg.evaluation.metrics.registry import measure
from rvsg.scenario.requirement import Requirement
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
        for campaign in ledger.campaigns():
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
