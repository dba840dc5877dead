"""What is asked of the robot and of the people, as plain data, and the rules that make it valid.

`rvsg.scenario(...)` makes a scenario: see `rvsg.CallableModule`.
"""

import sys

import rvsg

sys.modules[__name__].__class__ = rvsg.CallableModule
