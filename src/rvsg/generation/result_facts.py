"""Facts of a result for prompts: what runs showed, the table of a run, and configurations as answers have them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rvsg.generation.generator import Rehearsal
from rvsg.generation.people_sampler import added
from rvsg.generation.reply_json import TUNABLE
from rvsg.scenario.brief import Feedback, Passing, Row, Stop, Tried
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Attention, Human, HumanConfiguration, Mission, PersonKind, Scenario
from rvsg.world.grid import Grid
from rvsg.world.world import SolidObject

LONGEST_SERIES = 120
LONGEST_ANALYSIS = 800
"""Characters of an analysis that are told back: its end, which says what was changed and why."""
Pass = tuple[float, float]
"""First and last time, in seconds."""
RELIABLE_RUNS = 5
"""A configuration that fails in fewer runs is to fail reliably first, before it is to get by with less."""
MOST_ROWS, FEWER_ROWS, BRIEF_BELOW = 14, 6, 10
"""Lines of the table of a run, of that of a second configuration, and from how few on all else gets shorter, too."""
SEEN_M, POSITION_M = 6.0, 5.0
"""People farther from the robot than this are left out of a line, and their positions from this distance on."""
NEAR_M, ROW_S, LATE_S = 2.0, 2.0, 0.2

TOLD_AS_MEASURED = frozenset(
    {
        *("parts", "arrival_s", "arrived", "touched", "touches", "touches_elsewhere", "unusual"),
        *("best_mean", "best_runs", "tuned", "capped", "mildest", "unusual_runs", "untried"),
        *("objectives", "mean", "violation_share"),
        *("previous_mean", "influences", "series_of", "reactions", "least_room"),
    }
)


def feedback_facts(
    feedback: Feedback,
    requirement: Requirement | None,
    passes: Mapping[str, Pass],
    most_rows: int = MOST_ROWS,
    *,
    mission: Mission | None = None,
) -> dict[str, Any]:
    """Return a result as prompts tell it; `passes` tells when the robot passes which waypoint without people.

    Args:
        mission: That of the campaign, whose moved objects are not the generator's.
    """
    worse, limit = (requirement.worse, requirement.threshold) if requirement else ("smaller", None)
    previous, runs, people = feedback.previous_mean, len(feedback.objectives), feedback.scenario.people
    share = feedback.violation_share
    standing = feedback.standing or Tried(
        mean=feedback.mean,
        change="",
        runs=runs,
        violations=None if share is None else round(share * runs),
        objectives=feedback.objectives,
    )
    begins = {human.name: human.tasks[0].path[0] for human in people.humans}
    rows, shown = _rows(feedback, passes)
    brief = most_rows < BRIEF_BELOW
    fewer = 0 if brief else FEWER_ROWS
    weaker = None
    if feedback.weaker:
        weaker = feedback_facts(feedback.weaker, requirement, passes, fewer, mission=mission)
    return {
        "standing": _standing(standing),
        "beyond": None if limit is None else (limit - standing.mean) * (1 if worse == "smaller" else -1),
        "stage": _stage(feedback, standing),
        "failing": _failing(feedback, standing),
        "enough_runs": RELIABLE_RUNS,
        "less": _less(feedback),
        "runs": runs,
        "mildest_parts": [part.model_dump() for part in feedback.mildest_parts],
        "separable": bool(feedback.separable),
        "better": previous is not None
        and (feedback.mean < previous if worse == "smaller" else feedback.mean > previous),
        "moments": [
            moment.model_dump(mode="json") | {"humans_at": [{"name": n, "at": a} for n, a in moment.humans_at.items()]}
            for moment in feedback.moments
        ],
        **{"unusual": "", "unusual_runs": 0, "untried": [], "reactions": [], "least_room": None},
        **feedback.model_dump(mode="json", include=set(TOLD_AS_MEASURED)),
        "tried": [_standing(each) for each in feedback.tried],
        "tuning": _tuning(feedback),
        "ended": _ended(feedback),
        "rows": _fewer(rows, most_rows),
        "left_out": max(0, len(rows) - most_rows),
        "mildest_rows": _mild_rows(feedback, passes, fewer),
        "change_characters": 160 if not brief else 80 if most_rows > FEWER_ROWS else 40,
        "stops_between": [_stop(stop) for k, stop in enumerate(feedback.stops) if k not in shown],
        "currency": _currency(feedback, requirement, passes),
        "arrivals": {human.name: own for human in people.humans if (own := _arrivals(human, feedback))},
        "missed": [
            {"name": name, "at": at, "time_s": time}
            for name, moments in feedback.planned.items()
            for at, time in moments.items()
            if at != begins.get(name) and at not in {arrival.at for arrival in feedback.arrivals.get(name, ())}
        ],
        "passings": [
            p.model_dump(mode="json") for p in feedback.passings if p in _closest(feedback, 2 if brief else 4)
        ],
        "weaker": weaker,
        "behind_by_chance": feedback.weaker is not None and _within_chance(standing, feedback.weaker.standing),
        "configuration": _told_configuration(feedback.scenario, mission),
        "best": _told_configuration(feedback.best, mission) if feedback.best else None,
        "series": [sample.model_dump(mode="json") for sample in feedback.series[:LONGEST_SERIES]],
    }


def _standing(tried: Tried) -> dict[str, Any]:
    """Return a measured configuration with everything that may be missing in its record."""
    empty = {"number": None, "made_from": None, "estimate": None, "margin": None, "repeats": 0}
    return {**empty, "objectives": [], "rehearsed": [], **tried.model_dump(mode="json")}


def _tuning(feedback: Feedback) -> dict[str, Any] | None:
    tuning = feedback.tuning
    if tuning is None:
        return None
    origin = tuning.origin or Tried(mean=tuning.mean, change="", runs=tuning.runs)
    return tuning.model_dump(mode="json") | {"origin": _standing(origin)}


def _within_chance(first: Tried, second: Tried | None) -> bool:
    """Whether the intervals of two estimates overlap; so do those of estimates that are not known."""
    known = [(e.estimate, e.margin) for e in (first, second) if e and e.estimate is not None and e.margin is not None]
    if len(known) < 2:
        return True
    (one, margin), (other, another) = known
    return abs(one - other) <= margin + another


def _stage(feedback: Feedback, standing: Tried) -> str:
    """Return what to ask for next: `worse` values, failing in `every` run, or the same with `less`."""
    failing = _failing(feedback, standing)
    if not failing:
        return "worse"
    if failing < standing.runs or standing.runs < RELIABLE_RUNS:
        return "every"
    return "less" if feedback.capped == len(feedback.objectives) else "worse"


def _failing(feedback: Feedback, standing: Tried) -> int:
    """Return how many runs violate the requirement or end at the time limit that sets the value."""
    return max(standing.violations or 0, feedback.capped)


def _mild_rows(feedback: Feedback, passes: Mapping[str, Pass], most: int) -> list[dict[str, Any]]:
    """Return the lines of the mildest run that are told."""
    run = feedback.model_copy(update={"rows": feedback.mildest_rows, "stops": ()})
    return _fewer(_rows(run, passes)[0], most) if most else []


def _ended(feedback: Feedback) -> dict[str, list[float]]:
    """Return when the robot arrived, when its navigation gave up, and the runs that the time limit ended, s."""
    found: dict[str, list[float]] = {"arrived": [], "gave_up": [], "timed_out": []}
    for time, arrived in feedback.ends:
        late = time >= feedback.scenario.mission.route.time_limit_s - LATE_S
        found["arrived" if arrived else "timed_out" if late else "gave_up"].append(time)
    return found


def _told_configuration(scenario: Scenario, mission: Mission | None) -> Any:
    """The configuration of a scenario with the objects that it adds to those of the campaign."""
    return configuration_object(scenario.people, moved=added(mission, scenario.mission) if mission is not None else ())


def _less(feedback: Feedback) -> dict[str, Any] | None:
    """Return what a smaller configuration has less of, in the run that is worst for the robot; None without a table.

    The event is the longest stop of the robot, else the smallest gap: what people do later does not count.
    """
    stops = [(stop.until_s - stop.time_s, -stop.time_s) for stop in feedback.stops]
    gaps = [(-each.gap_m, -each.time_s) for each in feedback.passings]
    if not feedback.rows or not (stops or gaps):
        return None
    event_s = -max(stops or gaps)[1]
    before = [person.doing for row in feedback.rows if row.time_s < event_s for person in row.people.values()]
    return {
        "event_s": event_s,
        "stands": bool(stops),
        "near": sum(each.closest_gap_m <= NEAR_M for each in feedback.influences),
        "reacting": len({each.who for each in feedback.reactions}),
        "standing_s": before.count("waiting to start") * ROW_S + before.count("pausing") * ROW_S,
    }


def _rows(run: Feedback | Rehearsal, passes: Mapping[str, Pass]) -> tuple[list[dict[str, Any]], set[int]]:
    """Return the lines of the table, equal ones in a row joined, and the stops that they show.

    People who come within `SEEN_M` in none of them have no column.
    """
    lines: list[dict[str, Any]] = []
    shown = set[int]()
    seen = {name for row in run.rows for name, each in row.people.items() if each.distance_m <= SEEN_M}
    for row in run.rows:
        stop = next((k for k, s in enumerate(run.stops) if s.time_s <= row.time_s <= s.until_s), None)
        line = _row(row, passes) | {"stop": _stop(run.stops[stop]) if stop is not None else None}
        line["people"] = {name: each for name, each in line["people"].items() if name in seen}
        same = (row.robot_at, stop, [(p["far"], p["at"], p["doing"]) for p in line["people"].values()])
        if lines and lines[-1]["same"] == same:
            lines[-1]["until_s"] = row.time_s
        else:
            lines.append(line | {"same": same})
        shown |= {stop} if stop is not None else set()
    return lines, shown


def _stop(stop: Stop) -> dict[str, Any]:
    return {"because": "", **stop.model_dump(mode="json")}


def _currency(
    feedback: Feedback, requirement: Requirement | None, passes: Mapping[str, Pass]
) -> tuple[str, dict[str, float]] | None:
    """Return where the value is lost in the run that is worst for the robot, by person; None: not known.

    Of a time, the seconds (`lost`) by who was nearest within 2 m while they were lost; "nobody" for the rest. Of a
    distance, the percentage of the drive (`nearest`) that each person was the nearest for.
    """
    unit, rows = requirement.unit if requirement else "", [row for row in feedback.rows if row.people]
    found: dict[str, float] = {}
    if unit == "m" and rows:
        for row in rows:
            who = min(row.people, key=lambda name: row.people[name].distance_m)
            found[who] = found.get(who, 0.0) + 100.0 / len(rows)
        return "nearest", found
    if unit != "s" or not passes:
        return None
    behind = 0.0
    for row in rows:
        now = _row(row, passes)["behind_s"]
        if now is None or now <= behind:
            continue
        who = min(row.people, key=lambda name: row.people[name].distance_m)
        who = who if row.people[who].distance_m <= NEAR_M else "nobody"
        found[who] = found.get(who, 0.0) + now - behind
        behind = now
    return ("lost", found) if found else None


def _fewer(rows: list[dict[str, Any]], most: int) -> list[dict[str, Any]]:
    """Return so many lines: those in which the robot stands, then those in which somebody is nearest."""

    def interest(row: dict[str, Any]) -> tuple[bool, float]:
        return row["stop"] is None, min((p["distance_m"] for p in row["people"].values()), default=math.inf)

    kept = sorted(rows, key=interest)[:most]
    return sorted(kept, key=lambda row: float(row["time_s"]))


def _closest(feedback: Feedback, count: int) -> list[Passing]:
    return sorted(feedback.passings, key=lambda each: each.gap_m)[:count]


def _arrivals(human: Human, feedback: Feedback) -> list[dict[str, Any]]:
    """Return a person's first arrivals where they planned to be, in order."""
    planned = feedback.planned.get(human.name, {})
    first = {arrival.at: arrival for arrival in reversed(feedback.arrivals.get(human.name, ()))}
    found = [arrival.model_dump() | {"planned_s": planned[at]} for at, arrival in first.items() if at in planned]
    return sorted(found, key=lambda arrival: float(arrival["time_s"]))


