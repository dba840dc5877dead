"""A report says whether its robot is calibrated."""

from __future__ import annotations

from rvsg.report.answer import robot_words
from rvsg.scenario.scenario import Mission
from rvsg.world.world_folder import load_world


def test_only_the_calibrated_robot_is_called_calibrated() -> None:
    world = load_world("warehouse")
    words = {
        name: robot_words(Mission.of(world, world.routes[0], robot=name))
        for name in ("tiago_omni", "tugger", "elsewhere")
    }
    assert "calibrated" in words["tiago_omni"] and "not calibrated" not in words["tiago_omni"]
    assert "not calibrated" in words["tugger"]
    assert words["elsewhere"] == "elsewhere"
