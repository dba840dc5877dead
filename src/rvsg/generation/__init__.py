"""Generators of scenarios: a brief becomes a proposal."""
