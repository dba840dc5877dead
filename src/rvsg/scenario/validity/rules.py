"""The rules of validity: names, purpose and limits."""

from __future__ import annotations

from dataclasses import dataclass

MAX_HUMANS = 100
"""More people than this in one configuration are refused (Brief allows as many)."""

SPEED_RANGE_M_S = (0.3, 2.0)
"""Walking, not running: an ambling and a fast walk. HuNavSim's sample people walk at up to 1.5 m/s."""

ROBOT_RADIUS_M = 0.35
"""Radius of the disc that stands for a robot known by name only, and for the robot in the study's metrics."""

START_CLEARANCE_M = 0.5
"""Gap that RVSG's generators keep between robot and people at the start: the clearance that ISO 3691-4 requires beside
a driverless truck."""


@dataclass(frozen=True, kw_only=True)
class Rule:
    """A rule of validity: its name in a Finding, what it demands, why, and how a repair fixes a breach.

    A configuration that breaches a `warning` is simulated anyway; `warnings` reports it, `check` does not.
    """

    name: str
    demands: str
    because: str
    repair: str
    warning: bool = False


_TABLE = (
    Rule(
        name="unknown-waypoint",
        demands="Every waypoint of a path is one of the grid's.",
        because="A name that does not exist has no place to walk to; dropping it silently changes the walk.",
        repair="A misspelling with one reading (`e-15` for `E15`) is corrected; any other is left out.",
    ),
    Rule(
        name="invalid-waypoint",
        demands="Every waypoint of a path is one where a person can stand.",
        because="The grid also names points that lie in or too near a shelf, a wall or other solid things.",
        repair="The waypoint is removed from the path.",
    ),
    Rule(
        name="repeated-waypoint",
        demands="A path does not name the same waypoint twice in a row.",
        because="A stop is a pause, which has a duration.",
        repair="The repetition is removed.",
    ),
    Rule(
        name="not-neighbours",
        demands="Each waypoint of a path is a neighbour of the one before.",
        because="People walk straight from waypoint to waypoint; a longer hop may lead through an obstacle.",
        repair="The shortest valid path between the two is inserted.",
    ),
    Rule(
        name="leg-through-obstacle",
        demands="A person can walk straight from each waypoint to the next.",
        because="Two points of the grid may lie side by side with a shelf between them.",
        repair="The shortest valid path between the two is inserted.",
    ),
    Rule(
        name="door-closed",
        demands="No closed door stands between a waypoint of a path and the next.",
        because="People do not open a door that is closed all the time.",
        repair="The shortest valid path between the two is inserted, where there is one.",
    ),
    Rule(
        name="too-narrow",
        demands="Between two waypoints of a path there is room for a person who turns sideways (0.25 m).",
        because="The person would stand in front of the gap for the rest of the run.",
        repair="None: choose another way.",
    ),
    Rule(
        name="point-in-obstacle",
        demands="A free point of a person lies where a person can stand.",
        because="Nobody can walk into a shelf or off the map.",
        repair="None: move the point.",
    ),
    Rule(
        name="point-hides-waypoint",
        demands="A free point has no name of a waypoint.",
        because="A path would not say which of the two it means.",
        repair="None: give the point another name.",
    ),
    Rule(
        name="empty-path",
        demands="Every task has a path.",
        because="A task without a path is not walked at all.",
        repair="The shortest valid path between the task's areas is inserted; without known areas the task is removed.",
    ),
    Rule(
        name="short-path",
        demands="A path has two waypoints or more, or one at which the person pauses.",
        because="A task on one waypoint without a pause takes no time and does nothing.",
        repair="The path is extended to the task's end area, else the task is removed.",
    ),
    Rule(
        name="broken-chain",
        demands="A task starts at the waypoint where the one before it ended.",
        because="The simulator would walk the missing leg straight, through any obstacle.",
        repair="The path is extended within the area it ends in; between different areas a task is inserted.",
    ),
    Rule(
        name="open-loop",
        demands="The last task ends at the waypoint where the first one starts.",
        because="The list of tasks is cyclic: after the last one the first one begins again.",
        repair="The last path is extended within the area it ends in; between different areas a task is inserted.",
    ),
    Rule(
        name="unknown-area",
        demands="The start and end area of a task are labelled areas of the world, or waypoints.",
        because="A place that is not on the map cannot be checked.",
        repair="A near misspelling is corrected; any other name is replaced by the waypoint at that end of the path.",
    ),
    Rule(
        name="wrong-area",
        demands="A task starts and ends at waypoints from which its areas are worked.",
        because="A path that ends elsewhere is not the task that was described.",
        repair="The path is extended to the nearest waypoint of the area.",
    ),
    Rule(
        name="spawn-on-robot",
        demands="No person starts where the robot stands.",
        because="It would be a collision that nobody caused; the simulator does not start such a run.",
        repair="The person starts at another waypoint of the same area, with another task, or with an inserted one.",
    ),
    Rule(
        name="spawn-near-robot",
        demands=f"No person starts nearer than {START_CLEARANCE_M} m to the robot, edge to edge.",
        because="A person in the way from the start says little about the robot. RVSG's generators keep this "
        "clearance. It is not required, because half of the published study's runs start closer.",
        repair="None: the scenario is simulated as it is.",
        warning=True,
    ),
    Rule(
        name="spawn-on-human",
        demands="No two people start in the same place.",
        because="The simulator would push them apart, which no task explains.",
        repair="The later one starts at another waypoint of the area, with another task, or with an inserted one.",
    ),
    Rule(
        name="spawn-in-obstacle",
        demands="No person starts inside an obstacle.",
        because="The simulator would push the person out of the obstacle, which no task explains.",
        repair="The person starts at another waypoint of the same area, with another task, or with an inserted one.",
    ),
    Rule(
        name="never-moves",
        demands="A person's tasks name two different waypoints or more.",
        because="A person who never moves is an obstacle and belongs in the map.",
        repair="None: the tasks do not say where to go.",
    ),
    Rule(
        name="pause-off-path",
        demands="A pause is at a waypoint of its task's path.",
        because="The person would never reach the place of the pause.",
        repair="The pause moves to the nearest waypoint of the path; at an unknown waypoint it is removed.",
    ),
    Rule(
        name="speed-out-of-range",
        demands=f"The walking speed is between {SPEED_RANGE_M_S[0]} and {SPEED_RANGE_M_S[1]} m/s; 0.3 to 1.7 m/s in a "
        "wheelchair, 0.3 to 1.5 m/s with a trolley.",
        because="People at work neither creep nor run.",
        repair="The speed is set to the nearer end of the range.",
    ),
    Rule(
        name="size-out-of-range",
        demands="A child has a radius of 0.15 to 0.35 m, who sits in a wheelchair one of 0.25 to 0.4 m.",
        because="The size belongs to the kind of person.",
        repair="None: take a radius in the range, or leave it out.",
    ),
    Rule(
        name="trolley-pusher",
        demands="Only adults push a trolley.",
        because="A child does not reach over it, and a wheelchair needs both hands.",
        repair="None: leave the trolley out.",
    ),
    Rule(
        name="too-wide",
        demands="The way from waypoint to waypoint is as wide as the wheelchair or the trolley.",
        because="The person would stand in front of the gap for the rest of the run.",
        repair="None: choose another way, or a narrower trolley.",
    ),
    Rule(
        name="group-of-one",
        demands="A group has two members or more.",
        because="The forces that hold a group together need two people.",
        repair="The person leaves the group.",
    ),
    Rule(
        name="same-name",
        demands="No two people have the same name.",
        because="Findings, feedback and reports refer to people by name.",
        repair="The later one is renamed.",
    ),
    Rule(
        name="too-many-humans",
        demands=f"A configuration has at most {MAX_HUMANS} people.",
        because="The time to simulate people grows with the square of their number.",
        repair="The people beyond the limit are removed.",
    ),
    Rule(
        name="wrong-world",
        demands="The mission is in the world that is simulated, and that world has not changed since.",
        because="The same waypoint name is another place in another world.",
        repair="None: load the world the mission was made for.",
    ),
    Rule(
        name="moved-off-map",
        demands="Every object moved into the world lies on its map.",
        because="Nobody meets an object outside the building, so the scenario would not be what it says.",
        repair="None; the object has to be moved or left out.",
    ),
    Rule(
        name="moved-on-robot",
        demands="No moved object stands where the robot starts.",
        because="The run would end before it begins.",
        repair="None; the object has to be moved or left out.",
    ),
    Rule(
        name="moved-blocks-route",
        demands="The moved objects leave the robot a way to its goal.",
        because="A mission that cannot be done says nothing about people.",
        repair="None; an object has to be moved or left out.",
    ),
    Rule(
        name="unknown-door",
        demands="Every door whose state the mission gives is one of the world's.",
        because="A door that does not exist changes nothing, so the scenario would not be what it says.",
        repair="None: name a door of doors.yaml.",
    ),
    Rule(
        name="door-blocks-route",
        demands="Doors that stay closed, or stand open into the way, leave the robot a way to its goal.",
        because="A mission that cannot be done says nothing about people.",
        repair="None: open the door in the scenario or in doors.yaml, or choose another route.",
    ),
    Rule(
        name="robot-start-blocked",
        demands="The robot's start is free in the world.",
        because="Navigation cannot plan from inside an obstacle.",
        repair="None: correct the route.",
    ),
    Rule(
        name="robot-too-wide",
        demands="Some way from the start to the goal is as wide as the robot.",
        because="The robot cannot arrive, whatever people do. Checked for robots other than the default one.",
        repair="None: choose another route or robot.",
    ),
)

RULES: dict[str, Rule] = {rule.name: rule for rule in _TABLE}
"""Every rule by its name, in the order the reference page lists them."""


def rules_page() -> str:
    """Return the reference page of the rules as Markdown (written by docs/generate.py)."""
    rows = "\n".join(
        f"| `{r.name}`{' *warning*' if r.warning else ''} | {r.demands} | {r.because} | {r.repair} |" for r in _TABLE
    )
    return (
        "A configuration reaches a simulator only when the checker finds nothing. Every finding names the human, the\n"
        "task, the position in the path, the reason and a suggestion. The checker reports all findings at once. If a\n"
        "generator's proposal breaks a rule, RVSG repairs it as the last column says and records each repair with the\n"
        "path before and after. A proposal that cannot be repaired is kept with its problems and is not simulated. A\n"
        "rule marked *warning* is reported, and the configuration is simulated.\n\n"
        "| rule | demands | because | repair |\n|---|---|---|---|\n" + rows + "\n"
    )
