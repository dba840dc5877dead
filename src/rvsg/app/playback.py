"""The run that `rvsg replay` films, or records again as a trace."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rvsg.app.campaign import Campaign
from rvsg.app.runs import RunSet, simulate
from rvsg.campaign.attempt import Attempt, Measurement
from rvsg.campaign.ranking import best_attempt
from rvsg.core.errors import FileError, InputError, UnknownName
from rvsg.core.files import write_whole
from rvsg.core.inputs import parse_json, read_text
from rvsg.core.outputs import check_writable
from rvsg.core.plugins import Spec, find_format, ignore
from rvsg.report.film import Shot, shot_of_run
from rvsg.report.replay_data import FORMAT, VERSION, trace_file_beside, trace_json
from rvsg.report.run_facts import closest_approach
from rvsg.robots.robot import Robot
from rvsg.scenario.builder import check_valid, load_scenario_in
from rvsg.scenario.scenario import Scenario
from rvsg.scenario.world_lookup import load_world, world_of
from rvsg.simulation.archive import PackedRun, holds_runs, read_runs, rounded
from rvsg.simulation.embedded.simulator import EmbeddedSimulator
from rvsg.simulation.embedded.trace import Trace, trace_run
from rvsg.simulation.exporter import Exportable, Exporter
from rvsg.simulation.run import Run
from rvsg.simulation.simulators import make_simulator
from rvsg.simulation.stacks.registry import StackLike
from rvsg.world.world import World

if TYPE_CHECKING:
    from rvsg.app.campaign import Campaign


def shot_of(
    source: Path,
    *,
    run: str | None = None,
    seed: int = 0,
    world: str | None = None,
    simulator: str | Spec = "embedded",
) -> Shot:
    """Return what to film.

    Args:
        source: The folder of a campaign, a file of runs, or a scenario.
        run: The id of a run of the campaign or the file; by default the worst run of the worst finding, or the first
            run of the file.
        seed: The seed with which a scenario is simulated.
        world: The world, where it was moved or the file of runs does not name it.

    Raises:
        InputError: the source holds no run, or its world is not known.
        UnknownName: there is no run of that id.
    """
    if source.is_dir() or source.suffix == ".sqlite":
        return _of_campaign(Campaign.open(source), run, world)
    if holds_runs(source):
        if world is None:
            raise InputError(f"{source}: a file of runs does not say in which world they took place. Add --world.")
        chosen = chosen_run(read_runs([source]), run)
        return _plain(chosen, load_world(world), None)
    scenario, place = load_scenario_in(source, world)
    made = simulate(scenario, [seed], simulator=simulator, world=place)
    return _plain(made[0], place, scenario.mission.robot_record)


def _of_campaign(campaign: Campaign, run: str | None, world: str | None) -> Shot:
    attempts = [attempt for attempt in campaign.attempts() if attempt.measurements]
    known = {m.run_id: (attempt, m) for attempt in attempts for m in attempt.measurements}
    if run is not None and run not in known:
        raise UnknownName("run", run, known)
    attempt, measured = known[run] if run is not None else worst_run(campaign, attempts)
    place = campaign.world if world is None else load_world(world)
    found = next(each for each in campaign.runs() if each.id == measured.run_id)
    scenario = attempt.proposal.scenario
    assert scenario is not None  # it has a run
    return shot_of_run(found, measured, campaign.requirement, place, scenario)


def worst_run(campaign: Campaign, attempts: list[Attempt]) -> tuple[Attempt, Measurement]:
    """Return the worst run of the worst finding of a campaign, and its attempt; InputError if there is none."""
    chosen = campaign.summary().confirmed or best_attempt(attempts, campaign.requirement)
    if chosen is None or not chosen.measurements:
        raise InputError(f"{campaign.folder}: this campaign holds no run yet.")
    requirement = campaign.requirement

    def badness(measurement: Measurement) -> float:
        value = measurement.objective
        return requirement.badness(value) if value is not None else float("-inf")

    return chosen, max(chosen.measurements, key=badness)


def chosen_run(runs: list[Run], run: str | None) -> Run:
    """Return the run of an id, or the first; UnknownName if there is none of that id."""
    known = {each.id: each for each in runs}
    if run is None:
        return runs[0]
    if run not in known:
        raise UnknownName("run", run, known)
    return known[run]


def _plain(run: Run, world: World, robot: Robot | None) -> Shot:
    end, closest = float(run.trajectory.t[-1]), closest_approach(run)
    times = sorted({round(t, 1) for t in (end / 4, closest, end)})
    return Shot(run=run, world=world, robot=robot, moments=times)


HEAD = ("format", "version", "run")
OF_RECORD = ("version", "default_robot")
"""Options of a stored run that the simulator adds by itself."""


@dataclass(frozen=True, kw_only=True)
class Traced:
    """A trace with the world it took place in."""

    trace: Trace
    world: World

    @property
    def run(self) -> Run:
        """The run."""
        return self.trace.run

    def write(self, path: Path) -> None:
        """Write the trace: `.mcap` is a bag with everything, `.json` the file that the replay shows.

        Raises:
            FileError: the name ends otherwise, or the file cannot be written.
            InputError: rosbags is not installed.
        """
        check_trace_file(path)
        if path.suffix == ".mcap":
            _bag_exporter().write(Exportable(world=self.world, runs=(self.run,), trace=self.trace), path)
        else:
            write_whole(path, trace_text(self))


def trace_text(traced: Traced) -> str:
    """Return a trace as the file that the replay shows."""
    return trace_json(traced.trace, traced.world)


def check_trace_file(path: Path, *, bag_only: bool = False) -> None:
    """Refuse a name by which no trace is written, and a bag where rosbags is not installed."""
    kinds = (".mcap",) if bag_only else (".mcap", ".json")
    if path.suffix not in kinds:
        raise FileError(path, f"the name must end in {' or '.join(kinds)}.")
    if path.suffix == ".mcap":
        _bag_exporter().check()


def _bag_exporter() -> Exporter:
    exporter: Exporter = find_format("exporter", "mcap", "bag")()
    return exporter


def check_bag(path: Path | None, runs: int) -> None:
    """Check before a simulation that its bag can be written; None: there is none.

    Raises:
        InputError: several runs are asked for, the file has another ending, or rosbags is not installed.
    """
    if path is None:
        return
    if runs > 1:
        raise InputError("--bag writes one run, and --repeats asks for several. Leave one of them out.")
    check_trace_file(path, bag_only=True)
    check_writable(path)


def write_bag_of(
    runs: RunSet, path: Path, scenario: Scenario, *, simulator: Spec, stack: StackLike | None, world: World
) -> None:
    """Write one run as a bag, with all that the robot sees where the simulator can record that."""
    if simulator.name == "embedded":
        traced = trace(scenario, runs.runs[0].seed, simulator=simulator, stack=stack, world=world)
        Traced(trace=traced, world=world).write(path)
    else:
        _bag_exporter().write(Exportable(world=world, runs=runs.runs), path)


def check_trace_files(source: Path, paths: Sequence[Path]) -> None:
    """Refuse files that cannot hold a trace; without any, `source` has to be a campaign, which has a place for it."""
    if not paths and not source.is_dir():
        raise InputError("Name the file to write: --out RUN.mcap or --out RUN.trace.json.", code="trace-no-file")
    for path in paths:
        check_trace_file(path)
        check_writable(path)


def trace(
    scenario: Scenario,
    seed: int = 0,
    *,
    simulator: str | Spec = "embedded",
    stack: StackLike | None = None,
    world: World | str | Path | None = None,
    on_message: Callable[[str], None] = ignore,
) -> Trace:
    """Simulate a scenario with everything recorded: scans, costmaps, plans, trajectories tried, behaviour tree.

    A stack that is given as an instance stays open.

    Raises:
        InputError: the simulator records no traces, or the scenario cannot be simulated.
    """
    place = world_of(scenario.mission, world)
    check_valid(scenario, place)
    made = make_simulator(simulator, stack)
    if not isinstance(made, EmbeddedSimulator):
        raise InputError(f'The simulator "{made.name}" records no traces; "embedded" does.')
    with closing(made):
        made.prepare(on_message)
        return _as_stored(trace_run(scenario, place, seed=seed, simulator=made))


def _as_stored(found: Trace) -> Trace:
    """Return a trace whose run is rounded as runs are before they are measured, so that its bag measures the same."""
    return replace(found, run=rounded(found.run))


def trace_again(run: Run, scenario: Scenario, world: World, *, on_message: Callable[[str], None] = ignore) -> Traced:
    """Simulate a stored run again with everything recorded, and check that it is the same run.

    Raises:
        InputError: the run is of another scenario or simulator, or this version simulates it otherwise.
    """
    if run.scenario_id != scenario.id:
        raise InputError(f"The run {run.id} is of another scenario ({run.scenario_id}, not {scenario.id}).")
    if run.simulator != "embedded":
        raise InputError(f'The run {run.id} is of the simulator "{run.simulator}", which records no traces.')
    told = run.details.get("stack")
    if isinstance(told, Mapping) and not told.get("repeatable", True):
        raise InputError(
            f"The run {run.id} is of a real system, which gives another run every time. It cannot be traced. "
            "`--stack` with the scenario records a new one.",
            code="run-not-repeatable",
        )
    options = {name: value for name, value in run.options.items() if name not in OF_RECORD}
    made = EmbeddedSimulator(**options)  # type: ignore[arg-type]  # checked by it
    with closing(made):
        made.prepare(on_message)
        found = trace_run(scenario, world, seed=run.seed, simulator=made)
    if found.run.id != run.id or PackedRun.of(rounded(found.run)).data != PackedRun.of(rounded(run)).data:
        made_by = run.options.get("version")
        raise InputError(
            f"The run {run.id} cannot be repeated: it was simulated by rules of version {made_by}, and these are of "
            f"version {made.options['version']}. Run the campaign again, or trace it with the RVSG that made it."
        )
    return Traced(trace=_as_stored(found), world=world)


def trace_source(
    source: Path,
    *,
    run: str | None = None,
    seed: int = 0,
    scenario: Path | None = None,
    world: str | None = None,
    simulator: str | Spec = "embedded",
    stack: StackLike | None = None,
    on_message: Callable[[str], None] = ignore,
) -> Traced:
    """Trace a run of a campaign, of a file of runs, or of a scenario.

    Args:
        source: the folder of a campaign, a file of runs, or a scenario.
        run: the id of a run of the campaign or the file; by default the worst run of the worst finding, or the first
            run of the file.
        seed: the seed with which a scenario is simulated.
        scenario: the scenario of a file of runs.
        world: the world, where it was moved.

    Raises:
        InputError: the source holds no run, or the run cannot be repeated.
        UnknownName: there is no run of that id.
    """

    if source.is_dir() or source.suffix == ".sqlite":
        return _trace_of_campaign(source, run, world, on_message)
    if holds_runs(source):
        if scenario is None:
            raise InputError(f"{source}: a file of runs does not hold their scenario. Add --scenario.")
        found, place = load_scenario_in(scenario, world)
        return trace_again(chosen_run(read_runs([source]), run), found, place, on_message=on_message)
    if run is not None:
        raise InputError(f"{source}: --run names a run of a campaign or of a file of runs. Give --seed for a scenario.")
    asked, place = load_scenario_in(source, world)
    made = trace(asked, seed, simulator=simulator, stack=stack, world=place, on_message=on_message)
    return Traced(trace=made, world=place)


def _trace_of_campaign(source: Path, run: str | None, world: str | None, on_message: Callable[[str], None]) -> Traced:
    from rvsg.app.campaign import Campaign

    campaign = Campaign.open(source)
    if run is None:
        run = worst_run(campaign, [attempt for attempt in campaign.attempts() if attempt.measurements])[1].run_id
    return trace_in_campaign(campaign, run, load_world(world) if world is not None else None, on_message=on_message)


def trace_in_campaign(
    campaign: Campaign, run: str, world: World | None = None, *, on_message: Callable[[str], None] = ignore
) -> Traced:
    """Trace a run of a campaign.

    Args:
        world: the world, where it was moved.

    Raises:
        InputError: the run cannot be repeated.
        UnknownName: the campaign has no run of that id.
    """
    known = {m.run_id: attempt for attempt in campaign.attempts() for m in attempt.measurements}
    if run not in known:
        raise UnknownName("run", run, known)
    scenario = known[run].proposal.scenario
    assert scenario is not None, "an attempt with runs has a scenario"
    with campaign.reading() as ledger:
        stored = ledger.run(run)
    return trace_again(stored, scenario, world or campaign.world, on_message=on_message)


def kept_trace(campaign: Campaign, run: str, *, on_message: Callable[[str], None] = ignore) -> str:
    """Return the trace of a run as its file for the replay; made and kept beside the report where there is none yet.

    Raises:
        InputError: the run cannot be repeated.
        UnknownName: the campaign has no run of that id.
    """
    known = {m.run_id for attempt in campaign.attempts() for m in attempt.measurements}
    if run not in known:
        raise UnknownName("run", run, known)
    path = trace_file_beside(campaign.folder, run)
    if path.is_file():
        text = read_text(path)
        value = parse_json(text, path)
        if isinstance(value, dict) and [value.get(key) for key in HEAD] == [FORMAT, VERSION, run]:
            return text
    traced = trace_in_campaign(campaign, run, on_message=on_message)
    path.parent.mkdir(exist_ok=True)
    write_whole(path, text := trace_text(traced))
    return text
