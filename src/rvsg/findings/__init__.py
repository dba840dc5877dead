"""Findings: what runs show, in order of severity, and what generators are told of them."""
