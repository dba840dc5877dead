"""Reader of a model's reply: from its text to a configuration, leniently; the checker judges it strictly.

Understood are our own form, the published study's (`{"Worker 1 Tasks": [{"Task", "Start", "End", "Path"}]}`) and
what models make of either: other names for the keys, a wrapping object, a list of humans without one. Whatever had to
be guessed, cut or put right becomes a Finding that goes back to the model, and what was done about it a Repair.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pydantic import ValidationError

from rvsg.generation.people_sampler import CHILD, MOVED, TROLLEY, WHEELCHAIR, box
from rvsg.generation.reply_json import Found, find_json, number_of
from rvsg.scenario.rules import SPEED_RANGE_M_S, Finding, Repair
from rvsg.scenario.scenario import (
    LIMITS,
    TROLLEY_LENGTHS_M,
    TROLLEY_WIDTHS_M,
    Behaviour,
    Human,
    HumanConfiguration,
    Pause,
    PersonKind,
    Task,
    Trolley,
)
from rvsg.world.world import SolidObject

MOST_MOVED = 3
SIZES_M = {"length_m": (0.2, 3.0, 1.2), "width_m": (0.2, 2.0, 0.8), "height_m": (0.1, 2.2, 0.9)}
"""Smallest and largest size of a moved object, and what is taken where nothing is said."""
FARTHEST_M = 10_000.0
Find = Callable[[str, str, str], None]


def known_keys(actors: Sequence[str]) -> set[str]:
    """Return the keys of a person that mean something besides."""
    return ({"trolley"} if TROLLEY in actors else set()) | ({"kind"} if {CHILD, WHEELCHAIR} & set(actors) else set())


def person_of(value: Mapping[str, Any], actors: Sequence[str], find: Find) -> dict[str, Any]:
    """Return the fields of a person that the reply gives: kind, radius, trolley."""
    found: dict[str, Any] = {}
    kind = value.get("kind")
    if kind not in (None, "", PersonKind.ADULT.value) and {CHILD, WHEELCHAIR} & set(actors):
        if kind in (CHILD, WHEELCHAIR) and kind in actors:
            found |= {"kind": PersonKind(kind), "radius_m": LIMITS[PersonKind(kind)].radius_m}
        else:
            allowed = ", ".join(name for name in (CHILD, WHEELCHAIR) if name in actors)
            find("unknown-kind", f'"kind" is {str(kind)[:40]!r}.', f"Take one of adult, {allowed}.")
    pushed = value.get("trolley")
    if TROLLEY in actors and pushed is not None and pushed is not False:
        try:
            found["trolley"] = Trolley.model_validate({} if pushed is True else pushed)
        except ValidationError:
            (short, long), (thin, wide) = TROLLEY_LENGTHS_M, TROLLEY_WIDTHS_M
            sizes = f'Give {{"length_m": {short:g} to {long:g}, "width_m": {thin:g} to {wide:g}}}.'
            find("bad-trolley", "the trolley has no size that a trolley has.", sizes)
    return found


def moved_in(
    holder: Mapping[str, Any], actors: Sequence[str], lidar_height_m: float, find: Find
) -> tuple[SolidObject, ...] | None:
    """Return the objects that a reply moves; None where it says nothing of any."""
    listed = holder.get("moved")
    if MOVED not in actors or listed is None:
        return None
    entries = listed if isinstance(listed, list) else [listed]
    if len(entries) > MOST_MOVED:
        find("too-many-moved", f"{len(entries)} objects are moved; at most {MOST_MOVED} count.", "Leave some out.")
    found: list[SolidObject] = []
    for number, entry in enumerate(entries[:MOST_MOVED], start=1):
        thing = _box(entry, number, lidar_height_m)
        if thing is None:
            find("bad-moved-object", f"object {number} of moved has no x and y in metres.", "Give both as numbers.")
        else:
            found.append(thing)
    return tuple(found)


def _box(entry: Any, number: int, lidar_height_m: float) -> SolidObject | None:
    given = entry if isinstance(entry, dict) else {}
    x, y = number_of(given.get("x")), number_of(given.get("y"))
    if x is None or y is None or max(abs(x), abs(y)) > FARTHEST_M:
        return None
    sizes = []
    for key, (low, high, usual) in SIZES_M.items():
        value = number_of(given.get(key))
        sizes.append(usual if value is None else min(high, max(low, value)))
    yaw = math.remainder(number_of(given.get("yaw")) or 0.0, 2.0 * math.pi)
    name = " ".join(str(given.get("name") or "").split())[:60] or f"object {number}"
    return box(name, (round(x, 3), round(y, 3)), (sizes[0], sizes[1], sizes[2]), round(yaw, 3), lidar_height_m)


MAX_TASKS = 60
MAX_PATH = 400
MAX_GROUP = 1000
NAME_CHARACTERS = 120
TEXT_CHARACTERS = 20_000
LONGEST_S = 600.0
LONGEST_DELAY_S = 10.0
"""Nobody waits longer for their work to begin: a generated scenario needs no idle people in the way."""

_HUMANS = ("humans", "people", "persons", "workers", "agents", "pedestrians", "human_tasks")
_TASKS = ("tasks", "task_list", "tasklist", "task_sequence", "schedule", "activities")
_NAME = ("name", "human", "person", "worker", "id", "agent")
_TASK_NAME = ("task", "name", "title", "label", "activity")
_PATH = ("path", "waypoints", "waypoint_path", "full_path", "full_waypoint_path", "route", "points")
_FROM = ("from", "start_area", "from_area", "source")
_TO = ("to", "end_area", "to_area", "destination", "target")
_START = ("start", "start_waypoint")
_END = ("end", "end_waypoint", "goal")
_PAUSES = ("pauses", "pause", "stops", "waits")
_SPEED = ("speed_m_s", "speed", "walking_speed", "walking_speed_m_s", "max_speed")
_DELAY = ("start_delay_s", "start_delay", "delay", "delay_s")
_DESCRIPTION = ("description", "scenario", "scenario_description")
_LESSON = ("lesson", "lessons", "lesson_learnt", "lessons_learned")
LESSON_CHARACTERS = 400
"""Longest lesson in characters; every later prompt repeats it."""
_ANALYSIS = ("analysis", "reasoning", "thoughts", "explanation")
_KNOWN_HUMAN = {*_NAME, *_TASKS, *_SPEED, *_DELAY, "behaviour", "behavior", "group", "role", "start", "note", "plan"}
_STUDY_KEY = re.compile(
    r"^\s*((?:worker|human|person|agent|pedestrian)\s*_?\s*\w+?)[\s_]*(?:tasks?)?\s*$", re.IGNORECASE
)
_BETWEEN = re.compile(r"\s*(?:→|⟶|➔|➜|⇒|-+>|=+>|,|;|\||\s)\s*")


@dataclass(frozen=True, kw_only=True)
class Reply:
    """What was understood of a reply. `people` is None where there is no configuration in it at all.

    `findings` are the reader's own; the rules of the map are the checker's business. `repairs` are what the reader
    put right by itself for `people`; `fatal` says that the findings leave nothing that could be simulated.
    """

    people: HumanConfiguration | None = None
    description: str = ""
    analysis: str = ""
    lesson: str = ""
    plan: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """When each person is planned to be at which waypoint (s)."""
    moved: tuple[SolidObject, ...] | None = None
    """Objects moved into the world; None where nothing is said of any."""
    findings: tuple[Finding, ...] = ()
    repairs: tuple[Repair, ...] = ()
    complete: bool = True
    """Whether the JSON ends before the answer does; if not, the answer was cut off."""
    repaired_json: bool = False
    """Whether the JSON was malformed."""
    fatal: bool = False


@dataclass
class _Notes:
    findings: list[Finding] = field(default_factory=list)
    repairs: list[Repair] = field(default_factory=list)

    def find(
        self, rule: str, reason: str, suggestion: str = "", human: str | None = None, task: str | None = None
    ) -> None:
        self.findings.append(Finding(rule=rule, human=human, task=task, reason=reason, suggestion=suggestion))

    def repair(self, what: str, human: str = "", task: str = "") -> None:
        self.repairs.append(Repair(human=human, task=task, what=what, before=(), after=()))


def read_configuration(
    text: str, names: Sequence[str] | None = None, *, actors: Sequence[str] = (), lidar_height_m: float = 0.21
) -> Reply:
    """The configuration in a reply. `names` are the humans that were asked for, in order; None: any number.

    `actors` are those of the world, and `lidar_height_m` says what a lidar sees of moved objects.

    Of several configurations in a reply the last one counts: models put the corrected one last.
    """
    found = find_json(text)
    chosen = _chosen(found)
    if chosen is None:
        return _unread(text, found)
    people_value, holder, source = chosen
    notes = _Notes()
    humans = [h for h in (_human(name, value, notes, actors) for name, value in people_value) if h is not None]
    moved = moved_in(holder, actors, lidar_height_m, notes.find)
    if not source.complete:
        notes.find(
            "reply-cut-off",
            "the answer ends before its JSON does; what stands there is what was read.",
            "Answer with the whole object, more briefly.",
        )
    humans, fatal = _counted(humans, names, notes)
    return Reply(
        people=HumanConfiguration(humans=tuple(humans)) if humans else None,
        description=_text(holder, _DESCRIPTION),
        analysis=_text(holder, _ANALYSIS) or _prose(text, found),
        lesson=" ".join(_text(holder, _LESSON).split())[:LESSON_CHARACTERS],
        plan=_plan_of(people_value),
        moved=moved,
        findings=tuple(notes.findings),
        repairs=tuple(notes.repairs),
        complete=source.complete,
        repaired_json=source.repaired,
        fatal=fatal or not humans,
    )


def read_description(text: str) -> str:
    """The scenario's description in a reply to P1 or P2; empty where there is none."""
    for found in reversed(find_json(text)):
        if isinstance(found.value, dict) and (described := _text(found.value, _DESCRIPTION)):
            return described
    return ""


