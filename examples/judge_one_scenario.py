"""Simulate one scenario 20 times on 2 cores and judge it by R1."""

import sys

import rvsg


def main(simulator: str = "embedded") -> rvsg.Judgement:
    """Simulate, judge and print."""
    world = rvsg.load_world("warehouse")
    anna = rvsg.walk("Anna", "E15", "H15", speed_m_s=0.8)
    scenario = rvsg.scenario(world, "route_1", [anna])
    runs = rvsg.simulate(scenario, seeds=20, jobs=2, simulator=simulator)
    verdict = rvsg.judge(runs, "R1")
    print(verdict)
    print(f"violated with probability {verdict.violation_probability:.2f}, 95 % interval {verdict.interval}")
    return verdict


if __name__ == "__main__":
    main(*sys.argv[1:2])
