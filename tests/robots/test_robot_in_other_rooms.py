"""What assumed the default robot takes the robot of the mission."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from tests.evaluation.runs import run_of, trajectory

from rvsg.core.records import Pose
from rvsg.evaluation.detection import obstacle_contacts, place_namer
from rvsg.evaluation.metrics.registry import measure
from rvsg.evaluation.sampled import Sampled
from rvsg.generation.forecast import forecaster_of
from rvsg.robots.robot import load_robot
from rvsg.scenario.placement import robot_reach_m, start_gap_m
from rvsg.scenario.scenario import Mission
from rvsg.simulation.archive import PackedRun, run_from_json, run_to_json
from rvsg.simulation.run import ObstacleContact, Run
from rvsg.world.routes import robot_stands
from rvsg.world.space import robot_space
from rvsg.world.world_folder import load_world

WORLD = load_world("warehouse")


def passing() -> Run:
    """The robot drives 2 m at 0.5 m/s; a person stands 1 m beside its way."""
    t = np.arange(0.0, 4.1, 0.1)
    still = np.zeros_like(t)
    return run_of(trajectory(t, 0.5 * t, v=still + 0.5, humans=[(still + 3.0, still + 1.0)]))


MISSION = Mission(world=WORLD.name, world_id=WORLD.id, route=WORLD.route("route_1"))
TUGGER = MISSION.replace(robot="tugger")


def at(mission: Mission, ahead: float, left: float) -> tuple[float, float]:
    start = mission.route.start
    cos, sin = math.cos(start.yaw), math.sin(start.yaw)
    return start.x + ahead * cos - left * sin, start.y + ahead * sin + left * cos


def test_the_checker_measures_from_the_body_of_another_robot() -> None:
    assert start_gap_m(0.4, at(MISSION, 1.0, 0.0), MISSION) == pytest.approx(1.0 - 0.3585 - 0.4)
    assert start_gap_m(0.4, at(TUGGER, 1.65, 0.0), TUGGER) == pytest.approx(0.1)
    assert start_gap_m(0.4, at(TUGGER, 0.4, 1.0), TUGGER) == pytest.approx(1.0 - 0.325 - 0.4)
    assert start_gap_m(0.4, at(TUGGER, 1.0, 0.0), TUGGER) < 0.0
    assert robot_reach_m(MISSION) == 0.35
    assert robot_reach_m(TUGGER) == pytest.approx(math.hypot(1.15, 0.325))


def test_the_forecast_takes_speed_and_size_of_another_robot() -> None:
    usual = forecaster_of(MISSION, WORLD)
    waffle = forecaster_of(MISSION.replace(robot="turtlebot3_waffle"), WORLD)
    assert waffle.robot_speed == pytest.approx(0.98 * 0.22)
    assert waffle.robot_radius == 0.22
    assert (usual.robot_speed, usual.robot_radius) != (waffle.robot_speed, waffle.robot_radius)


def test_a_route_proposal_asks_for_the_room_the_robot_takes() -> None:
    space = robot_space(WORLD)
    start = WORLD.route("route_1").start
    tugger = load_robot("tugger")
    huge = tugger.replace(footprint=((9.0, 4.0), (-9.0, 4.0), (-9.0, -4.0), (9.0, -4.0)), body=tugger.footprint)
    assert robot_stands(space, start, load_robot("turtlebot3_waffle"))
    assert not robot_stands(space, Pose(x=start.x, y=start.y), huge)


def test_the_stopping_distance_is_that_of_the_robot() -> None:
    run = passing()
    slow = dataclasses.replace(run, robot_deceleration_m_s2=0.5, robot_latency_s=0.2)
    assert measure(slow, ["stopping_margin"])["stopping_margin"] < measure(run, ["stopping_margin"])["stopping_margin"]
    assert PackedRun.of(slow).unpack().robot_latency_s == 0.2
    assert run_from_json(run_to_json(slow)).robot_deceleration_m_s2 == 0.5


def test_a_recorded_contact_with_an_obstacle_is_an_event_of_the_run() -> None:
    touched = ObstacleContact(time_s=0.5, until_s=0.7, x=1.0, y=2.0, speed_m_s=0.3)
    run = dataclasses.replace(passing(), events=(touched,))
    (found,) = obstacle_contacts(Sampled(run, run.trajectory), place_namer(None))
    assert (found.time_s, found.until_s, found.speed_m_s, found.place.x) == (0.5, 0.7, 0.3, 1.0)
