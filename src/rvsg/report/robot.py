"""The robot of a mission in words, with whether its simulated runs were compared with published ones."""

from __future__ import annotations

from rvsg.scenario.scenario import Mission


def robot_words(mission: Mission) -> str:
    """Return the robot's name and whether it is calibrated; the name alone where only another simulator knows it."""
    robot = mission.robot_record
    if robot is None:
        return mission.robot_name
    return f"{robot.name} ({'' if robot.calibrated else 'not '}calibrated against published runs)"
