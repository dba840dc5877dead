"""Suites: cases, what is expected of them, and the folder that keeps them."""
