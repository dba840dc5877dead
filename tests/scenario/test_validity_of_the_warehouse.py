"""The rules on the shipped warehouse, and on the configurations the published study ran."""

import json
import os
from collections import Counter
from pathlib import Path

import pytest

from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Task
from rvsg.scenario.validity import check, repair
from rvsg.world.load import load_world

WORLD = load_world("warehouse")
MISSION = Mission(world="warehouse", world_id=WORLD.id, route=WORLD.route("route_1"))


def published() -> Path | None:
    """The folder of the published data: by environment, else `shared/data` beside or above the checkout."""
    folders = [Path(os.environ["RVSG_PUBLISHED_DATA"])] if "RVSG_PUBLISHED_DATA" in os.environ else []
    folders += [parent / "shared" / "data" for parent in Path(__file__).resolve().parents]
    return next((folder for folder in folders if (folder / "published").is_dir()), None)


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


def test_what_the_study_ran_is_repaired_into_valid_configurations() -> None:
    folder = published()
    if folder is None:
        pytest.skip("the published data is not here")
    paths = sorted((folder / "published" / "distance" / "route_1").glob("*/distance_*_[0-4].json"))
    configurations = [c for c in map(read, paths) if c is not None]
    assert len(configurations) > 40
    found = Counter(f.rule for c in configurations for f in check(c, MISSION, WORLD))
    assert found["unknown-waypoint"] + found["invalid-waypoint"] > 0
    assert found["not-neighbours"] > 100
    for configuration in configurations:
        mended, _ = repair(configuration, MISSION, WORLD)
        assert check(mended, MISSION, WORLD) == ()
