"""Reader of a model's reply: from its text to a configuration, leniently; the checker judges it strictly.

The aliases below understand the published study's form (`{"Worker 1 Tasks": [{"Task", "Start", "End", "Path"}]}`) and
what models make of it or of our own. What had to be guessed, cut or put right becomes a Finding that goes back to the
model, and what was done about it a Repair.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

from pydantic import ValidationError

from rvsg.generation.people_sampler import CHILD, MOVED, TROLLEY, WHEELCHAIR, box
from rvsg.generation.reply_json import TUNABLE, Found, find_json, number_of
from rvsg.scenario.brief import TuningLimits
from rvsg.scenario.rules import SPEED_RANGE_M_S, Finding, Repair
from rvsg.scenario.scenario import (
    LIMITS,
    TROLLEY_LENGTHS_M,
    TROLLEY_WIDTHS_M,
    Attention,
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
MAX_TASKS = 60
MAX_PATH = 400
MAX_GROUP = 1000
NAME_CHARACTERS = 120
TEXT_CHARACTERS = 20_000
LONGEST_S = 600.0
LONGEST_DELAY_S = 10.0
"""Nobody waits longer for their work to begin: a generated scenario needs no idle people in the way."""
LESSON_CHARACTERS = 400
"""Longest lesson in characters; every later prompt repeats it."""

_ALIASES = {
    "humans": ("humans", "people", "persons", "workers", "agents", "pedestrians", "human_tasks"),
    "tasks": ("tasks", "task_list", "tasklist", "task_sequence", "schedule", "activities"),
    "name": ("name", "human", "person", "worker", "id", "agent"),
    "task": ("task", "name", "title", "label", "activity"),
    "path": ("path", "waypoints", "waypoint_path", "full_path", "full_waypoint_path", "route", "points"),
    "waypoint": ("waypoint", "name", "at"),
    "from": ("from", "start_area", "from_area", "source"),
    "to": ("to", "end_area", "to_area", "destination", "target"),
    "start": ("start", "start_waypoint"),
    "end": ("end", "end_waypoint", "goal"),
    "pauses": ("pauses", "pause", "stops", "waits"),
    "at": ("at", "waypoint", "where"),
    "duration_s": ("duration_s", "duration", "seconds", "s"),
    "speed_m_s": ("speed_m_s", "speed", "walking_speed", "walking_speed_m_s", "max_speed"),
    "start_delay_s": ("start_delay_s", "start_delay", "delay", "delay_s"),
    "behaviour": ("behaviour", "behavior"),
    "attention": ("attention", "attentiveness"),
    "description": ("description", "scenario", "scenario_description"),
    "lesson": ("lesson", "lessons", "lesson_learnt", "lessons_learned"),
    "analysis": ("analysis", "reasoning", "thoughts", "explanation"),
}
"""The names models give to our keys where no schema holds them to ours."""
_OF_PERSON = ("name", "tasks", "speed_m_s", "start_delay_s", "behaviour", "attention")
_KNOWN_HUMAN = {
    *(alias for key in _OF_PERSON for alias in _ALIASES[key]),
    "group",
    "role",
    "start",
    "note",
    "plan",
    "tuning",
}
_STUDY_KEY = re.compile(
    r"^\s*((?:worker|human|person|agent|pedestrian)\s*_?\s*\w+?)[\s_]*(?:tasks?)?\s*$", re.IGNORECASE
)
_BETWEEN = re.compile(r"\s*(?:→|⟶|➔|➜|⇒|-+>|=+>|,|;|\||\s)\s*")

_SPAN = re.compile(r"(\d+(?:\.\d+)?)\s*(?:to|-|–)\s*(\d+(?:\.\d+)?)(?:\s*(?:s|m/s))?")

Choice = TypeVar("Choice", Attention, Behaviour)


@dataclass(frozen=True, kw_only=True)
class Reply:
    """What was understood of a reply; `people` is None without a configuration.

    `findings` are the reader's own, `repairs` what it put right for `people`; `fatal`: nothing is left to simulate.
    """

    people: HumanConfiguration | None = None
    description: str = ""
    analysis: str = ""
    lesson: str = ""
    plan: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """When each person is planned to be at which waypoint (s)."""
    limits: TuningLimits = field(default_factory=dict)
    """What an optimiser may not change of each person, and within which range it may."""
    moved: tuple[SolidObject, ...] | None = None
    """Objects moved into the world; None where nothing is said of any."""
    findings: tuple[Finding, ...] = ()
    repairs: tuple[Repair, ...] = ()
    complete: bool = True
    """Whether the JSON ends before the answer does; if not, the answer was cut off."""
    repaired_json: bool = False
    """Whether the JSON was malformed."""
    fatal: bool = False


def read_configuration(
    text: str, names: Sequence[str] | None = None, *, actors: Sequence[str] = (), lidar_height_m: float = 0.21
) -> Reply:
    """Return the last configuration in a reply, of the humans `names` that were asked for in order; None: any number.

    `actors` are those of the world, and `lidar_height_m` says what a lidar sees of moved objects.
    """
    found = find_json(text)
    for source in reversed(found):
        if (located := _people(source.value)) is not None:
            break
    else:
        return _unread(text, found)
    people, holder = located
    reader = _Reader(actors)
    humans = [human for name, value in people if (human := reader.human(name, value)) is not None]
    moved = reader.moved(holder, lidar_height_m)
    if not source.complete:
        reason = "the answer ends before its JSON does; what stands there is what was read."
        reader.note("reply-cut-off", reason, "Answer with the whole object, more briefly.")
    humans, missing = (humans, False) if names is None else reader.counted(humans, names)
    return Reply(
        people=HumanConfiguration(humans=tuple(humans)) if humans else None,
        description=_text(holder, "description"),
        analysis=_text(holder, "analysis") or _prose(text, found),
        lesson=" ".join(_text(holder, "lesson").split())[:LESSON_CHARACTERS],
        plan=_plan_of(people),
        limits=_limits_of(people, reader),
        moved=moved,
        findings=tuple(reader.findings),
        repairs=tuple(reader.repairs),
        complete=source.complete,
        repaired_json=source.repaired,
        fatal=missing or not humans,
    )


def read_description(text: str) -> str:
    """The scenario's description in a reply to P1 or P2; empty where there is none."""
    return next((described for value in _objects(text) if (described := _text(value, "description"))), "")


