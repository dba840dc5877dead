"""Verbs that this distribution adds to the command line."""

from rvsg.cli.frame import Verb

VERBS = {
    "import-study": Verb("rvsg_study.verb", "Import results in the published study's layout into a store"),
}
