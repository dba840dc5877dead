"""Navigation stacks under test: their protocols, and those that ship."""

from rvsg.simulation.stacks.protocol import (
    Command,
    Costmap,
    Ended,
    LocalObservation,
    LocalPlanner,
    NavigationStack,
    Observation,
    Scan,
    StackError,
    Task,
    Twist,
    Velocity,
    WholeStack,
)
from rvsg.simulation.stacks.registry import Stack, StackChoice, stack_names

__all__ = [
    "Command",
    "Costmap",
    "Ended",
    "LocalObservation",
    "LocalPlanner",
    "NavigationStack",
    "Observation",
    "Scan",
    "Stack",
    "StackChoice",
    "StackError",
    "Task",
    "Twist",
    "Velocity",
    "WholeStack",
    "stack_names",
]
