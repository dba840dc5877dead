"""Find, confirm and explain the human behaviours that make a mobile robot violate its requirements.

This module is the front door: load a world, write or load a scenario, simulate it, judge the runs, search for
scenarios with a `Campaign`. See docs/how-to/use-rvsg-from-python.md. The names load on first use; `import rvsg` loads
no simulator, database or client of a language model.
"""

import sys

if sys.argv[:1] == ["-m"] and {"rvsg", "-mrvsg"} & {*sys.orig_argv} and not sys.flags.safe_path:
    del sys.path[0]  # the current folder, where a file of a stranger may be called `json.py`

import importlib
from types import ModuleType
from typing import Any

__version__ = "0.2.0"

_HOME = {
    "Campaign": "rvsg.app.campaign",
    "InvalidScenario": "rvsg.core.errors",
    "Judgement": "rvsg.search.run_set",
    "Requirement": "rvsg.scenario.requirement",
    "Run": "rvsg.simulation.run",
    "RunSet": "rvsg.search.run_set",
    "RvsgError": "rvsg.core.errors",
    "Scenario": "rvsg.scenario.scenario",
    "Spec": "rvsg.core.plugins",
    "Suite": "rvsg.app.suites",
    "World": "rvsg.world.world",
    "check": "rvsg.scenario.builder",
    "evaluate": "rvsg.search.run_set",
    "judge": "rvsg.search.run_set",
    "load_recording": "rvsg.recording.tracks",
    "load_requirement": "rvsg.evaluation.verdict",
    "load_runs": "rvsg.search.run_set",
    "load_scenario": "rvsg.scenario.builder",
    "load_world": "rvsg.scenario.world_lookup",
    "propose": "rvsg.app.proposal",
    "recorded_scenario": "rvsg.recording.intent",
    "scenario": "rvsg.scenario.builder",
    "shrink": "rvsg.search.smallest_scenario",
    "simulate": "rvsg.search.run_set",
    "walk": "rvsg.scenario.builder",
}
"""Every public name, with the module that defines it; `__init__.pyi` declares them for type checkers."""

__all__ = ["__version__", *_HOME]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'rvsg' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})


class CallableModule(ModuleType):
    """A sub-package that shares its name with a public function, and is called as that function.

    Importing `rvsg.scenario` binds the sub-package to the attribute `scenario` of this module. Calling it still makes
    a scenario, so `rvsg.scenario(...)` works whatever was imported before.
    """

    def __call__(self, *args: Any, **options: Any) -> Any:
        """Call the public function of the same name."""
        return __getattr__(self.__name__.rpartition(".")[2])(*args, **options)