def read_object(text: str, keys: Sequence[str]) -> dict[str, str] | None:
    """The last object of a reply that has a text under every one of `keys`; None where there is none."""
    for found in reversed(find_json(text)):
        if isinstance(found.value, dict):
            texts = {key: _text(found.value, (key,)) for key in keys}
            if all(texts.values()):
                return texts
    return None


def read_path_lines(text: str, names: Sequence[str]) -> HumanConfiguration | None:
    """The tasks in the lines `human | task | waypoints` of a reply to P4, P5 or P6; the last list of each human.

    None where somebody of `names` has no such line: then there is nothing to check yet.
    """
    tasks: dict[str, list[Task]] = {}
    last_block: dict[str, int] = {}
    wanted = {" ".join(name.split()).casefold(): name for name in names}
    block = 0
    for line in text.splitlines():
        parts = [part.strip(" *`-\t") for part in line.strip().strip("|").split("|")]
        if len(parts) != 3 or parts[0].casefold() not in wanted:
            block += bool(line.strip()) and len(parts) != 3
            continue
        name = wanted[parts[0].casefold()]
        path = _path(parts[2])
        if not parts[1] or not path:
            continue
        if last_block.get(name, block) != block:
            tasks[name] = []
        last_block[name] = block
        tasks.setdefault(name, []).append(Task(name=parts[1][:NAME_CHARACTERS], path=path[:MAX_PATH]))
    if not all(tasks.get(name) for name in names):
        return None
    return HumanConfiguration(humans=tuple(Human(name=name, tasks=tuple(tasks[name][:MAX_TASKS])) for name in names))


