"""What people should bring about, so that a requirement is likely to be violated."""

from __future__ import annotations

from enum import Enum


class Aim(str, Enum):
    """What a generator aims at. Each metric declares its aim; the value is the wording that generators use."""

    SHARE = "work close to the robot all along its way"
    MEET = "meet the robot closely where it has to pass"
    DISTURB = "come up in front of the robot again and again"
    DELAY = "walk and stand in the robot's lane, before it or towards it"
    NONE = "do the place's work wherever it is"
