"""What the check of a world offers to mend, and that it is mended afterwards."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from rvsg.world.checks import Remark, check_world
from rvsg.world.edits import edit_world
from rvsg.world.schema import save_world
from rvsg.world.world_folder import SHIPPED, load_world

Values = dict[str, Any]


@pytest.fixture
def office(tmp_path: Path) -> Path:
    save_world(load_world("office"), tmp_path / "office")
    return tmp_path / "office"


def changed(folder: Path, file: str, change: Callable[[Values], None]) -> None:
    values = yaml.safe_load((folder / file).read_text())
    change(values)
    (folder / file).write_text(yaml.safe_dump(values, sort_keys=False))


@cache
def usual() -> frozenset[str]:
    """What the check says of the world as it ships."""
    return frozenset(remark.problem.message for remark in check_world(SHIPPED / "office"))


def new_remarks(folder: Path) -> list[Remark]:
    return [remark for remark in check_world(folder) if remark.problem.message not in usual()]


def twin(values: Values) -> None:
    area = dict(values["areas"][0])
    values["areas"].append({**area, "name": area["name"].upper()})


def named(name: str) -> Callable[[Values], None]:
    return lambda values: values["areas"][0].update(name=name)


def placed(**shape: Any) -> Callable[[Values], None]:
    def change(values: Values) -> None:
        for key in ("rectangle", "outline", "waypoints"):
            values["areas"][0].pop(key, None)
        values["areas"][0].update(shape)

    return change


def pose(key: str, **values: float) -> Callable[[Values], None]:
    def change(routes: Values) -> None:
        routes["routes"][0][key].update(values)
        routes["routes"][0].pop("via", None)

    return change


CASES = {
    "alike": ("labels.yaml", twin),
    "space": ("labels.yaml", named("Tea corner ")),
    "of a waypoint": ("labels.yaml", named("B3")),
    "outside": ("labels.yaml", placed(rectangle=[500, 500, 503, 503])),
    "partly outside": ("labels.yaml", placed(rectangle=[-4, 1, 3, 4])),
    "waypoints far away": ("labels.yaml", lambda values: values["areas"][0].update(waypoints=["A1", "B2", "H9"])),
    "start in a wall": ("routes.yaml", pose("start", x=0.0, y=0.0)),
    "goal outside": ("routes.yaml", pose("goal", x=-3.0, y=-3.0)),
    "degrees": ("routes.yaml", pose("start", yaw=90.0)),
    "no time": ("routes.yaml", lambda values: values["routes"][0].update(time_limit_s=1.0)),
    "activity": ("world.yaml", lambda values: values.update(activities=["A guest waits at the Receptio."])),
}


@pytest.mark.parametrize("case", CASES)
def test_a_fix_mends_what_was_found(office: Path, case: str) -> None:
    changed(office, *CASES[case])
    remarks = new_remarks(office)
    assert any(remark.fix for remark in remarks), remarks
    mendable = {remark.problem.message for remark in remarks if remark.fix}
    while fixes := [remark.fix for remark in remarks if remark.fix and remark.problem.message in mendable]:
        edit_world(office, fixes[0].change).apply()
        left = new_remarks(office)
        assert len(left) < len(remarks)
        remarks = left
    assert not mendable & {remark.problem.message for remark in remarks}


def test_a_finding_that_only_a_person_can_judge_has_no_fix(office: Path) -> None:
    changed(office, "world.yaml", lambda values: values.pop("activities", None))
    found = [remark for remark in check_world(office) if remark.key == ()]
    assert found and all(remark.fix is None for remark in found)
