"""The command line: one verb per stage, each in its own module, loaded only when it is used.

To add a verb, write `rvsg/cli/<module>.py` with a Typer named `app` (made by `frame.verb()`; with several commands
for a verb that has sub-verbs), and add one line to `VERBS`. The front door raises the errors; the frame prints each
as one message and exits with its code. Standard output carries machine-readable results only (`console.print_json`);
everything for people goes to standard error (`console.say`).
"""

from __future__ import annotations

from collections.abc import Sequence

from rvsg.api.files import open_standard_streams
from rvsg.cli.frame import Verb, command_line
from rvsg.cli.interruption import until_gone

VERBS: dict[str, Verb] = {
    "world": Verb("world", "Make a world from a map, check it, draw it, show it, compare two"),
    "run": Verb("run", "Find, confirm and report scenarios that make the robot violate a requirement"),
    "propose": Verb("propose", "Ask a generator for one scenario, and show what the checker said"),
    "simulate": Verb("simulate", "Simulate a scenario and write its runs"),
    "evaluate": Verb("evaluate", "Measure runs of a scenario, and judge them by a requirement"),
    "compare": Verb("compare", "Compare generators and strategies at an equal number of runs"),
    "scenario": Verb("scenario", "Adapt a saved scenario to a world that has changed"),
    "shrink": Verb("shrink", "Find the smallest scenario that violates a requirement about as often"),
    "confirm": Verb("confirm", "Confirm one more candidate of a campaign"),
    "report": Verb("report", "Write the page of a stored campaign, and print its ranked scenarios"),
    "export": Verb("export", "Write a scenario or runs for Foxglove, HuNavSim, Nav2, Gazebo, pandas"),
    "import-agents": Verb("import_agents", "Make a scenario from a HuNavSim agents file"),
    "suite": Verb("suite", "Keep scenarios, run them against every version, report what broke"),
    "compare-versions": Verb("compare_versions", "Compare two versions on the same scenarios and seeds"),
    "explore": Verb("explore", "Run a scenario with ranges, and show where in them it violates a requirement"),
    "coverage": Verb("coverage", "Show what suites and campaigns exercise, and what is untested"),
    "trace": Verb("trace", "Repeat a run and record everything, for the report and Foxglove"),
    "knowledge": Verb("knowledge", "Collect what campaigns find, search it, and give it to generators"),
    "watch": Verb("watch", "Monitor a robot, and test next what its runs suggest"),
    "replay": Verb("replay", "Write a run as a film or a strip of pictures"),
    "demo": Verb("demo", "Replay a recorded campaign whose scenarios a vision language model wrote"),
    "describe": Verb("describe", "Let a vision language model describe a world"),
    "prompt": Verb("prompt", "Print the next prompt of a campaign without calling a model"),
    "studio": Verb("studio", "Open a local web page for worlds, campaigns, findings and scenarios"),
    "robots": Verb("robots", "List the robots that can be tested, check a robot file, or draw them"),
    "stacks": Verb("stacks", "List the navigation stacks that can be tested, or compare several"),
    "ros2": Verb("ros2", "Check a running ROS 2 navigation, or scale Nav2's parameters for a faster clock"),
    "metrics": Verb("metrics", "List the metrics with formula and unit, or measure a run"),
    "import-study": Verb("import_study", "Import results in the published study's layout into a store"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code. Without `argv`, use the arguments and signals of this process.

    0 done; 1 done, and a requirement is violated (with --fail-on-violation); 2 usage or input error;
    3 interrupted but resumable; 4 an error in RVSG itself.
    """
    if argv is not None:
        return command_line(VERBS, argv)
    open_standard_streams()
    return until_gone(lambda: command_line(VERBS))