def passes_of(undisturbed: Rehearsal | None, grid: Grid) -> dict[str, Pass]:
    """Return when the robot is first and last nearest to each waypoint of its way without people, in seconds."""
    found: dict[str, Pass] = {}
    for time, x, y in undisturbed.way if undisturbed is not None else ():
        name = grid.nearest(x, y)
        found[name] = (found.get(name, (time, time))[0], time)
    return found


def rehearsal_facts(
    rehearsal: Rehearsal,
    passes: Mapping[str, Pass],
    requirement: Requirement | None = None,
    most_rows: int = MOST_ROWS,
) -> dict[str, Any]:
    """A rehearsal as prompts tell it."""
    rows, _ = _rows(rehearsal, passes)
    value = rehearsal.value
    violated = None
    if requirement is not None and requirement.threshold is not None and value is not None:
        violated = requirement.violated_by(value)
    return {
        "arrival_s": rehearsal.arrival_s,
        "rows": _fewer(rows, most_rows),
        "left_out": max(0, len(rows) - most_rows),
        "value": value,
        "unit": requirement.unit if requirement is not None else "",
        "violated": violated,
    }


def _row(row: Row, passes: Mapping[str, Pass]) -> dict[str, Any]:
    """Return a line with how much later than without people the robot is there; None where it never is there then."""
    first, last = passes.get(row.robot_at, (math.nan, math.nan))
    behind = max(0.0, row.time_s - last) + min(0.0, row.time_s - first)
    line = row.model_dump(mode="json")
    line["people"] = {
        name: {**person, "far": person["distance_m"] > SEEN_M, "placed": person["distance_m"] <= POSITION_M}
        for name, person in line["people"].items()
    }
    return line | {"until_s": row.time_s, "behind_s": round(behind) if row.robot_at in passes else None}


