"""OpenSCENARIO DSL in the dialect of scenario-execution (https://github.com/IntelLabs/scenario_execution).

The robot is initialised and drives the route with Nav2; people are run by HuNavSim from its agents file, since the
dialect has no action for people who walk and react.
"""

from __future__ import annotations

import re

from rvsg.core.records import Pose
from rvsg.scenario.scenario import Scenario
from rvsg.world.world import World


def scenario_osc(scenario: Scenario, world: World, *, agents_file: str = "agents.yaml") -> str:
    """Return a scenario as OpenSCENARIO DSL.

    Args:
        scenario: the scenario; its mission becomes the robot's actions, its time limit the timeout.
        world: the world of the scenario; poses are shifted by `map_offset` into the map frame.
        agents_file: the HuNavSim file that holds the people; a comment names it.
    """
    route = scenario.mission.route
    poses = (*route.through, route.goal)
    people = "".join(
        f"# - {_comment(human.name)}: {human.behaviour.value}, {human.speed_m_s:g} m/s, {len(human.tasks)} tasks\n"
        for human in scenario.people.humans
    )
    if len(poses) == 1:
        drive = f"robot.nav_to_pose({_pose(poses[0], world)})"
    else:
        listed = ",\n            ".join(_pose(pose, world) for pose in poses)
        drive = f"robot.nav_through_poses([\n            {listed}\n        ])"
    return (
        f"# {_comment(scenario.description) or 'A scenario of RVSG'}\n"
        f"# {scenario.id}, world {_comment(scenario.mission.world)}, {_comment(route.name)}\n"
        f"# People (HuNavSim reads them from {_comment(agents_file)}):\n{people or '# - none' + chr(10)}"
        "import osc.helpers\nimport osc.ros\nimport osc.nav2\n\n"
        f"scenario {_identifier(scenario.id)}:\n"
        f"    timeout({route.time_limit_s:g}s)\n"
        "    robot: differential_drive_robot\n"
        "    do serial:\n"
        f"        robot.init_nav2({_pose(route.start, world)})\n"
        f"        {drive}\n"
    )


def _pose(pose: Pose, world: World) -> str:
    dx, dy = world.map_offset
    position = f"position_3d(x: {pose.x - dx:.6f}m, y: {pose.y - dy:.6f}m)"
    return f"pose_3d({position}, orientation: orientation_3d(yaw: {pose.yaw:.6f}rad))"


def _comment(text: str) -> str:
    return " ".join(text.split())


def _identifier(text: str) -> str:
    return re.sub(r"\W", "_", text)
