"""What the check of a world offers to mend, and that it is mended afterwards."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from rvsg.world.authoring.check import check_world
from rvsg.world.authoring.editing import edit_world
from rvsg.world.authoring.remarks import Remark
from rvsg.world.io.load import load_world
from rvsg.world.io.save import save_world

Values = dict[str, Any]


@pytest.fixture
def office(tmp_path: Path) -> Path:
    save_world(load_world("office"), tmp_path / "office")
    return tmp_path / "office"


def changed(folder: Path, file: str, change: Callable[[Values], None]) -> None:
    values = yaml.safe_load((folder / file).read_text())
    change(values)
    (folder / file).write_text(yaml.safe_dump(values, sort_keys=False))


def new_remarks(folder: Path, before: set[str]) -> list[Remark]:
    return [remark for remark in check_world(folder) if remark.problem.message not in before]


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
    before = {remark.problem.message for remark in check_world(office)}
    file, change = CASES[case]
    changed(office, file, change)
    found = [remark for remark in new_remarks(office, before) if remark.fix is not None]
    assert found, [remark.problem.message for remark in new_remarks(office, before)]
    for remark in found:
        assert remark.fix is not None
        if remark.problem.message in {left.problem.message for left in check_world(office)}:
            edit_world(office, remark.fix.change).apply()
        assert remark.problem.message not in {left.problem.message for left in check_world(office)}


def test_a_finding_that_only_a_person_can_judge_has_no_fix(office: Path) -> None:
    changed(office, "world.yaml", lambda values: values.pop("activities", None))
    found = [remark for remark in check_world(office) if remark.key == ()]
    assert found and all(remark.fix is None for remark in found)
