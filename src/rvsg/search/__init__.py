"""The search: strategies, the loop, confirmation, shrinking and exploration."""
