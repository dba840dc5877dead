"""How people of searched scenarios turn and pace, beside recorded people.

    python benchmarks/pacing.py [--worlds warehouse office] [--requirement no_contact] [--scenarios 3] > F.json

Runs a campaign for each world and measures every run of its search. Walking: faster than 0.3 m/s over 0.8 s. Turning
round: more than 120° between the ways of the 1.2 s before and after, each at least 0.5 m, places every 0.4 s. Turns and
straightness: windows of 6.4 s never below 0.3 m/s, places every 0.8 s; straightness is distance over way. Goals: 0.1 a
minute and 2 % of people; 0.3 turns beyond 60° in 10 m; straightness 0.95 in the median, 0.85 at the 10th percentile.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rvsg
from rvsg.evaluation.realism import SAMPLE_S, turning
from rvsg.scenario.validity import about_turns

STEP_S, WINDOW, WALKING_M_S = 0.8, 8, 0.3


def measured(runs: Iterable[rvsg.Run]) -> dict[str, Any]:
    """Return the figures of all people of some runs."""
    people = rounds = turners = turns = 0
    minutes = metres = 0.0
    straight: list[float] = []
    for run in runs:
        path = run.trajectory
        for h in range(len(run.human_names)):
            fine, coarse = (_places(path, h, step) for step in (SAMPLE_S, STEP_S))
            if fine.shape[1] < WINDOW:
                continue
            hops = np.hypot(*np.diff(coarse))
            walks = hops > WALKING_M_S * STEP_S
            count, _ = turning(fine)
            people, rounds, turners = people + 1, rounds + count, turners + (count > 0)
            minutes += float(walks.sum()) * STEP_S / 60.0
            for k in range(0, len(hops) - WINDOW + 1, WINDOW):
                if walks[k : k + WINDOW].all():
                    part = coarse[:, k : k + WINDOW + 1]
                    way = part[0] + 1j * part[1]
                    steps = np.diff(way)
                    turns += int((np.abs(np.angle(steps[1:] / steps[:-1])) > np.pi / 3.0).sum())
                    metres += float(np.abs(steps).sum())
                    straight.append(float(abs(way[-1] - way[0]) / np.abs(steps).sum()))
    return {
        "people": people,
        "minutes_walked": round(minutes, 1),
        "turning_round_a_minute": round(rounds / max(minutes, 1e-9), 3),
        "people_who_turn_round": round(turners / max(people, 1), 3),
        "turns_beyond_60_in_10_m": round(10.0 * turns / max(metres, 1e-9), 3),
        "straightness_p50_p10": [round(float(np.percentile(straight or [np.nan], q)), 3) for q in (50, 10)],
    }


def _places(path: Any, person: int, step_s: float) -> NDArray[np.float64]:
    times = np.arange(float(path.t[0]), float(path.t[-1]), step_s)
    return np.stack([np.interp(times, path.t, axis[:, person]) for axis in (path.human_x, path.human_y)])


def searched(world: str, requirement: str, scenarios: int, seed: int) -> dict[str, Any]:
    """Search, and measure the runs and the scenarios."""
    with tempfile.TemporaryDirectory() as folder:
        campaign = rvsg.Campaign.create(
            Path(folder) / "campaign", world=world, route="route_1", requirement=requirement, scenarios=scenarios,
            seed=seed, shrink_runs=0, jobs=1,
        )  # fmt: skip
        for _ in campaign.run():
            pass
        written = [a.proposal.scenario for a in campaign.attempts() if a.purpose == "search" and a.proposal.scenario]
        humans = [human for scenario in written for human in scenario.people.humans]
        paces = sum(bool(about_turns(human, campaign.world.grid)) for human in humans)
        confirmed = sum(each.verdict.status.value in ("FAIL", "FLAKY") for each in campaign.findings)
        told = {"world": world, "requirement": requirement, "scenarios": scenarios, "seed": seed}
        written_ = {"people_written": len(humans), "who_pace_as_written": paces, "confirmed_failures": confirmed}
        return {**told, **written_, **measured(campaign.runs())}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--worlds", nargs="+", default=["warehouse", "office"])
    parser.add_argument("--requirement", default="no_contact")
    parser.add_argument("--scenarios", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rows = [searched(world, given.requirement, given.scenarios, given.seed) for world in given.worlds]
    print(json.dumps(rows, indent=1))
