"""Doors that an import finds among the joints of an SDF or URDF file, and the joints it leaves alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from rvsg.scenario.scenario import HumanConfiguration, Mission
from rvsg.scenario.validity import check
from rvsg.world.creation import WorldSource, world_from
from rvsg.world.schema import save_world
from rvsg.world.world_folder import load_world
from rvsg_exchange.sdf import load_sdf

SWING = "<axis><xyz>0 0 1</xyz><limit><lower>0</lower><upper>1.57</upper></limit></axis>"
SLIDE = "<axis><xyz>0 1 0</xyz><limit><lower>0</lower><upper>1.0</upper></limit></axis>"


def collision(size: str, pose: str = "0 0 0") -> str:
    geometry = f"<geometry><box><size>{size}</size></box></geometry>"
    return f'<collision name="c"><pose>{pose} 0 0 0</pose>{geometry}</collision>'


def door(
    *, kind: str = "revolute", axis: str = SWING, size: str = "0.05 1.0 2.0", hinge: str = "0 -0.5 0", z: float = 1.0,
    extra: str = "", place: str = "4 2.4 0 0 0 0",
) -> str:  # fmt: skip
    """A model of one leaf whose middle stands in the gap of the wall, jointed to the world."""
    return (
        f'<model name="entrance">{extra}<pose>{place}</pose>'
        f'<link name="leaf"><pose>0 0 {z} 0 0 0</pose>{collision(size)}</link>'
        f'<joint name="j" type="{kind}"><pose>{hinge} 0 0 0</pose><parent>world</parent><child>leaf</child>{axis}'
        "</joint></model>"
    )


def read(tmp_path: Path, models: str) -> WorldSource:
    (tmp_path / "r.world").write_text(f'<sdf version="1.7"><world name="w">{ROOM}{models}</world></sdf>')
    return load_sdf(tmp_path / "r.world")


LOW, HIGH = (4.0, 1.9), (4.0, 2.9)
"""The ends of the gap."""


@pytest.mark.parametrize(
    ("given", "kind", "turns", "hinge"),
    [
        ({}, "swing", "left", LOW),
        ({"axis": SWING.replace("0 0 1<", "0 0 -1<"), "hinge": "0 0.5 0"}, "swing", "right", HIGH),
        ({"kind": "prismatic", "axis": SLIDE}, "sliding", None, HIGH),
        ({"kind": "prismatic", "axis": SLIDE.replace("1.0", "0").replace("<lower>0", "<lower>-1")}, "sliding", None,
         LOW),
        ({"size": "1.0 0.05 2.0", "hinge": "-0.5 0 0", "place": "4 2.4 0 0 0 1.5707963"}, "swing", "left", LOW),
    ],
    ids=["left", "right", "sliding", "sliding-back", "turned"],
)  # fmt: skip
def test_a_leaf_in_a_gap_that_swings_or_slides_is_a_door(
    tmp_path: Path, given: dict[str, str], kind: str, turns: str | None, hinge: tuple[float, float]
) -> None:
    world = read(tmp_path, door(**given))
    (found,) = world.doors
    assert not [thing for thing in world.objects if thing.kind == "entrance"]
    assert (found.kind, found.state) == (kind, "automatic") and turns in (found.turns, None)
    assert found.hinge == pytest.approx(hinge, abs=1e-3)
    assert found.end == pytest.approx(HIGH if hinge == LOW else LOW, abs=1e-3)


WALLS = (
    ("8 0.2 2.5", "4 0 1.25"), ("8 0.2 2.5", "4 4.8 1.25"), ("0.2 5 2.5", "0 2.4 1.25"),
    ("0.2 5 2.5", "8 2.4 1.25"), ("0.2 1.8 2.5", "4 0.99 1.25"), ("0.2 1.8 2.5", "4 3.81 1.25"),
)  # fmt: skip
"""Size and middle of the walls of two rooms with a gap of 1 m between them."""
ROOM = "".join(
    f'<model name="wall_{n}"><static>true</static><link name="l">{collision(size, at)}</link></model>'
    for n, (size, at) in enumerate(WALLS)
)


@pytest.mark.parametrize(
    "given",
    [
        {"axis": SWING.replace("0 0 1<", "1 0 0<")},  # a flap that turns about a level axis
        {"hinge": "0 0 0"},  # a turnstile
        {"size": "0.05 1.0 0.6", "z": 0.3},  # a low gate or a drawer
        {"z": 2.0, "size": "0.05 1.0 1.9"},  # a window high in the wall
        {"size": "0.6 1.0 2.0"},  # a cupboard that turns
        {"extra": "<static>true</static>"},  # nothing of it moves
        {"place": "2 2.4 0 0 0 0"},  # a leaf that stands free
        {"kind": "prismatic", "axis": SLIDE.replace("0 1 0", "1 0 0")},  # it moves across itself
        {"kind": "fixed"},
    ],
)
def test_other_joints_are_left_alone(tmp_path: Path, given: dict[str, object]) -> None:
    world = read(tmp_path, door(**given))  # type: ignore[arg-type]
    assert world.doors == ()
    assert [thing.name for thing in world.objects if thing.kind == "entrance"] == ["entrance"]


def test_the_doors_of_a_urdf_room_are_found(tmp_path: Path) -> None:
    box = '<collision><origin xyz="{at}"/><geometry><box size="{size}"/></geometry></collision>'
    walls = "".join(
        f'<link name="w{n}">{box.format(at=at, size=size)}</link>'
        f'<joint name="j{n}" type="fixed"><parent link="base"/><child link="w{n}"/></joint>'
        for n, (size, at) in enumerate(WALLS)
    )
    leaf = (
        f'<link name="leaf">{box.format(at="0 0.5 1", size="0.05 1 2")}</link><joint name="hinge" type="revolute">'
        '<parent link="base"/><child link="leaf"/><origin xyz="4 1.9 0"/><axis xyz="0 0 1"/>'
        '<limit lower="-1.57" upper="0"/></joint>'
    )
    (tmp_path / "room.urdf").write_text(f'<robot name="room"><link name="base"/>{walls}{leaf}</robot>')
    (found,) = load_sdf(tmp_path / "room.urdf").doors
    assert (found.hinge, found.turns) == (pytest.approx((4.0, 1.9)), "right")


def test_an_imported_door_is_listed_saved_and_can_be_closed(tmp_path: Path) -> None:
    read(tmp_path, door())
    created = world_from("sdf", tmp_path / "r.world", name="r")
    assert any("entrance" in note and "doors.yaml" in note for note in created.notes)
    save_world(created.world, tmp_path / "r")
    world = load_world(tmp_path / "r")
    assert world.doors == created.world.doors and len(world.drawn) == len(world.objects) + 1
    route = next(r for r in world.routes if (r.start.x < 4.0) != (r.goal.x < 4.0))
    nobody = HumanConfiguration(humans=())
    assert check(nobody, Mission.of(world, route), world) == ()
    closed = Mission.of(world, route, doors={"entrance": "closed"})
    assert [f.rule for f in check(nobody, closed, world)] == ["door-blocks-route"]


def test_the_door_of_a_cupboard_is_none(tmp_path: Path) -> None:
    box = collision("0.7 1.0 2.0", "0 0 1")
    body = f'<model name="cupboard"><pose>3.6 2.4 0 0 0 0</pose><link name="l">{box}</link></model>'
    assert read(tmp_path, door() + body).doors == ()
