"""Coverage of worlds by suites and campaigns."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rvsg.app.campaign import Campaign, campaigns_below
from rvsg.app.folder import reading
from rvsg.app.suites import Suite
from rvsg.core.errors import InputError
from rvsg.core.plugins import Spec, ignore
from rvsg.report.overview import WorldCoverage
from rvsg.scenario.requirement import shipped_requirements
from rvsg.search.exploration import Exercise
from rvsg.search.run_set import simulate
from rvsg.simulation.simulators import Simulator
from rvsg.suites.suite_folder import HEAD, requirement_of
from rvsg.world.world import World

Source = Suite | Campaign | str | Path


def coverage(
    *sources: Source,
    runs: int = 1,
    jobs: int = 1,
    simulator: str | Spec | Simulator = "embedded",
    on_message: Callable[[str], None] = ignore,
) -> tuple[WorldCoverage, ...]:
    """Return what suites and campaigns have exercised, for each world by itself.

    Args:
        sources: suites and campaigns, or their folders. A folder of several campaigns counts with all of them.
        runs: runs of each scenario of a suite, which stores none: they show the encounters. 0 runs none.
        jobs: worker processes.
        simulator: a name, a Spec, or an instance, which stays open.

    Raises:
        InputError: a folder holds neither a suite nor a campaign.
    """
    exercises: dict[str, Exercise] = {}

    def exercise_of(world: World) -> Exercise:
        return exercises.setdefault(world.id, Exercise(world, tuple(shipped_requirements())))

    for source in (each for given in sources for each in _opened(given)):
        if isinstance(source, Campaign):
            _add_campaign(exercise_of(source.world), source)
            continue
        for case in source.cases:
            world = source.worlds[case.name]
            exercise = exercise_of(world)
            exercise.add(
                case.scenario, [requirement_of(expectation, source.folder).name for expectation in case.expectations]
            )
            if runs:
                simulated = simulate(
                    case.scenario, runs, jobs=jobs, simulator=simulator, world=world, on_message=on_message
                )
                for run in simulated:
                    exercise.add_run(run)
    return tuple(WorldCoverage(exercise.coverage(), exercise.world) for exercise in exercises.values())


def _opened(given: Source) -> list[Suite | Campaign]:
    if isinstance(given, Suite | Campaign):
        return [given]
    folder = Path(given)
    if (folder / HEAD).is_file():
        return [Suite.open(folder)]
    if not folder.exists():
        raise InputError(f"{folder}: there is no suite and no campaign here.")
    return list(campaigns_below(folder))


def _add_campaign(exercise: Exercise, campaign: Campaign) -> None:
    with reading(campaign.source) as ledger:
        attempts = [a for a in ledger.attempts(campaign.name) if a.purpose in ("search", "confirmation")]
        for attempt in attempts:
            if attempt.proposal.scenario is not None:
                exercise.add(attempt.proposal.scenario, [campaign.requirement.name])
        for run_id in dict.fromkeys(m.run_id for attempt in attempts for m in attempt.measurements):
            exercise.add_run(ledger.run(run_id))
