"""Reactive people: HuNavSim's social force model and its six behaviours, compiled, without allocation per tick."""

from rvsg.simulation.embedded.people.behaviour import tick
from rvsg.simulation.embedded.people.crowd import PERIOD_S, Crowd, PeopleOptions, initial

__all__ = ["PERIOD_S", "Crowd", "PeopleOptions", "initial", "tick"]
