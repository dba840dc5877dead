"""Scenarios and suites made of recordings: rebuilt, run again, compared with what happened, and kept."""

from __future__ import annotations

import math
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from rvsg.app.saved_scenario import stack_file
from rvsg.app.suites import Suite
from rvsg.core.errors import FileError, RvsgError
from rvsg.core.plugins import Spec, ignore
from rvsg.core.records import Pose
from rvsg.evaluation.detection import encounters_of
from rvsg.evaluation.verdict import counted, load_requirement
from rvsg.recording.fidelity import Fidelity, FidelityLimits, RobotEstimate, compare, estimates, recorded_as
from rvsg.recording.intent import RecordedScenario, recorded_scenario
from rvsg.recording.recorded_run import recorded_run
from rvsg.recording.tracks import Recording, between, load_recording
from rvsg.report.comparison_page import RECORDED, pair_replay, recording_page
from rvsg.report.run_facts import RunFacts, run_facts
from rvsg.runs.runner import Evaluator
from rvsg.scenario.builder import FoundWith
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.world_lookup import as_world, remember
from rvsg.search.run_set import Judgement, judge, simulate
from rvsg.simulation.run import Run
from rvsg.simulation.simulators import by_content
from rvsg.simulation.stacks.stack_choice import StackLike
from rvsg.world.creation import save_created, world_from
from rvsg.world.occupancy import MOST_CELLS, write_map
from rvsg.world.world import OccupancyMap, World

FLOOR_M, CELL_M = 3.0, 0.05
"""An open floor reaches this far beyond everybody who was recorded; the side of its cells."""


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
    estimates: tuple[RobotEstimate, ...]
    found: FoundWith
    """What its runs were made and judged with."""

    @property
    def repeats(self) -> bool:
        """Whether at least half of the runs repeat the recording."""
        return 2 * sum(fidelity.repeats for fidelity in self.fidelities) >= len(self.fidelities)

    @property
    def verdict(self) -> str:
        """Whether the scenario repeats the recording, and how its runs are judged, in words."""
        count = sum(fidelity.repeats for fidelity in self.fidelities)
        limits = FidelityLimits()
        said = "The scenario repeats the recording" if self.repeats else "The scenario does not repeat the recording"
        said += (
            f": {count} of {counted(len(self.fidelities), 'run')} keep the smallest gap within {limits.gap_m:g} m, the "
            f"time within {limits.time_share:.0%}, the path within {limits.path_m:g} m, and contact or none, where the "
            "recording tells it; at least half have to."
        )
        if self.requirement.threshold is None:
            return said
        bad = self.judged.verdict.violations
        return f"{said} {bad} of {counted(len(self.runs), 'run')} violate {self.requirement.name}."

    @property
    def notes(self) -> tuple[str, ...]:
        """What the scenario rests on, and what the robot file could say instead."""
        proposed = [
            f"The robot file says {estimate.parameter}: {estimate.file:g}; the recording shows {estimate.recorded:g}."
            for estimate in self.estimates
        ]
        contact = [self.fidelities[0].contact] if self.fidelities[0].contact else []
        return (*map(str, self.made.notes), *contact, *proposed)

    def to_dict(self) -> dict[str, Any]:
        """Return everything but the scenario as plain data."""
        return {
            "repeats": self.repeats,
            "verdict": self.verdict,
            "fidelity": [
                fidelity.model_dump(mode="json") | {"repeats": fidelity.repeats} for fidelity in self.fidelities
            ],
            "estimates": [estimate.model_dump(mode="json") for estimate in self.estimates],
            "notes": [note.model_dump(mode="json") for note in self.made.notes],
        }

    @property
    def lines(self) -> list[str]:
        """What the scenario rests on, and what each run does, a line each."""
        return [
            *(f"- {note}" for note in self.notes),
            *(f"seed {fidelity.seed}: {fidelity}" for fidelity in self.fidelities),
        ]

    def replay(self) -> dict[str, object]:
        """Return both drives as data of the replay component: over one floor plan and on one clock."""
        return pair_replay(self._both, RECORDED, self.made.scenario, self.requirement, self.world)

    def page(self) -> str:
        """Return the page with both drives on one clock."""
        return recording_page(
            Path(self.made.recording.source).name,
            self._both,
            self.fidelities,
            data=self.replay(),
            requirement=self.requirement,
            verdict=self.verdict,
            notes=self.notes,
        )

    @cached_property
    def _both(self) -> tuple[RunFacts, RunFacts]:
        """The recording, and the run that is nearest to it."""
        nearest, measuring = self.runs[0], Evaluator(self.requirement, self.world)
        recorded = recorded_as(self.made.recording, nearest)
        first, second = (
            run_facts(run, measuring.measure(run), self.requirement, self.world, of)
            for run, of in ((recorded, None), (nearest, self.made.scenario))
        )
        return first, second


