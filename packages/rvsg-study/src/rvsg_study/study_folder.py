"""The layout of the published study's results: what each folder holds, and readers for its files.

::

    {distance,jerk,reach}/route_R/E/            the guided method: five configurations K of scenario E
    no_req/route_R/E/, random/route_R/E/        the baselines: one configuration per scenario
    {best,worst}_scenario/{req}/route_R/E/      one configuration, run many times
      {req}_MODEL_K.json       tasks and waypoint paths      log_K.csv   one row per half second
      {req}_scenario_MODEL.json  description, task lists     log.csv     one row per run: the logged metrics

Any part of it can be read, and any results kept in the same layout.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from rvsg.core.records import Record
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import ForceFactors, Human, HumanConfiguration, Task
from rvsg_study.study_format import (
    Unreadable,
    as_number,
    children,
    folders,
    read_json,
    read_table,
    shown,
    small_number,
    truth,
)

Method = Literal["rvsg", "unguided", "random", "best", "worst"]

REQUIREMENTS: dict[str, Requirement] = {
    "distance": Requirement(
        name="R1",
        title="Collision avoidance",
        text="The robot keeps a safe distance from other objects.",
        metric="dto_logged",
        worse="smaller",
        unit="m",
        source="RVSG study; no limit, as there",
    ),
    "jerk": Requirement(
        name="R2",
        title="Stability",
        text="The robot keeps operational stability.",
        metric="jerk_logged",
        worse="larger",
        unit="m/s³",
        source="RVSG study; no limit, as there",
    ),
    "reach": Requirement(
        name="R3",
        title="Efficiency",
        text="The navigation task completes within a reasonable time.",
        metric="trg_logged",
        worse="larger",
        unit="s",
        source="RVSG study; no limit, as there",
    ),
}

LOGGED: dict[str, str] = {
    "time_to_reach_goal": "trg_logged",
    "path_length": "pl_logged",
    "cumulative_heading_changes": "chc_logged",
    "avg_distance_to_closest_person": "dto_logged",
    "minimum_distance_to_people": "min_distance_logged",
    "minimum_distance_to_target": "goal_distance_min_logged",
    "final_distance_to_target": "goal_distance_logged",
    "robot_on_person_collision": "rpc_logged",
    "person_on_robot_collision": "por_logged",
    "time_not_moving": "tnm_logged",
    "avg_robot_linear_speed": "speed_logged",
    "avg_robot_angular_speed": "turn_rate_logged",
    "avg_robot_acceleration": "acceleration_logged",
    "avg_robot_jerk": "jerk_logged",
    "avg_pedestrian_velocity": "human_speed_logged",
    "avg_closest_pedestrian_velocity": "closest_human_speed_logged",
}
"""The columns of `log.csv` and the metrics of ours that must equal them."""

TOLERANCE = {"jerk_logged": 1e-6}
EXACT = 1e-9

_ROUTE = re.compile(r"route_[A-Za-z0-9_-]{1,100}")
_LOG = re.compile(r"log_([0-9]{1,6})\.csv")
_CONFIGURATION = re.compile(r".+_([0-9]{1,6})\.json")
_IGNORED = {"replies"}

Kind = Literal["log", "configuration", "scenario", "waypoint", "metrics", "layout", "foreign-run"]
FOREIGN: Kind = "foreign-run"
"""The logged run cannot be of the configuration beside it."""


class ImportFinding(Record):
    """A defect in the imported files, and what the import did about it."""

    file: str
    kind: Kind
    message: str


@dataclass(frozen=True)
class Batch:
    """All runs of one scenario folder."""

    folder: Path
    method: Method
    requirement: str | None
    route: str
    scenario: int

    @property
    def repeats(self) -> bool:
        """Return whether the logs are repeats of one configuration and not one run each of several."""
        return self.method in ("best", "worst")


def batches(root: Path, findings: list[ImportFinding]) -> Iterator[Batch]:
    """Yield each scenario folder under `root` in a fixed order; folders that fit nowhere become findings."""
    for top in folders(root):
        if top.name in REQUIREMENTS:
            yield from _of_routes(top, root, "rvsg", top.name, findings)
        elif top.name in ("no_req", "random"):
            yield from _of_routes(top, root, "unguided" if top.name == "no_req" else "random", None, findings)
        elif top.name in ("best_scenario", "worst_scenario"):
            for folder in folders(top):
                if folder.name in REQUIREMENTS:
                    method: Method = "best" if top.name == "best_scenario" else "worst"
                    yield from _of_routes(folder, root, method, folder.name, findings)
                else:
                    findings.append(_stranger(folder, root))
        elif top.name not in _IGNORED:
            findings.append(_stranger(top, root))


def _of_routes(
    folder: Path, root: Path, method: Method, requirement: str | None, findings: list[ImportFinding]
) -> Iterator[Batch]:
    for route in folders(folder):
        if not _ROUTE.fullmatch(route.name):
            findings.append(_stranger(route, root))
            continue
        for scenario in sorted(folders(route), key=lambda p: (len(p.name), p.name)):
            number = small_number(scenario.name)
            if number is not None:
                yield Batch(scenario, method, requirement, route.name, number)
            else:
                findings.append(_stranger(scenario, root))


def _stranger(folder: Path, root: Path) -> ImportFinding:
    return ImportFinding(
        file=shown(folder, root), kind="layout", message="this folder fits nowhere in the layout: left out"
    )


def numbered(folder: Path, what: Literal["log", "configuration"]) -> dict[int, Path]:
    """Return the logs or the configurations of a scenario folder by number."""
    pattern = _LOG if what == "log" else _CONFIGURATION
    found = {
        int(match.group(1)): path
        for path in children(folder)
        if (match := pattern.fullmatch(path.name)) and "_scenario_" not in path.name and "_memory_" not in path.name
    }
    return dict(sorted(found.items()))


def read_description(folder: Path) -> tuple[str, str | None]:
    """Return the description in `*_scenario_*.json`, empty without one, and its defect, if it has one."""
    files = [path for path in children(folder) if "_scenario_" in path.stem and path.suffix == ".json"]
    if not files:
        return "", None
    try:
        value = read_json(files[0])
    except Unreadable as error:
        return "", f"{shown(Path(files[0].name))}: {error}; the description is lost"
    text = value.get("scenario", "") if isinstance(value, dict) else None
    if not isinstance(text, str):
        return "", f"{shown(Path(files[0].name))}: its `scenario` is not a text; the description is lost"
    return text, None


@dataclass(frozen=True)
class ReadPeople:
    """The content of a configuration file.

    `people` is None if the file is not a valid configuration; `tasks` are those that could be read; `odd` are the
    defects, as pairs of kind and message.
    """

    people: HumanConfiguration | None
    tasks: dict[str, list[str]]
    odd: list[tuple[Kind, str]]


def read_people(path: Path, known: frozenset[str]) -> ReadPeople:
    """Read a configuration. Unknown waypoint names stay in their paths and are listed.

    The study's own decoder dropped them without a message, so people walked straight to the next known one.
    """
    read = ReadPeople(None, {}, [])
    try:
        value = read_json(path)
    except Unreadable as error:
        read.odd.append(("configuration", f"{error}; is the file cut off?"))
        return read
    numbers = sorted(int(n) for key in value if (n := _worker_number(key))) if isinstance(value, dict) else []
    if not numbers:
        read.odd.append(("configuration", 'holds no "Worker N Tasks"'))
    humans = [_human(value[f"Worker {n} Tasks"], n, known, read) for n in numbers]
    present = tuple(human for human in humans if human is not None)
    if not present or len(present) < len(humans):
        return read
    return ReadPeople(HumanConfiguration(humans=present), read.tasks, read.odd)


def _worker_number(key: object) -> str | None:
    found = re.fullmatch(r"Worker ([1-9][0-9]{0,2}) Tasks", str(key))
    return found.group(1) if found else None


def _human(listed: Any, number: int, known: frozenset[str], read: ReadPeople) -> Human | None:
    """Return the human of that number, or None if the file holds none; defects go to `read.odd`."""
    name = f"Human {number}"
    if not isinstance(listed, list) or not all(isinstance(task, dict) for task in listed):
        read.odd.append(("configuration", f"the tasks of {name} are not a list of tasks"))
        return None
    tasks = [_task(task, name, place, known, read) for place, task in enumerate(listed, 1)]
    read.tasks[name] = [task.name for task in tasks]
    if not any(waypoint in known for task in tasks for waypoint in task.path):
        read.odd.append(
            (FOREIGN, f"{name} has no known waypoint to go to: the logged run cannot be of this configuration")
        )
    if not tasks:
        return None
    return Human(name=name, tasks=tuple(tasks), factors=ForceFactors() if number == 1 else "random_normal")


def _task(value: dict[str, Any], human: str, place: int, known: frozenset[str], read: ReadPeople) -> Task:
    title = str(value.get("Task") or f"task {place}")[:120]
    listed = value.get("Path")
    path = tuple(str(waypoint)[:120] for waypoint in listed) if isinstance(listed, list) else ()
    if not path:
        read.odd.append(("waypoint", f'{human}, task "{title}": the path is empty'))
    read.odd.extend(
        ("waypoint", f'{human}, task "{title}", waypoint {number}: there is no waypoint "{waypoint}"; kept')
        for number, waypoint in enumerate(path, 1)
        if waypoint not in known
    )
    return Task(name=title, path=path)


def read_logged(folder: Path) -> tuple[dict[int, dict[str, float | None]], dict[int, bool | None], list[str]]:
    """Return the rows of `log.csv` by run number, whether each run completed, and the defects of the file."""
    path = folder / "log.csv"
    if not path.is_file():
        return {}, {}, ["log.csv is missing: there are no logged metrics to compare with"]
    values: dict[int, dict[str, float | None]] = {}
    completed: dict[int, bool | None] = {}
    wrong: list[str] = []
    try:
        header, lines = read_table(path)
    except Unreadable as error:
        return {}, {}, [f"log.csv: {error}"]
    rows = [dict(zip(header, line, strict=False)) for line in lines]
    missing = [name for name in LOGGED if rows and name not in header]
    if missing:
        wrong.append(f"log.csv lacks the columns {', '.join(missing)}")
    for line, row in enumerate(rows, 2):
        tag = row.get("experiment_tag", "")
        number = small_number(tag.rpartition("_")[2])
        if number is None or number in values:
            wrong.append(f"log.csv line {line}: the experiment_tag is {tag[:40]!r}; row left out")
            continue
        values[number] = {name: _finite(row.get(name, ""), name, line, wrong) for name in LOGGED if name not in missing}
        completed[number] = truth(row.get("completed", ""))
    return values, completed, wrong


def _finite(text: str, name: str, line: int, wrong: list[str]) -> float | None:
    value = as_number(text)
    if value is None:
        wrong.append(f"log.csv line {line}: {name} is {text[:40]!r}; no value")
    return value
