"""Export of scenarios and runs in formats of other tools, and import of HuNavSim agents files."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import shapely
import yaml
from jinja2 import Environment, PackageLoader
from numpy.typing import NDArray
from pydantic import ValidationError

from rvsg.app.saved_scenario import AS_FOUND, rerun
from rvsg.app.view import viewer_page, write_view
from rvsg.core import plugins
from rvsg.core.errors import InputError, UnknownName, how_to_install
from rvsg.core.files import write_whole
from rvsg.core.plugins import Spec, ignore
from rvsg.core.records import Pose
from rvsg.scenario.builder import load_scenario_in, read_scenario
from rvsg.scenario.builder import scenario as scenario_of
from rvsg.scenario.scenario import HUNAVSIM_RADIUS_M, LONGEST_PAUSE_S, Human, HumanAgent, Pause, Scenario, Task, decode
from rvsg.scenario.world_lookup import as_world, world_of
from rvsg.search.run_set import RunSet, simulate
from rvsg.simulation.archive import once, read_runs
from rvsg.simulation.embedded.trace import trace as traced_run
from rvsg.simulation.exporter import Exportable, Exporter
from rvsg.simulation.run import Run
from rvsg.world.world import Polygon, Route, SolidObject, World
from rvsg_exchange import hunav_agents
from rvsg_exchange.bag import rosbags_types, write_bag

DIALECTS: tuple[hunav_agents.Dialect, ...] = get_args(hunav_agents.Dialect)
Release = Literal["humble", "jazzy", "kilted"]
RELEASES: tuple[Release, ...] = get_args(Release)
SDF_VERSION = "1.7"
"""Read by Gazebo Classic 11 and by Gazebo Fortress and later."""
ACTOR_STEP_S = 0.5
SKIN = "https://fuel.gazebosim.org/1.0/Mingfei/models/actor/tip/files/meshes/walk.dae"
"""The actors' mesh and walking animation."""
Column = NDArray[Any]