# -- finding the configuration ---------------------------------------------------------------------

_People = list[tuple[str | None, Any]]


def _chosen(found: Sequence[Found]) -> tuple[_People, Mapping[str, Any], Found] | None:
    for one in reversed(found):
        located = _people(one.value)
        if located is not None:
            return (*located, one)
    return None


def _people(value: Any, depth: int = 0) -> tuple[_People, Mapping[str, Any]] | None:
    """The humans in a value with the names of their keys, and the object that holds them."""
    if isinstance(value, list):
        humans = [v for v in value if isinstance(v, dict) and (_get(v, _TASKS) is not None)]
        return ([(None, h) for h in humans], {}) if humans else None
    if not isinstance(value, dict) or depth > 3:
        return None
    people = _get(value, _HUMANS)
    if isinstance(people, list):
        return [(None, person) for person in people], value
    if isinstance(people, dict):
        return [(str(name), person) for name, person in people.items()], value
    named: _People = []
    for key, item in value.items():
        match = _STUDY_KEY.match(str(key))
        if match and isinstance(item, (list, dict)):
            named.append((" ".join(match[1].replace("_", " ").split()), item))
    if named:
        return named, value
    if _get(value, _TASKS) is not None:
        return [(None, value)], value
    for item in value.values():
        inner = _people(item, depth + 1) if isinstance(item, (dict, list)) else None
        if inner is not None:
            return inner[0], {**value, **inner[1]}
    return None


