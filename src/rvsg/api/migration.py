"""Adapt saved scenarios to worlds that have changed."""

from __future__ import annotations

from pathlib import Path

from rvsg.api.records import read_scenario
from rvsg.api.scenarios import check_valid
from rvsg.api.worlds import load_world
from rvsg.scenario.scenario import Scenario
from rvsg.scenario.variation import REACH_M, migrate


def migrate_scenario(
    path: str | Path, world: str | Path, *, route: str | None = None, reach_m: float = REACH_M
) -> tuple[Scenario, tuple[str, ...]]:
    """Read a scenario, adapt it to a world and check it there; return it with the changes.

    Raises:
        InputError: A waypoint has no successor within `reach_m`.
        InvalidScenario: The adapted scenario breaks a rule; `findings` says which.
    """
    saved, _ = read_scenario(Path(path))
    place = load_world(world)
    scenario, changes = migrate(saved, place, reach_m=reach_m, route=place.route(route) if route else None)
    check_valid(scenario, place)
    return scenario, changes
