"""The layout of the published study's results: which folders hold what, and the records in them.

::

    {distance,jerk,reach}/route_R/E/            the guided method: five configurations K of scenario E
    no_req/route_R/E/, random/route_R/E/        the baselines: one configuration per scenario
    {best,worst}_scenario/{req}/route_R/E/      one configuration, run many times
      {req}_MODEL_K.json       tasks and waypoint paths      log_K.csv   one row per half second
      {req}_scenario_MODEL.json  description, task lists     log.csv     one row per run: the logged metrics

Any subset of it is read, and folders of any results kept in the same layout.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from rvsg.core.errors import FileError
from rvsg.core.inputs import parse_json, read_text
from rvsg.core.records import Record
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import ForceFactors, Human, HumanConfiguration, Task
from rvsg.study.study_log import truth

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

_ROUTE = re.compile(r"route_[\w-]+")
_LOG = re.compile(r"log_(\d+)\.csv")
_CONFIGURATION = re.compile(r".+_(\d+)\.json")
_IGNORED = {"replies"}


class ImportFinding(Record):
    """One thing that is not as it should be in the imported files, and what was done about it."""

    file: str
    kind: Literal["log", "configuration", "scenario", "waypoint", "metrics", "layout"]
    message: str


@dataclass(frozen=True)
class Batch:
    """All runs of one scenario folder; `repeats` says that they repeat one configuration."""

    folder: Path
    method: Method
    requirement: str | None
    route: str
    scenario: int

    @property
    def repeats(self) -> bool:
        """Whether the logs are repeats of one configuration and not one run each of several."""
        return self.method in ("best", "worst")


def batches(root: Path, findings: list[ImportFinding]) -> Iterator[Batch]:
    """Every scenario folder under `root`, in a fixed order; folders that fit nowhere are listed in the findings."""
    for top in sorted(path for path in root.iterdir() if path.is_dir()):
        if top.name in REQUIREMENTS:
            yield from _of_routes(top, root, "rvsg", top.name, findings)
        elif top.name in ("no_req", "random"):
            yield from _of_routes(top, root, "unguided" if top.name == "no_req" else "random", None, findings)
        elif top.name in ("best_scenario", "worst_scenario"):
            for folder in sorted(path for path in top.iterdir() if path.is_dir()):
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
    for route in sorted(path for path in folder.iterdir() if path.is_dir()):
        if not _ROUTE.fullmatch(route.name):
            findings.append(_stranger(route, root))
            continue
        for scenario in sorted((p for p in route.iterdir() if p.is_dir()), key=lambda p: (len(p.name), p.name)):
            if scenario.name.isdecimal() and len(scenario.name) < 10:
                yield Batch(scenario, method, requirement, route.name, int(scenario.name))
            else:
                findings.append(_stranger(scenario, root))


def _stranger(folder: Path, root: Path) -> ImportFinding:
    return ImportFinding(
        file=str(folder.relative_to(root)), kind="layout", message="this folder fits nowhere in the layout: left out"
    )


def numbered(folder: Path, what: Literal["log", "configuration"]) -> dict[int, Path]:
    """The logs or the configurations of a scenario folder by their number."""
    pattern = _LOG if what == "log" else _CONFIGURATION
    found = {
        int(match.group(1)): path
        for path in folder.iterdir()
        if (match := pattern.fullmatch(path.name)) and "_scenario_" not in path.name and "_memory_" not in path.name
    }
    return dict(sorted(found.items()))


def read_description(folder: Path) -> tuple[str, str | None]:
    """The description in `*_scenario_*.json`, empty where there is none; and what is wrong with it, if anything."""
    files = sorted(folder.glob("*_scenario_*.json"))
    if not files:
        return "", None
    try:
        value = parse_json(read_text(files[0]), files[0])
    except FileError as error:
        return "", f"{files[0].name}: not readable as JSON ({error.reason}); the description is lost"
    text = value.get("scenario", "") if isinstance(value, dict) else None
    if not isinstance(text, str):
        return "", f"{files[0].name}: its `scenario` is no text; the description is lost"
    return text, None


@dataclass(frozen=True)
class ReadPeople:
    """What a configuration file holds: `people` None where it is no valid configuration, `tasks` as far as legible.

    `odd` are pairs of kind and message of everything that is not as it should be.
    """

    people: HumanConfiguration | None
    tasks: dict[str, list[str]]
    odd: list[tuple[Literal["configuration", "waypoint"], str]]


def read_people(path: Path, known: frozenset[str]) -> ReadPeople:
    """Read a configuration. Unknown waypoint names stay in their paths and are listed.

    The study's own decoder dropped them in silence, so that people walked straight to the next known one.
    """
    read = ReadPeople(None, {}, [])
    try:
        value = parse_json(read_text(path), path)
    except FileError as error:
        read.odd.append(("configuration", f"not readable as JSON ({error.reason}): is the file cut off?"))
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
    found = re.fullmatch(r"Worker (\d{1,3}) Tasks", str(key))
    return found.group(1) if found else None


def _human(listed: Any, number: int, known: frozenset[str], read: ReadPeople) -> Human | None:
    """The human of that number, or None (and why, in `read.odd`) where the file does not hold one."""
    name = f"Human {number}"
    if not isinstance(listed, list) or not all(isinstance(task, dict) for task in listed):
        read.odd.append(("configuration", f"the tasks of {name} are not a list of tasks"))
        return None
    tasks = [_task(task, name, place, known, read) for place, task in enumerate(listed, 1)]
    read.tasks[name] = [task.name for task in tasks]
    if not any(waypoint in known for task in tasks for waypoint in task.path):
        read.odd.append(
            ("configuration", f"{name} has no known waypoint to go to: the logged run cannot be of this configuration")
        )
    if not tasks:
        return None
    return Human(name=name, tasks=tuple(tasks), factors=ForceFactors() if number == 1 else "random_normal")


def _task(value: dict[str, Any], human: str, place: int, known: frozenset[str], read: ReadPeople) -> Task:
    title = str(value.get("Task") or f"task {place}")[:120]
    listed = value.get("Path")
    path = tuple(str(waypoint) for waypoint in listed) if isinstance(listed, list) else ()
    if not path:
        read.odd.append(("waypoint", f'{human}, task "{title}": the path is empty'))
    read.odd.extend(
        ("waypoint", f'{human}, task "{title}", waypoint {number}: there is no waypoint "{waypoint}"; kept')
        for number, waypoint in enumerate(path, 1)
        if waypoint not in known
    )
    return Task(name=title, path=path)


def read_logged(folder: Path) -> tuple[dict[int, dict[str, float | None]], dict[int, bool | None], list[str]]:
    """The rows of `log.csv` by run number, whether each completed, and what is wrong with the file."""
    path = folder / "log.csv"
    if not path.is_file():
        return {}, {}, ["log.csv is missing: there are no logged metrics to compare with"]
    values: dict[int, dict[str, float | None]] = {}
    completed: dict[int, bool | None] = {}
    wrong: list[str] = []
    try:
        rows = list(csv.DictReader(io.StringIO(read_text(path), newline=""), strict=True))
    except (FileError, csv.Error) as error:
        return {}, {}, [f"log.csv cannot be read: {error}"]
    missing = [name for name in LOGGED if rows and name not in rows[0]]
    if missing:
        wrong.append(f"log.csv lacks the columns {', '.join(missing)}")
    for line, row in enumerate(rows, 2):
        tag = str(row.get("experiment_tag") or "").rpartition("_")[2]
        if not tag.isdecimal() or len(tag) > 9 or int(tag) in values:
            wrong.append(f"log.csv line {line}: the experiment_tag is {row.get('experiment_tag')!r}; row left out")
            continue
        values[int(tag)] = {name: _finite(row.get(name), name, line, wrong) for name in LOGGED if name not in missing}
        completed[int(tag)] = truth(str(row.get("completed") or ""))
    return values, completed, wrong


def _finite(text: str | None, name: str, line: int, wrong: list[str]) -> float | None:
    try:
        value = float(text) if text is not None else math.nan
    except ValueError:
        value = math.nan
    if math.isfinite(value):
        return value
    wrong.append(f"log.csv line {line}: {name} is {text!r}; no value")
    return None
