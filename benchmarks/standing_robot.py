"""Who walks into a robot that stands: people of searched scenarios, of every behaviour that sees the robot.

    python benchmarks/standing_robot.py [--runs 1000] [--attention attentive] [--worlds warehouse office hospital]
        [--campaigns FOLDER]

A campaign of each world finds scenarios by `no_contact`; FOLDER keeps the campaigns. In each run the robot stands
somewhere on the way that it drives where nobody is about, and everybody has the behaviour whose turn it is. Prints
JSON: runs and touched runs by behaviour, and the touches. Runs that would begin on somebody do not count.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import rvsg
from rvsg.core.records import Pose
from rvsg.scenario.scenario import Attention, Behaviour
from rvsg.simulation.events import Contact
from rvsg.stacks import WholeStack

WORLDS = ("warehouse", "office", "hospital")
STANDS_S = 60.0


class Standing(WholeStack):
    """Stays where it is."""

    def reset(self, task: Any) -> None:
        """Nothing is kept."""

    def step(self, seen: Any) -> tuple[float, float]:
        """Answer no velocity."""
        return 0.0, 0.0


def searched(place: Path, world: str) -> list[rvsg.Scenario]:
    """Return the scenarios with people that a campaign in a world tries; run it if there is none in the folder."""
    if not place.exists():
        settings = {"world": world, "requirement": "no_contact", "seed": 0, "scenarios": 8, "jobs": 1, "shrink_runs": 0}
        for _ in rvsg.Campaign.create(place, **settings).run():
            pass
    tried = (attempt.proposal.scenario for attempt in rvsg.Campaign.open(place).attempts())
    return list({each.id: each for each in tried if each is not None and each.people.humans}.values())


def standing_runs(
    folder: Path, worlds: Sequence[str], number: int, attention: Attention
) -> Iterator[tuple[Behaviour, rvsg.Run]]:
    """Yield runs in which the robot stands on its way."""
    rng, behaviours, ways = np.random.default_rng(1), list(Behaviour), dict[str, Any]()
    scenarios = [(name, each) for name in worlds for each in searched(folder / name, name)]
    for k in range(number):
        name, scenario = scenarios[int(rng.integers(len(scenarios)))]
        mission, people, behaviour = scenario.mission, scenario.people, behaviours[k % len(behaviours)]
        if mission.id not in ways:
            ways[mission.id] = rvsg.simulate(scenario.replace(people=people.replace(humans=())), [0], world=name)[0]
        way = ways[mission.id].trajectory
        row = int(rng.integers(len(way)))
        start = Pose(x=float(way.x[row]), y=float(way.y[row]), yaw=float(way.yaw[row]))
        route = mission.route.replace(start=start, through=(), time_limit_s=STANDS_S)
        how = {"behaviour": behaviour, "reaction": None, "attention": attention}
        humans = tuple(human.replace(**how) for human in people.humans)
        stands = scenario.replace(mission=mission.replace(route=route), people=people.replace(humans=humans))
        if not rvsg.check(stands, name):
            yield behaviour, rvsg.simulate(stands, [k], world=name, stack=Standing())[0]


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--attention", type=Attention, default=Attention.ATTENTIVE)
    parser.add_argument("--worlds", nargs="+", default=WORLDS)
    parser.add_argument("--campaigns", type=Path)
    given = parser.parse_args()
    runs, touched, touches = Counter[str](), Counter[str](), []
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.campaigns or Path(temporary)
        for behaviour, run in standing_runs(folder, given.worlds, given.runs, given.attention):
            contacts = [event.model_dump(mode="json") for event in run.events if isinstance(event, Contact)]
            runs[behaviour.value] += 1
            touched[behaviour.value] += bool(contacts)
            touches += [{"seed": run.seed, "behaviour": behaviour.value, **contact} for contact in contacts[:1]]
    print(json.dumps({"of": runs.total(), "in": touched.total(), "runs": runs, "touched": touched,
                      "touches": touches}, indent=1))  # fmt: skip


if __name__ == "__main__":
    main()