def _unread(text: str, found: Sequence[Found]) -> Reply:
    if not text.strip():
        reason = "the answer is empty."
    elif found:
        reason = f"the answer holds JSON, but no humans with tasks (it has {_keys_of(found[-1].value)})."
    else:
        shown = " ".join(text.split())
        reason = f"the answer holds no JSON; it begins {shown[:120]!r}."
    finding = Finding(rule="unreadable-reply", reason=reason, suggestion="Answer with the JSON object alone.")
    return Reply(findings=(finding,), analysis=text.strip()[:TEXT_CHARACTERS], fatal=True)


def _keys_of(value: Any) -> str:
    if isinstance(value, dict):
        return "the keys " + (", ".join(str(key)[:40] for key in list(value)[:8]) or "none")
    return "a list"


# -- one human -------------------------------------------------------------------------------------


def _plan_of(people: _People) -> dict[str, dict[str, float]]:
    """The planned moments of everybody; what cannot be read as one is left out: a plan decides nothing."""
    plans: dict[str, dict[str, float]] = {}
    for name, value in people:
        listed = value.get("plan") if isinstance(value, dict) else None
        moments = [m for m in listed[:MAX_TASKS] if isinstance(m, dict)] if isinstance(listed, list) else []
        called = _name(name or _scalar(_get(value, _NAME)) or "Human", _Notes()) if moments else ""
        for moment in moments:
            at, time = _scalar(moment.get("at")).strip(), number_of(moment.get("time_s"))
            if at and time is not None and 0.0 <= time <= LONGEST_S:
                plans.setdefault(called, {}).setdefault(at, time)
    return plans


def _human(name: str | None, value: Any, notes: _Notes, actors: Sequence[str] = ()) -> Human | None:
    if isinstance(value, list):
        value = {"tasks": value}
    if not isinstance(value, dict):
        notes.find("bad-human", f"a human must be an object with tasks, got {_shown(value)}.")
        return None
    name = _name(name or _scalar(_get(value, _NAME)) or "Human", notes)
    listed = _get(value, _TASKS)
    if isinstance(listed, dict):
        listed = [v if isinstance(v, dict) else {"task": k, "path": v} for k, v in listed.items()]
    if not isinstance(listed, list) or not listed:
        notes.find("no-tasks", "has no tasks.", "Give a list of tasks.", human=name)
        return None
    if len(listed) > MAX_TASKS:
        notes.find("too-many-tasks", f"has {len(listed)} tasks; at most {MAX_TASKS} make sense.", human=name)
        notes.repair(f"the tasks after the {MAX_TASKS}th were left out", name)
    tasks = [t for t in (_task(v, name, notes) for v in listed[:MAX_TASKS]) if t is not None]
    if not tasks:
        return None
    for key in value:
        if str(key).casefold() not in _KNOWN_HUMAN | known_keys(actors):
            notes.repair(f'the key "{str(key)[:40]}" means nothing here and was left out', name)
    more = person_of(value, actors, lambda rule, why, how: notes.find(rule, why, how, human=name))
    usual = LIMITS[more["kind"]].speed_m_s if "kind" in more else 1.5
    return Human(
        name=name,
        tasks=tuple(tasks),
        behaviour=_behaviour(_get(value, ("behaviour", "behavior")), name, notes),
        speed_m_s=_in_range(_get(value, _SPEED), SPEED_RANGE_M_S, usual, "the speed", "m/s", name, notes),
        start_delay_s=_in_range(_get(value, _DELAY), (0.0, LONGEST_DELAY_S), 0.0, "the start delay", "s", name, notes),
        group=_group(_get(value, ("group",)), name, notes),
        **more,
    )


