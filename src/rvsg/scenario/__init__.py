"""Missions, people, scenarios and requirements as plain data, and the rules that make them valid.

`rvsg.scenario(...)` makes a scenario: see `rvsg.CallableModule`.
"""

import sys

import rvsg

sys.modules[__name__].__class__ = rvsg.CallableModule