def configuration_object(
    people: HumanConfiguration,
    description: str | None = None,
    *,
    rich: bool = True,
    moved: Sequence[SolidObject] = (),
) -> Any:
    """A configuration in the form replies have; without `rich` only names, tasks and paths."""
    humans = []
    for human in people.humans:
        tasks = []
        for task in human.tasks:
            entry: dict[str, Any] = {"task": task.name, "path": list(task.path)}
            if rich and task.pauses:
                entry["pauses"] = [{"at": p.at, "duration_s": p.duration_s} for p in task.pauses]
            tasks.append(entry)
        chosen: dict[str, Any] = {
            "behaviour": human.behaviour.value,
            "speed_m_s": human.speed_m_s,
            "start_delay_s": human.start_delay_s,
        }
        if human.attention is not Attention.ATTENTIVE:
            chosen["attention"] = human.attention.value
        if human.group is not None:
            chosen["group"] = human.group
        if human.kind is not PersonKind.ADULT:
            chosen["kind"] = human.kind.value
        if human.trolley is not None:
            chosen["trolley"] = human.trolley.model_dump(mode="json")
        humans.append({"name": human.name, **(chosen if rich else {}), "tasks": tasks})
    told: dict[str, Any] = {} if description is None else {"description": description}
    told["humans"] = humans
    if moved:
        told["moved"] = []
    for thing in moved:
        (x, y, _), sizes = thing.box.center, zip(("length_m", "width_m", "height_m"), thing.box.size, strict=True)
        told["moved"].append({"name": thing.name, "x": x, "y": y, **dict(sizes), "yaw": thing.box.yaw})
    return told


def answer_object(feedback: Feedback, moved: Sequence[SolidObject] = ()) -> Any:
    """Return the configuration that was simulated as its generator answered it, with the end of its analysis."""
    found = configuration_object(feedback.scenario.people, feedback.scenario.description, moved=moved)
    for human in found["humans"] if feedback.limits else ():
        own = feedback.limits.get(human["name"], {})
        said = {key: f"{span[0]:g} to {span[1]:g}" if span else "fixed" for key, span in own.items()}
        human["tuning"] = dict.fromkeys(TUNABLE, "free") | said
    analysis = feedback.analysis
    if len(analysis) > LONGEST_ANALYSIS:
        end = analysis[-LONGEST_ANALYSIS:]
        begin = end.find(". ") + 2 if ". " in end else end.find(" ") + 1
        analysis = f"... {end[begin:]}"
    return ({"analysis": analysis} if analysis else {}) | found