def _counted(humans: list[Human], names: Sequence[str] | None, notes: _Notes) -> tuple[list[Human], bool]:
    """The humans that were asked for, under their names; whether some are missing."""
    if names is None:
        return humans, False
    asked = ", ".join(names)
    for extra in humans[len(names) :]:
        notes.find(
            "extra-human", f"only {len(names)} were asked for ({asked}).", "Leave this one out.", human=extra.name
        )
        notes.repair("left out: one more than were asked for", extra.name)
    kept = humans[: len(names)]
    if len(kept) < len(names):
        missing = ", ".join(names[len(kept) :])
        notes.find(
            "missing-human",
            f"{len(names)} humans were asked for ({asked}), the answer has {len(kept)}.",
            f"Add {missing}.",
        )
        return kept, True
    return [h if h.name == n else h.model_copy(update={"name": n}) for h, n in zip(kept, names, strict=True)], False


def _task(value: Any, human: str, notes: _Notes) -> Task | None:
    if isinstance(value, (str, list)):
        value = {"path": value}
    if not isinstance(value, dict):
        notes.find("bad-task", f"a task must be an object with a path, got {_shown(value)}.", human=human)
        return None
    start, end = _scalar(_get(value, _FROM)), _scalar(_get(value, _TO))
    name = _scalar(_get(value, _TASK_NAME)) or (f"{start} → {end}" if start and end else "task")
    name = name[:NAME_CHARACTERS]
    path = _path(_get(value, _PATH))
    if not path:
        ends = [_scalar(_get(value, keys)) for keys in (_START, _END)]
        path = tuple(e for e in ends if e)
        if path:
            notes.find("missing-path", "has no path.", "Give all waypoints.", human=human, task=name)
            notes.repair("its path was taken to be from its start to its end", human, name)
    if len(path) > MAX_PATH:
        notes.find("long-path", f"the path has {len(path)} waypoints; at most {MAX_PATH}.", human=human, task=name)
        notes.repair(f"the path was cut after {MAX_PATH} waypoints", human, name)
    return Task(
        name=name,
        path=path[:MAX_PATH],
        start_area=start[:NAME_CHARACTERS] if start else None,
        end_area=end[:NAME_CHARACTERS] if end else None,
        pauses=_pauses(_get(value, _PAUSES), human, name, notes),
    )


def _path(value: Any) -> tuple[str, ...]:
    """Waypoint names as they stand, from a list or from a text such as `G7 → G8 → G9`."""
    if isinstance(value, str):
        value = [part for part in _BETWEEN.split(value.strip().strip("[]()")) if part]
    if not isinstance(value, list):
        return ()
    names = [_get(item, ("waypoint", "name", "at")) if isinstance(item, dict) else item for item in value]
    return tuple(text[:40] for text in (_scalar(name).strip("\"'` ") for name in names) if text)


