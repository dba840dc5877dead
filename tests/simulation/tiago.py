"""The TIAGo OMNI base for tests of single kernels."""

from __future__ import annotations

import numpy as np

from rvsg.core.references import refer
from rvsg.robots.robot import load_robot
from rvsg.simulation.embedded.costmap import inflation_kernel
from rvsg.simulation.embedded.robot_parameters import padded_footprint, stack_of

TIAGO = load_robot("tiago_omni")
STACK = refer(stack_of(TIAGO))
FOOTPRINT = padded_footprint(TIAGO)
INFLATION = inflation_kernel(0.05, 0.55, 3.0, 0.24999999977)
RANGES = (2.5, 3.0, 0.05)
"""Obstacle range, clearing range and least range of a scan."""
BOX = np.array([-0.3585, 0.3585, -0.2485, 0.2485])
