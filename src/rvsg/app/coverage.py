"""Coverage of worlds by suites and campaigns."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from rvsg.app.campaign import Campaign, campaigns_below
from rvsg.app.folder import reading
from rvsg.app.runs import simulate
from rvsg.app.suites import HEAD, Suite, requirement_of
from rvsg.campaign.exploration import Coverage, Exercise
from rvsg.core.errors import InputError
from rvsg.core.files import write_whole
from rvsg.core.plugins import Spec, ignore
from rvsg.report.overview import coverage_map, coverage_page, coverage_text
from rvsg.scenario.requirement import shipped_requirements
from rvsg.simulation.simulators import Simulator
from rvsg.world.drawing import png_bytes
from rvsg.world.world import World

Source = Suite | Campaign | str | Path
FORMATS = (".html", ".png", ".json")


@dataclass(frozen=True)
class WorldCoverage:
    """What was exercised of a world, with the world."""

    coverage: Coverage
    world: World

    @property
    def text(self) -> str:
        """The coverage as lines for a terminal."""
        return coverage_text(self.coverage)


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
    for source in (each for given in sources for each in _opened(given)):
        if isinstance(source, Suite):
            _add_suite(exercises, source, runs, jobs, simulator, on_message)
        else:
            _add_campaign(exercises, source)
    return tuple(WorldCoverage(each.coverage(), each.world) for each in exercises.values())


def write_coverage(path: str | Path, found: Iterable[WorldCoverage]) -> None:
    """Write coverage to a file: .html, .png (of one world) or .json.

    Raises:
        InputError: another ending, or a picture of several worlds.
    """
    path, found = Path(path), tuple(found)
    kind = path.suffix.lower()
    check_format(path)
    if kind == ".json":
        import json

        values = [each.coverage.model_dump(mode="json") for each in found]
        write_whole(path, json.dumps(values, indent=2, ensure_ascii=False) + "\n")
    elif kind == ".html":
        write_whole(path, coverage_page([(each.coverage, each.world) for each in found]))
    elif len(found) == 1:
        write_whole(path, png_bytes(coverage_map(found[0].coverage, found[0].world)))
    else:
        raise InputError(f"{path}: the scenarios are of {len(found)} worlds, and a picture shows one. Write .html.")


def check_format(path: Path) -> None:
    """Refuse a file whose ending is none that coverage can be written as."""
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"{path}: coverage is written as {', '.join(FORMATS)}. Give --out one of these endings.")


def _opened(given: Source) -> list[Suite | Campaign]:
    if isinstance(given, Suite | Campaign):
        return [given]
    folder = Path(given)
    if (folder / HEAD).is_file():
        return [Suite.open(folder)]
    if not folder.exists():
        raise InputError(f"{folder}: there is no suite and no campaign here.")
    return list(campaigns_below(folder))


def _exercise(exercises: dict[str, Exercise], world: World) -> Exercise:
    return exercises.setdefault(world.id, Exercise(world, tuple(shipped_requirements())))


def _add_suite(
    exercises: dict[str, Exercise],
    suite: Suite,
    runs: int,
    jobs: int,
    simulator: str | Spec | Simulator,
    on_message: Callable[[str], None],
) -> None:
    for case in suite.cases:
        world = suite.worlds[case.name]
        exercise = _exercise(exercises, world)
        exercise.add(case.scenario, [requirement_of(each, suite.folder).name for each in case.expectations])
        if runs:
            made = simulate(case.scenario, runs, jobs=jobs, simulator=simulator, world=world, on_message=on_message)
            for run in made:
                exercise.add_run(run)


def _add_campaign(exercises: dict[str, Exercise], campaign: Campaign) -> None:
    exercise = _exercise(exercises, campaign.world)
    with reading(campaign.source) as ledger:
        attempts = [a for a in ledger.attempts(campaign.name) if a.purpose in ("search", "confirmation")]
        for attempt in attempts:
            if attempt.proposal.scenario is not None:
                exercise.add(attempt.proposal.scenario, [campaign.requirement.name])
        for run_id in dict.fromkeys(m.run_id for attempt in attempts for m in attempt.measurements):
            exercise.add_run(ledger.run(run_id))
