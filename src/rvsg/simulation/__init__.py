"""A Scenario becomes a Run: physics, sensors, the navigation stack under test, reactive people."""
