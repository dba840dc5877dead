"""The example in docs/reference/world-files.md is a world, and what the page says of it holds."""

import re
from pathlib import Path

import pytest

from rvsg.core.documents import DocumentError
from rvsg.world.grid import GridSpec
from rvsg.world.schema import AreaEntry, ObjectEntry, RouteEntry, WorldFile
from rvsg.world.space import human_space, robot_space
from rvsg.world.world_folder import load_world

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "world-files.md"


@pytest.fixture
def room(tmp_path: Path) -> Path:
    folder = tmp_path / "room"
    folder.mkdir()
    files = re.findall(r"^`(\w+\.yaml)`\n\n```yaml\n(.*?)```", PAGE.read_text(), flags=re.MULTILINE | re.DOTALL)
    assert [name for name, _ in files] == ["world.yaml", "objects.yaml", "labels.yaml", "routes.yaml"]
    for name, text in files:
        (folder / name).write_text(text)
    return folder


def test_the_example_is_a_world(room: Path) -> None:
    world = load_world(room)
    assert world.title == "Meeting room"
    assert [area.name for area in world.areas] == ["Table", "Coffee Shelf"]
    assert all(area.waypoints for area in world.areas)
    start, goal = world.routes[0].start, world.routes[0].goal
    assert robot_space(world).is_free(start.x, start.y, 0.3) and robot_space(world).is_free(goal.x, goal.y, 0.3)
    assert not human_space(world).is_free(3.0, 2.5)


def test_the_messages_shown_are_the_messages_given(room: Path) -> None:
    for file, old, new in (
        ("world.yaml", "format: 1\nname: room\ntitle", "name: room\ntilte"),
        ("labels.yaml", "2.1, 3.8", "2.1, wide"),
        ("routes.yaml", "    start: {x: 0.8, y: 0.8, yaw: 0.0}\n", ""),
    ):
        text = (room / file).read_text()
        assert old in text
        (room / file).write_text(text.replace(old, new))
    with pytest.raises(DocumentError) as caught:
        load_world(room)
    shown = re.search(r"^3 things are wrong:\n.*?(?=```)", PAGE.read_text(), flags=re.MULTILINE | re.DOTALL)
    assert shown is not None
    given = str(caught.value).replace(str(room.parent) + "/", "").splitlines()
    for line, said in zip(given, shown[0].splitlines(), strict=True):
        assert line.startswith(said.split(", ...")[0])


@pytest.mark.parametrize("model", [WorldFile, GridSpec, ObjectEntry, AreaEntry, RouteEntry])
def test_every_key_is_on_the_page(model: type) -> None:
    page = PAGE.read_text()
    for name, field in model.model_fields.items():  # type: ignore[attr-defined]
        assert f"`{field.alias or name}`" in page or f"{field.alias or name}:" in page, name
