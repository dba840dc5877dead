"""What differs between two versions of a world, and whether it matters to saved scenarios."""

from dataclasses import replace

from tests.world.parts import map_of, walled

from rvsg.core.records import Pose
from rvsg.world.diff import Difference, differences
from rvsg.world.grid import GridSpec
from rvsg.world.lattice import build_world
from rvsg.world.world import Area, Route, World

SPEC = GridSpec(spacing_m=1.0, origin=(0.5, 0.5))


def hall(*, pillar: bool = False, spec: GridSpec = SPEC) -> World:
    """A hall of 10 x 6 m, with or without a pillar of 0.5 m."""
    cells = walled(120, 200)
    if pillar:
        cells[60:70, 100:110] = 100
    dock = Area(name="Dock", outline=((1, 1), (3, 1), (3, 3), (1, 3)), waypoints=())
    route = Route(name="r", start=Pose(x=1, y=1), goal=Pose(x=8, y=4), time_limit_s=20)
    return build_world(name="hall", occupancy=map_of(cells), areas=(dock,), routes=(route,), grid_spec=spec)


def those_that_matter(old: World, new: World) -> list[Difference]:
    return [difference for difference in differences(old, new) if difference.matters]


def test_a_world_does_not_differ_from_itself() -> None:
    assert differences(hall(), hall()) == ()


def test_words_routes_and_activities_are_told_and_do_not_matter() -> None:
    old = hall()
    renamed = old.areas[0].model_copy(update={"name": "Ramp"})
    route = old.routes[0].model_copy(update={"name": "other"})
    new = replace(old, areas=(renamed,), routes=(*old.routes, route), activities=("a courier waits",))
    found = differences(old, new)
    assert {d.part for d in found} == {"areas", "routes", "activities"}
    assert not any(d.matters for d in found)
    assert any("Dock" in d.message and "Ramp" in d.message for d in found)


def test_a_pillar_closes_floor_and_takes_a_waypoint() -> None:
    found = those_that_matter(hall(), hall(pillar=True))
    assert {d.part for d in found} == {"map", "waypoints"}
    assert any("0.2 m² of floor closed" in d.message or "0.3 m² of floor closed" in d.message for d in found)


def test_a_moved_waypoint_is_named_with_its_distance() -> None:
    lines = hall().parts
    spec = GridSpec(rows=lines.rows, columns={int(k): v for k, v in lines.columns.items()})
    moved = spec.model_copy(update={"moved": {"B3": (2.9, 4.5)}})
    found = those_that_matter(hall(spec=spec), hall(spec=moved))
    assert [d.message for d in found] == ["Waypoint B3 moved by 0.4 m."]


def test_the_floors_id_holds_no_names() -> None:
    old = hall()
    assert replace(old, areas=(), routes=(), title="Other").floor_id == old.floor_id
    assert hall(pillar=True).floor_id != old.floor_id
