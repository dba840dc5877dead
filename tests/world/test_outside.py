"""What of the floor is inside a building: courtyards by ceilings, by enclosure and by a person's word."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from shapely import Polygon
from tests.coded import coded

from rvsg.core.errors import FileError, InputError
from rvsg.world.areas import propose_areas
from rvsg.world.creation import mapped, world_from
from rvsg.world.space import Space, human_space, human_space_of
from rvsg_exchange.sdf import load_sdf

Points = list[tuple[float, float]]
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


def outline(corners: Points, *, doors: int = 0, gap_m: float = 1.0, name: str = "w") -> list[str]:
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


def floor(tmp_path: Path, text: str, **choices: Any) -> Space:
    """Where people can be, without the grid, labels and routes of a whole world."""
    (tmp_path / "b.world").write_text(text)
    read = load_sdf(tmp_path / "b.world")
    return human_space_of(read.objects, mapped(read, None, [], **choices))


@pytest.mark.parametrize(("ceilings", "gate"), [(False, True), (True, False)])
def test_a_courtyard_is_no_floor_and_nothing_is_proposed_in_it(tmp_path: Path, ceilings: bool, gate: bool) -> None:
    (tmp_path / "b.world").write_text(ring(ceilings=ceilings, gate=gate))
    created = world_from("sdf", tmp_path / "b.world", name="b")
    world, space = created.world, human_space(created.world)
    assert not space.is_free(*MIDDLE) and space.is_free(*ROOM)
    ends = [(pose.x, pose.y) for route in world.routes for pose in (route.start, route.goal)]
    proposed = [*(world.grid.position(name) for name in world.grid.valid), *ends]
    assert not [at for at in proposed if 6.5 < at[0] < 17.5 and 6.5 < at[1] < 17.5]
    assert len(world.routes) == 3
    assert any("--indoors" in note for note in created.notes)


U = [(0, 0), (30, 0), (30, 25), (26, 25), (26, 4), (4, 4), (4, 25), (0, 25), (0, 0)]
L = [(0, 0), (40, 0), (40, 4), (4, 4), (4, 30), (0, 30), (0, 0)]
T = [(0, 0), (40, 0), (40, 4), (22, 4), (22, 30), (18, 30), (18, 4), (0, 4), (0, 0)]
IN_U, BESIDE_U = [(15, 2), (2, 15), (28, 15)], [(15, 15), (15, 23), (6, 6)]
ALONG_WALLS = [(x, y) for x in (6.7, 12.0, 17.3) for y in (6.7, 12.0, 17.3)]
TABLE = (
    '<model name="table"><static>true</static><pose>12 9 0.4 0 0 0</pose><link name="l"><collision name="c">'
    "<geometry><box><size>1 2 0.8</size></box></geometry></collision></link></model>"
)
FURNISHED = ring(ceilings=False, yard=TABLE)
CLOSED = wall("inner south", (6.3, 17.7), (6.3, 6.5))
DOORS = "".join(
    wall(f"inner south {n}", x, (6.3, 6.5)) for n, x in enumerate([(6.3, 8.0), (9.2, 11.4), (12.6, 14.8), (16.0, 17.7)])
)
OPEN_HALL = outline([(0, 30), (0, 0), (20, 0), (20, 30)])
GATE_HALL = [
    *outline([(0, 0), (20, 0), (20, 20), (0, 20)], doors=3, name="h"),
    *outline([(0, 20), (0, 0)], doors=1, gap_m=4.0, name="f"),
    *outline([(0, 0), (0, -4), (24, -4), (24, 24), (0, 24), (0, 20)], name="a"),
]
"""A hall of 20 x 20 m with a gate of 4 m, and rooms of 4 m behind its other walls, each with a door."""
PILLAR = [
    wall("a", (0.0, 5.0), (0.0, 0.9)), wall("b", (0.0, 5.0), (4.1, 5.0)), wall("c", (0.0, 0.9), (0.0, 5.0)),
    wall("d", (4.1, 5.0), (0.0, 5.0)), wall("pillar", (2.4, 2.6), (2.4, 2.6)),
]  # fmt: skip
CASES: dict[str, tuple[str, dict[str, Any], Points, Points]] = {
    "no-door": (ring(ceilings=False, door=False), {}, [ROOM], ALONG_WALLS),
    "ceilings-gate": (ring(ceilings=True, gate=True), {}, [ROOM], ALONG_WALLS),
    "court": (ring(ceilings=False), {}, [ROOM], ALONG_WALLS),
    "court-indoors": (ring(ceilings=False), {"indoors": (MIDDLE,)}, [MIDDLE, ROOM], []),
    "ceilings-indoors": (ring(ceilings=True), {"indoors": (MIDDLE,)}, [MIDDLE, ROOM], []),
    "furniture": (FURNISHED, {}, [MIDDLE], []),
    "furniture-outdoors": (FURNISHED, {"outdoors": (MIDDLE,)}, [], [MIDDLE]),
    "trees": (FURNISHED.replace('"table"', '"oak_tree"'), {}, [], [MIDDLE]),
    "many-doors": (ring(ceilings=False).replace(CLOSED, DOORS), {}, [MIDDLE], []),
    "pillars": (building(*PILLAR), {}, [(1.5, 1.5)], [(2.5, 2.5)]),
    # a corridor with two legs: the floor beside it is larger, but outside
    "corridor": (building(*outline([(0, 0), (40, 0), (40, 3), (3, 3), (3, 30), (0, 30), (0, 0)])), {},
                 [(1.5, 15.0), (20.0, 1.5)], [(20.0, 15.0)]),
    "U": (building(*outline(U)), {}, IN_U, BESIDE_U),
    "U-door": (building(*outline(U, doors=1)), {}, IN_U, BESIDE_U),
    "U-indoors": (building(*outline(U, doors=1)), {"indoors": ((15, 8),)}, [(15, 8)], []),
    "L": (building(*outline(L)), {}, [(20, 2), (2, 15)], [(20, 15)]),
    "L-door": (building(*outline(L, doors=1)), {}, [(20, 2), (2, 15)], [(20, 15)]),
    "T": (building(*outline(T)), {}, [(10, 2), (20, 20)], [(10, 15), (30, 15)]),
    "T-door": (building(*outline(T, doors=1)), {}, [(10, 2), (20, 20)], [(10, 15), (30, 15)]),
    "open-front": (building(*OPEN_HALL), {}, [(10, 15), (3, 20)], []),
    "office-in-hall": (building(*OPEN_HALL, *outline([(6, 0), (6, 6), (0, 6)], doors=1, name="o")), {},
                       [(10, 15), (3, 20)], []),
    "wide-gate": (building(*GATE_HALL), {}, [(10, 10), (22, 10)], []),
}  # fmt: skip


@pytest.mark.parametrize(("text", "choices", "inside", "outside"), CASES.values(), ids=CASES)
def test_floor_is_inside(tmp_path: Path, text: str, choices: dict[str, Any], inside: Points, outside: Points) -> None:
    space = floor(tmp_path, text, **choices)
    assert all(space.is_free(*at) for at in inside)
    assert not any(space.is_free(*at) for at in outside)


@pytest.mark.parametrize(
    ("text", "choices"),
    [
        (ring(ceilings=False), {"indoors": ((0.1, 0.1),)}),
        (ring(ceilings=False), {"outdoors": ((50.0, 0.0),)}),
        (building(*outline(U, doors=1)), {"indoors": ((15, 24),)}),
    ],
)
def test_a_point_off_the_floor_is_refused(tmp_path: Path, text: str, choices: dict[str, Any]) -> None:
    with pytest.raises(InputError, check=coded("no-floor")):
        floor(tmp_path, text, **choices)
    with pytest.raises(FileError, check=coded("no-floor")):
        world_from("sdf", tmp_path / "b.world", name="b", **choices)


def test_walls_of_one_model_that_meet_and_share_faces_stay_whole(tmp_path: Path) -> None:
    """Two walls end to end, both flush with a third and overlapping it at the corner."""
    parts = [wall("a", (0.0, 4.0), (0.0, 0.2)), wall("b", (4.0, 9.0), (0.0, 0.2)), wall("c", (0.0, 0.2), (0.0, 9.0))]
    (tmp_path / "w.sdf").write_text(building(*parts))
    (thing,) = load_sdf(tmp_path / "w.sdf").objects
    for outlines in ((thing.footprint, *thing.holes), thing.slices):
        assert Polygon(outlines[0], outlines[1:]).area == pytest.approx(9.0 * 0.2 * 2 - 0.04, abs=1e-3)


def test_a_small_part_of_a_building_is_not_called_after_the_building(tmp_path: Path) -> None:
    walls = outline([(0.1, 0.1), (8.9, 0.1), (8.9, 8.9), (0.1, 8.9), (0.1, 0.1)])
    (tmp_path / "b.sdf").write_text(building(*walls, wall("e", (4.2, 4.8), (4.2, 4.8)), name="Acme"))
    read = load_sdf(tmp_path / "b.sdf")
    areas = propose_areas(read.objects, mapped(read, None, []))
    assert "Fixture" in {area.name for area in areas} and not any("Acme" in area.name for area in areas)
