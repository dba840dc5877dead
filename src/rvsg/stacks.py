"""Base classes of your own navigation stack: `LocalPlanner` and `WholeStack`.

See docs/how-to/test-your-own-stack.md. `rvsg.testing.check_stack` examines one.
"""

from rvsg.simulation.stacks.parameters import Parameter
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
from rvsg.simulation.stacks.stack_choice import Stack, StackChoice, stack_names

__all__ = [
    "Command",
    "Costmap",
    "Ended",
    "LocalObservation",
    "LocalPlanner",
    "NavigationStack",
    "Observation",
    "Parameter",
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
