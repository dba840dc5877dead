"""The run that `rvsg replay` films, or records again as a trace."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rvsg.app.campaign import Campaign
from rvsg.app.saved_scenario import AS_FOUND, Rerun, rerun
from rvsg.core.errors import FileError, InputError, UnknownName
from rvsg.core.files import check_writable, write_whole
from rvsg.core.inputs import parse_json, read_text
from rvsg.core.plugins import find_format, ignore
from rvsg.findings.findings import worst_confirmation
from rvsg.findings.ranking import best_attempt
from rvsg.report.film import Shot, shot_of_run
from rvsg.report.replay_data import FORMAT, VERSION, trace_file_beside, trace_json
from rvsg.report.run_facts import closest_approach
from rvsg.robots.robot import Robot
from rvsg.runs.attempt import Attempt, Measurement
from rvsg.scenario.builder import load_scenario_in
from rvsg.scenario.scenario import Scenario
from rvsg.scenario.world_lookup import load_world, world_of
from rvsg.search.run_set import RunSet, simulate
from rvsg.simulation.archive import holds_runs, read_runs
from rvsg.simulation.embedded.trace import Trace, trace, trace_again
from rvsg.simulation.exporter import Exportable, Exporter
from rvsg.simulation.run import Run
from rvsg.world.world import World

HEAD = ("format", "version", "run")


def shot_of(
    source: Path,
    *,
    run: str | None = None,
    seed: int = 0,
    world: str | None = None,
    given: Mapping[str, Any] = AS_FOUND,
    on_message: Callable[[str], None] = ignore,
) -> Shot:
    """Return what to film.

    Args:
        source: The folder of a campaign, a file of runs, or a scenario.
        run: The id of a run of the campaign or the file; by default the worst run of the worst finding, or the first
            run of the file.
        seed: The seed with which a scenario is simulated.
        world: The world, where it was moved or the file of runs does not name it.
        given: What a scenario runs with, see `rerun`.

    Raises:
        InputError: the source holds no run, or its world is not known.
        UnknownName: there is no run of that id.
    """
    if _is_campaign(source):
        campaign = Campaign.open(source)
        scenario, place, measured, found = _stored(campaign, run, world)
        return shot_of_run(found, measured, campaign.requirement, place, scenario)
    if holds_runs(source):
        if world is None:
            raise InputError(f"{source}: a file of runs does not say in which world they took place. Add --world.")
        return _plain(_run_in(source, run), load_world(world), None)
    again = rerun(source, given, world=world, on_message=on_message)
    runs = simulate(again.scenario, [seed], simulator=again.simulator, world=again.world)
    return _plain(runs[0], again.world, again.scenario.mission.robot_record)


def _is_campaign(source: Path) -> bool:
    return source.is_dir() or source.suffix == ".sqlite"


def _plain(run: Run, world: World, robot: Robot | None) -> Shot:
    end, closest = float(run.trajectory.t[-1]), closest_approach(run)
    times = sorted({round(t, 1) for t in (end / 4, closest, end)})
    return Shot(run=run, world=world, robot=robot, moments=times)


def _stored(campaign: Campaign, run: str | None, world: str | None = None) -> tuple[Scenario, World, Measurement, Run]:
    """Return a run of a campaign with its scenario, the world as that has it, and its measurement.

    By default it is the worst of the worst finding.
    """
    attempts = [attempt for attempt in campaign.attempts() if attempt.measurements]
    known = {m.run_id: (attempt, m) for attempt in attempts for m in attempt.measurements}
    if run is not None and run not in known:
        raise UnknownName("run", run, known)
    attempt, measured = known[run] if run is not None else _worst(campaign, attempts)
    scenario = attempt.proposal.scenario
    assert scenario is not None, "an attempt with runs has a scenario"
    place = world_of(scenario.mission, campaign.world if world is None else world)
    with campaign.reading() as ledger:
        return scenario, place, measured, ledger.run(measured.run_id)


def _worst(campaign: Campaign, attempts: list[Attempt]) -> tuple[Attempt, Measurement]:
    requirement = campaign.requirement
    chosen = worst_confirmation(attempts, requirement) or best_attempt(attempts, requirement)
    if chosen is None or not chosen.measurements:
        raise InputError(f"{campaign.folder}: this campaign holds no run yet.")

    def badness(measurement: Measurement) -> float:
        return float("-inf") if measurement.objective is None else requirement.badness(measurement.objective)

    return chosen, max(chosen.measurements, key=badness)


def _run_in(source: Path, run: str | None) -> Run:
    """Return the run of that id in a file of runs, by default the first."""
    runs = read_runs([source])
    by_id = {run.id: run for run in runs}
    if run is not None and run not in by_id:
        raise UnknownName("run", run, by_id)
    return runs[0] if run is None else by_id[run]


@dataclass(frozen=True, kw_only=True)
class Traced:
    """A trace with the world it took place in."""

    trace: Trace
    world: World

    @property
    def run(self) -> Run:
        """The run."""
        return self.trace.run

    def text(self) -> str:
        """Return the trace as the file that the replay shows."""
        return trace_json(self.trace, self.world)

    def write(self, path: Path) -> None:
        """Write the trace: `.mcap` is a bag with everything, `.json` the file that the replay shows.

        Raises:
            FileError: the name ends otherwise, or the file cannot be written.
            InputError: rosbags is not installed.
        """
        _check_ending(path, ".mcap", ".json")
        if path.suffix == ".mcap":
            _bag_exporter().write(Exportable(world=self.world, runs=(self.run,), trace=self.trace), path)
        else:
            write_whole(path, self.text())


def _check_ending(path: Path, *endings: str) -> None:
    """Refuse a name by which no trace is written, and a bag where rosbags is not installed."""
    if path.suffix not in endings:
        raise FileError(path, f"the name must end in {' or '.join(endings)}.")
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
    _check_ending(path, ".mcap")
    check_writable(path)


def write_bag_of(runs: RunSet, path: Path, again: Rerun) -> None:
    """Write one run as a bag, with all that the robot sees where the simulator can record that."""
    if again.simulator.name == "embedded":
        traced = trace(again.scenario, runs.runs[0].seed, simulator=again.simulator, world=again.world)
        Traced(trace=traced, world=again.world).write(path)
    else:
        _bag_exporter().write(Exportable(world=again.world, runs=runs.runs), path)


def check_trace_files(source: Path, paths: Sequence[Path]) -> None:
    """Refuse files that cannot hold a trace; without any, `source` has to be a campaign, which has a place for it."""
    if not paths and not source.is_dir():
        raise InputError("Name the file to write: --out RUN.mcap or --out RUN.trace.json.", code="trace-no-file")
    for path in paths:
        _check_ending(path, ".mcap", ".json")
        check_writable(path)


def trace_source(
    source: Path,
    *,
    run: str | None = None,
    seed: int = 0,
    scenario: Path | None = None,
    world: str | None = None,
    given: Mapping[str, Any] = AS_FOUND,
    on_message: Callable[[str], None] = ignore,
) -> Traced:
    """Trace a run of a campaign, of a file of runs, or of a scenario.

    Args:
        source, run, seed, world, given: as for `shot_of`.
        scenario: the scenario of a file of runs.

    Raises:
        InputError: the source holds no run, or the run cannot be repeated.
        UnknownName: there is no run of that id.
    """
    if _is_campaign(source):
        campaign = Campaign.open(source)
        asked, place, _, stored = _stored(campaign, run, world)
        return Traced(trace=trace_again(stored, asked, place, on_message=on_message), world=place)
    if holds_runs(source):
        if scenario is None:
            raise InputError(f"{source}: a file of runs does not hold their scenario. Add --scenario.")
        asked, place = load_scenario_in(scenario, world)
        return Traced(trace=trace_again(_run_in(source, run), asked, place, on_message=on_message), world=place)
    if run is not None:
        raise InputError(f"{source}: --run names a run of a campaign or of a file of runs. Give --seed for a scenario.")
    again = rerun(source, given, world=world, on_message=on_message)
    traced = trace(again.scenario, seed, simulator=again.simulator, world=again.world, on_message=on_message)
    return Traced(trace=traced, world=again.world)


def kept_trace(campaign: Campaign, run: str) -> str:
    """Return the trace of a run as its file for the replay; made and kept beside the report where there is none yet.

    Raises:
        InputError: the run cannot be repeated.
        UnknownName: the campaign has no run of that id.
    """
    scenario, world, _, stored = _stored(campaign, run)
    path = trace_file_beside(campaign.folder, stored.id)
    if path.is_file():
        text = read_text(path)
        value = parse_json(text, path)
        if isinstance(value, dict) and [value.get(key) for key in HEAD] == [FORMAT, VERSION, run]:
            return text
    text = Traced(trace=trace_again(stored, scenario, world), world=world).text()
    path.parent.mkdir(exist_ok=True)
    write_whole(path, text)
    return text
