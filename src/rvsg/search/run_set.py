"""Runs of a scenario: simulate, save, load, draw and judge them."""

from __future__ import annotations

import html
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from rvsg.core.errors import InputError
from rvsg.core.files import write_whole
from rvsg.core.plugins import Spec, ignore
from rvsg.evaluation.verdict import (
    DEFAULT,
    Procedure,
    Status,
    Verdict,
    load_requirement,
    next_repeats,
    status_in_words,
    value_in_words,
    violated,
)
from rvsg.findings.feedback import feedback_of
from rvsg.recording.recorded_run import recorded_run
from rvsg.recording.tracks import load_recording
from rvsg.runs.attempt import Attempt, Measurement
from rvsg.runs.runner import Evaluator, Runner
from rvsg.scenario.brief import Feedback
from rvsg.scenario.builder import check_valid
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.scenario.world_lookup import as_world, world_of
from rvsg.simulation.archive import once, read_runs, runs_text
from rvsg.simulation.run import Outcome, Run
from rvsg.simulation.simulators import Simulator, simulator_of
from rvsg.simulation.stacks.stack_choice import StackLike
from rvsg.world.drawing.svg import floor_plan
from rvsg.world.world import World

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from pandas import DataFrame


COLUMNS = ("run_id", "seed", "outcome", "duration_s")
"""The columns of `RunSet.to_dataframe` before those of the metrics."""


