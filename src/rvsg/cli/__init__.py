"""The command line: one verb per stage, whose module is loaded only when it is used.

To add a verb, write a Typer (made by `frame.verb()`; with several commands for a verb that has sub-verbs) in the module
of the verbs it belongs to, and add one line to `VERBS`: `MODULE:ATTRIBUTE`, or the module alone for its `app`. Another
distribution registers a table like it under the entry point group `rvsg.verbs`. The front door raises the errors; the
frame prints each as one message and exits with its code. Standard output carries machine-readable results only
(`console.print_json`); everything for people goes to standard error (`console.say`).
"""

from __future__ import annotations

from collections.abc import Sequence

from rvsg.cli.frame import Verb, command_line, installed_verbs
from rvsg.cli.interruption import until_gone
from rvsg.core.inputs import open_standard_streams

VERBS: dict[str, Verb] = {
    "world": Verb("rvsg.cli.world", "Make a world from a map, check it, draw it, show it, compare two"),
    "run": Verb("rvsg.cli.run", "Find, confirm and report scenarios that make the robot violate a requirement"),
    "propose": Verb("rvsg.cli.model:propose_app", "Ask a generator for one scenario, and show what the checker said"),
    "simulate": Verb("rvsg.cli.simulate", "Simulate a scenario and write its runs"),
    "evaluate": Verb("rvsg.cli.simulate:evaluate_app", "Measure runs of a scenario, and judge them by a requirement"),
    "compare": Verb("rvsg.cli.suite:compare_app", "Compare generators and strategies at an equal number of runs"),
    "scenario": Verb("rvsg.cli.scenario", "Adapt a saved scenario to a world that has changed"),
    "shrink": Verb(
        "rvsg.cli.scenario:shrink_app", "Find the smallest scenario that violates a requirement about as often"
    ),
    "confirm": Verb("rvsg.cli.report:confirm_app", "Confirm one more candidate of a campaign"),
    "report": Verb("rvsg.cli.report", "Write the page of a stored campaign, and print its ranked scenarios"),
    "suite": Verb("rvsg.cli.suite", "Keep scenarios, run them against every version, report what broke"),
    "compare-versions": Verb(
        "rvsg.cli.suite:compare_versions_app", "Compare two versions on the same scenarios and seeds"
    ),
    "explore": Verb(
        "rvsg.cli.scenario:explore_app", "Run a scenario with ranges, and show where in them it violates a requirement"
    ),
    "coverage": Verb("rvsg.cli.suite:coverage_app", "Show what suites and campaigns exercise, and what is untested"),
    "trace": Verb("rvsg.cli.simulate:trace_app", "Repeat a run and record everything, for the report and Foxglove"),
    "knowledge": Verb("rvsg.cli.knowledge", "Collect what campaigns find, search it, and give it to generators"),
    "watch": Verb("rvsg.cli.watch", "Monitor a robot, and test next what its runs suggest"),
    "replay": Verb("rvsg.cli.simulate:replay_app", "Write a run as a film or a strip of pictures"),
    "demo": Verb("rvsg.cli.demo", "Replay a recorded campaign whose scenarios a vision language model wrote"),
    "describe": Verb("rvsg.cli.model:describe_app", "Let a vision language model describe a world"),
    "prompt": Verb("rvsg.cli.model:prompt_app", "Print the next prompt of a campaign without calling a model"),
    "robots": Verb(
        "rvsg.cli.robots:robots_app", "List the robots that can be tested, check a robot file, or draw them"
    ),
    "stacks": Verb("rvsg.cli.robots:stacks_app", "List the navigation stacks that can be tested, or compare several"),
    "metrics": Verb("rvsg.cli.simulate:metrics_app", "List the metrics with formula and unit, or measure a run"),
}


def verbs() -> dict[str, Verb]:
    """Return all verbs: those of the core, then those of other installed distributions (entry points `rvsg.verbs`)."""
    return VERBS | installed_verbs()


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code. Without `argv`, use the arguments and signals of this process.

    0 done; 1 done, and a requirement is violated (with --fail-on-violation); 2 usage or input error;
    3 interrupted but resumable; 4 an error in RVSG itself.
    """
    if argv is not None:
        return command_line(verbs(), argv)
    open_standard_streams()
    return until_gone(lambda: command_line(verbs()))