def world_of_recording(
    recording: Recording, given: World | str | Path | None, folder: Path, *, open_floor: bool = False
) -> World:
    """Return the world of a recording: the one given, else that of its map, which is written to `folder`.

    Args:
        open_floor: whether a recording without a map was made on a floor without obstacles.

    Raises:
        FileError: no world is given, and the recording holds no map.
    """
    if given is not None:
        return as_world(given)
    occupancy = recording.occupancy
    if occupancy is None and open_floor:
        occupancy = _floor(recording)
    if occupancy is None:
        said = "the recording holds no map (/map). Name the world: --world; or say --open-floor where nothing stood."
        raise FileError(Path(recording.source), said)
    with tempfile.TemporaryDirectory() as place:
        write_map(occupancy, Path(place))
        save_created(world_from("map", Path(place) / "map.yaml", name=folder.name), folder)
    return remember(as_world(folder), folder)


def _floor(recording: Recording) -> OccupancyMap:
    """Return the map of a free floor around everybody in a recording, with a wall around it."""
    places = np.concatenate([recording.robot[:, 1:3], *(person.rows[:, 1:3] for person in recording.people)])
    low, high = places.min(axis=0) - FLOOR_M, places.max(axis=0) + FLOOR_M
    columns, rows = np.ceil((high - low) / CELL_M).astype(int)
    if columns * rows > MOST_CELLS:
        said = f"its places lie up to {max(high - low):.3g} m apart. Take out those that are wrong"
        raise FileError(Path(recording.source), f"{said}; a floor has at most {MOST_CELLS} cells of {CELL_M:g} m.")
    cells = np.pad(np.zeros((rows, columns), np.uint8), 2, constant_values=100)
    x, y = (round(float(value) - 2 * CELL_M, 3) for value in low)
    return OccupancyMap(cells=cells, resolution=CELL_M, origin=Pose(x=x, y=y, yaw=0.0))


