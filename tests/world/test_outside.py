"""What of the floor is inside a building: courtyards by ceilings, by enclosure and by a person's word."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest
from shapely import Polygon

from rvsg.core.errors import FileError, InputError
from rvsg.world.areas import propose_areas
from rvsg.world.creation import Created, mapped, world_from
from rvsg.world.space import Space, human_space, human_space_of
from rvsg_exchange.sdf import load_sdf

MIDDLE = (12.0, 12.0)
ROOM = (3.5, 12.0)


def box(name: str, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> str:
    """A collision that spans these ranges, in metres."""
    middle, size = (
        [f"{v:g}" for v in values] for values in zip(*((a / 2 + b / 2, b - a) for a, b in (x, y, z)), strict=True)
    )
    return (
        f'<collision name="{name}"><pose>{" ".join(middle)} 0 0 0</pose>'
        f"<geometry><box><size>{' '.join(size)}</size></box></geometry></collision>"
    )


def wall(name: str, x: tuple[float, float], y: tuple[float, float]) -> str:
    return box(name, x, y, (0.0, 2.6))


def ring(*, ceilings: bool, door: bool = True, gate: bool = False, yard: str = "") -> str:
    """Four rooms in a ring, 24 x 24 m, round a court of 11 x 11 m; one model. Walls are 0.2 m thick."""
    low, high, near, far = 0.0, 24.0, 6.5, 17.5
    parts = [
        wall("west", (low, low + 0.2), (low, high)),
        wall("south", (low, high), (low, low + 0.2)),
        wall("north", (low, high), (high - 0.2, high)),
        wall("east", (high - 0.2, high), (low, 11.0 if gate else high)),
        wall("east 2", (high - 0.2, high), (13.0, high)),
        wall("inner west", (near - 0.2, near), (near, 11.4 if door else far)),
        wall("inner west 2", (near - 0.2, near), (12.6, far)),
        wall("inner east", (far, far + 0.2), (near, far)),
        wall("inner south", (near - 0.2, far + 0.2), (near - 0.2, near)),
        wall("inner north", (near - 0.2, far + 0.2), (far, far + 0.2)),
        # the rooms meet at three corners, through doors of 1.2 m
        wall("corner 1", (0.0, 3.0), (near - 0.2, near)), wall("corner 1b", (4.2, near), (near - 0.2, near)),
        wall("corner 2", (far, 20.0), (near - 0.2, near)), wall("corner 2b", (21.2, high), (near - 0.2, near)),
        wall("corner 3", (far, 20.0), (far, far + 0.2)), wall("corner 3b", (21.2, high), (far, far + 0.2)),
        wall("corner 4", (0.0, 3.0), (far, far + 0.2)), wall("corner 4b", (4.2, near), (far, far + 0.2)),
    ]  # fmt: skip
    if ceilings:
        spans = {"w": ((low, near), (low, high)), "e": ((far, high), (low, high))}
        spans |= {"s": ((near, far), (low, near)), "n": ((near, far), (far, high))}
        parts += [box(f"ceiling {name}", x, y, (2.6, 2.7)) for name, (x, y) in spans.items()]
    return building(*parts, yard=yard)


def building(*parts: str, name: str = "building", yard: str = "") -> str:
    return (
        f'<sdf version="1.7"><world name="w"><model name="{name}"><static>true</static><link name="l">'
        f"{''.join(parts)}</link></model>{yard}</world></sdf>"
    )


def made(tmp_path: Path, text: str, **choices: tuple[tuple[float, float], ...]) -> Created:
    (tmp_path / "b.world").write_text(text)
    return world_from("sdf", tmp_path / "b.world", name="b", **choices)


def floor(tmp_path: Path, text: str, **choices: tuple[tuple[float, float], ...]) -> Space:
    """Where people can be, without the grid, labels and routes of a whole world."""
    (tmp_path / "b.world").write_text(text)
    read = load_sdf(tmp_path / "b.world")
    return human_space_of(read.objects, mapped(read, None, [], **choices))


def places(created: Created) -> list[tuple[float, float]]:
    """All that is proposed: waypoints, and the ends of routes."""
    world = created.world
    ends = [(pose.x, pose.y) for route in world.routes for pose in (route.start, route.goal)]
    return [*(world.grid.position(name) for name in world.grid.valid), *ends]


@pytest.mark.parametrize(("ceilings", "gate"), [(False, True), (True, False)])
def test_a_courtyard_is_no_floor_and_nothing_is_proposed_in_it(tmp_path: Path, ceilings: bool, gate: bool) -> None:
    created = made(tmp_path, ring(ceilings=ceilings, gate=gate))
    space = human_space(created.world)
    assert not space.is_free(*MIDDLE) and space.is_free(*ROOM)
    assert not [at for at in places(created) if 6.5 < at[0] < 17.5 and 6.5 < at[1] < 17.5]
    assert len(created.world.routes) == 3
    assert any("--indoors" in note for note in created.notes)


@pytest.mark.parametrize("ceilings", [False, True])
def test_a_person_says_that_it_is_floor(tmp_path: Path, ceilings: bool) -> None:
    space = floor(tmp_path, ring(ceilings=ceilings), indoors=(MIDDLE,))
    assert space.is_free(*MIDDLE) and space.is_free(*ROOM)


@pytest.mark.parametrize("how", [{"door": False}, {"ceilings": True, "gate": True}, {}])
def test_nothing_is_left_of_a_courtyard_along_its_walls(tmp_path: Path, how: dict[str, bool]) -> None:
    space = floor(tmp_path, ring(**{"ceilings": False, **how}))
    assert not any(space.is_free(x, y) for x in (6.7, 12.0, 17.3) for y in (6.7, 12.0, 17.3))
    assert space.is_free(*ROOM)


def test_a_hall_with_furniture_stays_floor_until_a_person_says_otherwise(tmp_path: Path) -> None:
    table = (
        '<model name="table"><static>true</static><pose>12 9 0.4 0 0 0</pose><link name="l"><collision name="c">'
        "<geometry><box><size>1 2 0.8</size></box></geometry></collision></link></model>"
    )
    text = ring(ceilings=False, yard=table)
    assert floor(tmp_path, text).is_free(*MIDDLE)
    assert not floor(tmp_path, text, outdoors=(MIDDLE,)).is_free(*MIDDLE)
    assert not floor(tmp_path, text.replace('"table"', '"oak_tree"')).is_free(*MIDDLE)


def test_an_enclosed_hall_with_many_doors_is_no_courtyard(tmp_path: Path) -> None:
    closed, text = wall("inner south", (6.3, 17.7), (6.3, 6.5)), ring(ceilings=False)
    assert closed in text
    pieces = [(6.3, 8.0), (9.2, 11.4), (12.6, 14.8), (16.0, 17.7)]
    doors = "".join(wall(f"inner south {n}", x, (6.3, 6.5)) for n, x in enumerate(pieces))
    assert floor(tmp_path, text.replace(closed, doors)).is_free(*MIDDLE)
    assert not floor(tmp_path, text).is_free(*MIDDLE)


@pytest.mark.parametrize("choices", [{"indoors": ((0.1, 0.1),)}, {"outdoors": ((50.0, 0.0),)}])
def test_a_point_off_the_floor_is_refused(tmp_path: Path, choices: dict[str, tuple[tuple[float, float], ...]]) -> None:
    with pytest.raises(FileError) as caught:
        made(tmp_path, ring(ceilings=False), **choices)
    assert caught.value.code == "no-floor"


def test_walls_of_one_model_that_meet_and_share_faces_stay_whole(tmp_path: Path) -> None:
    """Two walls end to end, both flush with a third and overlapping it at the corner."""
    parts = [wall("a", (0.0, 4.0), (0.0, 0.2)), wall("b", (4.0, 9.0), (0.0, 0.2)), wall("c", (0.0, 0.2), (0.0, 9.0))]
    (tmp_path / "w.sdf").write_text(building(*parts))
    (thing,) = load_sdf(tmp_path / "w.sdf").objects
    for outlines in ((thing.footprint, *thing.holes), thing.slices):
        assert Polygon(outlines[0], outlines[1:]).area == pytest.approx(9.0 * 0.2 * 2 - 0.04, abs=1e-3)


def test_floor_in_closed_walls_counts_before_the_larger_one_around_it(tmp_path: Path) -> None:
    """A corridor with two legs: the floor beside it is larger, but it is outside."""
    corners: Corners = [(0, 0), (40, 0), (40, 3), (3, 3), (3, 30), (0, 30), (0, 0)]
    walls = outline(corners)
    space = floor(tmp_path, building(*walls))
    assert space.is_free(1.5, 15.0) and space.is_free(20.0, 1.5)
    assert not space.is_free(20.0, 15.0)


def test_pillars_in_a_room_of_the_same_model_leave_its_floor_open(tmp_path: Path) -> None:
    walls = [wall("a", (0.0, 5.0), (0.0, 0.9)), wall("b", (0.0, 5.0), (4.1, 5.0)), wall("c", (0.0, 0.9), (0.0, 5.0))]
    walls += [wall("d", (4.1, 5.0), (0.0, 5.0)), wall("pillar", (2.4, 2.6), (2.4, 2.6))]
    space = floor(tmp_path, building(*walls))
    assert space.is_free(1.5, 1.5) and not space.is_free(2.5, 2.5)


def test_a_small_part_of_a_building_is_not_called_after_the_building(tmp_path: Path) -> None:
    walls = [wall("a", (0.0, 9.0), (0.0, 0.2)), wall("b", (0.0, 9.0), (8.8, 9.0)), wall("c", (0.0, 0.2), (0.0, 9.0))]
    walls += [wall("d", (8.8, 9.0), (0.0, 9.0)), wall("e", (4.2, 4.8), (4.2, 4.8))]
    (tmp_path / "b.sdf").write_text(building(*walls, name="Acme"))
    read = load_sdf(tmp_path / "b.sdf")
    areas = propose_areas(read.objects, mapped(read, None, []))
    assert "Fixture" in {area.name for area in areas} and not any("Acme" in area.name for area in areas)


Corners = list[tuple[float, float]]
U = [(0, 0), (30, 0), (30, 25), (26, 25), (26, 4), (4, 4), (4, 25), (0, 25)]
L = [(0, 0), (40, 0), (40, 4), (4, 4), (4, 30), (0, 30)]
T = [(0, 0), (40, 0), (40, 4), (22, 4), (22, 30), (18, 30), (18, 4), (0, 4)]
U_COURT = (15.0, 15.0)


def outline(corners: Corners, *, doors: int = 0, gap_m: float = 1.0, name: str = "w") -> list[str]:
    """Walls of 0.2 m along a line from corner to corner; with a gap in the middle of the first so many."""
    walls = []
    for n, ((x0, y0), (x1, y1)) in enumerate(pairwise(corners)):
        (low, left), (high, right) = sorted([(x0, y0), (x1, y1)])
        level = y0 == y1
        begin, end = (low, high) if level else (left, right)
        middle, half = (begin + end) / 2, gap_m / 2
        pieces = [(begin, middle - half), (middle + half, end)] if n < doors else [(begin, end)]
        for k, (a, b) in enumerate(pieces):
            along, across = (a - 0.1, b + 0.1), ((y0 if level else x0) - 0.1, (y0 if level else x0) + 0.1)
            walls.append(wall(f"{name}{n} {k}", *((along, across) if level else (across, along))))
    return walls


@pytest.mark.parametrize("doors", [0, 1])
@pytest.mark.parametrize(
    ("corners", "inside", "outside"),
    [
        (U, [(15, 2), (2, 15), (28, 15)], [U_COURT, (15, 23), (6, 6)]),
        (L, [(20, 2), (2, 15)], [(20, 15)]),
        (T, [(10, 2), (20, 20)], [(10, 15), (30, 15)]),
    ],
)
def test_floor_between_wings_is_outside(
    tmp_path: Path, doors: int, corners: Corners, inside: Corners, outside: Corners
) -> None:
    space = floor(tmp_path, building(*outline([*corners, corners[0]], doors=doors)))
    assert all(space.is_free(*at) for at in inside)
    assert not any(space.is_free(*at) for at in outside)


def test_a_person_keeps_the_floor_between_wings(tmp_path: Path) -> None:
    text = building(*outline([*U, U[0]], doors=1))
    space = floor(tmp_path, text, indoors=((15, 8),))
    assert space.is_free(15, 8)
    with pytest.raises(InputError) as caught:
        floor(tmp_path, text, indoors=((15, 24),))
    assert caught.value.code == "no-floor"


def test_a_hall_that_is_open_at_the_front_is_inside(tmp_path: Path) -> None:
    """Three walls; then with an office in its corner, whose door is 1 m wide."""
    hall = outline([(0, 30), (0, 0), (20, 0), (20, 30)])
    office = outline([(6, 0), (6, 6), (0, 6)], doors=1, name="o")
    for walls in (hall, [*hall, *office]):
        space = floor(tmp_path, building(*walls))
        assert space.is_free(10, 15) and space.is_free(3, 20)


def test_a_hall_with_a_wide_gate_between_rooms_is_inside(tmp_path: Path) -> None:
    """A hall of 20 x 20 m with a gate of 4 m, and rooms of 4 m behind its other walls, each with a door."""
    hall = outline([(0, 0), (20, 0), (20, 20), (0, 20)], doors=3, name="h")
    front = outline([(0, 20), (0, 0)], doors=1, gap_m=4.0, name="f")
    around = outline([(0, 0), (0, -4), (24, -4), (24, 24), (0, 24), (0, 20)], name="a")
    space = floor(tmp_path, building(*hall, *front, *around))
    assert space.is_free(10, 10) and space.is_free(22, 10)
