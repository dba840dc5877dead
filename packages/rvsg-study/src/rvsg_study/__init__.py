"""The published study: its file formats, its as-logged measures and its tables. Nothing else imports this room."""

from rvsg.cli.frame import CONNECT, Verb

VERBS = {
    "import": Verb("rvsg_study.study_verb", "Read people of HuNavSim, or the study's results", CONNECT),
}
"""Verbs that this distribution adds to the command line."""
