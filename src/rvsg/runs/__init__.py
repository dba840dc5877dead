"""Runs: attempts, the ledger that keeps them, and the runner with its workers."""
