"""Verbs that this distribution adds to the command line."""

from rvsg.cli.frame import Verb

VERBS = {
    "studio": Verb("rvsg_studio.verb", "Open a local web page for worlds, campaigns, findings and scenarios"),
}
