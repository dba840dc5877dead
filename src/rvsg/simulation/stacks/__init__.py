"""Navigation stacks under test: their protocols, and those that ship."""
