"""Verbs that this distribution adds to the command line."""

from rvsg.cli.frame import CONNECT, Verb

VERBS = {
    "export": Verb("rvsg_exchange.verb:export_app", "Write a scenario or runs for another tool", CONNECT),
    "import": Verb("rvsg_exchange.verb:import_app", "Read people of HuNavSim, or the study's results", CONNECT),
}
