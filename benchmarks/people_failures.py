"""Confirmed failures with the people of 0.2 (profile `hunavsim`) and with the present ones (`default`).

    python benchmarks/people_failures.py [--seed 1] [--routes route_1] [--scenarios 10] > FILE.json

Runs a campaign with default settings for each shipped world, requirement and profile. Every scenario that a campaign
confirms, and every known failure of the suites in `examples`, is simulated again with fresh seeds and the people of
both profiles. A failure `remains` if people of the other profile cause it too, else it `vanishes`; one that only the
present people cause `appears`. Bodies of 0.4 m that a scenario of 0.2 states become those of the profile.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import rvsg
from rvsg.core.plugins import Spec
from rvsg.evaluation.verdict import violated
from rvsg.scenario.scenario import HUNAVSIM_RADIUS_M
from rvsg.simulation.events import Contact

PROFILES = ("hunavsim", "default")
REQUIREMENTS = ("R1", "R3")
WORLDS = ("warehouse", "hospital", "office")
SUITES = Path(__file__).parent.parent / "examples" / "suites"
RUNS = 30
FIRST_SEED = 100_000
"""Seeds from here on are used by no search and no confirmation."""


def with_own_bodies(scenario: rvsg.Scenario) -> rvsg.Scenario:
    """Return the scenario without the body radius that version 0.2 wrote into every person."""
    humans = tuple(
        human.model_copy(update={"radius_m": None}) if human.radius_m == HUNAVSIM_RADIUS_M else human
        for human in scenario.people.humans
    )
    return scenario.model_copy(update={"people": scenario.people.model_copy(update={"humans": humans})})


def repeated(scenario: rvsg.Scenario, requirement: str, world: Any) -> dict[str, Any]:
    """Return, by profile, the verdict on a scenario and the number of runs with a contact of robot and person."""
    found = {}
    for name in PROFILES:
        simulator = Spec("embedded", {"profile": name})
        runs = rvsg.simulate(scenario, range(FIRST_SEED, FIRST_SEED + RUNS), world=world, simulator=simulator)
        verdict = rvsg.judge(runs, requirement, world=world).verdict
        touched = sum(any(isinstance(event, Contact) for event in run.events) for run in runs)
        found[name] = {"violated": violated(verdict), "violations": verdict.violations, "contact_runs": touched}
    return found


def counted(cases: list[dict[str, Any]], found_with: str) -> dict[str, Any]:
    """Count how the repeated failures that were found with one profile turn out with both."""
    other = PROFILES[1 - PROFILES.index(found_with)]
    again = [case for case in cases if case[found_with]["violated"]]
    remaining = [case for case in again if case[other]["violated"]]
    return {
        "repeated": len(cases),
        f"fail_again_with_{found_with}": len(again),
        "remain": len(remaining),
        ("vanish" if found_with == "hunavsim" else "appear"): len(again) - len(remaining),
        "contact_runs": {name: sum(case[name]["contact_runs"] for case in again) for name in PROFILES},
        "runs": RUNS * len(again),
    }


def campaigns(world: str, route: str, seed: int, scenarios: int) -> Iterator[dict[str, Any]]:
    """Run the campaigns of a route with each profile; yield what they confirm, and its repetition."""
    for requirement in REQUIREMENTS:
        for name in PROFILES:
            with tempfile.TemporaryDirectory() as folder:
                campaign = rvsg.Campaign.create(
                    folder, world=world, route=route, requirement=requirement, scenarios=scenarios, seed=seed,
                    shrink_runs=0, jobs=1, simulator_options={"profile": name},
                )  # fmt: skip
                for _ in campaign.run():
                    pass
                confirmed = [each for each in campaign.findings if each.verdict.status.value in ("FAIL", "FLAKY")]
                attempts = {attempt.index: attempt for attempt in campaign.attempts()}
                cases = []
                for finding in confirmed:
                    scenario = attempts[finding.confirmation].proposal.scenario
                    assert scenario is not None
                    cases.append(repeated(scenario, requirement, campaign.world))
                yield {
                    "world": world, "route": route, "requirement": requirement, "profile": name,
                    "status": dict(Counter(each.verdict.status.value for each in campaign.findings)),
                    "failures": len(confirmed),
                    "contact_runs": sum(each.contacts.runs for each in confirmed),
                    "runs": sum(each.contacts.of for each in confirmed), "cases": cases,
                }  # fmt: skip


def suites() -> Iterator[dict[str, Any]]:
    """Repeat the known failures of the shipped suites with each profile."""
    for folder in sorted(SUITES.iterdir()):
        suite = rvsg.Suite.open(folder)
        known = [(case, e.requirement) for case in suite.cases for e in case.expectations if e.expected == "violation"]
        cases = [repeated(with_own_bodies(c.scenario), requirement, suite.worlds[c.name]) for c, requirement in known]
        yield {"suite": folder.name, **counted(cases, "hunavsim"), "cases": cases}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--routes", nargs="+", default=["route_1"])
    parser.add_argument("--scenarios", type=int, default=10)
    given = parser.parse_args()
    rows = []
    for place in WORLDS:
        for way in given.routes:
            for row in campaigns(place, way, given.seed, given.scenarios):
                rows.append(row)
                print({key: value for key, value in row.items() if key != "cases"}, file=sys.stderr, flush=True)
    total = {
        name: {
            "campaigns": sum(row["profile"] == name for row in rows),
            **{key: sum(r[key] for r in rows if r["profile"] == name) for key in ("failures", "contact_runs", "runs")},
            "again": counted([case for row in rows if row["profile"] == name for case in row["cases"]], name),
        }
        for name in PROFILES
    }  # fmt: skip
    print(json.dumps({"seed": given.seed, "scenarios": given.scenarios, "total": total, "campaigns": rows,
                      "suites": list(suites())}, indent=1))  # fmt: skip
