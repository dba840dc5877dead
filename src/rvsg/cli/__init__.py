"""The command line: one verb per stage, whose module is loaded only when it is used.

To add a verb, write a Typer (made by `frame.verb()`; with several commands for a verb that has sub-verbs) in the module
of the verbs it belongs to, and add one line to `VERBS`. Another distribution registers a table like it under the entry
point group `rvsg.verbs`. The application raises the errors; the frame prints each as one message and exits with its
code. Standard output carries machine-readable results only (`console.print_json`); everything for people goes to
standard error (`console.say`).
"""

from __future__ import annotations

from collections.abc import Sequence

from rvsg.cli.frame import BUILD, FIND, KEEP, Verb, Verbs, command_line, installed_verbs
from rvsg.cli.interruption import until_gone
from rvsg.core.inputs import open_standard_streams

VERBS: dict[str, Verb] = {
    "run": Verb("rvsg.cli.run", "Find, confirm and report scenarios that make the robot fail", FIND),
    "demo": Verb("rvsg.cli.demo", "Replay a recorded campaign of a vision language model", FIND),
    "report": Verb("rvsg.cli.report", "Write the page of a campaign, print its scenarios", FIND),
    "confirm": Verb("rvsg.cli.report:confirm_app", "Confirm one more candidate of a campaign", FIND),
    "simulate": Verb("rvsg.cli.simulate", "Simulate a scenario and write its runs", FIND),
    "evaluate": Verb("rvsg.cli.simulate:evaluate_app", "Measure and judge runs; list the metrics", FIND),
    "replay": Verb("rvsg.cli.simulate:replay_app", "Write a run as a film, pictures or a full trace", FIND),
    "world": Verb("rvsg.cli.worlds", "Make, check, draw, describe and compare worlds", BUILD),
    "robots": Verb("rvsg.cli.robots:robots_app", "List, check and draw robots", BUILD),
    "stacks": Verb("rvsg.cli.robots:stacks_app", "List navigation stacks, or compare several", BUILD),
    "scenario": Verb("rvsg.cli.scenario", "Propose, shrink, explore and migrate scenarios", BUILD),
    "recording": Verb("rvsg.cli.recording", "Make scenarios and suites of recordings of a robot", BUILD),
    "suite": Verb("rvsg.cli.suite", "Test every version with the same scenarios", KEEP),
    "tune": Verb("rvsg.cli.tune", "Find parameters of a stack that fail less", KEEP),
    "knowledge": Verb("rvsg.cli.knowledge", "Collect and search what campaigns find", KEEP),
    "watch": Verb("rvsg.cli.watch", "Monitor a robot, and test what its runs suggest", KEEP),
}
MOVED = {
    "propose": "scenario propose",
    "prompt": "scenario prompt",
    "shrink": "scenario shrink",
    "explore": "scenario explore",
    "describe": "world describe",
    "compare": "suite compare`, or for search methods `python benchmarks/search_methods.py",
    "compare-versions": "suite compare",
    "coverage": "suite coverage",
    "trace": "replay SOURCE --trace",
    "metrics": "evaluate --metric all",
    "import-agents": "import agents",
    "import-study": "import study",
}
"""Verbs of RVSG 0.2 by their name there."""


def verbs() -> Verbs:
    """Return all verbs: those of the core and those of other installed distributions."""
    return installed_verbs(VERBS)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code. Without `argv`, use the arguments and signals of this process.

    0 done; 1 done, and a requirement is violated (with --fail-on-violation); 2 usage or input error;
    3 interrupted but resumable; 4 an error in RVSG itself.
    """
    if argv is not None:
        return command_line(verbs(), argv, MOVED)
    open_standard_streams()
    return until_gone(lambda: command_line(verbs(), moved=MOVED))
