"""Test doubles and conformance checks for those who write plug-ins.

Run `check_generator`, `check_simulator`, `check_stack`, `check_strategy` or `check_ledger` in the tests of your
plug-in; each raises AssertionError with the first promise that is broken. The doubles are deterministic and need no
model and no files.
"""

from rvsg.campaign.conformance import check_ledger, check_strategy
from rvsg.simulation.conformance import check_simulator
from rvsg.simulation.stacks.conformance import check_stack
from rvsg.store.memory import MemoryLedger
from rvsg.testing.generators import ScriptedGenerator, WalkingGenerator, check_generator

__all__ = [
    "MemoryLedger",
    "ScriptedGenerator",
    "WalkingGenerator",
    "check_generator",
    "check_ledger",
    "check_simulator",
    "check_stack",
    "check_strategy",
]
