"""Export of scenarios and runs, and import of HuNavSim agents files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rvsg.app.playback import trace as traced_run
from rvsg.app.runs import RunSet, simulate
from rvsg.core import plugins
from rvsg.core.errors import InputError, UnknownName
from rvsg.core.plugins import Spec, ignore
from rvsg.scenario.builder import load_scenario_in, read_scenario
from rvsg.scenario.builder import scenario as scenario_of
from rvsg.scenario.scenario import Human, HumanAgent, Pause, Scenario, Task
from rvsg.scenario.world_lookup import as_world, world_of
from rvsg.simulation.archive import once, read_runs
from rvsg.simulation.exporter import Exportable, Exporter
from rvsg.simulation.stacks.registry import StackLike
from rvsg.world.world import World
from rvsg_exchange import hunav_agents

LONGEST_PAUSE_S = 600.0


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
        format: a name registered under `rvsg.exporters`.
        seed: of the run that is simulated.
        stack: the navigation stack under test of that run.
        dialect: of `hunav`: flat, block, v2.
        release: of `nav2-goals`: humble, jazzy, kilted.
        trace: for `mcap`: simulate the run again and record scans, costmaps and plans, too.

    Raises:
        UnknownName: the format, dialect or release does not exist.
        InputError: the source does not fit the format, or a library is missing.
    """
    if format not in plugins.names("exporter"):
        raise UnknownName("format", format, plugins.names("exporter"))
    options: dict[str, dict[str, Any]] = {"hunav": {"dialect": dialect}, "nav2-goals": {"release": release}}
    exporter: Exporter = plugins.make("exporter", format, options.get(format, {}))
    if exporter.takes == "nothing":
        return exporter.write(Exportable(), Path(out))
    given = _source(source, world)
    if exporter.takes == "runs":
        if not given.runs:
            given = _simulated(given, seed, simulator, stack, trace, on_message)
        elif trace:
            raise InputError("A trace simulates a scenario again: give the scenario and --seed, not the runs.")
    elif given.scenario is None and exporter.takes == "scenario":
        raise InputError(f'"{format}" is a format of scenarios: give the scenario, not its runs.')
    return exporter.write(given, Path(out))


def _simulated(
    given: Exportable,
    seed: int,
    simulator: str | Spec,
    stack: StackLike | None,
    traced: bool,
    on_message: Callable[[str], None],
) -> Exportable:
    """Return a scenario with a run of it, or with a trace of its run."""
    if given.scenario is None or given.world is None:
        raise InputError("Give a scenario or runs.")
    work: dict[str, Any] = {"simulator": simulator, "stack": stack, "world": given.world, "on_message": on_message}
    if traced:
        trace = traced_run(given.scenario, seed, **work)
        return Exportable(scenario=given.scenario, world=given.world, runs=(trace.run,), trace=trace)
    made = simulate(given.scenario, [seed], **work)
    return Exportable(scenario=given.scenario, world=given.world, runs=made.runs)


def _source(source: str | Path | Scenario | RunSet | None, world: World | str | Path | None) -> Exportable:
    if source is None:
        raise InputError("Give the scenario or the runs to export.")
    if isinstance(source, Scenario):
        return Exportable(scenario=source, world=world_of(source.mission, world))
    if isinstance(source, RunSet):
        place = source.world if world is None else as_world(world)
        return Exportable(scenario=source.scenario, world=place, runs=source.runs)
    path = Path(source)
    try:
        read_scenario(path)
    except InputError as no_scenario:
        try:
            runs = tuple(once(read_runs([path])))
        except InputError:
            raise no_scenario from None
        return Exportable(world=as_world(world) if world is not None else None, runs=runs)
    found, place = load_scenario_in(path, world)
    return Exportable(scenario=found, world=place)


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
    agents, notes = hunav_agents.read_agents(Path(path))
    humans = tuple(_human(agent) for agent in agents)
    text = description or f"People of {Path(path).name}"
    return scenario_of(place, route, humans, description=text), notes


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
