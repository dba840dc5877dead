"""Scenarios and suites made of recordings: rebuilt, run again, compared with what happened, and kept."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rvsg.campaign.run_set import Judgement, judge, simulate
from rvsg.campaign.runner import Evaluator
from rvsg.core.errors import FileError
from rvsg.core.plugins import ignore
from rvsg.evaluation.verdict import counted, load_requirement
from rvsg.recording.fidelity import Estimate, Fidelity, Limits, compare, estimates, recorded_as
from rvsg.recording.intent import RecordedScenario, recorded_scenario
from rvsg.recording.tracks import Recording, load_recording
from rvsg.report.comparison_page import recording_page
from rvsg.report.run_facts import run_facts
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.world_lookup import as_world, remember
from rvsg.simulation.run import Run
from rvsg.world.creation import save_created, world_from
from rvsg.world.occupancy import write_map
from rvsg.world.world import World


@dataclass(frozen=True, kw_only=True)
class Rebuilt:
    """A recording as a scenario, and how today's runs of it compare with what happened.

    `runs` and `fidelities` are in the order of their distance from the recording.
    """

    made: RecordedScenario
    world: World
    requirement: Requirement
    runs: tuple[Run, ...]
    fidelities: tuple[Fidelity, ...]
    judged: Judgement
    estimates: tuple[Estimate, ...]

    @property
    def repeats(self) -> bool:
        """Whether at least half of the runs repeat the recording."""
        return 2 * sum(each.repeats for each in self.fidelities) >= len(self.fidelities)

    @property
    def verdict(self) -> str:
        """Whether the scenario repeats the recording, and how its runs are judged, in words."""
        count = sum(each.repeats for each in self.fidelities)
        limits = Limits()
        said = "The scenario repeats the recording" if self.repeats else "The scenario does not repeat the recording"
        said += (
            f": {count} of {counted(len(self.fidelities), 'run')} keep the smallest gap within {limits.gap_m:g} m, the "
            f"time within {limits.time_share:.0%}, the path within {limits.path_m:g} m, and contact or none."
        )
        bad = sum(
            self.requirement.violated_by(m.objective) for m in self.judged.measurements if m.objective is not None
        )
        if self.requirement.threshold is None:
            return said
        return f"{said} {bad} of {counted(len(self.runs), 'run')} violate {self.requirement.name}."

    @property
    def notes(self) -> tuple[str, ...]:
        """What the scenario rests on, and what the robot file could say instead."""
        proposed = [
            f"The robot file says {each.parameter}: {each.file:g}; the recording shows {each.recorded:g}."
            for each in self.estimates
        ]
        return (*map(str, self.made.notes), *proposed)

    def to_dict(self) -> dict[str, Any]:
        """Return everything but the scenario as plain data."""
        return {
            "repeats": self.repeats,
            "verdict": self.verdict,
            "fidelity": [each.model_dump(mode="json") | {"repeats": each.repeats} for each in self.fidelities],
            "estimates": [each.model_dump(mode="json") for each in self.estimates],
            "notes": [note.model_dump(mode="json") for note in self.made.notes],
        }

    def page(self) -> str:
        """Return the page with both drives on one clock."""
        scenario, world = self.made.scenario, self.world
        measuring = Evaluator(self.requirement, world)
        recorded = recorded_as(self.made.recording, self.runs[0])
        first, second = (
            run_facts(run, measuring.measure(run), self.requirement, world, of)
            for run, of in ((recorded, None), (self.runs[0], scenario))
        )
        return recording_page(
            Path(self.made.recording.source).name,
            (first, second),
            self.fidelities,
            scenario=scenario,
            requirement=self.requirement,
            world=world,
            verdict=self.verdict,
            notes=self.notes,
        )


def world_of_recording(recording: Recording, given: World | str | Path | None, folder: Path) -> World:
    """Return the world of a recording: the one given, else that of its map, which is written to `folder`.

    Raises:
        FileError: no world is given, and the recording holds no map.
    """
    if given is not None:
        return as_world(given)
    if recording.occupancy is None:
        raise FileError(Path(recording.source), "the recording holds no map (/map). Name the world: --world.")
    with tempfile.TemporaryDirectory() as place:
        write_map(recording.occupancy, Path(place))
        save_created(world_from("map", Path(place) / "map.yaml", name=folder.name), folder)
    return remember(as_world(folder), folder)


def rebuild(
    recording: Recording | str | Path,
    world: World,
    requirement: str | Path | Requirement = "R1",
    *,
    runs: int = 5,
    route: str | None = None,
    jobs: int = 1,
    simulator: Any = "embedded",
    stack: Any = None,
    on_message: Callable[[str], None] = ignore,
    **options: Any,
) -> Rebuilt:
    """Make a scenario of a recording, run it, and compare the runs with what happened.

    Args:
        options: those of `recorded_scenario`: `people`, `robot`, `limit_m`.
    """
    found = recording if isinstance(recording, Recording) else load_recording(recording, world=world)
    made = recorded_scenario(found, world, route=world.route(route) if route is not None else None, **options)
    scenario = made.scenario
    asked = load_requirement(requirement, scenario.mission.route)
    kept = simulate(scenario, runs, jobs=jobs, simulator=simulator, stack=stack, world=world, on_message=on_message)
    pairs = [(run, compare(made.recording, run, world)) for run in kept]
    pairs.sort(key=lambda pair: _distance(pair[1]))
    robot = scenario.mission.robot_record
    return Rebuilt(
        made=made,
        world=world,
        requirement=asked,
        runs=tuple(run for run, _ in pairs),
        fidelities=tuple(each for _, each in pairs),
        judged=judge(kept, asked, scenario=scenario, world=world),
        estimates=estimates(made.recording, pairs[0][0], robot) if robot is not None else (),
    )


def _distance(each: Fidelity) -> tuple[int, float]:
    apart = abs(each.gap_m[0] - each.gap_m[1]) if each.gap_m is not None else 0.0
    return len(each.differences), apart
