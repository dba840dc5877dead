"""Scenarios and runs as files of other tools, and recordings and agents files as runs and scenarios."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rvsg.app.playback import check_trace_file
from rvsg.app.playback import trace as traced_run
from rvsg.app.runs import RunSet, simulate
from rvsg.core.errors import InputError, UnknownName
from rvsg.core.files import write_whole
from rvsg.core.outputs import check_writable
from rvsg.core.plugins import Spec, ignore
from rvsg.scenario.builder import load_scenario_in, read_scenario
from rvsg.scenario.builder import scenario as scenario_of
from rvsg.scenario.scenario import Human, HumanAgent, Pause, Scenario, Task, decode
from rvsg.scenario.world_lookup import as_world, world_of
from rvsg.simulation.run import Run
from rvsg.simulation.run_files import once, read_runs
from rvsg.simulation.stacks.registry import StackLike
from rvsg.world.world import World
from rvsg_exchange import bag, exporters, hunav_agents
from rvsg_exchange.recordings import read_recording

OF_RUNS = ("csv", "parquet", "mcap")
OF_SCENARIOS = ("hunav", "nav2-goals", "initial-pose", "osc", "sdf")
FORMATS = (*OF_RUNS, *OF_SCENARIOS, "foxglove-layout")
RECORDINGS = (".mcap", ".db3")
LONGEST_PAUSE_S = 600.0


@dataclass(frozen=True, kw_only=True)
class Source:
    """What is exported: a scenario with its world, and the runs of it where any are given or made."""

    scenario: Scenario | None
    world: World | None
    runs: tuple[Run, ...]


def export(
    source: str | Path | Scenario | RunSet | None,
    out: str | Path,
    format: str,
    *,
    seed: int = 0,
    simulator: str | Spec = "embedded",
    stack: StackLike | None = None,
    world: World | str | Path | None = None,
    dialect: str = "block",
    release: str = "jazzy",
    trace: bool = False,
    on_message: Callable[[str], None] = ignore,
) -> tuple[str, ...]:
    """Write a scenario or its runs in the format of another tool; return what the file cannot hold.

    Args:
        source: a scenario, runs, or a file of either. A format of runs simulates a scenario first.
        out: the file.
        format: one of `FORMATS`.
        seed: of the run that is simulated.
        stack: the navigation stack under test of that run.
        dialect: of `hunav`: flat, block, v2.
        release: of `nav2-goals`: humble, jazzy, kilted.
        trace: for `mcap`: simulate the run again and record scans, costmaps and plans, too.

    Raises:
        UnknownName: the format, dialect or release does not exist.
        InputError: the source does not fit the format, or a library is missing.
    """
    for kind, name, known in (
        ("format", format, FORMATS),
        ("dialect", dialect, ("flat", "block", "v2")),
        ("release", release, exporters.RELEASES),
    ):
        if name not in known:
            raise UnknownName(kind, name, known)
    path = Path(out)
    if format == "foxglove-layout":
        write_whole(path, exporters.foxglove_layout())
        return ()
    given = _source(source, world)
    if format in OF_RUNS:
        return _write_runs(given, path, format, seed, simulator, stack, trace, on_message)
    return _write_scenario(given, path, format, dialect, release)


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
        seed = runs.runs[0].seed
        export(scenario, path, "mcap", seed=seed, simulator=simulator, stack=stack, world=world, trace=True)
    else:
        export(runs, path, "mcap")


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
        found = read_recording(
            Path(path), world=place, route=driven, people_topic=people_topic, robot_topic=robot_topic
        )
        runs.append(found.run)
        notes += [f"{path}: {note}" for note in found.notes]
    return RunSet(tuple(runs), None, place), tuple(notes)


def import_agents(
    path: str | Path, world: World | str | Path, route: str, *, description: str = ""
) -> tuple[Scenario, tuple[str, ...]]:
    """Make a scenario of a HuNavSim agents file: its people at their coordinates, on a route of a world.

    Returns:
        The scenario, and one sentence for each setting that is not reproduced.

    Raises:
        FileError: the file is no agents file; every mistake with its line.
        InvalidScenario: somebody starts or walks in an obstacle of this world.
    """
    place = as_world(world)
    converted = hunav_agents.to_humans(hunav_agents.read_agents(Path(path)))
    humans = tuple(_human(agent) for agent in converted.agents)
    text = description or f"People of {Path(path).name}"
    return scenario_of(place, route, humans, description=text), converted.notes


def _human(agent: HumanAgent) -> Human:
    """Return a person whose free points are the goals of an agent."""
    points = {f"goal {k}": goal for k, goal in enumerate(agent.goals, start=1)}
    names = tuple(points)
    stays = len(names) == 1
    task = Task(
        name="Goals of the agent",
        path=names if stays or agent.stays else (*names, names[0]),
        pauses=(Pause(at=names[0], duration_s=LONGEST_PAUSE_S),) if stays else (),
    )
    return Human(
        name=agent.name,
        tasks=(task,),
        behaviour=agent.behaviour,
        speed_m_s=agent.speed_m_s,
        radius_m=agent.radius_m,
        goal_radius_m=agent.goal_radius_m,
        group=agent.group,
        factors=agent.factors,
        points=points,
        start=agent.start,
        reaction=agent.reaction,
        cyclic=not (stays or agent.stays),
    )


@dataclass(frozen=True, kw_only=True)
class Loaded:
    """Runs of files, and what a person should know of them."""

    runs: RunSet
    notes: tuple[str, ...] = ()


def load_any(
    paths: Sequence[str | Path],
    *,
    world: World | str | Path | None = None,
    route: str | None = None,
    people_topic: str | None = None,
    robot_topic: str | None = None,
) -> Loaded:
    """Load files of runs, or recordings; duplicates count once.

    Raises:
        InputError: files of both kinds are given, or options of recordings for files of runs.
    """
    recordings = [path for path in paths if is_recording(path)]
    if not recordings:
        if route or people_topic or robot_topic:
            raise InputError(
                "--route, --people-topic and --robot-topic are for recordings (.mcap, .db3, a rosbag2 folder)."
            )
        given = read_runs([Path(path) for path in paths])
        different = once(given)
        twice = len(given) - len(different)
        said = f"{twice} of {len(given)} runs are given twice and count once."
        return Loaded(runs=RunSet(tuple(different)), notes=(said,) if twice else ())
    if len(recordings) < len(paths):
        raise InputError("Judge recordings and simulated runs one after the other: they are of different scenarios.")
    runs, notes = load_recordings(paths, world=world, route=route, people_topic=people_topic, robot_topic=robot_topic)
    return Loaded(runs=runs, notes=notes)


def is_recording(path: str | Path) -> bool:
    """Return whether a path is a recording: a rosbag2 folder, an MCAP or an SQLite file."""
    path = Path(path)
    return path.suffix in RECORDINGS or (path / "metadata.yaml").is_file()


def _source(source: str | Path | Scenario | RunSet | None, world: World | str | Path | None) -> Source:
    if source is None:
        raise InputError("Give the scenario or the runs to export.")
    if isinstance(source, Scenario):
        return Source(scenario=source, world=world_of(source.mission, world), runs=())
    if isinstance(source, RunSet):
        place = source.world if world is None else as_world(world)
        return Source(scenario=source.scenario, world=place, runs=source.runs)
    path = Path(source)
    try:
        read_scenario(path)
    except InputError as no_scenario:
        try:
            runs = tuple(once(read_runs([path])))
        except InputError:
            raise no_scenario from None
        return Source(scenario=None, world=as_world(world) if world is not None else None, runs=runs)
    found, place = load_scenario_in(path, world)
    return Source(scenario=found, world=place, runs=())


def _write_runs(
    given: Source,
    path: Path,
    format: str,
    seed: int,
    simulator: str | Spec,
    stack: StackLike | None,
    traced: bool,
    on_message: Callable[[str], None],
) -> tuple[str, ...]:
    runs, recorded = given.runs, None
    if not runs:
        if given.scenario is None or given.world is None:
            raise InputError("Give a scenario or runs.")
        if traced:
            recorded = traced_run(
                given.scenario, seed, simulator=simulator, stack=stack, world=given.world, on_message=on_message
            )
            runs = (recorded.run,)
        else:
            made = simulate(
                given.scenario, [seed], simulator=simulator, stack=stack, world=given.world, on_message=on_message
            )
            runs = made.runs
    elif traced:
        raise InputError("A trace simulates a scenario again: give the scenario and --seed, not the runs.")
    if format == "csv":
        exporters.write_csv(runs, path)
    elif format == "parquet":
        exporters.write_parquet(runs, path)
    elif len(runs) > 1:
        raise InputError(f"A bag holds one run, and {len(runs)} are given. Give the scenario and --seed.")
    elif given.world is None:
        raise InputError("A bag holds the map: say with --world (in Python world=) which world the run is of.")
    else:
        bag.write_bag(runs[0], given.world, path, trace=recorded)
    return ()


def _write_scenario(given: Source, path: Path, format: str, dialect: Any, release: Any) -> tuple[str, ...]:
    world = given.world
    if format == "sdf" and world is not None and (given.scenario is None or given.runs):
        if len(given.runs) != 1:
            raise InputError(f"A Gazebo world replays one run, and {len(given.runs)} are given.")
        write_whole(path, exporters.world_sdf(world, given.runs[0]))
        return ()
    scenario = given.scenario
    if scenario is None or world is None:
        raise InputError(f'"{format}" is a format of scenarios: give the scenario, not its runs.')
    route = scenario.mission.route
    if format == "hunav":
        agents = decode(scenario.people, world.grid)
        file, notes = hunav_agents.export_agents(agents, map_name=world.name, dialect=dialect)
        hunav_agents.write_agents(file, path)
        return notes
    texts = {
        "nav2-goals": lambda: exporters.goals_yaml(route, world, release=release),
        "initial-pose": lambda: exporters.initial_pose_yaml(route, world),
        "osc": lambda: exporters.scenario_osc(scenario, world),
        "sdf": lambda: exporters.world_sdf(world),
    }
    write_whole(path, texts[format]())
    return () if format != "sdf" else ("A scenario has no recorded course of its people; export a run to get actors.",)
