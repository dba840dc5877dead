"""Load a requirement whose metric or formula exists and whose limit is known."""

from __future__ import annotations

from pathlib import Path

from rvsg.evaluation.judge import check_requirement
from rvsg.scenario import requirement as requirements
from rvsg.scenario.requirement import Requirement, shipped_requirements
from rvsg.world.world import Route

__all__ = ["Requirement", "load_requirement", "shipped_requirements"]


def load_requirement(
    name_or_path: str | Path | Requirement, route: Route | None = None, *, time_limit_s: float | None = None
) -> Requirement:
    """Load a shipped requirement by its name, or one of a file as `file.yaml` or `file.yaml#name`.

    Some limits are a share of the route's time limit. They are worked out where `route` or `time_limit_s` is given;
    otherwise `judge` does it for the runs it judges.

    Raises:
        UnknownName: there is no such requirement.
        FileError: the file cannot be used; names every mistake with its line.
    """
    if isinstance(name_or_path, Requirement):
        requirement = check_requirement(name_or_path)
    else:
        requirement = requirements.load_requirement(name_or_path, check=check_requirement)
    limit = route.time_limit_s if route is not None else time_limit_s
    return requirement if limit is None else requirement.for_time_limit(limit)
