"""Changes of a world's files, and the fixes that the check offers."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.coded import nearest

from rvsg.core.errors import FileError, InputError, UnknownName
from rvsg.world.checks import Remark, check_world
from rvsg.world.edits import edit_world
from rvsg.world.world import World
from rvsg.world.world_folder import SHIPPED, load_world
from rvsg_studio.world_editor import History, editable_world, remarks_on

pytest.importorskip("ruamel.yaml", reason="ruamel.yaml is not installed")


Values = dict[str, Any]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(SHIPPED / "office", tmp_path / "office"))


def made(folder: Path, what: str, **values: Any) -> World:
    edit_world(folder, {"what": what, **values}).apply()
    return load_world(folder)


def test_a_new_name_changes_its_entry_alone_and_keeps_the_comments(folder: Path) -> None:
    before = (folder / "labels.yaml").read_text()
    world = made(folder, "change area", name="Reception", values={"name": "Front Desk"})
    old, new = (set(text.splitlines()) for text in (before, (folder / "labels.yaml").read_text()))
    assert len(old - new) <= 2 and "Front Desk" in "".join(new - old) and len(new - old) == 1  # two lines become one
    assert world.area("Front Desk").outline == load_world("office").area("Reception").outline
    assert (folder / "labels.yaml").read_text().startswith(before.splitlines()[0])


@pytest.mark.parametrize(
    ("what", "values"),
    [
        ("add area", {"name": "Reception", "rectangle": [0, 0, 1, 1]}),
        ("add area", {"name": " ", "rectangle": [0, 0, 1, 1]}),
        ("add area", {"name": "x", "rectangle": [0, 0, 0, 1]}),
        ("add area", {"name": "x", "outline": [[0, 0], [1, 1], [0, 1], [1, 0]]}),
        ("add area", {"name": "x", "outline": [[0, 0], [1, float("nan")], [0, 1]]}),
        ("add area", {"name": "x", "rectangle": "0011"}),
        ("add area", {"name": "x" * 200, "rectangle": [0, 0, 1, 1]}),
        ("merge areas", {"name": "Reception", "other": "Lounge"}),
        ("merge areas", {"name": "Reception", "other": "Reception"}),
        ("split area", {"name": "Lounge", "line": [[0, 0], [0, 1]]}),
        ("add route", {"name": "x", "points": [[0, 0]]}),
        ("change route", {"name": "route_1", "values": {"time_limit_s": "soon"}}),
        ("set activities", {"values": "one"}),
        ("rm -rf", {}),
        ("remove area", {"name": "nowhere"}),
    ],
)
def test_what_would_be_wrong_is_refused_and_nothing_changes(folder: Path, what: str, values: Values) -> None:
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    with pytest.raises(InputError):
        edit_world(folder, {"what": what, **values}).apply()
    assert {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before


def test_a_shipped_world_is_not_changed_and_an_unknown_area_told_with_its_nearest(folder: Path) -> None:
    with pytest.raises(InputError):
        edit_world(SHIPPED / "office", {"what": "remove area", "name": "Lounge"})
    with pytest.raises(UnknownName, check=nearest("Lounge")):
        edit_world(folder, {"what": "remove area", "name": "Lunge"})


def new_remarks(folder: Path) -> list[Remark]:
    """What the check says of a world beyond what it says of the one that ships."""
    usual = {remark.problem.message for remark in check_world(SHIPPED / "office")}
    return [remark for remark in check_world(folder) if remark.problem.message not in usual]


def area(**values: Any) -> Callable[[Values], None]:
    """Change the first area; a shape replaces the one it has."""

    def change(file: Values) -> None:
        if "name" not in values:
            for key in ("rectangle", "outline"):
                file["areas"][0].pop(key, None)
        file["areas"][0].update(values)

    return change


def pose(key: str, **values: float) -> Callable[[Values], None]:
    def change(file: Values) -> None:
        file["routes"][0][key].update(values)
        file["routes"][0].pop("via", None)

    return change


def twin(file: Values) -> None:
    file["areas"].append({**file["areas"][0], "name": file["areas"][0]["name"].upper()})


@pytest.mark.parametrize(
    ("file", "change"),
    [
        pytest.param("labels", twin, id="alike"),
        pytest.param("labels", area(name="Tea corner "), id="space"),
        pytest.param("labels", area(name="B3"), id="of a waypoint"),
        pytest.param("labels", area(rectangle=[500, 500, 503, 503], waypoints=[]), id="outside"),
        pytest.param("labels", area(rectangle=[-4, 1, 3, 4], waypoints=[]), id="partly outside"),
        pytest.param("labels", lambda f: f["areas"][0].update(waypoints=["A1", "B2", "H9"]), id="waypoints far away"),
        pytest.param("routes", pose("start", x=0.0, y=0.0), id="start in a wall"),
        pytest.param("routes", pose("goal", x=-3.0, y=-3.0), id="goal outside"),
        pytest.param("routes", pose("start", yaw=90.0), id="degrees"),
        pytest.param("routes", lambda file: file["routes"][0].update(time_limit_s=1.0), id="no time"),
        pytest.param("world", lambda f: f.update(activities=["A guest waits at the Receptio."]), id="activity"),
    ],
)
def test_a_fix_mends_what_was_found(folder: Path, file: str, change: Callable[[Values], None]) -> None:
    values = yaml.safe_load((folder / f"{file}.yaml").read_text())
    change(values)
    (folder / f"{file}.yaml").write_text(yaml.safe_dump(values, sort_keys=False))
    remarks = new_remarks(folder)
    mendable = {remark.problem.message for remark in remarks if remark.fix}
    assert mendable, remarks
    while fixes := [remark.fix for remark in remarks if remark.fix and remark.problem.message in mendable]:
        edit_world(folder, fixes[0].change).apply()
        left = new_remarks(folder)
        assert len(left) < len(remarks)
        remarks = left
    assert not mendable & {remark.problem.message for remark in remarks}


def test_a_finding_that_only_a_person_can_judge_has_no_fix(folder: Path) -> None:
    values = yaml.safe_load((folder / "world.yaml").read_text())
    values.pop("activities", None)
    (folder / "world.yaml").write_text(yaml.safe_dump(values))
    found = [remark for remark in check_world(folder) if remark.key == ()]
    assert found and all(remark.fix is None for remark in found)


def test_areas_are_added_shaped_and_removed(folder: Path) -> None:
    world = made(folder, "add area", name="no", kind="yes: x # y", rectangle=[3.0, 5.0, 1.0, 2.0])
    assert world.area("no").kind == "yes: x # y"
    assert world.area("no").outline == ((1, 2), (3, 2), (3, 5), (1, 5))
    world = made(folder, "change area", name="no", values={"outline": [[1, 2], [3, 2], [2, 5]]})
    assert len(world.area("no").outline) == 3
    world = made(folder, "remove area", name="no")
    assert "no" not in [area.name for area in world.areas]


def test_a_split_area_is_merged_again(folder: Path) -> None:
    whole = load_world(folder).area("Lounge").outline
    x = (min(p[0] for p in whole) + max(p[0] for p in whole)) / 2
    world = made(folder, "split area", name="Lounge", line=[[x, -100], [x, 100]])
    assert {"Lounge 1", "Lounge 2"} <= {area.name for area in world.areas}
    world = made(folder, "merge areas", name="Lounge 1", other="Lounge 2")
    xs = [p[0] for p in world.area("Lounge 1").outline]
    assert (min(xs), max(xs)) == pytest.approx((min(p[0] for p in whole), max(p[0] for p in whole)), abs=0.02)


def test_routes_and_activities(folder: Path) -> None:
    world = made(folder, "add route", name="tour", points=[[4.0, 4.1], [9.0, 7.1], [17.0, 7.1]], purpose="a tour")
    route = world.route("tour")
    assert (route.start.x, route.goal.x, len(route.through)) == (4.0, 17.0, 1)
    assert route.goal.yaw == 0.0 and route.time_limit_s > 13
    world = made(folder, "change route", name="tour", values={"time_limit_s": 99, "goal": [18.0, 7.1, 1.57]})
    assert (world.route("tour").time_limit_s, world.route("tour").goal.x) == (99, 18.0)
    world = made(folder, "remove route", name="tour")
    assert "tour" not in [each.name for each in world.routes]
    assert made(folder, "set activities", values=["sweep: the floor", " "]).activities == ("sweep: the floor",)


def test_changes_are_undone_and_made_again_also_after_a_restart(folder: Path, tmp_path: Path) -> None:
    kept = tmp_path / "undo.json"
    original = (folder / "labels.yaml").read_text()
    History(kept).make(folder, {"what": "remove area", "name": "Lounge"})
    History(kept).make(folder, {"what": "change area", "name": "Reception", "values": {"kind": "desk"}})
    edited = (folder / "labels.yaml").read_text()
    assert History(kept).steps == (2, 0)
    History(kept).undo()
    History(kept).undo()
    assert (folder / "labels.yaml").read_text() == original and History(kept).steps == (0, 2)
    History(kept).redo()
    History(kept).redo()
    assert (folder / "labels.yaml").read_text() == edited
    with pytest.raises(InputError):
        History(kept).redo()


def moved(by: float) -> dict[str, Any]:
    return {"what": "change area", "name": "Lounge", "values": {"rectangle": [1.0 + by, 1.0, 3.0 + by, 2.0]}}


def test_changes_that_belong_together_are_undone_in_one_step(folder: Path, tmp_path: Path) -> None:
    history, labels = History(tmp_path / "undo.json"), folder / "labels.yaml"
    original = labels.read_text()
    for by in (0.1, 0.2, 0.3):
        history.make(folder, moved(by), together="a move")
    first = labels.read_text()
    history.make(folder, moved(0.4), together="another")
    assert history.steps == (2, 0)
    history.undo()
    assert labels.read_text() == first
    history.undo()
    assert labels.read_text() == original


@pytest.mark.parametrize("together", ["", "a move"])
def test_a_death_before_a_change_is_written_spoils_no_undo(folder: Path, tmp_path: Path, together: str) -> None:
    history, labels = History(tmp_path / "undo.json"), folder / "labels.yaml"
    original = labels.read_text()
    history.make(folder, moved(0.1), together=together)
    before = labels.read_text()
    history.make(folder, moved(0.2), together=together)
    labels.write_text(before)  # the second change was remembered, and never made
    history.undo()
    assert labels.read_text() == original


def test_what_somebody_else_changed_is_not_undone(folder: Path, tmp_path: Path) -> None:
    history = History(tmp_path / "undo.json")
    history.make(folder, {"what": "remove area", "name": "Lounge"})
    labels = folder / "labels.yaml"
    labels.write_text(labels.read_text() + "# by hand\n")
    with pytest.raises(FileError):
        history.undo()
    assert labels.read_text().endswith("# by hand\n") and history.steps == (1, 0)


def test_an_editor_sees_what_the_check_finds_and_where(folder: Path) -> None:
    made(folder, "add area", name="Far away", rectangle=[900, 900, 901, 901])
    seen = editable_world(folder)
    place = [area["name"] for area in seen["areas"]].index("Far away")
    assert any(remark["key"][:2] == ["areas", place] and remark["serious"] for remark in remarks_on(folder))
    assert seen["editable"] and not editable_world("office")["editable"]
    assert seen["edges"] and seen["routes"][0]["narrowest_m"] > 0
