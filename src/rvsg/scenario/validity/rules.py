"""The table of the rules of validity: one place for their names, their sense and their limits."""

from __future__ import annotations

from dataclasses import dataclass

MAX_HUMANS = 100
"""More people than this in one configuration are refused (Brief allows as many)."""

SPEED_RANGE_M_S = (0.3, 2.0)
"""Walking, not running: an ambling and a fast walk. HuNavSim's sample people walk at up to 1.5 m/s."""

ROBOT_RADIUS_M = 0.35
"""Radius of the disc that stands for the robot in every metric of the study."""

START_CLEARANCE_M = 0.5
"""What RVSG's own generators keep free between robot and people at the start, edge to edge: the clearance ISO 3691-4
asks for beside a driverless truck. Somebody nearer than that is met before either has done anything."""


@dataclass(frozen=True, kw_only=True)
class Rule:
    """A rule of validity: its name in a Finding, what it demands, why, and what a repair does about a breach.

    A breach of a `warning` is told and simulated all the same; it is found by `warnings`, not by `check`.
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
        because="A name that does not exist has no place to walk to; leaving it out in silence changes the walk.",
        repair="A misspelling with one reading (`e-15` for `E15`) is corrected; any other is left out.",
    ),
    Rule(
        name="invalid-waypoint",
        demands="Every waypoint of a path is one where a person can stand.",
        because="The grid also names points that lie in or too near a shelf, a wall or other solid things.",
        repair="It is left out of the path.",
    ),
    Rule(
        name="repeated-waypoint",
        demands="A path does not name the same waypoint twice in a row.",
        because="Standing still is said with a pause, which has a duration.",
        repair="The repetition is left out.",
    ),
    Rule(
        name="not-neighbours",
        demands="Each waypoint of a path is a neighbour of the one before.",
        because="People walk straight from waypoint to waypoint; a long hop cuts corners nobody looked at.",
        repair="The shortest valid path between the two is put in.",
    ),
    Rule(
        name="leg-through-obstacle",
        demands="A person can walk straight from each waypoint to the next.",
        because="Two points of the grid may lie side by side with a shelf between them.",
        repair="The shortest valid path between the two is put in.",
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
        repair="The shortest valid path between the task's areas is put in; without known areas the task is left out.",
    ),
    Rule(
        name="short-path",
        demands="A path has two waypoints or more, or one at which the person pauses.",
        because="A task on one waypoint without a pause takes no time and does nothing.",
        repair="The path is led on into the task's end area, else the task is left out.",
    ),
    Rule(
        name="broken-chain",
        demands="A task starts at the waypoint where the one before it ended.",
        because="People do not jump; the simulator would walk the missing leg through whatever lies there.",
        repair="The path is extended within the area it ends in; between different areas a task is put in.",
    ),
    Rule(
        name="open-loop",
        demands="The last task ends at the waypoint where the first one starts.",
        because="The list of tasks is cyclic: after the last one the first one begins again.",
        repair="The last path is extended within the area it ends in; between different areas a task is put in.",
    ),
    Rule(
        name="unknown-area",
        demands='Both sides of a task named "from → to" are labelled areas of the world, or waypoints.',
        because="The task says where its work is; a place that is not on the map cannot be checked.",
        repair="A near misspelling is corrected; any other name is replaced by the waypoint at that end of the path.",
    ),
    Rule(
        name="wrong-area",
        demands="A task starts and ends at waypoints from which its areas are worked.",
        because="A path that ends elsewhere is not the task that was described.",
        repair="The path is led on to the nearest waypoint of the area.",
    ),
    Rule(
        name="spawn-on-robot",
        demands="No person starts where the robot stands.",
        because="Two bodies in one place make a collision that nobody caused.",
        repair="The person starts at another waypoint of the same area, else with another task, else with one put in.",
    ),
    Rule(
        name="spawn-near-robot",
        demands=f"No person starts nearer than {START_CLEARANCE_M} m to the robot, edge to edge.",
        because="Whoever is met before either has done anything is no find. RVSG's offline generators keep this "
        "clearance; of others it is not demanded, since half of the published study's runs start so.",
        repair="None: it is a warning, and the scenario is simulated as it is.",
        warning=True,
    ),
    Rule(
        name="spawn-on-human",
        demands="No two people start in the same place.",
        because="Two bodies in one place push each other apart with forces that no walk explains.",
        repair="The later one starts at another waypoint of the area, else with another task, else with one put in.",
    ),
    Rule(
        name="spawn-in-obstacle",
        demands="No person starts inside an obstacle.",
        because="The obstacle would throw the person out, or hold them for the whole run.",
        repair="The person starts at another waypoint of the same area, else with another task, else with one put in.",
    ),
    Rule(
        name="never-moves",
        demands="A person's tasks name two different waypoints or more.",
        because="Somebody who never moves is an obstacle; put it into the map instead.",
        repair="None: it cannot be guessed what the person should do.",
    ),
    Rule(
        name="pause-off-path",
        demands="A pause is at a waypoint of its task's path.",
        because="The person would never come to where the pause is.",
        repair="The pause moves to the nearest waypoint of the path; at an unknown waypoint it is left out.",
    ),
    Rule(
        name="speed-out-of-range",
        demands=f"The walking speed is between {SPEED_RANGE_M_S[0]} and {SPEED_RANGE_M_S[1]} m/s.",
        because="Slower is standing, faster is running: neither is walking at work.",
        repair="The speed is set to the nearer end of the range.",
    ),
    Rule(
        name="group-of-one",
        demands="A group has two members or more.",
        because="Forces that hold a group together need somebody else in it.",
        repair="The person leaves the group.",
    ),
    Rule(
        name="same-name",
        demands="No two people have the same name.",
        because="Findings, feedback and reports tell people apart by their names.",
        repair="The later one is renamed.",
    ),
    Rule(
        name="too-many-humans",
        demands=f"A configuration has at most {MAX_HUMANS} people.",
        because="The forces between people cost time with the square of their number.",
        repair="Those beyond the limit are left out.",
    ),
    Rule(
        name="wrong-world",
        demands="The mission is in the world that is simulated, and that world has not changed since.",
        because="Waypoints of one map mean other places on another.",
        repair="None: choose the world the mission was made for.",
    ),
    Rule(
        name="robot-start-blocked",
        demands="The robot's start is free in the world.",
        because="A robot that stands in an obstacle cannot be planned for.",
        repair="None: the route has to be corrected.",
    ),
)

RULES: dict[str, Rule] = {rule.name: rule for rule in _TABLE}
"""Every rule by its name, in the order the reference page lists them."""


def rules_page() -> str:
    """The reference page of the rules as Markdown (written by docs/generate.py)."""
    rows = "\n".join(
        f"| `{r.name}`{' *warning*' if r.warning else ''} | {r.demands} | {r.because} | {r.repair} |" for r in _TABLE
    )
    return (
        "A configuration reaches a simulator only when the checker finds nothing. Every finding names the human, the\n"
        "task, the position in the path, the reason and a suggestion; all findings are listed at once. What is\n"
        "proposed by a generator and breaks a rule is repaired as the last column says, and the record lists each\n"
        "repair with the path before and after; what cannot be repaired is kept as a proposal with problems and never\n"
        "simulated. A rule marked *warning* is told of and does not keep a configuration from being simulated.\n\n"
        "| rule | demands | because | repair |\n|---|---|---|---|\n" + rows + "\n"
    )
