"""Verbs that this distribution adds to the command line."""

from rvsg.cli.frame import CONNECT, Verb

VERBS = {
    "export": Verb("rvsg_exchange.export_verb", "Write a scenario or runs for another tool", CONNECT),
    "import": Verb("rvsg_exchange.import_verb", "Read people of HuNavSim, or the study's results", CONNECT),
}
