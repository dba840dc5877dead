from rvsg.core.errors import UnknownName
from rvsg.core.records import Pose
from rvsg.world.grid import Grid, Waypoint


def test_a_changed_copy_has_an_id_of_its_own() -> None:
    pose = Pose(x=1.0, y=2.0)
    known = pose.id
    copy = pose.model_copy(update={"x": 3.0})
    assert copy.id != known
    assert copy.id == Pose(x=3.0, y=2.0).id == pose.replace(x=3.0).id
    assert pose.id == known


def test_nothing_computed_of_the_original_is_carried_over() -> None:
    grid = Grid(rows=("A",), columns=("1",), waypoints=(Waypoint(name="A1", x=0, y=0, row=0, column=0),), hops=())
    assert grid.valid == {"A1"}
    assert grid.model_copy(update={"waypoints": ()}).valid == frozenset()


def test_a_name_that_differs_in_a_number_only_is_not_suggested() -> None:
    assert UnknownName("route", "route_9", ["route_1", "route_3"]).nearest is None
    assert UnknownName("requirement", "R9", ["R1", "R3"]).nearest is None
    assert UnknownName("route", "rout_3", ["route_1", "route_3"]).nearest == "route_3"
    assert UnknownName("route", "rote_9", ["route_1", "route_9"]).nearest == "route_9"