def rebuild(
    recording: Recording | str | Path,
    world: World,
    requirement: str | Path | Requirement = "R1",
    *,
    runs: int = 5,
    route: str | None = None,
    jobs: int = 1,
    simulator: str | Spec = "embedded",
    stack: StackLike | None = None,
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
    simulated = simulate(
        scenario, runs, jobs=jobs, simulator=simulator, stack=stack, world=world, on_message=on_message
    )
    pairs = [(run, compare(made.recording, run, world)) for run in simulated]
    pairs.sort(key=lambda pair: _distance(pair[1]))
    robot = scenario.mission.robot_record
    return Rebuilt(
        made=made,
        world=world,
        requirement=asked,
        runs=tuple(run for run, _ in pairs),
        fidelities=tuple(fidelity for _, fidelity in pairs),
        judged=judge(simulated, asked, scenario=scenario, world=world),
        estimates=estimates(made.recording, pairs[0][0], robot) if robot is not None else (),
        found=FoundWith(
            simulator=by_content(Spec.of(simulator), simulated[0].options),
            stack_file=stack_file(stack),
            requirement=load_requirement(requirement),
        ),
    )


def _distance(each: Fidelity) -> tuple[int, float]:
    apart = abs(each.gap_m[0] - each.gap_m[1]) if each.gap_m is not None else 0.0
    return len(each.differences), apart


LONGEST_S, BEFORE_S, AFTER_S = 60.0, 8.0, 4.0
"""Of a longer drive each encounter is cut out, with what was before and after it."""
SUFFIXES = (".mcap", ".db3", ".csv", ".parquet")


@dataclass(frozen=True, kw_only=True)
class RecordedCase:
    """An encounter of a recording: its kinds, its smallest gap, and its rebuilt scenario or why there is none."""

    source: str
    kinds: tuple[str, ...]
    gap_m: float
    rebuilt: Rebuilt | None
    problem: str = ""

    @property
    def title(self) -> str:
        """What happens, and where it was recorded."""
        return f"{', '.join(self.kinds) or 'nobody near'}, {self.gap_m:.2f} m: {self.source}"


def recorded_cases(
    folder: Path,
    world: World | None,
    requirement: str = "R1",
    *,
    worlds: Path = Path("worlds"),
    open_floor: bool = False,
    on_case: Callable[[str], None] = ignore,
    **options: Any,
) -> list[RecordedCase]:
    """Rebuild every encounter of the recordings in a folder; rare kinds come first, and of a kind the nearest.

    Args:
        worlds: where the worlds of the recordings are written if none is given; see `world_of_recording`.
        options: those of `rebuild`.
    """
    if not folder.is_dir():
        raise FileError(folder, "this is no folder. Name a folder of recordings; of one: rvsg recording scenario.")
    paths = [path for path in sorted(folder.iterdir()) if path.suffix in SUFFIXES or (path / "metadata.yaml").is_file()]
    if not paths:
        raise FileError(folder, f"there is no recording here ({', '.join(SUFFIXES)}, or a rosbag2 folder).")
    cases: list[RecordedCase] = []
    for path in paths:
        on_case(path.name)
        try:
            whole = load_recording(path, world=world)
            place = world_of_recording(whole, world, worlds / path.stem, open_floor=open_floor)
            parts = [(path.name, whole)] if whole.end_s - whole.begin_s <= LONGEST_S else _encounters(whole, place)
        except RvsgError as error:
            cases.append(RecordedCase(source=path.name, kinds=(), gap_m=math.inf, rebuilt=None, problem=str(error)))
            continue
        for name, part in parts:
            goal = {} if part is whole else {"route": None}  # a part ends before the goal of the route
            try:
                rebuilt = rebuild(part, place, requirement, **options | goal)
            except RvsgError as error:
                cases.append(RecordedCase(source=name, kinds=(), gap_m=math.inf, rebuilt=None, problem=str(error)))
                continue
            met = encounters_of(recorded_as(rebuilt.made.recording, rebuilt.runs[0]), world=place)
            kinds = tuple(dict.fromkeys(meeting.kind.value for meeting in met))
            gap_m = min((meeting.gap_m for meeting in met), default=math.inf)
            cases.append(RecordedCase(source=name, kinds=kinds, gap_m=gap_m, rebuilt=rebuilt))
    often = Counter(kind for case in cases for kind in case.kinds)
    return sorted(cases, key=lambda case: (min((often[kind] for kind in case.kinds), default=math.inf), case.gap_m))


def _encounters(recording: Recording, world: World) -> list[tuple[str, Recording]]:
    """Cut the encounters out of a long recording; those that follow each other closely are one."""
    run, _ = recorded_run(replace(recording, header=None, goal=recording.goal or (0.0, 0.0, 0.0)))
    spans: list[list[float]] = []
    seen = {person.name: (person.begin_s, person.end_s) for person in recording.people}
    for meeting in encounters_of(run, world=world):
        if not seen[meeting.person][0] <= meeting.time_s <= seen[meeting.person][1]:
            continue  # a run has people stand where they are not seen
        begin, end = meeting.time_s - BEFORE_S, meeting.time_s + AFTER_S
        if spans and begin < spans[-1][1] and end - spans[-1][0] <= LONGEST_S:
            spans[-1][1] = end
        else:
            spans.append([begin, end])
    name = Path(recording.source).name
    return [(f"{name} at {begin + BEFORE_S:.0f} s", between(recording, begin, end)) for begin, end in spans]


def suite_of_recordings(cases: Sequence[RecordedCase], suite: str | Path, requirement: str) -> Suite:
    """Keep cases in a suite, each expected to do what most of today's runs do; the given order is that of the files.

    A scenario that the suite holds already keeps its name.
    """
    whole = Suite.create(suite)
    for case in cases:
        if case.rebuilt is not None:
            scenario, names = case.rebuilt.made.scenario, {other.scenario.id: other.name for other in whole.cases}
            bad = case.rebuilt.judged.verdict.violations * 2 > len(case.rebuilt.runs)
            name = f"{len(names) + 1:02}-{(case.kinds or ('nobody-near',))[0].replace(' ', '-')}"
            whole = whole.add(
                scenario, requirement, name=names.get(scenario.id, name), title=case.title[:120],
                expected="violation" if bad else "pass", world=case.rebuilt.world, found=case.rebuilt.found,
            )  # fmt: skip
    return whole