def _render(template: str, *, xml: bool = False, **values: Any) -> str:
    environment = Environment(
        loader=PackageLoader("rvsg_exchange", "."),
        autoescape=xml,  # noqa: S701 (what is not XML has nothing to escape)
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["line"] = lambda text: " ".join(str(text).split())
    return environment.get_template(template).render(**values)


def scenario_osc(scenario: Scenario, world: World) -> str:
    """Return a scenario as OpenSCENARIO DSL, poses in the map frame; comments list its people."""
    dx, dy = world.map_offset

    def pose(at: Pose) -> str:
        position = f"position_3d(x: {at.x - dx:.6f}m, y: {at.y - dy:.6f}m)"
        return f"pose_3d({position}, orientation: orientation_3d(yaw: {at.yaw:.6f}rad))"

    return _render(
        "scenario.osc.j2",
        scenario=scenario,
        route=scenario.mission.route,
        description=" ".join(scenario.description.split()),
        name=re.sub(r"\W", "_", scenario.id),
        pose=pose,
    )


def goals_yaml(route: Route, world: World, *, release: Release = "jazzy") -> str:
    """Return the poses the robot must pass and the goal, in the map frame, as the YAML of an action goal.

    Up to Jazzy the goal holds a list of PoseStamped, from Kilted on a nav_msgs/Goals.
    """
    header = {"frame_id": "map"}
    goals: Any = [{"header": {**header}, "pose": _goal_pose(p, world)} for p in (*route.through, route.goal)]
    if release == "kilted":
        goals = {"header": header, "goals": goals}
    return yaml.safe_dump({"poses": goals, "behavior_tree": ""}, sort_keys=False)


def _goal_pose(pose: Pose, world: World) -> dict[str, dict[str, float]]:
    dx, dy = world.map_offset
    return {
        "position": {"x": pose.x - dx, "y": pose.y - dy, "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(pose.yaw / 2), "w": math.cos(pose.yaw / 2)},
    }


def world_sdf(world: World, run: Run | None = None) -> str:
    """Return a world as SDF: solid objects become static models, and the people of a run actors on its clock."""
    actors = {name: _waypoints(run, k) for k, name in enumerate(run.human_names)} if run is not None else {}
    return _render("world.sdf.j2", xml=True, world=world, version=SDF_VERSION, rings=_rings, actors=actors, skin=SKIN)


def _rings(thing: SolidObject) -> list[Polygon]:
    """Return outlines without holes that together cover the object: a polyline of SDF is one closed ring."""
    if not thing.holes:
        return [thing.footprint]
    pieces = shapely.constrained_delaunay_triangles(shapely.Polygon(thing.footprint, thing.holes))
    return [tuple(piece.exterior.coords[:-1]) for piece in shapely.get_parts(pieces)]


def _waypoints(run: Run, index: int) -> list[tuple[float, str]]:
    """Return times and poses of a person, as an actor repeats them."""
    path = run.trajectory
    times = np.arange(0.0, float(path.t[-1]) + ACTOR_STEP_S / 2, ACTOR_STEP_S)
    if times.size < 2:
        raise InputError("The run is too short to make actors of its people.")
    x = np.interp(times, path.t, path.human_x[:, index])
    y = np.interp(times, path.t, path.human_y[:, index])
    yaw = np.interp(times, path.t, np.unwrap(path.human_yaw[:, index]))
    return [(t, f"{x[k]:.4f} {y[k]:.4f} 0 0 0 {yaw[k]:.4f}") for k, t in enumerate(times.tolist())]


def trajectory_table(runs: Iterable[Run]) -> dict[str, Column]:
    """Return the trajectories of runs as columns of equal length.

    Columns: `run` (content id), `seed`, `t` (s), `robot` or the name of a person as `who`, `x`, `y` (m, world frame),
    `yaw` (rad), `speed` (m/s), and for the robot `omega` (rad/s) and `acceleration` (m/s2); people have NaN there.
    Rows are ordered by run, then who, then time.
    """
    parts: list[dict[str, Column]] = []
    for run in runs:
        path = run.trajectory
        n = len(path)
        none = np.full(n, np.nan)
        same = {"run": np.full(n, run.id), "seed": np.full(n, run.seed), "t": path.t}
        parts.append(
            same
            | {"who": np.full(n, "robot"), "x": path.x, "y": path.y, "yaw": path.yaw, "speed": path.v}
            | {"omega": path.omega, "acceleration": path.acceleration}
        )
        for k, name in enumerate(run.human_names):
            human = {"x": path.human_x, "y": path.human_y, "yaw": path.human_yaw, "speed": path.human_speed}
            parts.append(
                same
                | {"who": np.full(n, name)}
                | {key: values[:, k] for key, values in human.items()}
                | {"omega": none, "acceleration": none}
            )
    if not parts:
        raise InputError("There are no runs to write a table of.")
    return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}


def foxglove_layout() -> str:
    """Return a layout as Foxglove imports it: the map with robot and people, and plots of speed and acceleration."""
    return Path(__file__).with_name("foxglove_layout.json").read_text(encoding="utf-8")


def _scenario_in(source: Exportable) -> tuple[Scenario, World]:
    if source.scenario is None or source.world is None:
        raise InputError("This is a format of scenarios: give the scenario, not its runs.")
    return source.scenario, source.world


def _no_formula(value: Any) -> Any:
    """Return a value of a cell; a text that a spreadsheet would run as a formula begins with an apostrophe."""
    return f"'{value}" if isinstance(value, str) and value.startswith(("=", "+", "-", "@", "\t", "\r")) else value


class Csv(Exporter):
    """Trajectories as CSV."""

    takes = "runs"

    def write(self, source: Exportable, path: Path) -> tuple[str, ...]:
        """Write a header, and a row for each sample of robot and people; reading a number gives the same float."""
        table = trajectory_table(source.runs)
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(table)
        for row in zip(*(values.tolist() for values in table.values()), strict=True):
            writer.writerow(["" if value != value else _no_formula(value) for value in row])
        write_whole(path, text.getvalue())
        return ()


class Parquet(Exporter):
    """Trajectories as Parquet; needs pyarrow (extra `tables`)."""

    takes = "runs"

    def write(self, source: Exportable, path: Path) -> tuple[str, ...]:
        """Write a row for each sample of robot and people."""
        try:
            import pyarrow as pa
            import pyarrow.parquet as pq
        except ImportError:
            raise InputError(f"Parquet needs pyarrow: {how_to_install('tables')}.") from None
        table = trajectory_table(source.runs)
        sink = io.BytesIO()
        columns = {key: pa.array(values.tolist(), from_pandas=True) for key, values in table.items()}
        pq.write_table(pa.table(columns), sink)
        write_whole(path, sink.getvalue())
        return ()


class Mcap(Exporter):
    """A run as rosbag2 for Foxglove, RViz and `ros2 bag play`."""

    takes = "runs"

    def check(self) -> None:
        """Raise InputError where rosbags is not installed."""
        rosbags_types()

    def write(self, source: Exportable, path: Path) -> tuple[str, ...]:
        """Write the one run that a bag holds, with its trace where there is one."""
        if len(source.runs) > 1:
            raise InputError(f"A bag holds one run, and {len(source.runs)} are given. Give the scenario and --seed.")
        if source.world is None:
            raise InputError("A bag holds the map: say with --world (in Python world=) which world the run is of.")
        write_bag(source.runs[0], source.world, path, trace=source.trace)
        return ()


class HunavAgents(Exporter):
    """The people of a scenario as an agents file of HuNavSim."""

    def __init__(self, dialect: hunav_agents.Dialect = "block") -> None:
        if dialect not in DIALECTS:
            raise UnknownName("dialect", dialect, DIALECTS)
        self.dialect = dialect

    def write(self, source: Exportable, path: Path) -> tuple[str, ...]:
        """Write the agents; return what HuNavSim does not hold of them."""
        scenario, world = _scenario_in(source)
        agents = decode(scenario.people, world.grid, HUNAVSIM_RADIUS_M)
        text, notes = hunav_agents.agents_yaml(agents, map_name=world.name, dialect=self.dialect)
        write_whole(path, text)
        return notes


class Nav2Goals(Exporter):
    """The route of a scenario as the goal of Nav2's `NavigateThroughPoses`."""

    def __init__(self, release: Release = "jazzy") -> None:
        if release not in RELEASES:
            raise UnknownName("release", release, RELEASES)
        self.release = release

    def write(self, source: Exportable, path: Path) -> tuple[str, ...]:
        """Write the poses in the map frame."""
        scenario, world = _scenario_in(source)
        write_whole(path, goals_yaml(scenario.mission.route, world, release=self.release))
        return ()


class InitialPose(Exporter):
    """The start of a scenario's route as a `geometry_msgs/PoseWithCovarianceStamped` for `/initialpose`."""

    def write(self, source: Exportable, path: Path) -> tuple[str, ...]:
        """Write the pose in the map frame."""
        scenario, world = _scenario_in(source)
        covariance = [0.0] * 36
        covariance[0] = covariance[7] = 0.25
        covariance[35] = (math.pi / 12) ** 2
        pose = {"pose": _goal_pose(scenario.mission.route.start, world), "covariance": covariance}
        write_whole(path, yaml.safe_dump({"header": {"frame_id": "map"}, "pose": pose}, sort_keys=False))
        return ()


class OpenScenario(Exporter):
    """A scenario as OpenSCENARIO DSL."""

    def write(self, source: Exportable, path: Path) -> tuple[str, ...]:
        """Write the scenario in the dialect of scenario-execution."""
        write_whole(path, scenario_osc(*_scenario_in(source)))
        return ()


class Gazebo(Exporter):
    """A world as SDF, with the people of a run as actors."""

    takes = "either"

    def write(self, source: Exportable, path: Path) -> tuple[str, ...]:
        """Write the world; a scenario without a run has no course of its people."""
        if source.world is None:
            raise InputError("Runs do not hold their world: say with --world (in Python world=) which one it is.")
        if not source.runs:
            write_whole(path, world_sdf(source.world))
            return ("A scenario has no recorded course of its people; export a run to get actors.",)
        if len(source.runs) != 1:
            raise InputError(f"A Gazebo world replays one run, and {len(source.runs)} are given.")
        write_whole(path, world_sdf(source.world, source.runs[0]))
        return ()


class FoxgloveLayout(Exporter):
    """The layout for Foxglove that fits the bags."""

    takes = "nothing"

    def write(self, source: Exportable, path: Path) -> tuple[str, ...]:
        """Write the layout."""
        write_whole(path, foxglove_layout())
        return ()


VIEW, VIEWER = "view", "viewer"
"""A campaign or the results of a suite as one file, and the page that opens it: no formats of another tool."""


def export(
    source: str | Path | Scenario | RunSet | None,
    out: str | Path,
    format: str,
    *,
    seed: int = 0,
    simulator: str | Spec = "embedded",
    settings: Mapping[str, Any] = AS_FOUND,
    world: str | None = None,
    dialect: str = "block",
    release: str = "jazzy",
    trace: bool = False,
    on_message: Callable[[str], None] = ignore,
) -> tuple[str, ...]:
    """Write a scenario or its runs in the format of another tool; return what the file cannot hold.

    Args:
        source: a scenario, runs, or a file of either. A format of runs simulates a scenario first, with the seed.
            For `view` the folder of a campaign, or a file of results of `rvsg suite run --json`.
        simulator: simulates a scenario; that of a file is simulated as it was found.
        settings: replace what the scenario of a file was found with, see `rerun`.
        format: a name registered under `rvsg.exporters`; `view`, or `viewer`, the page that opens views.
        dialect: of `hunav`: flat, block, v2.
        release: of `nav2-goals`: humble, jazzy, kilted.
        trace: for `mcap`: simulate the run again and record scans, costmaps and plans, too.

    Raises:
        UnknownName: the format, dialect or release does not exist.
        InputError: the source does not fit the format, or a library is missing.
    """
    if format not in (known := [*plugins.names("exporter"), VIEW, VIEWER]):
        raise UnknownName("format", format, known)
    if format == VIEWER:
        write_whole(Path(out), viewer_page())
        return ()
    if format == VIEW:
        if not isinstance(source, str | Path):
            raise InputError("A view is of the folder of a campaign, or of a file of results of a suite.")
        write_view(Path(source), Path(out))
        verbs = "rvsg report or rvsg studio" if Path(source).is_dir() else "rvsg studio"
        return (f"{out} opens in viewer.html (rvsg export --to viewer) and with {verbs}.",)
    options: dict[str, dict[str, Any]] = {"hunav": {"dialect": dialect}, "nav2-goals": {"release": release}}
    exporter: Exporter = plugins.make("exporter", format, options.get(format, {}))
    if exporter.takes == "nothing":
        return exporter.write(Exportable(), Path(out))
    given = _source(source, world)
    if exporter.takes == "runs":
        if not given.runs:
            if isinstance(source, str | Path):
                again = rerun(source, settings, world=world, on_message=on_message)
                given, simulator = Exportable(scenario=again.scenario, world=again.world), again.simulator
            given = _simulated(given, seed, simulator, trace, on_message)
        elif trace:
            raise InputError("A trace simulates a scenario again: give the scenario and --seed, not the runs.")
    elif given.scenario is None and exporter.takes == "scenario":
        raise InputError(f'"{format}" is a format of scenarios: give the scenario, not its runs.')
    return exporter.write(given, Path(out))


def _simulated(
    given: Exportable,
    seed: int,
    simulator: str | Spec,
    traced: bool,
    on_message: Callable[[str], None],
) -> Exportable:
    """Return a scenario with a run of it, or with a trace of its run."""
    if given.scenario is None or given.world is None:
        raise InputError("Give a scenario or runs.")
    work: dict[str, Any] = {"simulator": simulator, "world": given.world, "on_message": on_message}
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
    """Make a scenario of a HuNavSim agents file on a route of a world; return one sentence per setting not reproduced.

    Raises FileError with every mistake and its line, InputError for a value out of range, and InvalidScenario where
    somebody starts or walks in an obstacle of this world.
    """
    place = as_world(world)
    agents, notes = hunav_agents.read_agents(Path(path))
    try:
        humans = tuple(_human(agent) for agent in agents)
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(f"{path}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None
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
