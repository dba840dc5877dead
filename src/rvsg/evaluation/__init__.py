"""Metrics of a Run, and the Verdict that a Requirement makes of them."""