@dataclass(frozen=True, eq=False)
class RunSet:
    """Runs of one scenario, with the scenario and the world they took place in, where these are known."""

    runs: tuple[Run, ...]
    scenario: Scenario | None = None
    world: World | None = None
    _values: dict[str, list[Mapping[str, float | None]]] = field(default_factory=dict, repr=False)

    def __iter__(self) -> Iterator[Run]:
        return iter(self.runs)

    def __len__(self) -> int:
        return len(self.runs)

    @overload
    def __getitem__(self, index: int) -> Run: ...
    @overload
    def __getitem__(self, index: slice) -> RunSet: ...
    def __getitem__(self, index: int | slice) -> Run | RunSet:
        if isinstance(index, slice):
            return RunSet(self.runs[index], self.scenario, self.world)
        return self.runs[index]

    def __repr__(self) -> str:
        reached = sum(run.outcome is Outcome.REACHED for run in self.runs)
        return f"RunSet({len(self.runs)} runs, {reached} reached the goal)"

    @property
    def measurements(self) -> Sequence[Mapping[str, float | None]]:
        """Every metric of every run; None if a metric has no value for a run."""
        if "all" not in self._values:
            from rvsg.evaluation.metrics import measure

            self._values["all"] = [measure(run, world=self.world) for run in self.runs]
        return self._values["all"]

    def to_dataframe(self) -> DataFrame:
        """Return a pandas DataFrame with a row for each run: seed, outcome, duration and every metric.

        Raises:
            InputError: pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError:
            raise InputError("to_dataframe() needs pandas: .venv/bin/pip install pandas") from None
        rows = [
            {
                **dict(zip(COLUMNS, (run.id, run.seed, run.outcome.value, float(run.trajectory.t[-1])), strict=True)),
                **values,
            }
            for run, values in zip(self.runs, self.measurements, strict=True)
        ]
        return pd.DataFrame(rows, columns=[*COLUMNS, *(self.measurements[0] if rows else ())])

    def picture(self) -> Picture:
        """Return the floor plan with the ways of robot and people in all runs; a notebook shows it."""
        return picture_of(self)

    def save(self, path: str | Path) -> None:
        """Write the runs to a file, one JSON object per line; `load_runs` reads it."""
        write_whole(Path(path), runs_text(self.runs))

    def _repr_html_(self) -> str:
        shown = "" if self.world is None else self.picture()._repr_svg_()
        counted = Counter(run.outcome.value for run in self.runs)
        listed = "; ".join(f"{html.escape(words)}: {count}" for words, count in counted.items())
        return f"<div><p><b>{len(self.runs)} runs.</b> {listed}.</p>{shown}</div>"


def simulate(
    scenario: Scenario,
    seeds: int | Iterable[int] = 20,
    *,
    jobs: int = 1,
    simulator: str | Spec | Simulator = "embedded",
    stack: StackLike | None = None,
    world: World | str | Path | None = None,
    on_run: Callable[[Run], None] = ignore,
    on_message: Callable[[str], None] = ignore,
) -> RunSet:
    """Simulate a scenario, once for each seed.

    The same scenario, simulator and seed give the same run, bit for bit, on any number of workers.

    Args:
        seeds: the seeds, or how many: then they are 0, 1, ...
        jobs: worker processes.
        simulator: a name, a Spec or an instance. An instance stays open: close it yourself.
        stack: the navigation stack under test, by default the simulator's own, in the same ways (`rvsg stacks` lists
            the names); also as `module:Class` or a class.
        world: the world of the scenario, or its folder, where it cannot be found by itself.
        on_run: called with every run, in the order of the seeds.
        on_message: called with what a person should know, e.g. that the simulator is being compiled.

    Raises:
        InvalidScenario: the scenario breaks a rule; nothing is simulated.
        InputError: the world is not the scenario's, or the simulator does not know the robot.
        SimulationError: a run could not be made.
    """
    place = world_of(scenario.mission, world)
    check_valid(scenario, place)
    wanted = range(seeds) if isinstance(seeds, int) else tuple(seeds)
    runs = []
    with (
        simulator_of(simulator, stack, scenario=scenario, on_message=on_message) as made,
        Runner(made, place, jobs=jobs, notify=on_message) as runner,
    ):
        for finished in runner.run(scenario, wanted):
            runs.append(finished.unpack())
            on_run(runs[-1])
    return RunSet(tuple(runs), scenario, place)


def load_runs(*paths: str | Path, scenario: Scenario | None = None) -> RunSet:
    """Load the runs of one or more files, as `RunSet.save` and `rvsg simulate` write them; duplicates count once.

    Raises:
        FileError: a file holds something else; names the line.
        InputError: the runs are not of `scenario`.
    """
    runs = tuple(once(read_runs(Path(path) for path in paths)))
    if scenario is None:
        return RunSet(runs)
    check_of(scenario, runs)
    return RunSet(runs, scenario, world_of(scenario.mission))


def check_of(scenario: Scenario, runs: Iterable[Run]) -> None:
    """Refuse runs of another scenario."""
    for run in runs:
        if run.scenario_id != scenario.id:
            raise InputError(f"the runs are of another scenario ({run.scenario_id}, not {scenario.id}).")


def one_of(runs: RunSet | Run | Iterable[Run]) -> RunSet:
    """Return one or more runs as a RunSet."""
    if isinstance(runs, RunSet):
        return runs
    return RunSet((runs,) if isinstance(runs, Run) else tuple(runs))


ROBOT = "#1f4e9e"
PEOPLE = ("#d9630a", "#0b8f7a", "#a23bb8", "#8a6d00", "#c2255c", "#3f7d20", "#5b5fc7", "#9c4a2f")
STEP = 4
"""Every n-th sample becomes a point of a line."""


@dataclass(frozen=True)
class Picture:
    """A picture as SVG; a notebook shows it."""

    svg: str

    def save(self, path: str | Path) -> None:
        """Write the picture to an SVG file."""
        write_whole(Path(path), self.svg)

    def _repr_svg_(self) -> str:
        return self.svg


def picture_of(runs: RunSet) -> Picture:
    """Return the floor plan with the ways of the robot (blue) and every person in all runs.

    Raises:
        InputError: the world of the runs is not known.
    """
    if runs.world is None:
        raise InputError("The world of these runs is not known: load them with load_runs(path, scenario=...).")
    plan = floor_plan(runs.world, areas=True)
    lines = []
    names = runs[0].human_names if runs.runs else ()
    opacity = max(0.15, 1.0 / max(1, len(runs)))
    for run in runs:
        path = run.trajectory
        for h, name in enumerate(run.human_names):
            colour = PEOPLE[h % len(PEOPLE)]
            lines.append(_line(path.human_x[:, h], path.human_y[:, h], colour, opacity, name))
        lines.append(_line(path.x, path.y, ROBOT, opacity, "robot"))
    for run in runs.runs[:1]:
        (x, y), (goal_x, goal_y) = (run.trajectory.x[0], run.trajectory.y[0]), run.goal[:2]
        lines.append(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="0.25" fill="{ROBOT}"><title>start</title></circle>')
        ring = f'cx="{goal_x:.2f}" cy="{goal_y:.2f}" r="0.3" fill="none" stroke="{ROBOT}" stroke-width="0.12"'
        lines.append(f"<circle {ring}><title>goal</title></circle>")
    key = "; ".join(f"{html.escape(name)} {PEOPLE[h % len(PEOPLE)]}" for h, name in enumerate(names))
    _, _, wide, high = map(float, plan.view_box.split())
    size = f'width="640" height="{640 * high / wide:.0f}"'
    return Picture(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{plan.view_box}" {size} role="img">'
        f"<title>Ways of the robot {ROBOT}; {key}</title><style>{_STYLE}</style>{plan.shapes}{plan.names}"
        f'<g transform="{plan.matrix}">{"".join(lines)}</g></svg>'
    )


_STYLE = (
    ".floor{fill:#f7f6f2}.wall{fill:#454545}.thing{fill:#c9c4b8}.area{fill:#e6eef5}"
    ".area-name{fill:#444;font-family:sans-serif}.waypoint{fill:none}"
)


def _line(x: NDArray[np.float64], y: NDArray[np.float64], colour: str, opacity: float, name: str) -> str:
    points = " ".join(f"{a:.2f},{b:.2f}" for a, b in zip(x[::STEP], y[::STEP], strict=True))
    return (
        f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="0.08" opacity="{opacity:.2f}">'
        f"<title>{html.escape(name)}</title></polyline>"
    )


RECORDINGS = (".mcap", ".db3")


def load_recordings(
    paths: Sequence[str | Path],
    *,
    world: World | str | Path | None = None,
    route: str | None = None,
    people_topic: str | None = None,
    robot_topic: str | None = None,
) -> tuple[RunSet, tuple[str, ...]]:
    """Load recordings of a robot as runs; return them and what they lack.

    Args:
        paths: rosbag2 folders, or `.mcap` or `.db3` files.
        route: the route of the world that the robot drove.
    """
    place = as_world(world) if world is not None else None
    if route is not None and place is None:
        raise InputError("--route needs the world it is in: add --world (in Python world=).")
    driven = place.route(route) if route is not None and place is not None else None
    runs, notes = [], []
    for path in paths:
        found = load_recording(path, world=place, people_topic=people_topic, robot_topic=robot_topic)
        run, said = recorded_run(found, driven)
        runs.append(run)
        notes += [f"{path}: {note}" for note in said]
    return RunSet(tuple(runs), None, place), tuple(notes)


def load_any(
    paths: Sequence[str | Path],
    *,
    world: World | str | Path | None = None,
    route: str | None = None,
    people_topic: str | None = None,
    robot_topic: str | None = None,
) -> tuple[RunSet, tuple[str, ...]]:
    """Load files of runs, or recordings; return them and what a person should know of them. Duplicates count once.

    Raises:
        InputError: files of both kinds are given, or options of recordings for files of runs.
    """
    recordings = [path for path in paths if is_recording(path)]
    if not recordings:
        if route or people_topic or robot_topic:
            raise InputError(
                "--route, --people-topic and --robot-topic are for recordings (.mcap, .db3, a rosbag2 folder)."
            )
        runs = read_runs([Path(path) for path in paths])
        different = once(runs)
        twice = len(runs) - len(different)
        said = f"{twice} of {len(runs)} runs are given twice and count once."
        return RunSet(tuple(different)), (said,) if twice else ()
    if len(recordings) < len(paths):
        raise InputError("Judge recordings and simulated runs one after the other: they are of different scenarios.")
    return load_recordings(paths, world=world, route=route, people_topic=people_topic, robot_topic=robot_topic)


def is_recording(path: str | Path) -> bool:
    """Return whether a path is a recording: a rosbag2 folder, an MCAP or an SQLite file."""
    path = Path(path)
    return path.suffix in RECORDINGS or (path / "metadata.yaml").is_file()


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
        return violated(self.verdict)

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
    of_one = one_of(runs)
    if not of_one.runs:
        raise InputError("There is no run to judge.")
    if len({run.scenario_id for run in of_one}) > 1:
        raise InputError("The runs are of different scenarios; a verdict is on one. Judge them one by one.")
    known = scenario or of_one.scenario
    if known is not None:
        check_of(known, of_one)
    place = of_one.world
    if world is not None or (place is None and known is not None):
        place = world_of(known.mission, world) if known is not None else as_world(world or "")
    asked = load_requirement(requirement, time_limit_s=of_one[0].time_limit_s)
    measuring = Evaluator(asked, place, procedure=procedure, time_limit_s=of_one[0].time_limit_s)
    measurements = tuple(measuring.measure(run) for run in of_one)
    return Judgement(
        requirement=asked, verdict=measuring.judge(measurements), measurements=measurements, procedure=procedure
    )


def feedback(judged: Judgement, runs: RunSet | Iterable[Run], scenario: Scenario) -> Feedback:
    """Return what a generator learns from judged runs of a scenario; `propose` takes it.

    Raises:
        InputError: no run has a value of the requirement's metric.
    """
    of_one = one_of(runs)
    check_of(scenario, of_one)
    if judged.verdict.mean is None:
        raise InputError("None of the runs has a value of the requirement's metric, so there is nothing to learn from.")
    attempt = Attempt.by_hand(
        scenario.mission,
        judged.requirement,
        scenario,
        people=len(scenario.people.humans),
        measurements=judged.measurements,
        verdict=judged.verdict,
    )
    return feedback_of(attempt, of_one.runs, requirement=judged.requirement, world=world_of(scenario.mission))
