"""Judgement of runs by a requirement, and the feedback for a generator."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rvsg.app.runs import RunSet, check_of, one_of
from rvsg.campaign.attempt import Attempt, Measurement
from rvsg.campaign.feedback import feedback_of
from rvsg.campaign.runner import Measuring
from rvsg.core.errors import InputError
from rvsg.core.outputs import check_writable
from rvsg.core.records import Pose
from rvsg.evaluation.verdict import (
    DEFAULT,
    Procedure,
    Status,
    Verdict,
    load_requirement,
    next_repeats,
    number,
    status_in_words,
    value_in_words,
    violated,
)
from rvsg.generation.generator import Proposal
from rvsg.scenario.brief import Brief, Feedback
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission, Scenario
from rvsg.scenario.world_lookup import as_world, world_of
from rvsg.simulation.run import Run
from rvsg.world.world import Route, World


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """The verdict on a scenario from its runs, with what it was judged by."""

    requirement: Requirement
    """With its limit worked out for the route's time limit."""
    verdict: Verdict
    measurements: tuple[Measurement, ...]
    procedure: Procedure
    """The error rates and the budget of runs."""

    @property
    def outcome(self) -> Status:
        """PASS, FAIL, FLAKY, INCONCLUSIVE, or UNJUDGED where the requirement has no limit."""
        return self.verdict.status

    @property
    def violated(self) -> bool:
        """Return whether the requirement is violated more than rarely, with the error rate of the procedure."""
        return violated(self.verdict, procedure=self.procedure)

    @property
    def violation_probability(self) -> float | None:
        """The share of runs that violate the requirement; None if none is judged."""
        return self.verdict.violation_probability

    @property
    def interval(self) -> tuple[float, float] | None:
        """The Clopper-Pearson interval of the violation probability."""
        return self.verdict.violation_interval

    @property
    def more_runs(self) -> int:
        """The fewest further runs that can decide the verdict; 0 if it is decided or the budget is spent."""
        objectives = [measured.objective for measured in self.measurements]
        return next_repeats(self.requirement, objectives, procedure=self.procedure)

    def __str__(self) -> str:
        unit = self.requirement.unit
        head = f"{self.requirement.name} {self.requirement.title}: {status_in_words(self.verdict)}"
        return f"{head}; {value_in_words(self.verdict, unit)}. {self.verdict.reason}."

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain data."""
        return {
            "requirement": self.requirement.model_dump(mode="json"),
            "verdict": self.verdict.model_dump(mode="json"),
            "next_repeats": self.more_runs,
            "measurements": [measured.model_dump(mode="json") for measured in self.measurements],
        }


def evaluate(
    runs: RunSet | Run | Iterable[Run],
    requirement: str | Path | Requirement = "R1",
    *,
    scenario: Scenario | None = None,
    world: World | str | Path | None = None,
) -> tuple[Measurement, ...]:
    """Return every metric of every run, and its value of the requirement's metric as `objective`.

    Metrics that concern obstacles have no value where the world is not known: give `scenario` or `world` for runs
    from a file.
    """
    return judge(runs, requirement, scenario=scenario, world=world).measurements


def judge(
    runs: RunSet | Run | Iterable[Run],
    requirement: str | Path | Requirement = "R1",
    *,
    scenario: Scenario | None = None,
    world: World | str | Path | None = None,
    procedure: Procedure = DEFAULT,
) -> Judgement:
    """Judge the runs of one scenario by a requirement.

    A limit that is a share of the route's time limit is worked out for these runs.

    Args:
        scenario: the scenario of the runs, where they are not from `simulate`.
        world: the world, where neither the runs nor the scenario know it.
        procedure: the error rates of the verdict.

    Raises:
        InputError: there is no run, or they are of different scenarios.
    """
    given = one_of(runs)
    if not given.runs:
        raise InputError("There is no run to judge.")
    if len({run.scenario_id for run in given}) > 1:
        raise InputError("The runs are of different scenarios; a verdict is on one. Judge them one by one.")
    known = scenario or given.scenario
    if known is not None:
        check_of(known, given)
    place = given.world
    if world is not None or (place is None and known is not None):
        place = world_of(known.mission, world) if known is not None else as_world(world or "")
    asked = load_requirement(requirement, time_limit_s=given[0].time_limit_s)
    measuring = Measuring(asked, place, procedure=procedure, time_limit_s=given[0].time_limit_s)
    measurements = tuple(measuring.measure(run) for run in given)
    return Judgement(
        requirement=asked, verdict=measuring.judge(measurements), measurements=measurements, procedure=procedure
    )


def write_page(
    path: Path,
    judged: Judgement,
    runs: RunSet,
    *,
    scenario: Scenario | None = None,
    world: World | str | Path | None = None,
    notes: Sequence[str] = (),
) -> None:
    """Write the page of judged runs: verdict, story, replay, and what recordings lack (`notes`).

    Raises:
        InputError: the world of the runs is not known.
    """
    from rvsg.report.page import write_runs_page

    known = scenario or runs.scenario
    given = world if world is not None else runs.world
    if given is None and known is None:
        raise InputError("A page needs the world of the runs: add --scenario FILE or --world.", code="no-world")
    place = world_of(known.mission, given) if known is not None else as_world(given or "")
    check_writable(path)
    write_runs_page(
        path,
        runs.runs,
        judged.measurements,
        judged.verdict,
        requirement=judged.requirement,
        mission=known.mission if known is not None else _driven(runs[0], place),
        world=place,
        scenario=known,
        notes=notes,
    )


def _driven(run: Run, world: World) -> Mission:
    """Return the mission of a run of which only the way is known."""
    path, (x, y, yaw) = run.trajectory, run.goal
    start = Pose(x=float(path.x[0]), y=float(path.y[0]), yaw=float(path.yaw[0]))
    goal = Pose(x=x, y=y, yaw=yaw)
    route = Route(name="as recorded", start=start, goal=goal, time_limit_s=run.time_limit_s)
    return Mission.of(world, route, robot="as recorded")  # no robot's name, so pages draw the body that the run has


def check_feedback_file(path: Path, scenario: Path | None) -> None:
    """Refuse to write feedback where no scenario is given, or where the file cannot be written."""
    check_writable(path)
    if scenario is None:
        raise InputError("--feedback needs the scenario of the runs: add --scenario FILE.", code="no-scenario")


def feedback(judged: Judgement, runs: RunSet | Iterable[Run], scenario: Scenario) -> Feedback:
    """Return what a generator learns from judged runs of a scenario; `propose` takes it.

    Raises:
        InputError: no run has a value of the requirement's metric.
    """
    given = one_of(runs)
    check_of(scenario, given)
    if judged.verdict.mean is None:
        raise InputError("None of the runs has a value of the requirement's metric, so there is nothing to learn from.")
    brief = Brief(
        mission=scenario.mission, requirement=judged.requirement, seed=0, humans=max(1, len(scenario.people.humans))
    )
    attempt = Attempt(
        campaign="by hand",
        index=0,
        strategy="by hand",
        brief=brief,
        proposal=Proposal(generator="by hand", scenario=scenario),
        measurements=judged.measurements,
        verdict=judged.verdict,
    )
    return feedback_of(attempt, given.runs, requirement=judged.requirement, world=world_of(scenario.mission))


def describe_judgement(judged: Judgement) -> Iterator[str]:
    """Yield a line for each run, one for the verdict, and one for what can decide it."""
    for measured in judged.measurements:
        yield f"seed {measured.seed}: {number(measured.objective, judged.requirement.unit)}, {measured.outcome}"
    yield str(judged)
    if judged.more_runs:
        procedure, verdict = judged.procedure, judged.verdict
        left = procedure.max_runs - len(judged.measurements)
        fewest = procedure.fewest_for(verdict.violations, verdict.runs).items()
        each = ", ".join(f"{count} for {status.value}" for status, count in fewest if count <= left)
        can = f"More runs can decide it: at least {each}" if each else f"{left} more cannot decide it"
        yield f"{can} (budget: {procedure.max_runs} in all)."
