"""Generators of scenarios: from a brief to a proposal."""
