"""The rules on the shipped warehouse, and on the configurations the published study ran."""

import json
from collections import Counter
from pathlib import Path

import pytest
from tests.published_data import published_data

from rvsg.scenario.repair import repair
from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Task
from rvsg.scenario.validity import check
from rvsg.world.world_folder import load_world

WORLD = load_world("warehouse")
MISSION = Mission(world="warehouse", world_id=WORLD.id, route=WORLD.route("route_1"))


def read(path: Path) -> HumanConfiguration | None:
    workers = json.loads(path.read_text(encoding="utf-8"))
    if not all(workers.values()):
        return None
    return HumanConfiguration(
        humans=tuple(
            Human(name=name, tasks=tuple(Task(name=t["Task"], path=tuple(t["Path"])) for t in tasks))
            for name, tasks in workers.items()
        )
    )


def test_every_area_of_the_warehouse_can_be_worked_from_every_other() -> None:
    for area in WORLD.areas:
        for other in WORLD.areas:
            assert WORLD.grid.shortest_path(area.waypoints[0], other.waypoints[-1]) is not None


@pytest.mark.exhaustive
def test_what_the_study_ran_is_repaired_into_valid_configurations() -> None:
    folder = published_data()
    if folder is None:
        pytest.skip("the published data is not here")
    found: Counter[str] = Counter()
    for route in ("route_1", "route_2", "route_3"):
        mission = MISSION.model_copy(update={"route": WORLD.route(route)})
        paths = sorted((folder / "published" / "distance" / route).glob("*/distance_*_[0-4].json"))
        configurations = [c for c in map(read, paths) if c is not None]
        assert len(configurations) > 40
        for configuration in configurations:
            found.update(f.rule for f in check(configuration, mission, WORLD))
            mended, _ = repair(configuration, mission, WORLD)
            assert check(mended, mission, WORLD) == ()
    assert found["invalid-waypoint"] > 10
    assert found["not-neighbours"] > 1000
