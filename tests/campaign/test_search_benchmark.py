"""The benchmark of the searches asks for what a campaign would."""

from __future__ import annotations

import sys
from pathlib import Path

from rvsg.world.io.load import load_world

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
from search import options, plan_of


def test_a_limit_that_is_a_share_is_that_of_the_route() -> None:
    world = load_world("warehouse")
    plan = plan_of(options().parse_args(["--requirement", "R3", "--route", "route_2"]), world, 5)
    assert plan.requirement.threshold == 0.95 * world.route("route_2").time_limit_s
    assert (plan.seed, plan.mission.route.name) == (5, "route_2")
