"""The errors of RVSG, for those who use it from outside; see `rvsg.core.errors`."""

from rvsg.core.errors import (
    BudgetSpent,
    FileError,
    GenerationError,
    InputError,
    Interrupted,
    InvalidScenario,
    ModelUnavailable,
    NothingJudged,
    RvsgError,
    SimulationError,
    StoreError,
    UnknownName,
    how_to_install,
)

__all__ = [
    "BudgetSpent",
    "FileError",
    "GenerationError",
    "InputError",
    "Interrupted",
    "InvalidScenario",
    "ModelUnavailable",
    "NothingJudged",
    "RvsgError",
    "SimulationError",
    "StoreError",
    "UnknownName",
    "how_to_install",
]
