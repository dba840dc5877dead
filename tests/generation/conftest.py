from __future__ import annotations

import pytest

from rvsg.scenario.brief import Brief
from rvsg.scenario.requirement import load_requirement
from rvsg.scenario.scenario import Mission
from rvsg.world.world import World
from rvsg.world.world_folder import load_world


@pytest.fixture(autouse=True)
def _own_data_folder(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """No test reads or writes what the user stored."""
    monkeypatch.setenv("RVSG_DATA_DIR", str(tmp_path_factory.mktemp("data")))


@pytest.fixture(scope="session")
def warehouse() -> World:
    return load_world("warehouse")


@pytest.fixture
def brief(warehouse: World) -> Brief:
    mission = Mission(world="warehouse", world_id=warehouse.id, route=warehouse.route("route_1"))
    return Brief(mission=mission, requirement=load_requirement("R1"), seed=3)
