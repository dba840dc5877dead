"""The rules that make a configuration valid, and the repair of one that breaks them.

`check` lists every finding; `repair` replaces what it can by the shortest valid path and lists what it changed. What
cannot be repaired is reported by `check` again: nothing invalid reaches a simulator.
"""

from rvsg.scenario.validity.checker import check, warnings
from rvsg.scenario.validity.findings import Finding, Repair
from rvsg.scenario.validity.repairs import repair
from rvsg.scenario.validity.rules import RULES, Rule
from rvsg.scenario.validity.task_ends import read_ends

__all__ = ["RULES", "Finding", "Repair", "Rule", "check", "read_ends", "repair", "warnings"]