def _pauses(value: Any, human: str, task: str, notes: _Notes) -> tuple[Pause, ...]:
    if isinstance(value, dict):
        value = [value] if _get(value, ("at", "waypoint")) else [{"at": k, "duration_s": v} for k, v in value.items()]
    pauses: list[Pause] = []
    for item in value if isinstance(value, list) else []:
        at = _scalar(_get(item, ("at", "waypoint", "where"))) if isinstance(item, dict) else ""
        seconds = number_of(_get(item, ("duration_s", "duration", "seconds", "s"))) if isinstance(item, dict) else None
        if not at or seconds is None:
            notes.find(
                "bad-pause", f"a pause needs a waypoint and seconds, got {_shown(item)}.", human=human, task=task
            )
            notes.repair("a pause without place or duration was left out", human, task)
        elif seconds > 0:
            if seconds > LONGEST_S:
                notes.find(
                    "long-pause", f"a pause of {seconds:g} s is longer than {LONGEST_S:g} s.", human=human, task=task
                )
                notes.repair(f"the pause at {at} was cut to {LONGEST_S:g} s", human, task)
            pauses.append(Pause(at=at[:40], duration_s=min(seconds, LONGEST_S)))
    return tuple(pauses)


def _behaviour(value: Any, human: str, notes: _Notes) -> Behaviour:
    text = _scalar(value).casefold()
    if not text or text in ("none", "null"):
        return Behaviour.REGULAR
    try:
        return Behaviour(text)
    except ValueError:
        known = ", ".join(b.value for b in Behaviour)
        notes.find("unknown-behaviour", f'there is no behaviour "{text[:40]}".', f"Choose one of {known}.", human=human)
        notes.repair(f'behaviour "{text[:40]}" became regular', human)
        return Behaviour.REGULAR


def _in_range(
    value: Any, limits: tuple[float, float], default: float, what: str, unit: str, human: str, notes: _Notes
) -> float:
    if value is None:
        return default
    number = number_of(value)
    if number is None:
        notes.find("not-a-number", f"{what} must be a number in {unit}, got {_shown(value)}.", human=human)
        notes.repair(f"{what} became {default:g} {unit}", human)
        return default
    inside = min(max(number, limits[0]), limits[1])
    if inside != number:
        rule = "speed-out-of-range" if unit == "m/s" else "delay-out-of-range"
        notes.find(rule, f"{what} of {number:g} {unit} is outside {limits[0]:g} to {limits[1]:g}.", human=human)
        notes.repair(f"{what} of {number:g} {unit} became {inside:g}", human)
    return inside


def _group(value: Any, human: str, notes: _Notes) -> int | None:
    number = number_of(value)
    if number is None:
        if value not in (None, "", "none", "null"):
            notes.find("bad-group", f"a group is a whole number, got {_shown(value)}.", human=human)
            notes.repair("left the group", human)
        return None
    if number > MAX_GROUP:
        notes.find("bad-group", f"a group is a small whole number, got {_shown(value)}.", human=human)
        notes.repair("left the group", human)
    return int(number) if 0 <= number <= MAX_GROUP else None


# -- small readers ---------------------------------------------------------------------------------


def _get(value: Any, keys: Sequence[str]) -> Any:
    """The value under the first of the keys, their case, spaces and dashes aside."""
    if not isinstance(value, dict):
        return None
    plain = {re.sub(r"[\s\-]+", "_", str(key).strip().casefold()): item for key, item in value.items()}
    return next((plain[key] for key in keys if key in plain and plain[key] is not None), None)


def _scalar(value: Any) -> str:
    if isinstance(value, (str, int, float)) and not isinstance(value, bool):
        return " ".join(str(value).split())
    return ""


def _text(value: Mapping[str, Any], keys: Sequence[str]) -> str:
    text = _get(dict(value), keys)
    return text.strip()[:TEXT_CHARACTERS] if isinstance(text, str) else ""


def _name(name: str, notes: _Notes) -> str:
    short = " ".join(name.split())
    if len(short) > NAME_CHARACTERS:
        notes.repair("a name was shortened", short[:NAME_CHARACTERS])
    return short[:NAME_CHARACTERS] or "Human"


def _prose(text: str, found: Sequence[Found]) -> str:
    """What a reply says around its JSON."""
    out, at = [], 0
    for one in found:
        out.append(text[at : one.start])
        at = one.end
    out.append(text[at:])
    return re.sub(r"```(?:json)?", "", "".join(out)).strip()[:TEXT_CHARACTERS]


def _shown(value: Any) -> str:
    shown = repr(value)
    return shown if len(shown) <= 60 else shown[:60] + "..."
