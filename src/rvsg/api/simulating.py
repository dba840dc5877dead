"""Simulate a scenario, and the set of runs that comes of it."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, overload

from rvsg.api import records
from rvsg.api.scenarios import check_robot, check_valid, tell_of_robot
from rvsg.api.worlds import world_of
from rvsg.campaign.attempt import Failure
from rvsg.campaign.parallel import Simulations
from rvsg.core import plugins
from rvsg.core.errors import InputError, SimulationError
from rvsg.core.files import write_whole
from rvsg.core.plugins import Spec
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.protocol import Simulator
from rvsg.simulation.run import Outcome, Run
from rvsg.simulation.stacks.registry import StackLike
from rvsg.world.world import World

if TYPE_CHECKING:
    from pandas import DataFrame

    from rvsg.api.pictures import Picture

COLUMNS = ("run_id", "seed", "outcome", "duration_s")
"""The columns of `RunSet.to_dataframe` before those of the metrics."""


def ignore(_: object) -> None:
    """Do nothing with a message or an event."""


def make_simulator(given: str | Spec | Simulator, stack: StackLike | None = None) -> Simulator:
    """Return a simulator given by name, by Spec or by itself.

    Args:
        stack: the navigation stack under test, for a simulator that is given by name or Spec.
    """
    if isinstance(given, str | Spec):
        spec = with_stack(given, stack)
        simulator: Simulator = plugins.make("simulator", spec.name, spec.options)
    elif stack is not None:
        raise InputError(f"The simulator {given.name} is given as an instance. Give it the stack when you make it.")
    else:
        simulator = given
    plugins.check_complete("simulator", simulator, Simulator)
    return simulator


def with_stack(given: str | Spec, stack: StackLike | None) -> Spec:
    """Return a simulator's Spec with the stack under test among its options: as data, or as the object it is."""
    spec = Spec.of(given)
    if stack is None:
        return spec
    if isinstance(stack, Spec):
        stack = stack.model_dump(mode="json")
    return Spec(spec.name, {**spec.options, "stack": str(stack) if isinstance(stack, Path) else stack})


@contextmanager
def simulator_of(
    given: str | Spec | Simulator,
    stack: StackLike | None = None,
    *,
    scenario: Scenario | None = None,
    on_message: Callable[[str], None] = ignore,
) -> Iterator[Simulator]:
    """Make a simulator and prepare it; on leaving, close it unless it was given as an instance.

    Args:
        scenario: refuse its robot before the simulator is prepared, where the simulator does not know it.
    """
    made = make_simulator(given, stack)
    with nullcontext(made) if made is given else closing(made):
        if scenario is not None:
            check_robot(scenario, made)
        made.prepare(on_message)
        if scenario is not None:
            tell_of_robot(scenario.mission, made, on_message)
        yield made


def described(spec: Spec) -> str:
    """Return a simulator in words: its name, the stack under test, and whether its runs can be repeated."""
    stack = spec.options.get("stack")
    name = str(stack.get("name", "")) if isinstance(stack, Mapping) else ""
    known = plugins.find("stack", name) if name in plugins.names("stack") else None
    repeatable = spec.options.get("repeatable", True) and getattr(known, "repeatable", True)
    words = f"{spec.name}, stack {name}" if name else spec.name
    return words if repeatable else f"{words} (not repeatable bit for bit: a seed is the number of a run)"


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
            from rvsg.evaluation.metrics.registry import measure

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
                "run_id": run.id,
                "seed": run.seed,
                "outcome": run.outcome.value,
                "duration_s": float(run.trajectory.t[-1]),
            }
            | dict(values)
            for run, values in zip(self.runs, self.measurements, strict=True)
        ]
        return pd.DataFrame(rows, columns=[*COLUMNS, *(self.measurements[0] if rows else ())])

    def picture(self) -> Picture:
        """Return the floor plan with the ways of robot and people in all runs; a notebook shows it."""
        from rvsg.api.pictures import picture_of

        return picture_of(self)

    def save(self, path: str | Path) -> None:
        """Write the runs to a file, one JSON object per line; `load_runs` reads it."""
        write_whole(Path(path), records.runs_text(self.runs))

    def _repr_html_(self) -> str:
        shown = "" if self.world is None else self.picture()._repr_svg_()
        counted: dict[str, int] = {}
        for run in self.runs:
            counted[run.outcome.value] = counted.get(run.outcome.value, 0) + 1
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
        simulator, stack: what simulates, and the navigation stack under test, by default the simulator's own: a name
            (`rvsg stacks`), a Spec or an instance; a stack also as `module:Class` or a class. What is given as an
            instance stays open: close it yourself.
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
        Simulations(made, place, jobs=jobs, notify=on_message) as simulations,
    ):
        for pending in [simulations.submit(scenario, seed) for seed in wanted]:
            result = pending.result()
            if isinstance(result, Failure):
                raise SimulationError(f"seed {result.seed}: {result.reason}")
            runs.append(result.unpack())
            on_run(runs[-1])
    return RunSet(tuple(runs), scenario, place)


def load_runs(*paths: str | Path, scenario: Scenario | None = None) -> RunSet:
    """Load the runs of one or more files, as `RunSet.save` and `rvsg simulate` write them; duplicates count once.

    Raises:
        FileError: a file holds something else; names the line.
        InputError: the runs are not of `scenario`.
    """
    runs = tuple(records.once(records.read_runs(Path(path) for path in paths)))
    if scenario is None:
        return RunSet(runs)
    check_of(scenario, runs)
    return RunSet(runs, scenario, world_of(scenario.mission))


def once(runs: Iterable[Run]) -> list[Run]:
    """Return the runs without duplicates."""
    return records.once(runs)


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
