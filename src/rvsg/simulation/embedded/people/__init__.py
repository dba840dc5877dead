"""Reactive people: HuNavSim's social force model and its six behaviours, compiled, without allocation per tick."""
