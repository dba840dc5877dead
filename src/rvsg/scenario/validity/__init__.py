"""The rules that make a configuration valid, and the repair of what breaks them. The checker is the judge.

`check` lists every finding; `repair` mends what can be mended by the shortest valid path and says what it changed.
What cannot be mended is still found by `check` afterwards: nothing invalid may reach a simulator.
"""

from rvsg.scenario.validity.checker import check, warnings
from rvsg.scenario.validity.findings import Finding, Repair
from rvsg.scenario.validity.repairs import repair
from rvsg.scenario.validity.rules import RULES, Rule

__all__ = ["RULES", "Finding", "Repair", "Rule", "check", "repair", "warnings"]
