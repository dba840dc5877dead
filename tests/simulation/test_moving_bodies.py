"""Automatic doors, trolleys and wheelchairs in the embedded simulator."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import shapely
from tests.simulation.parts import ALONG, END, HINGE, hall, person, run_along

from rvsg.core.errors import InputError
from rvsg.core.records import Pose
from rvsg.evaluation.detection import events_of
from rvsg.evaluation.sampled import Sampled
from rvsg.evaluation.story import what_is_hit
from rvsg.scenario.scenario import Attention, PersonKind, Trolley
from rvsg.simulation.archive import PackedRun
from rvsg.simulation.embedded.episode import Outside
from rvsg.simulation.embedded.profiles import profile
from rvsg.simulation.embedded.simulator import simulate_agents
from rvsg.simulation.events import Contact, DoorMoved, ObstacleContact
from rvsg.simulation.run import Outcome, Run
from rvsg.world.space import human_space
from rvsg.world.world import Door


def door(**given: object) -> Door:
    return Door.model_validate({"name": "D", "hinge": HINGE, "end": END, "kind": "sliding", **given})


def doors(found: Run) -> list[DoorMoved]:
    return [event for event in found.events if isinstance(event, DoorMoved)]


def bodies(found: Run, row: int) -> tuple[shapely.Polygon, shapely.Polygon]:
    """Return the robot and what the person pushes at a sample."""
    t = found.trajectory
    placed = []
    for outline, x, y, yaw in (
        (found.robot_outline, t.x[row], t.y[row], t.yaw[row]),
        (found.human_outlines[0], t.human_x[row, 0], t.human_y[row, 0], t.human_yaw[row, 0]),
    ):
        cos, sin = np.cos(yaw), np.sin(yaw)
        placed.append(shapely.Polygon(np.array(outline) @ np.array([[cos, sin], [-sin, cos]]) + (x, y)))
    return placed[0], placed[1]


def test_an_automatic_door_opens_for_the_robot_and_closes_behind_it() -> None:
    far = hall(door(range_m=3.5))  # opens before a lidar has marked it in the costmaps: else the planner finds no way
    opened = run_along(far)
    assert opened.outcome is Outcome.REACHED
    first, last = doors(opened)[0], doors(opened)[-1]
    assert first.opens and not last.opens
    at = int(np.searchsorted(opened.trajectory.t, first.time_s))
    assert np.hypot(opened.trajectory.x[at] - 8.0, opened.trajectory.y[at] - 2.0) == pytest.approx(3.5, abs=0.1)
    assert opened.trajectory.x[int(np.searchsorted(opened.trajectory.t, last.time_s))] > 11.5
    assert PackedRun.of(run_along(far)).data == PackedRun.of(opened).data


def test_a_door_that_opens_for_people_only_stops_the_robot_until_somebody_comes() -> None:
    only = hall(door(opens_for=["people"]))
    alone = run_along(only, time_limit_s=25.0)
    assert alone.outcome is not Outcome.REACHED
    assert alone.trajectory.x.max() < 8.0
    assert not any(isinstance(event, ObstacleContact) for event in alone.events)


@pytest.mark.parametrize("kind", ["sliding", "swing"])
def test_a_person_waits_for_the_leaf_and_passes(kind: str) -> None:
    found = run_along(hall(door(kind=kind, range_m=1.0)), person((12, 3), (9, 2), (7, 2), (5, 3), speed_m_s=1.5))
    x = found.trajectory.human_x[:, 0]
    assert x.min() < 6.0
    first = doors(found)[0]
    opening = (found.trajectory.t > first.time_s) & (found.trajectory.t < first.time_s + 0.3)
    assert (np.abs(x[opening] - 8.0) > 0.1).all()


def test_a_closed_door_is_solid_and_not_on_the_map() -> None:
    closed, without = hall(door(state="closed")), hall()
    assert (closed.occupancy.cells == without.occupancy.cells).all()
    assert closed.id != without.id and closed.floor_id != without.floor_id
    assert human_space(without).segment_free((7.0, 2.0), (9.0, 2.0))
    assert not human_space(closed).segment_free((7.0, 2.0), (9.0, 2.0))
    assert [thing.kind for thing in closed.solids if thing not in closed.objects] == ["door"]
    assert run_along(closed, time_limit_s=20.0).trajectory.x.max() < 8.0


@pytest.mark.parametrize(
    ("given", "y", "named"),
    [
        ({"kind": "swing", "state": "open"}, 1.35, "D"),
        ({"kind": "swing"}, 1.35, "D"),
        ({"kind": "swing", "opening_s": 12.0, "range_m": 4.0}, 1.35, "D"),
        ({"kind": "swing", "state": "closed"}, 2.0, "D"),
        ({"kind": "sliding", "range_m": 0.5}, 2.0, "D"),
        ({"kind": "swing", "state": "open", "turns": "right"}, 1.35, ""),  # the leaf is behind the frame that it hits
        ({"kind": "swing"}, 2.65, ""),  # the frame on the other side, long after the leaf left it
        ({"kind": "sliding"}, 1.35, ""),
    ],
)
def test_a_contact_with_a_leaf_names_the_door(given: dict[str, object], y: float, named: str) -> None:
    world = hall(door(**given))
    route = ALONG.model_copy(update={"start": Pose(x=2.0, y=y), "time_limit_s": 20.0})
    found = simulate_agents(world, route, [], seed=1, outside=Outside(stack=lambda _: (0.5, 0.0), stack_ticks=5))
    hit = [event for event in events_of(found, world=world) if isinstance(event, ObstacleContact)]
    assert hit and hit[0].door == named
    assert what_is_hit(hit[0]) == ("the door D" if named else "an obstacle")
    assert not any(event.door for event in events_of(found) if isinstance(event, ObstacleContact))


@pytest.fixture(scope="module")
def pushed() -> Run:
    return run_along(hall(gap=False), person((13, 2), (2, 2), trolley=Trolley(length_m=1.0)))


def test_a_trolley_is_a_body_that_does_not_enter_the_robot(pushed: Run) -> None:
    gap = Sampled(pushed, pushed.trajectory).gap[:, 0]
    for row in range(0, len(pushed.trajectory), 5):
        robot, trolley = bodies(pushed, row)
        assert robot.intersection(trolley).area < 0.002
        assert min(gap[row], 3.0) <= robot.distance(trolley) + 0.02
    assert pushed.human_outlines[0][1][0] == pytest.approx(1.5)


def test_a_trolley_is_pushed_within_its_acceleration(pushed: Run) -> None:
    path, times = pushed.trajectory, np.arange(0.5, pushed.trajectory.t[-1], 0.1)
    places = [np.interp(times, path.t, way[:, 0]) for way in (path.human_x, path.human_y)]
    acceleration = np.hypot(*np.diff(places, n=2)) / 0.1**2
    assert np.percentile(acceleration, 95) <= 2.0
    assert acceleration.max() <= 2.6


def test_the_robot_makes_way_for_a_trolley_that_its_lidar_sees_and_that_turns_slowly(pushed: Run) -> None:
    without = run_along(hall(gap=False), person((13, 2), (2, 2)))
    first = [float(np.abs(r.trajectory.y - 2.0)[r.trajectory.x < 6.5].max()) for r in (pushed, without)]
    assert first[0] != first[1]
    assert PackedRun.of(pushed).unpack().human_outlines == pushed.human_outlines
    assert np.abs(np.diff(np.unwrap(pushed.trajectory.human_yaw[:, 0]))).max() <= 1.8 * 0.1 + 1e-6


def test_contact_with_a_trolley_is_contact_with_the_person() -> None:
    """Somebody who does not see the robot comes through the gap that it is in."""
    pusher = person((14, 2), (2, 2), trolley=Trolley(), speed_m_s=1.2).model_copy(
        update={"attention": Attention.UNSEEING}
    )
    found = run_along(hall(), pusher)
    touched = [event for event in found.events if isinstance(event, Contact) and event.part == "trolley"]
    assert touched and touched[0].closing_speed_m_s > 0.2
    assert [touch.recorded for touch in Sampled(found, found.trajectory).contacts if touch.recorded in touched]
    walls = [event for event in found.events if isinstance(event, ObstacleContact)]
    assert not [wall for wall in walls if abs(wall.x - 8.0) > 1.0 and 0.5 < wall.y < 3.5]


def test_a_wheelchair_is_as_wide_as_its_frame() -> None:
    found = run_along(hall(gap=False), person((13, 2), (2, 2), kind=PersonKind.WHEELCHAIR, radius_m=0.33))
    disc = dataclasses.replace(found, human_outlines=())
    sampled, smaller = Sampled(found, found.trajectory), Sampled(disc, disc.trajectory)
    assert (sampled.gap <= smaller.gap + 1e-12).all()
    assert sampled.gap.min() < smaller.gap.min()


def test_a_wheelchair_follows_somebody_slower_as_people_walk() -> None:
    slow = person((6, 2), (15, 2), speed_m_s=0.6, radius_m=0.25)
    chair = person((4.5, 2), (15, 2), kind=PersonKind.WHEELCHAIR, radius_m=0.33, speed_m_s=1.2)
    found = run_along(hall(gap=False), slow, chair, time_limit_s=10.0).trajectory
    times = np.arange(0.5, 10.0, 0.1)
    places = [[np.interp(times, found.t, way[:, k]) for k in (0, 1)] for way in (found.human_x, found.human_y)]
    assert np.hypot(*np.diff(places, n=2, axis=2)).max() / 0.1**2 <= 1.7


def test_the_profile_of_the_study_knows_none_of_them() -> None:
    with pytest.raises(InputError):
        simulate_agents(hall(door()), ALONG, (), options=profile("published-study"))
