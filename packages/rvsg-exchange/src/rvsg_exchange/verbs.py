"""Verbs that this distribution adds to the command line."""

from rvsg.cli.frame import Verb

VERBS = {
    "export": Verb("rvsg_exchange.export_verb", "Write a scenario or runs for Foxglove, HuNavSim, Gazebo, pandas"),
    "import-agents": Verb("rvsg_exchange.import_verb", "Make a scenario from a HuNavSim agents file"),
}
