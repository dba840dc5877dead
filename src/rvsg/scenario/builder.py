"""Scenarios made in Python and in files, and their checks.

A scenario is read from its own JSON, or from that of a proposal or an attempt.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from rvsg.core.documents import record_of
from rvsg.core.errors import FileError, InputError, InvalidScenario, UnknownName
from rvsg.core.files import write_whole
from rvsg.core.inputs import parse_json, read_text
from rvsg.core.plugins import Spec
from rvsg.core.records import Record
from rvsg.robots.robot import Robot, load_robot
from rvsg.scenario import validity
from rvsg.scenario.repair import repair
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.rules import Finding
from rvsg.scenario.scenario import (
    ROBOT,
    Attention,
    Behaviour,
    Human,
    HumanConfiguration,
    Mission,
    Pause,
    Scenario,
    Task,
)
from rvsg.scenario.variation import REACH_M, ScenarioFamily, family_of, migrate
from rvsg.scenario.world_lookup import as_world, doors_in, folder_of, load_moved, load_world, world_of
from rvsg.world.routes import fitted
from rvsg.world.space import robot_space
from rvsg.world.world import Route, SolidObject, State, World

WORLD_FOLDER = "world_folder"
"""The key beside a saved record under which the folder of its world stands. It is no part of the record or its id."""


class FoundWith(Record):
    """What a saved scenario was found with, by content. Each stands beside it under its name; its robot is in it."""

    simulator: Spec | None = None
    """The simulator and the stack, as `by_content` returns them."""
    stack_file: str | None = None
    """The file of parameters that the stack was read from."""
    requirement: Requirement | None = None


@dataclass(frozen=True)
class Saved:
    """The content of a scenario file."""

    value: Any
    """The JSON of the scenario, that of the proposal or attempt around it taken off; None where that holds none."""
    world_folder: Path | None
    found_with: FoundWith


def read_scenario(path: Path) -> tuple[Scenario, Path | None]:
    """Return a scenario, on its own or inside a proposal or an attempt, and the saved folder of its world."""
    saved = read_saved(path)
    return _scenario_in(saved, path), saved.world_folder


def _scenario_in(saved: Saved, path: Path) -> Scenario:
    if saved.value is None:
        raise FileError(path, "this proposal holds no valid scenario; its `problems` say why.")
    return record_of(path, saved.value, Scenario)


def read_saved(path: Path) -> Saved:
    """Return the content of a scenario file, its scenario unchecked; FileError where it holds runs or no JSON."""
    text = read_text(path)
    if '"arrays"' in text.partition("\n")[0]:
        reason = "these are runs; expected the scenario they are of, or a proposal."
        raise FileError(path, reason, code="runs-not-scenario")
    value = parse_json(text, path)
    folder, beside = None, dict[str, Any]()
    if isinstance(value, dict):
        folder = value.pop(WORLD_FOLDER, None)
        beside = {key: value.pop(key) for key in FoundWith.model_fields if key in value}
    for key in ("proposal", "scenario"):
        if isinstance(value, dict) and key in value and "people" not in value:
            value = value[key]
    return Saved(value, Path(folder) if isinstance(folder, str) else None, record_of(path, beside, FoundWith))


def with_world_folder(text: str, folder: Path | None) -> str:
    """Return the JSON of a record with the folder of its world beside it; unchanged where that is None."""
    if folder is None:
        return text
    return json.dumps({WORLD_FOLDER: str(folder), **json.loads(text)}, indent=2, ensure_ascii=False) + "\n"


@dataclass(frozen=True)
class Walk:
    """A person and the waypoints they go round, before the ways between them are known."""

    stops: tuple[str, ...]
    pauses_s: Mapping[str, float]
    given: Mapping[str, Any]
    """The other fields of the person."""

    def human(self, world: World) -> Human:
        """Return the person, who goes from stop to stop by the shortest way, and round again."""
        grid, tasks = world.grid, []
        for start, end in pairwise((*self.stops, self.stops[0])):
            valid = start in grid.valid and end in grid.valid
            way = (grid.shortest_path(start, end) if valid else None) or (start, end)  # the checker says what is wrong
            pauses = tuple(Pause(at=at, duration_s=self.pauses_s[at]) for at in way[1:] if at in self.pauses_s)
            tasks.append(Task.between(start, end, way, pauses))
        return Human(tasks=tuple(tasks), **self.given)


def walk(
    name: str,
    *waypoints: str,
    pauses_s: Mapping[str, float] | None = None,
    behaviour: Behaviour | str = Behaviour.REGULAR,
    attention: Attention | str = Attention.ATTENTIVE,
    speed_m_s: float = 1.5,
    start_delay_s: float = 0.0,
    group: int | None = None,
) -> Walk:
    """Describe a person who goes round two or more waypoints by the shortest ways.

    Args:
        pauses_s: seconds to stand still at a waypoint that the person passes or reaches.
        behaviour: how the person reacts to the robot: regular, impassive, surprised, scared, curious, threatening.
        attention: how far ahead the person looks: attentive, distracted, unseeing (default profile only).
        speed_m_s: the speed of the person at a brisk walk.

    Raises:
        InputError: fewer than two waypoints, or an unknown behaviour or attention.
    """
    stops = waypoints[:-1] if len(waypoints) > 2 and waypoints[0] == waypoints[-1] else waypoints
    if len(stops) < 2:
        raise InputError(f"{name} needs at least two waypoints to walk between, e.g. walk({name!r}, 'E15', 'H15').")
    for what, value, kind in (("behaviour", behaviour, Behaviour), ("attention", attention, Attention)):
        words = [member.value for member in kind]
        if value not in words:
            raise UnknownName(what, str(value), words)
    values = {"name": name, "behaviour": behaviour, "attention": attention, "speed_m_s": speed_m_s}
    return Walk(stops, dict(pauses_s or {}), {**values, "start_delay_s": start_delay_s, "group": group})


def scenario(
    world: World | str | Path,
    route: Route | str,
    people: Iterable[Walk | Human] | HumanConfiguration = (),
    *,
    description: str = "",
    robot: Robot | str | Path = ROBOT,
    moved: Iterable[SolidObject] | str | Path = (),
    doors: Mapping[str, State] | None = None,
) -> Scenario:
    """Make a scenario: a robot's mission on a route of a world, and the people who walk there.

    Without people it is the mission alone. `robot` is a record, the name of a shipped robot or a robot file; the route
    is fitted to it, see `mission_of`. `moved` are objects in the robot's way that its map does not show, or a file of
    them (like objects.yaml). `doors` gives the states of doors by name: open, closed or automatic.

    Raises:
        InvalidScenario: it breaks a rule; `findings` says which.
        UnknownName: the world has no such route or door.
    """
    place = doors_in(as_world(world), doors or {})
    place = place.with_moved(load_moved(moved, place) if isinstance(moved, str | Path) else tuple(moved))
    taken = place.route(route) if isinstance(route, str) else route
    if not isinstance(people, HumanConfiguration):
        humans = tuple(person.human(place) if isinstance(person, Walk) else person for person in people)
        people = HumanConfiguration(humans=humans)
    built = Scenario(mission=mission_of(place, taken, robot)[0], people=people, description=description)
    check_valid(built, place)
    return built


def check(scenario: Scenario, world: World | str | Path | None = None) -> tuple[Finding, ...]:
    """Return every rule the scenario breaks; empty if it is valid."""
    return validity.check(scenario.people, scenario.mission, world_of(scenario.mission, world))


def check_valid(scenario: Scenario, world: World) -> tuple[Finding, ...]:
    """Refuse a scenario that breaks a rule, so that none reaches a simulator; return what is merely doubtful.

    Raises:
        InvalidScenario: with every finding.
    """
    check_route(scenario.mission.route, world)
    _check(scenario.people, scenario.mission, world, "The scenario is not valid:")
    return validity.warnings(scenario.people, scenario.mission, world)


def check_mission(mission: Mission, world: World) -> None:
    """Refuse a mission that no people can make valid, e.g. one whose only way a closed door bars.

    Raises:
        InvalidScenario: with every finding.
    """
    _check(HumanConfiguration(humans=()), mission, world, "The mission is not valid:")


def _check(people: HumanConfiguration, mission: Mission, world: World, message: str) -> None:
    if findings := validity.check(people, mission, world):
        raise InvalidScenario(message, [str(finding) for finding in findings])


def check_route(route: Route, world: World) -> None:
    """Refuse a route that starts or ends inside an obstacle."""
    space = robot_space(world)
    for what, pose in (("start", route.start), ("goal", route.goal)):
        if not space.is_free(pose.x, pose.y):
            raise InputError(
                f"{world.name}, {route.name}: the {what} pose ({pose.x:g}, {pose.y:g}) lies inside an obstacle or "
                "outside the map. Move it in routes.yaml; `rvsg world check` shows every such pose.",
                code="pose-blocked",
            )


def as_robot(robot: Robot | str | Path, known: Sequence[str] = ()) -> Robot | str:
    """Return the robot of a mission: a record, or one of the names that the simulator knows.

    Raises:
        UnknownName: there is no such robot and no such file.
        FileError: the file is wrong.
    """
    return robot if isinstance(robot, Robot) or robot in (ROBOT, *known) else load_robot(robot)


def mission_of(
    world: World, route: Route, robot: Robot | str | Path = ROBOT, known: Sequence[str] = ()
) -> tuple[Mission, tuple[str, ...]]:
    """Return the mission of a robot on a route, and what of the route was fitted to the robot, in words.

    The routes of a world are written for the default robot. For another one the goal moves to where its body can stand,
    and the time limit to what its speed needs.

    Args:
        known: names of robots that the simulator knows; another one is looked up among the shipped ones and the files.

    Raises:
        UnknownName: there is no such robot and no such file.
        FileError: the robot file is wrong.
    """
    driver = as_robot(robot, known)
    if not isinstance(driver, Robot):
        return Mission.of(world, route, robot=driver), ()
    route, notes = fitted(route, driver, world)
    return Mission.of(world, route, robot=driver), notes


def with_robot(scenario: Scenario, robot: Robot | str | Path, world: World) -> tuple[Scenario, tuple[str, ...]]:
    """Return a scenario with another robot on its route, and what of the route was fitted to it, in words."""
    mission, notes = mission_of(world, scenario.mission.route, robot)
    return scenario.replace(mission=scenario.mission.replace(robot=mission.robot, route=mission.route)), notes


def load_scenario(path: str | Path, *, world: World | str | Path | None = None) -> Scenario:
    """Load a scenario from its JSON file, or from that of a proposal or an attempt, and check it.

    Raises:
        FileError: the file holds no scenario.
        InvalidScenario: the scenario breaks a rule.
    """
    saved, place = load_scenario_in(path, world)
    check_valid(saved, place)
    return saved


def load_scenario_in(path: str | Path, world: World | str | Path | None = None) -> tuple[Scenario, World]:
    """Load a scenario and the world it was made in, without checking the one in the other."""
    return load_saved(path, world)[:2]


def load_saved(path: str | Path, world: World | str | Path | None = None) -> tuple[Scenario, World, FoundWith]:
    """Load a scenario, the world it was made in, and what it was found with, without checking the one in the other."""
    path = Path(path)
    saved = read_saved(path)
    scenario = _scenario_in(saved, path)
    near = _near(path, scenario.mission, saved.world_folder)
    return scenario, world_of(scenario.mission, world, near=near), saved.found_with


def _near(path: Path, mission: Mission, saved: Path | None) -> tuple[Path, ...]:
    """Return where the world of a scenario file may be: in the folder saved in it, else beside the file."""
    beside = path.parent / mission.world
    return (beside,) if saved is None else (saved, beside)


def changed(
    scenario: Scenario,
    world: World,
    *,
    robot: str | None = None,
    moved: Path | None = None,
    doors: Mapping[str, State] | None = None,
) -> tuple[Scenario, World, tuple[str, ...]]:
    """Return a scenario and its world with another robot, moved objects or door states where given.

    The last is what of the route was fitted to the robot, in words.

    Raises:
        FileError: a file is wrong.
    """
    notes: tuple[str, ...] = ()
    if robot is not None:
        scenario, notes = with_robot(scenario, robot, world)
    if moved is not None:
        things = load_moved(moved, world)
        scenario, world = scenario.replace(mission=scenario.mission.replace(moved=things)), world.with_moved(things)
    if doors:
        world = doors_in(world, doors)
        scenario = scenario.replace(mission=scenario.mission.replace(doors=dict(world.door_states)))
    return scenario, world, notes


def scenario_json(scenario: Scenario, found: FoundWith | None = None) -> str:
    """Return a scenario as JSON, with the folder of its world beside it where that is not a shipped one.

    Args:
        found: what the scenario was found with, which `load_saved` returns again.
    """
    text = with_world_folder(scenario.to_json(), folder_of(scenario.mission.world_id))
    if found is None:
        return text
    beside = found.model_dump(mode="json", exclude_none=True)
    return json.dumps({**beside, **json.loads(text)}, indent=2, ensure_ascii=False) + "\n"


def without_people(scenario: Scenario) -> Scenario:
    """Return the mission alone."""
    return scenario.replace(people=HumanConfiguration(humans=()), description="")


def save_scenario(scenario: Scenario, path: str | Path, found: FoundWith | None = None) -> None:
    """Write a scenario, with what it was found with, to a file from which `load_scenario` finds its world again."""
    write_whole(Path(path), scenario_json(scenario, found))


def migrate_scenario(
    path: str | Path,
    world: str | Path,
    *,
    route: str | None = None,
    reach_m: float = REACH_M,
    with_repair: bool = False,
) -> tuple[Scenario, tuple[str, ...]]:
    """Read a scenario, adapt it to a world, repair its ways where asked, and check it; return it with the changes.

    Raises:
        InputError: A waypoint has no successor within `reach_m`.
        InvalidScenario: The adapted scenario breaks a rule; `findings` says which.
    """
    saved, _ = read_scenario(Path(path))
    place = load_world(world)
    scenario, changes = migrate(saved, place, reach_m=reach_m, route=place.route(route) if route else None)
    if with_repair:
        people, repairs = repair(scenario.people, scenario.mission, place)
        scenario, changes = scenario.replace(people=people), (*changes, *map(str, repairs))
    check_route(scenario.mission.route, place)
    offer = "" if with_repair else "; --repair repairs ways that are barred"
    _check(scenario.people, scenario.mission, place, f"The scenario is not valid in {place.name}{offer}:")
    return scenario, changes


def load_family(
    source: str | Path, vary: Sequence[str] = (), world: World | str | Path | None = None
) -> tuple[ScenarioFamily, World, FoundWith]:
    """Load a scenario file that may hold ranges, its world, and what it was found with.

    Args:
        vary: further ranges, as `PERSON.KEY=LOW to HIGH`.

    Raises:
        FileError: the file holds no scenario, or a range that cannot be used.
    """
    path = Path(source)
    saved = read_saved(path)
    if not isinstance(saved.value, dict):
        raise FileError(path, "this file holds no scenario.")
    try:
        family = family_of(saved.value, vary)
    except InputError as error:
        raise FileError(path, str(error)) from None
    mission = family.middle.mission
    place = world_of(mission, world, near=_near(path, mission, saved.world_folder))
    return family, place, saved.found_with
