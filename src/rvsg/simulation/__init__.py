"""Simulation of a Scenario as a Run: physics, sensors, the navigation stack under test, reactive people."""