def read_object(text: str, keys: Sequence[str]) -> dict[str, str] | None:
    """The last object of a reply that has a text under every one of `keys`; None where there is none."""
    read = ({key: _text(value, key) for key in keys} for value in _objects(text))
    return next((texts for texts in read if all(texts.values())), None)


def _objects(text: str) -> Iterator[dict[Any, Any]]:
    """Yield the JSON objects of a reply, the last one first."""
    return (found.value for found in reversed(find_json(text)) if isinstance(found.value, dict))


def read_path_lines(text: str, names: Sequence[str]) -> HumanConfiguration | None:
    """Return the tasks in the lines `human | task | waypoints` of a reply to P4, P5 or P6; the last list of each human.

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
        name, path = wanted[parts[0].casefold()], _path(parts[2])
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


def _people(value: Any, depth: int = 0) -> tuple[_People, Mapping[str, Any]] | None:
    """The humans in a value with the names of their keys, and the object that holds them."""
    if isinstance(value, list):
        humans = [v for v in value if isinstance(v, dict) and _get(v, "tasks") is not None]
        return ([(None, h) for h in humans], {}) if humans else None
    if not isinstance(value, dict) or depth > 3:
        return None
    people = _get(value, "humans")
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
    if _get(value, "tasks") is not None:
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
        value = found[-1].value
        keys = ", ".join(str(key)[:40] for key in list(value)[:8]) or "none"
        has = f"the keys {keys}" if isinstance(value, dict) else "a list"
        reason = f"the answer holds JSON, but no humans with tasks (it has {has})."
    else:
        reason = f"the answer holds no JSON; it begins {' '.join(text.split())[:120]!r}."
    finding = Finding.of("unreadable-reply", reason, "Answer with the JSON object alone.")
    return Reply(findings=(finding,), analysis=text.strip()[:TEXT_CHARACTERS], fatal=True)


def _plan_of(people: _People) -> dict[str, dict[str, float]]:
    """The planned moments of everybody; what cannot be read as one is left out: a plan decides nothing."""
    plans: dict[str, dict[str, float]] = {}
    for name, value in people:
        listed = value.get("plan") if isinstance(value, dict) else None
        for moment in listed[:MAX_TASKS] if isinstance(listed, list) else ():
            given = moment if isinstance(moment, dict) else {}
            at, time = _scalar(given.get("at")).strip(), number_of(given.get("time_s"))
            if at and time is not None and 0.0 <= time <= LONGEST_S:
                plans.setdefault(_name(name, value)[:NAME_CHARACTERS], {}).setdefault(at, time)
    return plans


def _limits_of(people: _People, reader: _Reader) -> TuningLimits:
    """Return what of each person is fixed, or free within a range only; what cannot be read is free, and noted."""
    limits: TuningLimits = {}
    for name, value in people:
        given, who = (value.get("tuning") if isinstance(value, dict) else None), _name(name, value)[:NAME_CHARACTERS]
        for key, said in given.items() if isinstance(given, dict) else ():
            text = _scalar(said).casefold()
            span = _SPAN.fullmatch(text) if key in TUNABLE[:3] else None
            if key in TUNABLE and text == "fixed":
                limits.setdefault(who, {})[key] = None
            elif span is not None and float(span[1]) <= float(span[2]):
                limits.setdefault(who, {})[key] = (float(span[1]), float(span[2]))
            elif text not in ("", "free"):
                reader.of = {"human": who}
                reader.repaired(f'"tuning" of {str(key)[:40]}, {text[:40]!r}, is not fixed and no range: it stays free')
    return limits


# -- reading it ------------------------------------------------------------------------------------


class _Reader:
    """Reads people and moved objects; notes what is wrong with them, and what it put right."""

    def __init__(self, actors: Sequence[str]) -> None:
        self.actors = actors
        self.findings: list[Finding] = []
        self.repairs: list[Repair] = []
        self.of: dict[str, str] = {}
        """The person and the task that are being read."""

    def note(self, rule: str, reason: str, suggestion: str = "", repair: str = "") -> None:
        self.findings.append(Finding.of(rule, reason, suggestion, **self.of))
        if repair:
            self.repaired(repair)

    def repaired(self, what: str) -> None:
        self.repairs.append(Repair(**{"human": "", "task": "", **self.of}, what=what, before=(), after=()))

    def human(self, name: str | None, value: Any) -> Human | None:
        self.of = {}
        if isinstance(value, list):
            value = {"tasks": value}
        if not isinstance(value, dict):
            self.note("bad-human", f"a human must be an object with tasks, got {_shown(value)}.")
            return None
        whole = _name(name, value)
        name = whole[:NAME_CHARACTERS]
        self.of = {"human": name}
        if name != whole:
            self.repaired("a name was shortened")
        listed = _get(value, "tasks")
        if isinstance(listed, dict):
            listed = [v if isinstance(v, dict) else {"task": k, "path": v} for k, v in listed.items()]
        if not isinstance(listed, list) or not listed:
            self.note("no-tasks", "has no tasks.", "Give a list of tasks.")
            return None
        if len(listed) > MAX_TASKS:
            reason = f"has {len(listed)} tasks; at most {MAX_TASKS} make sense."
            self.note("too-many-tasks", reason, repair=f"the tasks after the {MAX_TASKS}th were left out")
        tasks = [task for each in listed[:MAX_TASKS] if (task := self._task(each)) is not None]
        if not tasks:
            return None
        known = _KNOWN_HUMAN | {TROLLEY} & {*self.actors} | ({"kind"} if self._kinds() else set())
        for key in value:
            if str(key).casefold() not in known:
                self.repaired(f'the key "{str(key)[:40]}" means nothing here and was left out')
        more = self._actor(value)
        usual = LIMITS[more["kind"]].speed_m_s if "kind" in more else 1.5
        return Human(
            name=name,
            tasks=tuple(tasks),
            behaviour=self._choice(value, "behaviour", Behaviour.REGULAR),
            attention=self._choice(value, "attention", Attention.ATTENTIVE),
            speed_m_s=self._in_range(value, "speed_m_s", SPEED_RANGE_M_S, usual),
            start_delay_s=self._in_range(value, "start_delay_s", (0.0, LONGEST_DELAY_S), 0.0),
            group=self._group(_get(value, "group")),
            **more,
        )

    def _task(self, value: Any) -> Task | None:
        if isinstance(value, (str, list)):
            value = {"path": value}
        if not isinstance(value, dict):
            self.note("bad-task", f"a task must be an object with a path, got {_shown(value)}.")
            return None
        start, end = (_scalar(_get(value, key))[:NAME_CHARACTERS] for key in ("from", "to"))
        name = _scalar(_get(value, "task")) or (f"{start} → {end}" if start and end else "task")
        name = name[:NAME_CHARACTERS]
        before, self.of = self.of, {**self.of, "task": name}
        path = _path(_get(value, "path"))
        if not path and (path := tuple(filter(None, (_scalar(_get(value, key)) for key in ("start", "end"))))):
            repair = "its path was taken to be from its start to its end"
            self.note("missing-path", "has no path.", "Give all waypoints.", repair)
        if len(path) > MAX_PATH:
            reason = f"the path has {len(path)} waypoints; at most {MAX_PATH}."
            self.note("long-path", reason, repair=f"the path was cut after {MAX_PATH} waypoints")
        areas = {"start_area": start or None, "end_area": end or None}
        task = Task(name=name, path=path[:MAX_PATH], **areas, pauses=self._pauses(_get(value, "pauses")))
        self.of = before
        return task

    def _pauses(self, value: Any) -> tuple[Pause, ...]:
        if isinstance(value, dict):
            value = [value] if _get(value, "at") else [{"at": k, "duration_s": v} for k, v in value.items()]
        pauses: list[Pause] = []
        for item in value if isinstance(value, list) else []:
            at, seconds = _scalar(_get(item, "at")), number_of(_get(item, "duration_s"))
            if not at or seconds is None:
                reason = f"a pause needs a waypoint and seconds, got {_shown(item)}."
                self.note("bad-pause", reason, repair="a pause without place or duration was left out")
            elif seconds > 0:
                if seconds > LONGEST_S:
                    reason = f"a pause of {seconds:g} s is longer than {LONGEST_S:g} s."
                    self.note("long-pause", reason, repair=f"the pause at {at} was cut to {LONGEST_S:g} s")
                pauses.append(Pause(at=at[:40], duration_s=min(seconds, LONGEST_S)))
        return tuple(pauses)

    def _kinds(self) -> list[str]:
        return [kind for kind in (CHILD, WHEELCHAIR) if kind in self.actors]

    def _actor(self, value: Mapping[str, Any]) -> dict[str, Any]:
        """The fields of a person that only some worlds allow: kind, radius, trolley."""
        found: dict[str, Any] = {}
        kind, kinds = value.get("kind"), self._kinds()
        if kind in kinds:
            found |= {"kind": PersonKind(kind), "radius_m": LIMITS[PersonKind(kind)].radius_m}
        elif kinds and kind not in (None, "", PersonKind.ADULT.value):
            better = f"Take one of adult, {', '.join(kinds)}."
            self.note("unknown-kind", f'"kind" is {str(kind)[:40]!r}.', better)
        pushed = value.get("trolley")
        if TROLLEY in self.actors and pushed is not None and pushed is not False:
            try:
                found["trolley"] = Trolley.model_validate({} if pushed is True else pushed)
            except ValidationError:
                (short, long), (thin, wide) = TROLLEY_LENGTHS_M, TROLLEY_WIDTHS_M
                sizes = f'Give {{"length_m": {short:g} to {long:g}, "width_m": {thin:g} to {wide:g}}}.'
                self.note("bad-trolley", "the trolley has no size that a trolley has.", sizes)
        return found

    def _choice(self, person: Mapping[str, Any], key: str, usual: Choice) -> Choice:
        """Return the behaviour or the attention of a person; the usual one where there is none of that name."""
        text = _scalar(_get(person, key)).casefold()
        known = {each.value: each for each in type(usual)}
        if text in known:
            return known[text]
        if text not in ("", "none", "null"):
            reason, better = f'there is no {key} "{text[:40]}".', f"Choose one of {', '.join(known)}."
            self.note(f"unknown-{key}", reason, better, f'{key} "{text[:40]}" became {usual.value}')
        return usual

    def _in_range(self, person: Any, key: str, limits: tuple[float, float], usual: float) -> float:
        what, unit, rule = ("the speed", "m/s", "speed") if key == "speed_m_s" else ("the start delay", "s", "delay")
        value = _get(person, key)
        if value is None:
            return usual
        number = number_of(value)
        if number is None:
            reason = f"{what} must be a number in {unit}, got {_shown(value)}."
            self.note("not-a-number", reason, repair=f"{what} became {usual:g} {unit}")
            return usual
        inside = min(max(number, limits[0]), limits[1])
        if inside != number:
            reason = f"{what} of {number:g} {unit} is outside {limits[0]:g} to {limits[1]:g}."
            self.note(f"{rule}-out-of-range", reason, repair=f"{what} of {number:g} {unit} became {inside:g}")
        return inside

    def _group(self, value: Any) -> int | None:
        number = number_of(value)
        if number is None and value not in (None, "", "none", "null"):
            self.note("bad-group", f"a group is a whole number, got {_shown(value)}.", repair="left the group")
        if number is not None and number > MAX_GROUP:
            self.note("bad-group", f"a group is a small whole number, got {_shown(value)}.", repair="left the group")
        return int(number) if number is not None and 0 <= number <= MAX_GROUP else None

    def counted(self, humans: list[Human], names: Sequence[str]) -> tuple[list[Human], bool]:
        """The humans that were asked for, under their names; whether some are missing."""
        asked = ", ".join(names)
        for extra in humans[len(names) :]:
            self.of = {"human": extra.name}
            reason, repair = f"only {len(names)} were asked for ({asked}).", "left out: one more than were asked for"
            self.note("extra-human", reason, "Leave this one out.", repair)
        self.of = {}
        kept = humans[: len(names)]
        if len(kept) < len(names):
            reason = f"{len(names)} humans were asked for ({asked}), the answer has {len(kept)}."
            self.note("missing-human", reason, f"Add {', '.join(names[len(kept) :])}.")
            return kept, True
        return [h if h.name == n else h.model_copy(update={"name": n}) for h, n in zip(kept, names, strict=True)], False

    def moved(self, holder: Mapping[str, Any], lidar_height_m: float) -> tuple[SolidObject, ...] | None:
        """The objects that a reply moves; None where it says nothing of any."""
        self.of = {}
        listed = holder.get("moved")
        if MOVED not in self.actors or listed is None:
            return None
        entries = listed if isinstance(listed, list) else [listed]
        if len(entries) > MOST_MOVED:
            reason = f"{len(entries)} objects are moved; at most {MOST_MOVED} count."
            self.note("too-many-moved", reason, "Leave some out.")
        found: list[SolidObject] = []
        for number, entry in enumerate(entries[:MOST_MOVED], start=1):
            given = entry if isinstance(entry, dict) else {}
            x, y = number_of(given.get("x")), number_of(given.get("y"))
            if x is None or y is None or max(abs(x), abs(y)) > FARTHEST_M:
                reason = f"object {number} of moved has no x and y in metres."
                self.note("bad-moved-object", reason, "Give both as numbers.")
                continue
            sizes = []
            for key, (low, high, usual) in SIZES_M.items():
                value = number_of(given.get(key))
                sizes.append(usual if value is None else min(high, max(low, value)))
            yaw = round(math.remainder(number_of(given.get("yaw")) or 0.0, 2.0 * math.pi), 3)
            name = " ".join(str(given.get("name") or "").split())[:60] or f"object {number}"
            found.append(box(name, (round(x, 3), round(y, 3)), (sizes[0], sizes[1], sizes[2]), yaw, lidar_height_m))
        return tuple(found)


def _path(value: Any) -> tuple[str, ...]:
    """Waypoint names as they stand, from a list or from a text such as `G7 → G8 → G9`."""
    if isinstance(value, str):
        value = [part for part in _BETWEEN.split(value.strip().strip("[]()")) if part]
    if not isinstance(value, list):
        return ()
    names = [_get(item, "waypoint") if isinstance(item, dict) else item for item in value]
    return tuple(text[:40] for text in (_scalar(name).strip("\"'` ") for name in names) if text)


def _get(value: Any, key: str) -> Any:
    """The value under the first alias of a key, their case, spaces and dashes aside."""
    if not isinstance(value, dict):
        return None
    plain = {re.sub(r"[\s\-]+", "_", str(name).strip().casefold()): item for name, item in value.items()}
    aliases = _ALIASES.get(key, (key,))
    return next((plain[alias] for alias in aliases if plain.get(alias) is not None), None)


def _scalar(value: Any) -> str:
    if isinstance(value, (str, int, float)) and not isinstance(value, bool):
        return " ".join(str(value).split())
    return ""


def _text(value: Mapping[str, Any], key: str) -> str:
    text = _get(dict(value), key)
    return text.strip()[:TEXT_CHARACTERS] if isinstance(text, str) else ""


def _name(name: str | None, person: Any) -> str:
    return " ".join((name or _scalar(_get(person, "name")) or "Human").split()) or "Human"


def _prose(text: str, found: Sequence[Found]) -> str:
    """What a reply says around its JSON."""
    starts, ends = [one.start for one in found], [one.end for one in found]
    around = "".join(text[a:b] for a, b in zip([0, *ends], [*starts, len(text)], strict=True))
    return re.sub(r"```(?:json)?", "", around).strip()[:TEXT_CHARACTERS]


def _shown(value: Any) -> str:
    shown = repr(value)
    return shown if len(shown) <= 60 else shown[:60] + "..."
