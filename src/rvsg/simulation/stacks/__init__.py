"""Navigation stacks under test: their protocols, and those that ship."""

from rvsg.simulation.stacks.protocol import (
    Costmap,
    Ended,
    LocalObservation,
    LocalPlanner,
    NavigationStack,
    Observation,
    Scan,
    StackError,
    Task,
    Velocity,
    WholeStack,
)
from rvsg.simulation.stacks.registry import Stack, StackChoice, stack_names

__all__ = [
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
    "Velocity",
    "WholeStack",
    "stack_names",
]
